from pathlib import Path

import pytest

from hdd_servo_ros.graph import manual

PUBLISHED = Path(__file__).parents[2] / 'docs'


@pytest.mark.parametrize('name', manual.DOCUMENTS)
def test_the_published_document_is_what_the_declarations_say(name):
    assert (PUBLISHED / name).read_text('utf8') == manual.DOCUMENTS[name](), 'run `make docs`'


def test_written_into_a_folder(tmp_path):
    assert manual.main([str(tmp_path / 'docs')]) == 0
    for name, make in manual.DOCUMENTS.items():
        assert (tmp_path / 'docs' / name).read_text('utf8') == make()
