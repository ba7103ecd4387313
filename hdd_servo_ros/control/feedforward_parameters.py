"""Parameters of the feedforward from the accelerometers, common to all controller nodes."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

METHODS = ('none', 'fixed', 'fxlms', 'iir', 'network')


@dataclasses.dataclass(frozen=True)
class FeedforwardModelParameters(ParameterSet):
    """Model of drive and sensors in the feedforward, from a data sheet or an identification."""

    gain: float = parameter(4.0968e7, 'acceleration of the head per volt', unit='um/s^2/V', minimum=1.0, maximum=1e15)
    stiffness: float = parameter(
        0.02168, 'presliding stiffness of the pivot friction', unit='V/um', minimum=0.0, maximum=1e3
    )
    viscous_coefficient: float = parameter(
        6.9e-6, 'viscous friction coefficient', unit='V s/um', minimum=0.0, maximum=1.0
    )
    arm_radius: float = parameter(50.8e3, 'distance from the pivot axis to the head', unit='um', minimum=0.0)
    imbalance: float = parameter(
        0.01,
        'acceleration of the head per linear acceleration of the base, due to arm imbalance',
        minimum=0.0,
    )
    sensitivity: float = parameter(
        0.0, 'sensitivity of the sensors; 0 uses that of accelerometer', unit='V s^2/m', minimum=0.0
    )
    separation: float = parameter(
        0.0, 'distance between the two sensors; 0 uses that of accelerometer', unit='m', minimum=0.0
    )


@dataclasses.dataclass(frozen=True)
class IirParameters(ParameterSet):
    """Parameters of the recursive part, with method iir."""

    step_size: float = parameter(0.002, 'normalized step size of the two recursive weights', minimum=0.0, maximum=1.0)
    pole_radius: float = parameter(
        0.95, 'largest magnitude of the poles, to which the recursive weights are projected', above=0.0, maximum=0.999
    )


@dataclasses.dataclass(frozen=True)
class NetworkParameters(ParameterSet):
    """Parameters of the radial basis network of the linear part's output, with method network."""

    nodes: int = parameter(9, 'number of nodes', minimum=2, maximum=64, read_only=True)
    range: float = parameter(
        0.062,
        'range of the equidistant nodes, from minus to plus this voltage; their width equals their distance',
        unit='V',
        above=0.0,
    )
    step_size: float = parameter(0.05, 'normalized step size of the network weights', minimum=0.0, maximum=1.0)
    leakage: float = parameter(1e-6, 'leakage of the weights per sample (sigma-modification)', minimum=0.0, maximum=0.1)
    maximum: float = parameter(0.5, 'largest magnitude of a weight (projection)', unit='V', above=0.0)


@dataclasses.dataclass(frozen=True)
class SupervisorParameters(ParameterSet):
    """Parameters of the supervisor, which switches the feedforward off while it increases the error."""

    enabled: bool = parameter(True, 'enable the supervisor')
    averaging_time: float = parameter(0.3, 'time constant of the compared mean squares', unit='s', above=0.0)
    reaction_time: float = parameter(
        0.003, 'time constant of the mean squares for the immediate switch-off at twice the error', unit='s', above=0.0
    )
    tolerance: float = parameter(
        0.04, 'relative increase of the error by the feedforward above which it is switched off', minimum=0.0
    )
    gain_wanted: float = parameter(
        0.05,
        'expected relative reduction of the error above which the feedforward is switched on again',
        minimum=0.0,
        maximum=0.99,
    )
    pause: float = parameter(0.5, 'shortest time off; doubled after each further switch-off', unit='s', above=0.0)
    fade_time: float = parameter(0.005, 'time over which the feedforward is faded in', unit='s', above=0.0)


@dataclasses.dataclass(frozen=True)
class FeedforwardParameters(ParameterSet):
    """Parameters of :class:`hdd_servo_ros.control.feedforward.Feedforward`."""

    method: str = parameter(
        'none',
        'none; fixed: model of drive and sensors; fxlms: taps adapted by the normalized filtered-x LMS algorithm; '
        'iir: fxlms with two recursive weights; network: fxlms followed by a radial basis network',
        choices=METHODS,
        read_only=True,
    )
    enabled: bool = parameter(True, 'apply the feedforward to the drive; it adapts in either case')
    taps: int = parameter(16, 'number of taps per channel', unit='samples', minimum=1, maximum=256, read_only=True)
    initial_gain: float = parameter(1.0, 'initial weight of the newest acceleration, toward which the weights leak')
    lead: float = parameter(
        0.0,
        'lead of the initial weights, against the delay of sensor and converter',
        unit='s',
        minimum=0.0,
        maximum=1e-3,
    )
    step_size: float = parameter(0.1, 'normalized step size of the taps', minimum=0.0, maximum=1.0)
    leakage: float = parameter(
        1e-5, 'leakage of the weights toward the initial ones per sample', minimum=0.0, maximum=0.1
    )
    regularization: float = parameter(1e-6, 'added to the power of the filtered acceleration', unit='um^2', above=0.0)
    power_time: float = parameter(0.3, 'time constant of the power of the filtered acceleration', unit='s', above=0.0)
    error_limit: float = parameter(
        0.3,
        'bound on the magnitude of the error in the adaptation, since seeks and steps are not vibration',
        unit='um',
        above=0.0,
    )
    weight_limit: float = parameter(30.0, 'largest magnitude of a tap, with projection', above=0.0)
    control_limit: float = parameter(2.0, 'largest magnitude of the feedforward', unit='V', above=0.0)
    path_length: int = parameter(
        64,
        'length of the modeled response from the feedforward to the error',
        unit='samples',
        minimum=8,
        maximum=1024,
        read_only=True,
    )
    model: FeedforwardModelParameters = group(FeedforwardModelParameters)
    iir: IirParameters = group(IirParameters)
    network: NetworkParameters = group(NetworkParameters)
    supervisor: SupervisorParameters = group(SupervisorParameters)

    @property
    def is_used(self) -> bool:
        """Whether a feedforward is selected."""
        return self.method != 'none'

    def check_together(self) -> None:
        """Reject a path length that is not a multiple of four, as the kernel needs."""
        if self.path_length % 4:
            raise ParameterError('path_length', self.path_length, 'a multiple of 4')


@dataclasses.dataclass(frozen=True)
class ControllerFeedforwardParameters(ParameterSet):
    """Parameters of the feedforward in every controller node."""

    feedforward: FeedforwardParameters = group(FeedforwardParameters)
