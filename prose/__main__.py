"""
Report phrases that documentation, messages, docstrings and comments should avoid.

The exit code is 1 if a phrase is found. ``python -m prose PATH ...`` checks only some files.
"""

import argparse
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from prose.pages import LONGEST_AVERAGE, average_sentence, questions
from prose.passages import passages
from prose.vocabulary import read_vocabulary

ROOT = Path(__file__).resolve().parent.parent
CHECKED_FOLDERS = ('hdd_servo_ros', 'benchmarks', 'examples', 'faults', 'launch', 'prose')
CHECKED = (
    '*.md',
    '*.rst',
    'docs/**/*.md',
    'docs/**/*.rst',
    'params/*.yaml',
    *(f'{folder}/**/*.py' for folder in CHECKED_FOLDERS),
)
FAQ = 'faq.md'
GENERATED = ('docs/reference/parameters/*.md', 'docs/reference/executables.md')
"""Pages with parameter and option descriptions, whose units are those of the code."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Check files; return the exit code."""
    parser = argparse.ArgumentParser(prog='python -m prose', description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('paths', nargs='*', type=Path, metavar='PATH', help='files or directories; default: all')
    given = parser.parse_args(arguments).paths
    count = 0
    for path in files(given):
        for line, complaint in sorted(complaints(path)):
            print(f'{_relative(path)}:{line}: {complaint}')
            count += 1
    if count:
        print(f'Found {count} phrases to rewrite; prose/vocabulary.yaml explains them')
    return int(count > 0)


def files(given: Sequence[Path]) -> Iterator[Path]:
    """Yield the files to check; if paths are given, only those."""
    chosen = [path.resolve() for path in given]
    for path in sorted({path for pattern in CHECKED for path in ROOT.glob(pattern)}):
        if not chosen or any(path == one or one in path.parents for one in chosen):
            yield path


def complaints(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of each complaint about a file."""
    vocabulary = read_vocabulary()
    is_generated = any(_relative(path).match(pattern) for pattern in GENERATED)
    for passage in passages(path):
        if is_generated:
            passage = dataclasses.replace(passage, is_prose=False)
        for phrase in vocabulary:
            for line, words in phrase.found(passage):
                yield line, f'"{words}": {phrase.use}'
        if path.suffix == '.md':
            average = average_sentence(passage.text)
            if average > LONGEST_AVERAGE:
                yield 1, f'{average:.1f} words per sentence on average, more than {LONGEST_AVERAGE:g}'
            if path.name != FAQ:
                for line, heading in questions(passage.text):
                    yield line, f'heading "{heading}" is a question: name a task or an object'


def _relative(path: Path) -> Path:
    return path.relative_to(ROOT) if path.is_relative_to(ROOT) else path


if __name__ == '__main__':
    sys.exit(main())
