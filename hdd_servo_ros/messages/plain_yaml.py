"""
YAML files that anybody may have changed: read whole, or rejected with one kind of error.

libyaml's loader ends the process where a text is nested some ten thousand deep, and ten lines with aliases make a tree
of 10^9 elements. So the events are looked at first, which takes no recursion, and a text whose tree is too deep or too
large is rejected before there is one.
"""

from pathlib import Path
from typing import Any

import yaml

DEEPEST = 100
"""How deep lists and mappings may be nested."""
MOST_REPEATED = 2**22
"""How much aliases may repeat [characters and elements]."""
LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
"""That of libyaml, where PyYAML was built with it: ten times faster."""


class YamlError(ValueError):
    """A text that is no YAML, or more of it than is read; says where and why, in one line."""


def read_yaml(path: Path) -> Any:
    """
    Return the content of a YAML file.

    Raises
    ------
    OSError
        If it cannot be read.
    YamlError
        If it is no YAML in UTF-8, is nested deeper than :data:`DEEPEST`, or repeats too much by aliases; does not name
        the file.
    """
    data = path.read_bytes()
    try:
        return parse_yaml(data.decode())
    except UnicodeDecodeError as error:
        raise YamlError(f'it is not UTF-8: {error.reason} at byte {error.start}') from None


def parse_yaml(text: str) -> Any:
    """Return the content of a YAML text; see :func:`read_yaml`."""
    try:
        _check_size(text)
        return yaml.load(text, LOADER)
    except YamlError:
        raise
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = '' if mark is None else f'line {mark.line + 1}: '
        raise YamlError(f'{where}{error.problem or error.context}') from None
    except (yaml.YAMLError, ValueError, OverflowError, AttributeError, TypeError) as error:
        # What PyYAML makes values of does not catch all: a date of month 13, an integer of 5000 digits.
        raise YamlError(' '.join(str(error).split())) from None


def _check_size(text: str) -> None:
    """Reject a text that is nested too deep, or that aliases make too large a tree of."""
    # What each open list or mapping holds so far, aliases written out; the first is the text itself.
    sizes, anchors = [0], ['']
    size_of: dict[str, int] = {}
    repeated = 0
    for event in yaml.parse(text, Loader=LOADER):
        if isinstance(event, yaml.ScalarEvent):
            size = 1 + len(event.value)
            sizes[-1] += size
            if event.anchor:
                size_of[event.anchor] = size
        elif isinstance(event, yaml.CollectionStartEvent):
            if len(sizes) > DEEPEST:
                raise YamlError(f'line {_line(event)}: nested more than {DEEPEST} deep')
            sizes.append(1)
            anchors.append(event.anchor or '')
            # An alias of what it stands in is not known before its end.
            size_of.pop(event.anchor or '', None)
        elif isinstance(event, yaml.CollectionEndEvent):
            size, anchor = sizes.pop(), anchors.pop()
            sizes[-1] += size
            if anchor:
                size_of[anchor] = size
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in size_of:
                raise YamlError(f'line {_line(event)}: the alias *{event.anchor} repeats what is not known')
            size = size_of[event.anchor]
            sizes[-1] += size
            repeated += size
            if repeated > MOST_REPEATED:
                raise YamlError(f'line {_line(event)}: aliases repeat more than {MOST_REPEATED} characters')


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1
