"""Parameter values as nobody should give them, set on a running rig by its parameter services."""

import collections
import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically

from faults.campaign import HANG, TRACEBACK, WRONG, Campaign, Fault, Trial
from faults.judging import call, false_claims, wait_until
from faults.odd_values import is_named, odd_value
from faults.outside import Outside, outside
from faults.processes import LONGEST_START, NODES, Processes, processes
from hdd_servo_ros import Run
from hdd_servo_ros.graph.catalog import CONTROLLERS
from hdd_servo_ros.graph.known_parameters import node_declarations
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.tools.replay import main as replay

SETS = 400
"""Requests of a trial, each for one to three parameters."""
_ANSWER = 120.0
"""Time in which a request is answered; the rig looks for them ten times a second, unless the machine is busy [s]."""
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
    """Set parameters of a slow rig again and again, some changes with ticks before they are taken back."""
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
        with outside(run.domain) as stranger:
            session = _Session(stranger, choice, nodes, lambda: rig.poll() is None)
            session.hold()
        faults = run.ended()
        return _judged(folder / 'run', rig.returncode, run, session, faults)


def _judged(recorded: Path, code: int, run: Processes, session: '_Session', faults: list[Fault]) -> Trial:
    faults = [*session.faults, *faults]
    outcome = 'finished, replays to the bit' if code == 0 else 'ends at its first value that is not finite, replays'
    if not any(fault.kind == HANG for fault in faults):
        said = run.output('rig')
        if code not in (0, 1) or (code == 1 and _NOT_FINITE not in said):
            faults.append(Fault(WRONG, f'the run ends with {code}: {said[-500:]}'))
        faults += false_claims(recorded, code, None)
        if code == 0 and not faults:
            found = len(Run.open(recorded).parameter_changes)
            if not session.changed <= found <= session.changed + session.unanswered:
                faults.append(Fault(WRONG, f'{session.changed} parameters were changed, {found} changes are recorded'))
        again, printed, found_again = call(replay, [str(recorded), '--without-ros'])
        faults += found_again
        if again != 0 and not found_again:
            faults.append(Fault(WRONG, f'replay: exit code {again}: {printed[-500:]}'))
    if faults:
        faults = [*faults, Fault(WRONG, f'accepted: {session.accepted[-6:]}')]
    return Trial(outcome, faults, counts=session.counts)


