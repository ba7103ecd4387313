"""A signal cut into pieces at random offsets, some of which may be empty."""

import numpy as np
from hypothesis import strategies as st


@st.composite
def signals_in_pieces(draw, least=1, most=400):
    """Return a signal of some samples, and the offsets at which it is cut."""
    count = draw(st.integers(least, most))
    seed = draw(st.integers(0, 2**32 - 1))
    offset = draw(st.sampled_from([0.0, 1.0, -1e3]))
    values = np.random.default_rng(seed).normal(size=count) + offset
    cuts = sorted(draw(st.lists(st.integers(0, count), max_size=6)))
    return values, cuts


def pieces(values, cuts):
    """Return a signal in pieces."""
    return np.split(values, cuts)
