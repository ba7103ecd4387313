"""Table: shock, hard mount, parasitic coupling and NSS disturbances with one sample of computation delay."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.mobile.cases import (
    CONTROLLERS,
    DELAY,
    DELAYED,
    FILE,
    HARD_MOUNT,
    SHOCK_DURATION,
    SHOCKS,
    TRANSIENT,
    method_of,
)
from hdd_servo_ros.studies.mobile.shock_measures import BEFORE, LIMIT, peak_and_time
from hdd_servo_ros.studies.mobile.table_parasitic import UNIT_COUPLING
from hdd_servo_ros.studies.mobile.trials import DURATION, Trial, on_trials, trial
from hdd_servo_ros.studies.output import write_table

SEEDS = 3
SHARES = (-0.5, -0.1, 0.1, 0.5)
"""Parasitic coupling relative to that for a coupled loop gain of 1 without delay."""
COUPLED_DURATION = 5.0
"""Duration of a run with parasitic coupling [s]."""
_NSS_TRANSIENT = 0.5
_SHOCK = {
    controller: Case(
        f'delay_shock_63_g_{controller}',
        controller,
        (FILE, SHOCKS[63.0], DELAY),
        {'deterministic_timer:duration': SHOCK_DURATION, method_of(controller): 'fixed'},
    )
    for controller in CONTROLLERS
}
_NSS = {
    controller: Case(
        f'delay_nss_10_khz_{controller}',
        controller,
        (FILE, 'nss_100ktpi.yaml', 'nss_100ktpi_10_khz.yaml'),
        {f'{controller}_controller:dsp.computation_delay': 1},
    )
    for controller in CONTROLLERS
}
CASES = (*DELAYED.values(), *_SHOCK.values(), *_NSS.values())


@dataclasses.dataclass(frozen=True)
class _Row:
    """Row of the table: disturbance, controller, feedforward, sensor, trials and kind of result."""

    disturbance: str
    controller: str
    feedforward: str
    sensor: str
    trials: tuple[Trial, ...]
    shock_time: float = 0.0
    is_each_shown: bool = False


def make(runs: RecordedRuns, path: Path) -> Path:
    """Repeat the recorded runs, and write one row per disturbance, controller, feedforward and sensor."""
    rows = [*_hard_mount(runs), *_shock(runs), *_parasitic(runs), *_nss(runs), *_untuned(runs)]
    table = []
    for row in rows:
        found = on_trials(_measure, row.trials, row.disturbance, chunksize=1)
        if row.is_each_shown:
            text = f'{" / ".join(f"{sigma:.3g}" for sigma in found[:, 0])} nm'
        elif row.shock_time:
            text = f'{found[:, 1].max():.0f} nm, {found[:, 2].max():.1f} ms'
        else:
            text = 'unstable' if not np.isfinite(found[:, 0]).all() else f'{found[:, 0].max():.3g} nm'
        (warning, *_) = (*row.trials[0].warnings(), 'none')
        table.append(
            (row.disturbance, CONTROLLERS[row.controller], row.feedforward, row.sensor, text, in_short(warning))
        )
    header = ('disturbance', 'controller', 'feedforward', 'sensor', 'worst', 'warning at startup')
    title = (
        'One sample of computation delay, gains of one_sample_delay.yaml unless the row states others: 3 sigma of the '
        f'track error, or after a shock its peak and the time beyond {LIMIT:g} nm. Worst over {SEEDS} seeds and '
        'accelerometer gain errors of -12.5 % and +12.5 %; with parasitic coupling one value per coupled loop gain '
        f'(without delay) of {", ".join(f"{share:+g}" for share in SHARES)}.'
    )
    return write_table(path, title, header, table)


def in_short(warning: str) -> str:
    """Return the part of a warning that states the stability margin."""
    for phrase in ('is unstable', 'peak sensitivity of '):
        offset = warning.find(phrase)
        if offset >= 0:
            return warning[offset:].split(',')[0]
    return warning


def _measure(made: Trial) -> tuple[float, float, float]:
    """Return 3 sigma [nm], peak [nm] and time above the limit [ms] of the error after the transient."""
    error = made.error()
    return (3.0 * float(error.std()), *peak_and_time(error, made.sample_time))


def _seeded(
    runs: RecordedRuns,
    case: Case,
    changes: list[Mapping[str, object]],
    duration: float = DURATION,
    transient: float = TRANSIENT,
) -> tuple[Trial, ...]:
    return tuple(
        dataclasses.replace(trial(runs, case, seed, change), duration=duration, transient=transient)
        for change in changes
        for seed in range(1, SEEDS + 1)
    )


def _of(controller: str, method: str, bandwidth: float, gain_error: float) -> dict[str, object]:
    return {
        method_of(controller): method,
        'accelerometer:bandwidth': bandwidth,
        'accelerometer:gain_error': gain_error,
    }


def _errors(controller: str, method: str, bandwidth: float) -> list[Mapping[str, object]]:
    return [_of(controller, method, bandwidth, error) for error in (-0.125, 0.125)]


def _hard_mount(runs: RecordedRuns) -> list[_Row]:
    cubic = {key: value for key, value in HARD_MOUNT['pid'].overrides.items() if ':coupling.' in key}
    return [
        _Row(
            'hard mount',
            controller,
            method,
            '1 kHz',
            _seeded(runs, case, [{**change, **cubic} for change in _errors(controller, method, 1000.0)]),
        )
        for controller, case in DELAYED.items()
        for method in ('none', 'fxlms', 'network')
    ]


def _shock(runs: RecordedRuns) -> list[_Row]:
    rows = []
    for controller, case in _SHOCK.items():
        time = float(runs.parameters(case)['disturbance_generator']['shock.time'])
        for method in ('none', 'fixed', 'fxlms'):
            trials = _seeded(
                runs, case, _errors(controller, method, 3000.0), duration=SHOCK_DURATION, transient=time - BEFORE
            )
            rows.append(_Row('shock of 63 g', controller, method, '3 kHz', trials, time))
    return rows


def _parasitic(runs: RecordedRuns) -> list[_Row]:
    rows = []
    for controller, case in DELAYED.items():
        for method in ('none', 'fixed', 'fxlms', 'network'):
            changes: list[Mapping[str, object]] = [
                {**_of(controller, method, 1000.0, 0.125), 'accelerometer:parasitic_gain': share * UNIT_COUPLING}
                for share in SHARES
            ]
            trials = tuple(
                dataclasses.replace(trial(runs, case, 1, change), duration=COUPLED_DURATION, transient=TRANSIENT)
                for change in changes
            )
            rows.append(_Row('vibration, parasitic coupling', controller, method, '1 kHz', trials, is_each_shown=True))
    return rows


def _nss(runs: RecordedRuns) -> list[_Row]:
    return [
        _Row(
            'NSS at 10.08 kHz, gains without delay',
            controller,
            'none',
            'servo',
            _seeded(runs, case, [{}], duration=runs[case].duration, transient=_NSS_TRANSIENT),
        )
        for controller, case in _NSS.items()
    ]


def _untuned(runs: RecordedRuns) -> list[_Row]:
    """Return the rows with the gains tuned for no delay."""
    rows = []
    for controller, case in DELAYED.items():
        tuned = trial(runs, case, 1, {method_of(controller): 'none'})
        node = f'{controller}_controller'
        own = {name: value for name, value in tuned.parameters[node].items() if name.startswith(('dsp.', 'observer.'))}
        plain = dataclasses.replace(tuned, parameters={**tuned.parameters, node: own})
        rows.append(_Row('vibration, gains without delay', controller, 'none', '', (plain,)))
    return rows
