"""`scope`: show the signals of a run in progress in a window, in the browser, or in an image file."""

import argparse
import contextlib
import importlib.util
import math
import os
import signal
import socket
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import matplotlib as mpl
import rclpy
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from hdd_servo_ros.messages.command_line import CommandParser
from hdd_servo_ros.messages.exit_codes import WRONG_ARGUMENTS, command
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.reporting.live_view import LiveView, lighten
from hdd_servo_ros.ros.log_folder import find_log_folder
from hdd_servo_ros.ros.transport import check_domain, use_udp_alone, who_can_reach
from hdd_servo_ros.tools.scope_feed import Feed, FeedError
from hdd_servo_ros.tools.scope_web import serve_any_page

FRAME_PERIOD = 0.25
"""Wall time between two frames [s]."""
_NICENESS = 10
"""On a machine with few cores, the loop has priority."""
_ADDRESS = '127.0.0.1'
_NO_VIEW = (
    'no display was found, and tornado, which the browser view needs, is not installed (python3-tornado, or pip '
    'install tornado); --save FILE.png writes an image without either'
)


def _handle_interrupts_during_run(feed: Feed) -> None:
    """
    Handle Ctrl-C as an interrupt only during the run.

    A launch file that ends with the run interrupts a scope that is about to end by itself, which is not a failure.
    """

    def take(number: int, frame: FrameType | None) -> None:
        if not feed.has_ended:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, take)


def save(path: Path, seconds: float, window: float) -> None:
    """Collect data for ``seconds`` of wall time or until the run ends, and write one image."""
    figure = Figure(figsize=(10.0, 9.0))
    view = LiveView(figure, window)
    with contextlib.closing(Feed(view)) as feed:
        _handle_interrupts_during_run(feed)
        _wait_for_run(feed)
        end = time.monotonic() + seconds
        while time.monotonic() < end and not feed.has_ended:
            time.sleep(FRAME_PERIOD)
            feed.pour()
    view.draw()
    figure.savefig(path, dpi=120)
    print(f'scope: {path}')


def _wait_for_run(feed: Feed) -> None:
    print('scope: waiting for a run with a bag_recorder', flush=True)
    while not feed.pour():
        time.sleep(0.1)


def show(window: float, port: int | None) -> None:
    """Show the signals until the run ends, in a window or, if ``port`` is given, in the browser."""
    import matplotlib.pyplot as plt

    figure = plt.figure('scope', figsize=(10.0, 9.0))
    view = LiveView(figure, window)
    feed = Feed(view)
    _handle_interrupts_during_run(feed)
    if port is None:
        print('scope: waiting for a run with a bag_recorder', flush=True)
    else:
        print(f'scope: open http://{_ADDRESS}:{port}; waiting for a run with a bag_recorder', flush=True)

    faults: list[FeedError] = []

    def draw() -> None:
        try:
            if feed.pour():
                view.draw()
                figure.canvas.draw_idle()
        except FeedError as error:  # raised here, it would be lost in the event loop
            faults.append(error)
        if feed.has_ended or faults:
            if not faults:
                print('scope: the run has ended')
            timer.stop()
            _stop_showing(port is not None)

    timer = figure.canvas.new_timer(interval=int(1000 * FRAME_PERIOD))
    timer.add_callback(draw)
    timer.start()
    with contextlib.closing(feed):
        plt.show(block=True)
    if faults:
        raise faults[0]


def _stop_showing(in_browser: bool) -> None:
    if in_browser:
        import tornado.ioloop

        loop = tornado.ioloop.IOLoop.current()
        loop.add_callback(loop.stop)
    else:
        import matplotlib.pyplot as plt

        plt.close('all')


