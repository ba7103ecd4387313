"""Diagnosis of a node."""

import dataclasses
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """
    Diagnosis of one aspect of a node.

    Attributes
    ----------
    what
        The aspect; the status is named ``NODE: what``.
    level
        ``OK``, ``WARN`` or ``ERROR``.
    message
        Short message.
    values
        Supporting values, by name with unit.
    """

    what: str
    level: bytes
    message: str
    values: Mapping[str, object] = dataclasses.field(default_factory=dict)
