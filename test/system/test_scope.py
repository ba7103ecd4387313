"""The built-in scope: an image without a display, the browser view, and its end with the run."""

import contextlib
import http.client
import math
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request

import matplotlib.image
import pytest
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from hdd_servo_ros.recording.compare_bags import first_difference

ENTRY_POINT = 'import sys; from hdd_servo_ros.executables import scope; sys.exit(scope())'


@pytest.fixture
def scope(bench):
    """Start `scope`; ended with the bench's other processes."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments, code=ENTRY_POINT):
        environment = {name: value for name, value in bench.environment.items() if 'DISPLAY' not in name}
        started.append(
            subprocess.Popen(
                [sys.executable, '-c', code, *arguments],
                cwd=bench.directory,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        output = started[-1].stdout
        assert output is not None
        line = output.readline()
        assert 'waiting for a run' in line
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def test_a_picture_of_a_run_and_the_same_bits(bench, scope):
    duration = ('-p', 'duration:=0.3')
    watching = scope('--save', 'live.png', '--seconds', '60')
    process = bench.start('rig', *duration, '-p', 'rate:=0.1', '-p', 'run_dir:=run', '-p', 'plot:=false')
    assert process.wait() == 0, process.output
    # It ends with the run, long before its sixty seconds; what a launch file sends it then is no failure.
    watching.send_signal(signal.SIGINT)
    assert watching.wait(200.0) == 0, watching.stdout.read()
    picture = matplotlib.image.imread(bench.directory / 'live.png')
    # Lines in the colors of the panels, not an empty frame.
    colors = {tuple(color) for color in (picture[::2, ::2, :3].reshape(-1, 3) * 255).astype(int)}
    assert picture.shape[:2] == (1080, 1200)
    assert {(31, 119, 180), (255, 127, 14)} <= colors
    bench.run('simulate', *duration, '-p', 'run_dir:=simulated', '-p', 'plot:=false')
    assert first_difference(bench.directory / 'run', bench.directory / 'simulated') is None


def test_the_view_in_the_browser_ends_with_the_run(bench, scope):
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    watching = scope('--port', str(port))
    process = bench.start('rig', '-p', 'duration:=0.3', '-p', 'rate:=0.1', '-p', 'run_dir:=run', '-p', 'plot:=false')
    deadline = time.monotonic() + 200.0
    page = ''
    while not page:
        try:
            with urllib.request.urlopen(f'http://127.0.0.1:{port}/', timeout=60.0) as answer:
                page = answer.read().decode()
        except urllib.error.URLError:
            assert time.monotonic() < deadline
            time.sleep(0.2)
    assert '<canvas' in page or 'mpl' in page
    own = f'127.0.0.1:{port}'
    assert status(port, own) == status(port, f'localhost:{port}', f'http://localhost:{port}') == 200
    for host, origin in ((f'evil.example:{port}', None), ('127.0.0.1', None), (own, 'http://evil.example')):
        assert status(port, host, origin) == 403
        assert status(port, host, origin, '/1/ws') == 403
    assert process.wait() == 0, process.output
    for line in watching.stdout:
        if 'the run has ended' in line:
            break
    # Again and again while it ends.
    while watching.poll() is None:
        watching.send_signal(signal.SIGINT)
        time.sleep(0.01)
    assert watching.returncode == 0
    assert 'has ended' in line


def status(port, host, origin=None, path='/'):
    """Return the answer to a request that asks for this server by the name ``host``."""
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=60.0)
    headers = {'Host': host} | ({} if origin is None else {'Origin': origin})
    connection.request('GET', path, headers=headers)
    code = connection.getresponse().status
    connection.close()
    return code


SLOW_DRAWING = """
import sys, time
from hdd_servo_ros.reporting.live_view import LiveView
draw = LiveView.draw
def slowly(self):
    time.sleep(2.5)
    print('drawn', flush=True)
    draw(self)
