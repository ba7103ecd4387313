"""Trial of parameters before they are accepted: construct and step the block of a node with them."""

import copy
import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from hdd_servo_ros.bench.accelerometer import AccelerometerParameters
from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters, Dsp
from hdd_servo_ros.control.controller import Controller, KnowsOutputLimit
from hdd_servo_ros.control.feedforward import Feedforward
from hdd_servo_ros.control.feedforward_parameters import ControllerFeedforwardParameters
from hdd_servo_ros.control.observer import ControllerObserverParameters, Observer
from hdd_servo_ros.control.runout import RunoutCancellation
from hdd_servo_ros.control.runout_parameters import ControllerRunoutParameters
from hdd_servo_ros.control.seek import Seek
from hdd_servo_ros.drive.plant import PlantParameters
from hdd_servo_ros.graph.block_parameters import reject_other_units, seek_kind, sensor_scales
from hdd_servo_ros.graph.catalog import BASE_SENSOR, CONTROLLER, NODES, SENSORS, resolve
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR
from hdd_servo_ros.messages.controller_inputs import NO_INPUTS, SensorScales
from hdd_servo_ros.parameters import InvalidParameterError, ParameterError, ParameterSet, from_mapping, to_mapping

Sets = Mapping[type[Any], Any]
"""All parameters of a node: an instance of each of its dataclasses."""
Attempt = Callable[[Sets], object]
"""Constructs and steps the blocks of a node; raises any exception on failure."""

TICKS = 4
"""Number of steps of a trial."""
ORDINARY = (1e-30, 1e30)
"""Magnitudes whose products and quotients of a few stay finite."""
_FEW_TICKS = 2**53


class NotFiniteInTrialError(ArithmeticError):
    """An output of a trial is not finite."""

    def __init__(self) -> None:
        super().__init__('its output is not finite')


def reject_failing(node: str, sets: Sets, accepted: Sets, attempt: Attempt) -> None:
    """
    Reject parameters for which an attempt raises any exception.

    Parameters
    ----------
    node
        Name of the node, for the message.
    sets
        The parameters.
    accepted
        Parameters with which it succeeds: the previous ones, or the defaults.
    attempt
        The attempt.

    Raises
    ------
    ParameterError
        With the parameter that causes the failure, among those that differ from ``accepted``.
    """
    error = _failure(sets, attempt)
    if error is None:
        return
    if isinstance(error, ParameterError):
        raise error
    name, value = _cause(sets, accepted, attempt)
    text = ' '.join(str(error).split())
    reason = text if isinstance(error, NotFiniteInTrialError) else f'{type(error).__name__}{": " if text else ""}{text}'
    raise InvalidParameterError(name, value, f'{node} cannot run with it: {reason}') from error


def _failure(sets: Sets, attempt: Attempt) -> Exception | None:
    try:
        with np.errstate(all='ignore'):
            attempt(sets)
    except Exception as error:  # a block may raise anything for an unusable value
        return error
    return None


def _cause(sets: Sets, accepted: Sets, attempt: Attempt) -> tuple[str, object]:
    """Return name and value of the parameter whose change makes the attempt fail, otherwise of the first."""
    changed = [
        (kind, name, value)
        for kind, values in sets.items()
        for name, value in to_mapping(values).items()
        if value != to_mapping(accepted[kind])[name]
    ]
    for kind, name, value in changed if len(changed) > 1 else ():
        before = {**to_mapping(sets[kind]), name: to_mapping(accepted[kind])[name]}
        try:
            others: Sets = {**sets, kind: from_mapping(kind, before)}
        except ParameterError:
            # The parameters are valid only together.
            continue
        if _failure(others, attempt) is None:
            return name, value
    # Without a change the cause is elsewhere in the run, which this node cannot name.
    return changed[0][1:] if changed else ('', None)


def has_extremes(sets: Iterable[ParameterSet]) -> bool:
    """Return whether a value is so large or so small that computations may overflow or underflow."""
    return any(
        isinstance(number, float) and number != 0.0 and not ORDINARY[0] <= abs(number) <= ORDINARY[1]
        for values in sets
        for value in to_mapping(values).values()
        for number in (value if isinstance(value, tuple) else (value,))
    )


