"""Differences between the campaign in a directory and a campaign that is to resume there."""

from collections.abc import Iterator, Mapping
from typing import Any

from hdd_servo_ros.campaign.planning import Plan
from hdd_servo_ros.campaign.spec import named_values
from hdd_servo_ros.parameters.ros_yaml import RosYamlError, read_sections

_SHOWN = 3
"""Largest number of changes in a message."""


def changes(found: object, found_bases: Mapping[str, str], plan: Plan) -> str:
    """
    Return the first few differences as text; empty without a known difference.

    Parameters
    ----------
    found
        Entry ``contents`` of ``campaign.yaml`` in the directory.
    found_bases
        The base parameter files in the directory, by controller.
    plan
        Plan of the campaign that is to resume.
    """
    if not isinstance(found, Mapping):
        return ''
    listed = [*_of_contents(found, plan.contents), *_of_bases(found_bases, plan.base_files())]
    more = [f'and {len(listed) - _SHOWN} more'] if len(listed) > _SHOWN else []
    return '; '.join([*listed[:_SHOWN], *more])


def _of_contents(found: Mapping[str, Any], due: Mapping[str, Any]) -> Iterator[str]:
    for name, value in due.items():
        there = found.get(name)
        if name != 'varied':
            if there != value:
                yield f'{name} changed from {there} to {value}'
            continue
        varied = there if isinstance(there, Mapping) else {}
        for key in [*varied, *(key for key in value if key not in varied)]:
            if key not in value:
                yield f'{key} no longer varies'
            elif key not in varied:
                yield f'{key} varies now'
            elif varied[key] != value[key]:
                yield f'the values of {key} changed'


def _of_bases(found: Mapping[str, str], due: Mapping[str, str]) -> Iterator[str]:
    """Compare the base parameters of the common controllers; a difference of all controllers is listed once."""
    listed: dict[str, list[str]] = {}
    for name in due:
        if name not in found:
            continue
        old, new = _parameters(found[name]), _parameters(due[name])
        for key in sorted(old.keys() | new.keys()):
            if old.get(key) != new.get(key):
                if key not in old:
                    text = f'{key} is set to {new[key]} now'
                elif key not in new:
                    text = f'{key} is no longer set to {old[key]}'
                else:
                    text = f'{key} changed from {old[key]} to {new[key]}'
                listed.setdefault(text, []).append(name)
    for text, names in listed.items():
        yield text if len(names) == len(due) else f'{text} ({", ".join(names)})'


def _parameters(text: str) -> dict[str, object]:
    try:
        return named_values(dict(read_sections(text.encode())))
    except RosYamlError:
        return {}
