"""Zstandard, with the library that `rosbags` depends on; imported only for compressed bags."""

from types import ModuleType
from typing import Any

LEVEL = 3
"""Compression level, the default of the library."""
_PIECE = 4096
"""Number of bytes decompressed at once from a frame that may be damaged."""


def require_zstd() -> None:
    """Raise ValueError if the library is not installed."""
    _library()


def _library() -> ModuleType:
    try:
        from backports import zstd
    except ModuleNotFoundError:
        raise ValueError('zstd needs the Python package backports.zstd, which rosbags 0.11 installs') from None
    return zstd


def compress(data: Any) -> bytes:
    """Return the content of a buffer as one Zstandard frame."""
    frame: bytes = _library().compress(data, level=LEVEL)
    return frame


def decompress(frame: Any) -> bytes:
    """
    Return the content of a complete frame.

    Raises
    ------
    ValueError
        If the frame is damaged or truncated.
    """
    library = _library()
    try:
        content: bytes = library.decompress(frame)
    except library.ZstdError as error:
        raise ValueError(f'invalid Zstandard frame: {error}') from None
    return content


def decompress_beginning(frame: Any) -> bytes:
    """Return the content of the first complete blocks of a frame that may be truncated or damaged."""
    library = _library()
    decompressor = library.ZstdDecompressor()
    content = b''
    try:
        # In small pieces, so that the blocks before a damaged one are kept.
        for start in range(0, len(frame), _PIECE):
            content += decompressor.decompress(frame[start : start + _PIECE])
            if decompressor.eof:
                break
    except library.ZstdError:
        pass
    return content
