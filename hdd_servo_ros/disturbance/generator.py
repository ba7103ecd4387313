"""Disturbance generator: runout, flutter, force noise, vibration and shock."""

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.disturbance.band import run_in_ticks, stationary_band
from hdd_servo_ros.disturbance.coupling import fill_coupling
from hdd_servo_ros.disturbance.flutter import flutter_modes, stationary_states
from hdd_servo_ros.disturbance.kernel import CONSTANTS, DisturbanceArrays, disturbance_rows, disturbance_step
from hdd_servo_ros.disturbance.parameters import DisturbanceParameters
from hdd_servo_ros.disturbance.recording import read_recording
from hdd_servo_ros.disturbance.runout import harmonics_of, read_sequence, sequence_of
from hdd_servo_ros.disturbance.shock import SHAPES, STANDARD_GRAVITY
from hdd_servo_ros.disturbance.streams import LINEAR_VIBRATION, ROTATIONAL_VIBRATION
from hdd_servo_ros.disturbance.vibration import VibrationParameters, fill_vibration, samples_of, sections_of
from hdd_servo_ros.messages.topics import BASE_ACCELERATION, DISTURBANCE, LoopTopic
from hdd_servo_ros.numerics.records import record, zeros

Vector = tuple[float, float, float]

_QUANTITIES = {'rotational': 'acceleration [rad/s^2]', 'linear': 'acceleration [m/s^2]'}
_STREAMS = {'rotational': ROTATIONAL_VIBRATION, 'linear': LINEAR_VIBRATION}


class _Band:
    """Filter of the random vibration of one axis; keeps its states while their number does not change."""

    def __init__(self, stream: int) -> None:
        self._stream = stream
        self._structure: tuple[int, int] | None = None
        self.states: NDArray[np.float64] = np.zeros((0, 2))

    def use(self, parameters: VibrationParameters, sections: NDArray[np.float64], sample_time: float) -> None:
        """Change the parameters; a filter whose number of states changes starts in the stationary state."""
        if parameters.is_random and parameters.structure != self._structure:
            ticks = run_in_ticks(*parameters.band, sample_time)
            self.states = stationary_band(sections, parameters.seed, self._stream + 1, ticks)
            self._structure = parameters.structure


