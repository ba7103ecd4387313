"""A specification sets what runs: blocks, draws, controllers and seeds; an error names the entry."""

import re
from pathlib import Path

import pytest
import yaml

from hdd_servo_ros.campaign.planning import Plan
from hdd_servo_ros.campaign.spec import read_spec, spec_of
from hdd_servo_ros.parameters.files import ArgumentError
from hdd_servo_ros.parameters.ros_yaml import read_entries

BASE = 'files: [seagate_7200_10.yaml]\nset: {deterministic_timer:duration: 0.01}\n'


def plan(text):
    entries = read_entries(BASE.encode()) | (read_entries(text.encode()) if text else {})
    return Plan(spec_of(entries, Path.cwd()))


def test_blocks_are_crossed_and_parameters_of_a_block_zipped():
    found = plan("""
controllers: [adaptive_nn, pid]
seeds: [3, 5]
vary:
  - reference_generator:amplitude: [1.0, 2.0]
  - pid_controller:proportional_gain: {linspace: [1e-3, 3.0e-3, 3]}
    pid_controller:derivative_gain: {values: [1, 2, 3]}
""")
    runs = list(found)
    assert len(found) == len(runs) == 2 * 3 * 2 * 2
    assert [run.number for run in runs] == list(range(24))
    assert [(run.controller, run.seed) for run in runs[:4]] == [
        ('adaptive_nn', 3),
        ('adaptive_nn', 5),
        ('pid', 3),
        ('pid', 5),
    ]
    assert [tuple(run.varied.values()) for run in runs[::4]] == [
        (amplitude, gain, derivative)
        for amplitude in (1.0, 2.0)
        for gain, derivative in ((0.001, 1), (0.002, 2), (0.003, 3))
    ]
    for run in runs:
        assert found[run.number] == run


def test_factors_multiply_the_base_value_of_each_controller():
    found = plan("""
controllers: [pid, {name: double, controller: pid, set: {vcm_plant:gain: 2.0e7}}]
vary:
  - {vcm_plant:gain: {values: [0.5, 2], times_base: true}}
  - {vcm_plant:resonance.numerators: {values: [2], times_base: true}}
""")
    base = found[0].varied['vcm_plant:gain']
    assert [run.varied['vcm_plant:gain'] for run in found] == [base, 1e7, 4 * base, 4e7]
    assert found[0].varied['vcm_plant:resonance.numerators'] == 2.0
    assert isinstance(found[0].settings['vcm_plant:resonance.numerators'], tuple)


def test_a_seed_sets_sensors_and_disturbances_not_the_reference():
    found = plan('seeds: 2\nset: {deterministic_timer:duration: 0.01, disturbance_generator:force_noise.seed: 7}\n')
    assert [run.seed for run in found] == [1, 2]
    names = found[0].seeds
    assert 'ldv_sensor:seed' in names
    assert not [name for name in names if name.startswith('reference_generator')]
    assert found[1].settings['ldv_sensor:seed'] == 2


def test_drawn_points_are_the_same_for_all_controllers():
    found = plan("""
controllers: [adaptive_nn, pid]
vary: [{runs: 5, plan: sobol, seed: 2, draw: {vcm_plant:gain: {uniform: [0.9, 1.1], times_base: true}}}]
""")
    drawn = [run.varied['vcm_plant:gain'] for run in found]
    assert drawn[::2] == drawn[1::2]
    assert len(set(drawn)) == 5


def test_elements_of_a_list_vary_by_themselves_and_together():
    """The others keep the values of the files; the table has the elements, and the run the whole list."""
    key = 'vcm_plant:resonance.numerators'
    found = plan(f"""
files: [seagate_7200_10.yaml]
vary:
  - {{'{key}[1]': {{values: [0.5, 2.0], times_base: true}}, '{key}[11]': [1700000000, 8.0e+9]}}
  - {{runs: 3, draw: {{'{key}[2]': {{uniform: [0.8, 1.2], times_base: true}}}}}}
""")
    assert len(found) == 6
    (base,) = (found[0].base.parameters_of('vcm_plant')['resonance.numerators'],)
    drawn = found[4].varied[f'{key}[2]']
    assert 0.8 * base[2] < drawn < 1.2 * base[2]
    assert found[4].varied == {f'{key}[1]': 2.0 * base[1], f'{key}[11]': 8.0e9, f'{key}[2]': drawn}
    assert found[4].settings == {key: (base[0], 2.0 * base[1], drawn, *base[3:11], 8.0e9)}
    # A list holds numbers of one type.
    assert {type(value) for value in found[0].settings[key]} == {float}
    assert found[4].arguments().parameters_of('vcm_plant')['resonance.numerators'] == found[4].settings[key]


