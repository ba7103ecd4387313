"""
Exit codes and one-line error messages of all executables.

=========  ======================================================================================
exit code  meaning
=========  ======================================================================================
0          success
1          failed or different: a run failed, two runs differ, a file cannot be written, a disk is full
2          invalid arguments or parameters, including parameter files
3          a recording or measured data that cannot be read or is unsuitable for the command
128 + n    ended by signal n (130 for Ctrl-C)
=========  ======================================================================================
"""

import contextlib
import functools
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.messages.plain_matplotlib import use_plain_matplotlib
from hdd_servo_ros.messages.shown import shown

FAILED, WRONG_ARGUMENTS, UNREADABLE = 1, 2, 3
TRACEBACK = 'HDD_SERVO_ROS_TRACEBACK'
"""Environment variable that enables the traceback of an unexpected error."""
EPILOG = (
    'Exit code: 0 success, 1 failed, 2 invalid arguments or parameters, 3 input cannot be read, 128 + n ended by '
    'signal n.'
)
_LONGEST = 1000
_PACKAGE = Path(__file__).parents[1]

Main = Callable[[Sequence[str] | None], int]


class UnreadableError(ValueError):
    """Recording or measured data that cannot be read or is unsuitable for a command; the message names the file."""

    exit_code = UNREADABLE


def command(name: str, wrong_input: int = WRONG_ARGUMENTS) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """
    Decorate the ``main`` of an executable so that every exception becomes one line and an exit code.

    Parameters
    ----------
    name
        Name of the executable.
    wrong_input
        Exit code of errors in the input: 2 for arguments and parameters, 3 for a command that reads recordings, whose
        arguments argparse checks.
    """

    def decorate(main: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(main)
        def guarded(*arguments: Any, **options: Any) -> int:
            return guard(name, functools.partial(main, *arguments, **options), wrong_input)

        return guarded

    return decorate


def guard(name: str, work: Callable[[], int], wrong_input: int = WRONG_ARGUMENTS) -> int:
    """Run the work of a command and return its exit code, or that of its exception. See :func:`command`."""
    use_plain_matplotlib()
    if not sys.warnoptions:
        # Results of computations are checked and reported explicitly; warnings of NumPy would name internal lines.
        warnings.simplefilter('ignore')
    # File names need not be UTF-8, and a terminal need not be able to display every unit.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, 'reconfigure'):
            stream.reconfigure(errors='backslashreplace')
    try:
        code = work()
        # Errors from a full disk or a closed pipe must occur here, not when the interpreter exits.
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print(f'{name}: interrupted', file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:
        # The reader has closed the pipe, which is not an error.
        _give_up_output()
        return 0
    except Exception as error:
        if os.environ.get(TRACEBACK):
            traceback.print_exc()
        code, line = reported(error, wrong_input)
        try:
            sys.stdout.flush()
        except OSError:
            _give_up_output()
        print(f'{name}: {line}', file=sys.stderr)
        return code


def _give_up_output() -> None:
    """Discard the remaining output of the interpreter: a second error would change the exit code."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def reported(error: Exception, wrong_input: int = WRONG_ARGUMENTS) -> tuple[int, str]:
    """Return the exit code of an error and its one-line message."""
    line = one_line(error)
    code = getattr(error, 'exit_code', None)
    if code is not None:
        return (wrong_input if code == WRONG_ARGUMENTS else code), line
    if isinstance(error, OSError):
        # An OSError without errno is this package's own and concerns the input, as does an existing directory.
        return (wrong_input if error.errno is None or isinstance(error, FileExistsError) else FAILED), line
    if type(error) is ValueError:
        return wrong_input, line
    if isinstance(error, MemoryError):
        return FAILED, f'out of memory {line}'.strip()
    return FAILED, f'unexpected error: {described(error)}; {TRACEBACK}=1 shows the traceback'


def described(error: BaseException) -> str:
    """Return an unexpected error in one line, with the line of this package that raised it."""
    frames = ((Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__))
    own = [f'{path.relative_to(_PACKAGE)}:{line}' for path, line in frames if path.is_relative_to(_PACKAGE)]
    where = f' ({own[-1]})' if own else ''
    return f'{type(error).__name__}: {one_line(error)}{where}'


def one_line(error: BaseException) -> str:
    """Return the message of an error in one line."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f'{os.fsdecode(error.filename)}: {error.strerror}'
    text = error.args[0] if isinstance(error, KeyError) and error.args else str(error)
    line = ' '.join((text if isinstance(text, str) else shown(text)).split())
    return line if len(line) <= _LONGEST else f'{line[: _LONGEST - 3]}...'


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """
    Read a recording: every error caused by its content is reported as an error of the recording.

    Raises
    ------
    UnreadableError
        Instead of any error except those with their own exit code, and of a file that cannot be written.
    """
    try:
        yield
    except OSError as error:
        if getattr(error, 'exit_code', None) is None:
            raise UnreadableError(_naming(path, one_line(error))) from error
        raise
    except MemoryError:
        raise
    except Exception as error:
        if getattr(error, 'exit_code', None) == UNREADABLE:
            raise
        own = isinstance(error, ValueError) and not isinstance(error, UnicodeError)
        text = one_line(error) if own else f'cannot be read: {described(error)}'
        raise UnreadableError(_naming(path, text)) from error


def _naming(path: Path, text: str) -> str:
    return text if str(path) in text else f'{path}: {text}'
