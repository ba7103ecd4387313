"""A run read in bulk is what an independent reader reads message by message."""

from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import hdd_servo_ros
from hdd_servo_ros import Run
from hdd_servo_ros.messages.cdr import ArrayCodec, ClockCodec, VectorCodec
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import LOOP_TOPICS
from hdd_servo_ros.recording.bag_columns import Bag, BagError
from hdd_servo_ros.recording.run_recorder import RunRecorder

TYPES = get_typestore(Stores.ROS2_JAZZY)
TICKS = Ticks(1e-4)
COUNT = 2001
ARGUMENTS = {
    'mcap': [],
    'sqlite3': ['-p', 'storage:=sqlite3'],
    'namespace': ['-r', '__ns:=/bench1', '-r', 'ldv:=vibrometer'],
}


@pytest.fixture(scope='module', params=ARGUMENTS)
def directory(request, simulated, tmp_path_factory):
    """A run of 0.2 s, recorded in each way."""
    path = tmp_path_factory.mktemp('runs') / request.param
    return simulated(path, '-p', 'duration:=0.2', *ARGUMENTS[request.param])


def test_every_array_is_what_an_independent_reader_reads(directory):
    run = Run.open(directory)
    name_of = {full_name: name for name, full_name in run.description['topics'].items()}
    found: dict[str, list[Any]] = {name: [] for name in name_of.values()}
    with AnyReader([directory / 'bag']) as reader:
        for connection, _, payload in reader.messages():
            message: Any = reader.deserialize(payload, connection.msgtype)
            if hasattr(message, 'vector'):
                message = (message.vector.x, message.vector.y, message.vector.z)
            elif hasattr(message, 'clock'):
                message = message.clock.sec * 1_000_000_000 + message.clock.nanosec
            else:
                message = message.data
            found[name_of[connection.topic]].append(message)
    assert len(found) == len(LOOP_TOPICS)
    for name, expected in found.items():
        np.testing.assert_array_equal(run[name], expected)
        np.testing.assert_array_equal(run[run.description['topics'][name]], expected)
        assert name in run
    assert run.counts == dict.fromkeys(name_of.values(), COUNT)
    np.testing.assert_array_equal(run.ticks, np.arange(COUNT))
    np.testing.assert_allclose(run.time, np.arange(COUNT) * 1e-4, rtol=1e-15)
    assert (run.last_tick, run.duration) == (COUNT - 1, 0.2)
    np.testing.assert_array_equal(run.error, run.head[:, 0] - run.reference[:, 0])
    np.testing.assert_allclose(run.estimates['t'], run.time, rtol=1e-15)
    np.testing.assert_array_equal(run.command, run.control[:, 0])
    np.testing.assert_array_equal(run.feedback, run.control[:, 2])
    assert run.time[run.since(0.1)][0] == 0.1


def test_what_the_run_says_of_itself(directory):
    run = Run.open(directory)
    assert (run.status, run.reason, run.controller) == ('finished', '', 'adaptive_nn')
    assert (run.frame_id, run.sample_time) == ('seagate_7200_10', 1e-4)
    assert (run.length_unit, run.control_unit, run.error_unit, run.error_factor) == ('um', 'V', 'nm', 1e3)
    assert run.parameter('reference_generator', 'frequency') == 100.0
    assert run.parameter('adaptive_nn_controller', 'error_filter_lambda', tick=3) == 2450.0
    assert run.parameter_changes == []
    assert run.messages(run.description['topics']['clock'])[3][1].clock.nanosec == 300_000
    assert repr(str(directory)) in repr(run)
    # The bag alone knows its topics, sample time and units, too.
    alone = Run.open(directory / 'bag')
    np.testing.assert_array_equal(alone.error, run.error)


def test_a_topic_is_read_when_it_is_asked_for(directory, monkeypatch):
    read: list[str] = []
    column = Bag.column

    def noted(bag, topic):
        read.append(topic)
        return column(bag, topic)

    monkeypatch.setattr(Bag, 'column', noted)
    run = Run.open(directory)
    assert (run.controller, run.counts['head'], read) == ('adaptive_nn', COUNT, [])
    names = run.description['topics']
    first, second = run.head, run.head
    assert first is second
    assert read.count(names['head']) == 1
    assert not {names['reference'], names['ldv'], names['control'], names['estimates']} & set(read)
    with pytest.raises(ValueError, match='read-only'):
        first[0, 0] = 1.0


