"""
YAML files that users may have edited: parsed completely, or rejected with a single kind of error.

libyaml's loader crashes the process for some ten thousand nesting levels, and ten lines with aliases make a tree of
10^9 elements. Therefore the events are checked first, without recursion, and a file whose tree is too deep or too large
is rejected before it is built.
"""

from pathlib import Path
from typing import Any

import yaml

DEEPEST = 100
"""Maximum nesting depth of lists and mappings."""
MOST_REPEATED = 2**22
"""Maximum repetition by aliases [characters and elements]."""
LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
"""libyaml's loader if PyYAML was built with it; ten times faster."""


class YamlError(ValueError):
    """Invalid YAML, or YAML beyond the size limits; the message has the location and the reason in one line."""


def read_yaml(path: Path) -> Any:
    """
    Return the content of a YAML file.

    Raises
    ------
    OSError
        If it cannot be read.
    YamlError
        If it is not YAML in UTF-8, is nested deeper than :data:`DEEPEST`, or repeats too much by aliases; the message
        does not name the file.
    """
    data = path.read_bytes()
    try:
        return parse_yaml(data.decode())
    except UnicodeDecodeError as error:
        raise YamlError(f'not UTF-8: {error.reason} at byte {error.start}') from None


def parse_yaml(text: str) -> Any:
    """Return the content of a YAML string; see :func:`read_yaml`."""
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
        # PyYAML's constructors raise other errors for some values: month 13 of a date, an integer of 5000 digits.
        raise YamlError(' '.join(str(error).split())) from None


def _check_size(text: str) -> None:
    """Reject a string that is nested too deep, or whose tree is too large because of aliases."""
    # Sizes of the open lists and mappings, with aliases expanded; the first is the document itself.
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
            # An alias of an enclosing node is not defined until that node ends.
            size_of.pop(event.anchor or '', None)
        elif isinstance(event, yaml.CollectionEndEvent):
            size, anchor = sizes.pop(), anchors.pop()
            sizes[-1] += size
            if anchor:
                size_of[anchor] = size
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in size_of:
                raise YamlError(f'line {_line(event)}: the alias *{event.anchor} is not defined before it')
            size = size_of[event.anchor]
            sizes[-1] += size
            repeated += size
            if repeated > MOST_REPEATED:
                raise YamlError(f'line {_line(event)}: aliases repeat more than {MOST_REPEATED} characters')


def _line(event: Any) -> int:
    return int(event.start_mark.line) + 1
