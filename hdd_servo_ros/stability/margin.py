"""Margin of ``|r|`` to the bound of theorem 4.1 during a run, for the diagnostics."""

import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING

from hdd_servo_ros.control.adaptive_nn import AdaptiveNnParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.parameters import ParameterError

if TYPE_CHECKING:
    from hdd_servo_ros.stability.bounds import CertificateMonitor


class CertificateMargin:
    """
    Bound of theorem 4.1 on ``|r|`` minus ``|r|``, from the drive's known constants.

    The constants of the theorem are computed in a separate thread, which takes some tenths of a second; the loop does
    not wait for it. The region of (4.13) is that of the network's lattice.

    Parameters
    ----------
    controller, plant
        Parameters of the controller and the drive at tick 0.
    first_r
        r at tick 0 [um/s].
    """

    def __init__(self, controller: AdaptiveNnParameters, plant: PlantParameters, first_r: float) -> None:
        self.unavailable_reason = ''
        """Reason for a missing certificate; empty if it is available or pending."""
        self._monitor: CertificateMonitor | None = None
        self._ideal_values_are_allowed = True
        if plant.friction.model != 'lugre':
            self.unavailable_reason = f'theorem 4.1 requires LuGre friction, not {plant.friction.model}'
        else:
            threading.Thread(target=self._find, args=(controller, plant, first_r), daemon=True).start()

    def _find(self, controller: AdaptiveNnParameters, plant: PlantParameters, first_r: float) -> None:
        # Imported late: they load scipy, which takes longer than everything else that the node needs to start.
        from hdd_servo_ros.stability.bounds import CertificateMonitor, projection_allows
        from hdd_servo_ros.stability.certificate import known_plant
        from hdd_servo_ros.stability.ideal_values import theorem_values

        network = controller.network
        region = (
            (network.position_minimum, network.position_maximum),
            (network.velocity_minimum, network.velocity_maximum),
        )
        try:
            ideal = theorem_values(known_plant(plant, abs(plant.disturbance.amplitude)), controller, region)
            monitor = CertificateMonitor(controller, ideal)
            monitor.margin(0.0, first_r)
        except ParameterError as error:
            self.unavailable_reason = str(error)
        else:
            self._ideal_values_are_allowed = not controller.projection or projection_allows(controller, ideal)
            self._monitor = monitor

    @property
    def ideal_values_are_allowed(self) -> bool:
        """Whether the projection bounds, if enabled, contain the ideal values; true while these are unknown."""
        return self._ideal_values_are_allowed

    def at(self, time: float, r: float) -> Mapping[str, float] | None:
        """Return bound and margin [um/s] at a time [s], None while they are unknown."""
        if self._monitor is None:
            return None
        return {'margin': self._monitor.margin(time, r), 'bound on |r|': self._monitor.limit(time)}
