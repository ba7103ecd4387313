"""Resonances: modal form, exact discretization, parameter checks."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.linalg import expm

from hdd_servo_ros.drive import transfer
from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.drive.resonance import (
    Mode,
    ResonanceParameters,
    Section,
    modal_form,
    mode_transition,
    partial_fractions,
    sections_of,
)
from hdd_servo_ros.parameters import ParameterError

Run = Callable[..., npt.NDArray[np.float64]]

FREQUENCIES = (4000.0, 5100.0, 7300.0)
DAMPINGS = (0.01, 0.02, 0.05)


def modal_response(form: Any, s: complex) -> complex:
    assert hasattr(form, 'modes')
    value = form.r0 / s**2 + form.r1 / s
    return value + sum((m.beta * s + m.gamma) / (s * s + m.a1 * s + m.a0) for m in form.modes)


def test_default_sections_are_5_2_to_5_5() -> None:
    sections = sections_of(ResonanceParameters())
    assert sections[0] == Section(0.9321, 678.3, 1.184e9, 2053.0, 1.184e9)
    assert sections[1] == Section(0.8249, 2251.0, 1.665e9, 3276.0, 1.665e9)
    assert sections[2] == Section(0.0, 0.0, 2.431e9, 2703.0, 2.431e9)
    assert sections[3] == Section(0.0, 0.0, 8.383e9, 5655.0, 8.383e9)
    # The peaks that section 5.3 names: 5.5, 6.5, 7.86 and 15 kHz
    hertz = [math.sqrt(section.a0) / (2 * math.pi) for section in sections]
    np.testing.assert_allclose(hertz, [5476, 6494, 7847, 14572], atol=1)


@pytest.mark.parametrize('frequency', [10.0, 700.0, 5470.0, 6490.0, 7850.0, 14_500.0, 40_000.0])
def test_partial_fractions_are_the_product(frequency: float) -> None:
    s = 2j * math.pi * frequency
    sections = sections_of(ResonanceParameters())
    product = 1.0 / s**2
    for q in sections:
        product *= (q.b2 * s * s + q.b1 * s + q.b0) / (s * s + q.a1 * s + q.a0)
    assert modal_response(partial_fractions(sections), s) == pytest.approx(product, rel=1e-10)


@given(
    frequencies=st.lists(st.floats(500.0, 3.0e4), min_size=1, max_size=8, unique=True),
    damping=st.floats(0.002, 0.6),
    b2=st.floats(-2.0, 2.0),
    b1=st.floats(-1.0, 1.0),
    b0=st.floats(0.1, 2.0),
)
def test_a_force_step_causes_no_velocity_step(
    frequencies: list[float], damping: float, b2: float, b1: float, b0: float
) -> None:
    """R1 + sum of beta is zero: the head's acceleration, not its velocity, follows the force."""
    ordered = sorted(frequencies)
    assume(all(b / a > 1.01 for a, b in itertools.pairwise(ordered)))
    sections = []
    for f in frequencies:
        w = 2.0 * math.pi * f
        sections.append(Section(b2, b1 * w, b0 * w * w, 2.0 * damping * w, w * w))
    form = partial_fractions(sections)
    # R1 is a time: of the order of the slowest mode's 1/w.
    scale = abs(form.r1) + sum(abs(mode.beta) for mode in form.modes) + 1e-6 / (2.0 * math.pi * ordered[0])
    assert abs(form.r1 + sum(mode.beta for mode in form.modes)) <= 1e-9 * scale


@given(
    frequency=st.floats(10.0, 3.0e4),
    damping=st.floats(1.0e-4, 0.99),
    time=st.floats(1.0e-6, 1.0e-3),
)
def test_transition_is_the_matrix_exponential(frequency: float, damping: float, time: float) -> None:
    w = 2.0 * math.pi * frequency
    a11, a12, a21, a22, b1, b2 = mode_transition(Mode(0.0, 1.0, 2.0 * damping * w, w * w), time)
    # q and q'/w, so that the matrix is balanced
    matrix = np.array([[0.0, w, 0.0], [-w, -2.0 * damping * w, 1.0 / w], [0.0, 0.0, 0.0]])
    reference = expm(matrix * time)
    np.testing.assert_allclose([[a11, a12 * w], [a21 / w, a22]], reference[:2, :2], atol=1e-10)
    np.testing.assert_allclose([b1 * w * w, b2 * w], reference[:2, 2] * np.array([w * w, w * w]), rtol=1e-6, atol=1e-9)


def test_two_parameter_form_is_3_19() -> None:
    parameters = ResonanceParameters(form='two_parameter', frequencies=(1000.0,), damping_ratios=(0.02,))
    w = 2000.0 * math.pi
    assert sections_of(parameters) == [Section(0.0, 0.0, w * w, 0.04 * w, w * w)]


