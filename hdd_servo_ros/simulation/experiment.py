"""Experiment without middleware: reference, drive, sensor and controller, run tick by tick."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.bench.accelerometer import Accelerometer, AccelerometerParameters
from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters, Dsp, DspParameters
from hdd_servo_ros.bench.ldv import Ldv
from hdd_servo_ros.bench.servo_sensor import ServoSensor, ServoSensorArrays, ServoSensorParameters
from hdd_servo_ros.control.controller import Controller, KnowsOutputLimit
from hdd_servo_ros.control.feedforward import AccelerometerScales, Feedforward
from hdd_servo_ros.control.feedforward import PlainArrays as FeedforwardArrays
from hdd_servo_ros.control.feedforward_parameters import ControllerFeedforwardParameters, FeedforwardParameters
from hdd_servo_ros.control.observer import ControllerObserverParameters, Observer, ObserverArrays, ObserverParameters
from hdd_servo_ros.control.runout import PlainArrays as RunoutArrays
from hdd_servo_ros.control.runout import RunoutCancellation, path_length
from hdd_servo_ros.control.runout_parameters import ControllerRunoutParameters, RunoutParameters
from hdd_servo_ros.control.seek import PlainArrays as SeekArrays
from hdd_servo_ros.control.seek import Seek, SeekSurroundings, no_seek
from hdd_servo_ros.control.seek_parameters import SeekParameters
from hdd_servo_ros.drive.plant import Plant
from hdd_servo_ros.graph.block_parameters import (
    block_parameters,
    dsp_parameters,
    feedforward_parameters,
    input_parameters,
    observer_parameters,
    reject_other_units,
    runout_parameters,
    seek_kind,
    seek_parameters,
    sensor_scales,
)
from hdd_servo_ros.graph.catalog import BASE_SENSOR, NODES, SENSORS, resolve
from hdd_servo_ros.graph.catalog import CONTROLLERS as CONTROLLER_NODES
from hdd_servo_ros.graph.controller_loader import load_controller, reject_former_object
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR
from hdd_servo_ros.messages.controller_inputs import SensorScales
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.topics import (
    ACCELEROMETER,
    BASE_ACCELERATION,
    CONTROL_UPDATES,
    DISTURBANCE,
    PES,
    SIGNAL_TOPICS,
)
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.signals.reference import Reference
from hdd_servo_ros.simulation.closed_loop import ANGULAR_Z, LINEAR_Y, Controllers, closed_loop
from hdd_servo_ros.simulation.disturbance import DisturbanceSource


@functools.cache
def _kernel_kinds() -> dict[str, int]:
    """Return the number of each controller in the kernel, by its block."""
    return {NODES[CONTROLLER_NODES[name]].block: kind for kind, name in enumerate(Controllers._fields)}


@functools.cache
def _arrays_of_default(node: str) -> tuple[NDArray[np.float64], ...]:
    """Return placeholder arrays for a controller that is not used; the kernel needs the type but not the values."""
    row = NODES[node]
    arrays: tuple[NDArray[np.float64], ...] = resolve(row.block)(row.block_parameters(), 1e-4).arrays
    return arrays


@functools.cache
def _default_accelerometer() -> Accelerometer:
    """Return placeholder accelerometers."""
    return Accelerometer(AccelerometerParameters(), 1e-4)


@functools.cache
def _placeholder_servo_sensor() -> ServoSensorArrays:
    """Return placeholder arrays for the servo sensor."""
    return ServoSensor(ServoSensorParameters(), 1e-4).arrays


@functools.cache
def _placeholder_observer() -> ObserverArrays:
    """Return placeholder arrays for the observer."""
    return Observer(ObserverParameters(method='difference'), 1e-4).arrays


@functools.cache
def _placeholder_feedforward() -> FeedforwardArrays:
    """Return placeholder arrays for the feedforward."""
    parameters = FeedforwardParameters(method='fixed')
    return Feedforward(parameters, 1e-4, np.zeros(parameters.path_length), AccelerometerScales(1.0, 1.0)).arrays


@functools.cache
def _placeholder_seek() -> SeekArrays:
    """Return placeholder arrays for the seek block."""
    return no_seek(1e-4).arrays


@functools.cache
def _placeholder_runout() -> RunoutArrays:
    """Return placeholder arrays for the runout cancellation."""
    parameters = RunoutParameters(method='harmonics')
    return RunoutCancellation(parameters, 1e-4, np.zeros(path_length(parameters, 1e-4))).arrays


class Experiment:
    """
    Closed loop of a reference, a drive, a sensor and a controller.

    Parameters
    ----------
    sample_time
        T [s].
    controller
        ``'adaptive_nn'``, ``'pid'``, ``'seek'``, ``'open_loop'`` or ``'signal_analyzer'``; the name or import path of a
        custom controller, see :func:`~hdd_servo_ros.graph.controller_loader.load_controller`; or any object that
        satisfies :class:`~hdd_servo_ros.control.controller.Controller`. Custom controllers and objects are called from
        Python at every tick.
    parameters
        Parameters of each node with a block, under dotted names; other parameters keep their defaults. Sections of
        other nodes are ignored. A section for ``disturbance_generator`` adds this source.
    dsp
        DSP parameters for a controller given as an object; a named controller has them in its section.
    disturbance
        External disturbance of the drive. None uses the ``disturbance_generator`` if it has a section, and no
        disturbance otherwise.
    sensor
        ``'ldv'`` or ``'servo'``; with ``'servo'`` the vibrometer is not used, and an observer estimates the velocity.

    Raises
    ------
    ParameterError
        If a value is rejected or a name is unknown (the message names node and parameter); if the ``step`` of a
        controller object takes six arguments, the former interface; or if both ``disturbance`` and a section for
        ``disturbance_generator`` are given.

    Examples
    --------
    Default drive and controller for 0.3 s, then the PID controller with a 200 Hz reference:

    >>> from hdd_servo_ros.analysis import rms
    >>> from hdd_servo_ros.simulation import Experiment
    >>> run = Experiment(1e-4).run(0, 3001)
    >>> f'{1e3 * rms(run.position_error[run.since(0.2)]):.2f} nm'
    '1.48 nm'
    >>> pid = Experiment(1e-4, 'pid', {'reference_generator': {'frequency': 200.0}})
    >>> f'{1e3 * rms(pid.run(0, 3001).position_error[2000:]):.1f} nm'
    '48.4 nm'
    """

    def __init__(
        self,
        sample_time: float,
        controller: str | Controller = 'adaptive_nn',
        parameters: Mapping[str, Mapping[str, object]] | None = None,
        dsp: DspParameters | None = None,
        disturbance: DisturbanceSource | None = None,
        sensor: str = 'ldv',
    ) -> None:
        self.sample_time = sample_time
        self._blocks: dict[str, Any] = {}
        sections = parameters or {}
        self.reference: Reference = self._block('reference_generator', sections)
        self.plant: Plant = self._block('vcm_plant', sections)
        if sensor not in SENSORS:
            raise ParameterError('sensor', sensor, f'one of {", ".join(SENSORS)}')
        self.ldv: Ldv = self._block('ldv_sensor', sections if sensor == 'ldv' else {})
        self.servo: ServoSensor | None = None
        if sensor == 'servo':
            self.servo = self._block('servo_sensor', sections)
            del self._blocks['ldv_sensor']
        self._kind: int | None = None
        self.controller: Controller
        scales = ControllerInputParameters()
        feedforward = FeedforwardParameters()
        runout = RunoutParameters()
        observer = ObserverParameters()
        seek = SeekParameters()
        self._make_law: Callable[[Any, float], Controller]
        if isinstance(controller, str):
            if controller in CONTROLLER_NODES:
                node = CONTROLLER_NODES[controller]
                self._kind = _kernel_kinds()[NODES[node].block]
                self.controller = self._block(node, sections)
                self._make_law = resolve(NODES[node].block)
                parameters_of_law = block_parameters(node, sections.get(node, {}))
            else:
                custom = load_controller(controller)
                node, self._make_law = custom.node, custom.make
                parameters_of_law = block_parameters(node, sections.get(node, {}))
                custom.trial(parameters_of_law, sample_time)
                self.controller = self._blocks[node] = custom.make(parameters_of_law, sample_time)
            own = sections.get(node, {})
            dsp = dsp_parameters(node, own)
            scales = input_parameters(node, own)
            feedforward = feedforward_parameters(node, own)
            runout = runout_parameters(node, own)
            observer = observer_parameters(node, own)
            seek = seek_parameters(node, own)
            if self.servo is not None and NODES[node].needs_ldv:
                raise ParameterError('sensor', sensor, f'ldv, because {node} measures the vibrometer')
        else:
            reject_former_object(controller)
            self.controller = controller
        try:
            self.dsp = Dsp(dsp or DspParameters(), sample_time, self.plant.parameters.control_limit)
        except ParameterError as error:
            owner = f'{node}.' if isinstance(controller, str) else ''
            raise ParameterError(f'{owner}{error.name}', error.value, error.allowed) from None
        if self.dsp.parameters.is_multirate:
            self.plant = self._blocks['vcm_plant'] = Plant(self.plant.parameters, sample_time, is_multirate=True)
        if isinstance(self.controller, KnowsOutputLimit):
            self.controller.limit_output(self.dsp.limit)
        self.scales = sensor_scales(scales, self.ldv.parameters) if self.servo is None else SensorScales.none()
        self.observer = None if self.servo is None else Observer(observer, sample_time)
        self.seek: Seek | None = None
        if seek.is_used:
            reject_other_units(f'{node}.seek.method', seek, self.plant.parameters)
            try:
                surroundings = self._surroundings_of_seek(seek, parameters_of_law)
            except ParameterError as error:
                raise error.renamed(f'{node}.{error.name}') from None
            self.seek = Seek(seek, sample_time, surroundings, self.scales)
        self._disturbance = disturbance
        if DISTURBANCE_GENERATOR in sections:
            if disturbance is not None:
                raise ParameterError(
                    'disturbance', disturbance, f'None, because parameters of {DISTURBANCE_GENERATOR} are given'
                )
            self._disturbance = self._block(DISTURBANCE_GENERATOR, sections)
        self.accelerometer: Accelerometer | None = None
        if feedforward.is_used or BASE_SENSOR in sections:
            self.accelerometer = self._block(BASE_SENSOR, sections)
        self.feedforward: Feedforward | None = None
        if feedforward.is_used:
            reject_other_units(f'{node}.feedforward.method', feedforward, self.plant.parameters)
            data = self._feedforward_data(feedforward, parameters_of_law)
            self.feedforward = Feedforward(feedforward, sample_time, *data)
        self.runout: RunoutCancellation | None = None
        if runout.is_used:
            reject_other_units(f'{node}.runout.method', runout, self.plant.parameters)
            try:
                path = self._runout_path(runout, parameters_of_law)
            except ParameterError as error:
                raise error.renamed(f'{node}.{error.name}') from None
            self.runout = RunoutCancellation(runout, sample_time, path)
        self._held: NDArray[np.float64] = np.zeros(6)
        self._next_tick = 0

    def _block(self, name: str, sections: Mapping[str, Mapping[str, object]]) -> Any:
        make = resolve(NODES[name].block)
        parameters = block_parameters(name, sections.get(name, {}))
        try:
            self._blocks[name] = make(parameters, self.sample_time)
        except ParameterError as error:
            raise error.renamed(f'{name}.{error.name}') from None
        return self._blocks[name]

    def _feedforward_data(
        self, feedforward: FeedforwardParameters, law: Any
    ) -> tuple[NDArray[np.float64], AccelerometerScales]:
        """Return the loop and sensor data that the feedforward needs, for a controller with these parameters."""
        from hdd_servo_ros.analysis.feedforward_path import feedforward_knowledge

        assert self.accelerometer is not None
        fresh, observer = self._fresh(law)
        return feedforward_knowledge(
            feedforward,
            fresh,
            self.dsp.parameters,
            self.accelerometer.parameters,
            self.sample_time,
            self.scales,
            observer,
        )

    def _surroundings_of_seek(self, seek: SeekParameters, law: Any) -> SeekSurroundings:
        """Return the loop data that the seek block needs, for a controller with these parameters."""
        from hdd_servo_ros.analysis.seek_surroundings import seek_surroundings

        sensor = None if self.servo is not None else self.ldv.parameters
        return seek_surroundings(
            seek,
            lambda: self._make_law(law, self.sample_time),
            self.sample_time,
            self.dsp,
            self.scales,
            sensor,
            None if self.observer is None else self.observer.parameters,
        )

    def _runout_path(self, runout: RunoutParameters, law: Any) -> NDArray[np.float64]:
        """Return the path model of the runout cancellation, for a controller with these parameters."""
        from hdd_servo_ros.analysis.feedforward_path import runout_path

        fresh, observer = self._fresh(law)
        return runout_path(runout, fresh, self.dsp.parameters, self.sample_time, self.scales, observer)

    def _fresh(self, law: Any) -> tuple[Controller, Observer | None]:
        """Return a new controller with these parameters and a new observer like that of the run, both at rest."""
        observer = None if self.observer is None else Observer(self.observer.parameters, self.sample_time)
        return self._make_law(law, self.sample_time), observer

    def block(self, node: str) -> Any:
        """Return the block of a node of this package; raises KeyError if this experiment does not have it."""
        return self._blocks[node]

    def update(self, node: str, sets: Mapping[type[Any], Any]) -> None:
        """Change all parameter sets of a node from the next tick on; nodes without a block are ignored."""
        if node not in self._blocks:
            return
        self._blocks[node].update(sets[NODES[node].block_parameters])
        if ControllerOutputParameters in sets:
            self.dsp.update(sets[ControllerOutputParameters].dsp)
            if isinstance(self.controller, KnowsOutputLimit):
                self.controller.limit_output(self.dsp.limit)
        if self.observer is not None and ControllerObserverParameters in sets:
            self.observer.update(sets[ControllerObserverParameters].observer)
        if self.feedforward is not None and ControllerFeedforwardParameters in sets:
            parameters = sets[ControllerFeedforwardParameters].feedforward
            law = sets[NODES[node].block_parameters]
            self.feedforward.update(parameters, *self._feedforward_data(parameters, law))
        if self.runout is not None and ControllerRunoutParameters in sets:
            runout = sets[ControllerRunoutParameters].runout
            self.runout.update(runout, self._runout_path(runout, sets[NODES[node].block_parameters]))

        if self.seek is not None and ControllerOutputParameters in sets:
            seek = sets[seek_kind(node)].seek
            law = sets[NODES[node].block_parameters]
            self.seek.update(seek, self._surroundings_of_seek(seek, law))

    @property
    def estimate_names(self) -> tuple[str, ...]:
        """Column names of ``/estimates``: first those of the controller, then those of the blocks around it."""
        blocks = (self.controller, self.seek, self.feedforward, self.runout, self.observer)
        return tuple(name for block in blocks if block is not None for name in block.estimate_names)

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings about drive and controller, for the log at the start of a run."""
        loop = fragility.LoopSurroundings(
            self.plant.parameters,
            self.sample_time,
            self.dsp.parameters.computation_delay,
            self.ldv.parameters if self.observer is None else None,
            self.scales if self.observer is None else None,
            None if self.observer is None else self.observer.parameters,
            self.dsp.parameters,
        )
        warnings = (*self.plant.warnings(), *fragility.warnings(self.controller, loop))
        if self.runout is None:
            return warnings
        from hdd_servo_ros.analysis.runout_sensitivity import runout_warnings, speed_warnings

        source = self._blocks.get(DISTURBANCE_GENERATOR)
        return (
            *warnings,
            *speed_warnings(self.runout.parameters, None if source is None else source.parameters),
            *runout_warnings(self.controller, loop, self.runout.parameters, self.runout.path),
        )

    def saturation_warnings(self) -> dict[tuple[str, str], str]:
        """
        Return the warnings about clipped outputs and crash stops that were hit.

        The keys are the node of the instrument and its output, or the node of the drive and its stop.
        """
        warnings = {('vcm_plant', stop): message for stop, message in self.plant.impact_warnings().items()}
        warnings |= {('ldv_sensor', output): message for output, message in self.ldv.saturation_warnings().items()}
        if self.servo is not None:
            warnings.update(
                (('servo_sensor', output), message) for output, message in self.servo.saturation_warnings().items()
            )
        if self.accelerometer is not None:
            clipped = self.accelerometer.saturation_warnings()
            warnings.update(((BASE_SENSOR, output), message) for output, message in clipped.items())
        return warnings

    @property
    def is_compiled(self) -> bool:
        """Whether the loop is one compiled kernel, which is the case for the controllers of this package."""
        return self._kind is not None

    def compile(self) -> None:
        """Compile the kernels that :meth:`run` calls, unless they are cached; does not change the state."""
        if DISTURBANCE_GENERATOR in self._blocks:
            self._blocks[DISTURBANCE_GENERATOR].rows(self._next_tick, 0)
        if self.is_compiled:
            self.run(self._next_tick, 0)
            return
        Reference(self.reference.parameters, self.sample_time).step(0)
        plant = Plant(self.plant.parameters, self.sample_time, is_multirate=self.plant.is_multirate)
        plant.output()
        plant.step(1, 0.0, 0.0, (0.0, 0.0, 0.0) if plant.is_multirate else None)
        if self.servo is None or self.observer is None:
            Ldv(self.ldv.parameters, self.sample_time).step(0, 0.0, 0.0)
        else:
            ServoSensor(self.servo.parameters, self.sample_time).step(0, 0.0)
            Observer(self.observer.parameters, self.sample_time).step(0.0, 0.0)
        Dsp(self.dsp.parameters, self.sample_time).step(0.0, 0.0, 0.0)

    def empty_rows(self, first_tick: int, count: int) -> SignalRows:
        """Return empty rows for ``count`` ticks of this experiment, to be filled by :meth:`run`."""
        optional = () if self._disturbance is None else self._disturbance.topics
        if self.accelerometer is not None:
            optional = (*optional, ACCELEROMETER)
        if self.servo is not None:
            optional = (*optional, PES)
        if self.dsp.parameters.is_multirate:
            optional = (*optional, CONTROL_UPDATES)
        drive = self.plant.parameters
        units = Units(drive.length_unit, drive.control_unit)
        names = self.estimate_names
        return SignalRows.empty(first_tick, count, self.sample_time, names, optional, units)

    def run(self, first_tick: int, count: int, rows: SignalRows | None = None) -> SignalRows:
        """
        Run ticks ``first_tick`` to ``first_tick + count - 1``.

        The ticks of an experiment start at 0 and must be consecutive; they may be run in pieces of any length.

        Parameters
        ----------
        first_tick, count
            First tick and number of ticks.
        rows
            Rows from an earlier call with the same count, to be overwritten instead of allocating new memory.

        Raises
        ------
        ValueError
            If ``first_tick`` does not follow the last tick, or the shape of the disturbance rows does not match their
            topics.
        ControllerError
            If a custom controller fails; ``rows``, if given, then contain the ticks before the failure.
        """
        if first_tick != self._next_tick:
            raise ValueError(f'expected tick {self._next_tick}, got {first_tick}; ticks of a run must be consecutive')
        self._next_tick += count
        rows = (
            self.empty_rows(first_tick, count) if rows is None or len(rows) != count else rows.starting_at(first_tick)
        )
        if self._disturbance is not None and count:
            made = self._disturbance.rows(first_tick, count)
            for topic, found in zip(self._disturbance.topics, made, strict=True):
                if np.shape(found) != rows[topic.name].shape:
                    raise ValueError(
                        f'/{topic.name}: invalid shape of the rows of ticks {first_tick} to {first_tick + count - 1}: '
                        f'{np.shape(found)}; expected {rows[topic.name].shape}'
                    )
                rows[topic.name][:] = found
        if self._kind is None:
            self._run_from_python(rows)
        else:
            closed_loop(
                first_tick,
                self._kind,
                self.reference.arrays,
                self.plant.arrays,
                self.ldv.arrays,
                *self.scales,
                _placeholder_servo_sensor() if self.servo is None else self.servo.arrays,
                _placeholder_observer() if self.observer is None else self.observer.arrays,
                self._controllers(),
                self.seek is not None,
                _placeholder_seek() if self.seek is None else self.seek.arrays,
                (self.accelerometer or _default_accelerometer()).arrays,
                self.feedforward is not None,
                _placeholder_feedforward() if self.feedforward is None else self.feedforward.arrays,
                self.runout is not None,
                _placeholder_runout() if self.runout is None else self.runout.arrays,
                self.dsp.arrays,
                self._held,
                np.empty(2 * len(rows)),
                rows.kernel_arrays,
            )
        return rows

    def _estimates(self) -> NDArray[np.float64]:
        """Return the values of ``/estimates`` after a step."""
        blocks = (self.controller, self.seek, self.feedforward, self.runout, self.observer)
        return np.concatenate([block.estimates for block in blocks if block is not None])

    def _controllers(self) -> Controllers:
        """Return the arrays of all built-in controllers, with placeholders for those that are not used."""
        controller: Any = self.controller
        arrays = (
            controller.arrays if kind == self._kind else _arrays_of_default(CONTROLLER_NODES[name])
            for kind, name in enumerate(Controllers._fields)
        )
        return Controllers._make(arrays)

    def _measure(
        self, rows: SignalRows, row: int, tick: int, head: Sequence[float], control: float, track_center: float
    ) -> tuple[float, float]:
        """Return the sensor outputs for the controller, and write the row of the sensor."""
        if self.servo is None or self.observer is None:
            ldv = self.ldv.step(tick, head[0], head[1])
            rows.ldv[row] = (*ldv, 0.0)
            return ldv
        decoded = self.servo.step(tick, head[0], track_center)
        rows.pes[row] = decoded
        # Exclude the feedforward: it cancels a force that the observer does not model.
        _, velocity = self.observer.step(decoded[1], control - float(self._held[4]))
        return decoded[1], velocity

    def _run_from_python(self, rows: SignalRows) -> None:
        signals = [rows[topic.name] for topic in SIGNAL_TOPICS if topic.name in rows]
        forces = rows.disturbance.force if DISTURBANCE.name in rows else np.zeros(len(rows))
        centers = rows.disturbance.track_center if DISTURBANCE.name in rows else np.zeros(len(rows))
        base = rows[BASE_ACCELERATION.name] if BASE_ACCELERATION.name in rows else np.zeros((len(rows), 6))
        for row in range(len(rows)):
            tick = rows.first_tick + row
            reference = self.reference.step(tick)
            control, force, linear, angular = self._held[:4].tolist()
            later = self.dsp.later_voltages if self.plant.is_multirate else None
            head = self.plant.output() if tick == 0 else self.plant.step(tick, control, force, later)
            mean = self.dsp.mean_voltage(control)
            measured = self._measure(rows, row, tick, head, mean, float(centers[row]))
            outputs = (0.0, 0.0)
            if self.accelerometer is not None:
                outputs = self.accelerometer.step(tick, linear, angular, control)
                rows[ACCELEROMETER.name][row] = (*outputs, 0.0)
            inputs = self.scales.inputs(tick, *measured, *reference)
            if self.seek is not None:
                inputs = self.seek.before_law(inputs, mean)
            law = self.controller.step(inputs)
            if self.seek is not None:
                law = self.seek.after_law(*law)
            if self.feedforward is not None:
                law = self.feedforward.compensate(inputs.position - inputs.desired_position, *outputs, *law)
                u_ff = self.feedforward.voltage
                self._held[4:] = self._held[5] if self.dsp.parameters.computation_delay else u_ff, u_ff
            if self.runout is not None:
                law = self.runout.compensate(tick, inputs.position - inputs.desired_position, *law)
            commanded = self.dsp.step(*law)
            self._held[:4] = commanded[0], forces[row], base[row, LINEAR_Y], base[row, ANGULAR_Z]
            rows.reference[row] = reference
            rows.head[row] = head
            rows.control[row] = commanded
            if self.plant.is_multirate:
                rows[CONTROL_UPDATES.name][row] = self.dsp.later_voltages
            rows['estimates'][row] = self._estimates()
            if not math.isfinite(sum(head) + sum(commanded)) and not all(map(math.isfinite, (*head, *commanded))):
                # Later values would be meaningless, and the controller must not be called with them.
                for signal in signals:
                    signal[row + 1 :] = math.nan
                return
