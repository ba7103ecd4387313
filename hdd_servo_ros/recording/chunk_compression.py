"""The compressions of MCAP chunks, by their names in the file; the libraries are those that `rosbags` depends on."""

import importlib
from collections.abc import Callable
from typing import Any

from hdd_servo_ros.recording import zstd

_PIECE = 4096
"""Bytes of a frame that are decompressed at once where the frame may be damaged."""


def _lz4(frame: Any) -> bytes:
    library = importlib.import_module('lz4.frame')

    try:
        content: bytes = library.decompress(frame)
    except RuntimeError as error:
        raise ValueError(f'not a whole LZ4 frame: {error}') from None
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
"""Give the content of a whole chunk; raise ValueError if it is damaged or cut off."""
DECOMPRESS_BEGINNING: dict[str, Callable[[Any], bytes]] = {'zstd': zstd.decompress_beginning, 'lz4': _lz4_beginning}
"""Give the content of the first complete blocks of a chunk that may be cut off or damaged."""
