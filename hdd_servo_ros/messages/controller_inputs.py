"""Inputs of a controller at a tick."""

from typing import NamedTuple


class ControllerInputs(NamedTuple):
    """
    Inputs of a controller at tick k, by name; a future topic adds a field without changing controllers.

    Lengths are in the unit of the drive (um unless its parameter file sets another).

    Examples
    --------
    >>> from hdd_servo_ros.control import ControllerInputs
    >>> inputs = ControllerInputs(
    ...     tick=0,
    ...     position=0.1,
    ...     velocity=50.0,
    ...     displacement_volts=0.0125,
    ...     velocity_volts=0.002,
    ...     desired_position=0.0,
    ...     desired_velocity=0.0,
    ...     desired_acceleration=0.0,
    ... )
    >>> inputs.position - inputs.desired_position
    0.1
    """

    tick: int
    """Number k of the tick; its time is k T."""
    position: float
    """Measured head position [um]: displacement output of the sensor times its scale."""
    velocity: float
    """Measured head velocity [um/s]: velocity output of the sensor times its scale, or the observer's estimate."""
    displacement_volts: float
    """Displacement output of the sensor [V]; the position [um] with the servo sensor, which has no voltages."""
    velocity_volts: float
    """Velocity output of the sensor [V]; the velocity [um/s] with the servo sensor."""
    desired_position: float
    """Reference x_d [um]."""
    desired_velocity: float
    """Reference velocity dx_d/dt [um/s]."""
    desired_acceleration: float
    """Reference acceleration d2x_d/dt2 [um/s^2]."""


NO_INPUTS = ControllerInputs(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Tick 0 with zeros, for the trial step of a controller before a run."""


class SensorScales(NamedTuple):
    """Scale factors of a displacement and velocity sensor."""

    displacement: float
    """Head displacement per volt [um/V]."""
    velocity: float
    """Head velocity per volt [um/s/V]."""

    @classmethod
    def none(cls) -> 'SensorScales':
        """Return the scales of a sensor that outputs position and velocity directly."""
        return cls(1.0, 1.0)

    def inputs(
        self, tick: int, displacement_volts: float, velocity_volts: float, x_d: float, dx_d: float, ddx_d: float
    ) -> ControllerInputs:
        """Return the controller inputs for the sensor outputs [V] and the reference [um, um/s, um/s^2] of a tick."""
        position, velocity = displacement_volts * self[0], velocity_volts * self[1]
        # Bypasses the constructor of the class, whose call takes longer than the rest.
        return tuple.__new__(
            ControllerInputs, (tick, position, velocity, displacement_volts, velocity_volts, x_d, dx_d, ddx_d)
        )
