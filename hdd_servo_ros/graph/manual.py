"""
The documents that follow from declarations: parameters, topics, and the picture of the graph; no ROS import.

``python -m hdd_servo_ros.graph.manual FOLDER`` writes them into the folder of the documents (`make docs`).
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from hdd_servo_ros.graph import parameters_document, picture, topics_document
from hdd_servo_ros.messages.command_line import CommandParser

DOCUMENTS = {
    'parameters.md': parameters_document.document,
    'topics.md': topics_document.document,
    'images/graph.svg': picture.drawing,
}
"""What makes the content of each file of the folder."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the documents."""
    assert __doc__ is not None
    parser = CommandParser(prog='python -m hdd_servo_ros.graph.manual', description=__doc__.strip())
    parser.add_argument('folder', type=Path, help='where to write them')
    folder: Path = parser.parse_args(arguments).folder
    for name, make in DOCUMENTS.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(make(), 'utf8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
