"""
Transport of DDS messages between processes: only UDP, unless the user has configured another transport.

By default, Fast DDS also uses shared memory, which is not robust against killed processes:

- a process that dies while it creates a segment leaves it incomplete, and the next process with this participant number
  in this ROS domain waits forever to open it;
- the port of a vanished subscriber is reopened at every sample until the lease of its participant ends, which slows a
  run ten times.

For messages this small, UDP is not slower between processes. Lost datagrams are resent within 0.1 s instead of the 3 s
that Fast DDS takes by default; a loop that waits for one is stalled for that time.
"""

from collections.abc import Mapping, MutableMapping
from pathlib import Path

from hdd_servo_ros.messages.shown import shown
from hdd_servo_ros.parameters.files import ArgumentError

LOCALHOST_PROFILE = Path(__file__).with_name('localhost.xml')
ANY_RANGE_PROFILE = Path(__file__).with_name('any_range.xml')
_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_LARGEST_DOMAIN = 232
_LOCALHOST, _OFF = 'LOCALHOST', 'OFF'
_USER_SETTINGS = (
    'FASTDDS_BUILTIN_TRANSPORTS',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'ROS_DISCOVERY_SERVER',
    'ROS_LOCALHOST_ONLY',
    'ROS_STATIC_PEERS',
)


_REACHING = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'ROS_DISCOVERY_SERVER',
    'ROS_STATIC_PEERS',
)
"""User settings through which DDS may reach other machines."""


def who_can_reach(environment: Mapping[str, str]) -> str:
    """
    Return a warning if other machines may discover this process, and so change and end its run; otherwise empty.

    Parameters
    ----------
    environment
        Environment variables as set by the user, before :func:`use_udp_alone`.
    """
    if environment.get('FASTRTPS_DEFAULT_PROFILES_FILE') == str(LOCALHOST_PROFILE):
        return ''  # From a process of this package that started this one.
    if environment.get('ROS_LOCALHOST_ONLY') == '1':
        return ''
    given = environment.get(_RANGE, '')
    if given.upper() not in ('', _LOCALHOST, _OFF):
        reason = f'{_RANGE}={given}'
    else:
        opened = [name for name in _REACHING if environment.get(name) not in (None, '', str(ANY_RANGE_PROFILE))]
        if not opened:
            return ''
        reason = f'{opened[0]} is set'
    effect = 'other machines may find this run, read it, change its parameters and end it'
    return f'{reason}: {effect} (docs/concepts/security.md)'


def check_domain(environment: Mapping[str, str]) -> None:
    """Raise ArgumentError for a ROS domain without ports, for which Fast DDS would terminate the process."""
    given = environment.get('ROS_DOMAIN_ID')
    if given and not (given.isascii() and given.isdigit() and int(given[:9]) <= _LARGEST_DOMAIN):
        raise ArgumentError(f'ROS_DOMAIN_ID: {shown(given)}; expected an integer from 0 to {_LARGEST_DOMAIN}')


def use_udp_alone(environment: MutableMapping[str, str]) -> None:
    """
    Configure Fast DDS to use only UDP; called before the ROS context is created.

    Parameters
    ----------
    environment
        Environment variables of this process, modified in place unless one of them sets transports, profiles or
        peers. Other middlewares do not read them. A missing discovery range is set to LOCALHOST.
    """
    if any(environment.get(name) for name in _USER_SETTINGS):
        return
    if not environment.get(_RANGE):
        environment[_RANGE] = _LOCALHOST
    environment['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    if not environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps'):
        return
    profile = ANY_RANGE_PROFILE
    if environment[_RANGE].upper() == _LOCALHOST:
        # For this range, rmw_fastrtps enables shared memory regardless of that variable; this profile does not.
        profile = LOCALHOST_PROFILE
        environment[_RANGE] = 'SYSTEM_DEFAULT'
    environment['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)


def keeps_to_this_machine(environment: Mapping[str, str]) -> bool:
    """Return whether DDS discovers only processes of this machine; before or after :func:`use_udp_alone`."""
    is_local = environment.get(_RANGE, '').upper() in ('LOCALHOST', 'OFF')
    return is_local or environment.get('FASTRTPS_DEFAULT_PROFILES_FILE') == str(LOCALHOST_PROFILE)


def keeps_to_this_process(environment: Mapping[str, str]) -> bool:
    """Return whether DDS discovers no other process, as during a replay."""
    return environment.get(_RANGE, '').upper() == 'OFF'
