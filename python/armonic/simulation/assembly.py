"""A robot at a posture put together for the core: joints, motors, control, excitations, and where it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.closed_loop import ClosedLoop
from armonic.equilibrium import Rest, desired, settle
from armonic.errors import SimulationError
from armonic.linear import bushings_of, label_of
from armonic.simulation.control import is_number
from armonic.simulation.joints import JointTables, joint_tables

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.linear import Equilibrium, Posture
    from armonic.loads import Load
    from armonic.robot import Robot
    from armonic.simulation.excitations import Excitation
    from armonic.simulation.joints import JointLaw

    Array: TypeAlias = NDArray[np.float64]

FROM_THE_BEGINNING = -1.0


@dataclass(frozen=True, eq=False)
class Assembly:
    """A robot ready to be run.

    Attributes:
        robot: the robot.
        label: what its posture is called.
        q: the reference, all coordinates, (n_all,).
        moving: index of the n coordinates that move.
        loop: drives and control on them.
        rest: what the control holds.
        joints: springs and drags.
        plant: what the core runs.
        excitations: what acts from outside, without the constant wrench.
        constant: how many excitations of the plant stand before these (the wrench, or none).
    """

    robot: Robot
    label: str
    q: Array
    moving: NDArray[np.intp]
    loop: ClosedLoop
    rest: Rest
    joints: JointTables
    plant: _core.Plant
    excitations: tuple[Excitation, ...]
    constant: int

    @property
    def bodies(self) -> int:
        """Moving coordinates and motors, z."""
        return len(self.moving) + len(self.loop)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the moving coordinates, then of the motors."""
        return (*(self.robot.coordinates[i] for i in self.moving), *self.robot.drives.names)


def assemble(
    robot: Robot,
    posture: Posture,
    load: Load,
    *,
    excitations: Sequence[Excitation],
    joints: Sequence[JointLaw],
    duration_s: float,
    preloaded: bool,
) -> Assembly:
    """Puts a robot together.

    Args:
        robot: the robot.
        posture: which drives are told to hold, and in which springs are unloaded or preloaded.
        load: a constant wrench.
        excitations: what acts over time.
        joints: what is not linear in the joints.
        duration_s: how long the run will be.
        preloaded: whether coordinates without a drive carry gravity and load of the posture, so that they rest there.

    Raises:
        PostureError, SimulationError: something does not fit the robot.
    """
    q = robot.posture(posture)
    label = label_of(robot, posture, q)
    moving = np.flatnonzero(robot.flexible)
    if not moving.size:
        raise SimulationError(
            robot.name,
            found="no coordinate that moves",
            expected="at least one",
            hint="Give a joint an `elasticity` with stiffness and damping, or a `drive`.",
        )
    loop, rest = ClosedLoop.of(robot, moving), desired(robot, q, load)
    tables, bushings = joint_tables(robot, moving, joints), bushings_of(robot, q)
    deflection = np.array([_deflection(row, -t) for row, t in zip(tables.shafts, rest.motor_torque, strict=True)])
    drives = robot.drives
    rest = Rest(q, drives.scale * q[drives.coordinates] - deflection, rest.motor_torque)
    motors = np.column_stack(
        [loop.driven, drives.scale, tables.shafts, deflection, drives.inertia, tables.motor_drags]
    ).reshape(len(loop), 10)
    acting = tuple(excitations)
    constant = [] if load.frame is None else [_constant(load)]
    plant = _core.Plant(
        robot.mechanism,
        reference=q,
        moving=moving.tolist(),
        springs=tables.springs,
        drags=tables.drags,
        preload=_preload(robot, q, load, bushings, loop, moving) if preloaded else np.zeros(len(moving)),
        bushings=bushings,
        motors=motors,
        feedforward=rest.motor_torque,
        position=loop.position,
        velocity=loop.velocity,
        integral=loop.integral[loop.integrating],
        integrating=loop.integrating.tolist(),
        excitations=[*constant, *(e.on(robot, duration_s) for e in acting)],
    )
    return Assembly(robot, label, q, moving, loop, rest, tables, plant, acting, len(constant))


def rest_state(assembly: Assembly, load: Load, equilibrium: Equilibrium) -> Array:
    """The state y (states,) at rest where the equilibrium is.

    Args:
        assembly: the robot.
        load: its constant wrench.
        equilibrium: "reference" or "static", as in `linearize`.

    Raises:
        ModelError: there is no static equilibrium.
    """
    z = assembly.bodies
    y = np.zeros(assembly.plant.states)
    if equilibrium == "static":
        y[:z], integrators = _settled(assembly, load)
        y[2 * z : 2 * z + len(integrators)] = integrators
    return y


