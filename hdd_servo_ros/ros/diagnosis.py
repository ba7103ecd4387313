"""How one thing of a node is, as a value."""

import dataclasses
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticStatus

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """
    How one thing of a node is.

    Attributes
    ----------
    what
        The thing; the status is named ``NODE: what``.
    level
        ``OK``, ``WARN`` or ``ERROR``.
    message
        In a few words.
    values
        Figures behind it, by name with unit.
    """

    what: str
    level: bytes
    message: str
    values: Mapping[str, object] = dataclasses.field(default_factory=dict)
