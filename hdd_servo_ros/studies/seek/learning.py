"""Times into +-25 nm and learned friction scale of recorded seeks, by seek number."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.campaign.case import Case
from hdd_servo_ros.campaign.recorded_runs import RecordedRuns
from hdd_servo_ros.reporting.seeks_of_run import responses_of
from hdd_servo_ros.studies.seek.cases import NARROW


def narrow_times(runs: RecordedRuns, case: Case) -> NDArray[np.float64]:
    """Return the time into +-25 nm of each seek [ms], shape (seeks,); infinite without arrival."""
    return np.array([1e3 * response.seek_time for response in responses_of(runs[case], NARROW)])


def levels(runs: RecordedRuns, case: Case) -> NDArray[np.float64]:
    """Return the learned friction at the start of each seek, relative to the model, shape (seeks,)."""
    run = runs[case]
    rows = [response.seek.row for response in responses_of(run, NARROW)]
    return np.asarray(run.estimates['seek_friction'][rows])
