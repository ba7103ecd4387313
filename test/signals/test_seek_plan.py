"""The list of seeks: ticks, targets and repetitions, against lists written out by hand or made one by one."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest, loguniform, uniform

from hdd_servo_ros.parameters import ParameterError, from_mapping
from hdd_servo_ros.signals.reference import Reference, ReferenceParameters

T = 1e-4


def parameters(offset=0.0, start_time=0.0, **seek):
    values = {f'seek.{name}': value for name, value in seek.items()}
    return from_mapping(ReferenceParameters, {'waveform': 'seek', 'offset': offset, 'start_time': start_time, **values})


def reference(sample_time=T, **values):
    return Reference(parameters(**values), sample_time)


def rows(block, ticks):
    return np.array([block.step(int(tick)) for tick in ticks])


def test_steps_are_sharp_to_the_tick():
    block = reference(
        offset=2.0,
        start_time=0.003,
        trajectory='step',
        targets=[5.0, -1.0, 4.0],
        dwell_times=[0.001, 0.0007, 0.002],
        repeat=True,
    )
    expected = [2.0] * 30 + ([7.0] * 10 + [1.0] * 7 + [6.0] * 20) * 5
    result = rows(block, range(len(expected)))
    np.testing.assert_array_equal(result[:, 0], expected)
    assert not result[:, 1:].any()


@pytest.mark.parametrize('sample_time', [1e-4, 5e-5, 60 / 7200 / 220, 1 / 30_000])
@pytest.mark.parametrize('samples', [1, 7, 100])
def test_dwell_times_of_whole_samples_are_not_rounded_up(sample_time, samples):
    block = reference(
        sample_time, trajectory='step', targets=[1.0, 2.0], dwell_times=[samples * sample_time], repeat=False
    )
    np.testing.assert_array_equal(block.seeks.start_ticks, [0, samples])


def test_dwell_times_are_rounded_up():
    block = reference(trajectory='step', targets=[1.0, 2.0, 3.0], dwell_times=[1.5e-4], repeat=False)
    np.testing.assert_array_equal(block.seeks.start_ticks, [0, 2, 4])


def test_the_last_target_is_held():
    block = reference(trajectory='step', targets=[1.0, 2.0], dwell_times=[0.001], repeat=False)
    np.testing.assert_array_equal(rows(block, [15, 1000, 10**9])[:, 0], 2.0)
    assert block.seeks.next_after(9) == (10, 2.0)
    assert block.seeks.next_after(10) is None


def test_targets_in_tracks():
    block = reference(offset=1.0, track_pitch=0.254, targets=[100.0, -3.5])
    np.testing.assert_allclose(block.seeks.targets, [1.0 + 25.4, 1.0 - 0.889])
    np.testing.assert_allclose(block.seeks.origins, [1.0, 26.4])


@pytest.mark.parametrize('trajectory', ['minimum_jerk', 'time_optimal'])
def test_each_pass_starts_from_where_the_last_one_ended(trajectory):
    block = reference(offset=3.0, trajectory=trajectory, targets=[10.0, -5.0, 20.0], dwell_times=[0.004])
    first, second, third = (rows(block, range(120 * i, 120 * (i + 1))) for i in range(3))
    np.testing.assert_array_equal(second, third)
    np.testing.assert_array_equal(first[40:], second[40:])
    assert first[0, 0] == 3.0
    assert second[0, 0] == 23.0
    whole = np.concatenate([first, second])
    # Continuous at 2e8 um/s^2 and less than 2.1e5 um/s.
    assert np.abs(np.diff(whole[:, 0])).max() < 21.0 * 0.5
    np.testing.assert_array_equal(whole[39::40], [[3.0 + x, 0.0, 0.0] for x in (10.0, -5.0, 20.0)] * 2)


@pytest.mark.parametrize('trajectory', ['minimum_jerk', 'time_optimal'])
def test_trajectories_take_the_samples_that_are_said(trajectory):
    block = reference(trajectory=trajectory, targets=[10.0, 10.0, -40.0], dwell_times=[0.01])
    seeks = block.seeks.before(600)
    assert seeks.trajectory_ticks[1] == 0
    for start, origin, target, samples in zip(
        seeks.start_ticks, seeks.origins, seeks.targets, seeks.trajectory_ticks, strict=True
    ):
        result = rows(block, range(start, start + samples + 3))
        assert result[0, 0] == origin
        np.testing.assert_array_equal(result[samples:], [[target, 0.0, 0.0]] * 3)
        assert (np.abs(result[1:samples, 0] - target) > 0.0).all()


@settings(max_examples=60, deadline=None)
@given(
    count=st.integers(1, 5),
    repeat=st.booleans(),
    start=st.integers(0, 30),
    data=st.data(),
)
def test_the_list_against_one_made_seek_by_seek(count, repeat, start, data):
    targets = data.draw(st.lists(st.floats(-50.0, 50.0), min_size=count, max_size=count))
    dwells = data.draw(st.lists(st.integers(1, 20), min_size=count, max_size=count))
    block = reference(
        start_time=start * T, trajectory='step', targets=targets, dwell_times=[n * T for n in dwells], repeat=repeat
    )
    end = 200
    expected: list[tuple[int, float, float]] = []
    tick, origin = start, 0.0
    for target, samples in itertools.cycle(zip(targets, dwells, strict=True)):
        if tick >= end or (len(expected) == count and not repeat):
            break
        expected.append((tick, origin, target))
        tick, origin = tick + samples, target
    found = block.seeks.before(end)
    assert list(zip(found.start_ticks, found.origins, found.targets, strict=True)) == expected
    for tick in range(end - 20):
        later = [(t, target) for t, _, target in expected if t > tick]
        assert block.seeks.next_after(tick) == (later[0] if later else None)
    position = {t: target for t, _, target in expected}
    x = 0.0
    for tick in range(end):
        x = position.get(tick, x)
        assert block.step(tick) == (x, 0.0, 0.0)


def random_lengths(**seek):
    seeks = reference(source='random', **seek).seeks
    return np.abs(np.diff(np.concatenate([[0.0], seeks.targets])))


@pytest.mark.parametrize(
    ('name', 'distribution'),
    [('uniform', uniform(2.0, 48.0)), ('log_uniform', loguniform(2.0, 50.0))],
)
def test_random_lengths_have_their_distribution(name, distribution):
    lengths = random_lengths(
        count=5000, shortest=2.0, longest=50.0, travel=50.0, length_distribution=name, dwell_times=[0.01]
    )
    assert kstest(lengths, distribution.cdf).pvalue > 0.01


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**53), longest=st.floats(1.0, 100.0), room=st.floats(1.0, 3.0))
def test_random_targets_stay_within_the_travel(seed, longest, room):
    travel = room * longest
    block = reference(source='random', seed=seed, count=200, shortest=0.5, longest=longest, travel=travel, offset=30.0)
    lengths = np.abs(np.diff(np.concatenate([[30.0], block.seeks.targets])))
    assert np.abs(block.seeks.targets - 30.0).max() <= travel * (1.0 + 1e-12)
    assert lengths.min() >= 0.5 * (1.0 - 1e-9)
    assert lengths.max() <= longest * (1.0 + 1e-9)


def test_directions_are_drawn_evenly_where_there_is_room():
    targets = reference(source='random', count=4000, shortest=1.0, longest=2.0, travel=1e5).seeks.targets
    forward = np.count_nonzero(np.diff(targets) > 0.0)
    # 3 sigma of the binomial distribution.
    assert abs(forward - 2000) < 95


def test_random_seeks_follow_from_their_seed():
    def of(seed, **seek):
        return reference(source='random', seed=seed, **seek).seeks.targets

    np.testing.assert_array_equal(of(3), of(3))
    assert not np.isin(of(3), of(4)).any()
    # A longer list begins as the shorter one.
    np.testing.assert_array_equal(of(3, count=500)[:100], of(3))


def test_random_seeks_have_the_same_bits_everywhere():
    """Made once: a library's logarithm or generator must not enter."""
    block = reference(source='random', seed=7, count=4, longest=150.0, travel=150.0)
    assert [target.hex() for target in block.seeks.targets.tolist()] == [
        '0x1.38462cc410654p-1',
        '0x1.6c17595d5b47bp+3',
        '0x1.f5b3b0ad3cfa0p+4',
        '-0x1.abb57d72b8ba0p+4',
    ]


