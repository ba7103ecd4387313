"""The checksum of two pieces from those of the pieces, against that of the whole."""

import zlib

from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.recording.crc import combined_crc


@given(first=st.binary(max_size=300), second=st.binary(max_size=300))
def test_two_pieces(first, second):
    assert combined_crc(zlib.crc32(first), zlib.crc32(second), len(second)) == zlib.crc32(first + second)


@given(size=st.integers(0, 3_000_000), text=st.binary(min_size=1, max_size=20))
def test_a_long_second_piece(size, text):
    second = (text * (size // len(text) + 1))[:size]
    assert combined_crc(zlib.crc32(text), zlib.crc32(second), size) == zlib.crc32(text + second)
