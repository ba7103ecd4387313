"""Parameters of the friction models."""

from dataclasses import dataclass

from hdd_servo_ros.parameters import ParameterError, ParameterSet, parameter

MODELS = ('none', 'lugre')
"""The friction models by name; a model's number in compiled code is its place in this list."""


@dataclass(frozen=True)
class FrictionParameters(ParameterSet):
    """
    Pivot friction; each model reads the parameters that its equation has.

    The default is the LuGre model calibrated to the low-frequency responses of figs. 2.3 and 5.4 (the thesis gives no
    friction parameters in volts and micrometres).
    """

    model: str = parameter('lugre', 'friction model', choices=MODELS)
    stiffness: float = parameter(
        0.02168, 'bristle stiffness sigma_0 of (2.20), stiffness sigma of Dahl (2.15)', unit='V/um', above=0.0
    )
    bristle_damping: float = parameter(2.3e-6, 'bristle damping sigma_1 of (2.20)', unit='V s/um', minimum=0.0)
    viscous_coefficient: float = parameter(
        4.6e-6, 'viscous friction: f_v of (2.4), sigma_2 of (2.20)', unit='V s/um', minimum=0.0
    )
    coulomb_level: float = parameter(0.13, 'Coulomb friction f_c', unit='V', above=0.0)
    static_level: float = parameter(0.16, 'static friction f_s, at least f_c', unit='V', above=0.0)
    stribeck_velocity: float = parameter(300.0, 'Stribeck velocity v_s', unit='um/s', above=0.0)

    def check_together(self) -> None:
        """Check that f_s is at least f_c."""
        if self.static_level < self.coulomb_level:
            raise ParameterError(
                'static_level', self.static_level, f'at least coulomb_level, which is {self.coulomb_level:g} [V]'
            )
