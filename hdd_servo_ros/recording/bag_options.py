"""Options of a bag in addition to its storage."""

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True)
class BagOptions:
    """
    Compression and splitting of a bag; both only for MCAP.

    Attributes
    ----------
    compression
        Compression of the chunks: ``none`` or ``zstd``.
    max_bag_size
        Size [bytes] beyond which the bag continues in another file; 0 for a single file.
    max_bag_duration
        Time [s] from the first to the last message of a file beyond which the bag continues in another file; 0 for a
        single file.
    """

    compression: str = 'none'
    max_bag_size: int = 0
    max_bag_duration: float = 0.0

    @property
    def splits(self) -> bool:
        """Whether the bag can have several files."""
        return self.max_bag_size > 0 or self.max_bag_duration > 0.0

    @classmethod
    def of(cls, parameters: Any) -> 'BagOptions':
        """Return the options in a recorder's parameters."""
        return cls(parameters.compression, parameters.max_bag_size, parameters.max_bag_duration)
