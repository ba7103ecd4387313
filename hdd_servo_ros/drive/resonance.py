"""
Head resonances: series sections, thesis eqs. (3.19), (5.2)-(5.5), or parallel modes, and their exact discretization.

The transfer function from the net force f [V] on the rigid body to the head position is k/s^2 * prod R_i(s) (series),
or k (1/s^2 + sum c_i / (s^2 + 2 xi_i w_i s + w_i^2)) (parallel). A drive without a rigid body is k times the sum alone
(modes). All are converted to the same modal form,

    y = R0 x + R1 v + sum of (beta_i q_i' + gamma_i q_i),    q_i'' + 2 xi_i w_i q_i' + w_i^2 q_i = k f,

where x and v are position and velocity of the rigid body, R0 is the product of the sections at s = 0 and R1 its
derivative there. Without a rigid body R0 = R1 = 0. For series sections R1 + sum beta_i = 0 (y'' is a bounded multiple
of f), so a step in f does not cause a step in the head velocity.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.numerics.elementary import TWO_PI, exp, sine_cosine_of_turns
from hdd_servo_ros.numerics.records import layout, record, size
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

FORMS = ('none', 'sections', 'two_parameter', 'parallel', 'modes')

MODE = layout(
    'a11',
    'a12',
    'a21',
    'a22',
    'position_of_q',
    'position_of_rate',
    'velocity_of_q',
    'velocity_of_rate',
    'half',
    'damped',
)
"""Constants of one mode in the plant kernel; see :func:`modal_arrays`."""

MODAL_ERROR = 1.0e-6
"""Largest accepted :func:`modal_error` of series sections."""


@dataclass(frozen=True)
class ResonanceParameters(ParameterSet):
    """
    Resonances between the rigid body and the head; the defaults are thesis eqs. (5.2)-(5.5).

    ``form`` selects the lists that are used. A parameter file can therefore change the form without emptying the lists
    of another form: ``sections`` uses numerators and denominators, ``two_parameter`` uses frequencies and damping
    ratios in series (eq. 3.19), ``parallel`` and ``modes`` use frequencies, damping ratios and signed residues. With
    ``modes`` the drive has no rigid body: its pivot is one of the modes, usually the first one, at a low frequency.

    Notes
    -----
    Source: thesis eqs. (3.19), (5.2) to (5.5).

    Examples
    --------
    One parallel mode:

    >>> from hdd_servo_ros.drive import ResonanceParameters
    >>> mode = ResonanceParameters(form='parallel', frequencies=(5000.0,), damping_ratios=(0.02,), residues=(-1.0,))
    >>> mode.frequencies
    (5000.0,)
    """

    form: str = parameter('sections', 'form in which the resonances are given', choices=FORMS)
    numerators: tuple[float, ...] = parameter(
        (0.9321, 678.3, 1.184e9, 0.8249, 2251.0, 1.665e9, 0.0, 0.0, 2.431e9, 0.0, 0.0, 8.383e9),
        'numerator coefficients b2, b1, b0 of each section (b2 s^2 + b1 s + b0)/(a2 s^2 + a1 s + a0), concatenated',
        unit='1, 1/s, 1/s^2',
        equation='5.2-5.5',
    )
    denominators: tuple[float, ...] = parameter(
        (1.0, 2053.0, 1.184e9, 1.0, 3276.0, 1.665e9, 1.0, 2703.0, 2.431e9, 1.0, 5655.0, 8.383e9),
        'denominator coefficients a2, a1, a0 of each section, concatenated',
        unit='1, 1/s, 1/s^2',
        equation='5.2-5.5',
    )
    frequencies: tuple[float, ...] = parameter((), 'natural frequency of each mode', unit='Hz', above=0.0)
    damping_ratios: tuple[float, ...] = parameter(
        (), 'damping ratio xi of each mode', above=0.0, maximum=0.999, equation='3.19'
    )
    residues: tuple[float, ...] = parameter(
        (), 'signed residue c of each mode of the forms parallel and modes; the rigid body of parallel has 1'
    )

    def check_together(self) -> None:
        """Check the lists of the selected form: not empty, equal lengths, stable sections, distinct poles."""
        if self.form == 'none':
            return
        first = 'numerators' if self.form == 'sections' else 'frequencies'
        if not getattr(self, first):
            raise ParameterError(
                first, (), f'a list that is not empty for resonance form {self.form} (form none has no resonance)'
            )
        if self.form == 'sections':
            self._check_lengths('denominators', len(self.numerators), 'as numerators')
            if len(self.numerators) % 3:
                raise ParameterError('numerators', self.numerators, 'three numbers b2, b1, b0 per section')
            for i in range(0, len(self.denominators), 3):
                a2, a1, a0 = self.denominators[i : i + 3]
                stable = a2 > 0.0 and a1 > 0.0 and a0 > 0.0
                if not stable or a1 * a1 >= 4.0 * a2 * a0:
                    raise ParameterError(
                        'denominators',
                        self.denominators,
                        f'a2, a1, a0 above 0 (stable) and a1^2 < 4 a2 a0 (underdamped) in section {i // 3 + 1}',
                    )
        else:
            self._check_lengths('damping_ratios', len(self.frequencies), 'as frequencies')
            if self.form in ('parallel', 'modes'):
                self._check_lengths('residues', len(self.frequencies), 'as frequencies')
        if self.form in ('sections', 'two_parameter'):
            error = modal_error(sections_of(self))
            if not error <= MODAL_ERROR:
                name = 'denominators' if self.form == 'sections' else 'frequencies'
                raise ParameterError(
                    name,
                    getattr(self, name),
                    'series sections with distinct poles; with poles this close the modal form has a relative error of '
                    f'{error:.1g}, above the limit of {MODAL_ERROR:g}',
                )

    @property
    def has_rigid_body(self) -> bool:
        """Whether the drive has a rigid body with the pole 1/s^2; the form ``modes`` has none."""
        return self.form != 'modes'

    def _check_lengths(self, name: str, length: int, like: str) -> None:
        values = getattr(self, name)
        if len(values) != length:
            raise ParameterError(name, values, f'a list of {length} numbers, as many {like}')


@dataclass(frozen=True)
class Section:
    """Underdamped series section (b2 s^2 + b1 s + b0)/(s^2 + a1 s + a0), with s in rad/s."""

    b2: float
    b1: float
    b0: float
    a1: float
    a0: float


@dataclass(frozen=True)
class Mode:
    """Mode (beta s + gamma)/(s^2 + a1 s + a0) of the modal form, with s in rad/s."""

    beta: float
    gamma: float
    a1: float
    a0: float


@dataclass(frozen=True)
class ModalForm:
    """Modal form of the head position: y = R0 x + R1 v + sum of the modes."""

    r0: float
    r1: float
    modes: tuple[Mode, ...]


def sections_of(parameters: ResonanceParameters) -> list[Section]:
    """Return the series sections of the forms ``sections`` and ``two_parameter``."""
    if parameters.form == 'sections':
        sections = []
        for i in range(0, len(parameters.numerators), 3):
            b2, b1, b0 = parameters.numerators[i : i + 3]
            a2, a1, a0 = parameters.denominators[i : i + 3]
            sections.append(Section(b2 / a2, b1 / a2, b0 / a2, a1 / a2, a0 / a2))
        return sections
    if parameters.form == 'two_parameter':
        sections = []
        for frequency, damping_ratio in zip(parameters.frequencies, parameters.damping_ratios, strict=True):
            w = TWO_PI * frequency
            sections.append(Section(0.0, 0.0, w * w, 2.0 * damping_ratio * w, w * w))
        return sections
    return []


def modal_form(parameters: ResonanceParameters) -> ModalForm:
    """Return the modal form of the resonances, whatever form they are given in."""
    if parameters.form in ('parallel', 'modes'):
        modes = []
        lists = zip(parameters.frequencies, parameters.damping_ratios, parameters.residues, strict=True)
        for frequency, damping_ratio, residue in lists:
            w = TWO_PI * frequency
            modes.append(Mode(0.0, residue, 2.0 * damping_ratio * w, w * w))
        return ModalForm(0.0 if parameters.form == 'modes' else 1.0, 0.0, tuple(modes))
    return partial_fractions(sections_of(parameters))


def partial_fractions(sections: Sequence[Section]) -> ModalForm:
    """Expand 1/s^2 times a product of sections with distinct poles into partial fractions."""
    r0 = 1.0
    r1 = 0.0
    for section in sections:
        value = section.b0 / section.a0
        slope = (section.b1 * section.a0 - section.b0 * section.a1) / (section.a0 * section.a0)
        r0, r1 = r0 * value, r1 * value + r0 * slope
    modes = []
    for i, section in enumerate(sections):
        pole = (-0.5 * section.a1, math.sqrt(section.a0 - 0.25 * section.a1 * section.a1))
        square = _multiply(pole, pole)
        residue = _divide(_numerator(section, pole, square), _multiply(square, (0.0, 2.0 * pole[1])))
        for j, other in enumerate(sections):
            if j != i:
                denominator = (square[0] + other.a1 * pole[0] + other.a0, square[1] + other.a1 * pole[1])
                residue = _multiply(residue, _divide(_numerator(other, pole, square), denominator))
        # r/(s - p) + r*/(s - p*) = (2 Re(r) s - 2 Re(r p*)) / (s^2 + a1 s + a0)
        gamma = -2.0 * (residue[0] * pole[0] + residue[1] * pole[1])
        modes.append(Mode(2.0 * residue[0], gamma, section.a1, section.a0))
    return ModalForm(r0, r1, tuple(modes))


# Complex numbers as pairs: the interpreter's C compiler may fuse the operations of ``complex``, so the results would
# depend on the processor.
def _multiply(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _divide(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    square = b[0] * b[0] + b[1] * b[1]
    return (a[0] * b[0] + a[1] * b[1]) / square, (a[1] * b[0] - a[0] * b[1]) / square


def _numerator(section: Section, s: tuple[float, float], square: tuple[float, float]) -> tuple[float, float]:
    return section.b2 * square[0] + section.b1 * s[0] + section.b0, section.b2 * square[1] + section.b1 * s[1]


def modal_error(sections: Sequence[Section]) -> float:
    """
    Return the relative error of the modal form of series sections with respect to their product.

    The residues of the modes grow without bound as poles approach each other, and cancel in the sum, which leaves
    rounding errors. The result is the largest error over these frequencies: a tenth of the slowest section's, those of
    the sections, the geometric means between neighbors, and three times the fastest section's. The error is relative
    to the product or to the rigid body, whichever is larger at that frequency. It is infinite for equal poles.
    """
    # The interpreter's complex numbers are safe here: the result only accepts or rejects parameters.
    try:
        modal = partial_fractions(sections)
    except ZeroDivisionError:
        return math.inf
    poles = sorted(math.sqrt(section.a0) for section in sections)
    between = [math.sqrt(a * b) for a, b in itertools.pairwise(poles)]
    errors = []
    for w in [0.1 * poles[0], *poles, *between, 3.0 * poles[-1]]:
        s = complex(0.0, w)
        square = s * s
        product = 1.0 + 0.0j
        for q in sections:
            product *= (q.b2 * square + q.b1 * s + q.b0) / (square + q.a1 * s + q.a0)
        shape = modal.r0 + modal.r1 * s
        for mode in modal.modes:
            shape += square * (mode.beta * s + mode.gamma) / (square + mode.a1 * s + mode.a0)
        errors.append(abs(shape - product) / max(abs(product), 1.0))
    return max(errors) if all(math.isfinite(error) for error in errors) else math.inf


def mode_transition(mode: Mode, time: float) -> tuple[float, float, float, float, float, float]:
    """
    Return the exact transition of (q, q') over ``time`` [s] under a constant acceleration.

    Returns
    -------
    tuple
        a11, a12, a21, a22, b1, b2 of q(t) = a11 q + a12 q' + b1 k f, q'(t) = a21 q + a22 q' + b2 k f.
    """
    half = 0.5 * mode.a1
    damped = math.sqrt(mode.a0 - half * half)
    decay = exp(-half * time)
    sine, cosine = sine_cosine_of_turns(damped * time / TWO_PI)
    a12 = decay * sine / damped
    a11 = decay * cosine + half * a12
    return a11, a12, -mode.a0 * a12, decay * cosine - half * a12, (1.0 - a11) / mode.a0, a12


def modal_arrays(
    modal: ModalForm, sample_time: float, substeps: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """
    Return the arrays of the modes for the plant kernel.

    Returns
    -------
    modes
        Transition over the sample time, weights of q and q' in the head position and velocity, decay rate [1/s] and
        damped angular frequency [rad/s]: one row in the layout :data:`MODE` per mode.
    responses
        (q, q') at the end of the sample for a unit acceleration during one substep only, with shape
        (substeps, modes, 2).
    """
    modes = np.zeros((len(modal.modes), size(MODE)))
    responses = np.zeros((substeps, len(modal.modes), 2))
    for i, mode in enumerate(modal.modes):
        row = record(modes, MODE, i)
        row.a11, row.a12, row.a21, row.a22, _, _ = mode_transition(mode, sample_time)
        row.position_of_q = mode.gamma
        row.position_of_rate = mode.beta
        row.velocity_of_q = -mode.beta * mode.a0
        row.velocity_of_rate = mode.gamma - mode.beta * mode.a1
        row.half = 0.5 * mode.a1
        row.damped = math.sqrt(mode.a0 - row.half * row.half)
        after = [mode_transition(mode, sample_time * (substeps - j) / substeps)[4:] for j in range(substeps)]
        after.append((0.0, 0.0))
        for j in range(substeps):
            responses[j, i] = after[j][0] - after[j + 1][0], after[j][1] - after[j + 1][1]
    return modes, responses
