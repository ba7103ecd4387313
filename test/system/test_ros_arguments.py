"""One command line means the same to `rig`, which ROS reads it for, and to `simulate`, which reads it alone."""

import pytest
import yaml

from hdd_servo_ros.recording.compare_bags import first_difference

SHORT = ('-p', 'duration:=0.002')
SECTION = '  ros__parameters:\n'

MEANT = {
    'absolute': ['-r', '/reference:=/ref2'],
    'in a namespace': ['-r', '__ns:=/a', '-r', '/a/reference:=z', '-r', '/head:=/never'],
    'of a topic alone': ['-r', 'rostopic://reference:=c', '-r', 'rosservice://head:=never'],
    'of one node and of all': ['-r', 'nobody:head:=never', '-r', 'reference:=c'],
    'repeated': ['-r', 'reference:=a', '-r', 'reference:=b'],
    'repeated namespace': ['-r', '__ns:=/a', '-r', '__ns:=/b'],
    'node': ['-r', 'ldv_sensor:__node:=foo', '-p', 'foo:seed:=3'],
    'number without a digit before the point': ['-p', 'frequency:=.12e3'],
    'octal': ['-p', 'ldv_sensor:seed:=010'],
    'order': ['-p', 'seed:=1', '-p', 'ldv_sensor:seed:=2', '-p', 'seed:=3'],
}

REJECTED = {
    'configuration of logs': (['--log-config-file', '/nonexistent'], '/nonexistent'),
    'quality of service': (
        ['-p', 'qos_overrides./clock.publisher.depth:=5'],
        'the quality of service of the topics is fixed, since a run must not lose messages',
    ),
    'of one node': (['-r', 'reference_generator:reference:=ref2'], 'all nodes must use the same name'),
    'empty': (['-r', 'reference:='], "-r 'reference:=' is not"),
    'two topics': (['-r', 'reference:=head'], 'the same name /head'),
    'namespace of one node': (['-r', 'ldv_sensor:__ns:=/b'], 'all nodes must use the same name'),
    'namespace with a slash': (['-r', '__ns:=/b1/'], "-r '__ns:=/b1/' is not"),
    'name for all': (['-r', '__node:=x'], 'would both be /x'),
    'two nodes of one name': (['-r', 'ldv_sensor:__node:=vcm_plant'], 'would both be /vcm_plant'),
    'number with an underscore': (['-p', 'frequency:=1_000.0'], "frequency: '1_000.0';"),
    'date': (['-p', 'frequency:=2001-99-99'], "frequency: '2001-99-99';"),
    'binary': (['-p', 'ldv_sensor:seed:=0b_'], "seed: '0b_';"),
    'digits': (['-p', 'ldv_sensor:seed:=' + '9' * 400], 'seed: '),
    'mixed list': (['-p', 'phase:=[1, 2.0]'], 'write 2.0 for 2'),
    'alias': (['-p', 'phase:=*a'], 'ROS does not support the alias *a'),
    'a standard parameter of another type': (['-p', 'use_sim_time:=5'], 'use_sim_time: 5; expected true or false'),
    'a name before it was changed': (['-r', 'ldv_sensor:__node:=foo', '-p', 'ldv_sensor:seed:=3'], "for '/ldv_sensor'"),
}

FILES: dict[str, tuple[str | bytes, str]] = {
    'empty section': (f'reference_generator:\n{SECTION}', "line 2: 'ros__parameters' is empty"),
    'list': ('reference_generator:\n  ros__parameters: [1, 2]\n', 'line 2:'),
    'wildcard in a name': (f'/ref*:\n{SECTION}    frequency: 1.0\n', "'/ref*' is not a node name"),
    'anchor': (
        f'reference_generator:\n{SECTION}    phase: &a 1.0\n    offset: *a\n',
        'line 4: offset: ROS does not support the alias *a',
    ),
    'latin-1': (f'# fréquence\nreference_generator:\n{SECTION}    frequency: 1.0\n'.encode('latin-1'), 'UTF-8'),
    'quality of service': (
        f'ldv_sensor:\n{SECTION}    qos_overrides: {{/ldv: {{publisher: {{depth: 3}}}}}}\n',
        'the quality of service of the topics is fixed',
    ),
    'date': (f'reference_generator:\n{SECTION}    frequency: 2001-99-99\n', ' [Hz]; given in file.yaml, line 3'),
    'quoted number': (f'ldv_sensor:\n{SECTION}    noise: true\n    seed: "7"\n', '; given in file.yaml, line 4'),
    'null': (f'/**:\n{SECTION}    frequency: null\n', '; given in file.yaml, line 3'),
    'misspelt': (
        f'ldv_sensor:\n{SECTION}    sed: 7\n',
        'unknown parameter ldv_sensor:sed (given in file.yaml, line 3); did you mean seed?',
    ),
    'misspelt for all': (
        f'/**:\n{SECTION}    sample_tme: 1.0\n',
        'sample_tme (given in file.yaml, line 3); did you mean sample_time?',
    ),
    'blocks': (f'vcm_plant:\n{SECTION}    gain: -1.0\n', '; given in file.yaml, line 3'),
    'deep': (f'reference_generator:\n{SECTION}    phase: {"[" * 2000}\n', 'line 3: phase: a list contains a list'),
}


