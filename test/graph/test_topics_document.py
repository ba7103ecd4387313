"""`docs/reference/topics.md` against expected rows written out here."""

import re

import pytest

from hdd_servo_ros.graph import topics_document
from hdd_servo_ros.graph.catalog import CONTROLLERS, NODES, resolve
from hdd_servo_ros.graph.connections import TOPICS


@pytest.fixture(scope='module')
def text():
    return topics_document.document()


def section(text, name):
    (found,) = [part for part in text.split('\n## ') if part.startswith(f'{name}\n')]
    return found


@pytest.mark.parametrize('topic', TOPICS, ids=lambda topic: topic.name)
def test_every_field_has_its_unit_and_meaning(text, topic):
    rows = re.findall(r'^\| [\w.]+ \| `(\w+)` \| (.+) \| (.+) \| .+ \|$', section(text, topic.name), re.MULTILINE)
    assert rows == [(field.name, field.unit.replace('um', 'µm') or '-', field.meaning) for field in topic.fields]


def test_every_sign_is_that_of_a_field(text):
    fields = {f'{topic.name}.{field.name}' for topic in TOPICS for field in topic.fields}
    assert topics_document._SIGNS.keys() <= fields
    assert all(f' | {sign} |' in text for sign in topics_document._SIGNS.values())


@pytest.mark.parametrize(
    ('topic', 'row'),
    [
        (
            'control',
            '| [/control](#control) | `geometry_msgs/Vector3Stamped` | the controller | `vcm_plant` (delay 1 tick), '
            '`deterministic_timer` (delay 1 + lookahead ticks), `accelerometer` (delay 1 tick), `bag_recorder` | '
            '`header.stamp` | the drive | yes |',
        ),
        (
            'disturbance',
            '| [/disturbance](#disturbance), optional | `geometry_msgs/Vector3Stamped` | a disturbance source | '
            '`vcm_plant` (delay 1 tick), `servo_sensor`, `bag_recorder` | `header.stamp` | the drive | yes |',
        ),
        (
            'base_acceleration',
            '| [/base_acceleration](#base_acceleration), optional | `geometry_msgs/AccelStamped` | a disturbance '
            'source | `accelerometer` (delay 1 tick), `bag_recorder` | `header.stamp` | the drive | yes |',
        ),
        (
            'recorded',
            '| [/recorded](#recorded), optional | `std_msgs/Header` | `bag_recorder` | `deterministic_timer` | `stamp` '
            '| the run | no |',
        ),
    ],
)
def test_publishers_and_subscribers(text, topic, row):
    assert row in text.splitlines(), topic


def test_an_undeclared_component_of_a_vector_is_zero(text):
    assert '| z | - | - | 0 | - |' in section(text, 'ldv')


def test_the_estimates_of_each_controller(text):
    found = section(text, 'estimates')
    assert '| `pid_controller` | `integral` | V | integral part of u |' in found
    assert '| `adaptive_nn_controller` | `integral` | µm s | integral of e |' in found
    for node in CONTROLLERS.values():
        names = re.findall(rf'^\| `{node}` \| `(\w+)` \|', found, re.MULTILINE)
        assert tuple(names) == resolve(NODES[node].block).estimate_names
