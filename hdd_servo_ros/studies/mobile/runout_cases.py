"""The recorded runs with repeatable runout that the figure and the table share."""

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.studies.mobile.cases import CONTROLLERS, FILE, Limits

RATES = {84: '10.08 kHz', 220: '26.4 kHz'}
"""Sampling frequencies by the number of servo sectors."""
SAMPLE_TIMES = {84: 99206, 220: 37879}
"""[ns]."""
_DISTURBANCES = {84: ('nss_100ktpi.yaml', 'nss_100ktpi_10_khz.yaml'), 220: ('nss_100ktpi.yaml',)}
_CANCELLATION = 'runout_cancellation.yaml'
_REVOLUTIONS = {84: 240, 220: 30}
"""Of the recorded runs."""
FIRST = 10
"""Revolutions after which the repeatable error counts."""
RPE, NRPE, SENSITIVITY = Limits(0.1, unit=''), Limits(1.03, unit=''), Limits(2.2, unit='')
"""Of the errors over those without cancellation, and of the peak sensitivity."""
ALONE: dict[str, object] = {
    'disturbance_generator:flutter.enabled': False,
    'disturbance_generator:force_noise.enabled': False,
    'servo_sensor:noise': 0.0,
    'servo_sensor:bits': 0,
}
"""What leaves the runout without anything that does not repeat."""


def method_of(controller: str) -> str:
    """Return the override's name that chooses a controller's method of cancellation."""
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
"""By sectors and controller, with repetitive control."""
DRAWN = {method: _case(84, 'pid', method, 'runout') for method in ('none', 'repetitive')}
"""With all disturbances, by method."""
DRAWN_ALONE = {method: _case(84, 'pid', method, 'runout_alone', ALONE) for method in ('none', 'repetitive')}
"""With the repeatable runout alone, by method."""
