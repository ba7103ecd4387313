"""The results of a campaign on disk, a line per run in the order in which they were made: where it goes on from."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from hdd_servo_ros.campaign.measuring import Result


class Journal:
    """
    A file of results, one JSON object per line, written as each is known.

    A campaign may be killed at any byte: what is behind the last whole line does not count, and is cut off when the
    file is opened again.

    Parameters
    ----------
    path
        The file; made if it is not there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        path.touch()
        with path.open('rb+') as file:
            whole = 0
            for line in file:
                if not line.endswith(b'\n'):
                    break
                whole += len(line)
            file.truncate(whole)
        self._file = path.open('ab')

    def __enter__(self) -> 'Journal':
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, result: Result) -> None:
        """Write a result; it is in the file when this returns."""
        self._file.write(json.dumps(dataclasses.asdict(result)).encode() + b'\n')
        self._file.flush()

    def __iter__(self) -> Iterator[Result]:
        """Iterate over the results that are in the file."""
        with self._path.open('rb') as file:
            for line in file:
                yield Result(**json.loads(line))
