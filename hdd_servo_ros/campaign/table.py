"""The table of a campaign: one row per run, one column per parameter and metric."""

import collections
import csv
import hashlib
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.messages.errors import MissingExtra
from hdd_servo_ros.parameters.files import did_you_mean
from hdd_servo_ros.parameters.ros_yaml import LARGEST_INTEGER

_SHOWN_COLUMNS = 8
_SHOWN_ROWS = 10


class Table:
    """
    Columns of equal length by name.

    Numbers are int or float, and nan where a run lacks a value; other values are strings, lists as JSON.

    Parameters
    ----------
    columns
        The columns.
    units
        Units of the columns that have one.

    Raises
    ------
    ValueError
        If the columns have different lengths.

    Examples
    --------
    >>> from hdd_servo_ros.campaign import Table
    >>> table = Table({'controller': ['pid', 'adaptive_nn'], 'rms_error': [6.3, 1.4]}, {'rms_error': 'nm'})
    >>> table.where(controller='pid')['rms_error'].tolist(), table.units
    ([6.3], {'rms_error': 'nm'})
    >>> print(table.csv(), end='')
    controller,rms_error
    pid,6.3
    adaptive_nn,1.4
    """

    def __init__(self, columns: Mapping[str, Sequence[Any]], units: Mapping[str, str] | None = None) -> None:
        self._columns = {name: [_plain(value) for value in column] for name, column in columns.items()}
        self.units = dict(units or {})
        """Units of the columns that have one."""
        lengths = {len(column) for column in self._columns.values()}
        if len(lengths) > 1:
            raise ValueError(f'the columns have different lengths: {sorted(lengths)}')

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self._columns)

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    @overload
    def __getitem__(self, name: str) -> NDArray[Any]: ...

    @overload
    def __getitem__(self, name: int) -> dict[str, Any]: ...

    @overload
    def __getitem__(self, name: slice) -> 'Table': ...

    def __getitem__(self, name: str | int | slice) -> 'NDArray[Any] | dict[str, Any] | Table':
        """
        Return a column by its name, a row by its index as a mapping, or the rows of a slice as a table.

        Raises
        ------
        KeyError
            If the column does not exist; the message lists the columns.
        IndexError
            If the row does not exist.
        """
        if isinstance(name, slice):
            return Table({key: column[name] for key, column in self._columns.items()}, self.units)
        if isinstance(name, int):
            if not -len(self) <= name < len(self):
                raise IndexError(f'row {name} does not exist; expected 0 to {len(self) - 1}')
            return {key: column[name] for key, column in self._columns.items()}
        self._check(name)
        return np.array(self._columns[name])

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return self.rows()

    def _check(self, name: str) -> None:
        """Raise KeyError if a column does not exist."""
        if name not in self._columns:
            hint = did_you_mean(name, self._columns)
            raise KeyError(f'unknown column {name!r}{hint}; the columns are {", ".join(self._columns)}')

    def is_number(self, name: str) -> bool:
        """Return whether a column has only numbers."""
        return all(isinstance(value, int | float) for value in self._columns[name])

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows as mappings."""
        for values in zip(*self._columns.values(), strict=True):
            yield dict(zip(self._columns, values, strict=True))

    def where(self, **values: Any) -> 'Table':
        """
        Return the rows with given values, such as ``controller='pid'``.

        Raises
        ------
        KeyError
            If a column does not exist; the message lists the columns.
        """
        for name in values:
            self._check(name)
        return self.take(
            [index for index, row in enumerate(self.rows()) if all(row[key] == values[key] for key in values)]
        )

    def take(self, indices: Sequence[int]) -> 'Table':
        """Return the rows with given indices."""
        return Table({name: [column[i] for i in indices] for name, column in self._columns.items()}, self.units)

    def csv(self) -> str:
        """Return the table as comma-separated values, with all digits of floats."""
        file = io.StringIO()
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(self._columns)
        writer.writerows(zip(*self._columns.values(), strict=True))
        return file.getvalue()

    def digest(self) -> str:
        """Return a digest of the complete table."""
        return hashlib.blake2b(self.csv().encode(), digest_size=16).hexdigest()

    def to_dataframe(self) -> Any:
        """Return a pandas ``DataFrame``; raises :class:`MissingExtra` without pandas."""
        try:
            import pandas as pd
        except ImportError:
            raise MissingExtra('to_dataframe()', 'pandas') from None
        return pd.DataFrame(self._columns)

    def write_csv(self, path: Path) -> None:
        """Write a CSV file atomically."""
        _write_atomically(path, self.csv().encode())

    def write_parquet(self, path: Path) -> None:
        """Write a Parquet file atomically, with units as column metadata; raises :class:`MissingExtra`."""
        try:
            import pyarrow as pa
            from pyarrow import parquet
        except ImportError:
            raise MissingExtra('Parquet', 'pyarrow') from None
        arrays = [pa.array(_of_one_type(column)) for column in self._columns.values()]
        fields = [
            pa.field(name, array.type, metadata={'unit': self.units[name]} if name in self.units else None)
            for name, array in zip(self._columns, arrays, strict=True)
        ]
        buffer = io.BytesIO()
        parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), buffer)
        _write_atomically(path, buffer.getvalue())

    def __repr__(self) -> str:
        lines = [f'{len(self)} runs, {len(self._columns)} columns: {", ".join(self._columns)}']
        if 'verdict' in self:
            counted = collections.Counter(text or 'no verdict' for text in self._columns['verdict'])
            lines.append(', '.join(f'{text}: {count}' for text, count in counted.most_common()))
        # Digests are not informative, and reasons are long.
        names = [name for name in self._columns if name not in ('digest', 'reason')][:_SHOWN_COLUMNS]
        cells = [[_shown(self._columns[name][row]) for name in names] for row in range(min(len(self), _SHOWN_ROWS))]
        widths = [max(map(len, column)) for column in zip(names, *cells, strict=True)]
        for line in [names, *cells] if len(self) else []:
            lines.append('  '.join(f'{text:>{width}}' for text, width in zip(line, widths, strict=True)))
        if len(self) > _SHOWN_ROWS:
            lines.append(f'... {len(self) - _SHOWN_ROWS} more')
        return '\n'.join(lines)


def _plain(value: Any) -> int | float | str:
    if value is None:
        return math.nan
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return json.dumps(value)
    return value if isinstance(value, int | float) else str(value)


def _of_one_type(column: list[Any]) -> list[Any]:
    """Return a column of one Parquet type: strings if it has a string, otherwise doubles if it has a float."""
    if any(isinstance(value, str) for value in column):
        return list(map(str, column))
    if any(isinstance(value, float) or abs(value) > LARGEST_INTEGER for value in column):
        return list(map(float, column))
    return column


def _shown(value: object) -> str:
    return f'{value:.5g}' if isinstance(value, float) else str(value)


def _write_atomically(path: Path, content: bytes) -> None:
    temporary = path.with_name(f'{path.name}.tmp')
    temporary.write_bytes(content)
    temporary.replace(path)
