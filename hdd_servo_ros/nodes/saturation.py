"""Log and diagnose the saturation of an instrument's outputs."""

from collections.abc import Mapping
from typing import Protocol

from rclpy.node import Node

from hdd_servo_ros.ros.diagnosis import OK, WARN, Diagnosis


class Saturates(Protocol):
    """An instrument that counts the clipped samples of its outputs."""

    @property
    def saturated_samples(self) -> dict[str, int]:
        """How many samples of each output so far were clipped."""

    def saturation_warnings(self) -> dict[str, str]:
        """Return, for each output that has been clipped, what a user should be told."""


class SaturationLog:
    """
    Warns once for each output that saturates, and diagnoses how many samples did.

    Parameters
    ----------
    node
        The instrument's node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: set[str] = set()
        self._diagnosed: Mapping[str, int] = {}

    def warn(self, instrument: Saturates) -> None:
        """Warn of the outputs that have saturated since."""
        for output, warning in instrument.saturation_warnings().items():
            if output not in self._told:
                self._told.add(output)
                self._node.get_logger().warning(warning)

    def diagnose(self, instrument: Saturates, further: Mapping[str, object]) -> Diagnosis:
        """Return the diagnosis of the range since the last one, with further values in it."""
        counts = instrument.saturated_samples
        new = {name: count - self._diagnosed.get(name, 0) for name, count in counts.items()}
        self._diagnosed = counts
        values = {f'{name}: samples beyond the range, in all': count for name, count in counts.items()}
        beyond = ', '.join(f'{name} in {count} samples' for name, count in new.items() if count)
        if beyond:
            return Diagnosis('range', WARN, f'beyond the output range: {beyond}', {**values, **further})
        return Diagnosis('range', OK, 'inside the output range', {**values, **further})