def test_modes_are_scaled_as_one_number():
    key = 'vcm_plant:resonance.frequencies'
    found = plan(f"""
files: [seagate_7200_10.yaml, sixteen_modes.yaml]
vary: {{{key}: {{values: [0.9, 1.1], times_base: true}}}}
""")
    base = found[0].base.parameters_of('vcm_plant')['resonance.frequencies']
    assert [run.varied for run in found] == [{key: 0.9}, {key: 1.1}]
    for run, factor in zip(found, (0.9, 1.1), strict=True):
        assert run.settings[key] == pytest.approx([factor * value for value in base], rel=1e-12)


def test_an_element_of_a_controllers_list_leaves_the_others_alone():
    key = 'adaptive_nn_controller:network.gain'
    found = plan(f"controllers: [pid, adaptive_nn]\nvary: {{'{key}[0]': [1.0e-6]}}")
    assert [run.settings for run in found] == [{}, {key: (1e-6,)}]


def test_files_are_relative_to_the_specification(tmp_path):
    (tmp_path / 'own.yaml').write_text('vcm_plant:\n  ros__parameters:\n    gain: 5.0e7\n')
    (tmp_path / 'spec.yaml').write_text(
        'files: [seagate_7200_10.yaml, own.yaml]\nvary: {vcm_plant:gain: {values: [1], times_base: true}}\n'
    )
    spec = read_spec(tmp_path / 'spec.yaml')
    assert spec.name == 'spec'
    assert Plan(spec)[0].varied == {'vcm_plant:gain': 5e7}


def test_a_plan_is_a_sequence():
    found = plan('controllers: [pid]\nvary: [{vcm_plant:gain: [1.0, 2.0, 3.0]}]')
    assert found[-1] == found[2]
    assert found[1:] == [found[1], found[2]]
    assert repr(found) == 'Plan(3 runs, 3 points x 1 controllers x 1 seeds, varied: vcm_plant:gain)'
    with pytest.raises(IndexError, match='run -4 does not exist; expected 0 to 2'):
        found[-4]


def test_a_time_of_runs_that_differ_in_their_duration_is_not_judged_beforehand():
    assert len(plan('after: 0.5\nvary: [{deterministic_timer:duration: [0.1, 1.0]}]')) == 2


def test_values_of_a_file_are_read_as_those_of_a_parameter_file(tmp_path):
    (tmp_path / 'spec.yaml').write_text(
        "files: [seagate_7200_10.yaml]\nset: {deterministic_timer:duration: 1e-2, vcm_plant:frame_id: 'on'}\n"
        "vary: [{vcm_plant:gain: [1e7, 2.5e+7]}, {vcm_plant:frame_id: ['1', 'off']}]\n"
    )
    spec = read_spec(tmp_path / 'spec.yaml')
    assert spec.values == {'deterministic_timer:duration': 0.01, 'vcm_plant:frame_id': 'on'}
    varied = [tuple(run.varied.values()) for run in Plan(spec)]
    assert varied == [(1e7, '1'), (1e7, 'off'), (2.5e7, '1'), (2.5e7, 'off')]


def test_integers_and_floats_may_be_mixed():
    assert [run.varied['vcm_plant:gain'] for run in plan('vary: [{vcm_plant:gain: [1, 2.5]}]')] == [1, 2.5]


def test_a_million_runs_are_planned_one_by_one():
    found = plan('seeds: 1000\nvary: [{vcm_plant:gain: {linspace: [1, 2, 1000]}}]')
    assert len(found) == 10**6
    assert found[-1].settings['ldv_sensor:seed'] == 1000
    assert len(found.digest) == 32


