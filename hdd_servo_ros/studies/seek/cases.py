"""Recorded runs shared by figures and tables, and limits for the results."""

from collections.abc import Mapping, Sequence

import numpy as np

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.drive.plant import PlantParameters

FILE, SEEK, VIBRATION, NSS, NSS_RATE, SERVO = (
    'seagate_7200_10.yaml',
    'seek.yaml',
    'mobile_rotational_vibration.yaml',
    'nss_100ktpi.yaml',
    'nss_100ktpi_10_khz.yaml',
    'seek_servo.yaml',
)
DWELL = 0.03
"""Time between seeks [s]."""
TOLERANCE, NARROW, NEAR = 0.1, 0.025, 2.0
"""Position errors for arrival, for narrow arrival, and for the start of settling [um]."""
LENGTHS = (1.0, 5.0, 10.0, 50.0, 100.0, 150.0)
"""Lengths of the seeks in the tables [um]."""
NOMINAL_LIMITS = dict(zip(LENGTHS, (0.8, 1.0, 1.3, 1.6, 2.0, 2.2), strict=True))
NOMINAL_GOALS = dict(zip(LENGTHS, (0.75, 0.95, 1.1, 1.4, 1.6, 1.8), strict=True))
ROBUST_LIMITS = dict(zip(LENGTHS, (0.9, 1.1, 1.5, 1.9, 2.4, 2.7), strict=True))
"""Limits (and goals) of the seek time, by length [ms]."""
OVERSHOOT_LIMITS = {'nominal': 0.1, 'varied': 0.5}
"""Limits of the overshoot on the nominal drive and on others [um]."""
NARROW_LIMITS = {10.0: (1.5, 1.8), 50.0: (2.1, 2.6)}
"""Limits of the seek time into +-25 nm by length [ms]: nominal, and with friction +-20 % after 20 seeks."""
LEARNED_AFTER = 20
"""Number of seeks after which the friction scale is learned."""
METHODS = {'final_state': 'final-state', 'ptos': 'PTOS', 'cnf': 'CNF'}
"""Names of the seek methods in figures and tables."""
FRICTIONS = (0.8, 1.0, 1.2)
"""Friction of the drive relative to the model of the controller."""
LEARNING_LENGTHS = (10.0, 50.0)
"""Lengths of the seeks for the study of arrival [um]."""


def drive_changes(friction: float = 1.0, gain: float = 1.0, modes: float = 1.0) -> dict[str, object]:
    """Return overrides for a drive whose friction, gain and mode frequencies are scaled by factors."""
    nominal = PlantParameters()
    changes: dict[str, object] = {'vcm_plant:gain': nominal.gain * gain}
    for name in ('stiffness', 'coulomb_level', 'static_level'):
        changes[f'vcm_plant:friction.{name}'] = getattr(nominal.friction, name) * friction
    powers = np.array([1.0, modes, modes**2])
    for name in ('numerators', 'denominators'):
        sections = np.reshape(getattr(nominal.resonance, name), (-1, 3)) * powers
        changes[f'vcm_plant:resonance.{name}'] = tuple(sections.ravel().tolist())
    return changes


def seeks_to(targets: Sequence[float], dwell: float = DWELL) -> dict[str, object]:
    """Return overrides for seeks to targets [um], starting after one dwell time [s]."""
    return {
        'reference_generator:start_time': dwell,
        'reference_generator:seek.targets': tuple(float(target) for target in targets),
        'reference_generator:seek.dwell_times': (dwell,),
        'deterministic_timer:duration': round(dwell * (len(targets) + 1), 9),
    }


def to_and_fro(length: float, count: int) -> tuple[float, ...]:
    """Return targets that alternate between a length and 0."""
    return tuple(length if index % 2 == 0 else 0.0 for index in range(count))


def _case(name: str, targets: Sequence[float], *files: str, **changes: object) -> Case:
    """Return a recorded run; in ``changes``, ``__`` means a colon and ``_dot_`` a dot."""
    own = {key.replace('__', ':').replace('_dot_', '.'): value for key, value in changes.items()}
    return Case(name, 'seek', (FILE, *files, SEEK), {**seeks_to(targets), **own})


BASE: Mapping[str, Case] = {
    method: _case(f'to_50_um_{method}', to_and_fro(50.0, 2), seek_controller__seek_dot_method=method)
    for method in METHODS
}
"""Seek of 50 µm and back, by method."""
PID = Case('to_50_um_pid', 'pid', (FILE, SEEK), seeks_to(to_and_fro(50.0, 2)))
"""The same with only the PID controller."""
NO_FRICTION = {
    length: _case(
        f'{length:g}_um_without_friction_feedforward',
        to_and_fro(length, 4),
        seek_controller__seek_dot_friction_dot_enabled=False,
        seek_controller__seek_dot_learning_dot_friction=False,
    )
    for length in LEARNING_LENGTHS
}
"""Runs without friction feedforward, by length."""
UNLEARNED = {
    (length, friction): Case(
        f'{length:g}_um_friction_{friction:g}_not_learned',
        'seek',
        (FILE, SEEK),
        {
            **seeks_to(to_and_fro(length, 4)),
            **drive_changes(friction),
            'seek_controller:seek.learning.friction': False,
        },
    )
    for length in LEARNING_LENGTHS
    for friction in FRICTIONS
}
"""Runs with feedforward of the nominal friction, by length and friction of the drive."""
LEARNED = {
    (length, friction): Case(
        f'{length:g}_um_friction_{friction:g}',
        'seek',
        (FILE, SEEK),
        {**seeks_to(to_and_fro(length, 30)), **drive_changes(friction)},
    )
    for length in LEARNING_LENGTHS
    for friction in FRICTIONS
}
"""The same with learning of the friction, over 30 seeks."""
IN_VIBRATION = _case('shaken', to_and_fro(50.0, 4), VIBRATION, seek_controller__feedforward_dot_method='fxlms')
"""Run in rotational vibration, with feedforward."""
BY_SECTORS = Case(
    'by_servo_sectors', 'seek', (FILE, NSS, NSS_RATE, SERVO), {'deterministic_timer:duration': 0.199999296}
)
"""Run with the servo sensor, and runout, flutter and force noise of the NSS benchmark, at 10.08 kHz."""
DELAYED = _case(
    'delayed',
    to_and_fro(50.0, 2),
    seek_controller__dsp_dot_computation_delay=1,
    seek_controller__dsp_dot_dac_bits=16,
    seek_controller__dsp_dot_dac_range=10.0,
    # PID gains of one_sample_delay.yaml.
    seek_controller__proportional_gain=0.146,
    seek_controller__integral_gain=8.68,
    seek_controller__derivative_gain=8.67e-5,
    seek_controller__derivative_bandwidth=0.0,
)
"""Run with one sample of computation delay, and PID gains tuned for it."""
_FAST = 3.7879e-5
FAST = _case(
    'at_26_4_khz',
    to_and_fro(50.0, 2),
    deterministic_timer__sample_time=_FAST,
    deterministic_timer__duration=round(2376 * _FAST, 9),
)
"""Run at 26.4 kHz."""
AROUND_NN = Case(
    'around_adaptive_nn',
    'adaptive_nn',
    (FILE, SEEK),
    {**seeks_to(to_and_fro(50.0, 2)), 'adaptive_nn_controller:seek.method': 'final_state'},
)
"""Run with the adaptive NN controller in place of PID."""
