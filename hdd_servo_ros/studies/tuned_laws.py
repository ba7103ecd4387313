"""What tuned controllers do on the sines of the rule, as the table of `tune` has it, by a campaign."""

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
    A controller with its gains.

    Attributes
    ----------
    name
        As the table has it.
    controller
        ``'pid'`` or ``'adaptive_nn'``.
    gains
        Its parameters, over those of the parameter files.
    """

    name: str
    controller: str
    gains: Mapping[str, object]


@dataclasses.dataclass(frozen=True)
class SineRun:
    """
    A run of a law on a sine of 2 um.

    Attributes
    ----------
    law
        Name of the law.
    frequency
        Of the sine [Hz].
    rms_error, max_error
        After the transient [nm]; NaN if the run diverged.
    peak_control
        Of the whole run [V]; NaN if it diverged.
    mark
        The verdict where the run does not track, as tables of reports have it; empty where it does.
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
    Run each law on both sines, and iterate over the runs, law by law.

    Parameters
    ----------
    laws
        What runs.
    sections
        Parameters of drive, vibrometer and controllers.
    sample_time
        T [s].
    seconds
        Length of the runs, rounded to whole samples [s].
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
            # What a run did before it diverged is not its error.
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
