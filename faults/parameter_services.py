"""Extreme and wrong parameter values, set by the parameter services of a running rig."""

import collections
import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically

from faults.campaign import HANG, TRACEBACK, WRONG, Campaign, Fault, Trial
from faults.external_node import ExternalNode, external_node
from faults.judging import call, false_claims, wait_until
from faults.odd_values import is_named, odd_value
from faults.processes import LONGEST_START, NODES, Processes, processes
from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLERS
from hdd_servo_ros.graph.known_parameters import node_declarations
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.tools.replay import main as replay

SETS = 400
"""Number of requests of a trial, each with one to three parameters."""
_TIMEOUT = 120.0
"""Time limit of a request; the rig handles requests ten times per second unless the machine is busy [s]."""
_FIELDS = {
    ParameterType.PARAMETER_BOOL: 'bool_value',
    ParameterType.PARAMETER_INTEGER: 'integer_value',
    ParameterType.PARAMETER_DOUBLE: 'double_value',
    ParameterType.PARAMETER_STRING: 'string_value',
    ParameterType.PARAMETER_BYTE_ARRAY: 'byte_array_value',
    ParameterType.PARAMETER_BOOL_ARRAY: 'bool_array_value',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'integer_array_value',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double_array_value',
    ParameterType.PARAMETER_STRING_ARRAY: 'string_array_value',
}
_OF_SCALAR = {bool: 1, int: 2, float: 3, str: 4}
_OF_LIST = {bool: 6, int: 7, float: 8, str: 9}
_LARGEST_INTEGER = 2**63 - 1
_NOT_FINITE = 'not finite'


def trial(folder: Path, choice: random.Random) -> Trial:
    """Set parameters of a slow rig repeatedly, and restore them, some of them only after a few ticks."""
    controller = choice.choice([name for name in CONTROLLERS if CONTROLLERS[name] != 'signal_analyzer'])
    with processes(folder) as run:
        rig = run.start(
            'rig', '-p', 'duration:=1.0', '-p', 'rate:=0.01', '-p', 'run_dir:=run', '-p', 'plot:=false',
            '-p', f'rig:controller:={controller}',
        )  # fmt: skip
        if not wait_until((folder / 'run' / 'bag').exists, LONGEST_START):
            return Trial('did not start', [Fault(WRONG, run.output('rig')[-300:])])
        nodes = ['rig', *NODES]
        nodes[nodes.index('adaptive_nn_controller')] = CONTROLLERS[controller]
        with external_node(run.domain) as external:
            session = _Session(external, choice, nodes, lambda: rig.poll() is None)
            session.hold()
        faults = run.ended()
        return _judged(folder / 'run', rig.returncode, run, session, faults)


def _judged(recorded: Path, code: int, run: Processes, session: '_Session', faults: list[Fault]) -> Trial:
    faults = [*session.faults, *faults]
    outcome = 'finished' if code == 0 else 'ended at the first value that is not finite'
    outcome += ', replay is bit-identical'
    if not any(fault.kind == HANG for fault in faults):
        output = run.output('rig')
        if code not in (0, 1) or (code == 1 and _NOT_FINITE not in output):
            faults.append(Fault(WRONG, f'the run ended with {code}: {output[-500:]}'))
        faults += false_claims(recorded, code, None)
        if code == 0 and not faults:
            found = len(Run.open(recorded).parameter_changes)
            if not session.changed <= found <= session.changed + session.pending:
                faults.append(Fault(WRONG, f'{session.changed} parameters were changed, {found} changes are recorded'))
        again, printed, found_again = call(replay, [str(recorded), '--without-ros'])
        faults += found_again
        if again != 0 and not found_again:
            faults.append(Fault(WRONG, f'replay: exit code {again}: {printed[-500:]}'))
    if faults:
        faults = [*faults, Fault(WRONG, f'accepted: {session.accepted[-6:]}')]
    return Trial(outcome, faults, counts=session.counts)


