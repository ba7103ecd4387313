"""Runs shared by several figures and tables of chapter 5."""

import dataclasses

from hdd_servo_ros.campaign.case import Case

FILE = 'seagate_7200_10.yaml'
LAW = 'thesis_law.yaml'
STEPS = 'step_references.yaml'
FOR_SINES = 'pid_for_sines.yaml'
COMPENSATOR = 'hysteresis_compensator.yaml'
DELAY = 'one_sample_delay.yaml'
TRANSIENT = 2.0
"""Transient before the errors on sines are evaluated [s]."""
DURATION = 10.0
"""Duration of all runs but those of one minute [s]: long enough that a loop also fails if it bursts late."""
FREQUENCIES = (100.0, 200.0)
"""Frequencies of the sines in figs. 5.7 to 5.12 [Hz]."""
HYSTERESIS_FREQUENCY = 80.0
"""Frequency in figs. 5.6 and 5.21 [Hz]."""
HEIGHTS = (0.5, 5.0)
"""Heights of the steps in figs. 5.13 to 5.18 [um]."""
STEP_FREQUENCY = 10.0
"""Frequency of the square wave with these steps [Hz]."""
STEP_TIME = 2.0
"""Time of a single step from rest [s]."""
LAMBDAS = (100.0, 300.0, 595.0, 1000.0, 1600.0)
"""Values of lambda in figs. 5.19 and 5.20 [1/s]; the thesis has 595."""
_SAME_GAINS = {
    'proportional_gain': 7.96e-5 * 595.0,
    'derivative_gain': 7.96e-5,
    'integral_gain': 0.0,
    'derivative_bandwidth': 0.0,
}
"""PID equivalent to the feedback -k r of the adaptive law: k_p = k lambda, k_d = k."""
_FOR_SINES_DELAY = {
    'proportional_gain': 0.13,
    'integral_gain': 295.0,
    'derivative_gain': 9.8e-5,
    'derivative_bandwidth': 0.0,
}
"""PID gains for one sample of delay from `tune --overshoot none`."""


def sine(name: str, controller: str, frequency: float, *overlays: str, **overrides: object) -> Case:
    """
    Return a run with a 2 µm sine.

    Parameters
    ----------
    name
        Name of the case without the frequency.
    controller
        Value of the parameter ``controller`` of `rig`.
    frequency
        Frequency of the sine [Hz].
    overlays
        Parameter files applied on top of that of the drive.
    overrides
        Parameters of the controller; ``__`` in a name means a dot.
    """
    reference = {'waveform': 'sine', 'amplitude': 2.0, 'frequency': frequency}
    return _case(f'{name}_{frequency:g}_hz', controller, overlays, reference, overrides)


def steps(name: str, controller: str, height: float, *overlays: str, **overrides: object) -> Case:
    """Return a run with a square wave with edges of a height [um]; see :func:`sine` for the parameters."""
    reference = {'waveform': 'square', 'amplitude': 0.5 * height, 'frequency': STEP_FREQUENCY}
    return _case(f'{name}_{height:g}_um', controller, overlays, reference, overrides)


def step_from_rest(name: str, controller: str, height: float, *overlays: str) -> Case:
    """Return a run with one step from 0 to a height [um] at ``STEP_TIME``; see :func:`sine` for the parameters."""
    reference = {'waveform': 'step', 'amplitude': height, 'start_time': STEP_TIME}
    return _case(f'{name}_from_rest_{height:g}_um', controller, overlays, reference, {})


def open_loop(amplitude: float) -> Case:
    """Return an open-loop run with an 80 Hz sine of an amplitude [V] as the command."""
    reference = {'waveform': 'sine', 'amplitude': amplitude, 'frequency': HYSTERESIS_FREQUENCY}
    return _case(f'open_loop_{amplitude:g}_v', 'open_loop', (), reference, {})


def lasting(case: Case, duration: float) -> Case:
    """Return a case with a different duration [s]."""
    overrides = {**case.overrides, 'deterministic_timer:duration': duration}
    return dataclasses.replace(case, name=f'{case.name}_{duration:g}_s', overrides=overrides)


def _case(
    name: str,
    controller: str,
    overlays: tuple[str, ...],
    reference: dict[str, object],
    overrides: dict[str, object],
) -> Case:
    values: dict[str, object] = {'deterministic_timer:duration': DURATION}
    values |= {f'reference_generator:{key}': value for key, value in reference.items()}
    values |= {f'{controller}_controller:{key.replace("__", ".")}': value for key, value in overrides.items()}
    return Case(name, controller, (FILE, *overlays), values)


