"""
The linearized and sampled drive: a discrete state-space model, and its frequency response.

It is computed from the step of the plant by small changes of each state and of u, so that it includes everything that
the step computes.
"""

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdd_servo_ros.drive.friction.parameters import FrictionParameters
from hdd_servo_ros.drive.plant import PLANT_STATE, DisturbanceParameters, Plant, PlantParameters
from hdd_servo_ros.drive.travel import TravelParameters
from hdd_servo_ros.numerics.records import record

Array = NDArray[np.float64]

_INDEX = {name: field[1] // 8 for name, field in (PLANT_STATE.fields or {}).items()}
PREVIOUS = tuple(f'previous_{quarter}' for quarter in range(4))
_BODY = [_INDEX[name] for name in ('position', 'velocity', 'amplifier', 'coil', 'mean_friction', *PREVIOUS)]
"""Indices of the states of body, driver and contact in ``PLANT_STATE``."""

SPRING_MODELS = ('tangential_stiffness', 'complete', 'dahl', 'lugre', 'lugre_position', 'rbf_network')
"""Friction models with an elastic contact at rest; the others lock the body, or have no friction there."""
NOT_VISCOUS_MODELS = ('none', 'stiction', 'tangential_stiffness', 'coulomb', 'drag', 'dahl', 'rbf_network')
"""Friction models without damping in fast sliding or, with drag, in slow sliding."""
SMALL = 1e-7
"""
Change of a state for the linearization, relative to the breakaway deflection of the friction.

The nonlinearity of the contact changes a coefficient by about the same fraction, rounding by a hundredth of it.
"""


@dataclasses.dataclass(frozen=True)
class SampledDrive:
    """
    x_{k+1} = A x_k + B u_k, (position, velocity)_k = C x_k: the drive with hold and sampler, u_k held from tick k on.

    No further delay is included: as in the loop, u_k depends on the measurement of tick k and acts from then on.
    """

    a: Array
    b: Array
    c: Array
    sample_time: float
    mean_voltage: Array | None = None
    """Mean voltage of the sample over states and input, shape (1, n + 1); None if it is the input."""

    def mean_voltage_response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the mean voltage of the sample over the input at ``frequencies`` [Hz], shape (len(frequencies),)."""
        z = np.exp(2j * np.pi * np.asarray(frequencies) * self.sample_time)
        if self.mean_voltage is None:
            return np.ones_like(z)
        states = np.linalg.solve(z[:, None, None] * np.eye(len(self.a)) - self.a, self.b)
        return np.asarray((self.mean_voltage[:, :-1] @ states)[:, 0, 0] + self.mean_voltage[0, -1])

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return position [um/V] and velocity [um/s/V] over u at ``frequencies`` [Hz], shape (len(frequencies), 2)."""
        z = np.exp(2j * np.pi * np.asarray(frequencies) * self.sample_time)
        poles, residues = self._partial_fractions
        if residues is not None:
            return np.asarray((1.0 / (z[:, None] - poles)) @ residues.T)
        return np.asarray((self.c @ np.linalg.solve(z[:, None, None] * np.eye(len(self.a)) - self.a, self.b))[:, :, 0])

    @functools.cached_property
    def _partial_fractions(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128] | None]:
        """Return poles, and residues of shape (2, poles), or None if A has no full set of eigenvectors."""
        poles, vectors = np.linalg.eig(self.a)
        # A free body has a double pole at z = 1, a delay of n samples n poles at 0.
        if not np.linalg.cond(vectors) < 1e10:
            return poles, None
        return poles, (self.c @ vectors) * np.linalg.solve(vectors, self.b.astype(np.complex128))[:, 0]

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A."""
        return self._partial_fractions[0]


def has_presliding_spring(friction: FrictionParameters) -> bool:
    """
    Return whether the friction acts as a spring at rest.

    Otherwise the loop is linear only in sliding: at rest, static friction locks the body against any small u.
    """
    return friction.model in SPRING_MODELS


@functools.lru_cache(16)
def sampled_drive(plant: PlantParameters, sample_time: float, presliding: bool) -> SampledDrive:
    """
    Return the linearized drive with the integration of a run.

    The results for the last few drives are cached, for the runs of a campaign and the parts of a run.

    Parameters
    ----------
    plant
        The drive; its saturation, disturbance and initial state are ignored.
    sample_time
        Sample time T [s].
    presliding
        True: at rest, where the friction is a spring, as for the smallest motion. False: in sliding, where only the
        viscous part of the friction remains.

    Raises
    ------
    ValueError
        If ``presliding`` is true and the friction does not act as a spring at rest.
    """
    friction = plant.friction
    if presliding and not has_presliding_spring(friction):
        raise ValueError(f'friction model {friction.model} has no spring at rest; expected {", ".join(SPRING_MODELS)}')
    block = Plant(
        dataclasses.replace(
            plant,
            initial_position=0.0,
            initial_velocity=0.0,
            disturbance=DisturbanceParameters(),
            travel=TravelParameters(),
            friction=friction if presliding or not plant.resonance.has_rigid_body else sliding_friction(friction),
        ),
        sample_time,
    )
    return _linearized(block, _steps(plant, sample_time))


def sliding_friction(friction: FrictionParameters) -> FrictionParameters:
    """
    Return the viscous part of a friction, which remains in sliding.

    The Stribeck term vanishes in fast sliding; drag grows with speed and is smallest in slow sliding.
    """
    viscous = 0.0 if friction.model in NOT_VISCOUS_MODELS else friction.viscous_coefficient
    # LuGre with a contact that carries no load: a damper without a kink at rest, integrated as in the run.
    return FrictionParameters(
        model='lugre',
        stiffness=1e-200,
        bristle_damping=0.0,
        viscous_coefficient=viscous,
        coulomb_level=1.0,
        static_level=1.0,
    )


def _steps(plant: PlantParameters, sample_time: float) -> tuple[float, float, float]:
    """Return the changes of positions [um], velocities [um/s] and voltages [V] for the linearization."""
    friction = plant.friction
    breakaway = friction.coulomb_level / friction.stiffness
    if friction.model == 'rbf_network':
        breakaway = min(friction.position_width, sample_time * friction.velocity_width)
    position = SMALL * breakaway
    # A voltage that moves the body by about the same distance per sample, within the limits of the drive.
    voltage = min(position / (plant.rigid_gain * sample_time**2), 0.5 * plant.control_limit)
    return position, position / sample_time, voltage


def _linearized(plant: Plant, steps: tuple[float, float, float]) -> SampledDrive:
    """Return the derivatives of the step of the plant at rest, for the changes of :func:`_steps`."""
    position_step, velocity_step, voltage_step = steps
    rest = plant.state.copy()
    at_rest = record(rest, PLANT_STATE)
    # A network of contacts may hold a force at rest, which u and the driver balance.
    held = float(at_rest.friction)
    at_rest.mean_friction = at_rest.coil = held
    actuator = plant.parameters.actuator
    balance = at_rest.amplifier = held / actuator.current_ratio if actuator.is_electrical else held
    for name in PREVIOUS:
        at_rest[name] = balance
    kicks = []
    for names, step in (
        (('position', 'deflection'), position_step),
        (('velocity',), velocity_step),
        (('amplifier',), voltage_step),
        (('coil',), voltage_step),
        (('mean_friction',), voltage_step),
        *(((name,), voltage_step) for name in PREVIOUS),
    ):
        kick = np.zeros_like(rest)
        for name in names:
            kick[_INDEX[name]] = step
        kicks.append((kick, np.zeros_like(plant.motion), 0.0, step))
    # The modes are linear, so that the size of their change does not matter.
    for index in np.ndindex(plant.motion.shape):
        motion = np.zeros_like(plant.motion)
        motion[index] = 1.0
        kicks.append((np.zeros_like(rest), motion, 0.0, 1.0))
    kicks.append((np.zeros_like(rest), np.zeros_like(plant.motion), voltage_step, voltage_step))

    def after(state: Array, motion: Array, u: float) -> tuple[Array, Array]:
        """Return the outputs now, and the states one tick later."""
        plant.state[:], plant.motion[:] = state, motion
        now = np.array(plant.output()[:2])
        plant.step(1, u)
        # A record per state would take longer than the step.
        return now, np.concatenate([plant.state[_BODY], plant.motion.ravel()])

    columns, shown = [], []
    for kick, motion, voltage, step in kicks:
        above, below = (after(rest + s * kick, s * motion, balance + s * voltage) for s in (1.0, -1.0))
        shown.append((above[0] - below[0]) / (2.0 * step))
        columns.append((above[1] - below[1]) / (2.0 * step))
    matrix, c = np.array(columns).T, np.array(shown).T[:, :-1]
    return _reduced(SampledDrive(matrix[:, :-1], matrix[:, -1:], c, plant.sample_time))


def _reduced(drive: SampledDrive) -> SampledDrive:
    """Return a drive without the states that are not controllable or not observable."""
    linked = drive.a != 0.0
    reached, shown = (drive.b != 0.0).any(axis=1), (drive.c != 0.0).any(axis=0)
    for _ in range(len(linked)):
        reached = reached | linked[:, reached].any(axis=1)
        shown = shown | linked[shown].any(axis=0)
    kept = np.flatnonzero(reached & shown)
    return SampledDrive(drive.a[np.ix_(kept, kept)], drive.b[kept], drive.c[:, kept], drive.sample_time)
