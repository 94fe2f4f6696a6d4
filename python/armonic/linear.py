"""Linear models: mass, damping and stiffness of a robot at a posture, at rest or moving."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic import _core
from armonic.closed_loop import ClosedLoop
from armonic.equilibrium import desired, settle
from armonic.errors import ModelError, PostureError
from armonic.loads import WrenchAxes, load_of, numbers

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.description.drives import Control, Drives
    from armonic.robot import Robot
    from armonic.state_space import StateSpace

    Array: TypeAlias = NDArray[np.float64]
    Posture: TypeAlias = str | Sequence[float] | NDArray[np.float64] | Mapping[str, float]

Equilibrium = Literal["reference", "static"]
"""Where a model is linearized: at the posture as given, or where the robot settles under gravity and wrench."""


@dataclass(frozen=True)
class LinearModel:
    """M δz̈ + C δż + K δz + G ∫δz = δτ in the coordinates that can deflect, z = [q; q_m].

    Huynh et al. 2021, Eq. 16; with drives the explicit closed loop of Do et al. 2022, Eqs. 8 to 12. Locked coordinates
    (those without elasticity or drive) have dropped out. Everything is SI and radians.

    Attributes:
        robot: the robot that was linearized.
        posture: name of the posture, or its numbers as text.
        q: all link coordinates of the operating point, (n_all,).
        coordinates: names of the N coordinates that are left: n of the links, then one per motor ("arm.motor").
        mass: M, (N, N), kg m² or kg; motors behind the gear.
        damping: C with dampers, gyroscopic terms and the control's gains of velocity, (N, N).
        stiffness: K with springs, shafts, gravity, wrench, bushings and the control's gains of position, (N, N).
        free_damping: C without the impedances below, (N, N).
        free_stiffness: K without the impedances below, (N, N): drives, control, gravity, wrench, motion and the load of
            bushings.
        impedances: names of the r spring-dampers, as paths into the description.
        directions: coordinate-space direction of each spring-damper, (r, N).
        spring: their stiffness, (r,).
        damper: their damping, (r,).
        loop: the drives and their control.
        motor_position: q_m of the operating point at rest, (nm,), rad behind the gear (Do et al. 2022, Eq. 3).
        motor_torque: τ_m there, (nm,), N m behind the gear (Eq. 2).
        loaded: bushings that carry load in this posture; part of their stiffness is in `free_stiffness`, since it comes
            from the load.
    """

    robot: Robot = field(repr=False)
    posture: str
    q: Array
    coordinates: tuple[str, ...]
    mass: Array
    damping: Array
    stiffness: Array
    free_damping: Array
    free_stiffness: Array
    impedances: tuple[str, ...]
    directions: Array
    spring: Array
    damper: Array
    loop: ClosedLoop = field(repr=False)
    motor_position: Array
    motor_torque: Array
    loaded: tuple[str, ...] = ()

    @property
    def links(self) -> int:
        """Number n of link coordinates; those of motors follow."""
        return len(self.coordinates) - len(self.loop)

    @property
    def drives(self) -> Drives:
        """The drives, one per motor."""
        return self.loop.drives

    @property
    def control(self) -> Control:
        """The gains of the drives."""
        return self.loop.control

    @property
    def local(self) -> bool:
        """Whether every motor listens to its own joint only; if not, there is no impedance form."""
        return self.loop.local

    @cached_property
    def integral(self) -> Array:
        """G, (N, N): force per integral of a deviation, so that Z(s) = s²M + sC + K + G/s. Zero without K_I."""
        G = np.zeros(self.mass.shape)
        if len(self.loop):
            G[self.links :] = self.loop.integral
        return G

    def jacobian(self, frame: str) -> Array:
        """Jacobian of a frame in the frame's own axes, (6, N): velocity x y z over angular velocity rx ry rz.

        Motors do not move the links by themselves: their columns are zero.

        Args:
            frame: name of a frame or link of the robot.

        Raises:
            PostureError: no such frame.
        """
        rows = self.robot.mechanism.jacobian(self.q, self.robot.frame_index(frame), own_axes=True)
        return self.loop.widened(rows[:, self.robot.flexible])

    def with_impedances(self, spring: Array, damper: Array) -> LinearModel:
        """The same posture with other stiffness (r,) and damping (r,) of the impedances."""
        B = self.directions
        return replace(
            self,
            spring=spring,
            damper=damper,
            stiffness=self.free_stiffness + B.T @ (spring[:, None] * B),
            damping=self.free_damping + B.T @ (damper[:, None] * B),
        )

    def state_matrix(self) -> Array:
        """A of ẋ = A x, (2N + p, 2N + p) (Do et al. 2022, Eq. 14).

        x = [δz; δż] and a torque I ∫δz (N m) for each of the p motors whose control integrates.
        """
        n, rows = len(self.coordinates), self.loop.integrating
        factor = self.mass_factor
        held = np.eye(n)[:, self.links + rows]
        lower = np.hstack([self.stiffness, self.damping, held])
        solved = np.linalg.solve(factor.T, np.linalg.solve(factor, lower))
        upper = np.hstack([np.zeros((n, n)), np.eye(n), np.zeros(held.shape)])
        integrators = np.hstack([self.loop.integral[rows], np.zeros((len(rows), n + len(rows)))])
        return np.vstack([upper, -solved, *([integrators] if len(rows) else [])])

    def state_space(
        self,
        *,
        frame: str,
        inputs: Iterable[str] = ("x", "y", "z"),
        outputs: Iterable[str] = ("x", "y", "z"),
        motors: bool = True,
    ) -> StateSpace:
        """The model as ẋ = A x + B u, y = C x + D u, for MATLAB and python-control.

        Args:
            frame: where forces act and displacements are taken, in its own axes.
            inputs: force (x y z) and moment (rx ry rz) axes.
            outputs: displacement and rotation axes.
            motors: whether motor torques are inputs and motor positions outputs as well.

        Raises:
            PostureError: no such frame.
            FrfError: no such axis.
            ModelError: no positive definite mass matrix.
        """
        from armonic.state_space import state_space

        return state_space(self, frame=frame, inputs=tuple(inputs), outputs=tuple(outputs), motors=motors)

    @cached_property
    def mass_factor(self) -> Array:
        """Lower Cholesky factor L of M = L Lᵀ, (N, N).

        Raises:
            ModelError: M is not positive definite.
        """
        try:
            return np.asarray(np.linalg.cholesky(self.mass), np.float64)
        except np.linalg.LinAlgError:
            raise ModelError(
                f"{self.robot.name}, posture {self.posture}",
                found="a mass matrix that is not positive definite",
                expected="mass behind every coordinate",
                hint="Run `armonic check` on the robot file: a link at the end of the tree may lack its inertia.",
            ) from None


def linearize(
    robot: Robot,
    posture: Posture,
    *,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    wrench: ArrayLike | None = None,
    frame: str | None = None,
    wrench_axes: WrenchAxes = "world",
    equilibrium: Equilibrium = "reference",
) -> LinearModel:
    """Linearizes a robot about an operating point by analytic derivatives.

    M, C = ∂f/∂q̇ and K = ∂f/∂q of f(q, q̇, q̈) = M q̈ + b + g − Jᵀ w + springs and dampers (Huynh et al. 2021, Eqs. 14
    to 17; Do et al. 2022, Eqs. 8 to 12). The joint springs are unloaded in `posture`, which drives are told to hold.

    Args:
        robot: the robot.
        posture: a posture's name, or the joint coordinates (rad, m).
        velocity: coordinate velocities, one per joint or per coordinate; at rest if not given.
        acceleration: coordinate accelerations, likewise.
        wrench: force (N) over moment (N m) on the robot at the origin of `frame`, constant in `wrench_axes`, (6,).
        frame: where the wrench acts.
        wrench_axes: "world", or "frame" for a wrench in the axes of `frame` that turns with it.
        equilibrium: "reference" linearizes at `posture` itself, as the papers do; "static" where the robot comes to
            rest when gravity and the wrench load springs, shafts and control (Newton's method). Of a robot on drives
            with feed-forward that is the posture.

    Raises:
        PostureError: posture, velocity, acceleration, wrench or frame do not fit the robot.
        ModelError: every coordinate is locked, or there is no stable static equilibrium.
    """
    q = robot.posture(posture)
    label = label_of(robot, posture, q)
    rates = _rates(robot, "velocity", velocity), _rates(robot, "acceleration", acceleration)
    keep = np.flatnonzero(robot.flexible)
    if keep.size == 0:
        raise ModelError(
            robot.name,
            found="no coordinate with elasticity",
            expected="at least one",
            hint="Give a joint an `elasticity` with stiffness and damping, or a `drive`.",
        )
    load = load_of(robot, wrench, frame, wrench_axes)
    bushings, loop = bushings_of(robot, q), ClosedLoop.of(robot, keep)
    rest = desired(robot, q, load)
    if equilibrium == "static":
        rest = settle(label, rest, load, bushings, keep, loop)
        q = rest.q
    elif equilibrium != "reference":
        raise PostureError("equilibrium", found=repr(equilibrium), expected='"reference" or "static"')
    tangent = robot.mechanism.linearize(q, rates[0], rates[1], wrenches=load.at(q), bushings=bushings)
    turning = load.turning_stiffness(q)
    if turning is not None:
        tangent[2] += turning
    mass, damping, stiffness = tangent[:, keep[:, None], keep]
    _refuse_impossible(robot, label, mass, tangent)
    impedances, directions, spring, damper, in_tangent = _impedances(robot, q, bushings, keep)
    # The tangent holds the bushings whole; those of their springs that stand in the list are taken out again.
    held = directions[in_tangent]
    free_stiffness = _without(stiffness, held, spring[in_tangent])
    free_damping = _without(damping, held, damper[in_tangent])
    mass, free_damping, free_stiffness = loop.explicit(mass, free_damping, free_stiffness)
    return LinearModel(
        robot=robot,
        posture=label,
        q=q,
        coordinates=(*(robot.coordinates[i] for i in keep), *robot.drives.names),
        mass=mass,
        damping=free_damping,
        stiffness=free_stiffness,
        free_damping=free_damping,
        free_stiffness=free_stiffness,
        impedances=impedances,
        directions=loop.widened(directions),
        spring=spring,
        damper=damper,
        loop=loop,
        motor_position=rest.motor_position,
        motor_torque=rest.motor_torque,
        loaded=_loaded(robot, q, bushings),
    ).with_impedances(spring, damper)


def _refuse_impossible(robot: Robot, label: str, mass: Array, tangent: Array) -> None:
    where = f"{robot.name}, posture {label}"
    if not np.isfinite(tangent).all():
        raise ModelError(where, found="numbers too large to compute with", expected="loads and speeds of this world")
    size = np.sqrt(np.maximum(np.diag(mass), 0.0))
    seen = size > 0
    inertia = np.linalg.eigvalsh(mass[np.ix_(seen, seen)] / np.outer(size[seen], size[seen]))
    if (np.diag(mass) < 0).any() or inertia.min(initial=0.0) < -1e-9:
        raise ModelError(
            where,
            found="a mass matrix with a negative direction",
            expected="inertia that some real body has",
            hint="Run `armonic check` on the robot file.",
        )


def model_of(
    robot: Robot | LinearModel,
    posture: Posture | None,
    *,
    wrench: ArrayLike | None,
    frame: str | None,
    equilibrium: Equilibrium,
    wrench_axes: WrenchAxes = "world",
) -> LinearModel:
    """A robot linearized at a posture, or a linear model as it is.

    No posture means the only one that the robot names, or all coordinates zero if it names none.

    Raises:
        PostureError: as `linearize`; or a linear model comes with a posture, wrench or equilibrium of its own.
        ModelError: as `linearize`.
    """
    if not isinstance(robot, LinearModel):
        if posture is None and len(robot.postures) > 1:
            raise PostureError("posture", found="none", expected=f"one of {', '.join(robot.postures)}")
        where = posture if posture is not None else next(iter(robot.postures), {})
        return linearize(robot, where, wrench=wrench, frame=frame, wrench_axes=wrench_axes, equilibrium=equilibrium)
    if posture is not None or wrench is not None or equilibrium != "reference":
        raise PostureError(
            "posture",
            found="a posture, wrench or equilibrium beside a linear model",
            expected="the model alone",
            hint="Give them to `linearize`, which made the model.",
        )
    return robot


def _rates(robot: Robot, where: str, values: ArrayLike | None) -> Array:
    """Velocities or accelerations of all coordinates, from those of the joints or of all."""
    rates = np.zeros(len(robot.coordinates))
    if values is None:
        return rates
    lengths = len(robot.joint_coordinates), len(rates)
    given = numbers(
        where, values, lengths, f"{lengths[0]} finite numbers, one per joint, or {lengths[1]}, one per coordinate"
    )
    if given.size == len(rates):
        return given
    rates[[robot.coordinates.index(name) for name in robot.joint_coordinates]] = given
    return rates


def label_of(robot: Robot, posture: Posture, q: Array) -> str:
    """The name of a posture; of one without, its joint coordinates, and the virtual ones that are not zero."""
    if isinstance(posture, str):
        return posture
    shown = [i for i, name in enumerate(robot.coordinates) if name in robot.joint_coordinates or q[i] != 0]
    return ", ".join(f"{robot.coordinates[i]} = {q[i]:.4g}" for i in shown)


def bushings_of(robot: Robot, q: Array) -> list[_core.Bushing]:
    """The bushings of a robot for the core; those without a rest of their own are unloaded at q."""
    return [
        _core.Bushing(
            robot.mechanism,
            robot.frame_index(bushing.frame_a),
            robot.frame_index(bushing.frame_b),
            stiffness=bushing.stiffness,
            damping=bushing.damping,
            rest=q if bushing.rest is None else bushing.rest,
        )
        for bushing in robot.bushings
    ]


def _loaded(robot: Robot, q: Array, bushings: list[_core.Bushing]) -> tuple[str, ...]:
    """Names of the bushings whose force is more than rounding leaves of a deformation of nothing."""
    forces = [core.force(robot.mechanism, q, np.zeros_like(q)) for core in bushings]
    pairs = zip(robot.bushings, forces, strict=True)
    return tuple(b.name for b, force in pairs if np.abs(force).max(initial=0.0) > 1e-12 * np.abs(b.stiffness).max())


BUSHING_AXES = ("x", "y", "z", "rx", "ry", "rz")


def _impedances(
    robot: Robot, q: Array, bushings: list[_core.Bushing], keep: NDArray[np.intp]
) -> tuple[tuple[str, ...], Array, Array, Array, NDArray[np.bool_]]:
    """Every spring-damper by name, direction, stiffness and damping; the last flag marks those of bushings."""
    sprung = [i for i in keep if robot.stiffness[i] > 0]
    names = ["links.{}.elasticity.{}".format(*robot.coordinates[i].rsplit(".", 1)) for i in sprung]
    rows = [np.eye(len(robot.coordinates))[sprung][:, keep]]
    spring, damper = [robot.stiffness[sprung]], [robot.damping[sprung]]
    for bushing, core in zip(robot.bushings, bushings, strict=True):
        names += [f"bushings.{bushing.name}.{axis}" for axis in BUSHING_AXES]
        rows.append(core.directions(robot.mechanism, q)[:, keep])
        spring.append(np.diag(bushing.stiffness))
        damper.append(np.diag(bushing.damping))
    in_tangent = np.arange(len(names)) >= len(sprung)
    return tuple(names), np.vstack(rows), np.concatenate(spring), np.concatenate(damper), in_tangent


def _without(matrix: Array, directions: Array, values: Array) -> Array:
    """A tangent less some of its springs or dampers, symmetric if it was (the core is faster then)."""
    if not len(directions):
        return matrix
    rest = matrix - directions.T @ (values[:, None] * directions)
    odd = np.abs(matrix - matrix.T).max()
    return (rest + rest.T) / 2 if odd <= 1e-13 * np.abs(matrix).max() else rest
