"""Distinction of loop messages from arbitrary bytes."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.messages.cdr import ReportCodec, row_layout
from hdd_servo_ros.messages.checked import check_message
from hdd_servo_ros.messages.codecs import ACCELERATIONS, ARRAYS, CLOCKS, CODECS, REPORTS, VECTORS

NAMES = ('t', 'r', 'm_hat')


def message_of(codec, frame_id):
    return ReportCodec(frame_id).pack(bytes(8)) if codec is REPORTS else row_layout(codec, frame_id, NAMES).template


@pytest.mark.parametrize('codec', CODECS.values(), ids=lambda codec: codec.type_name)
@pytest.mark.parametrize('frame_id', ['', 'a', 'drive', 'a longer name', 'äö'])
def test_what_a_codec_packs_is_a_message(codec, frame_id):
    check_message(codec, message_of(codec, frame_id))


@pytest.mark.parametrize('codec', CODECS.values(), ids=lambda codec: codec.type_name)
def test_cut_off_or_longer_or_big_endian_is_none(codec):
    whole = message_of(codec, 'drive')
    for length in range(len(whole)):
        with pytest.raises(ValueError, match='bytes'):
            check_message(codec, whole[:length])
    for other in (whole + b'\x00', b'\x00\x00' + whole[2:], b'\x00\x03' + whole[2:]):
        with pytest.raises(ValueError, match='bytes'):
            check_message(codec, other)


def test_a_report_is_known_by_its_run_and_may_be_padded():
    stamp = bytes(range(8))
    for run in ('host:1:a', 'host:12:ab', 'host:123:abc'):
        codec = ReportCodec(run)
        whole = codec.pack(stamp)
        for padding in range(4):
            assert codec.stamp_of(whole + bytes(padding)) == stamp
        others = (b'', whole[:-1], whole + bytes(4), b'\x00\x00' + whole[2:], ReportCodec(run + 'b').pack(stamp))
        assert [codec.stamp_of(other) for other in others] == [None] * 5


@pytest.mark.parametrize('codec', [CLOCKS, VECTORS, ACCELERATIONS, ARRAYS, REPORTS], ids=lambda codec: codec.type_name)
@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_rejected(codec, data):
    for message in (data, b'\x00\x01\x00\x00' + data):
        with contextlib.suppress(ValueError):
            check_message(codec, message)
            # Of random bytes only these are valid by chance.
            assert message.startswith(b'\x00\x01')
