"""
The voice-coil actuator and its drivers (3.1)-(3.18): physical parameters and what follows from them.

Dots that the print lost: (3.9) holds theta''', theta'' and theta'. (3.15) is the product
s (s tau_e + 1)(s tau_a + 1)(s tau_m + R_m/(R_m + R_s)), printed as a sum. J is the moment of inertia.
"""

import math
from dataclasses import dataclass

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

METRES_PER_INCH = 0.0254

DRIVERS = ('reduced', 'rigid', 'current', 'voltage')


@dataclass(frozen=True)
class ActuatorParameters(ParameterSet):
    """
    The actuator and its driver.

    ``reduced`` is k/s^2 as identified in (5.1): its gain is the plant's parameter ``gain`` and nothing here is read.
    ``rigid`` is the reduced model (3.16)-(3.18), whose gain k_t k_a l_arm/J follows from the data here; ``current`` and
    ``voltage`` add the electrical dynamics to it. The defaults give (5.1) with a rigid or current driver; they are
    illustrative otherwise, for the thesis prints none of them.

    Notes
    -----
    Source: thesis eqs. (3.1) to (3.18).

    Examples
    --------
    >>> from hdd_servo_ros.drive import ActuatorParameters
    >>> actuator = ActuatorParameters(driver='current', coil_resistance=10.0)
    >>> round(actuator.torque_constant, 6), round(actuator.gain)  # N m/A, um/s^2/V
    (0.08, 40968000)
    """

    driver: str = parameter(
        'reduced',
        "driver of the coil; reduced (the plant's gain) and rigid (3.16) have no electrical dynamics",
        choices=DRIVERS,
    )
    flux_density: float = parameter(0.8, 'flux density B_g of the gap (3.1)', unit='T', above=0.0)
    coil_length: float = parameter(4.0, 'length l_coil of wire in the gap (3.1)', unit='m', above=0.0)
    force_radius: float = parameter(
        0.025, 'distance d from the pivot to the center of the force (3.1)', unit='m', above=0.0
    )
    inertia: float = parameter(
        4.88185901e-06, 'moment of inertia J of the moving parts (3.4)', unit='kg m^2', above=0.0
    )
    arm_length: float = parameter(0.05, 'distance l_arm from the pivot to the head (3.17)', unit='m', above=0.0)
    coil_resistance: float = parameter(8.0, 'resistance R_m of the coil (3.5)', unit='ohm', above=0.0)
    coil_inductance: float = parameter(1.0e-3, 'inductance L_m of the coil (3.5)', unit='H', minimum=0.0)
    back_emf_constant: float = parameter(
        0.08, 'back-EMF constant k_b (3.6); k_t in SI units', unit='V s/rad', minimum=0.0
    )
    source_resistance: float = parameter(2000.0, 'resistance R_s of the current source (3.7)', unit='ohm', above=0.0)
    amplifier_gain: float = parameter(
        0.05, 'steady gain k_a of the amplifier (3.14): V/V of a voltage driver, A/V of the others', above=0.0
    )
    amplifier_time_constant: float = parameter(
        5.0e-6, 'time constant tau_a of the amplifier (3.14)', unit='s', minimum=0.0
    )
    units_per_meter: float = parameter(1.0e6, 'units of length of this drive in a meter', unit='1/m', above=0.0)

    def check_together(self) -> None:
        """Check that the coil does not give back more power than it takes."""
        if self.is_electrical and self.back_emf_constant > 1.001 * self.torque_constant:
            raise ParameterError(
                'back_emf_constant',
                self.back_emf_constant,
                f'at most flux_density coil_length force_radius = {self.torque_constant:g} [V s/rad]',
            )

    @property
    def is_electrical(self) -> bool:
        """Whether the driver has electrical dynamics."""
        return self.driver in ('current', 'voltage')

    @property
    def torque_constant(self) -> float:
        """Return k_t = B_g l_coil d of (3.2) [N m/A]."""
        return self.flux_density * self.coil_length * self.force_radius

    @property
    def driver_resistance(self) -> float:
        """Return the resistance of the coil's circuit [ohm]: R_m + R_s, or R_m on a voltage driver."""
        return self.coil_resistance + (0.0 if self.driver == 'voltage' else self.source_resistance)

    @property
    def current_ratio(self) -> float:
        """Return the steady coil current at rest over the source's: R_s/(R_m + R_s) (3.7), or 1 on a voltage driver."""
        return 1.0 if self.driver == 'voltage' else self.source_resistance / self.driver_resistance

    @property
    def electrical_time_constant(self) -> float:
        """Return tau_e = L_m/(R_m + R_s) of (3.13) [s]; L_m/R_m on a voltage driver."""
        return self.coil_inductance / self.driver_resistance

    @property
    def mechanical_time_constant(self) -> float:
        """Return tau_m = R_m J/(k_t k_b) of (3.13) [s]; infinite without back-EMF."""
        if self.back_emf_constant == 0.0:
            return math.inf
        return self.coil_resistance * self.inertia / (self.torque_constant * self.back_emf_constant)

    @property
    def acceleration_constant(self) -> float:
        """Return k_v = k_t k_a/J of (3.17) [rad/s^2/V]; on a voltage driver k_a is per ohm of the coil."""
        constant = self.torque_constant * self.amplifier_gain / self.inertia
        return constant / self.coil_resistance if self.driver == 'voltage' else constant

    @property
    def gain(self) -> float:
        """Return the acceleration of the head per volt, k_v l_arm in the drive's unit of length [um/s^2/V]."""
        return self.acceleration_constant * self.arm_length * self.units_per_meter

    @property
    def back_emf_resistance(self) -> float:
        """Return the resistance that the back-EMF adds to the motion, referred to the control signal [V s/um]."""
        radians = self.back_emf_constant / (self.arm_length * self.units_per_meter)
        if self.driver == 'voltage':
            return radians / self.amplifier_gain
        return radians / (self.driver_resistance * self.amplifier_gain)

    def position_gain(self, tracks_per_inch: float) -> float:
        """Return k_y = l_arm TPI/0.0254 of (3.17) [tracks/rad]."""
        return self.arm_length * tracks_per_inch / METRES_PER_INCH


def torque_constant(flux_density: float, coil_length: float, force_radius: float) -> float:
    """Return k_t = B_g l_coil d of (3.2) [N m/A]."""
    return flux_density * coil_length * force_radius


def torque(torque_constant: float, current: float) -> float:
    """Return k_t I_m of (3.1), (3.3) [N m]."""
    return torque_constant * current


def angular_acceleration(torque: float, inertia: float) -> float:
    """Return theta'' = tau/J of (3.4) [rad/s^2]."""
    return torque / inertia


def coil_voltage(
    resistance: float, inductance: float, back_emf_constant: float, current: float, current_rate: float, speed: float
) -> float:
    """Return e = R_m I_m + L_m dI_m/dt + k_b theta' of (3.5), (3.6) [V]."""
    return resistance * current + inductance * current_rate + back_emf_constant * speed
