"""
Digest of each topic of a bag, for a storage without checksums.

It consists of the CRC-32 of the concatenated payloads and the CRC-32 of the receive times [ns] as 64-bit integers, both
in the order of writing. The digests are in ``custom_data`` of the bag's ``metadata.yaml``.
"""

import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

DIGEST_KEY = 'crc32_by_topic'
"""Key of the digests in ``custom_data``."""


class TopicDigest:
    """
    Digest of one topic, updated while its messages are written.

    Parameters
    ----------
    payloads, times
        Initial state; see :attr:`state`.
    """

    def __init__(self, payloads: int = 0, times: int = 0) -> None:
        self._payloads, self._times = payloads, times

    def add(self, times: NDArray[np.int64], payloads: bytes | memoryview | NDArray[np.uint8]) -> None:
        """Add messages by their receive times [ns] and concatenated payloads."""
        data: Any = payloads
        self._payloads = zlib.crc32(data, self._payloads)
        self._times = zlib.crc32(np.ascontiguousarray(times, dtype='<i8').tobytes(), self._times)

    @property
    def state(self) -> tuple[int, int]:
        """CRC-32 of the payloads and of the receive times so far."""
        return self._payloads, self._times

    @property
    def text(self) -> str:
        """Digest of all messages so far."""
        return f'{self._payloads:08x}{self._times:08x}'


def digest_state(text: str) -> tuple[int, int] | None:
    """Return the state in a string of :attr:`TopicDigest.text`; None if it is invalid."""
    try:
        return (int(text[:8], 16), int(text[8:], 16)) if len(text) == 16 else None
    except ValueError:
        return None


def write_digests(digests: Mapping[str, TopicDigest]) -> str:
    """Return the digests of topics, by full name, as a string."""
    return json.dumps({topic: digest.text for topic, digest in digests.items()})


def read_digests(text: str) -> dict[str, str]:
    """
    Return the digests in a string of :func:`write_digests`; an empty string has none.

    Raises
    ------
    ValueError
        If the string is invalid.
    """
    found = json.loads(text) if text else {}
    if not isinstance(found, dict) or not all(isinstance(digest, str) for digest in found.values()):
        raise ValueError(f'{DIGEST_KEY} is {text!r:.80}')
    return found
