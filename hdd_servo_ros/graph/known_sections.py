"""Sections of parameter files whose name is no node's but looks like one: misspelt, or a controller's short name."""

import difflib

from hdd_servo_ros.graph.catalog import CONTROLLERS, SENSORS, names_with_parameters
from hdd_servo_ros.parameters.files import RosArguments


def doubtful_sections(arguments: RosArguments) -> list[str]:
    """
    Return a warning for each section that no node of this package takes, though it may have been meant for one.

    A file may hold sections for nodes of other packages, so that a name that looks like none of ours is passed over.

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
