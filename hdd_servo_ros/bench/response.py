"""Measured frequency response, written by the signal analyzer and read by the identification."""

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
"""Conversion factors from the units of the other columns (in lower case) to those of :class:`FrequencyResponse`."""
_SEPARATORS = ';\t,'
_DECIBEL = re.compile(r'dB\b[ ,]*(re\b *)?', re.IGNORECASE)
_RATE = re.compile(r'\(?\s*([^/()]+?)\s*/\s*(?:s(\^?2|²)?\s*\)?(\s*/.+)?|\(\s*s(\^?2|²)?[\s*]+([^/()]+)\))')
"""Unit of velocity or acceleration per input unit, such as um/s/V, (um/s)/V, um/(s V), m/s^2/V, um/s."""
_VELOCITY, _DISPLACEMENT = 'velocity', 'displacement'
_NUMBERS = ('frequency', 'magnitude', 'phase', *_SIDE_UNITS)
"""Columns with numbers."""
_AS_WRITTEN = {'hz': 'Hz', 'khz': 'kHz', 'v': 'V', 'mv': 'mV', 'uv': 'uV', 'µv': 'µV'}
_RANGES = {
    'coherence': (0.0, 1.0, 'from 0 to 1 (or in [%])'),
    'averages': (1.0, 2.0**53, 'a whole number, at least 1'),
    'amplitude': (0.0, np.inf, 'not negative'),
    'hold': (0.0, np.inf, 'not negative'),
}
"""Lowest and highest value of the other columns, and the allowed values in words."""
_LINEAR_MISMATCH, _DECIBEL_MISMATCH = 1.0, 0.3
"""
Limits of the mismatch between slope and phase at which a magnitude is taken for one in dB.

The mismatch must exceed the first limit if the magnitude is read as linear, and be below the second if it is read as
dB. Among the responses of 1500 random plants, these limits rejected 2 that were linear and found half of those in dB.
"""
_LEAST_POINTS, _LEAST_SPAN, _PARTS = 12, 2.0, 12
"""Minimum points and frequency ratio for the comparison of slope and phase, and its number of parts of the band."""
_NAMES = {'gain': 'magnitude', 'freq': 'frequency', 'mag': 'magnitude'}


