"""Runs with the gains of section 5.5, for each interpretation of the printed values."""

from hdd_servo_ros.studies.chapter5.cases import LAW, sine, steps

_FILES = (LAW, 'thesis_gains.yaml')
_PRINTED_SIGNS = {'sigma__gain': -1e-9, 'mass__gain': -2e-14}
_SMALL_GAMMA = {'network__gain': (3e-8,)}
_LARGE_K = {'feedback_gain': 7.9e-5}

PRINTED_SIGNS = sine('thesis_printed_signs', 'adaptive_nn', 100.0, *_FILES, **_PRINTED_SIGNS)
MAGNITUDES = {f: sine('thesis_magnitudes', 'adaptive_nn', f, *_FILES) for f in (100.0, 200.0)}
"""Interpretation with which the loop works, by frequency."""
READINGS = {
    'printed signs, Gamma = 1': (PRINTED_SIGNS,),
    'printed signs, Gamma = k_w = 3e-8': (
        sine('thesis_printed_signs_small_gamma', 'adaptive_nn', 100.0, *_FILES, **_PRINTED_SIGNS, **_SMALL_GAMMA),
    ),
    'magnitudes, Gamma = 1 (thesis_gains.yaml)': (
        *MAGNITUDES.values(),
        steps('thesis_magnitudes_steps', 'adaptive_nn', 1.0, *_FILES),
    ),
    'magnitudes, Gamma = k_w': (sine('thesis_magnitudes_small_gamma', 'adaptive_nn', 100.0, *_FILES, **_SMALL_GAMMA),),
    'magnitudes, Gamma = k_w, k = 7.9e-5': tuple(
        sine('thesis_magnitudes_large_k', 'adaptive_nn', f, *_FILES, **_SMALL_GAMMA, **_LARGE_K) for f in (100.0, 200.0)
    ),
}
"""Runs of each interpretation, by name."""
