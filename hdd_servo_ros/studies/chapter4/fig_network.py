"""Benefit of the network: error over control chatter with it, without it, and with phi_hat instead."""

from collections.abc import Sequence
from pathlib import Path

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.studies.chapter4.cases import LAST_HALF, LAST_PERIODS
from hdd_servo_ros.studies.chapter4.network_cases import LEAKAGES, STRONG, compensator, network, phi_only, without
from hdd_servo_ros.studies.output import draw, legend_above, new_figure, save

_LAMBDA = 10.0
_NONE = without(_LAMBDA)
_COMPENSATOR = compensator(_LAMBDA, slow=True)
_BEST = network(_LAMBDA, STRONG, normalized=True)
_SWEEPS = {
    'phi_hat alone': [phi_only(_LAMBDA, leakage) for leakage in LEAKAGES],
    'network, normalized inputs': [network(_LAMBDA, leakage, normalized=True) for leakage in LEAKAGES],
}
CASES = (_NONE, _COMPENSATOR, *(case for sweep in _SWEEPS.values() for case in sweep))


def make(runs: RecordedRuns, path: Path) -> Path:
    """Draw the errors in the last two periods, and error over chatter for each leakage."""
    figure = new_figure(
        r'Benefit of the network: $\lambda$ = 10 1/s, $\sigma_\sigma = \sigma_m = 0.01$, $\Gamma$ or $k_\phi$ = 100',
        height=6.5,
    )
    errors, trade = figure.subplots(2, 1)
    for case, label, color in (
        (_NONE, 'without network', '0.5'),
        (_BEST, rf'network, normalized inputs, $\sigma_w$ = {STRONG:g}', 'C0'),
    ):
        run = runs[case]
        late = run.since(LAST_PERIODS)
        draw(errors, run.time[late], 1e3 * run.error[late], color=color, label=label)
    errors.set_xlabel('time [s]')
    errors.set_ylabel('error [mm]')
    for (label, sweep), color in zip(_SWEEPS.items(), ('C1', 'C0'), strict=True):
        chatter, rms = _trade(runs, sweep)
        trade.plot(chatter, rms, 'o-', color=color, label=label)
        annotation = {'textcoords': 'offset points', 'xytext': (4, 5) if color == 'C1' else (-14, -13)}
        for x, y, leakage in zip(chatter, rms, LEAKAGES, strict=True):
            trade.annotate(f'{leakage:g}', (x, y), fontsize=8, color=color, **annotation)
    for case, label, color in ((_NONE, 'without network', '0.5'), (_COMPENSATOR, 'compensator', 'C2')):
        trade.plot(*_trade(runs, [case]), 's', color=color, label=label)
    trade.set_xscale('log')
    trade.set_ylim(0.0, 1.1)
    trade.set_xlabel('chatter: rms change of the control from sample to sample [N]; numbers: leakage')
    trade.set_ylabel('rms error, last half [mm]')
    legend_above(errors, trade)
    return save(figure, path)


def _trade(runs: RecordedRuns, cases: Sequence[Case]) -> tuple[list[float], list[float]]:
    """Return chatter [N] and rms error [mm] of cases."""
    chatter = [runs.chatter(case, LAST_HALF) for case in cases]
    return chatter, [1e3 * runs.metrics(case, LAST_HALF).rms_error for case in cases]