def choose_view(*, web: bool, port: int) -> int | None:
    """
    Choose between a window and the browser.

    Returns
    -------
    int or None
        Port of the browser view; None for a window.

    Raises
    ------
    ViewError
        If neither is available, or the port is in use.
    """
    import matplotlib.pyplot as plt

    if not web and (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        for backend in ('QtAgg', 'TkAgg', 'GTK4Agg', 'GTK3Agg'):
            with contextlib.suppress(ImportError):
                plt.switch_backend(backend)
                return None
    if importlib.util.find_spec('tornado') is None:
        raise ViewError(_NO_VIEW)
    with socket.socket() as trial:
        # As the server does; the port of an ended server is free.
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((_ADDRESS, port))
        except OSError as error:
            raise ViewError(f'port {port}: {error.strerror}; choose another with --port') from None
    mpl.rcParams.update({'webagg.address': _ADDRESS, 'webagg.port': port, 'webagg.port_retries': 1})
    mpl.rcParams['webagg.open_in_browser'] = False
    plt.switch_backend('WebAgg')
    reject_other_hosts(port)
    serve_any_page()
    return port


def reject_other_hosts(port: int) -> None:
    """
    Accept only requests to this machine by its own name; others receive status 403.

    The server listens only on the loopback interface, and rejects WebSockets from pages of another origin. A page of
    another site whose name resolves to 127.0.0.1 would pass both checks: its origin equals the requested host.
    """
    import tornado.web
    from matplotlib.backends.backend_webagg import WebAggApplication

    own = {f'{name}:{port}' for name in (_ADDRESS, 'localhost')}
    original = WebAggApplication.find_handler

    def find_handler(self: Any, request: Any, **options: Any) -> Any:
        origin = request.headers.get('Origin')
        if request.host.lower() in own and origin in (None, *(f'http://{host}' for host in own)):
            return original(self, request, **options)
        return self.get_handler_delegate(request, tornado.web.ErrorHandler, {'status_code': 403})

    WebAggApplication.find_handler = find_handler  # type: ignore[method-assign]


class ViewError(Exception):
    """Neither a window nor the browser view is available."""

    exit_code = WRONG_ARGUMENTS


def command_line() -> CommandParser:
    """Return the parser of the command line."""
    parser = CommandParser(
        prog='scope',
        description='Show the signals of a run in progress: in a window, or in the browser without a display.',
        epilog='Waits for a run and ends with it or on Ctrl-C. ROS arguments (-r __ns:=/bench1) follow --ros-args.',
    )
    parser.add_argument(
        '--window', type=_seconds, default=0.5, metavar='S', help='displayed time span of the run [s]; default 0.5'
    )
    parser.add_argument('--web', action='store_true', help='use the browser even if there is a display')
    parser.add_argument('--port', type=_port, default=8988, help='port of the browser view; default 8988')
    parser.add_argument('--save', type=_image, metavar='FILE', help='collect data, write one image and exit')
    parser.add_argument(
        '--seconds', type=_seconds, default=3.0, metavar='S', help='time for which --save collects data [s]; default 3'
    )
    return parser


def _seconds(text: str) -> float:
    seconds = float(text)
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f'{text} is not a time above 0 [s]')
    return seconds


def _port(text: str) -> int:
    port = int(text)
    if not 0 < port < 65536:
        raise argparse.ArgumentTypeError(f'{text} is not a port from 1 to 65535')
    return port


def _image(text: str) -> Path:
    """Return the path of an image; check it now, because the image is written only after the run."""
    path = Path(text)
    endings = FigureCanvasBase.get_supported_filetypes()
    if path.suffix[1:].lower() not in endings:
        raise argparse.ArgumentTypeError(f'{text} must end in one of .{", .".join(sorted(endings))}')
    if not os.access(path.parent, os.W_OK):
        raise argparse.ArgumentTypeError(f'{path.parent} is not a writable directory')
    return path


@command('scope')
def main(arguments: Sequence[str] | None = None) -> int:
    """Show a run; exit code 0 after its end, 1 if receiving fails, 2 without a view, 130 on Ctrl-C."""
    given = list(sys.argv if arguments is None else ['scope', *arguments])
    parsed = command_line().parse_args(parse_ros_arguments(given[1:]).others)
    check_domain(os.environ)
    warning = who_can_reach(os.environ)
    if warning:
        print(f'scope: warning: {warning}', file=sys.stderr, flush=True)
    use_udp_alone(os.environ)
    find_log_folder(os.environ)
    os.nice(_NICENESS)
    lighten()
    try:
        port = None if parsed.save else choose_view(web=parsed.web, port=parsed.port)
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
        if parsed.save:
            save(parsed.save, parsed.seconds, parsed.window)
        else:
            show(parsed.window, port)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    finally:
        try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
