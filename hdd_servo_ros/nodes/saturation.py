"""Warnings and diagnosis of saturated instrument outputs."""

from collections.abc import Mapping
from typing import Protocol

from rclpy.node import Node

from hdd_servo_ros.ros.diagnosis import OK, WARN, Diagnosis


class Saturates(Protocol):
    """Instrument that counts the clipped samples of its outputs."""

    @property
    def saturated_samples(self) -> dict[str, int]:
        """Number of clipped samples of each output so far."""

    def saturation_warnings(self) -> dict[str, str]:
        """Return a warning for each output that has been clipped."""


class SaturationLog:
    """
    Log of saturated outputs: it warns once per output and diagnoses the number of saturated samples.

    Parameters
    ----------
    node
        Node of the instrument.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._warned: set[str] = set()
        self._diagnosed: Mapping[str, int] = {}

    def warn(self, instrument: Saturates) -> None:
        """Warn of the outputs that have saturated for the first time."""
        for output, warning in instrument.saturation_warnings().items():
            if output not in self._warned:
                self._warned.add(output)
                self._node.get_logger().warning(warning)

    def diagnose(self, instrument: Saturates, further: Mapping[str, object]) -> Diagnosis:
        """Return the diagnosis of the output range since the last one, with further values."""
        counts = instrument.saturated_samples
        new = {name: count - self._diagnosed.get(name, 0) for name, count in counts.items()}
        self._diagnosed = counts
        values = {f'{name}: samples beyond the range in total': count for name, count in counts.items()}
        beyond = ', '.join(f'{name} in {count} samples' for name, count in new.items() if count)
        if beyond:
            return Diagnosis('range', WARN, f'beyond the output range: {beyond}', {**values, **further})
        return Diagnosis('range', OK, 'inside the output range', {**values, **further})
