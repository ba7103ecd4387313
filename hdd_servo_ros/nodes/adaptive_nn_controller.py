"""`adaptive_nn_controller`: the adaptive neural network controller, eqs. (4.10) to (4.21)."""

import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from std_srvs.srv import Trigger

from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.nodes.controller_node import ControllerNode
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.ros.diagnostics import ERROR, OK, WARN, Diagnosis


class AdaptiveNnController(ControllerNode):
    """The node around :class:`AdaptiveNn`."""

    def __init__(self) -> None:
        super().__init__('adaptive_nn_controller', AdaptiveNnParameters, AdaptiveNn)
        self.create_service(Trigger, '~/reset', self._reset)

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset what was learnt by a parameter, so that the bag shows the tick and a replay does the same."""
        count = self.parameters[AdaptiveNnParameters].reset_count + 1
        response.message = self.parameters.set({'reset_count': count}) or f'reset before tick {self.tick}'
        response.success = self.parameters[AdaptiveNnParameters].reset_count == count
        return response

    def diagnose(self) -> Iterable[Diagnosis]:
        yield from super().diagnose()
        parameters: AdaptiveNnParameters = self.parameters[AdaptiveNnParameters]
        values = dict(zip(self._controller.estimate_names, self._controller.estimates.tolist(), strict=True))
        if not all(map(math.isfinite, values.values())):
            yield Diagnosis('adaptation', ERROR, 'an estimate is not finite', values)
            return
        laws: dict[str, Any] = {'sigma_hat': parameters.sigma, 'm_hat': parameters.mass, 'phi_hat': parameters.phi}
        bounds = {name: (law.minimum, law.maximum) for name, law in laws.items()}
        at_bounds = [name for name, (low, high) in bounds.items() if not low < values[name] < high]
        if parameters.projection and at_bounds:
            yield Diagnosis('adaptation', WARN, f'at its bound: {", ".join(at_bounds)}', values)
        else:
            yield Diagnosis('adaptation', OK, 'estimates are finite', values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('adaptive_nn_controller', AdaptiveNnController, arguments)


if __name__ == '__main__':
    sys.exit(main())
