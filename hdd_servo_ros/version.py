"""The version of this package, in one place for setup.py, ``run.yaml`` and ``hdd_servo_ros.__version__``."""

__version__ = '0.1.0'
