"""The runs that several figures and tables of chapter 5 share."""

import dataclasses

from hdd_servo_ros.campaign.case import Case

FILE = 'seagate_7200_10.yaml'
LAW = 'thesis_law.yaml'
STEPS = 'step_references.yaml'
FOR_SINES = 'pid_for_sines.yaml'
COMPENSATOR = 'hysteresis_compensator.yaml'
DELAY = 'one_sample_delay.yaml'
TRANSIENT = 2.0
"""The errors on sines count from here on [s]."""
DURATION = 10.0
"""Of all runs but those that last a minute: a loop that bursts later than the usual second has failed [s]."""
FREQUENCIES = (100.0, 200.0)
"""Of the sines of figs. 5.7 to 5.12 [Hz]."""
HYSTERESIS_FREQUENCY = 80.0
"""Of figs. 5.6 and 5.21 [Hz]."""
HEIGHTS = (0.5, 5.0)
"""Of the steps of figs. 5.13 to 5.18 [um]."""
STEP_FREQUENCY = 10.0
"""Of the square wave that makes them [Hz]."""
STEP_TIME = 2.0
"""Of a lone step from rest [s]."""
LAMBDAS = (100.0, 300.0, 595.0, 1000.0, 1600.0)
"""Of figs. 5.19 and 5.20 [1/s]; 595 is the thesis's."""
_SAME_GAINS = {
    'proportional_gain': 7.96e-5 * 595.0,
    'derivative_gain': 7.96e-5,
    'integral_gain': 0.0,
    'derivative_bandwidth': 0.0,
}
"""PID as the law's own -k r: k_p = k lambda, k_d = k."""
_FOR_SINES_DELAY = {
    'proportional_gain': 0.13,
    'integral_gain': 295.0,
    'derivative_gain': 9.8e-5,
    'derivative_bandwidth': 0.0,
}
"""PID with one sample of delay by `tune --overshoot none`."""


def sine(name: str, controller: str, frequency: float, *overlays: str, **overrides: object) -> Case:
    """
    Return a run on a sine of 2 um.

    Parameters
    ----------
    name
        Of the case, without the frequency.
    controller
        As of `rig`.
    frequency
        Of the sine [Hz].
    overlays
        Parameter files over that of the drive.
    overrides
        Parameters of the controller, with ``__`` for a dot.
    """
    reference = {'waveform': 'sine', 'amplitude': 2.0, 'frequency': frequency}
    return _case(f'{name}_{frequency:g}_hz', controller, overlays, reference, overrides)


def steps(name: str, controller: str, height: float, *overlays: str, **overrides: object) -> Case:
    """Return a run on a square wave whose edges have the given height [um]; parameters as of :func:`sine`."""
    reference = {'waveform': 'square', 'amplitude': 0.5 * height, 'frequency': STEP_FREQUENCY}
    return _case(f'{name}_{height:g}_um', controller, overlays, reference, overrides)


def step_from_rest(name: str, controller: str, height: float, *overlays: str) -> Case:
    """Return a run on one step from 0 to a height [um] at ``STEP_TIME``; parameters as of :func:`sine`."""
    reference = {'waveform': 'step', 'amplitude': height, 'start_time': STEP_TIME}
    return _case(f'{name}_from_rest_{height:g}_um', controller, overlays, reference, {})


def open_loop(amplitude: float) -> Case:
    """Return a run with a sine of 80 Hz and the given amplitude [V] as the command."""
    reference = {'waveform': 'sine', 'amplitude': amplitude, 'frequency': HYSTERESIS_FREQUENCY}
    return _case(f'open_loop_{amplitude:g}_v', 'open_loop', (), reference, {})