class _Session:
    """Requests to a running rig, and their responses."""

    def __init__(
        self, external: ExternalNode, choice: random.Random, nodes: Sequence[str], is_running: Callable[[], bool]
    ) -> None:
        self._external, self._choice, self._nodes, self._is_running = external, choice, nodes, is_running
        self.counts: collections.Counter[str] = collections.Counter()
        self.faults: list[Fault] = []
        self.accepted: list[str] = []
        """The last accepted requests."""
        self.changed = 0
        """Number of parameter changes."""
        self.pending = 0
        """Number of parameters in requests that were pending at the end of the run."""
        create = external.node.create_client
        self._one_by_one = {node: create(SetParameters, f'/{node}/set_parameters') for node in nodes}
        self._together = {node: create(SetParametersAtomically, f'/{node}/set_parameters_atomically') for node in nodes}
        self._get = {node: create(GetParameters, f'/{node}/get_parameters') for node in nodes}
        self._before: dict[str, dict[str, ParameterValue]] = {}
        """Initial values of the parameters of each node that can be changed."""

    def hold(self) -> None:
        """Send the requests, one per node at a time, restore accepted changes, and let the run end."""
        clients = [*self._one_by_one.values(), *self._together.values(), *self._get.values()]
        if not self._external.spin_until(lambda: all(client.service_is_ready() for client in clients), _TIMEOUT):
            self.faults.append(Fault(HANG, 'the services are missing'))
            return
        for node in self._nodes:
            names = [each.name for each in node_declarations(node) if not each.read_only]
            (response,) = self._responses([self._get[node].call_async(GetParameters.Request(names=names))])
            if response is None:
                return
            self._before[node] = dict(zip(names, response.values, strict=True))
        for _ in range(SETS // len(self._nodes)):
            if self.faults or not self._is_running():
                break
            # Some changes last for a few ticks, others are restored before the next tick.
            (self._with_ticks if self._choice.random() < 0.5 else self._without_ticks)()
        if self._is_running():
            fast = Parameter(name='rate', value=ParameterValue(type=3, double_value=0.0))
            self._restore([('deterministic_timer', [fast])])

    def _with_ticks(self) -> None:
        sent = [(node, self._odd(node), self._choice.random() < 0.5) for node in self._nodes]
        responses = self._responses([self._send(*each) for each in sent])
        restored = []
        for (node, given, is_together), response in zip(sent, responses, strict=True):
            if self._has_arrived(response, given):
                changed = self._judge(node, given, _results(response), is_together)
                restored += [(node, back)] if (back := self._as_before(node, changed)) else []
        self._restore(restored)

    def _without_ticks(self) -> None:
        sent = [(node, self._odd(node), self._choice.random() < 0.5) for node in self._nodes]
        # In reverse order, so that each value meets the ones with which it was accepted.
        restored = [(node, self._as_before(node, given)[::-1], is_together) for node, given, is_together in sent]
        restored = [each for each in restored if each[1]]
        responses = self._responses([self._send(*each) for each in [*sent, *restored]])
        for (node, given, is_together), response in zip(sent, responses[: len(sent)], strict=True):
            if self._has_arrived(response, given):
                self._judge(node, given, _results(response), is_together)
        for (node, given, _), response in zip(restored, responses[len(sent) :], strict=True):
            if self._has_arrived(response, given):
                self._judge_restored(node, given, _results(response))

    def _restore(self, restored: Sequence[tuple[str, list[Parameter]]]) -> None:
        responses = self._responses([self._send(node, given, True) for node, given in restored])
        for (node, given), response in zip(restored, responses, strict=True):
            if self._has_arrived(response, given):
                self._judge_restored(node, given, _results(response))

    def _has_arrived(self, response: Any, given: Sequence[Parameter]) -> bool:
        self.pending += len(given) if response is None else 0
        return response is not None

    def _send(self, node: str, given: list[Parameter], is_together: bool) -> Any:
        if is_together:
            return self._together[node].call_async(SetParametersAtomically.Request(parameters=given))
        return self._one_by_one[node].call_async(SetParameters.Request(parameters=given))

    def _responses(self, futures: Sequence[Any]) -> list[Any]:
        """Wait for responses; None for those that do not arrive, as after the end of the run."""
        self._external.spin_until(lambda: all(each.done() for each in futures) or not self._is_running(), _TIMEOUT)
        if self._is_running() and not all(each.done() for each in futures):
            self.faults.append(Fault(HANG, f'no response within {_TIMEOUT:g} s'))
        return [each.result() if each.done() else None for each in futures]

    def _odd(self, node: str) -> list[Parameter]:
        return [_parameter(self._choice, node) for _ in range(self._choice.randint(1, 3))]

    def _as_before(self, node: str, given: Sequence[Parameter]) -> list[Parameter]:
        before = self._before[node]
        return [Parameter(name=each.name, value=before[each.name]) for each in given if each.name in before]

    def _judge(
        self, node: str, given: list[Parameter], results: Sequence[SetParametersResult], is_together: bool
    ) -> list[Parameter]:
        """Check the response to a request; return the changed parameters."""
        how = 'set_parameters_atomically' if is_together else 'set_parameters'
        changed: list[Parameter] = []
        for part, result in zip([given] if is_together else [[each] for each in given], results, strict=True):
            self.counts[f'{how}: {"accepted" if result.successful else "rejected"}'] += 1
            if not result.successful:
                # The conflict may be with a parameter accepted earlier in the same request.
                self.faults += _wrong_reason(node, given, result.reason)
                continue
            # Of several values of one name only the last one takes effect.
            held = {each.name: each for each in part}.values()
            self.faults += [Fault(WRONG, f'{node} accepts {_written(each)}') for each in held if _is_wrong(node, each)]
            self.accepted = [*self.accepted[-9:], f'{node} {[_written(each) for each in part]}']
            changed += held
        self.changed += len(changed)
        return changed

    def _judge_restored(self, node: str, given: list[Parameter], results: Sequence[SetParametersResult]) -> None:
        for part, result in zip([given] if len(results) == 1 else [[each] for each in given], results, strict=True):
            self.changed += len({each.name for each in part}) if result.successful else 0
            if not result.successful:
                values = [_written(each) for each in part]
                self.faults.append(Fault(WRONG, f'{node} rejects the initial values {values}: {result.reason}'))


def _results(response: Any) -> Sequence[SetParametersResult]:
    return [response.result] if isinstance(response, SetParametersAtomically.Response) else response.results


def _parameter(choice: random.Random, node: str) -> Parameter:
    """Choose a parameter of a node or an unknown name, and a value of its type or of another one."""
    _, name, value = odd_value(choice, node)
    if choice.random() < 0.05:
        return Parameter(name=name + '_', value=ParameterValue(type=3, double_value=1.0))
    made = _message_of(node, name, value)
    if choice.random() < 0.1:
        # A type that the value does not have, or that does not exist.
        made.type = choice.choice([*range(12), 200, 255])
    return Parameter(name=name, value=made)


def _message_of(node: str, name: str, value: Any) -> ParameterValue:
    """Return a value as a message, with the declared type for an empty list."""
    declared = next(each for each in node_declarations(node) if each.name == name)
    elements = value if isinstance(value, list) else [value]
    kinds = {type(element) for element in elements} or {declared.element_type}
    if len(kinds) > 1 or not kinds <= set(_OF_SCALAR):
        return ParameterValue(type=0)
    (kind,) = kinds
    if kind is int:
        elements = [min(max(element, -_LARGEST_INTEGER), _LARGEST_INTEGER) for element in elements]
    number = (_OF_LIST if isinstance(value, list) else _OF_SCALAR)[kind]
    return ParameterValue(type=number, **{_FIELDS[number]: elements if isinstance(value, list) else elements[0]})


def _plain(given: Parameter) -> Any:
    field = _FIELDS.get(given.value.type)
    value = None if field is None else getattr(given.value, field)
    return value if value is None or isinstance(value, bool | int | float | str) else list(value)


def _written(given: Parameter) -> str:
    return f'{given.name} (type {given.value.type}) = {str(_plain(given))[:80]}'


def _is_wrong(node: str, given: Parameter) -> bool:
    """Return whether the declaration rejects a value."""
    declared = {each.name: each for each in node_declarations(node)}.get(given.name)
    value = _plain(given)
    if declared is None or value is None or declared.read_only:
        return True
    try:
        declared.check(tuple(value) if isinstance(value, list) else value)
    except ParameterError:
        return True
    return False


def _wrong_reason(node: str, given: Sequence[Parameter], reason: str) -> Iterator[Fault]:
    """Yield the faults in the reason of a rejection."""
    values = [_written(each) for each in given]
    if not any(is_named(reason, node, each.name) for each in given):
        yield Fault(WRONG, f'{node} rejects {values} without the name of a parameter: {reason!r}')
    if '\n' in reason or len(reason) > 1000:
        yield Fault(TRACEBACK, f'{node} rejects {values} in more than one line: {reason[:300]!r}')


CAMPAIGN = Campaign('services', 'Parameter values set by services', 20, 1, 3600.0, trial)
"""8,000 requests in total."""