@dataclasses.dataclass(frozen=True)
class FrequencyResponse:
    """
    Frequency response at n frequencies.

    Attributes
    ----------
    frequency
        Frequencies in rising order [Hz], shape (n,).
    response
        Complex response, output over input, shape (n,); on this bench head displacement over drive voltage [um/V].
    coherence
        Coherence of input and output over the averages, shape (n,); 1 where it was not measured.
    amplitude
        Amplitude of the excitation [V], shape (n,); 0 where it is unknown.
    averages
        Number of records per point, shape (n,); with 1 the coherence is meaningless.
    by_velocity
        Whether the velocity output was measured and divided by j 2 pi f, shape (n,).
    hold
        Duration of the zero-order hold of the input, which the response includes [s]; 0 for no hold.
    unit
        Unit of the response; empty if it is unknown.

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
        """Mask of the points with a nonzero output, shape (n,); an output below the ADC step reads 0."""
        return np.asarray(self.response != 0.0)

    def at(self, kept: NDArray[np.bool_]) -> 'FrequencyResponse':
        """Return the response at the points selected by a mask of shape (n,)."""
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
        """Return a response without information about its measurement."""
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
        Return the relative standard deviation of each point, shape (n,), or None if it was not measured.

        With K records of coherence g^2, the mean of the complex responses has the relative variance
        (1/g^2 - 1)/(K - 1) (Bendat and Piersol, *Random Data*, section 9.2, for a known input).
        """
        if len(self.frequency) == 0 or self.averages.min() < 2:
            return None
        coherence = np.clip(self.coherence, 1e-12, 1.0)
        return np.asarray(np.sqrt((1.0 / coherence - 1.0) / (self.averages - 1.0)))

    def write_csv(self, path: Path) -> None:
        """Write a CSV file with one row per frequency and units in the header; numbers are written without loss."""
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
    Return the frequency response of a zero-order hold of ``hold`` [s] after a ``delay`` [s], at frequencies [Hz].

    A sampled response divided by it is the response of the continuous system, except for aliasing.
    """
    turns = np.asarray(frequency, dtype=np.float64)
    return np.asarray(np.sinc(turns * hold) * np.exp(-2j * np.pi * turns * (0.5 * hold + delay)))


def decibels(response: FrequencyResponse) -> Array:
    """Return the magnitude [dB], shape (n,)."""
    return np.asarray(20.0 * np.log10(np.abs(response.response)))


def degrees(response: FrequencyResponse) -> Array:
    """Return the unwrapped phase [deg], shape (n,); it starts at -180, not +180, for a double integrator."""
    values = np.degrees(np.unwrap(np.angle(response.response)))
    return np.asarray(values - 360.0 if values[0] > 90.0 else values)


def read_csv(path: Path) -> FrequencyResponse:
    """
    Read a frequency response from a CSV file.

    The columns are separated by commas, semicolons or tabs. The first line may name them, with units in brackets; case
    does not matter. The columns are ``frequency [Hz]`` (or kHz, rad/s), ``magnitude`` (linear or [dB]) and
    ``phase [deg]`` (or rad). Optional columns are ``coherence`` (or [%]), ``averages``, ``amplitude [V]`` (or mV, uV),
    ``hold [s]`` (or ms, us, ns) and ``output`` (``velocity`` where the velocity output was measured). Without a header
    the first three columns are frequency [Hz], linear magnitude and phase [deg]. Lines that start with ``#`` are
    comments. The rows may be in any order.

    A magnitude in a unit of velocity or acceleration, such as um/s/V, is divided by j 2 pi f once or twice, so the
    result is the response of the position, in um/V.

    A magnitude without a unit is rejected if its slope agrees with its phase only when it is read as dB. A phase
    without a unit is rejected if it agrees with the slope only when it is read as rad.

    Raises
    ------
    ValueError
        If the file does not contain such a table; the message names the file and the line.

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
        raise ValueError(f'{path} is not a CSV file: {error}') from None
    if lines and not _is_number(lines[0][1][0]):
        columns = _columns(lines.pop(0)[1], path)
    else:
        columns = {'frequency': (0, ''), 'magnitude': (1, ''), 'phase': (2, '')}
    if not lines:
        raise ValueError(f'{path} has no row of numbers')
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
            raise ValueError(f'{path} has two columns for {name}: {header[found[name][0]]!r} and {title!r}')
        # The unit of the response keeps its case.
        found.setdefault(name, (index, unit if name == 'magnitude' else unit.lower()))
    for name in ('frequency', 'magnitude', 'phase'):
        if name not in found:
            raise ValueError(f'{path} has no column {name!r}; its columns are {shown(", ".join(header))}')
    for name, units in {'frequency': _FREQUENCY_UNITS, 'phase': _PHASE_UNITS, **_SIDE_UNITS}.items():
        if name in found and found[name][1] not in units:
            known = ', '.join(_AS_WRITTEN.get(unit, unit) for unit in units if unit)
            raise ValueError(f'{path}: invalid unit of {name}: {shown(found[name][1])}; expected one of {known}')
    return found


def _cell(row: Sequence[str], index: int, name: str, number: int) -> float:
    text = row[index] if index < len(row) else ''
    if name in _NUMBERS:
        if not _is_number(text) or not np.isfinite(float(text)):
            raise ValueError(f'line {number}: invalid {name}: {shown(text)}; expected a finite number')
        return float(text)
    if name == 'output' and text.lower() not in (_VELOCITY, _DISPLACEMENT):
        raise ValueError(f'line {number}: invalid output: {text!r}; expected {_VELOCITY} or {_DISPLACEMENT}')
    return float(name == 'output' and text.lower() == _VELOCITY)


