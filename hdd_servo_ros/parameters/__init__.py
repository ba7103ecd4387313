"""
Parameters: their declarations, the files and command lines that set them, and their changes during a run.

Exports the names of :mod:`~hdd_servo_ros.parameters.declaration`.
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
