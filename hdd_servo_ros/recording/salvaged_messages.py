"""Messages salvaged from a file: the first ones are kept in memory, later ones are read again on each use."""

import dataclasses
from collections.abc import Callable, Iterator

Message = tuple[str, int, bytes]
"""Topic, receive time [ns] and payload."""
MOST_HELD = 2**19
"""Number of messages kept in memory, a few hundred megabytes."""


@dataclasses.dataclass(frozen=True)
class StoredMessages:
    """
    Messages that are read from the file on each use.

    Attributes
    ----------
    count
        Number of messages.
    last_time
        Latest receive time [ns].
    read
        Function that returns the messages.
    """

    count: int
    last_time: int
    read: Callable[[], list[Message]]


class SalvagedMessages:
    """Messages of one or more files, in the order of the files."""

    def __init__(self) -> None:
        self._parts: list[list[Message] | StoredMessages] = []
        self._held = 0

    def __len__(self) -> int:
        return sum(part.count if isinstance(part, StoredMessages) else len(part) for part in self._parts)

    def __iter__(self) -> Iterator[Message]:
        for part in self._parts:
            yield from part.read() if isinstance(part, StoredMessages) else part

    def __getitem__(self, index: int) -> Message:
        return list(self)[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SalvagedMessages | list) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]

    def __iadd__(self, other: 'SalvagedMessages | list[Message]') -> 'SalvagedMessages':
        """Append the messages of another file."""
        self._parts += other._parts if isinstance(other, SalvagedMessages) else [other]
        return self

    def count(self, is_counted: Callable[[Message], bool], always_before: int) -> int:
        """Count the messages that meet a condition; all received before ``always_before`` [ns] are known to meet it."""
        counted = 0
        for part in self._parts:
            if isinstance(part, StoredMessages) and part.last_time < always_before:
                counted += part.count
            else:
                counted += sum(map(is_counted, part.read() if isinstance(part, StoredMessages) else part))
        return counted

    def append(self, message: Message) -> None:
        """Append a message."""
        if not self._parts or isinstance(self._parts[-1], StoredMessages):
            self.begin()
        part = self._parts[-1]
        assert isinstance(part, list)
        part.append(message)

    def begin(self) -> None:
        """Begin a new part; see :meth:`store`."""
        if not self._parts or isinstance(self._parts[-1], StoredMessages) or self._parts[-1]:
            self._parts.append([])

    def store(self, read: Callable[[], list[Message]]) -> None:
        """Release the messages added since :meth:`begin` if too many are in memory; ``read`` returns them again."""
        part = self._parts[-1]
        assert isinstance(part, list)
        if self._held + len(part) > MOST_HELD:
            last_time = max((time for _, time, _ in part), default=0)
            self._parts[-1] = StoredMessages(len(part), last_time, read)
        else:
            self._held += len(part)

    def pop(self) -> None:
        """Remove the last message."""
        part = self._parts[-1]
        if isinstance(part, StoredMessages):
            part = self._parts[-1] = part.read()
        part.pop()
        if not part:
            self._parts.pop()