def attempt_block(node: str, sample_time: float, *, is_change: bool) -> Attempt:
    """
    Return the attempt for a node that is not a controller: construct and step its block.

    Parameters
    ----------
    node
        Name of a node in the catalog that has a block.
    sample_time
        T [s].
    is_change
        Whether it is a change during a run; outputs that are not finite are then failures too. A run that starts with
        such parameters ends at once and reports the topic.
    """
    kind = NODES[node].block_parameters

    def attempt(sets: Sets) -> None:
        _step(node, resolve(NODES[node].block)(sets[kind], sample_time), is_change)

    return attempt


def attempt_change(node: str, block: Any, *, is_change: bool) -> Attempt:
    """Return the attempt to update a copy of a block of this package; see :func:`attempt_block`."""
    kind = NODES[node].block_parameters

    def attempt(sets: Sets) -> None:
        tried = copy.deepcopy(block)
        tried.update(sets[kind])
        _step(node, tried, is_change)

    return attempt


def _step(node: str, block: Any, is_change: bool) -> None:
    if node not in _STEPS:
        # Only constructed.
        return
    numbers = [number for tick in _ticks(node, block) for number in _flat(_STEPS[node](block, tick))]
    if is_change and not all(map(math.isfinite, numbers)):
        raise NotFiniteInTrialError


def _ticks(node: str, block: Any) -> Iterator[int]:
    yield from range(TICKS)
    if node == 'reference_generator':
        # A signal that is constant before its start proves nothing.
        start = math.ceil(block.parameters.start_time / block.sample_time)
        yield from range(start, start + TICKS) if start < _FEW_TICKS else ()


def _flat(values: Any) -> Iterator[float]:
    for value in values:
        if isinstance(value, tuple):
            yield from value
        else:
            yield value


_STEPS: dict[str, Callable[[Any, int], Any]] = {
    'reference_generator': lambda block, tick: block.step(tick),
    'vcm_plant': lambda block, tick: block.step(tick, 1.0, 0.1) if tick else block.output(),
    'ldv_sensor': lambda block, tick: block.step(tick, 1.0, 1.0),
    'servo_sensor': lambda block, tick: block.step(tick, 1.0, 0.1),
    'accelerometer': lambda block, tick: block.step(tick, 1.0, 1.0, 1.0),
    DISTURBANCE_GENERATOR: lambda block, tick: block.step(tick),
}
"""A step of each block, with inputs of typical size."""


def attempt_for(
    node: str,
    sample_time: float,
    sets: Sets,
    block_of: Callable[[str], Any],
    *,
    make: Callable[[Any, float], Any] | None = None,
    is_change: bool,
) -> Attempt | None:
    """
    Return the attempt for a node in its run; None without a block.

    Parameters
    ----------
    node
        Name of the node in the catalog.
    sample_time
        T [s].
    sets
        Its parameters, of which the sensor scales of a controller are used.
    block_of
        Returns the block parameters of another node by name; None if it is not in the run.
    make
        Constructs a custom controller.
    is_change
        See :func:`attempt_block`.
    """
    row = NODES[node]
    if row.role != CONTROLLER:
        return attempt_block(node, sample_time, is_change=is_change) if row.block else None
    drive, vibrometer = block_of('vcm_plant'), block_of(SENSORS['ldv'])
    own: ControllerInputParameters = sets[ControllerInputParameters]
    has_servo = block_of(SENSORS['servo']) is not None
    if has_servo:
        scales = SensorScales.none()
    elif vibrometer is not None:
        scales = sensor_scales(own, vibrometer)
    else:
        scales = SensorScales(own.displacement_scale or 1.0, own.velocity_scale or 1.0)
    return ControllerTrial(
        node,
        make or resolve(row.block),
        sample_time,
        drive,
        scales,
        has_servo,
        block_of(BASE_SENSOR),
        is_custom=make is not None,
    ).attempt(is_change=is_change)


