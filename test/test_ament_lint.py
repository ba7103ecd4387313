"""The linters that ROS packages use, where they are installed; `make lint` runs ruff and mypy everywhere."""

import pytest

CHECKED = ('hdd_servo_ros', 'launch')
IGNORED = ('D105', 'D107', 'D102', 'D401', 'D402', 'D405', 'D407', 'D410', 'D411', 'D414')
"""
The first three as for ruff: magic methods, constructors, and methods of nodes that override documented ones. The rest:
pydocstyle takes a parameter called "parameters" for a section, and wants a property to command.
"""


@pytest.fixture(autouse=True)
def _at_the_root(monkeypatch, request):
    monkeypatch.chdir(request.config.rootpath)


def test_flake8():
    linter = pytest.importorskip('ament_flake8.main')
    code, errors = linter.main_with_errors(argv=['--config', 'setup.cfg', *CHECKED, 'test'])
    assert code == 0, '\n'.join(errors)


def test_pep257():
    linter = pytest.importorskip('ament_pep257.main')
    assert linter.main(argv=['--convention', 'numpy', '--add-ignore', *IGNORED, '--', *CHECKED]) == 0
