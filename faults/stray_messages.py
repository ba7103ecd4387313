"""Messages of an external publisher on every topic of a run, during the run."""

import collections
import itertools
import json
import random
import struct
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from geometry_msgs.msg import Vector3Stamped
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray, Header, String

from faults.campaign import WRONG, Campaign, Fault, Trial
from faults.external_node import external_node
from faults.judging import false_claims, wait_until
from faults.processes import LONGEST_START, processes
from faults.reference import reference_run

SERVICE = {'lockstep': String, 'recorded': Header, 'scope': Float64MultiArray, 'parameter_events': ParameterEvent}
LOOP = {'clock': Clock, 'reference': Vector3Stamped, 'ldv': Vector3Stamped, 'control': Vector3Stamped}
MANY = 10
"""Number of messages of a trial on auxiliary topics, which the run must ignore; one on a loop topic ends the run."""
_STATES = ('waiting', 'ready', 'running', 'done', 'finished', 'failed', 'interrupted', 'asleep', None, 3)
_NODES = ('/vcm_plant', '/ldv_sensor', '/nobody', '', 7)


def trial(folder: Path, choice: random.Random) -> Trial:
    """Publish stray messages during a run: ten that the rig must ignore, or one that ends the run."""
    is_service = choice.random() < 0.8
    topics = choice.choices(list(SERVICE), k=MANY) if is_service else [choice.choice(list(LOOP))]
    strays = [(topic, payload({**SERVICE, **LOOP}[topic], choice)) for topic in topics]
    with processes(folder) as run:
        over_dds = choice.random() < 0.5 or not is_service
        rig = run.start(
            'rig', *('-p', 'duration:=0.25', '-p', 'rate:=0.1', '-p', 'run_dir:=run', '-p', 'plot:=false'),
            *('-p', f'rig:intra_process:={str(not over_dds).lower()}'),
        )  # fmt: skip
        if not wait_until((folder / 'run' / 'bag').exists, LONGEST_START):
            return Trial('did not start', [Fault(WRONG, run.output('rig')[-300:])])
        published = _publish(run.domain, strays, lambda: rig.poll() is None)
        faults = run.ended()
        code = rig.returncode
        where = 'auxiliary topics' if is_service else f'/{topics[0]}'
        if faults:
            return Trial(where, faults)
        faults += false_claims(folder / 'run', code, reference_run(folder.parent))
        if is_service and code != 0:
            faults.append(Fault(WRONG, f'the run was ended: {run.output("rig")[-300:]}; {strays!r}'))
        if not is_service and code != 0 and f'/{topics[0]}: ' not in run.output('rig'):
            faults.append(Fault(WRONG, f'/{topics[0]} is not named: {run.output("rig")[-300:]}'))
        outcome = f'{where}: {"run continues" if code == 0 else "run ends and names topic and publisher"}'
        return Trial(outcome, faults, counts={f'messages on /{topic}': count for topic, count in published.items()})


def _publish(
    domain: int, strays: Sequence[tuple[str, bytes]], is_running: Callable[[], bool]
) -> collections.Counter[str]:
    """Publish the messages in a cycle during a run; return the number of different ones per topic."""
    different: set[tuple[str, bytes]] = set()
    with external_node(domain) as external:
        kinds = {**SERVICE, **LOOP}
        create = external.node.create_publisher
        publishers = {topic: create(kinds[topic], f'/{topic}', 10) for topic in dict(strays)}
        for topic, message in itertools.cycle(strays):
            if not is_running():
                break
            if publishers[topic].get_subscription_count():
                publishers[topic].publish(message)
                different.add((topic, message))
            time.sleep(0.02)
    return collections.Counter(topic for topic, _ in different)


def payload(kind: Any, choice: random.Random) -> bytes:
    """Return the bytes of a message of a type, intact or damaged."""
    intact: bytes = serialize_message(_message(kind, choice))
    if choice.random() < 0.5:
        return intact
    damaged = bytearray(intact)
    for _ in range(choice.randint(1, 8)):
        damaged[choice.randrange(len(damaged))] = choice.randrange(256)
    return bytes(damaged[: choice.randint(0, len(damaged))] if choice.random() < 0.5 else damaged)


def _message(kind: Any, choice: random.Random) -> Any:
    made = kind()
    if kind is String:
        made.data = _text(choice)
    elif kind is Float64MultiArray:
        made.data = [choice.uniform(-1.0, 1.0) for _ in range(choice.randint(0, 20))]
    elif kind is ParameterEvent:
        made.node = '/nobody'
        made.stamp.sec = choice.randint(-(2**31), 2**31 - 1)
    else:
        stamp = made.clock if kind is Clock else made.stamp if kind is Header else made.header.stamp
        stamp.sec, stamp.nanosec = choice.randint(-3, 3), choice.randrange(2**32)
    return made


def _text(choice: random.Random) -> str:
    number: Any = choice.choice([-1, 0, 2**63, 1e400, True, 'one', None, [], struct.calcsize('d')])
    content = {
        'process': choice.choice(['x', 7, None, 'host:1:a']),
        'state': choice.choice(_STATES),
        'ticks': choice.choice([{str(choice.choice(_NODES)): number}, number, [number]]),
        'nodes': choice.choice([None, {}, {'/x': {}}, number, {'/x': {'inputs': number}}]),
        'run': choice.choice([None, {}, {'processes': number}, number]),
        'timer': choice.choice([None, {'sample_time': number}, number]),
    }
    kept = {key: value for key, value in content.items() if value is not None and choice.random() < 0.7}
    return choice.choice([json.dumps(kept), '[' * choice.randint(0, 9000), json.dumps(number), 'hello'])


CAMPAIGN = Campaign('messages', 'Stray messages on every topic', 200, 3, 3600.0, trial)
