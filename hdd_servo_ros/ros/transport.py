"""
How DDS carries messages between processes: over UDP alone, unless the user has configured something else.

Fast DDS would also use shared memory, which suffers from processes that are killed:

- a process that dies while it creates a segment leaves it incomplete, and the next process that gets this participant's
  number in this ROS domain waits forever to open it;
- the port of a vanished subscriber is reopened at every sample until the lease of its participant ends, which slows a
  run ten times.

Between processes UDP is no slower for messages this small. Lost datagrams are sent again within 0.1 s, where Fast DDS
by default takes up to 3 s; a loop that waits for one stands still that long.
"""

from collections.abc import MutableMapping
from pathlib import Path

LOCALHOST_PROFILE = Path(__file__).with_name('localhost.xml')
ANY_RANGE_PROFILE = Path(__file__).with_name('any_range.xml')
_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_USER_SETTINGS = (
    'FASTDDS_BUILTIN_TRANSPORTS',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'ROS_DISCOVERY_SERVER',
    'ROS_LOCALHOST_ONLY',
    'ROS_STATIC_PEERS',
)


def use_udp_alone(environment: MutableMapping[str, str]) -> None:
    """
    Have Fast DDS use UDP alone; called before the ROS context is made.

    Parameters
    ----------
    environment
        Environment variables of this process, changed. They stay as they are if one of them sets transports,
        profiles or peers. Other middlewares read none of them.
    """
    if any(environment.get(name) for name in _USER_SETTINGS):
        return
    environment['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    if not environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps'):
        return
    profile = ANY_RANGE_PROFILE
    if environment.get(_RANGE, '').upper() == 'LOCALHOST':
        # For this range rmw_fastrtps sets up shared memory regardless of that variable; this profile does not.
        profile = LOCALHOST_PROFILE
        environment[_RANGE] = 'SYSTEM_DEFAULT'
    environment['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