def test_update_goes_on_in_time():
    block = reference(trajectory='step', targets=[1.0, 2.0], dwell_times=[0.001])
    block.update(parameters(trajectory='step', targets=[1.0, 2.0], dwell_times=[0.002]))
    np.testing.assert_array_equal(rows(block, range(50))[:, 0], [1.0] * 20 + [2.0] * 20 + [1.0] * 10)
    block.update(ReferenceParameters())
    assert len(block.seeks) == 0
    assert block.seeks.next_after(0) is None
    assert len(block.seeks.before(10)) == 0


@pytest.mark.parametrize(
    ('name', 'values'),
    [
        ('seek.targets', {'targets': []}),
        ('seek.dwell_times', {'targets': [1.0, 2.0, 3.0], 'dwell_times': [0.1, 0.1]}),
        ('seek.dwell_times', {'dwell_times': []}),
        ('seek.dwell_times', {'dwell_times': [0.0]}),
        ('seek.dwell_times', {'source': 'random', 'dwell_times': [0.1, 0.1]}),
        ('seek.longest', {'source': 'random', 'longest': 0.05}),
        ('seek.travel', {'source': 'random', 'travel': 99.0}),
        ('seek.trajectory', {'trajectory': 'spline'}),
        ('seek.acceleration', {'acceleration': 0.0}),
        ('seek.count', {'source': 'random', 'count': 0}),
    ],
)
def test_invalid_parameters_are_rejected(name, values):
    with pytest.raises(ParameterError) as rejected:
        parameters(**values)
    assert rejected.value.name == name


