"""An experiment that does not run fails the test and says why."""

from pathlib import Path
from typing import Any

import pytest

from hdd_servo_ros.testing.experiment import ExperimentFailed, make_run

DEFAULT = Path(__file__).parents[2] / 'params' / 'seagate_7200_10.yaml'


@pytest.mark.parametrize(
    ('files', 'options', 'words'),
    [
        (['nowhere.yaml'], {}, r'exit code 2; its output:\nsimulate: parameter file nowhere\.yaml'),
        ([DEFAULT], {'overrides': {'amplitud': 1.0}}, r'unknown parameter .*; did you mean amplitude\?'),
        ([DEFAULT], {'overrides': {'reference_generator': {'amplitude': 'wide'}}}, 'reference_generator:amplitude'),
        ([DEFAULT], {'timeout': 0.01}, r'simulate .* took more than 0\.01 s'),
    ],
)
def test_why_it_did_not_run(tmp_path, files, options, words):
    with pytest.raises(ExperimentFailed, match=words):
        make_run(files, tmp_path / 'run', without_ros=True, **options)


def test_a_run_that_fails_is_returned_where_that_is_wanted(tmp_path):
    # The first derivative of this sine is beyond every number.
    options: dict[str, Any] = {'without_ros': True, 'overrides': {'duration': 0.1, 'amplitude': 1e308}}
    with pytest.raises(ExperimentFailed, match='not finite'):
        make_run([DEFAULT], tmp_path / 'a', **options)
    run = make_run([DEFAULT], tmp_path / 'b', may_fail=True, **options)
    with pytest.raises(AssertionError, match='run failed: /reference: not finite at tick 0: '):
        run.check.finished()
