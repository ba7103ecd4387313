"""
The processes of a run find each other, start together and learn of each other's end.

Every process says on the topic ``lockstep`` (``std_msgs/String`` holding JSON), several times a second, who it is, what
state it is in and how far its nodes are. Nothing here carries loop data, and nothing here decides when a node fires:
this is how a run starts, and how it ends when it cannot go on.

States of a process::

    waiting -> ready -> running -> done -> finished
        any of these -> failed, interrupted
"""

import dataclasses
import json
import math
import os
import socket
import time
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from hdd_servo_ros.messages.errors import RunError
from hdd_servo_ros.messages.outcome import FAILED, FINISHED, FINISHED_OUTCOME, INTERRUPTED, Outcome
from hdd_servo_ros.messages.topics import CLOCK, RECORDED
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.parameters.run_parameters import (
    PeerParameters,
    SampleTimeParameters,
    TimerParameters,
    last_tick_of_run,
)
from hdd_servo_ros.parameters.schedule import parse_schedule, refuse_strangers
from hdd_servo_ros.ros.loop_node import UNKNOWN_NODE, LoopNode, last_ticks_needed, publishers_of
from hdd_servo_ros.ros.run_plan import RunPlan

WAITING = 'waiting'
READY = 'ready'
RUNNING = 'running'
DONE = 'done'

RECORDER = 'bag_recorder'
_PERIODS = {WAITING: 0.1, READY: 0.1, RUNNING: 0.4, DONE: 0.1}
"""How often a process speaks in each state [s]."""
_FOREIGN_AFTER = 5.0
"""
How long a publisher may be silent before it counts as an ordinary ROS node that keeps the protocol of stamps [s].

DDS repeats a lost announcement after 3 s, so that one topic of a node may be known that much before another.
"""
_LAST_WORDS = 5
_ACKNOWLEDGED_WITHIN = Duration(nanoseconds=300_000_000)
"""How long to see that the last words arrive; a peer that died never says so."""
_FRESH = 1.0
"""How long what a waiting process said holds; it speaks ten times as often [s]."""
_STALLED = 1.0
"""A loop that fires no node for this long stands still [s]."""
_PATIENCE_UNDER_WAY = 3.0
"""How many times the timeout a peer may be silent as long as the loop goes on."""
_UNDER_WAY = 0.5
"""How long the first message after a pause may take [s]."""
_LEASE = 25.0
"""Longer than DDS remembers a participant that was killed: 20 s unless configured otherwise [s]."""
_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


