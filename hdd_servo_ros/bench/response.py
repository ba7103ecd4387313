"""A measured frequency response: what a signal analyzer writes and an identification reads."""

import csv
import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.messages.shown import shown

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
_SIDE_UNITS = {
    'coherence': {'': 1.0, '1': 1.0, '%': 0.01, 'percent': 0.01},
    'averages': {'': 1.0, '1': 1.0},
    'amplitude': {'': 1.0, 'v': 1.0, 'mv': 1e-3, 'uv': 1e-6, 'µv': 1e-6},
    'hold': {'': 1.0, 's': 1.0, 'ms': 1e-3, 'us': 1e-6, 'µs': 1e-6, 'ns': 1e-9},
}
"""Factors from the units of the other columns to those of :class:`FrequencyResponse`, in lower case."""
_SEPARATORS = ';\t,'
_DECIBEL = re.compile(r'dB\b[ ,]*(re\b *)?', re.IGNORECASE)
_RATE = re.compile(r'\(?\s*([^/()]+?)\s*/\s*(?:s(\^?2|²)?\s*\)?(\s*/.+)?|\(\s*s(\^?2|²)?[\s*]+([^/()]+)\))')
"""A unit of a velocity or an acceleration over that of the input: um/s/V, (um/s)/V, um/(s V), m/s^2/V, um/s."""
_VELOCITY, _DISPLACEMENT = 'velocity', 'displacement'
_NUMBERS = ('frequency', 'magnitude', 'phase', *_SIDE_UNITS)
"""The columns that hold numbers."""
_AS_WRITTEN = {'hz': 'Hz', 'khz': 'kHz', 'v': 'V', 'mv': 'mV', 'uv': 'uV', 'µv': 'µV'}
_RANGES = {
    'coherence': (0.0, 1.0, 'from 0 to 1 (or in [%])'),
    'averages': (1.0, 2.0**53, 'a whole number from 1 on'),
    'amplitude': (0.0, np.inf, 'not negative'),
    'hold': (0.0, np.inf, 'not negative'),
}
"""Lowest and highest value of the other columns, and what is allowed in words."""
_LINEAR_MISS, _DECIBEL_MISS = 1.0, 0.3
"""
By how much slopes must miss the phase if linear, and may miss it if in dB, for a magnitude to be taken for one in dB.

Of 1500 random plants 2 were rejected by these though linear, and half of those in dB found.
"""
_LEAST_POINTS, _LEAST_SPAN, _PARTS = 12, 2.0, 12
"""Points and ratio of highest to lowest frequency from which on slopes are compared, and in how many parts."""
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

    Examples
    --------
    >>> import numpy as np
    >>> from hdd_servo_ros.bench import FrequencyResponse
    >>> frequency = np.array([100.0, 200.0, 400.0])
    >>> measured = FrequencyResponse.of(frequency, -4.0968e7 / (2.0 * np.pi * frequency) ** 2)
    >>> measured.between(150.0, 500.0).frequency.tolist()
    [200.0, 400.0]
    >>> [f'{value:.4g} um/V' for value in abs(measured.response)]
    ['103.8 um/V', '25.94 um/V', '6.486 um/V']
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
            np.where(self.by_velocity, _VELOCITY, _DISPLACEMENT),
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
    ``coherence`` (or [%]), ``averages``, ``amplitude [V]`` (or mV, uV), ``hold [s]`` (or ms, us, ns), ``output``
    (``velocity`` where that was read). Without such a line the first three columns are frequency [Hz], linear magnitude
    and phase [deg]. Lines that begin with ``#`` are comments. The rows may come in any order.

    A magnitude in a unit of velocity or acceleration, such as um/s/V, is divided by j 2 pi f, once or twice, so that
    the response is that of the position, in um/V.

    A magnitude without a unit whose slope agrees with its phase only if it is in dB is rejected, and so is a phase
    without a unit that agrees with the slope only if it is in rad.

    Raises
    ------
    ValueError
        If the file holds no such table; the message names the file and the line.

    Examples
    --------
    >>> from pathlib import Path
    >>> from hdd_servo_ros.bench import FrequencyResponse, read_csv
    >>> path = Path('response.csv')
    >>> FrequencyResponse.of([100.0, 200.0], [-100.0, -25.0]).write_csv(path)
    >>> read_csv(path).response.round(9).tolist()
    [(-100+0j), (-25+0j)]
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
            name: np.array([_cell(row, index, name, number) for number, row in lines])
            for name, (index, _) in columns.items()
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
    """Return index and unit of each named column."""
    found: dict[str, tuple[int, str]] = {}
    for index, title in enumerate(header):
        match = re.fullmatch(r'([^\[(]*)(?:[\[(](.*)[\])])?', title)
        name, unit = (match[1].strip().lower(), (match[2] or '').strip()) if match else (title, '')
        name = _NAMES.get(name, name)
        if name in found and name in _NUMBERS:
            raise ValueError(f'{path}: two columns are {name}: {header[found[name][0]]!r} and {title!r}')
        # Of the response the unit is kept as it is written.
        found.setdefault(name, (index, unit if name == 'magnitude' else unit.lower()))
    for name in ('frequency', 'magnitude', 'phase'):
        if name not in found:
            raise ValueError(f'{path}: no column {name!r}; there are {shown(", ".join(header))}')
    for name, units in {'frequency': _FREQUENCY_UNITS, 'phase': _PHASE_UNITS, **_SIDE_UNITS}.items():
        if name in found and found[name][1] not in units:
            known = ', '.join(_AS_WRITTEN.get(unit, unit) for unit in units if unit)
            raise ValueError(f'{path}: the unit of {name} is {shown(found[name][1])}; known are {known}')
    return found


