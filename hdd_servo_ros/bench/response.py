"""A measured frequency response: what a signal analyzer writes and an identification reads."""

import csv
import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_HEADER = (
    'frequency [Hz]',
    'magnitude',
    'phase [deg]',
    'coherence',
    'amplitude [V]',
    'averages',
    'hold [s]',
    'output',
)
_FREQUENCY_UNITS = {'': 1.0, 'hz': 1.0, 'khz': 1e3, 'rad/s': 0.5 / np.pi}
_PHASE_UNITS = {'': 1.0, 'deg': 1.0, '°': 1.0, 'degrees': 1.0, 'rad': 180.0 / np.pi, 'radians': 180.0 / np.pi}
_SEPARATORS = ';\t,'
_DECIBEL = re.compile(r'dB\b[ ,]*(re\b *)?', re.IGNORECASE)
_VELOCITY = 'velocity'
_NAMES = {'gain': 'magnitude', 'freq': 'frequency', 'mag': 'magnitude'}


@dataclasses.dataclass(frozen=True)
class FrequencyResponse:
    """
    A response at n frequencies.

    Attributes
    ----------
    frequency
        [Hz], shape (n,), rising.
    response
        Output over input, complex, shape (n,): head displacement over drive voltage [um/V] on this bench.
    coherence
        Between input and output, over the averages, shape (n,); 1 where it was not measured.
    amplitude
        Of the excitation [V], shape (n,); 0 where it is not known.
    averages
        Number of records behind each point, shape (n,); 1 says that the coherence means nothing.
    by_velocity
        Whether the output's velocity was read and divided by j 2 pi f, shape (n,).
    hold
        How long the input was held from one sample to the next [s]: the response has that hold in it; 0 for none.
    unit
        Of the response; empty where it is not known.
    """

    frequency: Array
    response: ComplexArray
    coherence: Array
    amplitude: Array
    averages: NDArray[np.int64]
    by_velocity: NDArray[np.bool_]
    hold: float = 0.0
    unit: str = 'um/V'

    @property
    def is_seen(self) -> NDArray[np.bool_]:
        """At which points an output was measured; below the step of a converter it is 0. Shape (n,)."""
        return np.asarray(self.response != 0.0)

    def at(self, kept: NDArray[np.bool_]) -> 'FrequencyResponse':
        """Return the response at some of the points, given by a mask of shape (n,)."""
        return FrequencyResponse(
            self.frequency[kept],
            self.response[kept],
            self.coherence[kept],
            self.amplitude[kept],
            self.averages[kept],
            self.by_velocity[kept],
            self.hold,
            self.unit,
        )

    @classmethod
    def of(cls, frequency: ArrayLike, response: ArrayLike, hold: float = 0.0) -> 'FrequencyResponse':
        """Return a response of which nothing else is known."""
        frequencies = np.asarray(frequency, dtype=np.float64)
        count = len(frequencies)
        values = np.asarray(response, dtype=np.complex128)
        return cls(
            frequencies,
            values,
            np.ones(count),
            np.zeros(count),
            np.ones(count, dtype=np.int64),
            np.zeros(count, dtype=np.bool_),
            hold,
        )

    def between(self, lowest: float, highest: float) -> 'FrequencyResponse':
        """Return the points from ``lowest`` to ``highest`` [Hz], both included."""
        inside = (self.frequency >= lowest) & (self.frequency <= highest)
        return dataclasses.replace(
            self,
            frequency=self.frequency[inside],
            response=self.response[inside],
            coherence=self.coherence[inside],
            amplitude=self.amplitude[inside],
            averages=self.averages[inside],
            by_velocity=self.by_velocity[inside],
        )

    def relative_deviation(self) -> Array | None:
        """
        Return the standard deviation of each point over its magnitude, shape (n,), None if it was not measured.

        With K records of coherence g^2, the mean of their complex responses has the relative variance
        (1/g^2 - 1)/(K - 1) (Bendat and Piersol, *Random Data*, section 9.2, for a known input).
        """
        if len(self.frequency) == 0 or self.averages.min() < 2:
            return None
        coherence = np.clip(self.coherence, 1e-12, 1.0)
        return np.asarray(np.sqrt((1.0 / coherence - 1.0) / (self.averages - 1.0)))

    def write_csv(self, path: Path) -> None:
        """Write one row a frequency, units in the header; every number as short as it can be without loss."""
        columns = (
            self.frequency,
            np.abs(self.response),
            np.degrees(np.angle(self.response)),
            self.coherence,
            self.amplitude,
            self.averages,
            np.full(len(self.frequency), self.hold),
            np.where(self.by_velocity, _VELOCITY, 'displacement'),
        )
        with path.open('w', newline='', encoding='utf8') as stream:
            writer = csv.writer(stream)
            unit = f' [{self.unit}]' if self.unit else ''
            writer.writerow([title + unit if title == 'magnitude' else title for title in _HEADER])
            writer.writerows(zip(*(column.tolist() for column in columns), strict=True))


def held(frequency: ArrayLike, hold: float, delay: float = 0.0) -> ComplexArray:
    """
    Return the response of a zero-order hold over ``hold`` [s] with a ``delay`` [s] before it, at frequencies [Hz].

    A sampled response divided by it is that of the continuous system, but for what sampling folds back.
    """
    turns = np.asarray(frequency, dtype=np.float64)
    return np.asarray(np.sinc(turns * hold) * np.exp(-2j * np.pi * turns * (0.5 * hold + delay)))


def decibels(response: FrequencyResponse) -> Array:
    """Return the magnitude [dB], shape (n,)."""
    return np.asarray(20.0 * np.log10(np.abs(response.response)))


