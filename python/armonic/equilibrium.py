"""Where a robot comes to rest under gravity, a wrench, its springs and its control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic import _core
    from armonic.closed_loop import ClosedLoop
    from armonic.loads import Load
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]

NEWTON_STEPS = 50


@dataclass(frozen=True, eq=False)
class Rest:
    """A robot at rest.

    Attributes:
        q: all link coordinates, (n_all,), rad or m.
        motor_position: q_m, (nm,), rad after the gear.
        motor_torque: τ_m, (nm,), N m after the gear.
    """

    q: Array
    motor_position: Array
    motor_torque: Array


def desired(robot: Robot, q: Array, load: Load) -> Rest:
    """What the control is told to hold: the posture, q_m of Do et al. 2022, Eq. 3, and the feed-forward of Eq. 2.

    Without feed-forward q_m = W q, and no torque.
    """
    drives, zero = robot.drives, np.zeros_like(q)
    torque = np.zeros(len(drives.names))
    if not torque.size:
        return Rest(q, torque, torque)
    if robot.control.feedforward:
        forces = robot.mechanism.inverse_dynamics(q, zero, zero, wrenches=load.at(q))
        torque = forces[drives.coordinates] / drives.scale
    return Rest(q, drives.scale * q[drives.coordinates] + torque / drives.shaft_stiffness, torque)


def settle(
    label: str,
    target: Rest,
    load: Load,
    bushings: Sequence[_core.Bushing],
    keep: NDArray[np.intp],
    loop: ClosedLoop,
) -> Rest:
    """Where springs, shafts, control, gravity and wrench balance, by Newton's method from what is desired.

    A motor whose control integrates stands where its integrated deviation stays as it is (zero, if it only integrates
    its own), whatever torque that takes.

    Args:
        label: of the posture, for errors.
        target: the desired state, in which the joint springs are unloaded.
        load: from outside.
        bushings: of the robot.
        keep: the coordinates that are not locked, (n,).
        loop: drives and control on them.

    Raises:
        ModelError: there is no equilibrium near by; or, for a robot without drives, no stable one.
    """
    robot, n = load.robot, len(keep)
    mechanism, q, zero = robot.mechanism, target.q.copy(), np.zeros_like(target.q)
    motors = target.motor_position.copy()
    for _ in range(NEWTON_STEPS):
        wrenches = load.at(q)
        parts = [mechanism.inverse_dynamics(q, zero, zero, wrenches=wrenches), robot.stiffness * (q - target.q)]
        forces = np.array([*parts, *(bushing.force(mechanism, q, zero) for bushing in bushings)])[:, keep]
        stiffness = mechanism.linearize(q, zero, zero, wrenches=wrenches, bushings=bushings)[2][keep[:, None], keep]
        stiffness = stiffness + np.diag(robot.stiffness[keep])
        turning = load.turning_stiffness(q)
        if turning is not None:
            stiffness += turning[keep[:, None], keep]
        if len(loop):
            forces, stiffness = _with_drives(loop, target, q[keep], motors, forces, stiffness)
        residual = forces.sum(axis=0)
        # Of least length: a free coordinate that nothing loads stays where it is.
        step = np.linalg.lstsq(stiffness, residual, rcond=1e-12)[0]
        q[keep] -= step[:n]
        motors -= step[n:]
        if not np.isfinite(q).all() or np.abs(q - target.q).max() > 10.0:
            break
        # Convergence is quadratic: after a step this small only rounding is left, or what nothing carries.
        if np.abs(step).max() <= 1e-10:
            size = float(np.abs(stiffness).max())
            loose = np.abs(residual - stiffness @ step).max() > 1e-9 * np.abs(forces).max() + 1e-12 * size
            # A loop may be unstable at its equilibrium; that is for modal analysis to say.
            if loose or (not len(loop) and np.linalg.eigvals(stiffness).real.min() < -1e-12 * size):
                break
            drives = loop.drives
            return Rest(q, motors, drives.shaft_stiffness * (motors - drives.scale * q[drives.coordinates]))
    raise ModelError(
        f"{robot.name}, posture {label}",
        found="no stable static equilibrium near it" if not len(loop) else "no static equilibrium near it",
        expected="springs that carry gravity and the wrench",
        hint="Check stiffness and wrench, or linearize at the reference posture.",
    )


def _with_drives(
    loop: ClosedLoop, target: Rest, q: Array, motors: Array, forces: Array, stiffness: Array
) -> tuple[Array, Array]:
    """Forces by kind, and their tangent, with shafts and motors (Do et al. 2022, Eq. 4 at rest).

    Args:
        loop: the drives and their control.
        target: the desired state.
        q: coordinates of the model, (n,).
        motors: q_m, (nm,).
        forces: of springs, gravity, ... on the coordinates, (kinds, n).
        stiffness: their tangent, (n, n).
    """
    n, nm = loop.links, len(loop)
    both = np.r_[loop.driven, loop.motors]
    z = np.r_[q, motors]
    off = np.zeros(n + nm)
    off[both] = z[both] - np.r_[target.q[loop.drives.coordinates], target.motor_position]
    shaft, torque = np.zeros(n + nm), np.zeros(n + nm)
    shaft[both] = loop.shafts() @ z[both]
    torque[n:] = loop.position @ off - target.motor_torque
    tangent = np.zeros((n + nm, n + nm))
    tangent[:n, :n] = stiffness
    tangent[np.ix_(both, both)] += loop.shafts()
    tangent[n:] += loop.position
    # An integrator at rest has nothing to integrate; the row is brought to the size of its shaft's.
    for i in loop.integrating:
        row = loop.integral[i] * (loop.drives.shaft_stiffness[i] / loop.integral[i].max())
        shaft[n + i], torque[n + i], tangent[n + i] = 0.0, row @ off, row
    return np.vstack([loop.widened(forces), shaft, torque]), tangent
