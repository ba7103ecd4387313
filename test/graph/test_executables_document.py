import argparse

import pytest

from hdd_servo_ros.graph.catalog import COMMANDS, NODES, resolve
from hdd_servo_ros.graph.executables_document import document
from hdd_servo_ros.messages.exit_codes import FAILED, UNREADABLE, WRONG_ARGUMENTS

TEXT = document()


def section(name):
    (found,) = [part for part in TEXT.split('\n### ') if part.startswith(f'{name}\n')]
    return found


def test_every_exit_code_is_in_it():
    for code in ('0', str(FAILED), str(WRONG_ARGUMENTS), str(UNREADABLE), '128 + n'):
        assert TEXT.count(f'\n| {code} | ') == 1


@pytest.mark.parametrize('name', [*NODES, *(name for name, row in COMMANDS.items() if row.parameters)])
def test_every_executable_with_parameters_names_its_page(name):
    assert f'\n| `{name}` | ' in TEXT
    assert f'(parameters/{name}.md)' in TEXT


@pytest.mark.parametrize('name', [name for name, row in COMMANDS.items() if not row.parameters])
def test_every_option_of_a_command_is_in_its_section(name):
    text = section(name)
    assert f'```text\n{name} ' in text
    if name == 'outside_controller':
        return
    parser: argparse.ArgumentParser = resolve(f'{COMMANDS[name].module}:command_line')()
    usage = parser.format_usage()
    for word in {word.strip('[],') for word in usage.split() if word.strip('[],').startswith('-')} - {'-h'}:
        assert f'`{word}' in text, word
    assert '%(' not in text
