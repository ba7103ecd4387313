import contextlib
from pathlib import Path

import pytest

from hdd_servo_ros.parameters.files import ArgumentError
from hdd_servo_ros.ros.transport import ANY_RANGE_PROFILE, LOCALHOST_PROFILE, check_domain, use_udp_alone, who_can_reach

SHARED_MEMORY = Path('/dev/shm')


@pytest.mark.parametrize(
    ('given', 'profile'),
    [
        ({}, LOCALHOST_PROFILE),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}, ANY_RANGE_PROFILE),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, LOCALHOST_PROFILE),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'}, LOCALHOST_PROFILE),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}, None),
    ],
)
def test_udp_unless_the_user_configures_a_transport(given, profile):
    environment = dict(given)
    use_udp_alone(environment)
    assert environment.pop('FASTDDS_BUILTIN_TRANSPORTS') == 'UDPv4'
    if profile is not None:
        assert environment.pop('FASTRTPS_DEFAULT_PROFILES_FILE') == str(profile)
    if profile == LOCALHOST_PROFILE:
        assert environment.pop('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'SYSTEM_DEFAULT'
        given.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)
    assert environment == given


@pytest.mark.parametrize(
    'name', ['FASTDDS_BUILTIN_TRANSPORTS', 'FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY']
)
def test_settings_of_the_user_are_kept(name):
    environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', name: 'x'}
    use_udp_alone(environment)
    assert environment == {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', name: 'x'}


@pytest.mark.parametrize('domain', ['-1', '233', '99999', 'abc', '1.0', '٣', '9' * 5000])
def test_a_domain_without_ports_is_rejected(domain):
    with pytest.raises(ArgumentError, match='an integer from 0 to 232') as rejected:
        check_domain({'ROS_DOMAIN_ID': domain})
    assert len(str(rejected.value)) < 200


@pytest.mark.parametrize('environment', [{}, {'ROS_DOMAIN_ID': ''}, {'ROS_DOMAIN_ID': '0'}, {'ROS_DOMAIN_ID': '232'}])
def test_a_domain_with_ports_is_accepted(environment):
    check_domain(environment)


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ({}, ''),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, ''),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, ''),
        ({'ROS_LOCALHOST_ONLY': '1'}, ''),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}, ''),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}, 'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT'}, 'ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT'),
        ({'ROS_STATIC_PEERS': '10.0.0.1'}, 'ROS_STATIC_PEERS is set'),
        ({'ROS_DISCOVERY_SERVER': '10.0.0.1:11811'}, 'ROS_DISCOVERY_SERVER is set'),
    ],
)
def test_a_run_that_other_machines_may_reach_is_reported(given, reason):
    warning = who_can_reach(given)
    assert warning.startswith(reason)
    assert bool(warning) == bool(reason)
    # A process that this one starts tells it again, but nothing that is not so.
    use_udp_alone(given)
    assert bool(who_can_reach(given)) == bool(reason)


@pytest.mark.parametrize('discovery_range', ['LOCALHOST', 'SUBNET'])
def test_an_incomplete_segment_of_a_killed_process_blocks_no_other(bench, discovery_range):
    """With shared memory, a node would wait forever for such a segment."""
    bench.environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = discovery_range
    # The port of the first participants of a ROS domain, by the rule of RTPS.
    ports = [7400 + 250 * bench.domain + 11 + 2 * participant for participant in range(3)]
    segments = [SHARED_MEMORY / f'fastrtps_port{port}' for port in ports]
    made = []
    try:
        for segment in segments:
            with contextlib.suppress(FileExistsError):
                segment.touch(exist_ok=False)
                made.append(segment)
        bench.run('rig', '-p', 'duration:=0.02', '-p', 'plot:=false')
        assert [segment.stat().st_size for segment in made] == [0] * len(made)
    finally:
        for segment in made:
            segment.unlink(missing_ok=True)
