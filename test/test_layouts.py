"""Every signal that the layouts for PlotJuggler and Foxglove show is one that the default graph publishes."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.ros.loop_topics import message_class

CONFIG = Path(__file__).parent.parent / 'config'
TOPICS = {f'/{topic.name}': topic for topic in LOOP_TOPICS}
ESTIMATES = AdaptiveNn(AdaptiveNnParameters(), 1e-4).estimate_names


def check_signal(topic, fields):
    """Assert that a message of the topic has a number there."""
    value = message_class(TOPICS[topic].type_name)()
    for field in fields:
        found = re.fullmatch(r'(\w+)(?:\[(\d+)\])?', field)
        assert found is not None
        name, index = found.groups()
        value = getattr(value, name)
        if index is not None:
            assert int(index) < len(ESTIMATES)
            return
    assert isinstance(value, float), (topic, fields)


@pytest.fixture(scope='module')
def plotjuggler():
    return ET.parse(CONFIG / 'plotjuggler.xml').getroot()


def test_plotjuggler_shows_what_there_is(plotjuggler):
    computed = {}
    for snippet in plotjuggler.iter('snippet'):
        further = [element.text for element in snippet.find('additional_sources')]
        computed[snippet.get('name')] = [snippet.find('linked_source').text, *further]
    curves = list(plotjuggler.iter('curve'))
    shown = [curve.get(key) for curve in curves for key in ('name', 'curve_x', 'curve_y') if curve.get(key)]
    pairs = [curve.get('name') for curve in curves if curve.get('curve_x')]
    assert len(shown) > 10
    for name in [source for sources in computed.values() for source in sources] + shown:
        if name not in computed and name not in pairs:
            topic, *fields = name.removeprefix('/').split('/')
            check_signal(f'/{topic}', fields)
    for element in plotjuggler.iter('selected_topics'):
        assert set(element.get('value').split(';')) <= TOPICS.keys()


def test_plotjuggler_can_lay_it_out(plotjuggler):
    tabs = plotjuggler.findall('tabbed_widget/Tab')
    assert int(plotjuggler.find('tabbed_widget/currentTabIndex').get('index')) < len(tabs)
    for tab in tabs:
        assert int(tab.get('containers')) == len(tab.findall('Container'))
    for splitter in plotjuggler.iter('DockSplitter'):
        assert splitter.get('orientation') in ('-', '|')
        assert int(splitter.get('count')) == len(splitter) == len(splitter.get('sizes').split(';'))
    for area in plotjuggler.iter('DockArea'):
        assert area.find('plot').get('mode') in ('TimeSeries', 'XYPlot')


def panels(layout):
    if isinstance(layout, str):
        return [layout]
    assert layout['direction'] in ('row', 'column')
    return panels(layout['first']) + panels(layout['second'])


def test_foxglove_shows_what_there_is():
    layout = json.loads((CONFIG / 'foxglove.json').read_text())
    assert sorted(panels(layout['layout'])) == sorted(layout['configById'])
    for panel in layout['configById'].values():
        for path in [*panel.get('paths', []), *filter(None, [panel.get('xAxisPath')])]:
            topic, *fields = path['value'].split('.')
            check_signal(topic, fields)
