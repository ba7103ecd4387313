"""Effects not covered by theorem 4.1, for diagnostics, certificate and docs/concepts/stability-certificate.md."""

import dataclasses
from collections.abc import Callable

from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.adaptive_nn_parameters import AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.signals.reference import ReferenceParameters


@dataclasses.dataclass(frozen=True)
class Loop:
    """
    Properties of a loop that decide whether the theorem covers it.

    Attributes
    ----------
    controller, plant, dsp
        Parameters of the controller, of the drive, and of the DSP between the law and ``/control``.
    sensor, reference
        Parameters of the vibrometer and the reference; None if another, unknown node replaces it.
    limited_commands
        Number of commands limited so far, by the controller or after it.
    is_disturbed
        Whether a node publishes ``/disturbance``, with a bound unknown to the controller.
    ideal_values_are_allowed
        Whether the projection bounds, if enabled, contain the ideal values.
    """

    controller: AdaptiveNnParameters
    plant: PlantParameters
    dsp: DspParameters
    sensor: LdvParameters | None = None
    reference: ReferenceParameters | None = None
    limited_commands: int = 0
    is_disturbed: bool = False
    ideal_values_are_allowed: bool = True


@dataclasses.dataclass(frozen=True)
class Effect:
    """
    Effect that the theorem does not cover.

    Attributes
    ----------
    name
        Name in the diagnostics and in docs/concepts/stability-certificate.md.
    condition
        The violated condition of the theorem, as named in the certificate.
    statement
        Coverage by the theorem, as in docs/concepts/stability-certificate.md.
    is_in
        Return whether a loop has the effect.
    """

    name: str
    condition: str
    statement: str
    is_in: Callable[[Loop], bool]


def _is_measurement_inexact(loop: Loop) -> bool:
    sensor = loop.sensor
    if sensor is None or loop.controller.velocity_source != 'sensor':
        return True
    lag = sensor.demodulator_delay > 0.0 or sensor.demodulator_bandwidth > 0.0
    return sensor.noise or sensor.adc_bits > 0 or lag or sensor.dropout_rate > 0.0


def _has_steps(loop: Loop) -> bool:
    reference = loop.reference
    if reference is None:
        return True
    starts_late = reference.start_time > 0.0 and reference.waveform != 'constant'
    jumps = reference.waveform == 'seek' and reference.seek.trajectory == 'step'
    return reference.waveform in ('square', 'step', 'ramp') or jumps or starts_late


EFFECTS = (
    Effect(
        'sampling',
        'continuous time',
        'not covered: the laws hold r over a sample, and V may increase if they are fast compared with T',
        lambda loop: True,
    ),
    Effect(
        'resonances',
        'rigid body',
        'not covered: r in the bounds is that of the head, which does not move as the rigid body driven by u',
        lambda loop: loop.plant.resonance.form != 'none',
    ),
    Effect(
        'actuator.driver',
        'force without lag',
        'not covered with `current` and `voltage`: amplifier, coil and back-EMF delay the force',
        lambda loop: loop.plant.actuator.is_electrical,
    ),
    Effect(
        'travel',
        'no crash stops',
        'not covered: an impact is a force unknown to the controller',
        lambda loop: loop.plant.travel.is_limited,
    ),
    Effect(
        'measurement',
        'state measured exactly',
        'not covered: noise, ADC, lag and drop-outs of the vibrometer, and the filter of `velocity_source: difference`'
        '; r in the bounds is that of the true head position',
        _is_measurement_inexact,
    ),
    Effect(
        'boundary_layer',
        'exact sgn',
        'not covered',
        lambda loop: loop.controller.boundary_layer > 0.0,
    ),
    Effect(
        'saturation',
        'no saturation',
        'not covered, by `control_limit` or `dsp.dac_range`, with or without frozen estimates; the limited ticks are '
        'counted',
        lambda loop: loop.limited_commands > 0,
    ),
    Effect(
        'dsp.dac_bits',
        'no quantization of u',
        'not covered; violations are counted nevertheless',
        lambda loop: loop.dsp.dac_bits > 0,
    ),
    Effect(
        'dsp.computation_delay',
        'no computation delay',
        'not covered; violations are counted nevertheless',
        lambda loop: loop.dsp.computation_delay > 0,
    ),
    Effect(
        'dsp.interpolation',
        'u without steps within a sample',
        'not covered; violations are counted nevertheless',
        lambda loop: loop.dsp.is_interpolated,
    ),
    Effect(
        'dsp.filters',
        'no filters after the law',
        'not covered; violations are counted nevertheless',
        lambda loop: loop.dsp.filters.is_used,
    ),
    Effect(
        'r_limit',
        'unlimited r in the laws',
        'covered while abs(r) is below the limit',
        lambda loop: loop.controller.r_limit > 0.0,
    ),
    Effect(
        'reference steps',
        'reference without steps',
        "not covered: r and V jump with x_d and x_d', and again with the second part of a shaped step; e and r are "
        'those of the reference as the law receives it',
        _has_steps,
    ),
    Effect(
        'compensator.lag',
        'compensator without lag',
        "covered only with a lag of 0 and W_c* = 0: W_c'W_c/(2 Gamma_c) is then part of V, and sigma_c Gamma_c one of "
        'the rates. With a lag the terms in W_c do not cancel, and V can exceed its bounds',
        lambda loop: loop.controller.compensator.enabled and loop.controller.compensator.lag > 0.0,
    ),
    Effect(
        'projection',
        'projection bounds contain the ideal values',
        'covered if the ideal values are between `minimum` and `maximum`; W_c* = 0 is within any bound',
        lambda loop: loop.controller.projection and not loop.ideal_values_are_allowed,
    ),
    Effect(
        '/disturbance',
        'known bound on /disturbance',
        'covered by the certificate of a run, with the bound given by `--disturbance`; not during a run',
        lambda loop: loop.is_disturbed,
    ),
)
"""All effects that theorem 4.1 does not cover, or covers only under a condition."""


def not_covered(loop: Loop) -> tuple[str, ...]:
    """Return the names of the effects of a loop that the theorem does not cover."""
    return tuple(effect.name for effect in EFFECTS if effect.is_in(loop))
