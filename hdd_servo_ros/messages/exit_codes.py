"""
How every executable ends: the one place that catches, prints one line, and chooses the exit code.

=========  ======================================================================================
exit code  meaning
=========  ======================================================================================
0          done
1          failed, or different: a run failed, two runs differ, a file cannot be written, a disk is full
2          wrong arguments or parameters, parameter files among them
3          a recording or measured data that cannot be read, or that a command cannot work on
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
"""Environment variable that has an unexpected error shown with its traceback."""
EPILOG = (
    'Exit code: 0 done, 1 failed, 2 wrong arguments or parameters, 3 what is to be read cannot be, 128 + n ended by '
    'signal n.'
)
_LONGEST = 1000
_PACKAGE = Path(__file__).parents[1]

Main = Callable[[Sequence[str] | None], int]


class UnreadableError(ValueError):
    """A recording or measured data that cannot be read, or that a command cannot work on; names the file."""

    exit_code = UNREADABLE


def command(name: str, wrong_input: int = WRONG_ARGUMENTS) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """
    Decorate the ``main`` of an executable: whatever it raises ends in one line and an exit code.

    Parameters
    ----------
    name
        What the executable is called.
    wrong_input
        Exit code of errors about what was given: 2 for arguments and parameters, 3 for one that reads recordings, whose
        arguments argparse checks.
    """

    def decorate(main: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(main)
        def guarded(*arguments: Any, **options: Any) -> int:
            return guard(name, functools.partial(main, *arguments, **options), wrong_input)

        return guarded

    return decorate


def guard(name: str, work: Callable[[], int], wrong_input: int = WRONG_ARGUMENTS) -> int:
    """Do a command's work; return its exit code, or that of what it raises. See :func:`command`."""
    use_plain_matplotlib()
    if not sys.warnoptions:
        # What a computation comes to is checked and told in words; a warning of NumPy names lines of its own.
        warnings.simplefilter('ignore')
    # Names of files need not be UTF-8, and a terminal need not be able to show a unit.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, 'reconfigure'):
            stream.reconfigure(errors='backslashreplace')
    try:
        code = work()
        # What a full disk or a closed pipe rejects is to be known here, not while Python ends.
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print(f'{name}: interrupted', file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:
        # The reader has seen enough, which is no failure.
        _give_up_output()
        return 0
    except Exception as error:
        if os.environ.get(TRACEBACK):
            traceback.print_exc()
        code, line = told(error, wrong_input)
        try:
            sys.stdout.flush()
        except OSError:
            _give_up_output()
        print(f'{name}: {line}', file=sys.stderr)
        return code


def _give_up_output() -> None:
    """Have what Python still has to write at its end go nowhere: a second error would change the exit code."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def told(error: Exception, wrong_input: int = WRONG_ARGUMENTS) -> tuple[int, str]:
    """Return the exit code of an error and the line that it is told in."""
    line = one_line(error)
    code = getattr(error, 'exit_code', None)
    if code is not None:
        return (wrong_input if code == WRONG_ARGUMENTS else code), line
    if isinstance(error, OSError):
        # One without a number is this package's own, about what was given; so is a folder that is there already.
        return (wrong_input if error.errno is None or isinstance(error, FileExistsError) else FAILED), line
    if type(error) is ValueError:
        return wrong_input, line
    if isinstance(error, MemoryError):
        return FAILED, f'out of memory {line}'.strip()
    return FAILED, f'unexpected error: {described(error)}; {TRACEBACK}=1 shows the traceback'


def described(error: BaseException) -> str:
    """Return an error that nobody expected, with the line of this package that it comes from."""
    frames = ((Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__))
    own = [f'{path.relative_to(_PACKAGE)}:{line}' for path, line in frames if path.is_relative_to(_PACKAGE)]
    where = f' ({own[-1]})' if own else ''
    return f'{type(error).__name__}: {one_line(error)}{where}'


def one_line(error: BaseException) -> str:
    """Return the text of an error as one line."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f'{os.fsdecode(error.filename)}: {error.strerror}'
    text = error.args[0] if isinstance(error, KeyError) and error.args else str(error)
    line = ' '.join((text if isinstance(text, str) else shown(text)).split())
    return line if len(line) <= _LONGEST else f'{line[: _LONGEST - 3]}...'


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """
    Read a recording: what its content leads to, whatever that is, is an error of the recording.

    Raises
    ------
    UnreadableError
        Instead of any error but one that says its exit code, or that a file cannot be written.
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
