"""What has changed between the campaign that a folder holds and one that is to go on there."""

from collections.abc import Iterator, Mapping
from typing import Any

from hdd_servo_ros.campaign.planning import Plan
from hdd_servo_ros.campaign.spec import named_values
from hdd_servo_ros.parameters.ros_yaml import RosYamlError, read_sections

_SHOWN = 3
"""Changes in a message."""


def changes(found: object, found_bases: Mapping[str, str], plan: Plan) -> str:
    """
    Return in words what differs, the first few differences; empty if none is known.

    Parameters
    ----------
    found
        Entry ``contents`` of the folder's ``campaign.yaml``.
    found_bases
        The folder's base parameter files by controller.
    plan
        Of the campaign that is to go on.
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
    """Compare base parameters of controllers that are in both; those of all are named once."""
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
