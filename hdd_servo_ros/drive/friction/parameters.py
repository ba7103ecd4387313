"""Parameters of the friction models, and their layout for compiled code."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from hdd_servo_ros.numerics.records import layout, record, zeros
from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter


class FrictionModel(IntEnum):
    """Friction models, numbered for compiled code."""

    NONE = 0
    STICTION = 1
    TANGENTIAL_STIFFNESS = 2
    COULOMB = 3
    VISCOUS = 4
    COULOMB_VISCOUS = 5
    DRAG = 6
    EXPONENTIAL = 7
    GAUSSIAN = 8
    GAUSSIAN_TWO_BREAKS = 9
    GAUSSIAN_TWO_BREAKS_OFFSETS = 10
    TUSTIN = 11
    SQUARE_ROOT = 12
    LORENTZIAN = 13
    LORENTZIAN_TWO_BREAKS = 14
    LORENTZIAN_TWO_BREAKS_OFFSETS = 15
    COMPLETE = 16
    DAHL = 17
    LUGRE = 18
    LUGRE_POSITION = 19
    RBF_NETWORK = 20


MODELS = tuple(model.name.lower() for model in FrictionModel)
"""Names of the friction models: the values of the parameter ``model``."""

STRIBECK_MODELS = (
    'exponential',
    'gaussian',
    'gaussian_two_breaks',
    'gaussian_two_breaks_offsets',
    'tustin',
    'lorentzian',
    'lorentzian_two_breaks',
    'lorentzian_two_breaks_offsets',
    'lugre',
    'lugre_position',
)
"""Models with a Stribeck term, whose friction decreases from f_s to f_c with speed."""

FRICTION = layout(
    'model',
    'stiffness',
    'bristle_damping',
    'viscous_coefficient',
    'coulomb_level',
    'static_level',
    'inverse_stribeck_velocity',
    'stribeck_exponent',
    'second_break_level',
    'inverse_second_stribeck_velocity',
    'first_offset_velocity',
    'second_offset_velocity',
    'drag_coefficient',
    'square_root_coefficient',
    'dead_band_velocity',
    'dahl_exponent',
    'position_ripple',
    'inverse_position_period',
    'bristle_limit',
    'inverse_position_width',
    'inverse_velocity_width',
)
"""Friction constants of the kernels: the parameters, with divisors stored as their inverse."""


@dataclass(frozen=True)
class FrictionParameters(ParameterSet):
    """
    Pivot friction; each model uses only the parameters in its equation.

    The default is the LuGre model, calibrated to the low-frequency responses in thesis figs. 2.3 and 5.4, because the
    thesis gives no friction parameters in volts and micrometers; see ``docs/results/validation.md``. The units are
    those of the default drive.

    Notes
    -----
    Source: thesis eqs. (2.1) to (2.27).

    Examples
    --------
    >>> from hdd_servo_ros.drive import FrictionParameters
    >>> FrictionParameters(model='dahl', coulomb_level=0.1).stiffness
    0.02168
    >>> FrictionParameters(coulomb_level=0.2, static_level=0.1)
    Traceback (most recent call last):
        ...
    ParameterError: invalid value for parameter static_level: 0.1; expected at least coulomb_level, which is 0.2 [V]
    """

    model: str = parameter('lugre', 'friction model', choices=MODELS)
    stiffness: float = parameter(
        0.02168,
        'presliding stiffness: LuGre bristle stiffness sigma_0, Dahl stiffness sigma, or tangential stiffness f_t',
        unit='V/um',
        above=0.0,
        equation='2.2, 2.15, 2.20',
    )
    bristle_damping: float = parameter(2.3e-6, 'bristle damping sigma_1', unit='V s/um', minimum=0.0, equation='2.20')
    viscous_coefficient: float = parameter(
        4.6e-6,
        'viscous friction coefficient f_v, or sigma_2 of the LuGre model',
        unit='V s/um',
        minimum=0.0,
        equation='2.4, 2.20',
    )
    coulomb_level: float = parameter(0.13, 'Coulomb friction f_c', unit='V', above=0.0, equation='2.3')
    static_level: float = parameter(
        0.16, 'static (breakaway) friction f_s, at least f_c', unit='V', above=0.0, equation='2.1'
    )
    stribeck_velocity: float = parameter(300.0, 'Stribeck velocity v_s', unit='um/s', above=0.0, equation='2.6')
    stribeck_exponent: float = parameter(
        2.0, 'exponent delta of the Stribeck term', above=0.0, maximum=20.0, equation='2.6'
    )
    second_break_level: float = parameter(
        0.01,
        'height f_s2 of the second Stribeck term, in addition to f_s1 = f_s - f_c',
        unit='V',
        minimum=0.0,
        equation='2.8',
    )
    second_stribeck_velocity: float = parameter(
        3000.0, 'Stribeck velocity v_s2 of the second Stribeck term', unit='um/s', above=0.0, equation='2.8'
    )
    first_offset_velocity: float = parameter(
        0.0, 'velocity offset v_10 of the first Stribeck term', unit='um/s', minimum=0.0, equation='2.9'
    )
    second_offset_velocity: float = parameter(
        1000.0, 'velocity offset v_20 of the second Stribeck term', unit='um/s', minimum=0.0, equation='2.9'
    )
    drag_coefficient: float = parameter(
        1.0e-9, 'quadratic drag coefficient f_d', unit='V s^2/um^2', minimum=0.0, equation='2.5'
    )
    square_root_coefficient: float = parameter(
        1.0e-4,
        'coefficient f_r of the square-root term; a negative value bends the curve down',
        unit='V s^0.5/um^0.5',
        equation='2.11',
    )
    dead_band_velocity: float = parameter(
        0.0,
        'velocity dead band of the Karnopp model; a static model holds the body at rest below it',
        unit='um/s',
        minimum=0.0,
    )
    dahl_exponent: float = parameter(
        1.0, 'shape exponent alpha of the Dahl model', minimum=0.0, maximum=20.0, equation='2.15'
    )
    position_ripple: float = parameter(
        0.1,
        'relative ripple e over position in lugre_position: the friction g(v) in steady sliding is multiplied by '
        '1 + e sin(2 pi x/p)',
        minimum=0.0,
        maximum=0.99,
        equation='2.24',
    )
    position_period: float = parameter(
        10.0, 'period p of the friction ripple over position', unit='um', above=0.0, equation='2.24'
    )
    node_positions: tuple[float, ...] = parameter(
        (), 'positions mu_1 of the network node centers', unit='um', equation='2.25'
    )
    node_velocities: tuple[float, ...] = parameter(
        (), 'velocities mu_2 of the network node centers', unit='um/s', equation='2.25'
    )
    node_weights: tuple[float, ...] = parameter((), 'network weights W', unit='V', equation='2.26')
    position_width: float = parameter(
        5.0, 'width of the network nodes over position', unit='um', above=0.0, equation='2.25'
    )
    velocity_width: float = parameter(
        2000.0, 'width of the network nodes over velocity', unit='um/s', above=0.0, equation='2.25'
    )

    def check_together(self) -> None:
        """Check the combinations of parameters that the selected model requires."""
        if self.model in STRIBECK_MODELS and self.static_level < self.coulomb_level:
            raise ParameterError(
                'static_level', self.static_level, f'at least coulomb_level, which is {self.coulomb_level:g} [V]'
            )
        if self.model in ('square_root', 'complete') and self.square_root_coefficient < 0.0:
            # f_c + f_r sqrt(v) + f_v v is positive for every v if its discriminant is negative.
            limit = -2.0 * (self.coulomb_level * self.viscous_coefficient) ** 0.5
            if self.square_root_coefficient < limit:
                raise ParameterError(
                    'square_root_coefficient',
                    self.square_root_coefficient,
                    f'at least -2 sqrt(coulomb_level * viscous_coefficient) = {limit:g}, so that friction dissipates',
                )
        if self.model == 'rbf_network':
            nodes = len(self.node_weights)
            if nodes == 0:
                raise ParameterError(
                    'node_weights',
                    (),
                    'a list that is not empty for friction model rbf_network (model none has no friction)',
                )
            for name in ('node_positions', 'node_velocities'):
                if len(getattr(self, name)) != nodes:
                    raise ParameterError(
                        name, getattr(self, name), f'a list of {nodes} numbers, as many as node_weights'
                    )


def bristle_limit(parameters: FrictionParameters) -> float:
    """Return the bound 1/alpha_min of lemma 4.1 on the LuGre bristle deflection [um]."""
    limit = parameters.static_level / parameters.stiffness
    return limit * (1.0 + parameters.position_ripple) if parameters.model == 'lugre_position' else limit


def friction_constants(parameters: FrictionParameters) -> npt.NDArray[np.float64]:
    """Return the friction constants of the kernels, in the layout :data:`FRICTION`."""
    constants = zeros(FRICTION)
    friction = record(constants, FRICTION)
    friction.model = MODELS.index(parameters.model)
    friction.stiffness = parameters.stiffness
    friction.bristle_damping = parameters.bristle_damping
    friction.viscous_coefficient = parameters.viscous_coefficient
    friction.coulomb_level = parameters.coulomb_level
    friction.static_level = parameters.static_level
    friction.inverse_stribeck_velocity = 1.0 / parameters.stribeck_velocity
    friction.stribeck_exponent = parameters.stribeck_exponent
    friction.second_break_level = parameters.second_break_level
    friction.inverse_second_stribeck_velocity = 1.0 / parameters.second_stribeck_velocity
    friction.first_offset_velocity = parameters.first_offset_velocity
    friction.second_offset_velocity = parameters.second_offset_velocity
    friction.drag_coefficient = parameters.drag_coefficient
    friction.square_root_coefficient = parameters.square_root_coefficient
    friction.dead_band_velocity = parameters.dead_band_velocity
    friction.dahl_exponent = parameters.dahl_exponent
    friction.position_ripple = parameters.position_ripple
    friction.inverse_position_period = 1.0 / parameters.position_period
    friction.bristle_limit = bristle_limit(parameters)
    friction.inverse_position_width = 1.0 / parameters.position_width
    friction.inverse_velocity_width = 1.0 / parameters.velocity_width
    return constants


def friction_nodes(parameters: FrictionParameters) -> npt.NDArray[np.float64]:
    """Return position [um], velocity [um/s] and weight [V] of the network nodes, shape (n, 3); n = 0 without nodes."""
    if parameters.model != 'rbf_network':
        return np.zeros((0, 3))
    return np.column_stack((parameters.node_positions, parameters.node_velocities, parameters.node_weights))
