"""Linear models: mass, damping and stiffness of a robot at a posture, at rest or moving."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import ModelError, PostureError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Posture: TypeAlias = str | Sequence[float] | NDArray[np.float64] | Mapping[str, float]

Equilibrium = Literal["reference", "static"]
"""Where a model is linearized: at the posture as given, or where the robot settles under gravity and wrench."""

NEWTON_STEPS = 50


@dataclass(frozen=True)
class LinearModel:
    """M δq̈ + C δq̇ + K δq = δτ in the coordinates that can deflect (Huynh et al. 2021, Eq. 16).

    Locked coordinates (those without elasticity) have dropped out. Everything is SI and radians.

    Attributes:
        robot: the robot that was linearized.
        posture: name of the posture, or its numbers as text.
        q: all coordinates of the operating point, (n_all,).
        coordinates: names of the n coordinates that are left.
        mass: M, (n, n), kg m² or kg.
        damping: C with joint dampers and gyroscopic terms, (n, n).
        stiffness: K with joint springs, gravity, wrench and bushings, (n, n).
        free_damping: C without the impedances below, (n, n).
        free_stiffness: K without the impedances below, (n, n): gravity, wrench, motion and the load of bushings.
        impedances: names of the r spring-dampers, as paths into the description.
        directions: coordinate-space direction of each spring-damper, (r, n).
        spring: their stiffness, (r,).
        damper: their damping, (r,).
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
    loaded: tuple[str, ...] = ()

    def jacobian(self, frame: str) -> Array:
        """Jacobian of a frame in the frame's own axes, (6, n): velocity x y z over angular velocity rx ry rz.

        Args:
            frame: name of a frame or link of the robot.

        Raises:
            PostureError: no such frame.
        """
        rows = self.robot.mechanism.jacobian(self.q, self.robot.frame_index(frame), own_axes=True)
        return rows[:, self.robot.flexible]

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
        """A of ẋ = A x with x = [δq; δq̇], (2n, 2n) (Do et al. 2022, Eq. 14)."""
        n = len(self.coordinates)
        factor = self.mass_factor
        lower = np.hstack([self.stiffness, self.damping])
        solved = np.linalg.solve(factor.T, np.linalg.solve(factor, lower))
        return np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), -solved])

    @cached_property
    def mass_factor(self) -> Array:
        """Lower Cholesky factor L of M = L Lᵀ, (n, n).

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
    equilibrium: Equilibrium = "reference",
) -> LinearModel:
    """Linearizes a robot about an operating point by analytic derivatives.

    M, C = ∂f/∂q̇ and K = ∂f/∂q of f(q, q̇, q̈) = M q̈ + b + g − Jᵀ w + springs and dampers (Huynh et al. 2021, Eqs. 14
    to 17; Do et al. 2022, Eq. 12). The joint springs are unloaded in `posture`.

    Args:
        robot: the robot.
        posture: a posture's name, or the joint coordinates (rad, m).
        velocity: coordinate velocities, one per joint or per coordinate; at rest if not given.
        acceleration: coordinate accelerations, likewise.
        wrench: force (N) over moment (N m) on the robot at the origin of `frame`, constant in world axes, (6,).
        frame: where the wrench acts.
        equilibrium: "reference" linearizes at `posture` itself, as the paper does; "static" where the robot comes to
            rest when gravity and the wrench load the springs (Newton's method).

    Raises:
        PostureError: posture, velocity, acceleration, wrench or frame do not fit the robot.
        ModelError: every coordinate is locked, or there is no stable static equilibrium.
    """
    q = robot.posture(posture)
    label = posture if isinstance(posture, str) else _label(robot, q)
    rates = _rates(robot, "velocity", velocity), _rates(robot, "acceleration", acceleration)
    keep = np.flatnonzero(robot.flexible)
    if keep.size == 0:
        raise ModelError(
            robot.name,
            found="no coordinate with elasticity",
            expected="at least one",
            hint="Give a joint an `elasticity` with stiffness and damping.",
        )
    wrenches = _wrenches(robot, wrench, frame)
    bushings = _bushings(robot, q)
    if equilibrium == "static":
        q = _settle(robot, label, q, wrenches, bushings, keep)
    elif equilibrium != "reference":
        raise PostureError("equilibrium", found=repr(equilibrium), expected='"reference" or "static"')
    tangent = robot.mechanism.linearize(q, rates[0], rates[1], wrenches=wrenches, bushings=bushings)
    mass, damping, stiffness = tangent[:, keep[:, None], keep]
    _refuse_impossible(robot, label, mass, tangent)
    impedances, directions, spring, damper, in_tangent = _impedances(robot, q, bushings, keep)
    # The tangent holds the bushings whole; those of their springs that stand in the list are taken out again.
    held = directions[in_tangent]
    free_stiffness = _without(stiffness, held, spring[in_tangent])
    free_damping = _without(damping, held, damper[in_tangent])
    return LinearModel(
        robot=robot,
        posture=label,
        q=q,
        coordinates=tuple(robot.coordinates[i] for i in keep),
        mass=mass,
        damping=free_damping,
        stiffness=free_stiffness,
        free_damping=free_damping,
        free_stiffness=free_stiffness,
        impedances=impedances,
        directions=directions,
        spring=spring,
        damper=damper,
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
        return linearize(robot, where, wrench=wrench, frame=frame, equilibrium=equilibrium)
    if posture is not None or wrench is not None or equilibrium != "reference":
        raise PostureError(
            "posture",
            found="a posture, wrench or equilibrium beside a linear model",
            expected="the model alone",
            hint="Give them to `linearize`, which made the model.",
        )
    return robot


def _numbers(where: str, values: ArrayLike, lengths: tuple[int, ...], expected: str) -> Array:
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.ndim != 1 or array.size not in lengths or not np.isfinite(array).all():
        raise PostureError(where, found=f"{values!r:.60}", expected=expected)
    return array


def _rates(robot: Robot, where: str, values: ArrayLike | None) -> Array:
    """Velocities or accelerations of all coordinates, from those of the joints or of all."""
    rates = np.zeros(len(robot.coordinates))
    if values is None:
        return rates
    lengths = len(robot.joint_coordinates), len(rates)
    given = _numbers(
        where, values, lengths, f"{lengths[0]} finite numbers, one per joint, or {lengths[1]}, one per coordinate"
    )
    if given.size == len(rates):
        return given
    rates[[robot.coordinates.index(name) for name in robot.joint_coordinates]] = given
    return rates


def _label(robot: Robot, q: Array) -> str:
    """A posture without a name: its joint coordinates, and of the virtual ones those that are not zero."""
    shown = [i for i, name in enumerate(robot.coordinates) if name in robot.joint_coordinates or q[i] != 0]
    return ", ".join(f"{robot.coordinates[i]} = {q[i]:.4g}" for i in shown)


def _wrenches(robot: Robot, wrench: ArrayLike | None, frame: str | None) -> list[tuple[int, list[float]]]:
    if wrench is None:
        if frame is not None:
            raise PostureError("frame", found=f"{frame!r} without a wrench", expected="both or neither")
        return []
    if frame is None:
        raise PostureError("frame", found="nothing", expected="the frame at which the wrench acts")
    values = _numbers("wrench", wrench, (6,), "six finite numbers: force x y z (N), moment x y z (N m)")
    return [(robot.frame_index(frame), values.tolist())]


def _bushings(robot: Robot, q: Array) -> list[_core.Bushing]:
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


def _settle(
    robot: Robot,
    label: str,
    reference: Array,
    wrenches: list[tuple[int, list[float]]],
    bushings: list[_core.Bushing],
    keep: NDArray[np.intp],
) -> Array:
    """Posture where springs, gravity and wrench balance, by Newton's method from the unloaded one."""
    mechanism, zero = robot.mechanism, np.zeros_like(reference)
    q = reference.copy()
    for _ in range(NEWTON_STEPS):
        parts = [mechanism.inverse_dynamics(q, zero, zero, wrenches=wrenches), robot.stiffness * (q - reference)]
        forces = np.array([*parts, *(bushing.force(mechanism, q, zero) for bushing in bushings)])[:, keep]
        residual = forces.sum(axis=0)
        tangent = mechanism.linearize(q, zero, zero, wrenches=wrenches, bushings=bushings)
        stiffness = tangent[2][keep[:, None], keep] + np.diag(robot.stiffness[keep])
        # Of least length: a free coordinate that nothing loads stays where it is.
        step = np.linalg.lstsq(stiffness, residual, rcond=1e-12)[0]
        q[keep] -= step
        if not np.isfinite(q).all() or np.abs(q - reference).max() > 10.0:
            break
        # Convergence is quadratic: after a step this small only rounding is left, or what nothing carries.
        if np.abs(step).max() <= 1e-10:
            size = float(np.abs(stiffness).max())
            loose = np.abs(residual - stiffness @ step).max() > 1e-9 * np.abs(forces).max() + 1e-12 * size
            if loose or np.linalg.eigvals(stiffness).real.min() < -1e-12 * size:
                break
            return q
    raise ModelError(
        f"{robot.name}, posture {label}",
        found="no stable static equilibrium near it",
        expected="springs that carry gravity and the wrench",
        hint="Check stiffness and wrench, or linearize at the reference posture.",
    )
