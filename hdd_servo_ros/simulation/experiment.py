"""One experiment: reference, drive, vibrometer and controller, run tick by tick without middleware."""

import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.analysis import fragility
from hdd_servo_ros.bench.dsp import ControllerInputParameters, ControllerOutputParameters, Dsp, DspParameters
from hdd_servo_ros.bench.ldv import Ldv
from hdd_servo_ros.control.controller import Controller, KnowsOutputLimit
from hdd_servo_ros.drive.plant import Plant
from hdd_servo_ros.graph.block_parameters import block_parameters, dsp_parameters, input_parameters, sensor_scales
from hdd_servo_ros.graph.catalogue import CONTROLLERS as CONTROLLER_NODES
from hdd_servo_ros.graph.catalogue import NODES, resolve
from hdd_servo_ros.graph.controller_loader import load_controller, refuse_former_object
from hdd_servo_ros.graph.roles import DISTURBANCE_GENERATOR
from hdd_servo_ros.messages.signals import SignalRows
from hdd_servo_ros.messages.topics import DISTURBANCE, SIGNAL_TOPICS
from hdd_servo_ros.messages.units import Units
from hdd_servo_ros.parameters import ParameterError
from hdd_servo_ros.signals.reference import Reference
from hdd_servo_ros.simulation.closed_loop import Controllers, closed_loop
from hdd_servo_ros.simulation.disturbance import DisturbanceSource


@functools.cache
def _arrays_of_default(node: str) -> tuple[NDArray[np.float64], ...]:
    """Return the arrays of a controller that does not run: the kernel wants them of the right kind, and leaves them."""
    row = NODES[node]
    arrays: tuple[NDArray[np.float64], ...] = resolve(row.block)(row.block_parameters(), 1e-4).arrays
    return arrays


