"""
Claims of loop topics by the processes of this machine, to detect a second publisher immediately.

DDS takes 0.1 s to discover a publisher, and seconds on a busy machine: too long for a process that is about to become
the second publisher. Each process therefore claims the topics that it publishes by binding one Unix socket per topic in
the abstract namespace. Such a socket has no file, disappears with its process however that ends, and is visible in the
same network namespace as the DDS traffic of the processes.
"""

import contextlib
import hashlib
import socket
import struct
from collections.abc import Iterable

_CREDENTIALS = struct.Struct('3i')


class ClaimError(Exception):
    """A topic is claimed by another process, which the message names."""


class TopicClaims:
    """
    Claims of the topics that this process publishes, held until :meth:`close`.

    Parameters
    ----------
    topics
        Full names.
    domain
        ROS domain.

    Raises
    ------
    ClaimError
        If another process has claimed one of them; this process then claims no topic.
    """

    def __init__(self, topics: Iterable[str], domain: int) -> None:
        self._sockets: list[socket.socket] = []
        for topic in topics:
            made = socket.socket(socket.AF_UNIX)
            self._sockets.append(made)
            try:
                made.bind(_address(topic, domain))
                made.listen(1)  # required for SO_PEERCRED to return its process
            except OSError:
                self.close()
                raise ClaimError(f'{topic} is published by {_holder(topic, domain)} already') from None

    def close(self) -> None:
        """Release the topics."""
        for made in self._sockets:
            made.close()


def _address(topic: str, domain: int) -> bytes:
    digest = hashlib.sha256(topic.encode()).hexdigest()[:32]
    return b'\0hdd_servo_ros/%d/%s' % (domain, digest.encode())


def _holder(topic: str, domain: int) -> str:
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as asking:
        asking.connect(_address(topic, domain))
        process, _, _ = _CREDENTIALS.unpack(asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
        return f'process {process}'
    return 'another process'
