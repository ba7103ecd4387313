"""Ticks and their stamps: time is an integer multiple of the sample time, independent of wall clocks."""

import struct

NANOSECONDS = 1_000_000_000
HALF_MICROSECOND = 0.5e-6
"""Tolerance that includes a tick at exactly the requested time, despite rounding [s]."""
_STAMP = struct.Struct('<iI')
_SECONDS = struct.Struct('<d')


def sample_time_to_nanoseconds(sample_time: float) -> int:
    """
    Return a sample time [s] as an integer number of nanoseconds.

    Raises
    ------
    ValueError
        If it is not a positive integer number of nanoseconds: k*T would not be exact on `/clock`.
    """
    nanoseconds = round(sample_time * NANOSECONDS)
    if nanoseconds <= 0 or abs(sample_time * NANOSECONDS - nanoseconds) > 1e-3:
        raise ValueError(f'sample_time: {sample_time!r} s; expected a positive integer number of nanoseconds')
    return nanoseconds


class _Stamps(dict[int, bytes]):
    """Cache of stamp bytes by tick: all nodes of a process request the same few."""

    def __init__(self, sample_time_ns: int) -> None:
        super().__init__()
        self._sample_time_ns = sample_time_ns

    def __missing__(self, tick: int) -> bytes:
        if len(self) > 64:
            self.clear()
        stamp = self[tick] = _STAMP.pack(*divmod(tick * self._sample_time_ns, NANOSECONDS))
        return stamp


class Ticks:
    """Time line of a run: tick k is at time k*T in integer nanoseconds."""

    def __init__(self, sample_time: float) -> None:
        self.sample_time = sample_time
        self.sample_time_ns = sample_time_to_nanoseconds(sample_time)
        self.stamps = _Stamps(self.sample_time_ns)
        """Stamps by tick, as from :meth:`stamp`, but with faster access for the nodes at every tick."""

    def nanoseconds(self, tick: int) -> int:
        """Return the time of ``tick`` [ns]."""
        return tick * self.sample_time_ns

    def stamp(self, tick: int) -> bytes:
        """Return the eight bytes of ``builtin_interfaces/Time`` for ``tick`` in little-endian CDR."""
        return self.stamps[tick]

    def tick_of(self, stamp: bytes) -> float:
        """Return the tick of eight stamp bytes; not an integer for a stamp between ticks."""
        seconds, nanoseconds = _STAMP.unpack(stamp)
        time: int = seconds * NANOSECONDS + nanoseconds
        return time // self.sample_time_ns if time % self.sample_time_ns == 0 else time / self.sample_time_ns

    def seconds_bytes(self, tick: int) -> bytes:
        """Return k*T [s] as the eight bytes of a float64, the time in a message without a header."""
        return _SECONDS.pack(float(tick) * self.sample_time)

    def tick_of_seconds(self, seconds: bytes) -> float:
        """Return the tick of :meth:`seconds_bytes`; not an integer for a time between ticks."""
        (time,) = _SECONDS.unpack(seconds)
        nearest = round(time / self.sample_time) if abs(time) < 1e300 else 0
        return nearest if float(nearest) * self.sample_time == time else time / self.sample_time