def meaning_of(run):
    """Return what a run's arguments came to: its topics, and the parameters of its nodes by their names."""
    said = yaml.safe_load((run / 'run.yaml').read_text())
    parameters = {name: node['parameters'] for name, node in said['nodes'].items()}
    for node in parameters.values():
        for name in ('run_dir', 'start_timeout', 'peer_timeout'):
            node.pop(name, None)
    return said['topics'], parameters


@pytest.mark.parametrize('name', MEANT)
def test_both_take_it_for_the_same(bench, name):
    for program in ('rig', 'simulate'):
        bench.run(program, *SHORT, '-p', f'run_dir:={program}', *MEANT[name])
    rig, simulated = bench.directory / 'rig', bench.directory / 'simulate'
    assert meaning_of(rig) == meaning_of(simulated)
    assert first_difference(rig, simulated) is None


@pytest.mark.parametrize('name', REJECTED)
def test_both_reject_it_in_the_same_words(bench, name):
    arguments, words = REJECTED[name]
    rejected(bench, arguments, words)


@pytest.mark.parametrize('name', FILES)
def test_both_reject_a_file_in_the_same_words(bench, name):
    text, words = FILES[name]
    (bench.directory / 'file.yaml').write_bytes(text if isinstance(text, bytes) else text.encode())
    rejected(bench, ['--params-file', 'file.yaml'], words)


def test_a_section_that_may_have_been_meant_for_a_node(bench):
    names = {'pid': 'pid_controller', '/ldv': 'ldv_sensor', 'reference_genrator': 'reference_generator'}
    text = ''.join(f'{name}:\n{SECTION}    seed: 3\n' for name in (*names, 'ekf_filter_node', '/camera/driver'))
    (bench.directory / 'file.yaml').write_text(text)
    for program in ('rig', 'simulate'):
        process = bench.run(program, *SHORT, '-p', 'record:=false', '--params-file', 'file.yaml')
        said = [line for line in process.output.splitlines() if 'did you mean' in line]
        assert said == [
            f'{program}: warning: no node takes the parameters of {name}; did you mean {node}?'
            for name, node in names.items()
        ]


def rejected(bench, arguments, words):
    said = {}
    for program in ('rig', 'simulate'):
        process = bench.start(program, *SHORT, '-p', 'record:=false', *arguments)
        assert process.wait() == 2, process.output
        assert 'Traceback' not in process.output
        said[program] = process.output.removeprefix(f'{program}: ')
    assert said['rig'].replace('rig is several', 'simulate is several') == said['simulate']
    assert words in said['rig']
    assert len(said['rig'].splitlines()) == 1


def test_a_run_with_a_renamed_node_is_replayed_with_it(bench):
    bench.run('rig', *SHORT, '-p', 'run_dir:=run', *MEANT['node'])
    for option in ([], ['--without-ros']):
        ended = bench.python('-m', 'hdd_servo_ros.tools.replay', 'run', *option)
        assert ended.returncode == 0, ended.stdout + ended.stderr


def test_a_node_that_a_replay_cannot_run_is_named(bench):
    bench.run('simulate', *SHORT, '-p', 'run_dir:=run')
    path = bench.directory / 'run' / 'run.yaml'
    said = yaml.safe_load(path.read_text())
    said['nodes']['/foo'] = {**said['nodes'].pop('/ldv_sensor')}
    said['nodes']['/foo']['parameters']['gain_of_tomorrow'] = 1.0
    path.write_text(yaml.safe_dump(said))
    ended = bench.python('-m', 'hdd_servo_ros.tools.replay', 'run', '--without-ros')
    assert ended.returncode != 0
    assert '/foo' in ended.stderr
    assert 'different' not in ended.stdout
