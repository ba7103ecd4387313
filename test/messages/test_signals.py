"""The rows of a topic give access to its fields by name, and to no others."""

import copy
import pickle

import numpy as np
import pytest

from hdd_servo_ros.messages.signals import SignalArray
from hdd_servo_ros.messages.topics import CONTROL, HEAD


@pytest.fixture
def head():
    return SignalArray.of(HEAD, np.arange(12.0).reshape(4, 3))


def test_a_field_is_a_column(head):
    np.testing.assert_array_equal(head.position, head[:, 0])
    np.testing.assert_array_equal(head.friction, head[:, 2])
    assert set(HEAD.field_names) <= set(dir(head))


@pytest.mark.parametrize('rows', [slice(1, 3), [2, 0], np.array([True, False, True, False])])
def test_chosen_ticks_keep_their_fields(head, rows):
    np.testing.assert_array_equal(head[rows].velocity, head.velocity[rows])


@pytest.mark.parametrize('columns', [slice(1, None), [2, 0, 1], [0, 1]])
def test_chosen_columns_have_no_fields(head, columns):
    with pytest.raises(AttributeError):
        _ = head[:, columns].position


def test_what_is_computed_is_a_plain_array(head):
    assert type(head * 2.0) is np.ndarray
    assert type(head.max(axis=0)) is np.ndarray
    assert isinstance(head.max(), float)


def test_an_unknown_field_is_named_with_those_that_there_are():
    with pytest.raises(AttributeError, match=r"no field 'x'; fields: voltage, before_saturation, feedback"):
        _ = SignalArray.of(CONTROL, np.zeros((2, 3))).x


@pytest.mark.parametrize('copied', [copy.deepcopy, lambda array: pickle.loads(pickle.dumps(array))])
def test_a_copy_has_the_fields(head, copied):
    np.testing.assert_array_equal(copied(head).velocity, head.velocity)
