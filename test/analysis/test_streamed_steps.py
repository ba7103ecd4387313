"""Edges of a reference that comes in pieces, and the answers to them, against the same from whole arrays."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hdd_servo_ros.analysis.metrics import is_stepwise, step_response
from hdd_servo_ros.analysis.streamed_steps import StreamedEdges, StreamedSteps

from .cut import pieces

T = 1e-4


@st.composite
def stepped(draw):
    """Return a reference of some steps, a head that follows it with noise, and where both are cut."""
    lengths = draw(st.lists(st.integers(1, 60), min_size=1, max_size=8))
    levels = draw(st.lists(st.sampled_from([0.0, 1.0, -1.0, 5.0]), min_size=len(lengths), max_size=len(lengths)))
    reference = np.repeat(levels, lengths)
    rng = np.random.default_rng(draw(st.integers(0, 1000)))
    head = reference + rng.normal(size=len(reference)) * draw(st.sampled_from([0.001, 0.03, 1.0]))
    head[0] = draw(st.sampled_from([reference[0], 0.0]))
    return reference, head, sorted(draw(st.lists(st.integers(0, len(reference)), max_size=5)))


@given(stepped())
def test_the_answers_are_those_of_the_whole(given_run):
    reference, head, cuts = given_run
    edges = StreamedEdges(len(reference))
    for piece in pieces(reference, cuts):
        edges.add(piece)
    assert edges.is_stepwise == is_stepwise(reference)
    try:
        expected = step_response(np.arange(len(reference)) * T, reference, head)
    except ValueError:
        if edges.is_stepwise:
            try:
                StreamedSteps(edges, len(reference), reference[0] - head[0])
            except ValueError:
                return
            raise AssertionError('an edge where there is none') from None
        return
    steps = StreamedSteps(edges, len(reference), reference[0] - head[0])
    for x_d, x in zip(pieces(reference, cuts), pieces(head, cuts), strict=True):
        steps.add(x_d, x)
    found = steps.response(T)
    np.testing.assert_array_equal(found.row, expected.row)
    for name in ('height', 'overshoot', 'settling_time', 'steady_error'):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-12)
