"""Parameters of the seek part, common to all controller nodes."""

import dataclasses

from hdd_servo_ros.control.cnf import CnfParameters
from hdd_servo_ros.control.ptos import PtosParameters
from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

METHODS = ('none', 'final_state', 'ptos', 'cnf')
FRICTION_RANGES = ('seek', 'always')
_METHOD = (
    'none: a reference step goes to the controller unchanged; final_state: the head follows a trajectory of the '
    'sampled model to rest on the target (final-state control with two degrees of freedom); ptos: proximate '
    'time-optimal servomechanism; cnf: composite nonlinear feedback'
)


@dataclasses.dataclass(frozen=True)
class SeekModelParameters(ParameterSet):
    """Drive model for the planning of trajectories; the default is the drive of chapter 5."""

    gain: float = parameter(4.0968e7, 'acceleration of the head per volt', unit='um/s^2/V', minimum=1.0, maximum=1e15)
    viscous_coefficient: float = parameter(
        4.6e-6, 'viscous friction coefficient', unit='V s/um', minimum=0.0, maximum=1.0
    )
    numerators: tuple[float, ...] = parameter(
        (0.9321, 678.3, 1.184e9, 0.8249, 2251.0, 1.665e9, 0.0, 0.0, 2.431e9, 0.0, 0.0, 8.383e9),
        'b2, b1, b0 of the resonances (b2 s^2 + b1 s + b0)/(a2 s^2 + a1 s + a0), concatenated; empty for none',
        unit='1, 1/s, 1/s^2',
        read_only=True,
    )
    denominators: tuple[float, ...] = parameter(
        (1.0, 2053.0, 1.184e9, 1.0, 3276.0, 1.665e9, 1.0, 2703.0, 2.431e9, 1.0, 5655.0, 8.383e9),
        'a2, a1, a0 of the resonances, concatenated',
        unit='1, 1/s, 1/s^2',
        read_only=True,
    )
    mode_spread: float = parameter(
        0.05,
        'relative tolerance of the resonance frequencies, over which the residual vibration also stays small',
        minimum=0.0,
        maximum=0.2,
    )

    def check_together(self) -> None:
        """Reject incomplete, unstable or overdamped resonances, and resonances with zero static gain."""
        numerators, denominators = self.numerators, self.denominators
        if len(denominators) % 3:
            raise ParameterError('denominators', denominators, 'three numbers per resonance')
        if len(numerators) != len(denominators):
            allowed = f'as many numbers as denominators, which has {len(denominators)}'
            raise ParameterError('numerators', numerators, allowed)
        if not all(b0 > 0.0 for b0 in numerators[2::3]):
            raise ParameterError('numerators', numerators, 'b0 of each resonance above 0')
        for first in range(0, len(denominators), 3):
            a2, a1, a0 = denominators[first : first + 3]
            if not (a2 > 0.0 and a1 > 0.0 and a0 > 0.0 and a1 * a1 < 4.0 * a2 * a0):
                allowed = f'a2, a1, a0 of resonance {first // 3 + 1} above 0 and a1^2 < 4 a2 a0'
                raise ParameterError('denominators', denominators, allowed)


@dataclasses.dataclass(frozen=True)
class SeekFrictionParameters(ParameterSet):
    """Friction feedforward along the trajectory, LuGre model, thesis eqs. (2.20)-(2.22)."""

    enabled: bool = parameter(True, 'enable the friction feedforward')
    range: str = parameter(
        'seek',
        'seek: along the trajectory of a seek, then held; always: also along the reference while following, for a '
        'controller that does not compensate friction itself',
        choices=FRICTION_RANGES,
    )
    stiffness: float = parameter(0.02168, 'bristle stiffness sigma_0', unit='V/um', above=0.0)
    bristle_damping: float = parameter(2.3e-6, 'bristle damping sigma_1', unit='V s/um', minimum=0.0)
    coulomb_level: float = parameter(0.13, 'Coulomb friction f_c', unit='V', above=0.0)
    static_level: float = parameter(0.16, 'static (breakaway) friction f_s', unit='V', above=0.0)
    stribeck_velocity: float = parameter(300.0, 'Stribeck velocity v_s', unit='um/s', above=0.0)


