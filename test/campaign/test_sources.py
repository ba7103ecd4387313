"""What the runs of a campaign read beside their parameters is known by its content."""

import importlib
import math

from hdd_servo_ros.campaign.sources import digests

CLASS = {'controller_class': 'own:Law', 'controller_sha256': 'abc'}


def nodes(**parameters):
    return [{'/a': {'offers': {}, 'parameters': parameters}}]


def test_files_that_parameters_name_are_known_by_their_content(tmp_path):
    (tmp_path / 'force.csv').write_text('1.0\n')
    file = str(tmp_path / 'force.csv')
    found = digests(nodes(file=file, text='none', number=3.0, empty=''), [], {})
    assert list(found) == [f'file {file}']
    assert digests(nodes(), [file, 2.0], {}) == found
    (tmp_path / 'force.csv').write_text('1.5\n')
    assert digests(nodes(file=file), [], {})[f'file {file}'] != found[f'file {file}']


def test_a_recorded_run_is_known_by_its_files(tmp_path):
    (tmp_path / 'bag').mkdir()
    for name in ('run.yaml', 'bag/a.mcap'):
        (tmp_path / name).write_text(name)
    assert list(digests(nodes(), [str(tmp_path)], {})) == [f'file {tmp_path}/bag/a.mcap', f'file {tmp_path}/run.yaml']


def test_a_controller_is_known_by_the_digest_of_its_file():
    assert digests([{'/a': {'offers': CLASS, 'parameters': {}}}], [], {}) == {'controller own:Law': 'abc'}


def test_a_metric_is_known_by_the_files_of_its_module_and_its_function(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / 'defines_metric.py').write_text('def one(run):\n    return 1.0\n')
    (tmp_path / 'names_metric.py').write_text('from defines_metric import one\n')
    one = importlib.import_module('names_metric').one
    found = digests([], [], {'names_metric:one': one, 'math:sqrt': math.sqrt})
    names = ['metric names_metric:one, names_metric.py', 'metric names_metric:one, defines_metric.py']
    assert [name for name in found if 'names_metric' in name] == names
