"""Recorded runs with repeatable runout for the figure and the table."""

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS, FILE, Limits

RATES = {84: '10.08 kHz', 220: '26.4 kHz'}
"""Sampling frequencies, by number of servo sectors."""
SAMPLE_TIMES = {84: 99206, 220: 37879}
"""Sample times [ns], by number of servo sectors."""
_DISTURBANCES = {84: ('nss_100ktpi.yaml', 'nss_100ktpi_10_khz.yaml'), 220: ('nss_100ktpi.yaml',)}
_CANCELLATION = 'runout_cancellation.yaml'
_REVOLUTIONS = {84: 240, 220: 30}
"""Number of revolutions in the recorded runs, by number of servo sectors."""
FIRST = 10
"""Number of revolutions before the repeatable error is evaluated."""
RPE, NRPE, SENSITIVITY = Limits(0.1, unit=''), Limits(1.03, unit=''), Limits(2.2, unit='')
"""Limits of the error ratios with / without cancellation, and of the peak sensitivity."""
ALONE: dict[str, object] = {
    'disturbance_generator:flutter.enabled': False,
    'disturbance_generator:force_noise.enabled': False,
    'servo_sensor:noise': 0.0,
    'servo_sensor:bits': 0,
}
"""Overrides that disable all non-repeatable disturbances."""


def method_of(controller: str) -> str:
    """Return the name of the override that selects the cancellation method of a controller."""
    return f'{controller}_controller:runout.method'


def _case(sectors: int, controller: str, method: str, name: str, changes: dict[str, object] | None = None) -> Case:
    duration = _REVOLUTIONS[sectors] * sectors * SAMPLE_TIMES[sectors] / 1e9
    return Case(
        f'{name}_{sectors}_{controller}_{method}',
        controller,
        (FILE, *_DISTURBANCES[sectors], _CANCELLATION),
        {'deterministic_timer:duration': duration, method_of(controller): method, **(changes or {})},
    )


CANCELED = {
    (sectors, controller): _case(sectors, controller, 'repetitive', 'runout')
    for sectors in RATES
    for controller in CONTROLLERS
}
"""Runs with repetitive control, by sectors and controller."""
DRAWN = {method: _case(84, 'pid', method, 'runout') for method in ('none', 'repetitive')}
"""Runs with all disturbances, by method."""
DRAWN_ALONE = {method: _case(84, 'pid', method, 'runout_alone', ALONE) for method in ('none', 'repetitive')}
"""Runs with only the repeatable runout, by method."""
