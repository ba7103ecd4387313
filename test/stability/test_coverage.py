"""The list of effects that theorem 4.1 does not cover is the same in the code and in the documentation."""

import re
from pathlib import Path

import pytest

from hdd_servo_ros.bench.dsp import DspParameters
from hdd_servo_ros.control.adaptive_nn_parameters import AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.signals.reference import ReferenceParameters
from hdd_servo_ros.stability.coverage import EFFECTS, Loop

DOCS = Path(__file__).parents[2] / 'docs'


def test_the_page_has_the_list_of_the_code():
    page = (DOCS / 'concepts' / 'stability-certificate.md').read_text('utf8')
    section = page.split('\n## What the theorem does not cover\n')[1].split('\n## ')[0]
    table = section.split('| effect | is it covered? |\n|---|---|\n')[1].split('\n\n')[0]
    rows = dict(re.findall(r'^\| `?([^|`]+)`? \| ([^|]+) \|$', table, flags=re.MULTILINE))
    assert rows == {effect.name: effect.statement for effect in EFFECTS}
    assert list(rows) == [effect.name for effect in EFFECTS]


def test_the_page_of_diagnostics_links_to_the_list_and_does_not_repeat_it():
    page = (DOCS / 'howto' / 'monitor.md').read_text('utf8')
    (row,) = [line for line in page.splitlines() if 'controller: certificate`' in line]
    assert '(../concepts/stability-certificate.md' in row
    assert not [effect.name for effect in EFFECTS if effect.name in row]


@pytest.mark.parametrize(('trajectory', 'jumps'), [('step', True), ('minimum_jerk', False), ('time_optimal', False)])
def test_seeks_by_steps_are_not_covered_and_trajectories_are(trajectory, jumps):
    reference = from_mapping(ReferenceParameters, {'waveform': 'seek', 'seek.trajectory': trajectory})
    loop = Loop(AdaptiveNnParameters(), PlantParameters(), DspParameters(), reference=reference)
    (effect,) = (effect for effect in EFFECTS if effect.name == 'reference steps')
    assert effect.is_in(loop) is jumps
