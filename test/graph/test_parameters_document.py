import pytest

from hdd_servo_ros.graph import parameters_document
from hdd_servo_ros.graph.catalog import names_with_parameters
from hdd_servo_ros.graph.known_parameters import node_declarations

PAGES = parameters_document.pages()


def test_there_is_a_page_per_node_and_the_index_lists_all():
    index = PAGES['parameters/index.md']
    for node in names_with_parameters():
        assert PAGES[f'parameters/{node}.md'].startswith(f'# {node}\n')
        assert f'({node}.md)' in index
        assert f'\n{node}\n' in index
    assert len(PAGES) == len(names_with_parameters()) + 2


@pytest.mark.parametrize('node', names_with_parameters())
def test_every_parameter_is_in_it_with_unit_and_meaning(node):
    own, shared = PAGES[f'parameters/{node}.md'], PAGES['parameters/shared.md']
    sets = [part for part in shared.split('\n## ')[1:] if f'(shared.md#{slug(part.splitlines()[0])})' in own]
    text = '\n'.join([own, *sets])
    declared = list(node_declarations(node))
    for declaration in declared:
        (row,) = [row for row in text.splitlines() if row.startswith(f'| `{declaration.name}` |')]
        assert f'| {declaration.unit} | {declaration.type_and_range}' in row
        assert declaration.description.replace('|', r'\|') in row
    assert text.count('\n| `') == len(declared)


def slug(title):
    return title.lower().replace(' ', '-')


@pytest.mark.parametrize('node', names_with_parameters())
def test_every_declaration_is_complete(node):
    names = [declaration.name for declaration in node_declarations(node)]
    assert len(names) == len(set(names)), 'a name is declared twice'
    for declaration in node_declarations(node):
        assert len(declaration.description) > 8, declaration.name
        assert '\n' not in declaration.description, declaration.name
        assert declaration.check(declaration.default) == declaration.default
