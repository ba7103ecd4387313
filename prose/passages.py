"""Extraction of the prose of a file: paragraphs, comments, docstrings and messages."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_FENCE = re.compile(r'^( *)(`{3,}|~{3,}).*?^ *\2 *$', re.MULTILINE | re.DOTALL)
_MARKDOWN_CODE = re.compile(r'(`+)(?!`).+?(?<!`)\1(?!`)|\$\$.+?\$\$|\$[^$\n]+\$|\]\([^)]*\)|<[^<> ]+>', re.DOTALL)
_REST_CODE = re.compile(
    r'``.+?``|:[a-z:]+:`[^`]+`|`[^`]+`_*|^\s*(>>>|\.\.\.) .*$|^ *\.\. .*$', re.MULTILINE | re.DOTALL
)
_DOCTEST = re.compile(r'^ *>>> .*(\n(?! *$).*)*', re.MULTILINE)
_LITERAL_BLOCK = re.compile(r'::\n\n((?: {4,}.*\n|\n)+)')


@dataclass(frozen=True)
class Passage:
    """A passage of prose; code is blanked out, so that line numbers match the file."""

    line: int
    """Number of the first line."""
    text: str
    is_prose: bool = True
    """False for messages and help strings, which use the units of the code."""


def passages(path: Path) -> Iterator[Passage]:
    """Yield the passages of a Markdown, reStructuredText, Python or YAML file."""
    text = path.read_text('utf8')
    if path.suffix == '.md':
        yield Passage(1, _blanked(_MARKDOWN_CODE, _blanked(_FENCE, text)))
    elif path.suffix == '.rst':
        yield Passage(1, _without_code(text))
    elif path.suffix == '.py':
        yield from _of_python(text)
    else:
        for number, line in enumerate(text.splitlines(), 1):
            _, mark, comment = line.partition('#')
            if mark:
                yield Passage(number, comment)


def _of_python(text: str) -> Iterator[Passage]:
    yield from _comments(text)
    tree = ast.parse(text)
    docstrings = {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    pieces = {id(piece) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for piece in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            joined = ''.join(str(piece.value) if isinstance(piece, ast.Constant) else '`x`' for piece in node.values)
            yield Passage(node.lineno, _without_code(joined).replace('\n', ' '), is_prose=False)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in pieces:
            if id(node) in docstrings:
                yield Passage(node.lineno, _without_code(node.value))
            elif ' ' in node.value:
                yield Passage(node.lineno, _without_code(node.value).replace('\n', ' '), is_prose=False)


def _comments(text: str) -> Iterator[Passage]:
    """Yield comments; consecutive lines form one passage."""
    first, lines = 0, list[str]()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type != tokenize.COMMENT:
            continue
        number = token.start[0]
        if lines and number != first + len(lines):
            yield Passage(first, _without_code('\n'.join(lines)))
            lines = []
        first = first if lines else number
        lines.append(token.string.lstrip('# '))
    if lines:
        yield Passage(first, _without_code('\n'.join(lines)))


def _without_code(text: str) -> str:
    return _blanked(_REST_CODE, _blanked(_DOCTEST, _blanked(_LITERAL_BLOCK, text)))


def _blanked(pattern: re.Pattern[str], text: str) -> str:
    """Return the string with each match replaced by a placeholder with as many lines."""
    return pattern.sub(lambda found: '\x00' + '\n' * found[0].count('\n'), text)
