"""`deterministic_timer`: the only source of time."""

import sys
import time
from collections.abc import Sequence

from hdd_servo_ros.loop_parameters import TimerParameters
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.recording.cdr import ClockCodec
from hdd_servo_ros.reporting.progress import Progress
from hdd_servo_ros.ros.loop_node import Input, LoopNode
from hdd_servo_ros.ros.run import Outcome, Run
from hdd_servo_ros.topics import CLOCK, CONTROL, QUEUE_DEPTH, RECORDED

RECORDER_WINDOW = QUEUE_DEPTH // 2
"""How many ticks the recorder may be behind before the timer waits; half of what its queues hold."""


class DeterministicTimer(LoopNode):
    """
    Publishes `/clock`.

    Tick k comes once `/control` of tick k - 1 - ``lookahead`` is there, the recorder is near, and, when the run is
    paced, wall time has come to it.
    """

    paced = True

    def __init__(self) -> None:
        # The number of ticks that may be under way is a wire of its own, so it must be known before the base is made.
        control = Input(CONTROL, delay=1)
        self._recorded_wire = Input(RECORDED)
        super().__init__(
            'deterministic_timer',
            [],
            [control],
            [CLOCK],
            sample_time_kind=TimerParameters,
            optional_inputs=[self._recorded_wire],
        )
        control.delay = 1 + self.parameters[TimerParameters].lookahead
        self._recorded = 0
        self._recorder_takes_part = False
        self._paced_from = (0.0, 0)
        self._rate = 0.0
        self._progress: Progress | None = None

    def begin(self, run: Run) -> None:
        wires = self.inputs
        super().begin(run)
        # The recorder's count is no tick's message: it is looked at when the recorder seems far behind.
        self._recorder_takes_part = self._recorded_wire in self.inputs
        self.inputs = wires

    def prepare(self, run: Run) -> None:
        self.update()
        if self.parameters[TimerParameters].progress:
            self._progress = Progress('run', run.last_tick, run.sample_time)

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        self.publish_bytes(0, ClockCodec.pack(stamp))
        if self._progress is not None and not tick & 255:
            self._progress.show(tick)

    def update(self) -> None:
        self._rate = self.parameters[TimerParameters].rate
        self._paced_from = (time.monotonic(), self.tick)

    def seconds_until_due(self) -> float:
        if self._recorder_takes_part and self.tick - self._recorded > RECORDER_WINDOW and self._recorder_is_far():
            return float('inf')
        if self._rate == 0.0:
            return 0.0
        start, tick = self._paced_from
        if self.tick == 0:
            start = time.monotonic()
            self._paced_from = (start, 0)
        return start + (self.tick - tick) * self._ticks.sample_time / self._rate - time.monotonic()

    def missing(self) -> Input | None:
        wire = super().missing()
        if wire is None and self._recorder_takes_part and self.tick - self._recorded > RECORDER_WINDOW:
            return self._recorded_wire
        return wire

    def _recorder_is_far(self) -> bool:
        while (message := self._recorded_wire.take()) is not None:
            self._recorded = int.from_bytes(message[4:12], 'little')
        return self.tick - self._recorded > RECORDER_WINDOW

    def complete(self) -> None:
        if self._progress is not None:
            self._progress.show(self.last_tick)

    def finish(self, outcome: Outcome) -> None:
        if self._progress is not None:
            self._progress.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('deterministic_timer', DeterministicTimer, arguments)


if __name__ == '__main__':
    sys.exit(main())
