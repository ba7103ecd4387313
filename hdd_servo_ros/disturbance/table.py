"""Tables of numbers in CSV files."""

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from hdd_servo_ros.parameters import ParameterError


def read_table(parameter: str, path: str, columns: Sequence[str], least: int) -> list[tuple[float, ...]]:
    """
    Return the rows of a CSV file of numbers.

    The first line may name the columns. Lines that start with # are comments.

    Parameters
    ----------
    parameter
        Name of the parameter with the path, for error messages.
    path
        CSV file.
    columns
        Quantity of each column, for error messages; further columns are ignored.
    least
        Minimum number of rows.

    Raises
    ------
    ParameterError
        If the file cannot be read, has too few rows, or a row lacks a finite number; names file and line.
    """
    form = f'a CSV file with the columns {", ".join(columns)}' if len(columns) > 1 else f'a CSV file with {columns[0]}'
    rows: list[tuple[float, ...]] = []
    may_be_names = True
    try:
        for line, words in _lines(Path(path)):
            row = _numbers(words[: len(columns)])
            is_names = may_be_names and not any(map(_is_number, words))
            may_be_names = False
            if is_names:
                continue
            if row is None or len(row) < len(columns):
                found = ','.join(words)
                raise ParameterError(parameter, path, f'{form} as finite numbers; line {line} is {found!r}')
            rows.append(row)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(parameter, path, f'{form}; reading failed: {error}') from None
    if len(rows) < least:
        raise ParameterError(parameter, path, f'{form} and at least {least} rows of numbers; it has {len(rows)}')
    return rows


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    with path.open(encoding='utf-8-sig', newline='') as file:
        reader = csv.reader(file, skipinitialspace=True)
        for words in reader:
            if any(word.strip() for word in words) and not words[0].startswith('#'):
                yield reader.line_num, words


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(words: Sequence[str]) -> tuple[float, ...] | None:
    """Return the numbers of a row, or None if a word is not a finite number."""
    try:
        numbers = tuple(map(float, words))
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None