class _Session:
    """What is asked of a rig while it runs, and what it answers."""

    def __init__(
        self, stranger: Outside, choice: random.Random, nodes: Sequence[str], goes_on: Callable[[], bool]
    ) -> None:
        self._stranger, self._choice, self._nodes, self._goes_on = stranger, choice, nodes, goes_on
        self.counts: collections.Counter[str] = collections.Counter()
        self.faults: list[Fault] = []
        self.accepted: list[str] = []
        """The last sets that were accepted."""
        self.changed = 0
        """Parameters that were changed, each as often as it was."""
        self.unanswered = 0
        """Those of requests that were under way when the run ended."""
        create = stranger.node.create_client
        self._one_by_one = {node: create(SetParameters, f'/{node}/set_parameters') for node in nodes}
        self._together = {node: create(SetParametersAtomically, f'/{node}/set_parameters_atomically') for node in nodes}
        self._get = {node: create(GetParameters, f'/{node}/get_parameters') for node in nodes}
        self._before: dict[str, dict[str, ParameterValue]] = {}
        """What can be changed of each node, as it is at first."""

    def hold(self) -> None:
        """Make the requests, one of each node at a time, take back what is accepted, and let the run end."""
        clients = [*self._one_by_one.values(), *self._together.values(), *self._get.values()]
        if not self._stranger.spin_until(lambda: all(client.service_is_ready() for client in clients), _ANSWER):
            self.faults.append(Fault(HANG, 'the services are not there'))
            return
        for node in self._nodes:
            names = [each.name for each in node_declarations(node) if not each.read_only]
            (answer,) = self._answers([self._get[node].call_async(GetParameters.Request(names=names))])
            if answer is None:
                return
            self._before[node] = dict(zip(names, answer.values, strict=True))
        for _ in range(SETS // len(self._nodes)):
            if self.faults or not self._goes_on():
                break
            # Of some a tick sees the change, others are taken back before the next tick.
            (self._with_ticks if self._choice.random() < 0.5 else self._without_ticks)()
        if self._goes_on():
            fast = Parameter(name='rate', value=ParameterValue(type=3, double_value=0.0))
            self._take_back([('deterministic_timer', [fast])])

    def _with_ticks(self) -> None:
        asked = [(node, self._odd(node), self._choice.random() < 0.5) for node in self._nodes]
        answers = self._answers([self._ask(*each) for each in asked])
        backs = []
        for (node, given, is_together), answer in zip(asked, answers, strict=True):
            if self._is_there(answer, given):
                changed = self._judge(node, given, _results(answer), is_together)
                backs += [(node, back)] if (back := self._as_before(node, changed)) else []
        self._take_back(backs)

    def _without_ticks(self) -> None:
        asked = [(node, self._odd(node), self._choice.random() < 0.5) for node in self._nodes]
        # Backwards each value meets the others that were there when it was accepted.
        backs = [(node, self._as_before(node, given)[::-1], is_together) for node, given, is_together in asked]
        backs = [each for each in backs if each[1]]
        answers = self._answers([self._ask(*each) for each in [*asked, *backs]])
        for (node, given, is_together), answer in zip(asked, answers[: len(asked)], strict=True):
            if self._is_there(answer, given):
                self._judge(node, given, _results(answer), is_together)
        for (node, given, _), answer in zip(backs, answers[len(asked) :], strict=True):
            if self._is_there(answer, given):
                self._judge_back(node, given, _results(answer))

    def _take_back(self, backs: Sequence[tuple[str, list[Parameter]]]) -> None:
        answers = self._answers([self._ask(node, given, True) for node, given in backs])
        for (node, given), answer in zip(backs, answers, strict=True):
            if self._is_there(answer, given):
                self._judge_back(node, given, _results(answer))

    def _is_there(self, answer: Any, given: Sequence[Parameter]) -> bool:
        self.unanswered += len(given) if answer is None else 0
        return answer is not None

    def _ask(self, node: str, given: list[Parameter], is_together: bool) -> Any:
        if is_together:
            return self._together[node].call_async(SetParametersAtomically.Request(parameters=given))
        return self._one_by_one[node].call_async(SetParameters.Request(parameters=given))

    def _answers(self, futures: Sequence[Any]) -> list[Any]:
        """Wait for answers; None for those that do not come, as none does once the run has ended."""
        self._stranger.spin_until(lambda: all(each.done() for each in futures) or not self._goes_on(), _ANSWER)
        if self._goes_on() and not all(each.done() for each in futures):
            self.faults.append(Fault(HANG, f'no answer within {_ANSWER:g} s'))
        return [each.result() if each.done() else None for each in futures]

    def _odd(self, node: str) -> list[Parameter]:
        return [_parameter(self._choice, node) for _ in range(self._choice.randint(1, 3))]

    def _as_before(self, node: str, given: Sequence[Parameter]) -> list[Parameter]:
        before = self._before[node]
        return [Parameter(name=each.name, value=before[each.name]) for each in given if each.name in before]

    def _judge(
        self, node: str, given: list[Parameter], results: Sequence[SetParametersResult], is_together: bool
    ) -> list[Parameter]:
        """Judge the answer to a request; return the parameters that it changed."""
        how = 'set_parameters_atomically' if is_together else 'set_parameters'
        changed: list[Parameter] = []
        for part, result in zip([given] if is_together else [[each] for each in given], results, strict=True):
            self.counts[f'{how}: {"accepted" if result.successful else "rejected"}'] += 1
            if not result.successful:
                # One of the same request that was accepted before may be what it does not go with.
                self.faults += _wrong_reason(node, given, result.reason)
                continue
            # The last value of a name is the one that holds; the others are never in force.
            held = {each.name: each for each in part}.values()
            self.faults += [Fault(WRONG, f'{node} accepts {_written(each)}') for each in held if _is_wrong(node, each)]
            self.accepted = [*self.accepted[-9:], f'{node} {[_written(each) for each in part]}']
            changed += held
        self.changed += len(changed)
        return changed

    def _judge_back(self, node: str, given: list[Parameter], results: Sequence[SetParametersResult]) -> None:
        for part, result in zip([given] if len(results) == 1 else [[each] for each in given], results, strict=True):
            self.changed += len({each.name for each in part}) if result.successful else 0
            if not result.successful:
                what = [_written(each) for each in part]
                self.faults.append(Fault(WRONG, f'{node} rejects to go back to {what}: {result.reason}'))


def _results(answer: Any) -> Sequence[SetParametersResult]:
    return [answer.result] if isinstance(answer, SetParametersAtomically.Response) else answer.results


def _parameter(choice: random.Random, node: str) -> Parameter:
    """Choose a parameter of a node, or none of it, and a value of its type or of another one."""
    _, name, value = odd_value(choice, node)
    if choice.random() < 0.05:
        return Parameter(name=name + '_', value=ParameterValue(type=3, double_value=1.0))
    made = _message_of(node, name, value)
    if choice.random() < 0.1:
        # A type that the value is not of, or that there is not.
        made.type = choice.choice([*range(12), 200, 255])
    return Parameter(name=name, value=made)


def _message_of(node: str, name: str, value: Any) -> ParameterValue:
    """Return a value as a message, of the declared type if it has none of its own."""
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
    """Return whether a value is none that its declaration allows."""
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
    """Iterate over what is wrong with the reason of a rejection."""
    what = [_written(each) for each in given]
    if not any(is_named(reason, node, each.name) for each in given):
        yield Fault(WRONG, f'{node} rejects {what} without its name: {reason!r}')
    if '\n' in reason or len(reason) > 1000:
        yield Fault(TRACEBACK, f'{node} rejects {what} in more than a line: {reason[:300]!r}')


CAMPAIGN = Campaign('services', 'Parameter values by the services of a running rig', 20, 1, 3600.0, trial)
"""8,000 requests in all."""
