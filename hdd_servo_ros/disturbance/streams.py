"""
Streams of the counter-based noise, so that sources with equal seeds are independent.

The numbers are apart from those of the vibrometer, whose seed may be equal as well.
"""

RUNOUT_PHASES = 16
RUNOUT_SEQUENCE = 17
FORCE_NOISE = 18
ROTATIONAL_VIBRATION = 20
"""The one after it is that of the filter before tick 0."""
LINEAR_VIBRATION = 22
"""The one after it is that of the filter before tick 0."""
FLUTTER = 65536
"""Of the first mode; one more for each further mode."""
