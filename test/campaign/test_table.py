"""A table gives columns, rows and parts of itself, and names the columns that there are."""

from typing import Any

import pytest

from hdd_servo_ros.campaign.table import Table

TABLE = Table({'run': [0, 1, 2], 'controller': ['pid', 'pid', 'seek'], 'rms': [1.5, 2.5, 3.5]}, {'rms': 'nm'})


def test_an_index_gives_a_row_and_a_slice_a_table():
    assert TABLE[1] == {'run': 1, 'controller': 'pid', 'rms': 2.5}
    assert TABLE[-1]['run'] == 2
    assert TABLE[1:].csv() == 'run,controller,rms\n1,pid,2.5\n2,seek,3.5\n'
    assert TABLE[0:2].units == {'rms': 'nm'}
    with pytest.raises(IndexError, match='row 3 does not exist; expected 0 to 2'):
        TABLE[3]


def test_iterating_gives_the_rows():
    assert list(TABLE) == list(TABLE.rows()) == [TABLE[0], TABLE[1], TABLE[2]]


def test_a_misspelt_column_is_named_with_those_that_there_are():
    message = "unknown column 'controler'; did you mean controller\\?; the columns are run, controller, rms"
    with pytest.raises(KeyError, match=message):
        TABLE.where(controler='pid')
    with pytest.raises(KeyError, match=message):
        TABLE['controler']
    assert TABLE.where(controller='pid')['run'].tolist() == [0, 1]


def test_columns_of_mixed_types_go_to_parquet(tmp_path):
    parquet = pytest.importorskip('pyarrow.parquet')
    mixed: dict[str, list[Any]] = {
        'a': [1, 2.5],
        'b': [2**60 + 1, 2.5],
        'c': [50.0, 'fast'],
        'd': [1, 2**64],
        'e': [True, 1.0],
        'f': [1, 2],
    }
    Table(mixed).write_parquet(tmp_path / 'table.parquet')
    assert parquet.read_table(tmp_path / 'table.parquet').to_pydict() == {
        'a': [1.0, 2.5],
        'b': [float(2**60), 2.5],
        'c': ['50.0', 'fast'],
        'd': [1.0, 2.0**64],
        'e': ['true', '1.0'],
        'f': [1, 2],
    }