def lasting(case: Case, duration: float) -> Case:
    """Return a case that lasts longer or shorter [s]."""
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
"""The law of the thesis, by frequency."""
SHIPPED = {f: sine('shipped', 'adaptive_nn', f) for f in FREQUENCIES}
"""Beyond the thesis: the adaptive NN controller as shipped."""
SHIPPED_MINUTE = {f: lasting(case, 60.0) for f, case in SHIPPED.items()}
PID = {f: sine('pid', 'pid', f) for f in FREQUENCIES}
"""The best PID with at most 20 % overshoot of steps, tuned by the same rule."""
PID_FOR_SINES = {f: sine('pid_for_sines', 'pid', f, FOR_SINES) for f in FREQUENCIES}
"""The best PID without a limit of the overshoot."""
PID_SAME_GAINS = {f: sine('pid_same_gains', 'pid', f, **_SAME_GAINS) for f in FREQUENCIES}
SHIPPED_DELAY = {f: sine('shipped_delay', 'adaptive_nn', f, DELAY) for f in FREQUENCIES}
PID_DELAY = {f: sine('pid_delay', 'pid', f, DELAY) for f in FREQUENCIES}
PID_FOR_SINES_DELAY = {f: sine('pid_for_sines_delay', 'pid', f, DELAY, **_FOR_SINES_DELAY) for f in FREQUENCIES}

LAW_STEPS = {h: steps('law_steps', 'adaptive_nn', h, LAW) for h in HEIGHTS}
"""The law of the thesis, which has no integral, by height."""
SHIPPED_STEPS = {h: steps('shipped_steps', 'adaptive_nn', h) for h in HEIGHTS}
PID_STEPS = {h: steps('pid_steps', 'pid', h) for h in HEIGHTS}
PID_FOR_SINES_STEPS = {h: steps('pid_for_sines_steps', 'pid', h, FOR_SINES) for h in HEIGHTS}
LAW_FROM_REST = {h: step_from_rest('law', 'adaptive_nn', h, LAW) for h in HEIGHTS}
"""One step, of a head that has not moved before."""
SHIPPED_FROM_REST = {h: step_from_rest('shipped', 'adaptive_nn', h) for h in HEIGHTS}
PID_FROM_REST = {h: step_from_rest('pid', 'pid', h) for h in HEIGHTS}
PID_FOR_SINES_FROM_REST = {h: step_from_rest('pid_for_sines', 'pid', h, FOR_SINES) for h in HEIGHTS}

LAMBDA_SINES = {
    value: NN[100.0]
    if value == 595.0
    else sine(f'nn_lambda_{value:g}', 'adaptive_nn', 100.0, LAW, error_filter_lambda=value)
    for value in LAMBDAS
}
"""All but lambda as in the law of the thesis."""
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
"""With integral action, lambda_i = 0.138 lambda^2; each jump of the reference is taken at once."""

_TERMS = ('sigma', 'mass', 'network', 'phi')
_OFF = {f'{term}__enabled': False for term in _TERMS}


def _hysteresis(name: str, *overlays: str, **overrides: object) -> Case:
    return sine(f'hysteresis_{name}', 'adaptive_nn', HYSTERESIS_FREQUENCY, LAW, *overlays, **overrides)


HYSTERESIS_OFF = _hysteresis('off', **_OFF)
"""No compensation: the law's -k r alone."""
HYSTERESIS_ON = _hysteresis('on')
"""The whole law."""
HYSTERESIS = {
    'no compensation: only -k r': HYSTERESIS_OFF,
    'whole law': HYSTERESIS_ON,
    'without sigma_hat': _hysteresis('without_sigma', sigma__enabled=False),
    'without m_hat': _hysteresis('without_mass', mass__enabled=False),
    'without network': _hysteresis('without_network', network__enabled=False),
    'without phi_hat': _hysteresis('without_phi', phi__enabled=False),
    'only sigma_hat': _hysteresis('only_sigma', **{**_OFF, 'sigma__enabled': True}),
    'only network': _hysteresis('only_network', **{**_OFF, 'network__enabled': True}),
    'whole law and compensator': _hysteresis('compensator', COMPENSATOR),
    'only compensator': _hysteresis('only_compensator', COMPENSATOR, **_OFF),
    'as shipped': sine('hysteresis_shipped', 'adaptive_nn', HYSTERESIS_FREQUENCY),
}
"""Who shrinks the loop of fig. 5.21."""
HYSTERESIS_PID = {
    'PID, at most 20 % overshoot': sine('hysteresis_pid', 'pid', HYSTERESIS_FREQUENCY),
    'PID for sines': sine('hysteresis_pid_for_sines', 'pid', HYSTERESIS_FREQUENCY, FOR_SINES),
}
"""All of their command is feedback."""