@pytest.mark.parametrize(
    ('arguments', 'match'),
    [
        (('nobody', 'gain'), "no node 'nobody' in run.yaml; it has .*deterministic_timer"),
        (('reference_generator', 'frequenzy'), "no parameter 'frequenzy'; did you mean frequency"),
        (('reference_generator', 'frequency', COUNT), f'tick {COUNT} is outside the run'),
    ],
)
def test_a_parameter_that_there_is_not(directory, arguments, match):
    with pytest.raises(LookupError, match=match):
        Run.open(directory).parameter(*arguments)


def test_a_topic_that_there_is_not(directory):
    with pytest.raises(KeyError, match='does not contain topic disturbance; it contains'):
        Run.open(directory)['disturbance']
    with pytest.raises(KeyError, match='does not contain topic /tf'):
        Run.open(directory).messages('/tf')
    assert 'disturbance' not in Run.open(directory)


def test_an_estimate_that_there_is_not(directory):
    with pytest.raises(KeyError) as caught:
        Run.open(directory).estimates['zz']
    assert str(caught.value) == f"{directory}: no estimate 'zz'; estimates: {', '.join(Run.open(directory).estimates)}"


def parameter_event(tick, node, **values):
    """Return a serialized parameter event; floats and whole arrays as ROS has them."""
    kinds = {name.rsplit('/', 1)[-1]: kind for name, kind in TYPES.types.items()}
    empty: dict[str, Any] = {'bool_value': False, 'integer_value': 0, 'double_value': 0.0, 'string_value': ''}
    empty['byte_array_value'] = np.zeros(0, np.uint8)
    empty['bool_array_value'] = np.zeros(0, bool)
    empty['integer_array_value'] = np.zeros(0, np.int64)
    empty |= {'double_array_value': np.zeros(0), 'string_array_value': []}
    changed = []
    for name, value in values.items():
        field = {'type': 8, 'double_array_value': np.array(value)} if isinstance(value, list) else None
        field = field or {'type': 3, 'double_value': value}
        changed.append(kinds['Parameter'](name, kinds['ParameterValue'](**{**empty, **field})))
    stamp = kinds['Time'](*divmod(tick * 100_000, 1_000_000_000))
    kind = 'rcl_interfaces/msg/ParameterEvent'
    return bytes(TYPES.serialize_cdr(TYPES.types[kind](stamp, node, [], changed, []), kind))


def recorder_of(path, nodes, recorded=()):
    """Return a recorder of a run in the namespace /b, and a function that gives the messages of a tick."""
    description = {'sample_time': 1e-4, 'nodes': nodes}
    topics = [(topic, f'/b/{topic.name}') for topic in LOOP_TOPICS]
    recorder = RunRecorder(str(path), 'mcap', topics, description, separate_process=False, recorded=recorded)
    vector, array = VectorCodec('drive'), ArrayCodec(['t', 'r'])

    def messages(tick):
        stamp = TICKS.stamp(tick)
        return [ClockCodec.pack(stamp), *[vector.pack(stamp, tick, 0.0, 0.0)] * 4, array.pack([tick * 1e-4, 0.0])]

    return recorder, messages


@pytest.mark.parametrize('recorded', [(), ('head', 'control')])
def test_many_ticks_at_once_are_the_same_as_one_by_one(tmp_path, recorded):
    one_by_one, messages = recorder_of(tmp_path / 'one_by_one', {}, recorded)
    at_once, _ = recorder_of(tmp_path / 'at_once', {}, recorded)
    for tick in range(1000):
        one_by_one.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    for first, end in ((0, 1), (1, 65), (65, 1000)):
        columns = list(zip(*map(messages, range(first, end)), strict=True))
        at_once.write_columns(first, [TICKS.nanoseconds(tick) for tick in range(first, end)], columns)
    for recorder in (one_by_one, at_once):
        recorder.finish('finished', '')
    assert Run.open(tmp_path / 'at_once').last_tick == 999
    # Where chunks end depends on the clock; the messages do not.
    ours, theirs = (Run.open(tmp_path / name).messages_by_topic() for name in ('one_by_one', 'at_once'))
    assert ours.keys() == theirs.keys()
    for topic, (times, payloads) in ours.items():
        assert times.tolist() == theirs[topic][0].tolist()
        assert payloads == theirs[topic][1]


