"""The diagram of the graph: its lines match the topic definitions, and it is legible."""

import itertools
import re
import xml.etree.ElementTree as ET

import pytest

from hdd_servo_ros.graph import picture
from hdd_servo_ros.graph.connections import TOPICS
from hdd_servo_ros.messages.topics import ALL_LOOP_TOPICS

SVG = '{http://www.w3.org/2000/svg}'


@pytest.fixture(scope='module')
def drawn():
    return ET.fromstring(picture.drawing())


def attributes(drawn, tag, name):
    return [element for element in drawn.iter(f'{SVG}{tag}') if element.get(name) is not None]


def test_its_lines_are_those_of_the_contract(drawn):
    lines = {
        (line.get('data-topic'), line.get('data-reader'), int(line.get('data-delay')))
        for line in attributes(drawn, 'path', 'data-topic')
    }
    declared = {(topic.name, reader.node, reader.delay) for topic in TOPICS for reader in topic.readers}
    assert lines == declared | {(topic.name, 'bag_recorder', 0) for topic in ALL_LOOP_TOPICS}


def test_each_line_goes_from_its_writer_to_its_reader(drawn):
    boxes = [element for element in drawn.iter(f'{SVG}text') if element.get('font-weight') == 'bold']
    columns = {box.text: int(box.get('x')) for box in boxes}
    for line in attributes(drawn, 'path', 'data-topic'):
        path = re.fullmatch(r'M(\d+) \d+ H(\d+)', line.get('d'))
        assert path is not None
        start, end = map(int, path.groups())
        (topic,) = [topic for topic in TOPICS if topic.name == line.get('data-topic')]
        assert start == columns[topic.writer]
        assert abs(end - columns[line.get('data-reader')]) == 8  # the arrow head


def test_every_topic_has_its_name_and_optional_ones_are_dashed(drawn):
    texts = {text.text for text in drawn.iter(f'{SVG}text')}
    assert {f'/{topic.name}' for topic in TOPICS} <= texts
    for line in attributes(drawn, 'path', 'data-topic'):
        (topic,) = [topic for topic in TOPICS if topic.name == line.get('data-topic')]
        assert (line.get('stroke-dasharray') is not None) == topic.is_optional


def test_nothing_overlaps(drawn):
    width, height = map(int, drawn.get('viewBox').split()[2:])
    boxes = sorted(
        (int(box.get('x')), int(box.get('x')) + int(box.get('width'))) for box in attributes(drawn, 'rect', 'rx')
    )
    assert len(boxes) == len(picture.columns())
    assert all(left[1] < right[0] for left, right in itertools.pairwise(boxes))
    assert boxes[0][0] >= 0
    assert boxes[-1][1] <= width
    assert all(int(text.get('y')) < height for text in drawn.iter(f'{SVG}text'))
