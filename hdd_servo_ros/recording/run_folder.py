"""
A run's folder: ``runs/<name>/`` with ``bag/`` and ``run.yaml``.

``run.yaml`` is written when the run starts, with status ``running``, and again when it ends; each time it lands by
rename, so that a killed run never looks complete, and it is on the disk when the writing returns. The room that it
needs at the end is allocated at the start, so that a full disk does not leave it ``running``.
"""

import datetime as dt
import importlib.metadata
import os
import platform
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from hdd_servo_ros.messages.exit_codes import UNREADABLE, one_line
from hdd_servo_ros.messages.outcome import RUNNING
from hdd_servo_ros.messages.plain_yaml import read_yaml
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.recording.disk import allocate, sync_folder, write_durably
from hdd_servo_ros.version import __version__

_KINDS: dict[str, type | tuple[type, ...]] = {
    'status': str,
    'last_tick': (int, type(None)),
    'sample_time': float,
    'topics': dict,
    'nodes': dict,
}
"""Types of what readers rely on."""
_MORE_AT_THE_END = 2**14
"""By how much run.yaml may grow until the run ends [bytes]: the reason is the longest of it."""
_DISTRIBUTIONS = ('numpy', 'numba', 'rosbags', 'rclpy')


_DUMPER: Any = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
"""That of libyaml, where PyYAML was built with it: it writes the same, five times as fast."""


class DescriptionError(OSError):
    """A run.yaml that does not describe a run; says which and why."""

    exit_code = UNREADABLE


def default_run_directory(controller: str) -> Path:
    """Return ``runs/<date-time>-<controller>`` below the working folder, with a number behind it if that is taken."""
    name = f'{dt.datetime.now():%Y%m%d-%H%M%S}-{controller}'
    directory = Path('runs') / name
    number = 1
    while directory.exists():
        number += 1
        directory = Path('runs') / f'{name}-{number}'
    return directory


class RunFolder:
    """
    The folder of one run.

    Parameters
    ----------
    directory
        Folder to make.
    description
        What ``run.yaml`` shall say beside versions and outcome: the time line, topics and the parameters of each node.

    Raises
    ------
    FileExistsError
        If the folder exists: a run is never overwritten.
    OSError
        If it cannot be written; there is no folder then.
    """

    def __init__(self, directory: Path, description: Mapping[str, Any]) -> None:
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            raise FileExistsError(f'{directory} exists, and a run is never overwritten') from None
        self.directory = directory
        self.bag = directory / 'bag'
        self._content: dict[str, Any] = {
            'status': RUNNING,
            'reason': '',
            'last_tick': None,
            'started': _now(),
            'ended': None,
            **description,
            'versions': versions(),
            'git_revision': git_revision(),
        }
        try:
            self._save()
            self._reserve()
        except OSError as error:
            # Nothing is recorded in it, and nothing could say how the run ended.
            shutil.rmtree(directory, ignore_errors=True)
            raise OSError(error.errno, error.strerror, str(directory)) from None
        sync_folder(directory.parent)

    def _reserve(self) -> None:
        """Give the file that becomes run.yaml at the end its room on the disk."""
        temporary = _temporary(self.directory)
        file = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        try:
            allocate(file, 0, (self.directory / 'run.yaml').stat().st_size + _MORE_AT_THE_END)
        finally:
            os.close(file)

    def close(self, status: str, reason: str, last_tick: int, **measured: Any) -> None:
        """
        Say how the run ended.

        Parameters
        ----------
        status
            ``finished``, ``interrupted`` or ``failed``.
        reason
            Why, in one line; empty for a finished run.
        last_tick
            The last tick that the bag holds on every loop topic; -1 if none.
        measured
            Further entries, such as the wall time.

        Raises
        ------
        OSError
            If ``run.yaml`` cannot be written; says that it still has the status ``running``.
        """
        self._content.update(status=status, reason=reason, last_tick=last_tick, ended=_now(), **measured)
        try:
            self._save()
        except OSError as error:
            where = self.directory / 'run.yaml'
            raise OSError(
                f'{where} still says {RUNNING}, for it cannot be written: {error.strerror or error}'
            ) from None

    def _save(self) -> None:
        rewrite_run_yaml(self.directory, self._content)


def rewrite_run_yaml(directory: Path, content: Mapping[str, Any]) -> None:
    """Write a folder's ``run.yaml``, by rename."""
    text = yaml.dump(_plain(content), Dumper=_DUMPER, sort_keys=False, width=120)
    write_durably(directory / 'run.yaml', text, _temporary(directory))


def _temporary(directory: Path) -> Path:
    return directory / 'run.yaml.tmp'


def read_run_yaml(directory: Path) -> dict[str, Any]:
    """
    Return the content of a run folder's ``run.yaml``.

    Raises
    ------
    FileNotFoundError
        If the folder holds none.
    DescriptionError
        If it holds something else under that name.
    """
    path = directory / 'run.yaml'
    if not path.is_file():
        raise FileNotFoundError(f'{directory} is not a run folder: it has no run.yaml')
    try:
        content = read_yaml(path.read_text('utf8'))
    except (yaml.YAMLError, OSError, ValueError, RecursionError, OverflowError) as error:
        raise DescriptionError(f'{path} cannot be read: {one_line(error)}') from None
    if not isinstance(content, dict):
        raise DescriptionError(f'{path} does not describe a run: it holds {shown(content, 40)}')
    for key, kinds in _KINDS.items():
        if key in content and not isinstance(content[key], kinds):
            raise DescriptionError(f'{path} does not describe a run: {key} is {shown(content[key], 40)}')
    topics = content.get('topics', {})
    if not all(isinstance(name, str) for pair in topics.items() for name in pair):
        raise DescriptionError(f'{path} does not describe a run: topics is {shown(topics, 40)}')
    try:
        sample_time_to_nanoseconds(content.get('sample_time', 1.0))
    except (ValueError, OverflowError) as error:
        raise DescriptionError(f'{path} does not describe a run: {error}') from None
    return content


def versions() -> dict[str, str]:
    """Return the versions that a run may depend on."""
    found = {'hdd_servo_ros': __version__, 'python': platform.python_version(), 'platform': platform.platform()}
    for distribution in _DISTRIBUTIONS:
        try:
            found[distribution] = importlib.metadata.version(distribution)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def git_revision() -> str:
    """Return the revision of the checkout that this package runs from, ``unknown`` where it runs from an install."""
    here = Path(__file__).resolve()
    git = ['git', '-C', str(here.parent)]
    try:
        # An install below some other checkout, such as a virtual environment in it, is not that checkout's work.
        subprocess.run([*git, 'ls-files', '--error-unmatch', here.name], capture_output=True, timeout=10, check=True)
        described = subprocess.run(
            [*git, 'describe', '--always', '--dirty', '--abbrev=40', '--match='],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return 'unknown'
    return described.stdout.strip()


def _now() -> str:
    return dt.datetime.now().astimezone().isoformat(timespec='seconds')


def _plain(value: Any) -> Any:
    """Return ``value`` in the types that plain YAML has."""
    if isinstance(value, Mapping):
        return {str(key): _plain(element) for key, element in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(element) for element in value]
    return value
