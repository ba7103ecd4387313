"""The results of a campaign on disk, one line per run in order of completion, from which it resumes."""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from hdd_servo_ros.campaign.measuring import Result


class Journal:
    """
    A file of results, one JSON object per line, written as each run completes.

    A campaign may be killed at any byte: an incomplete last line is ignored, and is removed when the file is opened
    again.

    Parameters
    ----------
    path
        The file; created if it is missing.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        path.touch()
        with path.open('rb+') as file:
            complete = 0
            for line in file:
                if not line.endswith(b'\n'):
                    break
                complete += len(line)
            file.truncate(complete)
        self._file = path.open('ab')

    def __enter__(self) -> 'Journal':
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, result: Result) -> None:
        """Write a result to the file."""
        self._file.write(json.dumps(dataclasses.asdict(result)).encode() + b'\n')
        self._file.flush()

    def __iter__(self) -> Iterator[Result]:
        """Iterate over the results in the file."""
        with self._path.open('rb') as file:
            for line in file:
                yield Result(**json.loads(line))