@dataclasses.dataclass(frozen=True)
class SeekLearningParameters(ParameterSet):
    """Learning of gain and friction during a seek and from seek to seek."""

    gain: bool = parameter(True, 'estimate the gain of the drive during a seek, from measured velocity and voltage')
    gain_memory: float = parameter(
        0.5, 'weight of the previous seeks in the estimate of the gain', minimum=0.0, maximum=0.99
    )
    gain_range: float = parameter(
        0.3, 'largest relative deviation of the estimated gain from that of the model', minimum=0.0, maximum=0.9
    )
    friction: bool = parameter(True, 'learn the friction from the voltage that the controller adds after a seek')
    friction_rate: float = parameter(
        100.0, 'rate at which the learned friction follows this voltage', unit='1/s', minimum=0.0
    )
    friction_window: float = parameter(
        0.02, 'time after the end of the trajectory during which the friction is learned', unit='s', minimum=0.0
    )
    friction_range: float = parameter(
        0.5, 'largest relative deviation of the learned friction from that of the model', minimum=0.0, maximum=0.9
    )


@dataclasses.dataclass(frozen=True)
class SeekSwitchParameters(ParameterSet):
    """Conditions of the switch from PTOS or CNF to the controller."""

    distance: float = parameter(1.7, 'largest distance from the target at the switch', unit='um', above=0.0)
    velocity: float = parameter(1e4, 'largest velocity at the switch', unit='um/s', above=0.0)
    fade_time: float = parameter(
        1e-4,
        'time constant with which the difference of the two voltages decays, except for its constant part',
        unit='s',
        above=0.0,
    )


@dataclasses.dataclass(frozen=True)
class SeekParameters(ParameterSet):
    """Parameters of :class:`hdd_servo_ros.control.seek.Seek`."""

    method: str = parameter('none', _METHOD, choices=METHODS, read_only=True)
    threshold: float = parameter(0.05, 'smallest reference step that starts a seek', unit='um', above=0.0)
    control_limit: float = parameter(
        9.3,
        'largest voltage of a planned trajectory; the rest up to the limit of the drive is for feedback and friction',
        unit='V',
        above=0.0,
    )
    vibration_limit: float = parameter(
        0.03,
        'largest residual vibration of a trajectory on the nominal drive; a shorter trajectory leaves more',
        unit='um',
        above=0.0,
    )
    longest_plan: float = parameter(
        6.4e-3,
        'duration of the longest planned trajectory; a longer seek is made in several pieces',
        unit='s',
        minimum=1e-4,
        maximum=0.03,
        read_only=True,
    )
    arrival_tolerance: float = parameter(
        0.1, 'largest measured distance from the target on arrival', unit='um', above=0.0
    )
    arrival_samples: int = parameter(
        4, 'consecutive samples within arrival_tolerance after which a seek has arrived', unit='samples', minimum=1
    )
    model: SeekModelParameters = group(SeekModelParameters)
    friction: SeekFrictionParameters = group(SeekFrictionParameters)
    learning: SeekLearningParameters = group(SeekLearningParameters)
    switch: SeekSwitchParameters = group(SeekSwitchParameters)
    ptos: PtosParameters = group(PtosParameters)
    cnf: CnfParameters = group(CnfParameters)

    @property
    def is_used(self) -> bool:
        """Whether a seek method is selected."""
        return self.method != 'none'

    def check_together(self) -> None:
        """Reject a static friction below the Coulomb friction."""
        friction = self.friction
        if friction.static_level < friction.coulomb_level:
            raise ParameterError(
                'friction.static_level', friction.static_level, f'at least coulomb_level = {friction.coulomb_level:g} V'
            )


@dataclasses.dataclass(frozen=True)
class ControllerSeekParameters(ParameterSet):
    """Parameters of the seek part in every controller node."""

    seek: SeekParameters = group(SeekParameters)


@dataclasses.dataclass(frozen=True)
class SeekingParameters(SeekParameters):
    """The same parameters with a seek method by default."""

    method: str = parameter('final_state', _METHOD, choices=METHODS, read_only=True)


@dataclasses.dataclass(frozen=True)
class SeekControllerParameters(ControllerSeekParameters):
    """Parameters of the seek part in the node `seek_controller`."""

    seek: SeekParameters = group(SeekingParameters)
