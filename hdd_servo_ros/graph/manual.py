"""
Pages generated from declarations: executables, parameters, topics, and the diagram of the graph.

``python -m hdd_servo_ros.graph.manual FOLDER`` writes them into the documentation directory (`make docs`).
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from hdd_servo_ros.graph import executables_document, parameters_document, picture, topics_document
from hdd_servo_ros.messages.command_line import CommandParser

DOCUMENTS: dict[str, Callable[[], str]] = {
    'reference/executables.md': executables_document.document,
    'reference/topics.md': topics_document.document,
    'images/graph.svg': picture.drawing,
}
"""Functions that return the content of each generated file, except the parameter pages."""


def contents() -> dict[str, str]:
    """Return the content of every generated file by its path in the documentation directory."""
    found = {name: make() for name, make in DOCUMENTS.items()}
    return found | {f'reference/{name}': text for name, text in parameters_document.pages().items()}


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the generated pages; return the exit code."""
    assert __doc__ is not None
    parser = CommandParser(prog='python -m hdd_servo_ros.graph.manual', description=__doc__.strip())
    parser.add_argument('folder', type=Path, help='documentation directory')
    folder: Path = parser.parse_args(arguments).folder
    for name, text in contents().items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, 'utf8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
