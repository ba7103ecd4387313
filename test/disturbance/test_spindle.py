"""Whether a revolution of the spindle has a whole number of samples."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.disturbance.spindle import SpindleParameters
from hdd_servo_ros.parameters import ParameterError


@pytest.mark.parametrize(('sectors', 'nanoseconds'), [(84, 99206), (220, 37879), (420, 19841)])
def test_the_sample_times_of_the_presets_are_synchronous(sectors, nanoseconds):
    spindle = SpindleParameters(7200.0, sectors)
    sample_time = nanoseconds * 1e-9
    assert spindle.samples_per_revolution(sample_time) == sectors
    assert spindle.require_synchronous(sample_time, 'this') == sectors
    assert spindle.turns_per_sample(sample_time) * sectors == pytest.approx(1.0, rel=2e-5)


@given(st.integers(10, 2000), st.floats(1000.0, 20000.0))
def test_a_whole_number_of_nanoseconds_is_always_close_enough(sectors, speed):
    sample_time = round(60e9 / (speed * sectors)) * 1e-9
    assert SpindleParameters(speed, sectors).samples_per_revolution(sample_time) == sectors


@pytest.mark.parametrize(
    ('sectors', 'sample_time'), [(0, 1e-4), (84, 1e-4), (83, 1e-4), (84, 99204e-9), (220, 37878e-9), (84, 49603e-9)]
)
def test_asynchronous_sectors_are_rejected_in_one_line(sectors, sample_time):
    spindle = SpindleParameters(7200.0, sectors)
    assert spindle.samples_per_revolution(sample_time) == 0
    with pytest.raises(ParameterError) as error:
        spindle.require_synchronous(sample_time, 'runout.repeatable.sequence = random')
    text = str(error.value)
    assert text.startswith(
        f'invalid value for parameter spindle.sectors: {sectors}; expected a whole number of samples per revolution'
    )
    assert f'sample_time is {sample_time!r} s' in text
    assert '\n' not in text


def test_the_advice_of_the_rejection_is_synchronous():
    with pytest.raises(ParameterError, match=r'for example sectors = 83 with sample_time = 0\.000100402 s'):
        SpindleParameters(7200.0, 0).require_synchronous(1e-4, 'this')
    assert SpindleParameters(7200.0, 83).samples_per_revolution(0.000100402) == 83
