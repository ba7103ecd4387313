"""
Run directory: ``runs/<name>/`` with ``bag/`` and ``run.yaml``.

``run.yaml`` is written when the run starts, with status ``running``, and again when it ends. Each time it is written to
a temporary file, synchronized with the disk and renamed, so that a killed run never looks complete. The disk space for
the second time is allocated at the start, so that a full disk does not leave the status ``running``.
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

from hdd_servo_ros.messages.exit_codes import UNREADABLE
from hdd_servo_ros.messages.outcome import FAILED, FINISHED, INTERRUPTED, RECOVERED, RUNNING
from hdd_servo_ros.messages.plain_yaml import YamlError, read_yaml
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.recording.disk import allocate, sync_folder, write_durably
from hdd_servo_ros.version import __version__

_KINDS: dict[str, type | tuple[type, ...]] = {
    'status': str,
    'reason': str,
    'last_tick': (int, type(None)),
    'last_tick_planned': (int, type(None)),
    'controller': str,
    'controller_class': str,
    'frame_id': str,
    'length_unit': str,
    'control_unit': str,
    'sample_time': float,
    'topics': dict,
    'topics_left_out': dict,
    'nodes': dict,
    'versions': dict,
    'git_revision': str,
}
"""Types of the entries that readers rely on."""
_KINDS_OF_NODE: dict[str, type] = {'inputs': list, 'outputs': list, 'parameters': dict}
STATUSES = (RUNNING, FINISHED, INTERRUPTED, FAILED, RECOVERED)
"""Allowed values of ``status``."""
_MORE_AT_THE_END = 2**14
"""Allowed growth of run.yaml until the run ends [bytes]; the reason is the longest entry."""
_DISTRIBUTIONS = ('numpy', 'numba', 'rosbags', 'rclpy')


_DUMPER: Any = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
"""Dumper of libyaml if PyYAML was built with it: same output, five times as fast."""


class DescriptionError(OSError):
    """A run.yaml that does not describe a run; the text names the file and the reason."""

    exit_code = UNREADABLE


def default_run_directory(controller: str) -> Path:
    """Return ``runs/<date-time>-<controller>`` in the working directory, with a number appended if it exists."""
    name = f'{dt.datetime.now():%Y%m%d-%H%M%S}-{controller}'
    directory = Path('runs') / name
    number = 1
    while directory.exists():
        number += 1
        directory = Path('runs') / f'{name}-{number}'
    return directory


class RunFolder:
    """
    Directory of one run.

    Parameters
    ----------
    directory
        Directory to create.
    description
        Entries of ``run.yaml`` in addition to versions and outcome: time line, topics and parameters of each node.

    Raises
    ------
    FileExistsError
        If the directory exists: a run is never overwritten.
    OSError
        If the directory cannot be written; it is then removed.
    """

    def __init__(self, directory: Path, description: Mapping[str, Any]) -> None:
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            raise FileExistsError(f'{directory} exists; a run is never overwritten') from None
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
            # Nothing has been recorded, and the outcome could not be written.
            shutil.rmtree(directory, ignore_errors=True)
            raise OSError(error.errno, error.strerror, str(directory)) from None
        sync_folder(directory.parent)

    def _reserve(self) -> None:
        """Allocate disk space for the file that becomes run.yaml at the end."""
        temporary = _temporary(self.directory)
        file = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        try:
            allocate(file, 0, (self.directory / 'run.yaml').stat().st_size + _MORE_AT_THE_END)
        finally:
            os.close(file)

    def close(self, status: str, reason: str, last_tick: int, **measured: Any) -> None:
        """
        Record how the run ended.

        Parameters
        ----------
        status
            ``finished``, ``interrupted`` or ``failed``.
        reason
            Reason in one line; empty for a finished run.
        last_tick
            Last tick that the bag contains on every loop topic; -1 if no tick is complete.
        measured
            Further entries, such as the wall time.

        Raises
        ------
        OSError
            If ``run.yaml`` cannot be written; the text states that its status is still ``running``.
        """
        self._content.update(status=status, reason=reason, last_tick=last_tick, ended=_now(), **measured)
        try:
            self._save()
        except OSError as error:
            where = self.directory / 'run.yaml'
            raise OSError(
                f'{where} cannot be written, so its status is still {RUNNING}: {error.strerror or error}'
            ) from None

    def _save(self) -> None:
        rewrite_run_yaml(self.directory, self._content)


def rewrite_run_yaml(directory: Path, content: Mapping[str, Any]) -> None:
    """Write ``run.yaml`` of a run directory, by rename."""
    text = yaml.dump(_plain(content), Dumper=_DUMPER, sort_keys=False, width=120)
    write_durably(directory / 'run.yaml', text, _temporary(directory))


def _temporary(directory: Path) -> Path:
    return directory / 'run.yaml.tmp'


def read_run_yaml(directory: Path) -> dict[str, Any]:
    """
    Return the content of ``run.yaml`` in a run directory.

    Raises
    ------
    FileNotFoundError
        If the directory does not contain the file.
    DescriptionError
        If the file cannot be read, or an entry is invalid.
    """
    content, faults = read_right_entries(directory)
    for fault in faults:
        raise DescriptionError(f'{directory / "run.yaml"} does not describe a run: {fault}')
    return content


def read_right_entries(directory: Path) -> tuple[dict[str, Any], list[str]]:
    """
    Return the valid entries of ``run.yaml`` in a run directory, and the faults of the others.

    Raises
    ------
    FileNotFoundError
        If the directory does not contain the file.
    DescriptionError
        If the file has no entries.
    """
    path = directory / 'run.yaml'
    if not path.is_file():
        raise FileNotFoundError(f'{directory} is not a run folder: it has no run.yaml')
    try:
        content = read_yaml(path)
    except (OSError, YamlError) as error:
        raise DescriptionError(f'{path} cannot be read: {getattr(error, "strerror", None) or error}') from None
    if not isinstance(content, dict):
        raise DescriptionError(f'{path} does not describe a run: it contains {shown(content, 40)}')
    faults = {key: fault for key, value in content.items() if (fault := _fault_of(key, value))}
    return {key: value for key, value in content.items() if key not in faults}, list(faults.values())


def _fault_of(key: object, value: Any) -> str:
    """Return the fault of an entry of run.yaml; empty if it is valid or not in the list of known entries."""
    if not isinstance(key, str):
        return f'{shown(key, 40)} is not a name'
    if key not in _KINDS:
        return ''
    fault = f'{key} is {shown(value, 40)}'
    kinds: Any = _KINDS[key]
    if not isinstance(value, kinds) or isinstance(value, bool):
        return fault
    if key == 'status' and value not in STATUSES:
        return f'{fault}; expected one of {", ".join(STATUSES)}'
    if key in ('topics', 'topics_left_out') and not all(
        isinstance(name, str) for pair in value.items() for name in pair
    ):
        return fault
    if key == 'nodes':
        return next(filter(None, (_fault_of_node(name, node) for name, node in value.items())), '')
    if key == 'sample_time':
        try:
            sample_time_to_nanoseconds(value)
        except (ValueError, OverflowError) as error:
            return str(error)
    return ''


def _fault_of_node(name: object, node: object) -> str:
    if not isinstance(name, str) or not isinstance(node, dict):
        return f'nodes: {shown(name, 40)} is {shown(node, 40)}'
    for key, kind in _KINDS_OF_NODE.items():
        if key in node and not isinstance(node[key], kind):
            return f'{key} of {name} is {shown(node[key], 40)}'
    return ''


def versions() -> dict[str, str]:
    """Return the versions that can influence a run."""
    found = {'hdd_servo_ros': __version__, 'python': platform.python_version(), 'platform': platform.platform()}
    for distribution in _DISTRIBUTIONS:
        try:
            found[distribution] = importlib.metadata.version(distribution)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def git_revision() -> str:
    """Return the git revision of the checkout that contains this package; ``unknown`` for an installation."""
    here = Path(__file__).resolve()
    git = ['git', '-C', str(here.parent)]
    try:
        # An installation below another checkout, such as in its virtual environment, does not belong to it.
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
    """Return ``value`` converted to types of plain YAML."""
    if isinstance(value, Mapping):
        return {str(key): _plain(element) for key, element in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(element) for element in value]
    return value
