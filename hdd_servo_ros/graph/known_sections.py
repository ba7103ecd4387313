"""Sections of parameter files with a name similar to that of a node: misspelled, or a short controller name."""

import difflib

from hdd_servo_ros.graph.catalog import CONTROLLERS, SENSORS, names_with_parameters
from hdd_servo_ros.parameters.files import RosArguments


def doubtful_sections(arguments: RosArguments) -> list[str]:
    """
    Return a warning for each section that matches no node of this package but may be intended for one.

    A file may contain sections for nodes of other packages; a name that resembles no node of this package is ignored.

    Parameters
    ----------
    arguments
        The command line.
    """
    short = {**CONTROLLERS, **SENSORS}
    called = {arguments.full_name(node).rpartition('/')[2]: node for node in names_with_parameters()}
    warnings = []
    for pattern in arguments.overrides:
        name = pattern.rpartition('/')[2]
        if name in called or name.startswith('*'):
            continue
        meant = [called_as for called_as, node in called.items() if node == short.get(name)]
        meant += [known for known in called if name and known.startswith(f'{name}_')]
        meant += difflib.get_close_matches(name, list(called), n=1, cutoff=0.75)
        if meant:
            warnings.append(f'no node takes the parameters of {pattern}; did you mean {meant[0]}?')
    return warnings
