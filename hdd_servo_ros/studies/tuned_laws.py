"""Campaign with tuned controllers on the sines of the tuning rule, for the table of `tune`."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

from hdd_servo_ros.campaign.campaign import Campaign
from hdd_servo_ros.campaign.points import Varied
from hdd_servo_ros.campaign.spec import CampaignController, Spec, named_values
from hdd_servo_ros.messages.outcome import FINISHED
from hdd_servo_ros.reporting.verdict import in_table
from hdd_servo_ros.studies.tuning_runs import AMPLITUDE, FREQUENCIES, TRANSIENT, Sections, bench_of

_METRICS = ('rms_error', 'max_error', 'peak_control')


@dataclasses.dataclass(frozen=True)
class TunedLaw:
    """
    Controller with gains.

    Attributes
    ----------
    name
        Name in the table.
    controller
        ``'pid'`` or ``'adaptive_nn'``.
    gains
        Parameters that override those of the parameter files.
    """

    name: str
    controller: str
    gains: Mapping[str, object]


@dataclasses.dataclass(frozen=True)
class SineRun:
    """
    Result of a run on a 2 µm sine.

    Attributes
    ----------
    law
        Name of the controller.
    frequency
        Frequency of the sine [Hz].
    rms_error, max_error
        Errors after the transient [nm]; NaN if the run diverged.
    peak_control
        Peak control of the entire run [V]; NaN if it diverged.
    mark
        Verdict on a run that does not track, as in the tables of reports; empty otherwise.
    """

    law: str
    frequency: float
    rms_error: float
    max_error: float
    peak_control: float
    mark: str


def runs_on_sines(
    laws: Sequence[TunedLaw], sections: Sections, sample_time: float, seconds: float
) -> Iterator[SineRun]:
    """
    Run each controller on both sines, and yield the results in order of the controllers.

    Parameters
    ----------
    laws
        Controllers to run.
    sections
        Parameters of drive, vibrometer and controllers.
    sample_time
        T [s].
    seconds
        Duration of the runs, rounded to whole samples [s].
    """
    values: dict[str, object] = {
        'deterministic_timer:sample_time': sample_time,
        'deterministic_timer:duration': round(seconds / sample_time) * sample_time,
        'reference_generator:waveform': 'sine',
        'reference_generator:amplitude': AMPLITUDE,
    }
    values |= named_values(bench_of(sections))
    points = [{'reference_generator:frequency': Varied(frequency)} for frequency in FREQUENCIES]
    controllers = tuple(_controller(law, sections) for law in laws)
    table = Campaign(Spec('tune', (), values, controllers, points, metrics=_METRICS, after=TRANSIENT)).run()
    for law in laws:
        for row in table.where(controller=law.name).rows():
            # The samples before a divergence do not give a valid error.
            rms_error, max_error, peak_control = (
                row[name] if row['status'] == FINISHED else math.nan for name in _METRICS
            )
            shown = in_table(row['verdict'])
            mark = '' if shown == row['verdict'] else shown
            yield SineRun(law.name, row['reference_generator:frequency'], rms_error, max_error, peak_control, mark)


def _controller(law: TunedLaw, sections: Sections) -> CampaignController:
    node = f'{law.controller}_controller'
    values = named_values({node: {**sections.get(node, {}), **law.gains}})
    return CampaignController(law.name, law.controller, values=values)
