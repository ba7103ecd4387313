"""The runs that several figures and tables of chapter 4 share."""

from hdd_servo_ros.studies.case import Case

FILE = 'simulation_study.yaml'
LAST_HALF = 10.0
"""The errors of the last half of 20 s count, as the estimates have settled by then [s]."""
LAMBDAS = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0)
"""Of fig. 4.7; the thesis recommends 0.1 to 15 [1/s]."""


def adaptive_nn(name: str, **overrides: object) -> Case:
    """Return section 4.4 with the adaptive NN controller; its parameters are written with ``__`` for a dot."""
    own = {f'adaptive_nn_controller:{key.replace("__", ".")}': value for key, value in overrides.items()}
    return Case(name, 'adaptive_nn', (FILE,), own)


NN = adaptive_nn('nn')
"""Everything as section 4.4 has it; lambda = 1."""
NN_BY_LAMBDA = {
    value: NN if value == 1.0 else adaptive_nn(f'nn_lambda_{value:g}', error_filter_lambda=value) for value in LAMBDAS
}
PID = Case('pid', 'pid', (FILE,))
"""The PID controller with the least error under the peak control of ``NN``."""