def degrees(response: FrequencyResponse) -> Array:
    """Return the phase [deg] without jumps, shape (n,); from -180 rather than +180 for a double integrator."""
    values = np.degrees(np.unwrap(np.angle(response.response)))
    return np.asarray(values - 360.0 if values[0] > 90.0 else values)


def read_csv(path: Path) -> FrequencyResponse:
    """
    Return the response in a CSV file.

    Commas, semicolons or tabs part the columns. The first line may name them, with units in brackets, whatever their
    case: ``frequency [Hz]`` (or kHz, rad/s), ``magnitude`` (linear or [dB]), ``phase [deg]`` (or rad), and perhaps
    ``coherence``, ``averages``, ``amplitude``, ``hold [s]``, ``output`` (``velocity`` where that was read). Without
    such a line the first three columns are frequency [Hz], linear magnitude and phase [deg]. Lines that begin with
    ``#`` are comments. The rows may come in any order.

    Raises
    ------
    ValueError
        If the file holds no such table; the message names the file and the line.
    """
    try:
        text = path.read_text('utf-8-sig').splitlines()
        first = next((line for line in text if line.strip() and not line.lstrip().startswith('#')), '')
        separator = next(mark for mark in _SEPARATORS if mark in first or mark == _SEPARATORS[-1])
        lines = [
            (number, [cell.strip() for cell in row])
            for number, row in enumerate(csv.reader(text, delimiter=separator), start=1)
            if row and row[0].strip() and not row[0].lstrip().startswith('#')
        ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f'{path} is no CSV file: {error}') from None
    if lines and not _is_number(lines[0][1][0]):
        columns = _columns(lines.pop(0)[1], path)
    else:
        columns = {'frequency': (0, ''), 'magnitude': (1, ''), 'phase': (2, '')}
    if not lines:
        raise ValueError(f'{path}: no row of numbers')
    try:
        table = {
            name: np.array([_cell(row, place, name, number) for number, row in lines])
            for name, (place, _) in columns.items()
        }
    except ValueError as error:
        raise ValueError(f'{path}, {error}') from None
    numbers = [number for number, _ in lines]
    return _response(table, {name: unit for name, (_, unit) in columns.items()}, numbers, path)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _columns(header: Sequence[str], path: Path) -> dict[str, tuple[int, str]]:
    """Return place and unit of each named column."""
    found: dict[str, tuple[int, str]] = {}
    for place, title in enumerate(header):
        match = re.fullmatch(r'([^\[(]*)(?:[\[(](.*)[\])])?', title)
        name, unit = (match[1].strip().lower(), (match[2] or '').strip()) if match else (title, '')
        name = _NAMES.get(name, name)
        # Of the response the unit is kept as it is written.
        found.setdefault(name, (place, unit if name == 'magnitude' else unit.lower()))
    for name, units in (('frequency', _FREQUENCY_UNITS), ('magnitude', None), ('phase', _PHASE_UNITS)):
        if name not in found:
            raise ValueError(f'{path}: no column {name!r}; there are {", ".join(header)}')
        if units is not None and found[name][1] not in units:
            known = ', '.join(unit.replace('hz', 'Hz') for unit in units if unit)
            raise ValueError(f'{path}: the unit of {name} is {found[name][1]!r}; known are {known}')
    return found


def _cell(row: Sequence[str], place: int, name: str, number: int) -> float:
    text = row[place] if place < len(row) else ''
    if name in ('frequency', 'magnitude', 'phase', 'coherence', 'averages', 'amplitude', 'hold'):
        if not _is_number(text) or not np.isfinite(float(text)):
            raise ValueError(f'line {number}: {name} is {text!r}, not a finite number')
        return float(text)
    return float(name == 'output' and text == _VELOCITY)


def _response(
    table: Mapping[str, Array], units: Mapping[str, str], numbers: Sequence[int], path: Path
) -> FrequencyResponse:
    """Return the response of the columns; ``numbers`` are the lines of the rows in the file."""
    frequency = table['frequency'] * _FREQUENCY_UNITS[units['frequency']]
    decibel = _DECIBEL.match(units['magnitude'])
    magnitude = 10.0 ** (table['magnitude'] / 20.0) if decibel else table['magnitude']
    phase = np.radians(table['phase'] * _PHASE_UNITS[units['phase']])
    for row in np.flatnonzero(frequency <= 0.0)[:1]:
        raise ValueError(f'{path}, line {numbers[row]}: frequency is {table["frequency"][row]:g}, not above 0')
    for row in np.flatnonzero(magnitude <= 0.0)[:1]:
        raise ValueError(
            f'{path}, line {numbers[row]}: magnitude is {table["magnitude"][row]:g}, not above 0; a magnitude in dB '
            'needs the unit [dB] in the header'
        )
    order = np.argsort(frequency, kind='stable')
    for place in np.flatnonzero(np.diff(frequency[order]) == 0.0)[:1]:
        first, second = order[place], order[place + 1]
        raise ValueError(
            f'{path}, line {numbers[second]}: frequency {table["frequency"][second]:.12g} is that of line '
            f'{numbers[first]} already; each may be given once'
        )
    holds = set(table.get('hold', np.zeros(1)).tolist())
    if len(holds) > 1:
        raise ValueError(f'{path}: the hold must be the same in all rows')
    ones = np.ones(len(frequency))
    return FrequencyResponse(
        frequency[order],
        np.asarray(magnitude * np.exp(1j * phase), dtype=np.complex128)[order],
        table.get('coherence', ones)[order],
        table.get('amplitude', 0.0 * ones)[order],
        np.rint(table.get('averages', ones)[order]).astype(np.int64),
        table.get('output', 0.0 * ones)[order] != 0.0,
        holds.pop(),
        units['magnitude'][decibel.end() :] if decibel else units['magnitude'],
    )
