"""Recorded runs shared by several figures and tables, and limits for the results."""

import dataclasses

from hdd_servo_ros.campaign.case import Case

FILE = 'seagate_7200_10.yaml'
VIBRATION = 'mobile_rotational_vibration.yaml'
DELAY = 'one_sample_delay.yaml'
SHOCKS = {63.0: 'mobile_shock_35.yaml', 300.0: 'mobile_shock_25.yaml'}
"""Parameter files, by peak acceleration of the shock [g]."""
TRANSIENT = 2.0
"""Transient before the errors in vibration are evaluated [s]."""
DURATION = 4.0
"""Duration of the recorded runs in vibration [s]."""
SHOCK_DURATION = 0.7
"""Duration of the recorded runs with a shock [s]."""
METHODS = ('none', 'fixed', 'fxlms', 'iir', 'network')
"""Methods of feedforward."""
CONTROLLERS = {'pid': 'PID', 'adaptive_nn': 'adaptive NN'}
"""Names of the controllers in figures and tables."""
GAINS = 'PID: k_p 0.627, k_i 61.6, k_d 1.39e-4, filter 3170 Hz, as in seagate_7200_10.yaml'
"""PID gains, for the titles of the tables."""
BANDWIDTHS = (1000.0, 3000.0)
"""Bandwidths of the accelerometers [Hz]."""
GAIN_ERRORS = (-0.125, 0.125)
"""Relative gain errors of the accelerometers."""


@dataclasses.dataclass(frozen=True)
class Limits:
    """Range that at least 95 % of the runs must meet."""

    high: float
    low: float = 0.0
    unit: str = 'nm'

    def __str__(self) -> str:
        """Return the range as tables show it."""
        if self.low > 0.0:
            return f'{self.low:g} to {self.high:g} {self.unit}'
        return f'<= {self.high:g} {self.unit}'


NO_VIBRATION_LIMITS = Limits(6.0, 4.4)
"""Limits of 3 sigma with PID and without vibration."""
VIBRATION_LIMITS = {
    ('none', 1000.0): Limits(83.0, 67.0),
    ('fixed', 1000.0): Limits(44.0, 36.0),
    ('fixed', 3000.0): Limits(22.0, 17.0),
    ('fxlms', 1000.0): Limits(9.0),
    ('fxlms', 3000.0): Limits(6.5),
}
"""Limits of 3 sigma with PID in rotational vibration, by method and bandwidth [Hz]."""


def method_of(controller: str) -> str:
    """Return the name of the override that selects the feedforward method of a controller."""
    return f'{controller}_controller:feedforward.method'


def _vibration(controller: str, method: str, name: str = 'vibration', *overlays: str, **others: object) -> Case:
    """Return a run in rotational vibration; ``others`` are overrides, with ``__`` for the colon."""
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
"""Runs in vibration by controller and method, with accelerometers of 1 kHz and a gain error of +12.5 %."""
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
"""Runs without vibration and feedforward, by controller."""
DELAYED = {controller: _vibration(controller, 'fxlms', 'delay', DELAY) for controller in CONTROLLERS}
"""Runs in vibration with one sample of computation delay and the gains tuned for it, by controller."""
HARD_MOUNT = {
    controller: Case(
        f'hard_mount_{controller}_network',
        controller,
        (FILE, VIBRATION),
        {
            **IN_VIBRATION[controller]['network'].overrides,
            # At twice its rms value of 12.5 rad/s^2 * 50.8 mm / gain, the force is 30 % larger.
            'disturbance_generator:coupling.cubic': 0.075,
            'disturbance_generator:coupling.cubic_scale': 0.0155,
        },
    )
    for controller in CONTROLLERS
}
"""Runs in vibration with a nonlinear (hardening) mount, by controller."""


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
"""Runs with a shock by level, controller and method."""