class Peers:
    """
    What this process knows of the others, and what it tells them.

    Parameters
    ----------
    nodes
        The loop nodes of this process; the first one lends its publisher and subscription.
    """

    def __init__(self, nodes: Sequence[LoopNode]) -> None:
        self._nodes = nodes
        for node in nodes:
            node.connect()
        self.identifier = f'{socket.gethostname()}:{os.getpid()}:{uuid.uuid4().hex[:8]}'
        self.state = WAITING
        self.run: RunPlan | None = None
        self.timeout = max(node.parameters[PeerParameters].peer_timeout for node in nodes)
        start_timeouts = [node.parameters[PeerParameters].start_timeout for node in nodes]
        self._start_timeout = 0.0 if 0.0 in start_timeouts else max(start_timeouts)
        self._timer = next((node for node in nodes if CLOCK in node.outputs), None)
        self._publisher = nodes[0].create_publisher(String, 'lockstep', _QOS)
        self._subscription = nodes[0].create_subscription(String, 'lockstep', self._hear, _QOS)
        self._heard: dict[str, dict[str, Any]] = {}
        self._heard_at: dict[str, float] = {}
        self._spoke_at = 0.0
        self._changed_at = time.monotonic()
        self._unannounced_since: dict[str, float] = {}
        self._doubled_since: dict[str, float] = {}
        self._late_since: dict[tuple[str, int], float] = {}
        self._missing: list[str] = []
        self._told: list[str] = []
        self._told_at = time.monotonic()
        self._graph_checked_at = 0.0
        self._outcome_of_peer: Outcome | None = None

    # Speaking and hearing.

    def _speak(self, reason: str = '') -> None:
        said: dict[str, Any] = {'process': self.identifier, 'state': self.state, 'reason': reason}
        said['ticks'] = {node.get_fully_qualified_name(): node.tick for node in self._nodes}
        said['changes'] = {node.get_fully_qualified_name(): node.changes for node in self._nodes}
        if self.state in (WAITING, READY):
            said['nodes'] = self._own_nodes()
            said['hears'] = list(self._heard)
        directory = next((node.directory for node in self._nodes if node.directory), '')
        if directory:
            said['directory'] = str(Path(directory).absolute())
            self._tell_directory(said['directory'])
        if self._timer is not None:
            timer = self._timer.parameters[TimerParameters]
            said['timer'] = {'sample_time': timer.sample_time, 'last_tick': timer.last_tick, 'rate': timer.rate}
            if self.state in (WAITING, READY):
                said['timer']['schedule'] = timer.schedule
            if self.run is not None and self.state == RUNNING:
                said['run'] = dataclasses.asdict(self.run)
        self._publisher.publish(String(data=json.dumps(said)))
        self._spoke_at = time.monotonic()

    def _hear(self, message: String) -> None:
        try:
            said = json.loads(message.data)
            process = said['process']
        except (ValueError, TypeError, KeyError):
            self._nodes[0].get_logger().warning(f'what was said on lockstep is none of ours: {message.data[:60]!r}')
            return
        if process == self.identifier:
            return
        known = self._heard.get(process)
        if known is None:
            if said['state'] in (INTERRUPTED, FINISHED):
                return  # the end of an earlier run
            self._changed_at = time.monotonic()
        elif 'nodes' not in said:
            said['nodes'] = known.get('nodes', {})
        said.setdefault('nodes', {})
        self._heard[process] = said
        if said.get('directory'):
            self._tell_directory(said['directory'])
        self._heard_at[process] = time.monotonic()
        if said['state'] in (FAILED, INTERRUPTED):
            self._hear_end(process, said)
        if said.get('run') and self.run is None:
            self._hear_start(said['run'])

    def _tell_directory(self, directory: str) -> None:
        for node in self._nodes:
            node.run_directory = Path(directory)

    def _hear_end(self, process: str, said: dict[str, Any]) -> None:
        if self.run is None and said['state'] == INTERRUPTED:
            self._forget(process)  # before a run, a node that a person stops may be started again
        elif self._outcome_of_peer is None and (self.run is None or process in self.run.processes):
            self._outcome_of_peer = Outcome(said['state'], said['reason'])

    def _hear_start(self, run: dict[str, Any]) -> None:
        if self.identifier not in run['processes']:
            names = ', '.join(node.get_fully_qualified_name() for node in self._nodes)
            raise RunError(
                f'{names} came too late: a run is in progress in this namespace; wait for its end, or give this node '
                'another namespace (--ros-args -r __ns:=/bench2)'
            )
        self._start(RunPlan(**run))

    def _forget(self, process: str) -> None:
        self._heard.pop(process, None)
        self._heard_at.pop(process, None)
        self._changed_at = time.monotonic()

    # Before the run.

    def gather(self) -> bool:
        """
        Go on with finding the others; return whether the run has started.

        Raises
        ------
        RunError
            If the run cannot start: a mismatch, two publishers of a topic, a peer that failed or never came.
        """
        now = time.monotonic()
        if self._outcome_of_peer is not None:
            raise RunError(self._outcome_of_peer.reason)
        for process in [process for process, heard_at in self._heard_at.items() if now - heard_at > self.timeout]:
            self._forget(process)
        if self.run is None:
            self._missing = list(self._find_missing())
            state = WAITING if self._missing else READY
            if state != self.state or now - self._spoke_at > _PERIODS[state]:
                self.state = state
                self._speak()
            if self._timer is not None and state == READY and self._all_peers(READY):
                self._start(self._make_run())
            elif self._start_timeout and now - self._changed_at > self._start_timeout:
                raise RunError(
                    f'waited {self._start_timeout:g} s for {"; ".join(self._missing) or self._unready_names()} '
                    '(parameter start_timeout)'
                )
            else:
                self._tell_missing(now)
            return False
        if now - self._spoke_at > _PERIODS[READY]:
            self._speak()
        # A node in place listens already; the timer alone must know that all the others are in place too.
        return self._timer is None or self._all_peers(RUNNING)

    def _unready_names(self) -> str:
        unready = [name for said in self._heard.values() if said['state'] != READY for name in said['nodes']]
        return ', '.join(unready) + ' to get ready' if unready else 'deterministic_timer to start the run'

    def _all_peers(self, *states: str) -> bool:
        processes = self._heard if self.run is None else self.run.processes
        others = [process for process in processes if process != self.identifier]
        for process in others:
            if process not in self._heard:
                assert self.run is not None
                raise RunError(f'lost a peer before tick 0: {process}; it was one of {", ".join(self.run.nodes)}')
        return all(self._heard[process]['state'] in states for process in others)

    def _start(self, run: RunPlan) -> None:
        for node in self._nodes:
            node.begin(run)
        self.run = run
        self.state = RUNNING
        self._speak()

    def _own_nodes(self) -> dict[str, dict[str, Any]]:
        """Return what there is to say of this process's nodes; their parameters may change until the run starts."""
        described = {node.get_fully_qualified_name(): _describe(node) for node in self._nodes}
        timer = self._timer_said()
        if timer is not None:
            try:
                needed = last_ticks_needed(self._nodes, timer['sample_time'])
            except ParameterError as error:
                raise RunError(str(error)) from None
            for name, tick in needed.items():
                described[name]['last_tick_needed'] = tick
            for name, refused in self._refusals(timer):
                described[name]['refuses'] = refused
        return described

    def _refusals(self, timer: dict[str, Any]) -> Iterator[tuple[str, str]]:
        """
        Iterate over nodes of this process and why they cannot do what the timer's schedule says of them.

        They only say so. The timer ends the run for it when all are ready, so that nobody misses the reason.
        """
        if timer.get('schedule'):
            changes = parse_schedule(timer['schedule'], timer['sample_time'], timer['last_tick'])
            for node in self._nodes:
                try:
                    node.plan(changes)
                except ParameterError as error:
                    yield node.get_fully_qualified_name(), str(error)

    def _known_nodes(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Iterate over all nodes that say who they are; one that fell silent may have been killed."""
        yield from self._own_nodes().items()
        now = time.monotonic()
        for process, said in self._heard.items():
            if now - self._heard_at[process] < _FRESH:
                yield from said['nodes'].items()

    def _timer_said(self) -> dict[str, Any] | None:
        if self._timer is not None:
            timer = self._timer.parameters[TimerParameters]
            return {
                'sample_time': timer.sample_time,
                'last_tick': timer.last_tick,
                'schedule': timer.schedule,
            }
        return next((said['timer'] for said in self._heard.values() if 'timer' in said), None)

    def _find_missing(self) -> Iterator[str]:
        timer = self._timer_said()
        if timer is None:
            yield 'deterministic_timer'
        else:
            self._check_sample_time(timer['sample_time'])
        nodes = list(self._known_nodes())
        for node in self._nodes:
            for wire in node.inputs:
                announced = [name for name, description in nodes if wire.name in description['outputs']]
                self._check_announced(wire.name, announced)
                if node.count_publishers(wire.name) > 1:
                    yield self._second_publisher(node, wire.name)
                if wire.subscription.get_publisher_count() == 0:
                    yield f'{wire.topic.writer} (nobody publishes {wire.name})'
                elif announced:
                    # From now on it is one of ours, also while it is too busy to speak.
                    self._unannounced_since[wire.name] = math.inf
                elif not self._is_foreign(wire.name):
                    yield f'the publisher of {wire.name} to say who it is'
            for wire in node.optional_inputs:
                announced = [name for name, description in nodes if wire.name in description['outputs']]
                self._check_announced(wire.name, announced)
                if announced and wire.subscription.get_publisher_count() == 0:
                    yield f'{announced[0]} (not yet heard on {wire.name})'
            for publisher in node.loop_publishers:
                readers = sum(publisher.topic_name in description['inputs'] for _, description in nodes)
                if publisher.get_subscription_count() < readers:
                    yield f'the readers of {publisher.topic_name}'
        if self._timer is not None and self._timer.parameters[TimerParameters].record:
            recorded = [output for _, node in nodes for output in node['outputs'] if output.endswith(RECORDED.name)]
            if not recorded:
                yield f'{RECORDER} (parameter record of deterministic_timer is true)'
        if self._timer is not None:
            yield from self._find_unready()

    def _find_unready(self) -> Iterator[str]:
        """Say whom the timer waits for, among them those that only others have heard of so far."""
        known = {self.identifier, *self._heard}
        for process, said in self._heard.items():
            if said['state'] != READY:
                yield f'{", ".join(said["nodes"]) or process} to get ready'
            unheard = set(said.get('hears', ())) - known
            if unheard:
                yield f'{len(unheard)} more that {", ".join(said["nodes"])} can hear'

    def _is_foreign(self, topic: str) -> bool:
        """Return whether a topic's publisher is none of ours: it had time to say who it is and did not."""
        now = time.monotonic()
        return now - self._unannounced_since.setdefault(topic, now) > _FOREIGN_AFTER

    def _check_sample_time(self, sample_time: float) -> None:
        for node in self._nodes:
            own = node.parameters[SampleTimeParameters].sample_time if node is not self._timer else sample_time
            if own not in (0.0, sample_time):
                raise RunError(
                    f'{node.get_fully_qualified_name()}: parameter sample_time = {own!r} s is refused: '
                    f'deterministic_timer has {sample_time!r} s'
                )

    @staticmethod
    def _check_announced(topic: str, announced: Sequence[str]) -> None:
        if len(announced) > 1:
            raise RunError(f'{topic}: {len(announced)} publishers, one is allowed: {", ".join(announced)}')

    def _second_publisher(self, node: LoopNode, topic: str) -> str:
        """
        Judge a second publisher before the run: DDS remembers one that was killed until its lease has run out.

        Returns
        -------
        str
            What to wait for.

        Raises
        ------
        RunError
            If two different nodes publish the topic, or one has done so for longer than any lease.
        """
        names = publishers_of(node, topic)
        different = len(set(names.split(', '))) > 1 and UNKNOWN_NODE not in names
        now = time.monotonic()
        if different or now - self._doubled_since.setdefault(topic, now) > _LEASE:
            raise RunError(f'{topic}: 2 publishers, one is allowed: {names}')
        return f'one of two publishers of {topic} to go ({names})'

    @staticmethod
    def _check_publishers(node: LoopNode, topic: str) -> None:
        count = node.count_publishers(topic)
        if count > 1:
            raise RunError(
                f'{topic}: {count} publishers at tick {node.tick}, one is allowed: {publishers_of(node, topic)}'
            )

    def _tell_missing(self, now: float) -> None:
        period = 0.5 if self._missing != self._told else 3.0
        if self._missing and now - self._told_at > max(period, 1.0):
            self._nodes[0].get_logger().info('waiting for ' + '; '.join(self._missing))
            self._told, self._told_at = self._missing, now

    def _make_run(self) -> RunPlan:
        assert self._timer is not None
        timer = self._timer.parameters[TimerParameters]
        nodes = dict(self._known_nodes())
        frame_id = next((d['offers']['frame_id'] for d in nodes.values() if 'frame_id' in d['offers']), '')
        processes = [self.identifier, *self._heard]
        name = self._timer.get_fully_qualified_name()
        for node in nodes.values():
            if 'refuses' in node:
                raise RunError(node['refuses'])
        needed = {name: node['last_tick_needed'] for name, node in nodes.items() if 'last_tick_needed' in node}
        try:
            refuse_strangers(timer.changes, list(nodes))
            last_tick = last_tick_of_run(timer, needed)
        except ParameterError as error:
            raise RunError(str(error)) from None
        schedule = list(timer.schedule)
        return RunPlan(timer.sample_time, last_tick, timer.rate, frame_id, name, nodes, processes, schedule)

    # During the run.

    def watch(self, stalled: float = math.inf) -> None:
        """
        Look after the others while the loop runs.

        Parameters
        ----------
        stalled
            For how long no node of this process has fired [s].

        Raises
        ------
        RunError
            If a peer is silent for too long, a message was lost, or a topic has a second publisher.
        PeerEnded
            If a peer said that the run ends.
        """
        assert self.run is not None
        now = time.monotonic()
        if now - self._spoke_at > _PERIODS[self.state]:
            self._speak()
        if self._outcome_of_peer is not None:
            raise PeerEnded(self._outcome_of_peer)
        # While ticks go on, most of the others must be alive, and only their word is late: DDS repeats what got lost
        # after a while, and a busy machine loses much.
        patience = self.timeout if stalled > _STALLED else _PATIENCE_UNDER_WAY * self.timeout
        for process in self.run.processes:
            silent = now - self._heard_at.get(process, now)
            if process != self.identifier and silent > patience:
                self._refuse_silent(process, silent)
        if now - self._graph_checked_at > 1.0:
            self._graph_checked_at = now
            for node in self._nodes:
                for wire in node.inputs:
                    self._check_publishers(node, wire.name)

    def _refuse_silent(self, process: str, silent: float) -> None:
        said = self._heard[process]
        if said['state'] == DONE:
            return  # it had nothing left to do
        waits = ', '.join(
            f'{node.get_name()} is at tick {node.tick}'
            if (wire := node.missing()) is None
            else f'{wire.name} is missing for tick {node.tick - wire.delay}'
            for node in self._nodes
        )
        raise RunError(f'lost a peer: nothing heard for {silent:.1f} s from {", ".join(said["ticks"])}; {waits}')

    def check_stall(self, stalled: float) -> None:
        """
        Judge why the loop stands still.

        Parameters
        ----------
        stalled
            For how long [s].

        Raises
        ------
        RunError
            If a message was published and did not arrive, or if its publisher is none of ours and does not answer.
        """
        assert self.run is not None
        # DDS repeats what got lost within 3 s.
        if stalled < self.timeout + 1.0:
            self._late_since.clear()
            return
        ticks = {name: tick for said in self._heard.values() for name, tick in said['ticks'].items()}
        ticks.update({node.get_fully_qualified_name(): node.tick for node in self._nodes})
        for node in self._nodes:
            wire = node.missing()
            if wire is None:
                continue
            expected = node.tick - wire.delay
            producer = self.run.publisher_of(wire.name)
            if producer is None:
                if ticks[self.run.timer] > expected and self._is_late(wire.name, expected):
                    raise RunError(
                        f'{wire.name}: nothing for tick {expected} in {stalled:.1f} s; '
                        f'published by {publishers_of(node, wire.name)}'
                    )
            elif ticks[producer] > expected and self._is_late(wire.name, expected):
                raise RunError(f'{wire.name}: tick {expected} was published by {producer} and did not arrive')

    def _is_late(self, topic: str, tick: int) -> bool:
        """Return whether a message has been overdue for a while: right after a pause, the first one is under way."""
        now = time.monotonic()
        return now - self._late_since.setdefault((topic, tick), now) > _UNDER_WAY

    # The end.

    def final_changes(self) -> dict[str, int] | None:
        """Return how often each node's parameters were changed; None while another process still runs."""
        assert self.run is not None
        if not self._all_peers(DONE, FINISHED):
            return None
        changes = {node.get_fully_qualified_name(): node.changes for node in self._nodes}
        for process in self.run.processes:
            changes.update(self._heard.get(process, {}).get('changes', {}))
        return changes

    def close_ranks(self) -> bool:
        """Say that this process is done; return whether the whole run is finished."""
        if self.state == RUNNING:
            self.state = DONE
            self._speak()
        assert self.run is not None
        if self._timer is None:
            for said in self._heard.values():
                if 'timer' in said and said['state'] == FINISHED:
                    return True
            return self._timer_is_gone()
        return self._all_peers(DONE, FINISHED)

    def _timer_is_gone(self) -> bool:
        """Return whether the timer fell silent after it was done: its last word was lost, the run is complete."""
        now = time.monotonic()
        return any(
            said['state'] in (DONE, FINISHED) and now - self._heard_at[process] > self.timeout
            for process, said in self._heard.items()
            if 'timer' in said
        )

    def say_end(self, outcome: Outcome) -> None:
        """Tell the others how the run ended for this process, and see that they got it."""
        if outcome == FINISHED_OUTCOME:
            self.state = FINISHED
        elif self._outcome_of_peer is not None and self.run is not None:
            return  # all that take part know already
        else:
            self.state = outcome.status
        self._speak(outcome.reason)
        if self.run is None:
            # Some of those that wait may not have found this process yet, or not the one that failed first.
            for _ in range(_LAST_WORDS):
                time.sleep(_PERIODS[WAITING])
                self._speak(outcome.reason)
        self._publisher.wait_for_all_acked(_ACKNOWLEDGED_WITHIN)


class PeerEnded(Exception):
    """A peer said that the run ends, and how."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.reason)
        self.outcome = outcome


def _describe(node: LoopNode) -> dict[str, Any]:
    """Return what the others, and ``run.yaml``, shall know of a node."""
    return {
        'inputs': [wire.name for wire in (*node.inputs, *node.optional_inputs)],
        'outputs': [publisher.topic_name for publisher in node.loop_publishers],
        'offers': node.offers(),
        'parameters': node.parameters.as_mapping(),
    }
