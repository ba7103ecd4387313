"""The recorded runs that several figures and tables share, and the limits that the results are held to."""

import dataclasses

from hdd_servo_ros.campaign.case import Case

FILE = 'seagate_7200_10.yaml'
VIBRATION = 'mobile_rotational_vibration.yaml'
DELAY = 'one_sample_delay.yaml'
SHOCKS = {63.0: 'mobile_shock_35.yaml', 300.0: 'mobile_shock_25.yaml'}
"""Parameter files by the peak of their shock [G]."""
TRANSIENT = 2.0
"""Errors under vibration count from here on [s]."""
DURATION = 4.0
"""Of the recorded runs under vibration [s]."""
SHOCK_DURATION = 0.7
"""Of the recorded runs with a shock [s]."""
METHODS = ('none', 'fixed', 'fxlms', 'iir', 'network')
"""Of feedforward."""
CONTROLLERS = {'pid': 'PID', 'adaptive_nn': 'adaptive NN'}
"""Their names in figures and tables."""
GAINS = 'PID: k_p 0.627, k_i 61.6, k_d 1.39e-4, filter 3170 Hz, as in seagate_7200_10.yaml'
"""Which PID controller the tables are about."""
BANDWIDTHS = (1000.0, 3000.0)
"""Of the accelerometers [Hz]."""
GAIN_ERRORS = (-0.125, 0.125)
"""Of the accelerometers."""


@dataclasses.dataclass(frozen=True)
class Limits:
    """Range in which at least 95 % of the runs must be."""

    high: float
    low: float = 0.0
    unit: str = 'nm'

    def __str__(self) -> str:
        """Return the range as tables have it."""
        if self.low > 0.0:
            return f'{self.low:g} to {self.high:g} {self.unit}'
        return f'<= {self.high:g} {self.unit}'


NO_VIBRATION_LIMITS = Limits(6.0, 4.4)
"""PID without vibration, 3 sigma."""
VIBRATION_LIMITS = {
    ('none', 1000.0): Limits(83.0, 67.0),
    ('fixed', 1000.0): Limits(44.0, 36.0),
    ('fixed', 3000.0): Limits(22.0, 17.0),
    ('fxlms', 1000.0): Limits(9.0),
    ('fxlms', 3000.0): Limits(6.5),
}
"""PID in the rotational vibration, 3 sigma, by method and bandwidth."""


def method_of(controller: str) -> str:
    """Return the override's name that chooses a controller's method of feedforward."""
    return f'{controller}_controller:feedforward.method'


def _vibration(controller: str, method: str, name: str = 'vibration', *overlays: str, **others: object) -> Case:
    """Return a run in the rotational vibration; ``others`` are overrides, with ``__`` for the colon."""
    overrides = {key.replace('__', ':'): value for key, value in others.items()}
    return Case(
        f'{name}_{controller}_{method}',
        controller,
        (FILE, VIBRATION, *overlays),
        {'deterministic_timer:duration': DURATION, method_of(controller): method, **overrides},
    )


IN_VIBRATION = {
    controller: {method: _vibration(controller, method) for method in METHODS} for controller in CONTROLLERS
}
"""By controller and method, with the file's accelerometers: 1 kHz, gains too large by 12.5 %."""
NO_VIBRATION = {
    controller: dataclasses.replace(
        _vibration(controller, 'none', 'still'),
        overrides={
            **_vibration(controller, 'none').overrides,
            'disturbance_generator:vibration.rotational.enabled': False,
        },
    )
    for controller in CONTROLLERS
}
"""The same without vibration and feedforward, by controller."""
DELAYED = {controller: _vibration(controller, 'fxlms', 'delay', DELAY) for controller in CONTROLLERS}
"""In the vibration with one sample of computation delay and the gains that are tuned for it."""
HARD_MOUNT = {
    controller: Case(
        f'hard_mount_{controller}_network',
        controller,
        (FILE, VIBRATION),
        {
            **IN_VIBRATION[controller]['network'].overrides,
            # The force is 30 % larger at twice its rms value, which is 12.5 rad/s^2 * 50.8 mm / gain.
            'disturbance_generator:coupling.cubic': 0.075,
            'disturbance_generator:coupling.cubic_scale': 0.0155,
        },
    )
    for controller in CONTROLLERS
}
"""In the vibration over a hard mount."""


def _shock(controller: str, level: float, method: str) -> Case:
    return Case(
        f'shock_{level:g}_g_{controller}_{method}',
        controller,
        (FILE, SHOCKS[level]),
        {'deterministic_timer:duration': SHOCK_DURATION, method_of(controller): method},
    )


SHOCK = {
    level: {controller: {m: _shock(controller, level, m) for m in ('none', 'fixed')} for controller in CONTROLLERS}
    for level in SHOCKS
}
"""By level, controller and method."""
