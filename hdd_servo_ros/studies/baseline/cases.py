"""Runs shared by several figures and tables of the baseline."""

import dataclasses
import math

from hdd_servo_ros.campaign.case import Case

FILE = 'seagate_7200_10.yaml'
LAW = 'thesis_law.yaml'
FOR_SINES = 'pid_for_sines.yaml'
DURATION = 10.0
"""Duration of all runs except those with steps [s]."""
TRANSIENT = 2.0
"""Transient before the errors on sines are evaluated [s]."""
FREQUENCIES = (10.0, 20.0, 30.0, 50.0, 60.0, 100.0, 200.0, 500.0)
"""Frequencies of the sines with ``AMPLITUDE`` [Hz]."""
AMPLITUDE = 2.0
"""Amplitude of the sines over frequency [um]."""
AMPLITUDES = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Amplitudes of the sines with ``FREQUENCY`` [um]."""
FREQUENCY = 100.0
"""Frequency of the sines over amplitude [Hz]."""
LIMIT_FREQUENCIES = (50.0, 100.0, 200.0)
"""Frequencies at which the best PID controllers are compared [Hz]."""
HEIGHTS = (0.5, 5.0)
"""Heights of the steps for the measurement of their overshoot [um]."""
STEP_TIME = 0.05
"""Time of these steps [s]."""
STEP_DURATION = 0.25
"""Duration of the runs with steps [s]."""

BEST_PIDS = {
    10.0: (0.606, 38.2, 1.58e-4, 2570.0),
    20.0: (0.627, 61.6, 1.39e-4, 3170.0),
    30.0: (0.435, 853.0, 1.92e-4, 1930.0),
    50.0: (0.331, 1360.0, 2.09e-4, 1720.0),
    math.inf: (0.186, 2250.0, 2.26e-4, 1550.0),
}
"""k_p, k_i, k_d and corner frequency of the filter from `tune --overshoot`, by limit [%]; infinity for no limit."""
PID_NAMES = ('proportional_gain', 'integral_gain', 'derivative_gain', 'derivative_bandwidth')
"""Parameter names of these gains."""


def limit_in_words(limit: float) -> str:
    """Return a limit of the overshoot [%] as tables show it."""
    return 'none' if math.isinf(limit) else f'{limit:g} %'


def _case(name: str, controller: str, overlays: tuple[str, ...], duration: float, **reference: object) -> Case:
    overrides = {f'reference_generator:{key}': value for key, value in reference.items()}
    return Case(name, controller, (FILE, *overlays), {'deterministic_timer:duration': duration, **overrides})


def _sine(
    name: str, controller: str, overlays: tuple[str, ...], frequency: float, amplitude: float = AMPLITUDE
) -> Case:
    name = f'{name}_{frequency:g}_hz_{amplitude:g}_um'
    reference = {'waveform': 'sine', 'frequency': frequency, 'amplitude': amplitude}
    return _case(name, controller, overlays, DURATION, **reference)


CONTROLLERS = {
    'adaptive NN as shipped': ('shipped', 'adaptive_nn', ()),
    'law of the thesis': ('law', 'adaptive_nn', (LAW,)),
    'PID, at most 20 % overshoot': ('pid', 'pid', ()),
    'PID for sines': ('pid_for_sines', 'pid', (FOR_SINES,)),
}
"""Prefix of the case names, controller and overlays of each compared controller."""
OVER_FREQUENCY = {name: {f: _sine(*kind, f) for f in FREQUENCIES} for name, kind in CONTROLLERS.items()}
"""Cases by name of the controller and frequency."""
OVER_AMPLITUDE = {name: {a: _sine(*kind, FREQUENCY, a) for a in AMPLITUDES} for name, kind in CONTROLLERS.items()}
"""Cases by name of the controller and amplitude."""


def _best_pid(limit: float, name: str, duration: float, **reference: object) -> Case:
    gains = {f'pid_controller:{key}': value for key, value in zip(PID_NAMES, BEST_PIDS[limit], strict=True)}
    case = _case(f'pid_{limit:g}_{name}', 'pid', (), duration, **reference)
    return dataclasses.replace(case, overrides={**case.overrides, **gains})


BEST_PID_SINES = {
    limit: {
        f: _best_pid(limit, f'{f:g}_hz', DURATION, waveform='sine', frequency=f, amplitude=AMPLITUDE)
        for f in LIMIT_FREQUENCIES
    }
    for limit in BEST_PIDS
}
"""Cases by limit and frequency."""
BEST_PID_STEPS = {
    limit: {
        h: _best_pid(limit, f'{h:g}_um', STEP_DURATION, waveform='step', amplitude=h, start_time=STEP_TIME)
        for h in HEIGHTS
    }
    for limit in BEST_PIDS
}
"""Cases with single steps from rest, by limit and height."""
