from pathlib import Path

import pytest

from hdd_servo_ros.graph import parameters_document
from hdd_servo_ros.graph.catalogue import names_with_parameters
from hdd_servo_ros.graph.known_parameters import node_declarations

PUBLISHED = Path(__file__).parents[2] / 'docs' / 'parameters.md'


def test_the_published_document_is_what_the_declarations_say():
    assert PUBLISHED.read_text('utf8') == parameters_document.document(), 'run `make docs`'


def test_every_parameter_is_in_it_with_unit_and_meaning():
    sections = parameters_document.document().split('\n## ')
    shared = [section for section in sections if 'Has [' not in section]
    for node in names_with_parameters():
        (own,) = [section for section in sections if section.startswith(f'{node}\n')]
        text = own + ''.join(shared)
        for declaration in node_declarations(node):
            rows = [row for row in text.splitlines() if row.startswith(f'| `{declaration.name}` |')]
            assert any(f'| {declaration.unit} |' in row and declaration.description in row for row in rows)


@pytest.mark.parametrize('node', names_with_parameters())
def test_every_declaration_is_complete(node):
    names = [declaration.name for declaration in node_declarations(node)]
    assert len(names) == len(set(names)), 'a name is declared twice'
    for declaration in node_declarations(node):
        assert len(declaration.description) > 8, declaration.name
        assert '\n' not in declaration.description, declaration.name
        assert declaration.check(declaration.default) == declaration.default
