"""The points of crossed blocks are those of the product, made one by one."""

import itertools

import pytest

from hdd_servo_ros.campaign.points import Block, Column, Points, Varied


def block(name, count, times_base=False):
    return Block({f'{name}:x': Column(range(count), times_base), f'{name}:y': Column([-x for x in range(count)])})


def test_blocks_are_crossed_the_last_one_fastest():
    points = Points([block('a', 3), block('b', 2, times_base=True)])
    expected = [
        {'a:x': Varied(a), 'a:y': Varied(-a), 'b:x': Varied(b, True), 'b:y': Varied(-b)}
        for a, b in itertools.product(range(3), range(2))
    ]
    assert len(points) == 6
    assert list(points) == expected
    assert [points[index] for index in range(6)] == expected
    assert [points[index] for index in range(-6, 0)] == expected
    assert points[1:5:2] == expected[1:5:2]
    with pytest.raises(IndexError):
        points[6]


def test_without_blocks_there_is_one_empty_point():
    assert list(Points([])) == [{}]


def test_points_are_made_when_they_are_asked_for():
    points = Points([block(name, 10**6) for name in 'abc'])
    assert len(points) == 10**18
    assert points[-1]['b:x'] == Varied(10**6 - 1)
    assert next(iter(points))['c:x'] == Varied(0)
