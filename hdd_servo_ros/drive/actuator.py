"""
Voice-coil actuator and its drivers, thesis eqs. (3.1)-(3.18): physical parameters and derived constants.

Corrected misprints of the thesis: eq. (3.9) lacks the dots of theta''', theta'' and theta'. Eq. (3.15) is the product
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
    Voice-coil actuator and its driver.

    ``reduced`` is the identified double integrator k/s^2 of eq. (5.1): k is the plant's parameter ``gain``, and the
    parameters of this group are ignored. ``rigid`` is the reduced model of eqs. (3.16)-(3.18), whose gain
    k_t k_a l_arm/J follows from the parameters of this group. ``current`` and ``voltage`` add the electrical dynamics.
    The default values reproduce eq. (5.1) with a rigid or current driver. They are otherwise illustrative, because the
    thesis gives no values.

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
        'coil driver; reduced (uses the gain of the plant) and rigid have no electrical dynamics',
        choices=DRIVERS,
        equation='3.16',
    )
    flux_density: float = parameter(0.8, 'air-gap flux density B_g', unit='T', above=0.0, equation='3.1')
    coil_length: float = parameter(
        4.0, 'length l_coil of the coil wire in the air gap', unit='m', above=0.0, equation='3.1'
    )
    force_radius: float = parameter(
        0.025, 'distance d from the pivot to the center of force', unit='m', above=0.0, equation='3.1'
    )
    inertia: float = parameter(
        4.88185901e-06, 'moment of inertia J of the moving parts', unit='kg m^2', above=0.0, equation='3.4'
    )
    arm_length: float = parameter(
        0.05,
        'distance l_arm from the pivot to the head; not used by the reduced driver',
        unit='m',
        above=0.0,
        equation='3.17',
    )
    coil_resistance: float = parameter(8.0, 'coil resistance R_m', unit='ohm', above=0.0, equation='3.5')
    coil_inductance: float = parameter(1.0e-3, 'coil inductance L_m', unit='H', minimum=0.0, equation='3.5')
    back_emf_constant: float = parameter(
        0.08,
        'back-EMF constant k_b; ideally equal in SI units to the torque constant k_t = B_g l_coil d, and not above it',
        unit='V s/rad',
        minimum=0.0,
        equation='3.6',
    )
    source_resistance: float = parameter(
        2000.0, 'output resistance R_s of the current source', unit='ohm', above=0.0, equation='3.7'
    )
    amplifier_gain: float = parameter(
        0.05,
        'DC gain k_a of the amplifier: V/V for the voltage driver, A/V for the other drivers',
        above=0.0,
        equation='3.14',
    )
    amplifier_time_constant: float = parameter(
        5.0e-6, 'amplifier time constant tau_a', unit='s', minimum=0.0, equation='3.14'
    )
    units_per_meter: float = parameter(
        1.0e6, 'number of length units of the drive per meter (1e6 for um)', unit='1/m', above=0.0
    )

    def check_together(self) -> None:
        """Check that the coil does not return more power than it receives: k_b is at most k_t."""
        if self.is_electrical and self.back_emf_constant > 1.001 * self.torque_constant:
            raise ParameterError(
                'back_emf_constant',
                self.back_emf_constant,
                f'at most flux_density * coil_length * force_radius = {self.torque_constant:g} [V s/rad]',
            )

    @property
    def is_electrical(self) -> bool:
        """Whether the driver has electrical dynamics."""
        return self.driver in ('current', 'voltage')

    @property
    def torque_constant(self) -> float:
        """Return the torque constant k_t = B_g l_coil d of eq. (3.2) [N m/A]."""
        return self.flux_density * self.coil_length * self.force_radius

    @property
    def driver_resistance(self) -> float:
        """Return the resistance of the coil circuit [ohm]: R_m + R_s, or R_m with a voltage driver."""
        return self.coil_resistance + (0.0 if self.driver == 'voltage' else self.source_resistance)

    @property
    def current_ratio(self) -> float:
        """Return the DC ratio of coil to source current at rest, R_s/(R_m + R_s) (3.7); 1 with a voltage driver."""
        return 1.0 if self.driver == 'voltage' else self.source_resistance / self.driver_resistance

    @property
    def electrical_time_constant(self) -> float:
        """Return the electrical time constant tau_e = L_m/(R_m + R_s) of (3.13) [s]; L_m/R_m with a voltage driver."""
        return self.coil_inductance / self.driver_resistance

    @property
    def mechanical_time_constant(self) -> float:
        """Return the mechanical time constant tau_m = R_m J/(k_t k_b) of (3.13) [s]; infinite without back-EMF."""
        if self.back_emf_constant == 0.0:
            return math.inf
        return self.coil_resistance * self.inertia / (self.torque_constant * self.back_emf_constant)

    @property
    def acceleration_constant(self) -> float:
        """Return k_v = k_t k_a/J of (3.17) [rad/s^2/V], divided by the coil resistance with a voltage driver."""
        constant = self.torque_constant * self.amplifier_gain / self.inertia
        return constant / self.coil_resistance if self.driver == 'voltage' else constant

    @property
    def gain(self) -> float:
        """Return the head acceleration per volt, k_v l_arm, in the length unit of the drive [um/s^2/V]."""
        return self.acceleration_constant * self.arm_length * self.units_per_meter

    @property
    def back_emf_resistance(self) -> float:
        """Return the viscous damping due to the back-EMF, referred to the control signal [V s/um]."""
        radians = self.back_emf_constant / (self.arm_length * self.units_per_meter)
        if self.driver == 'voltage':
            return radians / self.amplifier_gain
        return radians / (self.driver_resistance * self.amplifier_gain)

    def position_gain(self, tracks_per_inch: float) -> float:
        """Return the position gain k_y = l_arm TPI/0.0254 of eq. (3.17) [tracks/rad]."""
        return self.arm_length * tracks_per_inch / METRES_PER_INCH


def torque_constant(flux_density: float, coil_length: float, force_radius: float) -> float:
    """Return the torque constant k_t = B_g l_coil d of eq. (3.2) [N m/A]."""
    return flux_density * coil_length * force_radius


def torque(torque_constant: float, current: float) -> float:
    """Return the actuator torque k_t I_m of eqs. (3.1), (3.3) [N m]."""
    return torque_constant * current


def angular_acceleration(torque: float, inertia: float) -> float:
    """Return the angular acceleration theta'' = tau/J of eq. (3.4) [rad/s^2]."""
    return torque / inertia


def coil_voltage(
    resistance: float, inductance: float, back_emf_constant: float, current: float, current_rate: float, speed: float
) -> float:
    """Return the coil voltage e = R_m I_m + L_m dI_m/dt + k_b theta' of eqs. (3.5), (3.6) [V]."""
    return resistance * current + inductance * current_rate + back_emf_constant * speed
