"""
Which process of this machine publishes a topic of the loop, known at once and to all.

DDS takes a tenth of a second to find a publisher, and some seconds on a busy machine: too long for one that is about to
become the second. So each process claims the topics that it publishes by binding a Unix socket of the abstract
namespace a topic. It has no file, goes with its process however that ends, and is as far-reaching as this machine's
network, over which the processes would meet.
"""

import contextlib
import hashlib
import socket
import struct
from collections.abc import Iterable

_CREDENTIALS = struct.Struct('3i')


class ClaimError(Exception):
    """A topic is claimed by another process; says by which."""


class TopicClaims:
    """
    The topics that this process publishes, claimed until :meth:`close`.

    Parameters
    ----------
    topics
        Full names.
    domain
        ROS domain.

    Raises
    ------
    ClaimError
        If another process has claimed one of them; then none is claimed.
    """

    def __init__(self, topics: Iterable[str], domain: int) -> None:
        self._sockets: list[socket.socket] = []
        for topic in topics:
            made = socket.socket(socket.AF_UNIX)
            self._sockets.append(made)
            try:
                made.bind(_address(topic, domain))
                made.listen(1)  # only then does it tell its process
            except OSError:
                self.close()
                raise ClaimError(f'{topic} is published by {_holder(topic, domain)} already') from None

    def close(self) -> None:
        """Give the topics free."""
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