NN = {f: sine('nn', 'adaptive_nn', f, LAW) for f in FREQUENCIES}
"""Law of the thesis, by frequency."""
SHIPPED = {f: sine('shipped', 'adaptive_nn', f) for f in FREQUENCIES}
"""Adaptive NN controller as shipped, which extends the law of the thesis, by frequency."""
SHIPPED_MINUTE = {f: lasting(case, 60.0) for f, case in SHIPPED.items()}
PID = {f: sine('pid', 'pid', f) for f in FREQUENCIES}
"""Best PID with at most 20 % overshoot of steps, tuned by the same rule, by frequency."""
PID_FOR_SINES = {f: sine('pid_for_sines', 'pid', f, FOR_SINES) for f in FREQUENCIES}
"""Best PID without a limit of the overshoot, by frequency."""
PID_SAME_GAINS = {f: sine('pid_same_gains', 'pid', f, **_SAME_GAINS) for f in FREQUENCIES}
SHIPPED_DELAY = {f: sine('shipped_delay', 'adaptive_nn', f, DELAY) for f in FREQUENCIES}
PID_DELAY = {f: sine('pid_delay', 'pid', f, DELAY) for f in FREQUENCIES}
PID_FOR_SINES_DELAY = {f: sine('pid_for_sines_delay', 'pid', f, DELAY, **_FOR_SINES_DELAY) for f in FREQUENCIES}

LAW_STEPS = {h: steps('law_steps', 'adaptive_nn', h, LAW) for h in HEIGHTS}
"""Law of the thesis, which has no integral action, by height."""
SHIPPED_STEPS = {h: steps('shipped_steps', 'adaptive_nn', h) for h in HEIGHTS}
PID_STEPS = {h: steps('pid_steps', 'pid', h) for h in HEIGHTS}
PID_FOR_SINES_STEPS = {h: steps('pid_for_sines_steps', 'pid', h, FOR_SINES) for h in HEIGHTS}
LAW_FROM_REST = {h: step_from_rest('law', 'adaptive_nn', h, LAW) for h in HEIGHTS}
"""Single steps from rest, by height."""
SHIPPED_FROM_REST = {h: step_from_rest('shipped', 'adaptive_nn', h) for h in HEIGHTS}
PID_FROM_REST = {h: step_from_rest('pid', 'pid', h) for h in HEIGHTS}
PID_FOR_SINES_FROM_REST = {h: step_from_rest('pid_for_sines', 'pid', h, FOR_SINES) for h in HEIGHTS}

LAMBDA_SINES = {
    value: NN[100.0]
    if value == 595.0
    else sine(f'nn_lambda_{value:g}', 'adaptive_nn', 100.0, LAW, error_filter_lambda=value)
    for value in LAMBDAS
}
"""Law of the thesis with different lambda."""
LAMBDA_STEPS = {
    value: LAW_STEPS[5.0]
    if value == 595.0
    else steps(f'law_steps_lambda_{value:g}', 'adaptive_nn', 5.0, LAW, error_filter_lambda=value)
    for value in LAMBDAS
}
LAMBDA_INTEGRAL_STEPS = {
    value: steps(
        f'nn_steps_lambda_{value:g}',
        'adaptive_nn',
        5.0,
        LAW,
        STEPS,
        error_filter_lambda=value,
        integral_gain=0.138 * value**2,
        shaping__share=0.0,
    )
    for value in LAMBDAS
}
"""Steps with integral action, lambda_i = 0.138 lambda^2, and without input shaping."""

_TERMS = ('sigma', 'mass', 'network', 'phi')
_OFF = {f'{term}__enabled': False for term in _TERMS}


def _hysteresis(name: str, *overlays: str, **overrides: object) -> Case:
    return sine(f'hysteresis_{name}', 'adaptive_nn', HYSTERESIS_FREQUENCY, LAW, *overlays, **overrides)


HYSTERESIS_OFF = _hysteresis('off', **_OFF)
"""No compensation: only the feedback -k r of the law."""
HYSTERESIS_ON = _hysteresis('on')
"""Complete law."""
HYSTERESIS = {
    'no compensation: only -k r': HYSTERESIS_OFF,
    'complete law': HYSTERESIS_ON,
    'without sigma_hat': _hysteresis('without_sigma', sigma__enabled=False),
    'without m_hat': _hysteresis('without_mass', mass__enabled=False),
    'without network': _hysteresis('without_network', network__enabled=False),
    'without phi_hat': _hysteresis('without_phi', phi__enabled=False),
    'only sigma_hat': _hysteresis('only_sigma', **{**_OFF, 'sigma__enabled': True}),
    'only network': _hysteresis('only_network', **{**_OFF, 'network__enabled': True}),
    'complete law and compensator': _hysteresis('compensator', COMPENSATOR),
    'only compensator': _hysteresis('only_compensator', COMPENSATOR, **_OFF),
    'as shipped': sine('hysteresis_shipped', 'adaptive_nn', HYSTERESIS_FREQUENCY),
}
"""Variants that show which terms reduce the hysteresis loop of fig. 5.21."""
HYSTERESIS_PID = {
    'PID, at most 20 % overshoot': sine('hysteresis_pid', 'pid', HYSTERESIS_FREQUENCY),
    'PID for sines': sine('hysteresis_pid_for_sines', 'pid', HYSTERESIS_FREQUENCY, FOR_SINES),
}
"""PID controllers, whose entire command is feedback."""