class DisturbanceGenerator:
    """
    Generator of the disturbances on a drive in use, one value per tick.

    The base moves linearly along y, the direction of the head motion, and rotates about z, the pivot axis. Its effect
    on the head is a force against u; see :mod:`hdd_servo_ros.disturbance.coupling`.

    Parameters
    ----------
    parameters
        Parameters of the sources; the files they name are read once, in the constructor.
    sample_time
        T [s].

    Raises
    ------
    ParameterError
        If a file is invalid, or a source is incompatible with T: a frequency above half the sampling rate, or a
        sequence per sector where a revolution is not a whole number of samples.

    Notes
    -----
    Source: models of this package; ``docs/concepts/mobile-use.md`` and ``docs/controllers/runout-compensation.md`` list
    the values and the papers.

    Examples
    --------
    A half-sine shock of 10 g for 1 ms:

    >>> from hdd_servo_ros.disturbance import DisturbanceGenerator, DisturbanceParameters
    >>> from hdd_servo_ros.parameters import from_mapping
    >>> shock = {'shock.enabled': True, 'shock.linear_amplitude': 10.0, 'shock.duration': 0.001, 'shock.time': 0.001}
    >>> generator = DisturbanceGenerator(from_mapping(DisturbanceParameters, shock), sample_time=1e-4)
    >>> force, base = generator.rows(0, 30)
    >>> force.shape, base.shape
    ((30, 3), (30, 6))
    >>> round(float(base[:, 1].max()), 2)  # m/s^2, along y
    96.46
    """

    topics: tuple[LoopTopic, ...] = (DISTURBANCE, BASE_ACCELERATION)
    """Topics whose rows :meth:`rows` returns."""

    def __init__(self, parameters: DisturbanceParameters, sample_time: float) -> None:
        self.sample_time = sample_time
        axes = {axis: getattr(parameters.vibration, axis) for axis in _STREAMS}
        self._recorded_sequence = read_sequence(parameters.runout.repeatable)
        self._recordings = {
            axis: read_recording(f'vibration.{axis}.recording', own.recording, _QUANTITIES[axis])
            for axis, own in axes.items()
            if own.recording
        }
        self._bands = {axis: _Band(stream) for axis, stream in _STREAMS.items()}
        self._mode_states: NDArray[np.float64] | None = None
        self.update(parameters)

    def check(self, parameters: DisturbanceParameters) -> None:
        """Check that the parameters are compatible with T; raise :class:`ParameterError` otherwise."""
        self._sequence(parameters)
        for axis in _STREAMS:
            own: VibrationParameters = getattr(parameters.vibration, axis)
            own.check_rate(f'vibration.{axis}', self.sample_time)

    def _sequence(self, parameters: DisturbanceParameters) -> NDArray[np.float64]:
        repeatable = parameters.runout.repeatable
        return sequence_of(repeatable, parameters.spindle, self.sample_time, self._recorded_sequence)

    def update(self, parameters: DisturbanceParameters) -> None:
        """
        Change the parameters from the next tick on; filters keep their states if the number of states is the same.

        Raises
        ------
        ParameterError
            If :meth:`check` rejects the parameters; nothing is changed in that case.
        """
        self.check(parameters)
        sample_time = self.sample_time
        constants = zeros(CONSTANTS)
        c = record(constants, CONSTANTS)
        repeatable = parameters.runout.repeatable
        tables = {}
        for axis, stream in _STREAMS.items():
            own: VibrationParameters = getattr(parameters.vibration, axis)
            fill_vibration(getattr(c, axis), own, stream, sample_time)
            tables[axis] = (
                sections_of(own, sample_time),
                samples_of(own, self._recordings.get(axis), sample_time),
            )
        c.runout.is_enabled = float(repeatable.enabled)
        c.runout.turns_per_sample = parameters.spindle.turns_per_sample(sample_time)
        c.runout.samples_per_revolution = parameters.spindle.samples_per_revolution(sample_time)
        c.flutter.is_enabled = float(parameters.flutter.enabled)
        c.flutter.seed = parameters.flutter.seed
        c.force_noise.is_enabled = float(parameters.force_noise.enabled)
        c.force_noise.seed = parameters.force_noise.seed
        c.force_noise.sigma = parameters.force_noise.sigma_at(sample_time)
        shock = parameters.shock
        c.shock.is_enabled = float(shock.enabled)
        c.shock.pulse = SHAPES.index(shock.shape)
        c.shock.time_step = sample_time
        c.shock.time, c.shock.duration, c.shock.period = shock.time, shock.duration, shock.period
        c.shock.linear = shock.linear_amplitude * STANDARD_GRAVITY
        c.shock.rotational = shock.rotational_amplitude
        fill_coupling(c.coupling, parameters.coupling)
        modes = flutter_modes(parameters.flutter, sample_time)
        if self._mode_states is None or len(self._mode_states) != len(modes):
            self._mode_states = stationary_states(modes, parameters.flutter.seed)
        for axis, band in self._bands.items():
            band.use(getattr(parameters.vibration, axis), tables[axis][0], sample_time)
        self.parameters = parameters
        rotational, linear = self._bands['rotational'], self._bands['linear']
        self.arrays = DisturbanceArrays(
            constants,
            harmonics_of(repeatable),
            self._sequence(parameters),
            modes,
            self._mode_states,
            tables['rotational'][0],
            rotational.states,
            tables['rotational'][1],
            tables['linear'][0],
            linear.states,
            tables['linear'][1],
        )

    def step(self, tick: int) -> tuple[float, float, Vector, Vector]:
        """
        Return the disturbances held from a tick to the next tick; call it for consecutive ticks, starting at 0.

        Returns
        -------
        force, track_center
            Force against u [V], and displacement of the track center [um].
        linear, angular
            Linear [m/s^2] and angular [rad/s^2] acceleration of the base along and about x, y, z.
        """
        force, track_center, linear, angular = disturbance_step(tick, *self.arrays)
        return force, track_center, (0.0, linear, 0.0), (0.0, 0.0, angular)

    def rows(self, first_tick: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the disturbances for consecutive ticks, computed by the same compiled step as :meth:`step`.

        Returns
        -------
        disturbance, base_acceleration
            Rows of the topics: force, track center and 0, shape (count, 3); linear x, y, z and angular x, y, z, shape
            (count, 6).
        """
        disturbances, accelerations = np.zeros((count, 3)), np.zeros((count, 6))
        # A plain tuple, because numba cannot combine a named tuple with a tick.
        disturbance_rows(first_tick, tuple(self.arrays), disturbances, accelerations)
        return disturbances, accelerations
