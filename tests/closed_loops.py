"""The closed loop of a driven robot written out from its law, as equations of motion and as impedances."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

import armonic as am
from models import Complex, robot_of
from trees import Array


class Law:
    """Do et al. 2022, Eqs. 1 to 4, with integral gains, gains on the link side and state feedback.

    Args:
        robot: the robot.
        q_d: its desired posture, all coordinates.
        frame: at which a wrench acts.
        wrench: of it, in world axes, or in the frame's own with `follows`.
    """

    def __init__(
        self, robot: am.Robot, q_d: Array, frame: str | None = None, wrench: Any = None, *, follows: bool = False
    ) -> None:
        self.robot, self.q_d, self.follows = robot, q_d, follows
        self.frame = None if frame is None else robot.frame_index(frame)
        self.wrench = np.zeros(6) if wrench is None else np.asarray(wrench, float)
        self.keep = np.flatnonzero(robot.flexible)
        d, c = robot.drives, robot.control
        self.n, self.nm, self.driven = len(self.keep), len(d.names), d.coordinates
        self.w, self.k = d.scale, d.shaft_stiffness
        carried = self.rigid(q_d)[self.driven] / self.w
        self.feedforward = carried if c.feedforward else np.zeros(self.nm)
        self.q_md = self.w * q_d[self.driven] + self.feedforward / self.k

    def rigid(self, q: Array) -> Array:
        """g − Jᵀτ."""
        force = self.robot.mechanism.gravity_torque(q)
        if self.frame is None:
            return force
        turn = self.robot.mechanism.pose(q, self.frame)[:3, :3] if self.follows else np.eye(3)
        world = np.concatenate([turn @ self.wrench[:3], turn @ self.wrench[3:]])
        return force - self.robot.mechanism.jacobian(q, self.frame).T @ world

    def full(self, z: Array) -> tuple[Array, Array]:
        """All link coordinates, locked ones at their posture, and the motors' of the coordinates of a model."""
        q = self.q_d.copy()
        q[self.keep] = z[: self.n]
        return q, z[self.n :]

    def motor_torque(self, z: Array, rate: Array, integral: Array) -> Array:
        """τ_m of coordinates, rates and integrals of deviations."""
        c, (q, q_m) = self.robot.control, self.full(z)
        at = np.searchsorted(self.keep, self.driven)
        rates, sums = (np.concatenate([v[at], v[self.n :]]) for v in (rate, integral))
        e, e_m, nm = self.w * (self.q_d - q)[self.driven], self.q_md - q_m, self.nm
        torque = self.feedforward + c.kp * e_m - c.ki * sums[nm:] - c.kd * rates[nm:]
        torque += c.link_kp * e - c.link_ki * self.w * sums[:nm] - c.link_kd * self.w * rates[:nm]
        off = np.concatenate([(q - self.q_d)[self.driven], q_m - self.q_md])
        return torque - c.position @ off - c.velocity @ rates

    def residual(self, z: Array, rate: Array, integral: Array) -> Array:
        """Γ of Eq. 4 without accelerations, at small rates: what does not balance on links and motors, (n + nm,)."""
        robot, d, (q, q_m) = self.robot, self.robot.drives, self.full(z)
        rates = np.zeros_like(q)
        rates[self.keep] = rate[: self.n]
        twist = self.k * (self.w * q[self.driven] - q_m)
        links = self.rigid(q) + robot.stiffness * (q - self.q_d) + robot.damping * rates
        links[self.driven] += d.joint_damping * rates[self.driven] + self.w * twist
        motors = d.motor_damping * rate[self.n :] - twist - self.motor_torque(z, rate, integral)
        return np.concatenate([links[self.keep], motors])


def impedances(robot: am.Robot, s: complex) -> tuple[Array, Complex]:
    """Where drives act among the flexible coordinates, and z(s) of each: the law with the motor eliminated."""
    d, c = robot.drives, robot.control
    own = d.inertia * s**2 + (d.motor_damping + c.kd) * s + d.shaft_stiffness + c.kp + c.ki / s
    link = d.scale * (c.link_kp + c.link_kd * s + c.link_ki / s)
    wk = d.scale * d.shaft_stiffness
    at = np.searchsorted(np.flatnonzero(robot.flexible), d.coordinates)
    return at, d.scale * wk + s * d.joint_damping - wk * (wk - link) / own


def impedance_form(model: am.LinearModel, s: complex) -> Complex:
    """Z(s), (n, n), of the link coordinates alone."""
    robot, keep, none = model.robot, np.flatnonzero(model.robot.flexible), np.zeros(len(model.q))
    mass, _, stiffness = robot.mechanism.linearize(model.q, none, none)[:, keep[:, None], keep]
    Z = s**2 * mass + stiffness + np.diag(robot.stiffness[keep] + s * robot.damping[keep])
    at, z = impedances(robot, s)
    Z[at, at] += z
    return np.asarray(Z)


def with_control(robot: am.Robot, **control: Any) -> am.Robot:
    """The same robot, whose text is JSON, under other gains; those not named stay."""
    data = json.loads(robot.to_yaml())
    data["control"] |= control
    return am.Robot.from_yaml(json.dumps(data))


def driven_hinge(
    *, inertia: float, control: dict[str, Any] | None = None, mass: float = 1.0, com: float = 0.0, **drive: float
) -> am.Robot:
    """One link on a driven hinge about y, its mass straight above while the hinge is at zero; inertia about its com."""
    numbers = {"gear_ratio": 100, "rotor_inertia": 2e-4, "shaft_stiffness": 3e4} | drive
    link = {
        "name": "rod",
        "parent": "base",
        "joint": {"type": "revolute", "axis": "y"},
        "drive": numbers,
        "mass": mass,
        "com": [0, 0, com],
        "inertia": {"xx": inertia, "yy": inertia, "zz": inertia},
    }
    return robot_of([link], control=control or {})


def driven_slide(
    *, mass: float, axis: str = "x", radius: float = 1.0, control: dict[str, Any] | None = None, **drive: float
) -> am.Robot:
    """One mass on a slide along an axis, driven through a rack; frame "mass"."""
    numbers = {"gear_ratio": 100, "rotor_inertia": 2e-4, "shaft_stiffness": 3e4, "radius": radius} | drive
    link = {
        "name": "mass",
        "parent": "base",
        "joint": {"type": "prismatic", "axis": axis},
        "drive": numbers,
        "mass": mass,
    }
    return robot_of([link], control=control or {})
