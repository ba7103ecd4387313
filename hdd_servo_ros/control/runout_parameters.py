"""Parameters of the cancellation of repeatable runout, which every controller's node has."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

METHODS = ('none', 'harmonics', 'repetitive')


@dataclasses.dataclass(frozen=True)
class RunoutModelParameters(ParameterSet):
    """The model of the drive from which the response of the error to the cancellation is computed."""

    gain: float = parameter(4.0968e7, 'acceleration of the head per volt', unit='um/s^2/V', minimum=1.0, maximum=1e15)
    stiffness: float = parameter(
        0.02168, "stiffness of the pivot's friction in presliding", unit='V/um', minimum=0.0, maximum=1e3
    )
    viscous_coefficient: float = parameter(6.9e-6, 'viscous friction', unit='V s/um', minimum=0.0, maximum=1.0)
    numerators: tuple[float, ...] = parameter(
        (0.9321, 678.3, 1.184e9, 0.8249, 2251.0, 1.665e9, 0.0, 0.0, 2.431e9, 0.0, 0.0, 8.383e9),
        'b2, b1, b0 of each resonance (b2 s^2 + b1 s + b0)/(a2 s^2 + a1 s + a0) in series; empty for none',
        unit='1, 1/s, 1/s^2',
    )
    denominators: tuple[float, ...] = parameter(
        (1.0, 2053.0, 1.184e9, 1.0, 3276.0, 1.665e9, 1.0, 2703.0, 2.431e9, 1.0, 5655.0, 8.383e9),
        'a2, a1, a0 of each resonance, as many as numerators',
        unit='1, 1/s, 1/s^2',
    )

    def check_together(self) -> None:
        """Check that the lists have equal lengths and describe stable resonances."""
        if len(self.numerators) % 3:
            raise ParameterError('numerators', self.numerators, 'b2, b1, b0 of each resonance')
        if len(self.denominators) != len(self.numerators):
            allowed = f'{len(self.numerators)} numbers, as many as numerators'
            raise ParameterError('denominators', self.denominators, allowed)
        if any(not value > 0.0 for value in self.denominators):
            raise ParameterError('denominators', self.denominators, 'above 0, so that each resonance is stable')


@dataclasses.dataclass(frozen=True)
class RunoutParameters(ParameterSet):
    """Parameters of :class:`hdd_servo_ros.control.runout.RunoutCancellation`."""

    method: str = parameter(
        'none',
        'none; harmonics: adaptive feedforward cancellation, a sine and a cosine for each of orders; repetitive: '
        'repetitive control, one value for each servo sector',
        choices=METHODS,
        read_only=True,
    )
    enabled: bool = parameter(True, 'whether it acts on the drive and learns; what it has learned is kept')
    learning: bool = parameter(True, 'whether it goes on learning while it acts')
    revolutions_per_minute: float = parameter(
        7200.0, 'speed of the spindle', unit='1/min', minimum=100.0, maximum=1e6, read_only=True
    )
    sectors: int = parameter(
        0,
        'samples per revolution; 0 takes the whole number next to 60/(revolutions_per_minute T); repetitive needs it '
        'to be exact',
        minimum=0,
        maximum=1_000_000,
        read_only=True,
    )
    orders: tuple[int, ...] = parameter(
        (1, 2, 3),
        'harmonics: which multiples of the speed are canceled, below half the sampling frequency',
        minimum=1,
        element=int,
        read_only=True,
    )
    gain: float = parameter(
        0.04,
        'part of the repeatable error that is learned in a revolution once the initial, larger gains have decayed',
        above=0.0,
        maximum=1.0,
    )
    initial_gain: float = parameter(
        0.3,
        'harmonics: the same at most in the first revolutions; the more orders, the less the loop tolerates',
        above=0.0,
        maximum=1.0,
    )
    cutoff: float = parameter(
        2000.0,
        'repetitive: frequency at which the learning filter has fallen to half, without phase; 0 for none',
        unit='Hz',
        minimum=0.0,
    )
    wait: int = parameter(1, 'revolutions before it begins to learn', minimum=0, maximum=1_000_000)
    error_limit: float = parameter(0.3, 'a larger error counts as this one', unit='um', above=0.0)
    control_limit: float = parameter(1.0, 'largest magnitude of the cancellation', unit='V', above=0.0)
    model: RunoutModelParameters = group(RunoutModelParameters)

    @property
    def is_used(self) -> bool:
        """Whether there is a cancellation."""
        return self.method != 'none'

    def check_together(self) -> None:
        """Reject harmonics without orders, or with one twice."""
        if not self.orders or len(set(self.orders)) != len(self.orders):
            raise ParameterError('orders', self.orders, 'at least one order, each once')


@dataclasses.dataclass(frozen=True)
class ControllerRunoutParameters(ParameterSet):
    """The parameters of the cancellation in every controller's node."""

    runout: RunoutParameters = group(RunoutParameters)
