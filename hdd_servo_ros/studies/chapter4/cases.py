"""Runs shared by several figures and tables of chapter 4."""

import dataclasses

from hdd_servo_ros.campaign.case import Case

FILE = 'simulation_study.yaml'
LAST_HALF = 10.0
"""Start of the last half of 20 s, over which the errors are evaluated: the estimates have settled [s]."""
LAST_PERIODS = 17.5
"""Start of the close-up of the last two periods of 1.26 s [s]."""
LAMBDAS = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0)
"""Values of lambda in fig. 4.7; the thesis recommends 0.1 to 15 [1/s]."""
COMPARED_LAMBDAS = (1.0, 10.0, 15.0)
"""Values of lambda at which the PID is tuned for the peak control of the adaptive NN controller [1/s]."""


def adaptive_nn(name: str, **overrides: object) -> Case:
    """Return a run of section 4.4 with the adaptive NN controller; ``__`` in parameter names means a dot."""
    own = {f'adaptive_nn_controller:{key.replace("__", ".")}': value for key, value in overrides.items()}
    return Case(name, 'adaptive_nn', (FILE,), own)


def at_sample_time(case: Case, sample_time: float) -> Case:
    """Return a case with a different sample time T [s]."""
    overrides = {**case.overrides, 'deterministic_timer:sample_time': sample_time}
    return dataclasses.replace(case, name=f'{case.name}_T{sample_time:g}', overrides=overrides)


def _pid(error_filter_lambda: float, *, feedforward: bool) -> Case:
    number = f'{error_filter_lambda:g}'
    files = [FILE]
    files += [f'simulation_study_lambda_{number}.yaml'] if error_filter_lambda != 1.0 else []
    files += [f'simulation_study_feedforward_{number}.yaml'] if feedforward else []
    return Case(f'pid_{"feedforward_" if feedforward else ""}lambda_{number}', 'pid', tuple(files))


NN_BY_LAMBDA = {value: adaptive_nn(f'nn_lambda_{value:g}', error_filter_lambda=value) for value in LAMBDAS}
NN = NN_BY_LAMBDA[1.0]
"""Case with the parameters of section 4.4."""
PID_BY_LAMBDA = {value: _pid(value, feedforward=False) for value in COMPARED_LAMBDAS}
"""PID with the least error at the peak control of the adaptive NN controller with the same lambda."""
PID = PID_BY_LAMBDA[1.0]
FEEDFORWARD_BY_LAMBDA = {value: _pid(value, feedforward=True) for value in COMPARED_LAMBDAS}
"""The same with acceleration feedforward, scaled by the true mass."""
