"""
How DDS carries messages between processes: over UDP alone, unless the user has said anything about it.

Fast DDS would use shared memory beside UDP, which suffers from processes that are killed:

- one that dies while it creates a segment leaves it half made, and the next process that gets this participant's number
  in this ROS domain waits for ever to open it;
- the port of a subscriber that is gone is opened anew at every sample until the lease of its participant ends, which
  slows a run ten times.

Between processes UDP is no slower for messages as small as ours. What a busy machine loses of it is sent again within a
tenth of a second, where Fast DDS by itself takes up to 3 s; a loop that waits for it stands still that long.
"""

from collections.abc import MutableMapping
from pathlib import Path

LOCALHOST_PROFILE = Path(__file__).with_name('localhost.xml')
ANY_RANGE_PROFILE = Path(__file__).with_name('any_range.xml')
_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_SAID_BY_USER = (
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
        Environment variables of this process, changed. They stay as they are if one of them says which transports,
        profiles or peers are wanted. Other middlewares read none of them.
    """
    if any(environment.get(name) for name in _SAID_BY_USER):
        return
    environment['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    if not environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps'):
        return
    profile = ANY_RANGE_PROFILE
    if environment.get(_RANGE, '').upper() == 'LOCALHOST':
        # For this range rmw_fastrtps sets up shared memory whatever that variable says; our profile does not.
        profile = LOCALHOST_PROFILE
        environment[_RANGE] = 'SYSTEM_DEFAULT'
    environment['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
