"""Parameters of the feedforward from the accelerometers, which every controller's node has."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

METHODS = ('none', 'fixed', 'fxlms', 'iir', 'network')


@dataclasses.dataclass(frozen=True)
class FeedforwardModelParameters(ParameterSet):
    """What the feedforward knows of drive and sensors, as a data sheet or an identification gives it."""

    gain: float = parameter(4.0968e7, 'acceleration of the head per volt', unit='um/s^2/V', minimum=1.0, maximum=1e15)
    stiffness: float = parameter(
        0.02168, "stiffness of the pivot's friction in presliding", unit='V/um', minimum=0.0, maximum=1e3
    )
    viscous_coefficient: float = parameter(6.9e-6, 'viscous friction', unit='V s/um', minimum=0.0, maximum=1.0)
    arm_radius: float = parameter(50.8e3, 'distance from the pivot axis to the head', unit='um', minimum=0.0)
    imbalance: float = parameter(
        0.01, "acceleration of the head per linear acceleration of the base, from the arm's imbalance", minimum=0.0
    )
    sensitivity: float = parameter(
        0.0, 'volts per acceleration of the sensors; 0 takes that of accelerometer', unit='V s^2/m', minimum=0.0
    )
    separation: float = parameter(
        0.0, 'distance between the two sensors; 0 takes that of accelerometer', unit='m', minimum=0.0
    )


@dataclasses.dataclass(frozen=True)
class IirParameters(ParameterSet):
    """The recursive part of the method iir."""

    step_size: float = parameter(0.002, 'normalized step size of the two recursive weights', minimum=0.0, maximum=1.0)
    pole_radius: float = parameter(
        0.95, 'largest magnitude of the poles; the recursive weights are projected', above=0.0, maximum=0.999
    )


@dataclasses.dataclass(frozen=True)
class NetworkParameters(ParameterSet):
    """The network of the method network: radial basis functions of the linear part's output."""

    nodes: int = parameter(9, 'number of nodes', minimum=2, maximum=64, read_only=True)
    range: float = parameter(
        0.062,
        'the nodes lie evenly between minus and plus this voltage; they are as wide as they are apart',
        unit='V',
        above=0.0,
    )
    step_size: float = parameter(0.05, 'normalized step size of its weights', minimum=0.0, maximum=1.0)
    leakage: float = parameter(
        1e-6, 'part of the weights that leaks in a sample (sigma-modification)', minimum=0.0, maximum=0.1
    )
    maximum: float = parameter(0.5, 'largest magnitude of a weight (projection)', unit='V', above=0.0)


@dataclasses.dataclass(frozen=True)
class SupervisorParameters(ParameterSet):
    """What switches the feedforward off while it does harm."""

    enabled: bool = parameter(True, 'whether it may switch the feedforward off')
    averaging_time: float = parameter(0.3, 'time constant of the mean squares that it compares', unit='s', above=0.0)
    reaction_time: float = parameter(
        0.003, 'time constant of those by which it cuts off at once where the error has doubled', unit='s', above=0.0
    )
    tolerance: float = parameter(
        0.04, 'it switches off where the error is larger than without feedforward by more than this part', minimum=0.0
    )
    gain_wanted: float = parameter(
        0.05, 'it switches on again where the error would be smaller by more than this part', minimum=0.0, maximum=0.99
    )
    pause: float = parameter(
        0.5, 'shortest time off; twice as long after each time that it has to switch off again', unit='s', above=0.0
    )
    fade_time: float = parameter(0.005, 'time in which it fades the feedforward in', unit='s', above=0.0)


@dataclasses.dataclass(frozen=True)
class FeedforwardParameters(ParameterSet):
    """Parameters of :class:`hdd_servo_ros.control.feedforward.Feedforward`."""

    method: str = parameter(
        'none',
        'none; fixed: the model of drive and sensors alone; fxlms: taps adapted by the normalized filtered-x LMS '
        'algorithm; iir: the same with two recursive weights; network: the same with a radial basis network behind',
        choices=METHODS,
        read_only=True,
    )
    enabled: bool = parameter(True, 'whether it acts on the drive; it adapts in any case')
    taps: int = parameter(
        16, 'accelerations that it remembers, per channel', unit='samples', minimum=1, maximum=256, read_only=True
    )
    initial_gain: float = parameter(1.0, 'weight of the newest acceleration at tick 0, and to which the weights leak')
    lead: float = parameter(
        0.0,
        'time by which the initial weights lead the acceleration, against the lag of sensor and converter',
        unit='s',
        minimum=0.0,
        maximum=1e-3,
    )
    step_size: float = parameter(0.1, 'normalized step size of the taps', minimum=0.0, maximum=1.0)
    leakage: float = parameter(
        1e-5, 'part of the weights that leaks to the initial ones in a sample', minimum=0.0, maximum=0.1
    )
    regularization: float = parameter(1e-6, 'added to the power of the filtered acceleration', unit='um^2', above=0.0)
    power_time: float = parameter(0.3, 'time constant of that power', unit='s', above=0.0)
    error_limit: float = parameter(
        0.3, 'the adaptation takes a larger error for this one: a seek or a step is no vibration', unit='um', above=0.0
    )
    weight_limit: float = parameter(30.0, 'largest magnitude of a tap (projection)', above=0.0)
    control_limit: float = parameter(2.0, 'largest magnitude of the feedforward', unit='V', above=0.0)
    path_length: int = parameter(
        64,
        'samples for which the model of the path from the feedforward to the error is kept',
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
        """Whether there is a feedforward."""
        return self.method != 'none'

    def check_together(self) -> None:
        """Reject a path that cannot be summed in fours."""
        if self.path_length % 4:
            raise ParameterError('path_length', self.path_length, 'a multiple of 4')


@dataclasses.dataclass(frozen=True)
class ControllerFeedforwardParameters(ParameterSet):
    """The feedforward's parameters in every controller's node."""

    feedforward: FeedforwardParameters = group(FeedforwardParameters)