def _response(
    table: Mapping[str, Array], units: Mapping[str, str], numbers: Sequence[int], path: Path
) -> FrequencyResponse:
    """Return the response from the columns; ``numbers`` are the line numbers of the rows in the file."""
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
        raise ValueError(
            f'{path}, line {numbers[row]}: invalid frequency: {table["frequency"][row]:g}; expected above 0'
        )
    for row in np.flatnonzero(magnitude <= 0.0)[:1]:
        raise ValueError(
            f'{path}, line {numbers[row]}: invalid magnitude: {table["magnitude"][row]:g}; expected above 0; '
            'a magnitude in dB needs the unit [dB] in the header'
        )
    order = np.argsort(frequency, kind='stable')
    for index in np.flatnonzero(np.diff(frequency[order]) == 0.0)[:1]:
        first, second = order[index], order[index + 1]
        raise ValueError(
            f'{path}, line {numbers[second]}: duplicate frequency {table["frequency"][second]:.12g}, already in line '
            f'{numbers[first]}'
        )
    if not units['phase'] and _looks_like_radians(frequency[order], magnitude[order], table['phase'][order]):
        raise ValueError(
            f'{path}: the phase agrees with the slope of the magnitude only if it is in rad; add its unit to the '
            'header: phase [rad] or phase [deg]'
        )
    if not units['magnitude'] and _looks_like_decibels(frequency[order], magnitude[order], phase[order]):
        raise ValueError(
            f'{path}: the slope of the magnitude agrees with the phase only if it is in dB; add its unit to the '
            'header: [dB], or the unit of a linear magnitude, such as [um/V]'
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
    """Return the unit of the position response, and the order of the derivative that ``unit`` is for (0, 1 or 2)."""
    match = _RATE.fullmatch(unit.strip())
    if not match:
        return unit, 0
    length, square, over, other_square, below = match.groups()
    per_input = f'/{below.strip()}' if below else (over or '').replace(' ', '')
    return f'{length}{per_input}', 2 if square or other_square else 1


def _check_side_columns(
    table: Mapping[str, Array], units: Mapping[str, str], numbers: Sequence[int], path: Path
) -> None:
    """Reject an invalid coherence, number of averages, amplitude or hold."""
    for name, (lowest, highest, allowed) in _RANGES.items():
        if name not in table:
            continue
        values = table[name] * _SIDE_UNITS[name][units.get(name, '')]
        # The tolerance accepts a coherence of 1 that was rounded up.
        wrong = (values < lowest) | (values > highest * (1.0 + 1e-9))
        if name == 'averages':
            wrong |= values != np.rint(values)
        for row in np.flatnonzero(wrong)[:1]:
            raise ValueError(f'{path}, line {numbers[row]}: invalid {name}: {table[name][row]:g}; expected {allowed}')
    if 'coherence' in table and not np.any(table['coherence']):
        raise ValueError(
            f'{path}: coherence is 0 in every row, so the output is unrelated to the input; omit the column if the '
            'coherence was not measured'
        )


def reject_hold(hold: float, highest: float, where: str) -> None:
    """
    Reject a hold that is inconsistent with the frequencies of a response.

    Parameters
    ----------
    hold
        Duration of the hold [s].
    highest
        Highest frequency of the response [Hz].
    where
        File name, for the message.

    Raises
    ------
    ValueError
        If a frequency is above half the sampling rate, 1/hold.
    """
    if hold * highest > 0.5 * (1.0 + 1e-6):
        raise ValueError(
            f'{where}: a hold of {hold:g} s allows frequencies up to {0.5 / hold:g} Hz, but the highest frequency is '
            f'{highest:g} Hz; check the unit of the column: hold [s], [ms], [us] or [ns]'
        )


def _looks_like_decibels(frequency: Array, magnitude: Array, phase: Array) -> bool:
    """
    Return whether a magnitude agrees with its phase when read as dB, but not when read as linear.

    For a minimum-phase response, the phase is about 90 degrees times the slope in a log-log plot (Bode's relation). A
    delay adds to the phase; it affects both readings equally.
    """
    mismatches = _mismatches(frequency, [np.log(magnitude), magnitude * (np.log(10.0) / 20.0)], [phase, phase])
    return mismatches is not None and _is_other_reading(*mismatches)


def _looks_like_radians(frequency: Array, magnitude: Array, phase: Array) -> bool:
    """Return whether a phase agrees with the slope of its magnitude when read as rad, but not when read as degrees."""
    mismatches = _mismatches(frequency, [np.log(magnitude)] * 2, [np.radians(phase), phase])
    return mismatches is not None and _is_other_reading(*mismatches)


def _is_other_reading(usual: float, other: float) -> bool:
    return usual > _LINEAR_MISMATCH and other < min(_DECIBEL_MISMATCH, 0.2 * usual)


def _mismatches(frequency: Array, logarithms: Sequence[Array], phases: Sequence[Array]) -> list[float] | None:
    """
    Return the mismatch of slope and phase for each reading of a response, or None if the data do not suffice.

    Parameters
    ----------
    frequency
        Frequencies in rising order, shape (n,).
    logarithms
        Natural logarithm of the magnitude in each reading, shape (n,).
    phases
        Phase in each reading [rad], shape (n,).
    """
    if len(frequency) < _LEAST_POINTS or frequency[-1] < _LEAST_SPAN * frequency[0]:
        return None
    # Means over a few parts of the band, because noise dominates the slope between two neighboring points.
    parts = np.array_split(np.arange(len(frequency)), min(_PARTS, len(frequency) // 2))

    def between_parts(values: Array) -> Array:
        return np.diff([values[part].mean() for part in parts])

    steps = between_parts(np.log(frequency))
    mismatches = []
    for logarithm, phase in zip(logarithms, phases, strict=True):
        expected = np.array([np.unwrap(phase)[part].mean() for part in parts]) / (0.5 * np.pi)
        expected = 0.5 * (expected[1:] + expected[:-1])
        slope = between_parts(logarithm) / steps
        # The phase is known up to whole turns; one turn is 4 in the slope.
        turns = 4.0 * np.rint(np.median(slope - expected) / 4.0)
        mismatches.append(float(np.median(np.abs(slope - expected - turns))))
    return mismatches
