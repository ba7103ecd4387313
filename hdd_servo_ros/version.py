"""Version of this package, used by setup.py, ``run.yaml`` and ``hdd_servo_ros.__version__``."""

__version__ = '0.1.0'
