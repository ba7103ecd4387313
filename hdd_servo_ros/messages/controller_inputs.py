"""What a controller gets at a tick."""

from typing import NamedTuple


class ControllerInputs(NamedTuple):
    """
    What a controller gets at tick k, by name; a topic that comes later adds a field and changes no controller.

    Lengths are in the drive's own unit (um unless its parameter file says otherwise).

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
    """Measured head position [um], the sensor's displacement output times the sensor's own scale."""
    velocity: float
    """Measured head velocity [um/s], the sensor's velocity output times the sensor's own scale; or the observer's."""
    displacement_volts: float
    """Displacement output of the sensor [V]; with the servo sensor, which has no voltages, the position [um]."""
    velocity_volts: float
    """Velocity output of the sensor [V]; with the servo sensor the velocity [um/s]."""
    desired_position: float
    """Reference x_d [um]."""
    desired_velocity: float
    """Its first derivative [um/s]."""
    desired_acceleration: float
    """Its second derivative [um/s^2]."""


NO_INPUTS = ControllerInputs(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Tick 0 with zeros: what a controller is tried with before a run."""


class SensorScales(NamedTuple):
    """How the outputs of a displacement and velocity sensor are scaled."""

    displacement: float
    """Head displacement per volt [um/V]."""
    velocity: float
    """Head velocity per volt [um/s/V]."""

    @classmethod
    def none(cls) -> 'SensorScales':
        """Return the scales of a sensor that gives position and velocity as they are."""
        return cls(1.0, 1.0)

    def inputs(
        self, tick: int, displacement_volts: float, velocity_volts: float, x_d: float, dx_d: float, ddx_d: float
    ) -> ControllerInputs:
        """Return what a controller gets for the sensor's outputs [V] and the reference [um, um/s, um/s^2] of a tick."""
        position, velocity = displacement_volts * self[0], velocity_volts * self[1]
        # What the class itself does to make one, without the call in between, which takes longer than the rest.
        return tuple.__new__(
            ControllerInputs, (tick, position, velocity, displacement_volts, velocity_volts, x_d, dx_d, ddx_d)
        )
