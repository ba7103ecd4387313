"""Runs that show when the network helps: leakage, gain, lattice, and position in the law."""

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.studies.chapter4.cases import adaptive_nn

SLOW = {'sigma__leakage': 0.01, 'mass__leakage': 0.01}
"""A tenth of sigma_sigma and sigma_m of the thesis, whose slow error would mask the effect of the network."""
GAIN = 100.0
"""Gamma, or k_phi where phi_hat replaces the network; the thesis has 1."""
LEAKAGES = (0.1, 0.03, 0.01, 0.003, 0.001)
"""sigma_w, or sigma_phi where phi_hat replaces the network; the thesis has 1 and 0.1."""
STRONG = 0.003
"""Leakage used in the table."""
NORMALIZED = {'network__normalize_inputs': True, 'network__width': (0.5,)}
"""Gaussian width of half the half-range on both axes, so that neighbors overlap on both."""
COMPENSATOR = {
    'compensator__enabled': True,
    'compensator__gain': 100.0,
    'compensator__lag': 0.0,  # a mass with -k r responds without a lag that the adaptation would have to model
    'compensator__position_minimum': -1.0,
    'compensator__position_maximum': 1.0,
    'compensator__velocity_minimum': -5.0,
    'compensator__velocity_maximum': 5.0,
}


def _case(name: str, error_filter_lambda: float, **overrides: object) -> Case:
    name = f'network_{name}_lambda_{error_filter_lambda:g}'
    return adaptive_nn(name, error_filter_lambda=error_filter_lambda, **overrides)


def network(
    error_filter_lambda: float, leakage: float = STRONG, *, normalized: bool, network_input: str = 'measured'
) -> Case:
    """Return a case with a strong network multiplied by sgn r, on the lattice of the thesis or a normalized one."""
    lattice = NORMALIZED if normalized else {}
    name = f'{"normalized" if normalized else "strong"}_{leakage:g}'
    name += '' if network_input == 'measured' else f'_{network_input}'
    own = {'network__gain': (GAIN,), 'network__leakage': leakage, 'network__input': network_input}
    return _case(name, error_filter_lambda, **SLOW, **own, **lattice)


def phi_only(error_filter_lambda: float, leakage: float = STRONG) -> Case:
    """Return a case without the network, and with its constants for phi_hat."""
    own = {'network__enabled': False, 'phi__gain': GAIN, 'phi__leakage': leakage}
    return _case(f'phi_{leakage:g}', error_filter_lambda, **SLOW, **own)


def without(error_filter_lambda: float) -> Case:
    """Return a case without the network."""
    return _case('none', error_filter_lambda, **SLOW, network__enabled=False)


def as_printed(error_filter_lambda: float) -> Case:
    """Return a case with the network of the thesis."""
    return _case('printed', error_filter_lambda, **SLOW)


def compensator(error_filter_lambda: float, *, slow: bool) -> Case:
    """Return a case with the compensator (a network without sgn r), with the leakages of the thesis or ``SLOW``."""
    if slow:
        return _case('compensator_slow', error_filter_lambda, **SLOW, **COMPENSATOR, compensator__leakage=0.01)
    return _case('compensator', error_filter_lambda, **COMPENSATOR, compensator__leakage=0.001)