@dataclasses.dataclass(frozen=True)
class ControllerTrial:
    """
    The surroundings of a controller in a trial.

    Attributes
    ----------
    node
        Name of the node in the catalog.
    make
        Constructs the controller from its parameters and T [s].
    sample_time
        Sample time T [s].
    drive
        Parameters of the drive; None if it is unknown.
    scales
        Scales of the sensor outputs.
    has_observer
        Whether an observer provides the velocity.
    accelerometer
        Parameters of the accelerometers; None without accelerometers, so that the feedforward is not tried.
    is_custom
        Whether it is a custom controller, which is stepped only with zeros.
    """

    node: str
    make: Callable[[Any, float], Controller]
    sample_time: float
    drive: PlantParameters | None = None
    scales: SensorScales = SensorScales(1.0, 1.0)  # noqa: RUF009 - a frozen value
    has_observer: bool = False
    accelerometer: AccelerometerParameters | None = None
    is_custom: bool = False

    def attempt(self, *, is_change: bool) -> Attempt:
        """Return the attempt: construct and step controller and DSP, and the blocks around the controller."""

        def attempt(sets: Sets) -> None:
            numbers = list(self._outputs(sets, is_change))
            if is_change and not all(map(math.isfinite, numbers)):
                raise NotFiniteInTrialError

        return attempt

    def _outputs(self, sets: Sets, is_change: bool) -> Iterator[float]:
        law = self._law(sets, is_updated=is_change and self.is_custom)
        limit = math.inf if self.drive is None else self.drive.control_limit
        dsp = Dsp(sets[ControllerOutputParameters].dsp, self.sample_time, limit)
        if isinstance(law, KnowsOutputLimit):
            law.limit_output(dsp.limit)
        observer = self._observer(sets)
        seek, feedforward, runout = self._seek(sets), self._feedforward(sets), self._runout(sets)
        held = 0.0
        for tick in range(TICKS):
            volts = (-1.0) ** tick * (not self.is_custom)
            velocity = volts if observer is None else observer.step(volts, held)[1]
            inputs = self.scales.inputs(tick, volts, velocity, *NO_INPUTS[-3:])
            if seek is not None:
                inputs = seek.before_law(inputs, held)
            output = law.step(inputs)
            error = inputs.position - inputs.desired_position
            if seek is not None:
                output = seek.after_law(*output)
            if feedforward is not None:
                output = feedforward.compensate(error, volts, -volts, *output)
            if runout is not None:
                output = runout.compensate(tick, error, *output)
            held, *others = dsp.step(*output)
            yield from (held, *others)

    def _law(self, sets: Sets, *, is_updated: bool = False) -> Controller:
        parameters = sets[NODES[self.node].block_parameters]
        law: Any = self.make(parameters, self.sample_time)
        if is_updated:
            # A custom controller may not support a parameter change.
            law.update(parameters)
        made: Controller = law
        return made

    def _observer(self, sets: Sets) -> Observer | None:
        return Observer(sets[ControllerObserverParameters].observer, self.sample_time) if self.has_observer else None

    def _seek(self, sets: Sets) -> Seek | None:
        parameters = sets[seek_kind(self.node)].seek
        if self.drive is not None:
            reject_other_units('seek.method', parameters, self.drive)
        if not parameters.is_used:
            return None
        from hdd_servo_ros.analysis.seek_surroundings import seek_surroundings

        limit = math.inf if self.drive is None else self.drive.control_limit
        dsp = Dsp(sets[ControllerOutputParameters].dsp, self.sample_time, limit)
        surroundings = seek_surroundings(parameters, lambda: self._law(sets), self.sample_time, dsp, self.scales, None)
        return Seek(parameters, self.sample_time, surroundings, self.scales)

    def _runout(self, sets: Sets) -> RunoutCancellation | None:
        parameters = sets[ControllerRunoutParameters].runout
        if self.drive is not None:
            reject_other_units('runout.method', parameters, self.drive)
        if not parameters.is_used:
            return None
        from hdd_servo_ros.analysis.feedforward_path import runout_path

        path = runout_path(
            parameters,
            self._law(sets),
            sets[ControllerOutputParameters].dsp,
            self.sample_time,
            self.scales,
            self._observer(sets),
        )
        return RunoutCancellation(parameters, self.sample_time, path)

    def _feedforward(self, sets: Sets) -> Feedforward | None:
        parameters = sets[ControllerFeedforwardParameters].feedforward
        if self.drive is not None:
            reject_other_units('feedforward.method', parameters, self.drive)
        if not parameters.is_used or self.accelerometer is None:
            return None
        from hdd_servo_ros.analysis.feedforward_path import feedforward_knowledge

        knowledge = feedforward_knowledge(
            parameters,
            self._law(sets),
            sets[ControllerOutputParameters].dsp,
            self.accelerometer,
            self.sample_time,
            self.scales,
            self._observer(sets),
        )
        return Feedforward(parameters, self.sample_time, *knowledge)
