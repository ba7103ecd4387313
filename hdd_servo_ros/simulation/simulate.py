"""
Command ``simulate``: the same experiment as ``rig`` without middleware, with the same parameters and the same bag.

It does not import ROS: the loop is one compiled kernel, and its rows are packed into the bytes that the nodes would
publish.
"""

import dataclasses
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hdd_servo_ros.bench.signal_analyzer import SignalAnalyzer
from hdd_servo_ros.graph.help import COMPILING, parse_help
from hdd_servo_ros.graph.known_sections import doubtful_sections
from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.exit_codes import command
from hdd_servo_ros.messages.outcome import FINISHED_OUTCOME, Outcome, failed, interrupted
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.numerics.kernel_folder import first_compilation
from hdd_servo_ros.parameters.events import pack_parameter_event
from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.run_recorder import RunRecorder, controller_name
from hdd_servo_ros.reporting.evaluation import REFERENCE_GENERATOR, transient_of
from hdd_servo_ros.reporting.progress import Progress
from hdd_servo_ros.reporting.response import response_line, write_response
from hdd_servo_ros.reporting.run_sums import RunSums
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.simulation.interrupts import Interrupts, interrupts
from hdd_servo_ros.simulation.packing import Packer
from hdd_servo_ros.simulation.pieces import run_piece
from hdd_servo_ros.simulation.run_setup import Simulation


def _to_stderr(line: str) -> None:
    print(f'simulate: {line}', file=sys.stderr)


class SimulatedRun:
    """
    Simulation in progress, run piece by piece and recorded into a bag (optional).

    Parameters
    ----------
    simulation
        Simulation to run.
    log
        Function that receives the warnings, one line per call.
    """

    def __init__(self, simulation: Simulation, log: Callable[[str], None] = _to_stderr) -> None:
        self._simulation = simulation
        self._log = log
        self._experiment = simulation.experiment
        self._experiment.compile()
        for warning in self._experiment.warnings():
            log(f'warning: {warning}')
        self.recorder: RunRecorder | None = None
        if simulation.timer.record:
            self.recorder = RunRecorder(
                simulation.recorder.run_dir,
                simulation.recorder.storage,
                simulation.topics,
                simulation.description(),
                separate_process=False,
                recorded=simulation.recorder.topics,
                options=BagOptions.of(simulation.recorder),
            )
        topics = [] if self.recorder is None else self.recorder.topics
        self._packer = Packer(
            topics, simulation.timer.sample_time, simulation.frame_id, self._experiment.estimate_names
        )
        self.sums = RunSums(self._metadata(), self._transient())
        self._warned: frozenset[tuple[str, str]] = frozenset()
        self._started = time.monotonic()

    def run(self, requests: Interrupts, progress: Progress | None) -> Outcome:
        """Run all pieces until the end, a failure or an interrupt; return the outcome."""
        rows: SignalRows | None = None
        for first_tick, count in self._simulation.pieces(self._simulation.last_tick):
            if rows is None or len(rows) != count:
                rows = self._experiment.empty_rows(first_tick, count)
            outcome, valid = self._piece(first_tick, count, rows)
            if self.recorder is not None and len(valid):
                messages = self._packer.pack(valid, self._simulation.recorded_messages(valid))
                self.recorder.write_ticks(first_tick + len(valid) - 1, messages)
            elif self.recorder is None:
                self.sums.add(valid)
            if progress is not None:
                progress.show(first_tick + len(valid) - 1)
            if requests.number:
                name = signal.Signals(requests.number).name
                outcome = interrupted(f'{name} at tick {first_tick + count - 1}', requests.number)
            if outcome != FINISHED_OUTCOME:
                return outcome
        return FINISHED_OUTCOME

    def _piece(self, first_tick: int, count: int, rows: SignalRows) -> tuple[Outcome, SignalRows]:
        """Run a piece; return the outcome so far, and the rows before a failure (all rows without one)."""
        outcome, valid, changes = run_piece(self._simulation, first_tick, count, rows)
        if self.recorder is not None:
            for change in changes:
                self.recorder.write_parameter_event(change.time_ns, pack_parameter_event(change))
        self._warn_about_saturation()
        return outcome, valid

    def _warn_about_saturation(self) -> None:
        """Log a warning for each newly saturated output and each crash stop hit, as the nodes do."""
        warnings = self._experiment.saturation_warnings()
        for output in sorted(warnings.keys() - self._warned):
            self._log(f'warning: {output[0]}: {warnings[output]}')
        self._warned = frozenset(warnings)

    def _transient(self) -> float:
        """Return the end of the transient [s], before which errors do not count; needs the complete schedule."""
        changes = [step.tick for node, step in self._simulation.schedule if node == REFERENCE_GENERATOR]
        sample_time = self._simulation.timer.sample_time
        return transient_of(self._simulation.last_tick * sample_time, max(changes, default=0) * sample_time)

    def _metadata(self) -> dict[str, Any]:
        return {'controller': controller_name(self._simulation.nodes), **self._simulation.description()}

    def summary(self, outcome: Outcome) -> str:
        """Return the summary of a run that was not recorded, or of the frequency response that a sweep measured."""
        if isinstance(self._experiment.controller, SignalAnalyzer):
            measured = self._experiment.controller.response()
            response = measured.at(measured.is_seen)
            if len(response.frequency):
                return response_line(response)
        looped = max(time.monotonic() - self._started, 1e-9)
        ended = {
            'status': outcome.status,
            'reason': outcome.reason,
            'real_time_factor': self.sums.last_tick * self._simulation.timer.sample_time / looped,
        }
        return summary(self.sums, {**self._metadata(), **ended})

    def finish(self, outcome: Outcome) -> None:
        """Close the bag, and write the response that a signal analyzer measured."""
        if self.recorder is not None:
            self.recorder.finish(outcome.status, outcome.reason)
        if isinstance(self._experiment.controller, SignalAnalyzer):
            directory = None if self.recorder is None else self.recorder.directory
            for line in write_response(self._experiment.controller, directory):
                self._log(line)


