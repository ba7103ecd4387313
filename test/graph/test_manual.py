from pathlib import Path

import pytest

from hdd_servo_ros.graph import manual

PUBLISHED = Path(__file__).parents[2] / 'docs'
CONTENTS = manual.contents()


@pytest.mark.parametrize('name', CONTENTS)
def test_the_published_page_matches_the_declarations(name):
    assert (PUBLISHED / name).read_text('utf8') == CONTENTS[name], 'run `make docs`'


def test_no_parameter_page_of_a_removed_node_is_left():
    published = {path.relative_to(PUBLISHED).as_posix() for path in (PUBLISHED / 'reference/parameters').iterdir()}
    assert published == {name for name in CONTENTS if name.startswith('reference/parameters/')}


def test_written_into_a_directory(tmp_path):
    assert manual.main([str(tmp_path / 'docs')]) == 0
    for name, text in CONTENTS.items():
        assert (tmp_path / 'docs' / name).read_text('utf8') == text
