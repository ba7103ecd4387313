"""
Check of the two checksums of a closed MCAP file, which together cover the data section and the summary.

See https://mcap.dev/spec, records "Data End" and "Footer". Both are optional; rosbag2 omits that of the data section.
"""

import struct
import zlib
from pathlib import Path
from typing import BinaryIO

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _DATA_END = 0x02, 0x0F
_FOOTER_RECORD = struct.Struct('<BQQQI')
_DATA_END_RECORD = struct.Struct('<BQI')
_PIECE = 2**20
"""Number of bytes that are read at once."""


WRONG_DATA = 'the data section is damaged: its checksum is wrong'


class CheckError(ValueError):
    """A file that does not match its checksums."""


def check_mcap(path: Path) -> bool:
    """
    Check a file.

    Returns
    -------
    bool
        Whether the file has a checksum of the data section, so that every byte was verified.

    Raises
    ------
    OSError
        If the file cannot be read.
    CheckError
        If the file is truncated or a checksum is wrong.
    """
    with path.open('rb') as file:
        size = file.seek(0, 2)
        footer_at = size - len(_MAGIC) - _FOOTER_RECORD.size
        if footer_at < len(_MAGIC):
            raise CheckError('the file does not end as an MCAP file does')
        file.seek(0)
        begin = file.read(len(_MAGIC))
        file.seek(footer_at)
        opcode, length, summary, _, crc = _FOOTER_RECORD.unpack(file.read(_FOOTER_RECORD.size))
        if begin != _MAGIC or (opcode, length) != (_FOOTER, 20) or file.read() != _MAGIC:
            raise CheckError('the file does not begin and end as an MCAP file does')
        if not summary:
            summary = footer_at
        if not len(_MAGIC) + _DATA_END_RECORD.size <= summary <= footer_at:
            raise CheckError(f'the footer contains the invalid summary offset {summary}')
        # The checksum also covers the footer up to the checksum itself.
        if crc and _crc(file, summary, size - len(_MAGIC) - 4) != crc:
            raise CheckError('the summary is damaged: its checksum is wrong')
        data_end = summary - _DATA_END_RECORD.size
        file.seek(data_end)
        opcode, length, crc = _DATA_END_RECORD.unpack(file.read(_DATA_END_RECORD.size))
        if (opcode, length) != (_DATA_END, 4):
            raise CheckError(f'the data section does not end at byte {data_end}, before the summary')
        if crc and _crc(file, 0, data_end) != crc:
            raise CheckError(WRONG_DATA)
        return bool(crc)


def _crc(file: BinaryIO, start: int, end: int) -> int:
    file.seek(start)
    crc, left = 0, end - start
    while left > 0:
        piece = file.read(min(_PIECE, left))
        if not piece:
            raise CheckError('the file became shorter during reading')
        crc = zlib.crc32(piece, crc)
        left -= len(piece)
    return crc