def test_what_is_left_of_a_run_that_was_cut_off(tmp_path):
    recorder, messages = recorder_of(tmp_path / 'run', {})
    for tick in range(10):
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    recorder._writer.write(range(3), [TICKS.nanoseconds(10)] * 3, messages(10)[:3])
    recorder.finish('failed', 'the disk is full')
    run = Run.open(tmp_path / 'run')
    assert (run.status, run.reason, run.last_tick) == ('failed', 'the disk is full', 9)
    for name in ('head', 'control'):
        assert run[name][:, 0].tolist() == list(range(10))


def test_parameters_in_force_at_a_tick(tmp_path):
    """The change acts from the tick on whose stamp its event carries; the values before are those of run.yaml."""
    nodes = {
        '/b/pid_controller': {'outputs': ['/b/control'], 'parameters': {'kp': 1.0, 'weights': [1.0]}},
        '/b/vcm_plant': {'outputs': ['/b/head'], 'parameters': {'kp': 5.0}},
    }
    recorder, messages = recorder_of(tmp_path / 'run', nodes)
    for tick in range(10):
        if tick == 4:
            recorder.write_parameter_event(400_000, parameter_event(4, '/b/pid_controller', kp=2.0, weights=[3.0, 4.0]))
        if tick == 7:
            recorder.write_parameter_event(700_000, parameter_event(7, '/b/pid_controller', kp=3.0))
        recorder.write_tick(tick, TICKS.nanoseconds(tick), messages(tick))
    recorder.finish('interrupted', 'SIGINT at tick 9')
    run = Run.open(tmp_path / 'run')
    assert [run.parameter('pid_controller', 'kp', tick) for tick in range(10)] == [1.0] * 4 + [2.0] * 3 + [3.0] * 3
    assert run.parameter('/b/pid_controller', 'kp') == 3.0
    assert run.parameter('pid_controller', 'weights', 3) == [1.0]
    assert run.parameter('pid_controller', 'weights', 4) == [3.0, 4.0]
    assert run.parameter('vcm_plant', 'kp') == 5.0
    assert [(change.tick, change.name) for change in run.parameter_changes] == [(4, 'kp'), (4, 'weights'), (7, 'kp')]
    assert (run.status, run.reason) == ('interrupted', 'SIGINT at tick 9')
    # An event among them breaks the even spacing of the messages in the file, not their order.
    assert run.head[:, 0].tolist() == list(range(10))


QOS = Qos(
    QosHistory.KEEP_LAST,
    10,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    False,
)


def foreign_bag(path, storage=StoragePlugin.MCAP, compression=None, namespaces=('/bench1',), late=3, lost=(), shift=0):
    """Write what `ros2 bag record` would: receive times of a wall clock, a late start, lost messages, no run.yaml."""
    writer = Writer(path, version=9, storage_plugin=storage)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    vector, array = VectorCodec('drive'), ArrayCodec(['t', 'r'])
    with writer:
        connections = {
            (namespace, topic): writer.add_connection(
                f'{namespace}/{topic.name}', topic.type_name, typestore=TYPES, offered_qos_profiles=(QOS,)
            )
            for namespace in namespaces
            for topic in LOOP_TOPICS
        }
        for tick in range(50):
            for offset, ((_, topic), connection) in enumerate(connections.items()):
                if (topic.name == 'head' and tick in lost) or (topic.name == 'ldv' and tick < late):
                    continue
                stamp = Ticks(1e-9).stamp(tick * 100_000 + shift)
                payload = vector.pack(stamp, tick, float(offset), 0.5)
                if topic.name == 'clock':
                    payload = ClockCodec.pack(stamp)
                elif topic.name == 'estimates':
                    payload = array.pack([tick * 1e-4, float(offset)])
                writer.write(connection, 1_700_000_000_000_000_000 + tick * 123_457 + offset, payload)
    return path


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'storage': StoragePlugin.SQLITE3},
        {'compression': CompressionMode.FILE},
        {'compression': CompressionMode.MESSAGE},
        {'compression': CompressionMode.STORAGE},
    ],
    ids=['mcap', 'sqlite3', 'file', 'message', 'chunk'],
)
def test_a_bag_of_another_recorder_is_aligned_by_its_stamps(tmp_path, options):
    run = Run.open(foreign_bag(tmp_path / 'bag', lost=(7, 20), **options))
    ticks = [tick for tick in range(3, 50) if tick not in (7, 20)]
    assert run.ticks.tolist() == ticks
    assert run.sample_time == pytest.approx(1e-4)
    for name in ('reference', 'head', 'ldv', 'control'):
        assert run[name][:, 0].tolist() == ticks
    np.testing.assert_allclose(run.estimates['t'], run.time, rtol=1e-12)
    assert (run.status, run.controller) == ('unknown', 'unknown')
    with pytest.raises(LookupError, match=r"no node 'vcm_plant' in run\.yaml; it has none"):
        run.parameter('vcm_plant', 'gain')