LiveView.draw = slowly
from hdd_servo_ros.executables import scope
sys.exit(scope())
"""


def free_port():
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        return free.getsockname()[1]


def test_a_slow_drawing_does_not_end_it_before_the_run(bench, scope):
    watching = scope('--port', str(free_port()), code=SLOW_DRAWING)
    process = bench.start('rig', '-p', 'duration:=0.6', '-p', 'rate:=0.05', '-p', 'run_dir:=run')
    assert process.wait() == 0, process.output
    assert watching.wait(200.0) == 0
    said = watching.stdout.read()
    assert said.count('drawn') >= 3  # 12 s of a run, 2.5 s a picture
    assert 'the run has ended' in said


def stray_messages():
    texts = ('hello', '[' * 5000, '{"process": "x"}', '[1]', '7', '{"process": "x", "state": "finished"}')
    blocks = (
        Float64MultiArray(),
        Float64MultiArray(data=[1.0, 2.0]),
        block_of('um,V', 't,error', [0.0, 1.0]),
        block_of('um,V,host:1:a', 't,error', [0.0, 1.0, 2.0]),
        block_of('um,V,host:1:a', 'error,t', [0.0, 1.0]),
        block_of('um,V,host:1:a', 't,error', [2.0, 1.0, 1.0, 1.0]),
        block_of('um,V,host:1:a', 't,error', [math.nan, 1.0]),
    )
    return [String(data=text) for text in texts], [*blocks, b'\x00', bytes(12)]


def block_of(label, names, values):
    made = Float64MultiArray(data=values)
    made.layout.dim = [MultiArrayDimension(label=label), MultiArrayDimension(label=names)]
    return made


def test_stray_messages_neither_end_it_nor_hold_it_up(bench, scope, outside):
    texts, blocks = stray_messages()
    on_lockstep, on_scope = (
        outside.create_publisher(String, '/lockstep', 10),
        outside.create_publisher(Float64MultiArray, '/scope', 10),
    )
    watching = scope('--save', 'live.png', '--seconds', '60')

    def disturb():
        for publisher, messages in ((on_lockstep, texts), (on_scope, blocks)):
            for message in messages:
                publisher.publish(message)
        outside.spin_for(0.05)

    for _ in range(40):
        disturb()
    assert watching.poll() is None
    process = bench.start('rig', '-p', 'duration:=0.3', '-p', 'rate:=0.1', '-p', 'run_dir:=run')
    while process.popen.poll() is None:
        disturb()
    assert process.wait() == 0, process.output
    assert watching.wait(200.0) == 0
    said = watching.stdout.read()
    assert 'Traceback' not in said
    for topic in ('/scope', '/lockstep'):
        assert said.count(f'{topic}: ignored a message') == 1
    # Of a publisher that is gone by then, its name is not known.
    assert '/outside' in said or 'undiscovered or vanished node' in said
    assert (bench.directory / 'live.png').exists()


def open_tab(port):
    """Be a tab that is gone after a moment; return whether it was served."""
    with socket.create_connection(('127.0.0.1', port)) as tab:
        tab.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))  # closes by a reset
        tab.sendall(
            b'GET /1/ws HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
            b'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n' % port
        )
        for text in (b'{"type": "supports_binary", "value": true}', b'{"type": "refresh"}', b'[', b'7', b'{}'):
            tab.sendall(bytes((0x81, 0x80 | len(text), 0, 0, 0, 0)) + text)
        answer = tab.recv(1000)
        time.sleep(0.3)
    return b'101' in answer


def test_tabs_that_come_and_go(bench, scope):
    """Tabs that are closed without a word, in the middle of a picture, or send what no tab sends."""
    port = free_port()
    watching = scope('--port', str(port))
    process = bench.start('rig', '-p', 'duration:=0.6', '-p', 'rate:=0.05', '-p', 'run_dir:=run')
    process.wait_for('real-time factor')
    served = 0
    while process.popen.poll() is None:
        with contextlib.suppress(OSError):  # it may be about to end
            served += open_tab(port)
    assert served > 3
    assert process.wait() == 0, process.output
    assert watching.wait(200.0) == 0
    said = watching.stdout.read()
    assert 'the run has ended' in said
    assert 'Traceback' not in said
    assert 'Error' not in said


def test_an_interrupt_before_the_run_has_ended(scope):
    watching = scope('--save', 'live.png')
    watching.send_signal(signal.SIGINT)
    assert watching.wait(200.0) == 130
    assert 'Traceback' not in watching.stdout.read()


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (('--window', '0'), '0 is not a time above 0 [s]'),
        (('--save', 'live.png', '--seconds', 'nan'), 'nan is not a time above 0 [s]'),
        (('--port', '65536'), '65536 is not a port from 1 to 65535'),
        (('--save', 'live.xyz'), 'live.xyz must end in one of'),
        (('--save', 'missing/live.png'), 'missing is not a writable directory'),
        (('--ros-args', '--bogus'), "unknown ROS argument '--bogus'"),
    ],
)
def test_wrong_arguments_are_rejected_before_the_run(bench, arguments, said):
    answer = bench.python('-m', 'hdd_servo_ros.tools.scope', *arguments)
    assert answer.returncode == 2
    assert said in answer.stderr
    assert 'Traceback' not in answer.stderr


def test_a_port_that_is_taken(bench):
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        port = other.getsockname()[1]
        answer = bench.python('-m', 'hdd_servo_ros.tools.scope', '--web', '--port', str(port))
    assert answer.returncode == 2
    assert f'scope: port {port}: ' in answer.stderr
    assert 'choose another with --port' in answer.stderr
