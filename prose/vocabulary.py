"""Phrases to avoid, from ``vocabulary.yaml``."""

import functools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from prose.passages import Passage


@dataclass(frozen=True)
class Phrase:
    """A phrase to avoid, its replacement, and longer phrases that are allowed."""

    avoid: re.Pattern[str]
    use: str
    allowed: tuple[re.Pattern[str], ...]
    in_messages: bool
    """False for a phrase that messages and help strings may use, such as the units of the code."""

    def found(self, passage: Passage) -> Iterator[tuple[int, str]]:
        """Yield line and wording of each match in a passage."""
        if not (passage.is_prose or self.in_messages):
            return
        allowed = [span.span() for pattern in self.allowed for span in pattern.finditer(passage.text)]
        for match in self.avoid.finditer(passage.text):
            if not any(start <= match.start() and match.end() <= end for start, end in allowed):
                yield passage.line + passage.text.count('\n', 0, match.start()), ' '.join(match[0].split())


@functools.cache
def read_vocabulary() -> tuple[Phrase, ...]:
    """Return the phrases of ``vocabulary.yaml``."""
    entries = yaml.safe_load(Path(__file__).with_suffix('.yaml').read_text('utf8'))
    return tuple(map(_phrase, entries))


def _phrase(entry: Mapping[str, Any]) -> Phrase:
    allowed = tuple(map(_compiled, entry.get('except', ())))
    return Phrase(_compiled(entry['avoid']), entry['use'], allowed, entry.get('where', '') != 'prose')


def _compiled(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern.replace(' ', r'\s+'), re.IGNORECASE)
