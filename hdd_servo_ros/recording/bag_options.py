"""Options of a bag in addition to its storage."""

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True)
class BagOptions:
    """
    Compression and splitting of a bag; both for MCAP only.

    Attributes
    ----------
    compression
        Of the chunks: ``none`` or ``zstd``.
    max_bag_size
        Size [bytes] beyond which the bag goes on in another file; 0 for one file.
    max_bag_duration
        Time [s] from a file's first message to its last beyond which the bag goes on in another file; 0 for one file.
    """

    compression: str = 'none'
    max_bag_size: int = 0
    max_bag_duration: float = 0.0

    @property
    def splits(self) -> bool:
        """Whether there may be several files."""
        return self.max_bag_size > 0 or self.max_bag_duration > 0.0

    @classmethod
    def of(cls, parameters: Any) -> 'BagOptions':
        """Return those of a recorder's parameters."""
        return cls(parameters.compression, parameters.max_bag_size, parameters.max_bag_duration)
