"""Compressions of MCAP chunks, by their names in the file; the libraries are dependencies of `rosbags`."""

import importlib
from collections.abc import Callable
from typing import Any

from hdd_servo_ros.recording import zstd

_PIECE = 4096
"""Number of bytes decompressed at once from a frame that may be damaged."""


def _lz4(frame: Any) -> bytes:
    library = importlib.import_module('lz4.frame')

    try:
        content: bytes = library.decompress(frame)
    except RuntimeError as error:
        raise ValueError(f'invalid LZ4 frame: {error}') from None
    return content


def _lz4_beginning(frame: Any) -> bytes:
    library = importlib.import_module('lz4.frame')

    decompressor = library.LZ4FrameDecompressor()
    content = b''
    try:
        for start in range(0, len(frame), _PIECE):
            content += decompressor.decompress(bytes(frame[start : start + _PIECE]))
            if decompressor.eof:
                break
    except RuntimeError:
        pass
    return content


DECOMPRESS: dict[str, Callable[[Any], Any]] = {'': lambda data: data, 'zstd': zstd.decompress, 'lz4': _lz4}
"""Functions that return the content of a complete chunk; they raise ValueError if it is damaged or truncated."""
DECOMPRESS_BEGINNING: dict[str, Callable[[Any], bytes]] = {'zstd': zstd.decompress_beginning, 'lz4': _lz4_beginning}
"""Functions that return the content of the first complete blocks of a truncated or damaged chunk."""
