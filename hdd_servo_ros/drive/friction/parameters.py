"""Parameters of the friction models, and their order in compiled code."""

from dataclasses import dataclass

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

MODELS = (
    'none',
    'stiction',
    'tangential_stiffness',
    'coulomb',
    'viscous',
    'coulomb_viscous',
    'drag',
    'exponential',
    'gaussian',
    'gaussian_two_breaks',
    'gaussian_two_breaks_offsets',
    'tustin',
    'square_root',
    'lorentzian',
    'lorentzian_two_breaks',
    'lorentzian_two_breaks_offsets',
    'complete',
    'dahl',
    'lugre',
    'lugre_position',
    'rbf_network',
)
"""The friction models by name; a model's number in compiled code is its place in this list."""

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
"""The models whose friction falls from f_s to f_c."""

# The numbers of the models that have a step of their own; those of the static ones are in `static`.
NO_FRICTION = MODELS.index('none')
TANGENTIAL_STIFFNESS = MODELS.index('tangential_stiffness')
COMPLETE = MODELS.index('complete')
DAHL = MODELS.index('dahl')
LUGRE = MODELS.index('lugre')
LUGRE_POSITION = MODELS.index('lugre_position')
NETWORK = MODELS.index('rbf_network')

# Places in the friction's constants
MODEL = 0
STIFFNESS = 1
BRISTLE_DAMPING = 2
VISCOUS = 3
COULOMB = 4
STATIC = 5
INVERSE_STRIBECK = 6
STRIBECK_EXPONENT = 7
SECOND_BREAK = 8
SECOND_INVERSE_STRIBECK = 9
FIRST_OFFSET = 10
SECOND_OFFSET = 11
DRAG = 12
SQUARE_ROOT = 13
DEAD_BAND = 14
DAHL_EXPONENT = 15
RIPPLE = 16
INVERSE_PERIOD = 17
BRISTLE_LIMIT = 18
NODES = 19
INVERSE_POSITION_WIDTH = 20
INVERSE_VELOCITY_WIDTH = 21
NODE_CONSTANTS = 22
"""Here the nodes of the network begin: position, velocity and weight of each."""