def _cell(row: Sequence[str], index: int, name: str, number: int) -> float:
    text = row[index] if index < len(row) else ''
    if name in _NUMBERS:
        if not _is_number(text) or not np.isfinite(float(text)):
            raise ValueError(f'line {number}: {name} is {shown(text)}, not a finite number')
        return float(text)
    if name == 'output' and text.lower() not in (_VELOCITY, _DISPLACEMENT):
        raise ValueError(f'line {number}: output is {text!r}, neither {_VELOCITY} nor {_DISPLACEMENT}')
    return float(name == 'output' and text.lower() == _VELOCITY)


def _response(
    table: Mapping[str, Array], units: Mapping[str, str], numbers: Sequence[int], path: Path
) -> FrequencyResponse:
    """Return the response of the columns; ``numbers`` are the lines of the rows in the file."""
    _check_side_columns(table, units, numbers, path)
    table = {
        name: column * _SIDE_UNITS[name][units.get(name, '')] if name in _SIDE_UNITS else column
        for name, column in table.items()
    }
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
    for index in np.flatnonzero(np.diff(frequency[order]) == 0.0)[:1]:
        first, second = order[index], order[index + 1]
        raise ValueError(
            f'{path}, line {numbers[second]}: frequency {table["frequency"][second]:.12g} is that of line '
            f'{numbers[first]} already; each may be given once'
        )
    if not units['phase'] and _looks_like_radians(frequency[order], magnitude[order], table['phase'][order]):
        raise ValueError(
            f'{path}: the phase is what the slope of the magnitude says only if it is in rad; write its unit in the '
            'header: phase [rad], or phase [deg]'
        )
    if not units['magnitude'] and _looks_like_decibels(frequency[order], magnitude[order], phase[order]):
        raise ValueError(
            f'{path}: the magnitude falls with frequency as its phase says only if it is in dB; write its unit in the '
            'header: [dB], or that of a linear magnitude, such as [um/V]'
        )
    unit, derivatives = _of_position(units['magnitude'][decibel.end() :] if decibel else units['magnitude'])
    response = magnitude * np.exp(1j * phase) / (2j * np.pi * frequency) ** derivatives
    holds = set(table.get('hold', np.zeros(1)).tolist())
    if len(holds) > 1:
        raise ValueError(f'{path}: the hold must be the same in all rows')
    reject_hold(max(holds), float(frequency.max()), str(path))
    ones = np.ones(len(frequency))
    return FrequencyResponse(
        frequency[order],
        np.asarray(response, dtype=np.complex128)[order],
        table.get('coherence', ones)[order],
        table.get('amplitude', 0.0 * ones)[order],
        np.rint(table.get('averages', ones)[order]).astype(np.int64),
        (table.get('output', 0.0 * ones)[order] != 0.0) | (derivatives > 0),
        holds.pop(),
        unit,
    )


