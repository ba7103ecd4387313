"""Rules for pages of the documentation: short sentences, and headings that name a task or an object."""

import re
from collections.abc import Iterator

LONGEST_AVERAGE = 25.0
"""Largest average number of words per sentence of a page."""
_HEADING = re.compile(r'^#+ +(.*)$', re.MULTILINE)
_NOT_SENTENCES = re.compile(r'^(#+ .*|\|.*|!\[.*|\s*\x00\s*)$', re.MULTILINE)
_END = re.compile(r'[.!?:]["\')*_]*(?:\s+|$)|\n\s*\n|\n\s*(?:[-*]|\d+\.)\s+')


def average_sentence(text: str) -> float:
    """Return the average number of words per sentence of Markdown with blanked-out code; 0 without a sentence."""
    sentences = [part.split() for part in _END.split(_NOT_SENTENCES.sub('\n', text))]
    lengths = [len(words) for words in sentences if len(words) > 1]
    return sum(lengths) / len(lengths) if lengths else 0.0


def questions(text: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of each heading that is a question."""
    for match in _HEADING.finditer(text):
        if match[1].rstrip().endswith('?'):
            yield 1 + text.count('\n', 0, match.start()), match[1]
