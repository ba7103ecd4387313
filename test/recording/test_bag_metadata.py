"""The metadata of a bag, wrong in one entry: one error with file, entry and value, whoever reads the bag."""

import shutil

import pytest
import yaml

from hdd_servo_ros import Run
from hdd_servo_ros.recording.bag_columns import Bag, BagError
from hdd_servo_ros.recording.bag_metadata import MetadataError, read_metadata
from hdd_servo_ros.recording.compare_bags import first_difference
from hdd_servo_ros.recording.compare_bags import main as compare_bags
from hdd_servo_ros.tools.recover import main as recover
from hdd_servo_ros.tools.report import main as report


@pytest.fixture(scope='module')
def original(simulated, tmp_path_factory):
    return simulated(tmp_path_factory.mktemp('runs') / 'run', '-p', 'duration:=0.02', '-p', 'plot:=false')


@pytest.fixture
def run(original, tmp_path):
    shutil.copytree(original, tmp_path / 'run')
    return tmp_path / 'run'


def change(run, keys, value):
    """Set an entry of the metadata; of a value ``None`` leave it out."""
    path = run / 'bag' / 'metadata.yaml'
    content = yaml.safe_load(path.read_text())
    inner = content['rosbag2_bagfile_information']
    for key in keys[:-1]:
        inner = inner[key]
    if value is None:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    path.write_text(yaml.safe_dump(content))


TOPIC = ('topics_with_message_count', 2)
WRONG = [
    (('storage_identifier',), ['mcap'], r"storage_identifier is \['mcap'\]; expected a string"),
    (('storage_identifier',), None, 'storage_identifier is missing'),
    (('compression_mode',), 7, 'compression_mode is 7; expected a string'),
    (('relative_file_paths',), 'bag.mcap', "relative_file_paths is 'bag.mcap'; expected a list"),
    (('relative_file_paths',), [3], 'relative_file_paths is 3; expected a string'),
    (('topics_with_message_count',), {'a': 1}, '; expected a list'),
    (TOPIC, '/head', r"topics_with_message_count\[2\] is '/head'; expected a mapping"),
    ((*TOPIC, 'message_count'), '201', r"\[2\].message_count is '201'; expected a non-negative integer"),
    ((*TOPIC, 'message_count'), True, 'message_count is True'),
    ((*TOPIC, 'message_count'), -1, 'message_count is -1'),
    ((*TOPIC, 'message_count'), 2.5, 'message_count is 2.5'),
    ((*TOPIC, 'topic_metadata'), [], 'topic_metadata is'),
    ((*TOPIC, 'topic_metadata', 'name'), 5, 'topic_metadata.name is 5; expected a string'),
    ((*TOPIC, 'topic_metadata', 'type'), ['x'], 'topic_metadata.type is'),
    (('custom_data',), ['x'], 'custom_data is'),
    (('custom_data', 'frame_id'), ['x'], r"custom_data.'frame_id' is \['x'\]; expected a string"),
    (('custom_data', 'sample_time'), 'short', "custom_data.sample_time is 'short'; expected a time"),
    (('custom_data', 'sample_time'), '-1.0', 'custom_data.sample_time is'),
]


@pytest.mark.parametrize(('keys', 'value', 'why'), WRONG)
def test_a_wrong_entry_is_one_error_for_all_readers(run, keys, value, why):
    change(run, keys, value)
    with pytest.raises(MetadataError, match=why):
        read_metadata(run / 'bag')
    with pytest.raises(BagError, match=r'metadata\.yaml cannot be read: ') as error:
        Run.open(run)
    assert str(run / 'bag') in str(error.value)


@pytest.mark.parametrize(
    'text', ['', '[]', 'a: b', 'rosbag2_bagfile_information: 3', 100_000 * '[', 'a: &a [*a]', '\x00']
)
def test_what_is_no_metadata_is_one_error(run, text):
    (run / 'bag' / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=r'metadata\.yaml cannot be read'):
        Bag(run / 'bag')


def test_numbers_need_no_quotes(run):
    change(run, ('custom_data', 'sample_time'), 1e-4)
    assert read_metadata(run / 'bag').custom_data['sample_time'] == '0.0001'
    assert Run.open(run / 'bag').sample_time == 1e-4


@pytest.mark.parametrize(
    ('keys', 'value'),
    [
        (('storage_identifier',), ['mcap']),
        ((*TOPIC, 'topic_metadata', 'type'), 'std_msgs/msg/String'),
        ((*TOPIC, 'message_count'), '201'),
    ],
)
def test_one_verdict_on_one_bag_and_recover_repairs_it(run, original, capsys, keys, value):
    change(run, keys, value)
    for command, arguments in ((report, [run]), (compare_bags, [run, original])):
        assert command([str(argument) for argument in arguments]) == 3
        said = capsys.readouterr().err
        assert str(run) in said
        assert len(said.splitlines()) == 1
    assert recover([str(run)]) == 0
    assert first_difference(run, original) is None
    Run.open(run).verify()
