"""One diagnosis of a node, as a value."""

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
        In a few words.
    values
        Values that support it, by name with unit.
    """

    what: str
    level: bytes
    message: str
    values: Mapping[str, object] = dataclasses.field(default_factory=dict)
