"""The code in README.md and docs/howto/test-with-pytest.md runs as it is printed there, and passes."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytest_plugins = ['pytester']


@pytest.fixture
def python_blocks(pytester):
    """Return the code of a document, and let it find the shipped parameter files."""
    (pytester.path / 'params').symlink_to(ROOT / 'params')

    def blocks(document):
        return re.findall(r'```python\n(.*?)```', (ROOT / document).read_text('utf8'), re.DOTALL)

    return blocks


def test_the_tutorial(pytester, run_pytest, python_blocks):
    blocks = python_blocks('docs/howto/test-with-pytest.md')
    assert len(blocks) == 4
    pytester.makepyfile('\n'.join(blocks))
    run_pytest().assert_outcomes(passed=6)


def test_readme_opens_a_run(pytester, kernel_cache, python_blocks):
    # In processes of their own: pytester takes away what is imported while it is in use.
    parameters = ('--params-file', 'params/seagate_7200_10.yaml', '-p', 'run_dir:=runs/first', '-p', 'plot:=false')
    made = pytester.run(sys.executable, '-m', 'hdd_servo_ros.simulation.simulate', '--ros-args', *parameters)
    assert made.ret == 0
    script, _ = python_blocks('README.md')
    (printed,) = re.findall('this prints `(.+)`', (ROOT / 'README.md').read_text('utf8'))
    assert pytester.runpython_c(script).outlines == [printed]


def test_readme_makes_a_run_in_a_test(pytester, run_pytest, python_blocks):
    _, test = python_blocks('README.md')
    pytester.makepyfile(test)
    run_pytest().assert_outcomes(passed=1)
