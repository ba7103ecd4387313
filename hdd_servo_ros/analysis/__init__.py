"""Analysis of signals and models: metrics, stability margins, identified models."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.analysis.friction_identification import identify_lugre
    from hdd_servo_ros.analysis.identification import identify_measured
    from hdd_servo_ros.analysis.metrics import (
        RepeatableParts,
        StepResponse,
        TrackingMetrics,
        amplitude_spectrum,
        power_spectral_density,
        repeatable_parts,
        rms,
        step_response,
        tracking_metrics,
    )
    from hdd_servo_ros.analysis.transfer_model import Model

__all__ = [
    'Model',
    'RepeatableParts',
    'StepResponse',
    'TrackingMetrics',
    'amplitude_spectrum',
    'identify_lugre',
    'identify_measured',
    'power_spectral_density',
    'repeatable_parts',
    'rms',
    'step_response',
    'tracking_metrics',
]

__getattr__ = lazily(
    __name__,
    {
        'Model': '.transfer_model',
        'RepeatableParts': '.metrics',
        'StepResponse': '.metrics',
        'TrackingMetrics': '.metrics',
        'amplitude_spectrum': '.metrics',
        'identify_lugre': '.friction_identification',
        'identify_measured': '.identification',
        'power_spectral_density': '.metrics',
        'repeatable_parts': '.metrics',
        'rms': '.metrics',
        'step_response': '.metrics',
        'tracking_metrics': '.metrics',
    },
)