@dataclass(frozen=True)
class FrictionParameters(ParameterSet):
    """
    Pivot friction; each model reads the parameters that its equation has.

    The default is the LuGre model calibrated to what figs. 2.3 and 5.4 say of the low-frequency responses (the thesis
    gives no friction parameters in volts and micrometres); see ``docs/drive.md``. The units are the default drive's.
    """

    model: str = parameter('lugre', 'friction model', choices=MODELS)
    stiffness: float = parameter(
        0.02168, 'bristle stiffness sigma_0 (2.20), sigma of Dahl (2.15), tangential f_t (2.2)', unit='V/um', above=0.0
    )
    bristle_damping: float = parameter(2.3e-6, 'bristle damping sigma_1 (2.20)', unit='V s/um', minimum=0.0)
    viscous_coefficient: float = parameter(
        4.6e-6, 'viscous friction f_v (2.4), sigma_2 (2.20)', unit='V s/um', minimum=0.0
    )
    coulomb_level: float = parameter(0.13, 'Coulomb friction f_c (2.3)', unit='V', above=0.0)
    static_level: float = parameter(0.16, 'static friction f_s (2.1), at least f_c', unit='V', above=0.0)
    stribeck_velocity: float = parameter(300.0, 'Stribeck velocity v_s (2.6)', unit='um/s', above=0.0)
    stribeck_exponent: float = parameter(2.0, 'exponent delta of (2.6)', above=0.0, maximum=20.0)
    second_break_level: float = parameter(
        0.01, 'f_s2 of two breaks (2.8), on top of f_s1 = f_s - f_c', unit='V', minimum=0.0
    )
    second_stribeck_velocity: float = parameter(3000.0, 'v_s2 of two breaks (2.8)', unit='um/s', above=0.0)
    first_offset_velocity: float = parameter(0.0, 'offset v_10 of the first break (2.9)', unit='um/s', minimum=0.0)
    second_offset_velocity: float = parameter(1000.0, 'offset v_20 of the second break (2.9)', unit='um/s', minimum=0.0)
    drag_coefficient: float = parameter(1.0e-9, 'drag f_d (2.5)', unit='V s^2/um^2', minimum=0.0)
    square_root_coefficient: float = parameter(
        1.0e-4, 'f_r of (2.11); below 0 it bends the curve down', unit='V s^0.5/um^0.5'
    )
    dead_band_velocity: float = parameter(
        0.0, "Karnopp's dead band: a static model holds the body at rest below it", unit='um/s', minimum=0.0
    )
    dahl_exponent: float = parameter(1.0, 'shape alpha of Dahl (2.15)', minimum=0.0, maximum=20.0)
    position_ripple: float = parameter(
        0.1, 'depth e of 1/alpha(x, v) = (1 + e sin(2 pi x/p))/alpha(v) (2.24)', minimum=0.0, maximum=0.99
    )
    position_period: float = parameter(10.0, 'period p of alpha(x, v) over position (2.24)', unit='um', above=0.0)
    node_positions: tuple[float, ...] = parameter((), 'centres mu_1 of the network (2.25)', unit='um')
    node_velocities: tuple[float, ...] = parameter((), 'centres mu_2 of the network (2.25)', unit='um/s')
    node_weights: tuple[float, ...] = parameter((), 'weights W of the network (2.26)', unit='V')
    position_width: float = parameter(5.0, 'width of the nodes over position (2.25)', unit='um', above=0.0)
    velocity_width: float = parameter(2000.0, 'width of the nodes over velocity (2.25)', unit='um/s', above=0.0)

    def check_together(self) -> None:
        """Check what the chosen model asks of several parameters."""
        if self.model in STRIBECK_MODELS and self.static_level < self.coulomb_level:
            raise ParameterError(
                'static_level', self.static_level, f'at least coulomb_level, which is {self.coulomb_level:g} [V]'
            )
        if self.model in ('square_root', 'complete') and self.square_root_coefficient < 0.0:
            # f_c + f_r sqrt(v) + f_v v stays positive for every v when its discriminant is negative.
            limit = -2.0 * (self.coulomb_level * self.viscous_coefficient) ** 0.5
            if self.square_root_coefficient < limit:
                raise ParameterError(
                    'square_root_coefficient',
                    self.square_root_coefficient,
                    f'at least -2 sqrt(coulomb_level viscous_coefficient) = {limit:g}, so that friction dissipates',
                )
        if self.model == 'rbf_network':
            nodes = len(self.node_weights)
            if nodes == 0:
                raise ParameterError(
                    'node_weights', (), 'not empty with friction model rbf_network (model none has no friction)'
                )
            for name in ('node_positions', 'node_velocities'):
                if len(getattr(self, name)) != nodes:
                    raise ParameterError(
                        name, getattr(self, name), f'a list of {nodes} numbers, as many as node_weights'
                    )


def bristle_limit(parameters: FrictionParameters) -> float:
    """Return the bound 1/alpha_min [um] that lemma 4.1 puts on the LuGre bristle's deflection."""
    limit = parameters.static_level / parameters.stiffness
    return limit * (1.0 + parameters.position_ripple) if parameters.model == 'lugre_position' else limit


def friction_constants(parameters: FrictionParameters) -> list[float]:
    """Return the constants of the friction's kernels."""
    constants = [
        float(MODELS.index(parameters.model)),
        parameters.stiffness,
        parameters.bristle_damping,
        parameters.viscous_coefficient,
        parameters.coulomb_level,
        parameters.static_level,
        1.0 / parameters.stribeck_velocity,
        parameters.stribeck_exponent,
        parameters.second_break_level,
        1.0 / parameters.second_stribeck_velocity,
        parameters.first_offset_velocity,
        parameters.second_offset_velocity,
        parameters.drag_coefficient,
        parameters.square_root_coefficient,
        parameters.dead_band_velocity,
        parameters.dahl_exponent,
        parameters.position_ripple,
        1.0 / parameters.position_period,
        bristle_limit(parameters),
        float(len(parameters.node_weights)) if parameters.model == 'rbf_network' else 0.0,
        1.0 / parameters.position_width,
        1.0 / parameters.velocity_width,
    ]
    if parameters.model == 'rbf_network':
        nodes = zip(parameters.node_positions, parameters.node_velocities, parameters.node_weights, strict=True)
        for node in nodes:
            constants += node
    return constants
