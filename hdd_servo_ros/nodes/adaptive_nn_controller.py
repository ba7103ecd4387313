"""`adaptive_nn_controller`: adaptive neural network controller, thesis eqs. 4.10 to 4.21."""

import math
import sys
from collections.abc import Iterable, Sequence

from std_srvs.srv import Trigger

from hdd_servo_ros.analysis.fragility import MAX_ADAPTED_SENSITIVITY
from hdd_servo_ros.analysis.linear_laws import FrozenEstimates
from hdd_servo_ros.bench.dsp import ControllerOutputParameters
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn, AdaptiveNnParameters
from hdd_servo_ros.messages.topics import DISTURBANCE
from hdd_servo_ros.nodes.controller_node import ControllerNode, block_parameters_of
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.ros.diagnosis import ERROR, OK, WARN, Diagnosis
from hdd_servo_ros.ros.run_plan import RunPlan
from hdd_servo_ros.signals.reference import ReferenceParameters
from hdd_servo_ros.stability.coverage import Loop, not_covered
from hdd_servo_ros.stability.margin import CertificateMargin

_R = AdaptiveNn.estimate_names.index('r')
_FROZEN = tuple(AdaptiveNn.estimate_names.index(name) for name in FrozenEstimates._fields)


class AdaptiveNnController(ControllerNode):
    """Node of the controller block :class:`AdaptiveNn`."""

    def __init__(self) -> None:
        super().__init__('adaptive_nn_controller')
        self.create_service(Trigger, '~/reset', self._reset)
        self._at_start: AdaptiveNnParameters = self.parameters[AdaptiveNnParameters]
        self._first_r = 0.0
        self._margin: CertificateMargin | None = None
        self._is_disturbed = False
        self._sensor: LdvParameters | None = None
        self._reference: ReferenceParameters | None = None

    def prepare(self, run: RunPlan) -> None:
        super().prepare(run)
        self._is_disturbed = run.publisher_of(self.resolve_topic_name(DISTURBANCE.name)) is not None
        self._sensor = block_parameters_of(run, 'ldv_sensor')
        self._reference = block_parameters_of(run, 'reference_generator')
        # V(0) of the certificate needs r of tick 0; later ticks use the regular step.
        self.step = self._first_step  # type: ignore[method-assign]

    def _first_step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        del self.step
        self._at_start = self.parameters[AdaptiveNnParameters]
        self.step(tick, stamp, messages)
        self._first_r = float(self._controller.estimates[_R])

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset the estimates by a parameter change, so that the bag contains the tick and a replay resets too."""
        count = self.parameters[AdaptiveNnParameters].reset_count + 1
        response.message = self.parameters.set({'reset_count': count}) or f'reset before tick {self.tick}'
        response.success = self.parameters[AdaptiveNnParameters].reset_count == count
        return response

    def diagnose(self) -> Iterable[Diagnosis]:
        yield from super().diagnose()
        yield self._diagnose_adaptation()
        yield self._diagnose_certificate()
        yield self._diagnose_margin()

    def _diagnose_margin(self) -> Diagnosis:
        """Diagnose the loop with the present estimates frozen; this takes a few milliseconds, once per second."""
        if self._loop is None:
            return Diagnosis('stability margin', OK, 'unknown: this run has no vcm_plant')
        frozen = self._loop.frozen_loop(self._controller, self._dsp.parameters.computation_delay)
        estimates = FrozenEstimates(*(float(self._controller.estimates[index]) for index in _FROZEN))
        ms = frozen.peak_sensitivity(estimates)
        values = {'peak sensitivity': ms, 'limit': MAX_ADAPTED_SENSITIVITY, **estimates._asdict()}
        if math.isinf(ms):
            return Diagnosis('stability margin', WARN, 'the loop is unstable with the present estimates', values)
        if ms > MAX_ADAPTED_SENSITIVITY:
            message = f'low with the present estimates: peak sensitivity {ms:.3g}'
            return Diagnosis('stability margin', WARN, message, values)
        return Diagnosis('stability margin', OK, f'peak sensitivity {ms:.3g} with the present estimates', values)

    def _diagnose_certificate(self) -> Diagnosis:
        if self.tick == 0:
            return Diagnosis('certificate', OK, 'no tick yet')
        if self._drive is None or self.changes:
            return Diagnosis('certificate', OK, 'not available: the drive is unknown, or parameters were changed')
        if self._margin is None:
            self._margin = CertificateMargin(self._at_start, self._drive, self._first_r)
        r = float(self._controller.estimates[_R])
        found = self._margin.at(self.tick * self._ticks.sample_time, r)
        if found is None:
            return Diagnosis('certificate', OK, self._margin.unavailable_reason or 'not computed yet')
        dsp = self.parameters[ControllerOutputParameters].dsp
        limited = self._dsp.saturated_samples
        loop = Loop(
            self._at_start,
            self._drive,
            dsp,
            self._sensor,
            self._reference,
            limited,
            is_disturbed=self._is_disturbed,
            ideal_values_are_allowed=self._margin.ideal_values_are_allowed,
        )
        caveat = f', which does not cover {", ".join(not_covered(loop))}'
        if found['margin'] < 0.0:
            return Diagnosis('certificate', WARN, f'outside the bound of theorem 4.1{caveat}', {**found, 'r': r})
        return Diagnosis('certificate', OK, f'inside the bound of theorem 4.1{caveat}', {**found, 'r': r})

    def _diagnose_adaptation(self) -> Diagnosis:
        parameters: AdaptiveNnParameters = self.parameters[AdaptiveNnParameters]
        values = dict(zip(self._controller.estimate_names, self._controller.estimates.tolist(), strict=True))
        if not all(map(math.isfinite, values.values())):
            return Diagnosis('adaptation', ERROR, 'an estimate is not finite', values)
        bounds = {name: (law.minimum, law.maximum) for name, law in parameters.adapted.items()}
        at_bounds = [name for name, (low, high) in bounds.items() if not low < values[name] < high]
        if parameters.projection and at_bounds:
            return Diagnosis('adaptation', WARN, f'at its bound: {", ".join(at_bounds)}', values)
        return Diagnosis('adaptation', OK, 'estimates are finite', values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node('adaptive_nn_controller', AdaptiveNnController, arguments)


if __name__ == '__main__':
    sys.exit(main())
