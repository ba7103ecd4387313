"""Spindle: rotation per sample, and synchronization of the samples with the revolution."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

TOLERANCE = 1e-5
"""Tolerance of T with respect to the time between two sectors, relative to T."""
_ROUNDING = 0.501e-9
"""Half a nanosecond plus a margin for rounding [s], because T is a whole number of nanoseconds."""


@dataclasses.dataclass(frozen=True)
class SpindleParameters(ParameterSet):
    """Spindle speed, and servo sectors per revolution."""

    revolutions_per_minute: float = parameter(
        7200.0, 'spindle speed', unit='1/min', above=0.0, maximum=1e6, read_only=True
    )
    sectors: int = parameter(
        0,
        'servo sectors per revolution; a revolution takes exactly this number of samples if T is '
        '60/(revolutions_per_minute * sectors), rounded to whole nanoseconds; 0 for no sectors',
        minimum=0,
        maximum=1_000_000,
        read_only=True,
    )

    def turns_per_sample(self, sample_time: float) -> float:
        """Return the rotation of the spindle during the sample time T [s], as a fraction of a revolution."""
        return self.revolutions_per_minute * sample_time / 60.0

    def samples_per_revolution(self, sample_time: float) -> int:
        """Return the number of samples per revolution at T [s]; 0 if T does not match the sectors."""
        if not self.sectors:
            return 0
        between = 60.0 / (self.revolutions_per_minute * self.sectors)
        difference = abs(between - sample_time)
        return self.sectors if difference <= max(TOLERANCE * sample_time, _ROUNDING) else 0

    def require_synchronous(self, sample_time: float, feature: str) -> int:
        """
        Return the number of samples per revolution for a feature that needs a whole number.

        Parameters
        ----------
        sample_time
            T [s].
        feature
            Parameter that needs it, with its value, for the error message.

        Raises
        ------
        ParameterError
            If T and the spindle are not synchronous.
        """
        samples = self.samples_per_revolution(sample_time)
        if not samples:
            sectors = self.sectors or round(60.0 / (self.revolutions_per_minute * sample_time)) or 1
            needed = round(60e9 / (self.revolutions_per_minute * sectors)) / 1e9
            allowed = (
                f'a whole number of samples per revolution, because of {feature}: for example sectors = {sectors} with '
                f'sample_time = {needed!r} s at {self.revolutions_per_minute:g} 1/min; sample_time is {sample_time!r} s'
            )
            raise ParameterError('spindle.sectors', self.sectors, allowed)
        return samples
