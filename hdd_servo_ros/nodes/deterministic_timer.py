"""`deterministic_timer`: the only time source of a run."""

import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence

from std_srvs.srv import Trigger

from hdd_servo_ros.messages.cdr import ClockCodec, ReportCodec
from hdd_servo_ros.messages.errors import StopRequest
from hdd_servo_ros.messages.outcome import Outcome
from hdd_servo_ros.messages.topics import QUEUE_DEPTH
from hdd_servo_ros.nodes.catalog_node import CatalogNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters.run_parameters import TimerParameters
from hdd_servo_ros.reporting.progress import Progress
from hdd_servo_ros.ros.diagnosis import OK, WARN, Diagnosis
from hdd_servo_ros.ros.ignored_messages import IgnoredMessages
from hdd_servo_ros.ros.loop_input import Input
from hdd_servo_ros.ros.run_plan import RunPlan

RECORDER_WINDOW = QUEUE_DEPTH // 2
"""Number of ticks by which the recorder may lag before the timer waits; half of its queue depth."""

_LATE = 0.95
"""Fraction of the requested rate below which the diagnostics warn."""


class DeterministicTimer(CatalogNode):
    """
    Publisher of `/clock`.

    Tick k is published when `/control` of tick k - 1 - ``lookahead`` has arrived, the recorder does not lag too far,
    and, in a paced run, wall time has reached the tick. The services ``~/start``, ``~/pause``, ``~/resume``, ``~/step``
    and ``~/stop`` decide whether a next tick follows; they do not affect the results.
    """

    def __init__(self) -> None:
        super().__init__('deterministic_timer')
        (control,) = self.inputs
        control.delay += self.parameters[TimerParameters].lookahead
        (self._recorded_input,) = self.optional_inputs
        self._recorded = 0
        self._ignored = IgnoredMessages(self)
        self._has_recorder = False
        self._paced_from = (0.0, 0)
        self._rate = 0.0
        self._progress: Progress | None = None
        self._started = self.parameters[TimerParameters].autostart
        self._hold_at = math.inf if self._started else 0
        self._stopped = False
        self._diagnosed = (time.monotonic(), 0)
        for name, act in (
            ('start', self._start),
            ('pause', self._pause),
            ('resume', self._resume),
            ('step', self._single_step),
            ('stop', self._stop),
        ):
            self._offer(name, act)

    def _offer(self, name: str, act: Callable[[], str]) -> None:
        def serve(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if self.done and self._ticks is not None:
                response.message = f'the run is over: its last tick is {self.last_tick}'
                return response
            if self._ticks is None and act not in (self._start, self._stop):
                response.message = 'the run has not begun: nodes are missing'
                return response
            rejected = act()
            response.success = not rejected
            response.message = rejected or self._state
            self._set_halt()
            if response.success:
                self.get_logger().info(response.message)
            return response

        self.create_service(Trigger, f'~/{name}', serve)

    # Actions of the services; each returns why it is rejected, or an empty string.

    def _start(self) -> str:
        if self._started:
            return 'started already'
        self._go()
        return ''

    def _pause(self) -> str:
        if self._held:
            return f'not running: {self._state}'
        self._hold_at = self.tick
        return ''

    def _resume(self) -> str:
        if not self._started:
            return 'not started: call ~/start'
        if not self._held:
            return 'not paused'
        self._go()
        return ''

    def _single_step(self) -> str:
        if self._hold_at == math.inf:
            return 'running: call ~/pause first'
        self._started = True
        # If a step is still in progress, this is the one after it.
        self._hold_at = max(self._hold_at, self.tick) + 1
        return ''

    def _stop(self) -> str:
        self._stopped = True
        return ''

    def _go(self) -> None:
        self._started, self._hold_at = True, math.inf
        self._pace_from_here()
        if self._progress is not None:
            self._progress.resume(self.tick)

    @property
    def _held(self) -> bool:
        return self.tick >= self._hold_at

    @property
    def _state(self) -> str:
        if self._stopped:
            return f'stopped before tick {self.tick}'
        if not self._started:
            return 'waiting for ~/start'
        if self._held:
            return f'paused before tick {self.tick}'
        return f'stepping over tick {self.tick}' if self._hold_at < math.inf else f'running, next is tick {self.tick}'

    def _next_halt(self) -> int:
        if self._stopped:
            return self.tick
        window = self._recorded + RECORDER_WINDOW + 1 if self._has_recorder else math.inf
        return min(super()._next_halt(), self._hold_at, window)  # type: ignore[return-value]

    def _passes(self) -> bool:
        if self._stopped:
            raise StopRequest(f'~/stop {self.get_name()} before tick {self.tick}')
        return not self._held and not self._recorder_lags() and super()._passes()

    def housekeep(self) -> None:
        if self._stopped and self._ticks is None:
            # The missing nodes may never start.
            raise StopRequest(f'~/stop {self.get_name()} before the run')

    def begin(self, run: RunPlan) -> None:
        inputs = self.inputs
        super().begin(run)
        # The report of the recorder does not belong to a tick: it is read only when the recorder seems to lag.
        self._has_recorder = self._recorded_input in self.inputs
        self._report = ReportCodec(run.identifier)
        self.inputs = inputs
        self._set_halt()

    def prepare(self, run: RunPlan) -> None:
        self.update()
        if self.parameters[TimerParameters].progress:
            self._progress = Progress('run', run.last_tick, run.sample_time)

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        self.publish_bytes(0, ClockCodec.pack(stamp))
        if self._progress is not None and not tick & 255:
            self._progress.show(tick)

    def update(self) -> None:
        self._rate = self.parameters[TimerParameters].rate
        self.paced = self._rate > 0.0
        self._pace_from_here()

    def _pace_from_here(self) -> None:
        self._paced_from = (time.monotonic(), self.tick)

    def seconds_until_due(self) -> float:
        if self.tick >= self._hold_at:
            return math.inf
        if not self.paced:
            return 0.0
        start, tick = self._paced_from
        if self.tick == 0:
            start = time.monotonic()
            self._paced_from = (start, 0)
        return start + (self.tick - tick) * self._ticks.sample_time / self._rate - time.monotonic()

    def missing(self) -> Input | None:
        if self._held:
            return None
        return self._recorded_input if self._is_outside_window else super().missing()

    @property
    def _is_outside_window(self) -> bool:
        return self._has_recorder and self.tick - self._recorded > RECORDER_WINDOW

    def _recorder_lags(self) -> bool:
        """Return whether the recorder lags too far; read its reports if necessary."""
        if self._is_outside_window:
            while (message := self._recorded_input.take()) is not None:
                self._take_report(message)
        return self._is_outside_window

    def _take_report(self, message: bytes) -> None:
        stamp = self._report.stamp_of(message)
        tick = -1.0 if stamp is None else self._ticks.tick_of(stamp)
        # Even with a forged report, the timer must not run further ahead of the recorder than it already is.
        if not self._recorded <= tick < self.tick or int(tick) != tick:
            publisher = None if self._run is None else self._run.publisher_of(self._recorded_input.name)
            self._ignored.add(self._recorded_input.name, 'not a report of this run', [publisher] if publisher else [])
            return
        self._recorded = int(tick) + 1

    def diagnose(self) -> Iterable[Diagnosis]:
        if self._ticks is None:
            yield Diagnosis('ticks', OK, 'waiting for peers')
            return
        now = time.monotonic()
        (before, first), self._diagnosed = self._diagnosed, (now, self.tick)
        tick_rate = (self.tick - first) / max(now - before, 1e-9)
        factor = tick_rate * self._ticks.sample_time
        values = {
            'tick': self.tick,
            'last tick': self.last_tick,
            'tick rate [1/s]': tick_rate,
            'real-time factor': factor,
            'rate': self._rate,
        }
        if self.done or self._held or first == 0:
            yield Diagnosis('ticks', OK, 'finished' if self.done else self._state, values)
        elif factor < _LATE * self._rate:
            yield Diagnosis('ticks', WARN, f'slower than the requested rate: {factor:.3g} of {self._rate:g}', values)
        else:
            yield Diagnosis('ticks', OK, f'{factor:.3g} x real time', values)

    def complete(self) -> None:
        if self._progress is not None:
            self._progress.show(self.last_tick)

    def finish(self, outcome: Outcome) -> None:
        self._ignored.report()
        if self._progress is not None:
            self._progress.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('deterministic_timer', DeterministicTimer, arguments)


if __name__ == '__main__':
    sys.exit(main())
