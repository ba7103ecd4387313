"""Parameter values at and beyond the allowed bounds, and of wrong types."""

import math
import random
from collections.abc import Collection
from typing import Any

from hdd_servo_ros.graph.known_parameters import node_declarations
from hdd_servo_ros.parameters import Declaration


def odd_value(choice: random.Random, node: str, without: Collection[str] = ()) -> tuple[str, str, Any]:
    """
    Choose a parameter of a node and a value for it.

    Parameters
    ----------
    choice
        Random generator.
    node
        Name of the node in the catalog.
    without
        Parameters to exclude.

    Returns
    -------
    tuple
        Node, name and value.
    """
    declaration = choice.choice([each for each in node_declarations(node) if each.name not in without])
    return node, declaration.name, _value(choice, declaration)


def is_named(reason: str, node: str, name: str) -> bool:
    """
    Return whether a rejection names a parameter.

    The reason may contain only the last part of the name (`as many as numerators`), and the units of a drive appear
    together (`a drive in x and V`).
    """
    names = (name, node, name.rpartition('.')[2], *(['a drive in'] if '_unit' in name else []))
    return any(each in reason for each in names)


_NUMBERS = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e-12, 1e12, 1e300, 1.797e308, math.inf, -math.inf, math.nan)
_ODD: tuple[Any, ...] = (True, 'x', '', [], [1.0, 'x'], 2**63, -(2**63) - 1, 10**30, {'a': 1}, None)


def _value(choice: random.Random, declaration: Declaration) -> Any:
    if choice.random() < 0.1:
        return choice.choice(_ODD)
    if declaration.is_sequence:
        return [_scalar(choice, declaration) for _ in range(choice.randint(0, 4))]
    return _scalar(choice, declaration)


def _scalar(choice: random.Random, declaration: Declaration) -> Any:
    kind = declaration.element_type
    if kind is bool:
        return choice.random() < 0.5
    if kind is str:
        return choice.choice([*(declaration.choices or ()), 'x', ''])
    lower, upper = max(declaration.minimum, declaration.above), declaration.maximum
    bounds = [bound for bound in (lower, upper) if math.isfinite(bound)]
    if kind is int:
        return choice.choice([0, 1, 2, 3, -1, 2**31, 2**62, *map(int, bounds)])
    return choice.choice(
        [*_NUMBERS, *bounds, *(math.nextafter(bound, math.inf) for bound in bounds), choice.gauss(0, 1)]
    )