def test_without_vary_there_is_one_run():
    assert [run.varied for run in plan('')] == [{}]


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('seed: 3', "top level: unknown entry 'seed'; expected name, files"),
        ('vary: 3', 'vary: 3 is not a list of blocks'),
        ('vary: [{gain: [1.0]}]', "vary: 'gain' is not NODE:PARAMETER"),
        (
            'vary: [{vcm_plant:gian: [1.0]}]',
            'unknown parameter; did you mean vcm_plant:gain?',
        ),
        ('vary: [{vcm_plan:gain: [1.0]}]', 'vary: vcm_plan:gain: unknown node; did you mean vcm_plant?'),
        ('vary: [{vcm_plant:gain: [1.0], ldv_sensor:seed: [1, 2]}]', 'vcm_plant:gain has 1, ldv_sensor:seed has 2'),
        ('vary: [{vcm_plant:gain: [1.0]}, {vcm_plant:gain: [1.0]}]', 'vcm_plant:gain is in two blocks'),
        ('vary: [{vcm_plant:gain: {linspace: [1.0, 2.0]}}]', 'expected [first, last, count]'),
        ('vary: [{vcm_plant:gain: {steps: [1.0, 2.0]}}]', "unknown entry 'steps'; expected linspace, logspace"),
        ('vary: [{runs: 0, draw: {}}]', 'vary: runs: 0 is not an integer at least 1'),
        (
            'vary: [{runs: 2, plan: grid, draw: {vcm_plant:gain: {uniform: [1, 2]}}}]',
            "unknown plan 'grid'",
        ),
        (
            'vary: [{runs: 2, draw: {vcm_plant:gain: {uniform: [2, 1]}}}]',
            'vcm_plant:gain: uniform: [2, 1] is invalid',
        ),
        (
            'vary: [{vcm_plant:friction.model: {values: [2], times_base: true}}]',
            "base value 'lugre' is not a number",
        ),
        (
            "vary: [{'vcm_plant:gain[0]': [1.0]}]",
            'vary: vcm_plant:gain[0]: vcm_plant:gain is not a list, its base value is',
        ),
        (
            "files: [sixteen_modes.yaml]\nvary: [{'vcm_plant:resonance.frequencies[16]': [1.0]}]",
            'resonance.frequencies has no element 16; valid indices are 0 to 15',
        ),
        (
            "vary: [{'vcm_plant:friction.node_weights[0]': [1.0]}]",
            'friction.node_weights has no element 0; the list is empty',
        ),
        (
            "vary: [{'vcm_plant:resonance.frequencies[-1]': [1.0]}]",
            "'-1' is not the index of an element; the first is 0",
        ),
        (
            "vary: [{'vcm_plant:resonance.frequency[0]': [1.0]}]",
            'unknown parameter; did you mean vcm_plant:resonance.frequencies?',
        ),
        (
            "vary: [{'vcm_plant:resonance.numerators[0]': [1.0]}, {'vcm_plant:resonance.numerators': [[1.0]]}]",
            'vcm_plant:resonance.numerators and vcm_plant:resonance.numerators[0] are both given',
        ),
        (
            'controllers: [adaptive_nn, pid]\n'
            "vary: [{'adaptive_nn_controller:network.gain[0]': {values: [2.0], times_base: true}}]",
            'times_base is invalid: a controller of the campaign lacks this parameter',
        ),
        ('controllers: [pid, pid]', "controllers: duplicate name 'pid'"),
        ('controllers: [{name: a b, controller: pid}, {name: a_b, controller: pid}]', "duplicate name 'a_b'"),
        ('controllers: [{name: x}]', 'lacks the entry controller'),
        ('seeds: 0', 'seeds: 0 is not an integer at least 1'),
        ('seeds: [1, 1]', 'has a duplicate seed'),
        ('keep: some', "keep: 'some' is invalid; expected none, failed, all or {worst: COUNT, of: METRIC}"),
        ('keep: {worst: 0}', 'keep: worst: 0 is not an integer at least 1'),
        ('files: [nowhere.yaml]', "unknown parameter file 'nowhere.yaml'"),
        ('name: a/b', "name: 'a/b' is not a valid directory name"),
        ('after: -1', 'after: -1 is not at least 0'),
        ('metrics: []', 'metrics: [] is not a list of at least one element'),
        ('after: .inf', 'after: inf is not a finite number'),
        ('after: 0.5', 'after: 0.5 s is invalid: the runs of adaptive_nn end at 0.01 s'),
        ('vary: {}', 'vary: empty block'),
        ('vary: [{vcm_plant:gain: [1.0]}, {}]', 'vary: empty block'),
        ('vary: [{vcm_plant:gain: [50.0, fast]}]', "vcm_plant:gain: [50.0, 'fast'] has a number and a string"),
        ('vary: [{vcm_plant:gain: [50.0, true]}]', 'vcm_plant:gain: [50.0, True] has a number and true or false'),
        (
            'vary: [{vcm_plant:gain: [50.0, [1.0, 2.0]]}]',
            'vcm_plant:gain: [50.0, (1.0, 2.0)] has a number and a list',
        ),
        ('seeds: [99999999999999999999]', 'seeds: 1e+20 is not an integer at least 0'),
        ('seeds: 2147483648', 'seeds: 2147483648 is not an integer at most 1000000'),
        (
            'vary: [{vcm_plant:gain: {linspace: [1, 2, 1000000000]}}]',
            '1000000000 values are too many: a campaign has',
        ),
        ('vary: [{runs: 1000001, draw: {vcm_plant:gain: {uniform: [1, 2]}}}]', 'runs: 1000001 is not an integer at'),
        (
            'vary: [{vcm_plant:gain: {linspace: [1, 2, 3000]}}, {vcm_plant:track_pitch: {linspace: [1, 2, 3000]}}]',
            '9000000 points x 1 controllers x 1 seeds are 9000000 runs; a campaign has at most 1000000',
        ),
        ('vary: [{rig:controller: [pid]}]', 'vary: rig:controller cannot vary; put it in `set` of an entry of'),
        ('controllers: [{name: 3, controller: pid}]', 'controllers: name: 3 is not a string'),
        ('metrics: [rms_error]\nkeep: {worst: 1, of: max_error}', "keep: of: 'max_error' is not among the metrics of"),
        ('keep: {worst: 1, of: 3}', 'keep: of: 3 is not the name of a metric'),
        (
            'controllers: [{name: a, controller: pid, set: {gain: 1.0}}]',
            "controllers: a: set: 'gain' is not NODE:PARAMETER",
        ),
    ],
)
def test_a_wrong_entry_is_named(text, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        plan(text)


@pytest.mark.parametrize(
    ('entries', 'message'),
    [
        (
            {'vary': [{'vcm_plant:gain': [10**20]}]},
            'gain: 100000000000000000000 is invalid; expected an integer of 64 bits',
        ),
        ({'seeds': [10**20]}, '100000000000000000000 is not an integer at most 9223372036854775807'),
        ({'controllers': [{'name': None, 'controller': 'pid'}]}, 'controllers: name: None is not a string'),
        ({'vary': [{'vcm_plant:gain': [None]}]}, 'vcm_plant:gain: None is not the value of a parameter'),
    ],
)
def test_an_entry_from_python_is_named(entries, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        spec_of(entries, Path.cwd())


@pytest.mark.parametrize('text', ['[1, 2]', 'a: [', ''])
def test_what_is_no_specification_is_rejected(tmp_path, text):
    (tmp_path / 'spec.yaml').write_text(text)
    with pytest.raises(ArgumentError, match=r'specification .*spec\.yaml is invalid'):
        read_spec(tmp_path / 'spec.yaml')


def test_the_specifications_of_the_documents_are_allowed():
    root = Path(__file__).parents[2]
    page = (root / 'docs' / 'howto' / 'run-campaigns.md').read_text('utf8')
    first, elements = (yaml.safe_load(block) for block in re.findall(r'```yaml\n(.*?)```', page, re.DOTALL))
    assert len(Plan(spec_of(first, root))) == 2 * 200 * 2 * 5
    with pytest.raises(ArgumentError, match='vary the list or its elements, not both'):
        spec_of({'vary': [*elements['vary'], {'vcm_plant:resonance.frequencies': [[1.0]]}]}, root)
    assert len(Plan(spec_of(elements, root))) == 50 * 3
    assert len(Plan(read_spec(root / 'examples' / 'random_drives.yaml'))) == 600