def test_parallel_form_is_the_sum_of_its_modes() -> None:
    parameters = ResonanceParameters(
        form='parallel', frequencies=FREQUENCIES, damping_ratios=DAMPINGS, residues=(-1.0, 0.3, -0.2)
    )
    form = modal_form(parameters)
    s = 2j * math.pi * 4900.0
    value = 1 / s**2
    for f, z, c in zip(FREQUENCIES, DAMPINGS, (-1.0, 0.3, -0.2), strict=True):
        w = 2 * math.pi * f
        value += c / (s * s + 2 * z * w * s + w * w)
    assert modal_response(form, s) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ('values', 'name', 'allowed'),
    [
        ({'numerators': ()}, 'numerators', 'a list that is not empty for resonance form sections'),
        ({'form': 'two_parameter'}, 'frequencies', 'a list that is not empty for resonance form two_parameter'),
        ({'form': 'parallel'}, 'frequencies', 'form none has no resonance'),
        ({'numerators': (1.0, 2.0, 3.0)}, 'denominators', 'a list of 3 numbers'),
        ({'numerators': (1.0,) * 4, 'denominators': (1.0,) * 4}, 'numerators', 'three numbers'),
        ({'numerators': (0.0, 0.0, 1.0), 'denominators': (1.0, -0.1, 1.0)}, 'denominators', 'section 1'),
        ({'numerators': (0.0, 0.0, 1.0), 'denominators': (1.0, 0.1, -1.0)}, 'denominators', 'stable'),
        ({'numerators': (0.0, 0.0, 1.0), 'denominators': (1.0, 3.0, 1.0)}, 'denominators', 'underdamped'),
        ({'numerators': (0.0, 0.0, 1.0) * 2, 'denominators': (1.0, 0.1, 1.0) * 2}, 'denominators', 'distinct poles'),
        ({'numerators': (0.0, 0.0, math.nan), 'denominators': (1.0, 0.1, 1.0)}, 'numerators', 'finite'),
        ({'form': 'two_parameter', 'frequencies': (1.0e3,)}, 'damping_ratios', 'a list of 1 numbers'),
        (
            {'form': 'parallel', 'frequencies': FREQUENCIES, 'damping_ratios': DAMPINGS, 'residues': (1.0,)},
            'residues',
            'a list of 3 numbers',
        ),
        ({'form': 'two_parameter', 'frequencies': (-1.0,), 'damping_ratios': (0.1,)}, 'frequencies', 'above 0'),
        ({'form': 'two_parameter', 'frequencies': (10.0,), 'damping_ratios': (1.5,)}, 'damping_ratios', 'at most'),
        ({'form': 'two_parameter', 'frequencies': (10.0,), 'damping_ratios': (0.0,)}, 'damping_ratios', 'above 0'),
        ({'form': 'cascade'}, 'form', 'one of none, sections, two_parameter, parallel'),
    ],
)
def test_bad_parameters_are_named(values: dict[str, object], name: str, allowed: str) -> None:
    with pytest.raises(ParameterError, match=allowed) as error:
        ResonanceParameters(**values)  # type: ignore[arg-type]
    assert error.value.name == name


def test_lists_of_another_form_are_not_read() -> None:
    # A parameter file changes the form and leaves the default's lists alone.
    assert sections_of(ResonanceParameters(form='none')) == []
    parallel = ResonanceParameters(form='parallel', frequencies=(1e3,), damping_ratios=(0.1,), residues=(-1.0,))
    assert len(modal_form(parallel).modes) == 1


def cluster(count: int, spacing: float) -> ResonanceParameters:
    frequencies = tuple(4000.0 * (1.0 + spacing * i) for i in range(count))
    return ResonanceParameters(form='two_parameter', frequencies=frequencies, damping_ratios=(0.02,) * count)


# The sum of modes loses about (count - 1) * 2 powers of the spacing over the damping to cancellation.
@pytest.mark.parametrize(
    ('count', 'spacing'), [(2, 1e-6), (3, 1.2e-5), (3, 1e-4), (4, 1.2e-5), (4, 1e-4), (5, 1.2e-5), (5, 1e-3)]
)
def test_poles_too_close_for_the_modal_form_are_rejected(count: int, spacing: float) -> None:
    with pytest.raises(ParameterError, match='distinct poles; with poles this close') as error:
        cluster(count, spacing)
    assert error.value.name == 'frequencies'


@pytest.mark.parametrize(('count', 'spacing'), [(2, 2e-5), (2, 1e-3), (3, 1e-3), (4, 5e-3), (5, 1e-2)])
def test_close_poles_that_are_accepted_run_as_their_product(count: int, spacing: float) -> None:
    """The measured response, too: the error of the modal form is the step's."""
    resonance = cluster(count, spacing)
    plant = Plant(PlantParameters(friction=FrictionParameters(model='none'), resonance=resonance), 2.0e-5)
    frequencies = np.array([100.0, 1000.0, 3900.0])
    pulse = [1.0, -2.0, 1.0]
    head = [plant.step(tick, pulse[tick - 1] if tick < 4 else 0.0)[0] for tick in range(1, 20_001)]
    z = np.exp(-2j * np.pi * frequencies * 2.0e-5)
    measured = (z[:, np.newaxis] ** np.arange(1, 20_001)) @ np.array(head) / np.polyval(pulse, z)
    analytic = transfer.frequency_response(plant.parameters, frequencies)
    hold = np.sinc(frequencies * 2.0e-5) * np.exp(-1j * np.pi * frequencies * 2.0e-5)
    np.testing.assert_allclose(measured, analytic * hold, rtol=5e-5)  # aliasing of about 1e-5