def _of_position(unit: str) -> tuple[str, int]:
    """Return the unit of the position's response for one of its derivatives, and which derivative; 0 for none."""
    match = _RATE.fullmatch(unit.strip())
    if not match:
        return unit, 0
    length, square, over, other_square, below = match.groups()
    behind = f'/{below.strip()}' if below else (over or '').replace(' ', '')
    return f'{length}{behind}', 2 if square or other_square else 1


def _check_side_columns(
    table: Mapping[str, Array], units: Mapping[str, str], numbers: Sequence[int], path: Path
) -> None:
    """Reject a coherence, a number of averages, an amplitude or a hold that cannot be."""
    for name, (lowest, highest, allowed) in _RANGES.items():
        if name not in table:
            continue
        values = table[name] * _SIDE_UNITS[name][units.get(name, '')]
        # A coherence of 1 may be rounded up.
        wrong = (values < lowest) | (values > highest * (1.0 + 1e-9))
        if name == 'averages':
            wrong |= values != np.rint(values)
        for row in np.flatnonzero(wrong)[:1]:
            raise ValueError(f'{path}, line {numbers[row]}: {name} is {table[name][row]:g}; it must be {allowed}')
    if 'coherence' in table and not np.any(table['coherence']):
        raise ValueError(
            f'{path}: coherence is 0 in every row: the output has nothing to do with the input; leave the column out '
            'if it was not measured'
        )


def reject_hold(hold: float, highest: float, where: str) -> None:
    """
    Reject a hold that cannot be that of a response.

    Parameters
    ----------
    hold
        The hold [s].
    highest
        Highest frequency of the response [Hz].
    where
        The file.

    Raises
    ------
    ValueError
        If a frequency is above half the sampling rate that the hold is of.
    """
    if hold * highest > 0.5 * (1.0 + 1e-6):
        raise ValueError(
            f'{where}: hold is {hold:g} s, which is of frequencies up to {0.5 / hold:g} Hz, and there are some up to '
            f'{highest:g} Hz; its unit may be another: hold [s], [ms], [us] or [ns]'
        )


def _looks_like_decibels(frequency: Array, magnitude: Array, phase: Array) -> bool:
    """
    Return whether a magnitude agrees with its phase if it is in dB, and does not if it is linear.

    Where a response has no zeros on the right, its phase is about 90 degrees times its slope in a double logarithmic
    plot (Bode's relation); a delay adds to the phase, and both readings miss that alike.
    """
    misses = _misses(frequency, [np.log(magnitude), magnitude * (np.log(10.0) / 20.0)], [phase, phase])
    return misses is not None and _is_the_other(*misses)


def _looks_like_radians(frequency: Array, magnitude: Array, phase: Array) -> bool:
    """Return whether a phase agrees with the slope of its magnitude if it is in rad, and does not if in degrees."""
    misses = _misses(frequency, [np.log(magnitude)] * 2, [np.radians(phase), phase])
    return misses is not None and _is_the_other(*misses)


def _is_the_other(usual: float, other: float) -> bool:
    return usual > _LINEAR_MISS and other < min(_DECIBEL_MISS, 0.2 * usual)


def _misses(frequency: Array, logarithms: Sequence[Array], phases: Sequence[Array]) -> list[float] | None:
    """
    Return by how much the slope of readings of a response misses what their phase says, None where too little is known.

    Parameters
    ----------
    frequency
        Rising, shape (n,).
    logarithms
        Natural logarithm of the magnitude by each reading, shape (n,).
    phases
        Phase by each reading [rad], shape (n,).
    """
    if len(frequency) < _LEAST_POINTS or frequency[-1] < _LEAST_SPAN * frequency[0]:
        return None
    # Means over a few parts of the band, since noise outweighs the slope between two close points.
    parts = np.array_split(np.arange(len(frequency)), min(_PARTS, len(frequency) // 2))

    def between_parts(values: Array) -> Array:
        return np.diff([values[part].mean() for part in parts])

    steps = between_parts(np.log(frequency))
    misses = []
    for logarithm, phase in zip(logarithms, phases, strict=True):
        expected = np.array([np.unwrap(phase)[part].mean() for part in parts]) / (0.5 * np.pi)
        expected = 0.5 * (expected[1:] + expected[:-1])
        slope = between_parts(logarithm) / steps
        # The phase is known but for whole turns, which are four in the slope.
        turns = 4.0 * np.rint(np.median(slope - expected) / 4.0)
        misses.append(float(np.median(np.abs(slope - expected - turns))))
    return misses
