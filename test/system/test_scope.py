"""The built-in scope: a picture without a display, the view in the browser, and its end with the run."""

import http.client
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import matplotlib.image
import pytest

from hdd_servo_ros.recording.compare_bags import first_difference

ENTRY_POINT = 'import sys; from hdd_servo_ros.executables import scope; sys.exit(scope())'


@pytest.fixture
def scope(bench):
    """Start `scope`; ended with the bench's other processes."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments):
        environment = {name: value for name, value in bench.environment.items() if 'DISPLAY' not in name}
        started.append(
            subprocess.Popen(
                [sys.executable, '-c', ENTRY_POINT, *arguments],
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
    # Lines in the colours of the panels, not an empty frame.
    colours = {tuple(colour) for colour in (picture[::2, ::2, :3].reshape(-1, 3) * 255).astype(int)}
    assert picture.shape[:2] == (1080, 1200)
    assert {(31, 119, 180), (255, 127, 14)} <= colours
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
        (('--save', 'missing/live.png'), 'missing is no folder that can be written to'),
        (('--ros-args', '--bogus'), "unknown ROS argument '--bogus'"),
    ],
)
def test_wrong_arguments_are_refused_before_the_run(bench, arguments, said):
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
    assert 'choose another by --port' in answer.stderr
