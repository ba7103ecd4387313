from pathlib import Path

import pytest

from hdd_servo_ros.graph import manual

PUBLISHED = Path(__file__).parents[2] / 'docs'
CONTENTS = manual.contents()


@pytest.mark.parametrize('name', CONTENTS)
def test_the_published_document_is_what_the_declarations_say(name):
    assert (PUBLISHED / name).read_text('utf8') == CONTENTS[name], 'run `make docs`'


def test_no_page_of_parameters_is_left_of_a_node_that_is_gone():
    published = {path.relative_to(PUBLISHED).as_posix() for path in (PUBLISHED / 'reference/parameters').iterdir()}
    assert published == {name for name in CONTENTS if name.startswith('reference/parameters/')}


def test_written_into_a_folder(tmp_path):
    assert manual.main([str(tmp_path / 'docs')]) == 0
    for name, text in CONTENTS.items():
        assert (tmp_path / 'docs' / name).read_text('utf8') == text
