"""The prose check of `make lint`: what it finds, where, and what it leaves alone."""

import pytest
import yaml

from prose.__main__ import ROOT, complaints, main
from prose.pages import average_sentence, questions
from prose.vocabulary import Phrase, read_vocabulary


def found(path, text):
    path.write_text(text, 'utf8')
    return sorted(complaints(path))


@pytest.mark.parametrize(
    'text',
    [
        'The log says it.',
        'the value stands in the file',
        'ten nodes an axis',
        'The bag is whole.',
        'bit\nfor\nbit',
        'a time that is no tick',
        'Return what is read.',
    ],
)
def test_phrases_of_the_vocabulary_are_found_in_pages(tmp_path, text):
    assert found(tmp_path / 'page.md', text)


@pytest.mark.parametrize(
    'text',
    [
        'The file is sorted in place.',
        'It takes no longer than before.',
        'Use `says` there.',
        '```bash\necho it says 2 um\n```',
        'The amplitude is 2 µm.',
        'It takes two decimal places.',
    ],
)
def test_code_and_exceptions_are_left_alone(tmp_path, text):
    assert not found(tmp_path / 'page.md', text)


def test_python_docstrings_comments_and_messages_are_read_with_their_lines(tmp_path):
    source = '\n'.join(
        [
            '"""Module.',
            '',
            'It says so.',
            '"""',
            '# The value stands here.',
            "NAME = 'says'",
            "print(f'{NAME} is refused: 2 um')",
        ]
    )
    lines = [line for line, _ in found(tmp_path / 'module.py', source)]
    assert lines == [3, 5, 7], 'one each: a docstring, a comment, a message, whose unit is that of the code'


def test_literals_and_doctests_of_docstrings_are_code(tmp_path):
    source = '"""Return ``stands``.\n\nExamples\n--------\n>>> says = 1\n>>> says\n1\n"""\n'
    assert not found(tmp_path / 'module.py', source)


def test_comments_of_parameter_files_are_read(tmp_path):
    assert found(tmp_path / 'drive.yaml', 'gain: 1.0  # stands for the drive\n') == found(
        tmp_path / 'drive.yaml', '# stands for the drive\n'
    )


def test_long_sentences_are_reported_for_the_page_as_a_whole(tmp_path):
    long = ' '.join(['word'] * 40)
    assert found(tmp_path / 'page.md', f'{long}. {long}.')
    assert not found(tmp_path / 'page.md', f'{long}. Short. Short one. And one more.')
    assert average_sentence('One two three. Four five.') == 2.5
    assert average_sentence('# A heading of many words\n\n| a | table |\n') == 0.0


def test_headings_are_no_questions_except_in_the_faq(tmp_path):
    text = '# Does it run?\n\nYes, it does.\n'
    assert list(questions(text)) == [(1, 'Does it run?')]
    assert found(tmp_path / 'page.md', text)
    assert not found(tmp_path / 'faq.md', text)


def test_every_entry_of_the_vocabulary_has_a_replacement_and_finds_itself_in_any_case():
    for phrase in read_vocabulary():
        assert isinstance(phrase, Phrase)
        assert phrase.use


def test_the_vocabulary_has_only_the_documented_keys():
    for entry in yaml.safe_load((ROOT / 'prose' / 'vocabulary.yaml').read_text('utf8')):
        assert set(entry) <= {'avoid', 'use', 'except', 'where'}, entry


def test_the_command_names_file_line_and_replacement(tmp_path, monkeypatch, capsys):
    import prose.__main__ as command

    (tmp_path / 'README.md').write_text('Good.\n\nIt says so.\n')
    monkeypatch.setattr(command, 'ROOT', tmp_path)
    assert main([]) == 1
    assert capsys.readouterr().out.startswith('README.md:3: "says": reports, logs')
    (tmp_path / 'README.md').write_text('It reports it.\n')
    assert main([]) == 0
