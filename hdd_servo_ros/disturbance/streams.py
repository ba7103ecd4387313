"""
Streams of the counter-based noise, which make sources with equal seeds independent.

The numbers differ from those of the vibrometer, which may have the same seed.
"""

RUNOUT_PHASES = 16
RUNOUT_SEQUENCE = 17
FORCE_NOISE = 18
ROTATIONAL_VIBRATION = 20
"""The next stream is for the run-in of the filter before tick 0."""
LINEAR_VIBRATION = 22
"""The next stream is for the run-in of the filter before tick 0."""
FLUTTER = 65536
"""Stream of the first mode; each further mode uses the next stream."""
