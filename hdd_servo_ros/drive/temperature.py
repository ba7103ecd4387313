"""Resonances over temperature: factors on the natural frequencies and the damping ratios of all modes."""

import dataclasses
from dataclasses import dataclass

from hdd_servo_ros.drive.resonance import ResonanceParameters
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter


@dataclass(frozen=True)
class TemperatureParameters(ParameterSet):
    """
    Factors of the resonances at the temperature of the drive; with the defaults, the resonances are as given.

    A cold drive is stiffer and less damped. A benchmark with sixteen modes (PyHDDBenchmark, after T. Atsumi) has
    frequencies of 1.04 and damping ratios of 0.8 at low temperature, and 0.96 and 1.2 at high temperature. A schedule
    that changes the factors in small steps is a slow drift.

    Examples
    --------
    >>> from hdd_servo_ros.drive import PlantParameters, TemperatureParameters
    >>> cold = PlantParameters(temperature=TemperatureParameters(frequency_scale=1.04, damping_scale=0.8))
    >>> [f"{a:.6g}" for a in cold.resonance_at_temperature.denominators[:3]]
    ['1', '1708.1', '1.28061e+09']
    """

    frequency_scale: float = parameter(
        1.0, 'factor on the natural frequency of every resonance, its zeros included', minimum=0.1, maximum=10.0
    )
    damping_scale: float = parameter(
        1.0, 'factor on the damping ratio of every resonance, its zeros included', minimum=0.01, maximum=100.0
    )


def resonance_at(resonance: ResonanceParameters, temperature: TemperatureParameters) -> ResonanceParameters:
    """
    Return the resonances with the factors of a temperature applied.

    A section R(s) becomes R(s/f) with the frequency scale f, and the coefficients of s are multiplied by the damping
    scale as well. Residues do not change, because they are ratios of masses.

    Raises
    ------
    ParameterError
        If a damping ratio becomes too large; names ``temperature.damping_scale``.
    """
    f, z = temperature.frequency_scale, temperature.damping_scale
    if resonance.form == 'none' or (f == 1.0 and z == 1.0):
        return resonance
    powers = (1.0, f * z, f * f)
    try:
        if resonance.form == 'sections':
            return dataclasses.replace(
                resonance,
                numerators=tuple(b * powers[i % 3] for i, b in enumerate(resonance.numerators)),
                denominators=tuple(a * powers[i % 3] for i, a in enumerate(resonance.denominators)),
            )
        return dataclasses.replace(
            resonance,
            frequencies=tuple(f * frequency for frequency in resonance.frequencies),
            damping_ratios=tuple(z * ratio for ratio in resonance.damping_ratios),
        )
    except ParameterError as error:
        raise ParameterError(
            'temperature.damping_scale', z, f'a factor that leaves resonance.{error.name} {error.allowed}'
        ) from None