class Experiment:
    """
    The closed loop of one reference, drive, vibrometer and controller.

    Parameters
    ----------
    sample_time
        T [s].
    controller
        ``'adaptive_nn'``, ``'pid'``, ``'open_loop'`` or ``'signal_analyzer'``; the name or import path of one from
        outside, as :func:`~hdd_servo_ros.graph.controller_loader.load_controller` takes it; or any object that
        satisfies :class:`~hdd_servo_ros.control.controller.Controller`. The
        latter two are called from Python, tick by tick.
    parameters
        For each node with a block, its parameters under dotted names; what is not named keeps its default.
        Sections of other nodes are passed over. A section of ``disturbance_generator`` adds that source.
    dsp
        What lies between a controller that is given as an object and the drive; a named one has it in its section.
    disturbance
        What disturbs the drive from outside; None for the ``disturbance_generator`` if it has a section, else nothing.

    Raises
    ------
    ParameterError
        If a value is refused or a name unknown; the name is preceded by its node's. If the ``step`` of a controller
        given as an object takes six arguments, as it once did. If ``disturbance`` and a ``disturbance_generator`` are
        both given.
    """

    def __init__(
        self,
        sample_time: float,
        controller: str | Controller = 'adaptive_nn',
        parameters: Mapping[str, Mapping[str, object]] | None = None,
        dsp: DspParameters | None = None,
        disturbance: DisturbanceSource | None = None,
    ) -> None:
        self.sample_time = sample_time
        self._blocks: dict[str, Any] = {}
        sections = parameters or {}
        self.reference: Reference = self._block('reference_generator', sections)
        self.plant: Plant = self._block('vcm_plant', sections)
        self.ldv: Ldv = self._block('ldv_sensor', sections)
        self._kind: int | None = None
        self.controller: Controller
        scales = ControllerInputParameters()
        if isinstance(controller, str) and controller in Controllers._fields:
            self._kind = Controllers._fields.index(controller)
            node = CONTROLLER_NODES[controller]
            self.controller = self._block(node, sections)
            dsp = dsp_parameters(node, sections.get(node, {}))
            scales = input_parameters(node, sections.get(node, {}))
        elif isinstance(controller, str):
            outside = load_controller(controller)
            own = sections.get(outside.node, {})
            parameters_of_law = block_parameters(outside.node, own)
            outside.trial(parameters_of_law, sample_time)
            self.controller = self._blocks[outside.node] = outside.make(parameters_of_law, sample_time)
            dsp = dsp_parameters(outside.node, own)
            scales = input_parameters(outside.node, own)
        else:
            refuse_former_object(controller)
            self.controller = controller
        self.dsp = Dsp(dsp or DspParameters(), sample_time, self.plant.parameters.control_limit)
        if isinstance(self.controller, KnowsOutputLimit):
            self.controller.limit_output(self.dsp.limit)
        self.scales = sensor_scales(scales, self.ldv.parameters)
        self._disturbance = disturbance
        if DISTURBANCE_GENERATOR in sections:
            if disturbance is not None:
                raise ParameterError('disturbance', disturbance, f'None with parameters of {DISTURBANCE_GENERATOR}')
            self._disturbance = self._block(DISTURBANCE_GENERATOR, sections)
        self._held: NDArray[np.float64] = np.zeros(2)
        self._next_tick = 0

    def _block(self, name: str, sections: Mapping[str, Mapping[str, object]]) -> Any:
        make = resolve(NODES[name].block)
        parameters = block_parameters(name, sections.get(name, {}))
        try:
            self._blocks[name] = make(parameters, self.sample_time)
        except ParameterError as error:
            raise ParameterError(f'{name}.{error.name}', error.value, error.allowed) from None
        return self._blocks[name]

    def check_change(self, node: str, sets: Mapping[type[Any], Any]) -> None:
        """Refuse parameters of a node that do not go with T: raises :class:`ParameterError`."""
        if node == DISTURBANCE_GENERATOR:
            self._blocks[node].check(sets[NODES[node].block_parameters])

    def update(self, node: str, sets: Mapping[type[Any], Any]) -> None:
        """Give the block of a node other parameters from the next tick on: all its sets; other nodes have none."""
        if node not in self._blocks:
            return
        self._blocks[node].update(sets[NODES[node].block_parameters])
        if ControllerOutputParameters in sets:
            self.dsp.update(sets[ControllerOutputParameters].dsp)
            if isinstance(self.controller, KnowsOutputLimit):
                self.controller.limit_output(self.dsp.limit)

    def warnings(self) -> tuple[str, ...]:
        """Return what a user should be told of the controller before a run."""
        return fragility.warnings(
            self.controller,
            fragility.LoopSurroundings(
                self.plant.parameters,
                self.sample_time,
                self.dsp.parameters.computation_delay,
                self.ldv.parameters,
                self.scales,
            ),
        )

    @property
    def is_compiled(self) -> bool:
        """Whether the loop is one compiled kernel, as it is with a controller of this package."""
        return self._kind is not None

    def compile(self) -> None:
        """Compile what :meth:`run` calls, where that was never done here, and change nothing."""
        if DISTURBANCE_GENERATOR in self._blocks:
            self._blocks[DISTURBANCE_GENERATOR].rows(self._next_tick, 0)
        if self.is_compiled:
            self.run(self._next_tick, 0)
            return
        Reference(self.reference.parameters, self.sample_time).step(0)
        plant = Plant(self.plant.parameters, self.sample_time)
        plant.output()
        plant.step(1, 0.0)
        Ldv(self.ldv.parameters, self.sample_time).step(0, 0.0, 0.0)
        Dsp(self.dsp.parameters, self.sample_time).step(0.0, 0.0, 0.0)

    def empty_rows(self, first_tick: int, count: int) -> SignalRows:
        """Return rows for ``count`` ticks of this experiment, to be filled by :meth:`run`."""
        optional = () if self._disturbance is None else self._disturbance.topics
        drive = self.plant.parameters
        units = Units(drive.length_unit, drive.control_unit)
        names = self.controller.estimate_names
        return SignalRows.empty(first_tick, count, self.sample_time, names, optional, units)

    def run(self, first_tick: int, count: int, rows: SignalRows | None = None) -> SignalRows:
        """
        Run ticks ``first_tick`` to ``first_tick + count - 1``.

        The ticks of one experiment start at 0 and follow each other; they may be run in pieces of any length.

        Parameters
        ----------
        first_tick, count
            Which ticks.
        rows
            Rows of an earlier call with the same count, to be written again instead of new memory.

        Raises
        ------
        ValueError
            If ``first_tick`` is not the one after the last, or the disturbance's rows have another shape than those of
            its topics.
        ControllerError
            If a controller from outside fails; ``rows``, if given, then hold the ticks before that one.
        """
        if first_tick != self._next_tick:
            raise ValueError(f'expected tick {self._next_tick}, got {first_tick}: the ticks of a run follow each other')
        self._next_tick += count
        rows = (
            self.empty_rows(first_tick, count) if rows is None or len(rows) != count else rows.starting_at(first_tick)
        )
        if self._disturbance is not None and count:
            made = self._disturbance.rows(first_tick, count)
            for topic, found in zip(self._disturbance.topics, made, strict=True):
                if np.shape(found) != rows[topic.name].shape:
                    raise ValueError(
                        f'/{topic.name}: the rows of ticks {first_tick} to {first_tick + count - 1} have shape '
                        f'{np.shape(found)}, not {rows[topic.name].shape}'
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
                self._controllers(),
                self.dsp.arrays,
                self._held,
                np.empty((len(rows), 2)),
                rows.kernel_arrays,
            )
        return rows

    def _controllers(self) -> Controllers:
        """Return the arrays of all built-in controllers, of which one runs."""
        controller: Any = self.controller
        arrays = (
            controller.arrays if kind == self._kind else _arrays_of_default(CONTROLLER_NODES[name])
            for kind, name in enumerate(Controllers._fields)
        )
        return Controllers._make(arrays)

    def _run_from_python(self, rows: SignalRows) -> None:
        signals = [rows[topic.name] for topic in SIGNAL_TOPICS if topic.name in rows]
        forces = rows.disturbance.force if DISTURBANCE.name in rows else np.zeros(len(rows))
        for row in range(len(rows)):
            tick = rows.first_tick + row
            reference = self.reference.step(tick)
            head = self.plant.output() if tick == 0 else self.plant.step(tick, *self._held.tolist())
            ldv = self.ldv.step(tick, head[0], head[1])
            control = self.dsp.step(*self.controller.step(self.scales.inputs(tick, *ldv, *reference)))
            self._held[:] = control[0], forces[row]
            rows.reference[row] = reference
            rows.head[row] = head
            rows.ldv[row] = (*ldv, 0.0)
            rows.control[row] = control
            rows['estimates'][row] = self.controller.estimates
            if not math.isfinite(sum(head) + sum(control)):
                # Nothing after it means anything, and the controller must not be asked what to make of it.
                for signal in signals:
                    signal[row + 1 :] = math.nan
                return
