"""Parameters of the cancellation of repeatable runout, common to all controller nodes."""

import dataclasses

from hdd_servo_ros.parameters import ParameterError, ParameterSet, group, parameter

METHODS = ('none', 'harmonics', 'repetitive')


@dataclasses.dataclass(frozen=True)
class RunoutModelParameters(ParameterSet):
    """Drive model from which the response of the error to the cancellation is computed."""

    gain: float = parameter(4.0968e7, 'acceleration of the head per volt', unit='um/s^2/V', minimum=1.0, maximum=1e15)
    stiffness: float = parameter(
        0.02168, 'presliding stiffness of the pivot friction', unit='V/um', minimum=0.0, maximum=1e3
    )
    viscous_coefficient: float = parameter(
        6.9e-6, 'viscous friction coefficient', unit='V s/um', minimum=0.0, maximum=1.0
    )
    numerators: tuple[float, ...] = parameter(
        (0.9321, 678.3, 1.184e9, 0.8249, 2251.0, 1.665e9, 0.0, 0.0, 2.431e9, 0.0, 0.0, 8.383e9),
        'b2, b1, b0 of the resonances (b2 s^2 + b1 s + b0)/(a2 s^2 + a1 s + a0) in series; empty for none',
        unit='1, 1/s, 1/s^2',
    )
    denominators: tuple[float, ...] = parameter(
        (1.0, 2053.0, 1.184e9, 1.0, 3276.0, 1.665e9, 1.0, 2703.0, 2.431e9, 1.0, 5655.0, 8.383e9),
        'a2, a1, a0 of the resonances, as many as numerators',
        unit='1, 1/s, 1/s^2',
    )

    def check_together(self) -> None:
        """Check that the lists have equal lengths and describe stable resonances."""
        if len(self.numerators) % 3:
            raise ParameterError('numerators', self.numerators, 'three numbers b2, b1, b0 per resonance')
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
        'none; harmonics: adaptive feedforward cancellation with a sine and a cosine per element of orders; '
        'repetitive: repetitive control with one value per servo sector',
        choices=METHODS,
        read_only=True,
    )
    enabled: bool = parameter(True, 'apply the cancellation and learn; false keeps the learned cancellation')
    learning: bool = parameter(True, 'continue to learn while the cancellation is applied')
    revolutions_per_minute: float = parameter(
        7200.0, 'speed of the spindle', unit='1/min', minimum=100.0, maximum=1e6, read_only=True
    )
    sectors: int = parameter(
        0,
        'samples per revolution; 0 uses the integer nearest to 60/(revolutions_per_minute T); repetitive needs an '
        'exact number',
        minimum=0,
        maximum=1_000_000,
        read_only=True,
    )
    orders: tuple[int, ...] = parameter(
        (1, 2, 3),
        'harmonics: canceled multiples of the spindle speed, below half the sampling frequency',
        minimum=1,
        element=int,
        read_only=True,
    )
    gain: float = parameter(
        0.04,
        'fraction of the repeatable error that is learned per revolution after the larger initial gains have decayed',
        above=0.0,
        maximum=1.0,
    )
    initial_gain: float = parameter(
        0.3,
        'harmonics: largest such fraction in the first revolutions; the more orders, the less the loop tolerates',
        above=0.0,
        maximum=1.0,
    )
    cutoff: float = parameter(
        2000.0,
        'repetitive: frequency at which the zero-phase learning filter has decreased to half; 0 for no filter',
        unit='Hz',
        minimum=0.0,
    )
    wait: int = parameter(1, 'revolutions before learning starts', minimum=0, maximum=1_000_000)
    error_limit: float = parameter(0.3, 'bound on the magnitude of the error in learning', unit='um', above=0.0)
    control_limit: float = parameter(1.0, 'largest magnitude of the cancellation', unit='V', above=0.0)
    model: RunoutModelParameters = group(RunoutModelParameters)

    @property
    def is_used(self) -> bool:
        """Whether a cancellation is selected."""
        return self.method != 'none'

    def check_together(self) -> None:
        """Reject the method harmonics without orders, and repeated orders."""
        if not self.orders or len(set(self.orders)) != len(self.orders):
            raise ParameterError('orders', self.orders, 'at least one order, without repetition')


@dataclasses.dataclass(frozen=True)
class ControllerRunoutParameters(ParameterSet):
    """Parameters of the cancellation in every controller node."""

    runout: RunoutParameters = group(RunoutParameters)