def test_a_rejected_length_names_the_one_that_it_does_not_go_with():
    for values, allowed in (
        ({'shortest': 200.0}, 'seek.longest: 100.0; expected at least shortest, which is 200.0 um'),
        ({'travel': 99.0}, 'seek.travel: 99.0; expected at least longest, which is 100.0 um'),
    ):
        with pytest.raises(ParameterError, match=allowed):
            parameters(source='random', **values)


@pytest.mark.parametrize(
    ('values', 'number'),
    [
        ({'targets': [1.0, 100.0], 'dwell_times': [0.001, 0.001]}, 'seek 2 over 99 um takes 0.00181104 s'),
        ({'targets': [1.0, 0.0, 100.0], 'dwell_times': [0.001, 0.001, 0.01]}, 'seek 1 of the repeated list over'),
        ({'source': 'random', 'dwell_times': [0.001]}, 'the next seek starts after 0.001 s'),
    ],
)
def test_a_trajectory_longer_than_its_dwell_time_is_rejected(values, number):
    with pytest.raises(ParameterError) as rejected:
        parameters(**values)
    assert rejected.value.name == 'seek.dwell_times'
    assert number in str(rejected.value)


def test_a_last_seek_that_nothing_follows_may_take_long():
    assert reference(targets=[1.0, 100.0], dwell_times=[0.001], repeat=False).step(30)[0] == 100.0


def test_other_waveforms_do_not_look_at_the_seeks():
    ReferenceParameters(seek=parameters(trajectory='step', dwell_times=[1e-4]).seek)
    with pytest.raises(ParameterError, match='dwell_times'):
        parameters(dwell_times=[1e-4])