def simulate(
    simulation: Simulation, *, progress: bool, log: Callable[[str], None] = _to_stderr
) -> tuple[int, Path | None]:
    """
    Run a simulation, and record it unless the parameter ``record`` of the timer is false.

    Parameters
    ----------
    simulation
        Simulation to run.
    progress
        Whether to show a progress bar.
    log
        Function that receives the warnings and the outcome, one line per call.

    Returns
    -------
    exit_code, directory
        Exit code, the same as for ``rig``; directory of the run, or None if it was not recorded.
    """
    run = SimulatedRun(simulation, log)
    with interrupts() as requests:
        outcome = FINISHED_OUTCOME
        try:
            shown = Progress('simulate', simulation.last_tick, simulation.timer.sample_time) if progress else None
            if shown is not None:
                shown.show(0)
            outcome = run.run(requests, shown)
            if shown is not None:
                shown.close()
        except RunError as error:
            outcome = failed(str(error))
        except BaseException as error:
            outcome = failed(f'{type(error).__name__}: {error}')
            raise
        finally:
            outcome = _finished(run, outcome)
    if outcome != FINISHED_OUTCOME:
        log(f'run {outcome.status}: {outcome.reason}')
    elif run.recorder is None:
        print(run.summary(outcome))
    return outcome.exit_code, None if run.recorder is None else run.recorder.directory


def _finished(run: SimulatedRun, outcome: Outcome) -> Outcome:
    """Finish a run and return its outcome; the first error is reported first."""
    try:
        run.finish(outcome)
    except (RunError, OSError) as error:
        if outcome != FINISHED_OUTCOME:
            outcome = dataclasses.replace(outcome, reason=f'{outcome.reason}; {error}')
        else:
            outcome = failed(str(error))
    return outcome


@command('simulate')
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment; exit codes as for `rig`."""
    command_line = list(sys.argv[1:] if arguments is None else arguments)
    try:
        parsed = parse_ros_arguments(command_line)
        parse_help('simulate', parsed.others)
        if first_compilation():
            print(f'simulate: {COMPILING}', file=sys.stderr, flush=True)
        with parsed.naming_files():
            simulation = Simulation(parsed)
        for warning in doubtful_sections(parsed):
            print(f'simulate: warning: {warning}', file=sys.stderr)
        exit_code, directory = simulate(simulation, progress=simulation.timer.progress)
    except KeyboardInterrupt:
        # Compilation is slow, and nothing has been recorded yet.
        print('simulate: interrupted before the run started', file=sys.stderr)
        return 128 + signal.SIGINT
    if exit_code == 0 and directory is not None:
        # Imported late, because matplotlib is slow to import and not needed without a plot.
        from hdd_servo_ros.reporting.show import show_run

        show_run(directory, plot=simulation.rig.plot)
    return exit_code


if __name__ == '__main__':
    sys.exit(main())
