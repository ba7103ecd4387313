"""
Parameters: how a block declares them, the files and command lines that set them, and how they change during a run.

The names of :mod:`~hdd_servo_ros.parameters.declaration` are offered here.
"""

from hdd_servo_ros.parameters.declaration import (
    Declaration,
    InvalidParameterError,
    ParameterError,
    ParameterSet,
    UnknownParameterError,
    Value,
    declarations,
    from_mapping,
    group,
    parameter,
    to_mapping,
    with_tuples,
)

__all__ = [
    'Declaration',
    'InvalidParameterError',
    'ParameterError',
    'ParameterSet',
    'UnknownParameterError',
    'Value',
    'declarations',
    'from_mapping',
    'group',
    'parameter',
    'to_mapping',
    'with_tuples',
]