def set_in_motion(
    y: Array,
    names: Sequence[str],
    displacement: Mapping[str, float] | None,
    velocity: Mapping[str, float] | None,
) -> Array:
    """A state displaced and set in motion.

    Args:
        y: positions, then velocities of what is named, then anything, (states,).
        names: of coordinates and motors.
        displacement: by name, rad or m.
        velocity: by name, rad/s or m/s.

    Raises:
        SimulationError: there is no such name, or a number is not finite.
    """
    y = y.copy()
    for offset, what, given in ((0, "displacement", displacement), (len(names), "velocity", velocity)):
        for name, value in (given or {}).items():
            if name not in names:
                known = ", ".join(names)
                raise SimulationError(what, found=repr(name), expected=f"a coordinate or motor that moves: {known}")
            if not is_number(value):
                raise SimulationError(f"{what} of {name}", found=repr(value), expected="a finite number")
            y[offset + names.index(name)] += value
    return y


def _settled(assembly: Assembly, load: Load) -> tuple[Array, Array]:
    """Deviations (z,) and torques of the integrators at the static equilibrium."""
    robot, loop = assembly.robot, assembly.loop
    rest = settle(assembly.label, assembly.rest, load, bushings_of(robot, assembly.q), assembly.moving, loop)
    x = np.concatenate([(rest.q - assembly.q)[assembly.moving], rest.motor_position - assembly.rest.motor_position])
    if not assembly.joints.linear:
        x = _nonlinear_rest(assembly, x)
    deviation = assembly.rest.motor_torque - loop.position @ x - rest.motor_torque
    return x, deviation[loop.integrating]


def _nonlinear_rest(assembly: Assembly, x: Array) -> Array:
    from scipy.optimize import root

    if len(assembly.loop.integrating):
        raise SimulationError(
            "equilibrium",
            found='"static" with joints that are not linear and integral gains',
            expected='"reference"',
        )
    z, states = assembly.bodies, assembly.plant.states

    def accelerations(position: Array) -> Array:
        return assembly.plant.rates(0.0, np.concatenate([position, np.zeros(states - z)]), 0.0)[z : 2 * z]

    found = root(accelerations, x, tol=1e-12)
    size = np.abs(accelerations(np.zeros(z))).max() + 1.0
    if not np.abs(found.fun).max() < 1e-6 * size:
        raise SimulationError(assembly.label, found="no static equilibrium near it", expected="springs that carry it")
    return np.asarray(found.x, np.float64)


def _deflection(shaft: Array, torque: float) -> float:
    """Where a spring (stiffness, cubic term, gap) holds a torque: the least deflection at which it resists more too."""
    stiffness, cubic, gap = (float(v) for v in shaft)
    x = torque / stiffness
    if cubic and torque:
        roots = np.roots([cubic, 0.0, stiffness, -torque])
        real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
        holds = real[(real * torque > 0) & (stiffness + 3 * cubic * real**2 > 0)]
        x = float(holds[np.argmin(np.abs(holds))]) if holds.size else np.nan
        for _ in range(2):  # the last digits of a root of a polynomial
            x -= (x * (stiffness + cubic * x * x) - torque) / (stiffness + 3 * cubic * x * x)
    if not np.isfinite(x):
        raise SimulationError("Hardening", found="a spring too soft for the load", expected="one that carries gravity")
    return float(x + np.sign(x) * gap / 2)


def _constant(load: Load) -> tuple[int, list[float], bool, str, list[float], list[float]]:
    assert load.frame is not None  # the caller asks only for a load
    forever = [FROM_THE_BEGINNING, np.inf, 1.0]
    return load.frame, load.wrench.tolist(), load.axes == "frame", "constant", forever, []


def _preload(
    robot: Robot,
    q: Array,
    load: Load,
    bushings: Sequence[_core.Bushing],
    loop: ClosedLoop,
    moving: NDArray[np.intp],
) -> Array:
    """What holds the posture in coordinates without a drive, (n,)."""
    zero = np.zeros_like(q)
    forces = robot.mechanism.inverse_dynamics(q, zero, zero, wrenches=load.at(q))
    for bushing in bushings:
        forces = forces + bushing.force(robot.mechanism, q, zero)
    held = forces[moving]
    held[loop.driven] = 0.0
    return np.asarray(held, np.float64)
