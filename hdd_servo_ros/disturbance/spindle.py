"""The spindle: its angle at every tick, and whether a revolution has a whole number of samples."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

TOLERANCE = 1e-5
"""By how much T may differ from the time between two sectors, relative to it."""
_ROUNDING = 0.501e-9
"""Half a nanosecond [s], and a little for the last bits: T is a whole number of nanoseconds."""


@dataclasses.dataclass(frozen=True)
class SpindleParameters(ParameterSet):
    """The spindle's speed, and the servo sectors of a revolution."""

    revolutions_per_minute: float = parameter(
        7200.0, 'speed of the spindle', unit='1/min', above=0.0, maximum=1e6, read_only=True
    )
    sectors: int = parameter(
        0,
        'servo sectors of a revolution, which is then exactly so many samples if T is 60/(revolutions_per_minute '
        'sectors), rounded to whole nanoseconds; 0 for none',
        minimum=0,
        maximum=1_000_000,
        read_only=True,
    )

    def turns_per_sample(self, sample_time: float) -> float:
        """Return by how much the spindle turns during T [s], in turns."""
        return self.revolutions_per_minute * sample_time / 60.0

    def samples_per_revolution(self, sample_time: float) -> int:
        """Return how many samples of T [s] a revolution has, 0 if it has no whole number by the sectors."""
        if not self.sectors:
            return 0
        between = 60.0 / (self.revolutions_per_minute * self.sectors)
        difference = abs(between - sample_time)
        return self.sectors if difference <= max(TOLERANCE * sample_time, _ROUNDING) else 0

    def require_synchronous(self, sample_time: float, what: str) -> int:
        """
        Return how many samples a revolution has, for something that needs a whole number.

        Parameters
        ----------
        sample_time
            T [s].
        what
            The parameter that needs it, with its value.

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
                f'{what} needs a whole number of samples per revolution, such as sectors = {sectors} with '
                f'sample_time = {needed!r} s at {self.revolutions_per_minute:g} 1/min; sample_time is {sample_time!r} s'
            )
            raise ParameterError('spindle.sectors', self.sectors, allowed)
        return samples