def test_of_several_rigs_in_one_bag_one_is_to_be_named(tmp_path):
    path = foreign_bag(tmp_path / 'bag', namespaces=('/bench1', ''))
    with pytest.raises(BagError, match='/bench1/clock and /clock are both present; select one by namespace'):
        Run.open(path)
    assert set(Run.open(path, namespace='/bench1').head[:, 1]) == {2.0}
    assert set(Run.open(path, namespace='/').head[:, 1]) == {8.0}


def test_stamps_between_ticks_are_rejected(tmp_path):
    path = foreign_bag(tmp_path / 'bag', shift=7)
    with pytest.raises(BagError, match='message 0 has stamp 7 ns, which does not fall on a tick of'):
        Run.open(path).head  # noqa: B018


def test_damage_is_told(directory, tmp_path):
    """Cut off anywhere, or with bytes changed, a bag gives an error and no traceback of another kind."""
    source = directory / 'bag'
    file = next(path for path in source.iterdir() if path.suffix != '.yaml')
    whole = file.read_bytes()
    for kept in (0, 100, len(whole) // 2):
        copy = tmp_path / f'cut{kept}'
        copy.mkdir()
        (copy / 'metadata.yaml').write_bytes((source / 'metadata.yaml').read_bytes())
        (copy / file.name).write_bytes(whole[:kept])
        with pytest.raises(BagError, match=str(copy)):
            Run.open(copy).head  # noqa: B018
    (tmp_path / 'cut0' / file.name).unlink()
    with pytest.raises(BagError, match='cut0'):
        Run.open(tmp_path / 'cut0').head  # noqa: B018
    (tmp_path / 'cut100' / 'metadata.yaml').write_text('rosbag2_bagfile_information: {version: 9}')
    with pytest.raises(BagError, match=r'metadata\.yaml cannot be read: topics_with_message_count is missing'):
        Run.open(tmp_path / 'cut100')


def test_a_wrong_checksum_is_told_by_every_topic_of_the_chunk(simulated, tmp_path):
    """Also when the file was right as another topic was read from it."""
    run = simulated(tmp_path / 'run', '-p', 'duration:=0.01')
    file = run / 'bag' / 'bag.mcap'
    bag = Bag(run / 'bag')
    assert len(bag.column('/head')) == 101
    content = bytearray(file.read_bytes())
    content[content.index(b'seagate_7200_10')] ^= 1
    file.write_bytes(content)
    for opened in (bag, Bag(run / 'bag')):
        for topic in ('/head', '/control', '/head'):
            with pytest.raises(BagError, match='is damaged: its checksum is wrong'):
                opened.column(topic)


def test_a_run_that_lost_its_bag(directory, tmp_path):
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'run.yaml').write_text(yaml.safe_dump({'status': 'failed', 'topics': {}}))
    with pytest.raises(FileNotFoundError, match='neither a run folder nor a closed bag'):
        Run.open(tmp_path / 'run')


def test_a_run_whose_bag_was_not_closed_names_its_cure(tmp_path):
    """As a killed writer leaves it."""
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'run.yaml').write_text(yaml.safe_dump({'status': 'failed', 'topics': {}}))
    (tmp_path / 'bag' / 'bag.mcap').write_bytes(b'')
    with pytest.raises(FileNotFoundError, match=f'{tmp_path}: the bag was not closed .*; `recover {tmp_path}` repairs'):
        Run.open(tmp_path)


def test_the_package_offers_run_and_nothing_else():
    assert hdd_servo_ros.Run is Run
    with pytest.raises(AttributeError, match="has no attribute 'Walk'"):
        hdd_servo_ros.Walk  # noqa: B018
