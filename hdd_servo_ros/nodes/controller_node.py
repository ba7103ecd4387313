"""Base class of all controller nodes: inputs and outputs of a controller block."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.analysis.fragility import LoopSurroundings
from hdd_servo_ros.bench.accelerometer import AccelerometerParameters
from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters, Dsp
from hdd_servo_ros.bench.ldv import LdvParameters
from hdd_servo_ros.bench.output_filters import FilterParameters
from hdd_servo_ros.control.controller import Controller, HasPlan, KnowsOutputLimit, ReportsFault, WarnsBeforeRun
from hdd_servo_ros.control.feedforward import Feedforward
from hdd_servo_ros.control.feedforward_parameters import ControllerFeedforwardParameters, FeedforwardParameters
from hdd_servo_ros.control.observer import ControllerObserverParameters, Observer, ObserverParameters
from hdd_servo_ros.control.runout import RunoutCancellation
from hdd_servo_ros.control.runout_parameters import ControllerRunoutParameters, RunoutParameters
from hdd_servo_ros.control.seek import Seek, SeekSurroundings, no_seek
from hdd_servo_ros.control.seek_parameters import SeekParameters
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.block_parameters import (
    feedforward_parameters,
    reject_other_units,
    runout_parameters,
    seek_kind,
    seek_parameters,
    sensor_scales,
)
from hdd_servo_ros.graph.catalog import BASE_SENSOR, NODES, resolve
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR
from hdd_servo_ros.messages.cdr import ArrayCodec, VectorCodec, unpack_vector
from hdd_servo_ros.messages.controller_inputs import NO_INPUTS, SensorScales
from hdd_servo_ros.messages.errors import NotFiniteError, RunError
from hdd_servo_ros.messages.topics import ACCELEROMETER, CONTROL_UPDATES, LDV, PES, REFERENCE
from hdd_servo_ros.nodes.catalog_node import CatalogNode, block_parameters_in
from hdd_servo_ros.nodes.main import run_node
from hdd_servo_ros.parameters import ParameterError, ParameterSet, to_mapping
from hdd_servo_ros.ros.diagnosis import ERROR, OK, WARN, Diagnosis
from hdd_servo_ros.ros.run_plan import RunPlan

_OFTEN = 0.5
"""Fraction of ticks with saturated control above which the diagnosis is an error."""


def block_parameters_of(run: RunPlan, name: str) -> Any:
    """Return the block parameters of a node before tick 0; None if the run does not have the node."""
    return block_parameters_in(run.nodes, name)


class ControllerNode(CatalogNode):
    """
    Publisher of `/control` and `/estimates` for every pair of `/reference` and `/ldv`, or `/reference` and `/pes`.

    The control law drives `/control` through the output stage of the DSP (:class:`~hdd_servo_ros.bench.dsp.Dsp`), whose
    parameters every controller node has.

    Parameters
    ----------
    name
        Name of the catalog row.
    make
        Constructs the controller from its parameters and T [s]; the block of the row if not given.
    """

    def __init__(self, name: str, make: Callable[[Any, float], Controller] | None = None) -> None:
        super().__init__(name)
        row = NODES[name]
        self._kind: type[ParameterSet] = row.block_parameters
        self._make: Callable[[Any, float], Controller] = make or resolve(row.block)
        self._controller = self.trial(self._make, self._kind)
        # Compiles; T decides which frequencies of filters are allowed, and is not known yet.
        unfiltered = dataclasses.replace(self.parameters[ControllerOutputParameters].dsp, filters=FilterParameters())
        self._dsp = Dsp(unfiltered, self.trial_sample_time)
        self._is_multirate = self._dsp.parameters.is_multirate
        if not self._is_multirate:
            self.outputs = tuple(topic for topic in self.outputs if topic is not CONTROL_UPDATES)
        self._dsp.step(*self._controller.step(NO_INPUTS))
        self._scales = SensorScales(0.0, 0.0)
        self._codec = VectorCodec('')
        self._estimates = ArrayCodec(self._controller.estimate_names)
        self._diagnosed = (0, 0)
        self._drive: PlantParameters | None = None
        self._sensor: LdvParameters | None = None
        self._loop: LoopSurroundings | None = None
        self._accelerometer: AccelerometerParameters | None = None
        self._disturbance: DisturbanceParameters | None = None
        self._feedforward: Feedforward | None = None
        self._runout: RunoutCancellation | None = None
        self._observer: Observer | None = None
        self._seek: Seek | None = None
        # Compiles the kernel; the Kalman filter would import a library that most runs do not need.
        Observer(ObserverParameters(method='difference'), 1e-4).step(0.0, 0.0)
        self._held = 0.0
        self._held_feedforward = self._last_feedforward = 0.0
        self._offsets: dict[str, int] = {}
        feedforward_parameters(name, to_mapping(self.parameters[ControllerFeedforwardParameters]))
        if seek_parameters(name, to_mapping(self.parameters[seek_kind(name)])).is_used:
            compiles = no_seek(1e-4)
            compiles.before_law(NO_INPUTS, 0.0)
            compiles.after_law(0.0, 0.0, 0.0)
        runout_parameters(name, to_mapping(self.parameters[ControllerRunoutParameters]))

    def last_tick_needed(self, sample_time: float) -> int:
        if not isinstance(self._controller, HasPlan):
            return 0
        planned = self._make(self.parameters[self._kind], sample_time)
        assert isinstance(planned, HasPlan)
        return planned.last_tick

    def prepare(self, run: RunPlan) -> None:
        self._codec = VectorCodec(run.frame_id)
        self._controller = self._make(self.parameters[self._kind], run.sample_time)
        self._drive = block_parameters_of(run, 'vcm_plant')
        self._offsets = {port.topic.name: offset for offset, port in enumerate(self.inputs)}
        self._observer = None
        if PES.name in self._offsets:
            self._prepare_observer(run.sample_time)
        else:
            self._sensor = block_parameters_of(run, 'ldv_sensor')
            self._scales = self._sensor_scales()
        drive_limit = math.inf if self._drive is None else self._drive.control_limit
        self._dsp = Dsp(self.parameters[ControllerOutputParameters].dsp, run.sample_time, drive_limit)
        self._pass_limit()
        delay = self._dsp.parameters.computation_delay
        self._loop = None
        if self._drive is not None:
            scales = None if self._observer is not None else self._scales
            observer = None if self._observer is None else self._observer.parameters
            self._loop = LoopSurroundings(
                self._drive, run.sample_time, delay, self._sensor, scales, observer, self._dsp.parameters
            )
        self._accelerometer = block_parameters_of(run, BASE_SENSOR)
        self._disturbance = block_parameters_of(run, DISTURBANCE_GENERATOR)
        try:
            names = (
                *self._controller.estimate_names,
                *self._prepare_seek(run.sample_time),
                *self._prepare_feedforward(run.sample_time),
                *self._prepare_runout(run.sample_time),
                *(() if self._observer is None else self._observer.estimate_names),
            )
        except ParameterError as error:
            raise RunError(f'{self.get_name()}: {error}') from None
        self._estimates = ArrayCodec(names)
        self._zeros = np.zeros(len(names))
        for warning in self._warnings():
            self.get_logger().warning(warning)

    def _prepare_observer(self, sample_time: float) -> None:
        if NODES[self.row_name].needs_ldv:
            raise RunError(f'{self.get_name()}: invalid sensor topic /{PES.name}; this controller needs /{LDV.name}')
        self._sensor = None
        self._scales = SensorScales.none()
        self._observer = Observer(self.parameters[ControllerObserverParameters].observer, sample_time)
        self._held = self._held_feedforward = self._last_feedforward = 0.0

    def _prepare_seek(self, sample_time: float) -> tuple[str, ...]:
        """Construct the seek part if it is enabled; return the names of its estimates."""
        parameters: SeekParameters = self.parameters[seek_kind(self.row_name)].seek
        if not parameters.is_used:
            return ()
        self._reject_other_units('seek.method', parameters)
        self._held = 0.0
        surroundings = self._surroundings_of_seek(parameters, sample_time)
        self._seek = Seek(parameters, sample_time, surroundings, self._scales)
        return self._seek.estimate_names

    def _surroundings_of_seek(self, seek: SeekParameters, sample_time: float) -> SeekSurroundings:
        from hdd_servo_ros.analysis.seek_surroundings import seek_surroundings

        return seek_surroundings(
            seek,
            lambda: self._make(self.parameters[self._kind], sample_time),
            sample_time,
            self._dsp,
            self._scales,
            self._sensor,
            None if self._observer is None else self._observer.parameters,
        )

    def _prepare_feedforward(self, sample_time: float) -> tuple[str, ...]:
        """Construct the feedforward if it is enabled; return the names of its estimates."""
        parameters: FeedforwardParameters = self.parameters[ControllerFeedforwardParameters].feedforward
        if not parameters.is_used:
            return ()
        self._reject_other_units('feedforward.method', parameters)
        knowledge = self._feedforward_knowledge(parameters, sample_time)
        self._feedforward = Feedforward(parameters, sample_time, *knowledge)
        return self._feedforward.estimate_names

    def _prepare_runout(self, sample_time: float) -> tuple[str, ...]:
        """Construct the runout cancellation if it is enabled; return the names of its estimates."""
        parameters: RunoutParameters = self.parameters[ControllerRunoutParameters].runout
        if not parameters.is_used:
            return ()
        self._reject_other_units('runout.method', parameters)
        path = self._runout_path(parameters, sample_time)
        RunoutCancellation(parameters, sample_time, path).step(0, 0.0)  # compiles
        self._runout = RunoutCancellation(parameters, sample_time, path)
        return self._runout.estimate_names

    def _reject_other_units(
        self, name: str, parameters: SeekParameters | FeedforwardParameters | RunoutParameters
    ) -> None:
        if self._drive is not None:
            try:
                reject_other_units(f'{self.get_name()}.{name}', parameters, self._drive)
            except ParameterError as error:
                raise RunError(str(error)) from None

    def _feedforward_knowledge(self, parameters: FeedforwardParameters, sample_time: float) -> Any:
        if self._accelerometer is None:
            raise RunError(
                f'{self.get_name()}: invalid value for parameter feedforward.method: {parameters.method!r}; '
                f'expected none, because this run has no {BASE_SENSOR}'
            )
        from hdd_servo_ros.analysis.feedforward_path import feedforward_knowledge

        fresh, observer = self._fresh(sample_time)
        return feedforward_knowledge(
            parameters, fresh, self._dsp.parameters, self._accelerometer, sample_time, self._scales, observer
        )

    def _runout_path(self, parameters: RunoutParameters, sample_time: float) -> Any:
        from hdd_servo_ros.analysis.feedforward_path import runout_path

        fresh, observer = self._fresh(sample_time)
        return runout_path(parameters, fresh, self._dsp.parameters, sample_time, self._scales, observer)

    def _fresh(self, sample_time: float) -> tuple[Controller, Observer | None]:
        """Return a new controller and observer with the parameters of the run, both at rest."""
        observer = None
        if self._observer is not None:
            observer = Observer(self.parameters[ControllerObserverParameters].observer, sample_time)
        return self._make(self.parameters[self._kind], sample_time), observer

    def _sensor_scales(self) -> SensorScales:
        """Return the scales of the sensor; raises :class:`RunError` if they are unknown."""
        own: ControllerInputParameters = self.parameters[ControllerInputParameters]
        if self._sensor is not None:
            return sensor_scales(own, self._sensor)
        for name in ('displacement_scale', 'velocity_scale'):
            if not getattr(own, name):
                raise RunError(
                    f'{self.get_name()}: invalid value for parameter {name}: 0.0; '
                    'expected a value above 0, because this run has no ldv_sensor that defines it'
                )
        return SensorScales(own.displacement_scale, own.velocity_scale)

    def _warnings(self) -> Iterable[str]:
        """Return the warnings for the user before the run."""
        if self._loop is None:
            return self._controller.warnings() if isinstance(self._controller, WarnsBeforeRun) else ()
        warnings = fragility.warnings(self._controller, self._loop)
        if self._runout is None:
            return warnings
        from hdd_servo_ros.analysis.runout_sensitivity import runout_warnings, speed_warnings

        return (
            *warnings,
            *speed_warnings(self._runout.parameters, self._disturbance),
            *runout_warnings(self._controller, self._loop, self._runout.parameters, self._runout.path),
        )

    def step(self, tick: int, stamp: bytes, messages: Sequence[bytes]) -> None:
        controller, observer, offsets = self._controller, self._observer, self._offsets
        if observer is None:
            displacement, velocity, _ = unpack_vector(messages[offsets[LDV.name]])
        else:
            _, displacement, _ = unpack_vector(messages[offsets[PES.name]])
            # The feedforward cancels a force that the observer does not model.
            _, velocity = observer.step(displacement, self._held - self._held_feedforward)
        inputs = self._scales.inputs(tick, displacement, velocity, *unpack_vector(messages[offsets[REFERENCE.name]]))
        seek = self._seek
        if seek is not None:
            inputs = seek.before_law(inputs, self._held)
        law = controller.step(inputs)
        estimates = controller.estimates
        if seek is not None:
            law = seek.after_law(*law)
            estimates = np.concatenate([estimates, seek.estimates])
        feedforward = self._feedforward
        if feedforward is not None:
            output_1, output_2, _ = unpack_vector(messages[offsets[ACCELEROMETER.name]])
            law = feedforward.compensate(inputs.position - inputs.desired_position, output_1, output_2, *law)
            estimates = np.concatenate([estimates, feedforward.estimates])
            u_ff = feedforward.voltage
            self._held_feedforward = self._last_feedforward if self._dsp.parameters.computation_delay else u_ff
            self._last_feedforward = u_ff
        if self._runout is not None:
            law = self._runout.compensate(tick, inputs.position - inputs.desired_position, *law)
            estimates = np.concatenate([estimates, self._runout.estimates])
        if observer is not None:
            estimates = np.concatenate([estimates, observer.estimates])
        u, unsaturated, feedback = self._dsp.step(*law)
        self._held = self._dsp.mean_voltage(u)
        try:
            self.publish_vector(0, tick, self._codec.pack(stamp, u, unsaturated, feedback), u, unsaturated, feedback)
            # Zero times a nonfinite number is NaN; a plain sum of finite numbers may overflow.
            if estimates.dot(self._zeros) != 0.0:
                raise NotFiniteError(
                    self.loop_publishers[1].topic_name, tick, estimates.tolist(), self.get_name(), self._estimates.names
                )
        except NotFiniteError:
            fault = controller.fault() if isinstance(controller, ReportsFault) else ''
            if fault:
                raise RunError(fault) from None
            raise
        self.publish_bytes(1, self._estimates.pack_array(estimates))
        if self._is_multirate:
            later = self._dsp.later_voltages
            self.publish_vector(2, tick, self._codec.pack(stamp, *later), *later)

    def update(self) -> None:
        self._controller.update(self.parameters[self._kind])
        self._dsp.update(self.parameters[ControllerOutputParameters].dsp)
        self._pass_limit()
        if self._observer is not None:
            self._observer.update(self.parameters[ControllerObserverParameters].observer)
        if self._seek is not None:
            seek = self.parameters[seek_kind(self.row_name)].seek
            self._seek.update(seek, self._surroundings_of_seek(seek, self._seek.sample_time))
        if self._feedforward is not None:
            parameters = self.parameters[ControllerFeedforwardParameters].feedforward
            knowledge = self._feedforward_knowledge(parameters, self._feedforward.sample_time)
            self._feedforward.update(parameters, *knowledge)
        if self._runout is not None:
            runout = self.parameters[ControllerRunoutParameters].runout
            self._runout.update(runout, self._runout_path(runout, self._runout.sample_time))

    def _pass_limit(self) -> None:
        if isinstance(self._controller, KnowsOutputLimit):
            self._controller.limit_output(self._dsp.limit)

    def diagnose(self) -> Iterable[Diagnosis]:
        limited = self._dsp.saturated_samples
        (tick, before), self._diagnosed = self._diagnosed, (self.tick, limited)
        count, ticks = limited - before, self.tick - tick
        values = {'ticks at the limit since the last report': count, 'in total': limited}
        if count == 0:
            yield Diagnosis('control', OK, 'inside its limit', values)
        else:
            level = ERROR if count > _OFTEN * ticks else WARN
            yield Diagnosis('control', level, f'at its limit in {count} of {ticks} ticks', values)
        if self._seek is not None:
            yield _diagnosis_of_seek(self._seek)
        if self._feedforward is not None:
            yield _diagnosis_of(self._feedforward)
        if self._runout is not None:
            yield _diagnosis_of_runout(self._runout)


def _diagnosis_of_seek(seek: Seek) -> Diagnosis:
    values = {'gain relative to the model': seek.gain, 'friction relative to the model': seek.friction_level}
    at_limits = seek.at_limits
    if at_limits:
        message = f'{" and ".join(at_limits)} at the adaptation limit: the model differs, or the head was held'
        return Diagnosis('seek', WARN, message, values)
    return Diagnosis('seek', OK, seek.mode, values)


def _diagnosis_of(feedforward: Feedforward) -> Diagnosis:
    values = {
        'rms error [um]': feedforward.error_rms,
        'rms error without feedforward, estimated [um]': feedforward.error_rms_without,
        'times switched off in total': feedforward.times_switched_off,
    }
    if not feedforward.parameters.enabled:
        return Diagnosis('feedforward', OK, 'not enabled', values)
    if feedforward.is_switched_off:
        return Diagnosis('feedforward', WARN, 'switched off, because the error is smaller without it', values)
    return Diagnosis('feedforward', OK, 'active', values)


def _diagnosis_of_runout(runout: RunoutCancellation) -> Diagnosis:
    values = {'rms of the cancellation [V]': runout.learned_rms, 'learning gain per revolution': runout.gain}
    if not runout.parameters.enabled:
        return Diagnosis('runout cancellation', OK, 'not enabled', values)
    if runout.is_limited:
        return Diagnosis('runout cancellation', WARN, 'at its limit: it may diverge', values)
    return Diagnosis('runout cancellation', OK, 'active', values)


def run_plain_controller(name: str, arguments: Sequence[str] | None) -> int:
    """Run the node of a controller row until its run ends; see :func:`run_node` for the exit codes."""
    return run_node(name, lambda: ControllerNode(name), arguments)
