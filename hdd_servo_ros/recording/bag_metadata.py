"""Content of ``metadata.yaml`` of a rosbag2 bag, with type checks."""

import dataclasses
from pathlib import Path
from typing import Any, TypeVar

from hdd_servo_ros.messages.plain_yaml import YamlError, read_yaml
from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.messages.ticks import sample_time_to_nanoseconds
from hdd_servo_ros.recording.bag_digest import DIGEST_KEY, read_digests

FILE_NAME = 'metadata.yaml'
_TOP = 'rosbag2_bagfile_information'
_SHOWN = 40
_SAMPLE_TIME = 'sample_time'
T = TypeVar('T')


class MetadataError(ValueError):
    """Invalid metadata; the text names the entry, its value and the expected type."""


@dataclasses.dataclass(frozen=True)
class BagMetadata:
    """
    Metadata needed to read a bag.

    Attributes
    ----------
    types
        Type of each topic, by its full name.
    counts
        Number of messages of each topic.
    custom_data
        Strings that the recorder stored in the bag.
    storage
        ``mcap``, ``sqlite3`` or another.
    is_compressed
        Whether rosbag2 compressed the messages or the files.
    files
        Names of the files in the bag's directory.
    digests
        Digest of each topic that has one, by its full name.
    """

    types: dict[str, str]
    counts: dict[str, int]
    custom_data: dict[str, str]
    storage: str
    is_compressed: bool
    files: tuple[str, ...]
    digests: dict[str, str]


def read_metadata(bag: Path) -> BagMetadata:
    """
    Return the metadata of a bag, given by its directory.

    Raises
    ------
    OSError
        If the file cannot be read.
    MetadataError
        If the file is not valid YAML, or an entry is missing or has a wrong type.
    """
    try:
        content = read_yaml(bag / FILE_NAME)
    except YamlError as error:
        raise MetadataError(str(error)) from None
    entries = _Entries(_of(content, dict, 'a mapping', 'the file'), '').mapping(_TOP)
    types, counts = {}, {}
    for index, topic in enumerate(entries.get('topics_with_message_count', list, 'a list')):
        where = f'topics_with_message_count[{index}]'
        listed = _Entries(_of(topic, dict, 'a mapping', where), f'{where}.')
        described = listed.mapping('topic_metadata')
        name = described.get('name', str, 'a string')
        types[name] = described.get('type', str, 'a string')
        counts[name] = listed.count('message_count')
    custom_data = _custom_data(entries)
    mode = entries.optional('compression_mode', str, 'a string', '')
    names = entries.get('relative_file_paths', list, 'a list')
    files = tuple(Path(_of(name, str, 'a string', 'relative_file_paths')).name for name in names)
    try:
        digests = read_digests(custom_data.get(DIGEST_KEY, ''))
    except (ValueError, RecursionError) as error:
        raise MetadataError(f'custom_data: {error}') from None
    storage = entries.get('storage_identifier', str, 'a string')
    return BagMetadata(types, counts, custom_data, storage, mode.lower() not in ('', 'none'), files, digests)


class _Entries:
    """Entries of a mapping with type checks; ``prefix`` comes before their names in error messages."""

    def __init__(self, content: dict[Any, Any], prefix: str) -> None:
        self._content = content
        self._prefix = prefix

    def get(self, name: str, kind: type[T], allowed: str) -> T:
        if name not in self._content:
            raise MetadataError(f'{self._prefix}{name} is missing')
        return _of(self._content[name], kind, allowed, self._prefix + name)

    def optional(self, name: str, kind: type[T], allowed: str, default: T) -> T:
        return default if self._content.get(name) is None else self.get(name, kind, allowed)

    def count(self, name: str) -> int:
        value = self.get(name, int, 'a non-negative integer')
        if isinstance(value, bool) or value < 0:
            raise MetadataError(f'{self._prefix}{name} is {shown(value, _SHOWN)}; expected a non-negative integer')
        return value

    def mapping(self, name: str) -> '_Entries':
        return _Entries(self.get(name, dict, 'a mapping'), f'{name}.' if name != _TOP else '')


def _of(value: Any, kind: type[T], allowed: str, name: str) -> T:
    if not isinstance(value, kind):
        raise MetadataError(f'{name} is {shown(value, _SHOWN)}; expected {allowed}')
    return value


def _custom_data(entries: _Entries) -> dict[str, str]:
    """Return the strings; numbers without quotes are converted to strings."""
    texts = {}
    for key, value in entries.optional('custom_data', dict, 'a mapping', {}).items():
        if not isinstance(value, str | int | float):
            raise MetadataError(f'custom_data.{shown(key, _SHOWN)} is {shown(value, _SHOWN)}; expected a string')
        texts[str(key)] = str(value)
    if _SAMPLE_TIME in texts:
        try:
            sample_time_to_nanoseconds(float(texts[_SAMPLE_TIME]))
        except (ValueError, OverflowError):
            raise MetadataError(
                f'custom_data.{_SAMPLE_TIME} is {shown(texts[_SAMPLE_TIME], _SHOWN)}; expected a time [s]'
            ) from None
    return texts
