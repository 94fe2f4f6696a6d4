"""Driven robots simulated by other means: Pinocchio's dynamics, the law of Do et al. 2022 and SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import armonic as am
from published import SCOMPI
from test_against_pinocchio import pinocchio_model
from trees import Array, Tree

HIT = am.Impulse(axis="y0", force=50.0, duration_s=0.006)  # Do et al. 2022, section 4.3


@cache
def scompi(case: int = 0) -> am.Robot:
    return am.load("scompi").with_values({"tool.mass": SCOMPI.tool_mass[case]})


class Peer:
    """A serial robot whose joints are all driven, under proportional-derivative control about a posture.

    Args:
        robot: the robot; its numbers are taken, nothing is computed with it.
        posture: name of the desired one.
        frame: where a force acts.
    """

    def __init__(self, robot: am.Robot, posture: str, frame: str = "tool") -> None:
        names = ("parents", "placements", "kinds", "axes", "masses", "coms", "inertias")
        parts = {name: getattr(robot.tree, name) for name in (*names, "frame_nodes", "frame_placements")}
        self.model, frames, _ = pinocchio_model(Tree(**parts, gravity=robot.gravity))
        self.data = self.model.createData()
        self.frame = frames[robot.tree.frames.index(frame)]
        self.drives, self.control, self.n = robot.drives, robot.control, len(robot.coordinates)
        self.q = np.array(robot.tree.postures[posture])
        d = self.drives
        self.feedforward = pin.computeGeneralizedGravity(self.model, self.data, self.q) / d.scale
        self.motors = d.scale * self.q + self.feedforward / d.shaft_stiffness  # Eq. 3

    def rates(self, state: Array, force: Array) -> Array:
        """Of [q, q_m, q̇, q̇_m], with a force in world axes at the frame's origin."""
        n, d, c = self.n, self.drives, self.control
        q, q_m, v, v_m = state[:n], state[n : 2 * n], state[2 * n : 3 * n], state[3 * n :]
        twist = d.shaft_stiffness * (d.scale * q - q_m)
        torque = -d.scale * twist - d.joint_damping * v
        if force.any():
            pin.framesForwardKinematics(self.model, self.data, q)
            joint = self.model.frames[self.frame].parentJoint
            at = pin.SE3(np.eye(3), self.data.oMf[self.frame].translation)
            forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
            forces[joint] = self.data.oMi[joint].actInv(at.act(pin.Force(force, np.zeros(3))))
            acceleration = pin.aba(self.model, self.data, q, v, torque, forces)
        else:
            acceleration = pin.aba(self.model, self.data, q, v, torque)
        motor_torque = self.feedforward + c.kp * (self.motors - q_m) - c.kd * v_m  # Eq. 2
        return np.concatenate([v, v_m, acceleration, (twist + motor_torque - d.motor_damping * v_m) / d.inertia])

    def run(self, time_s: Array, pieces: list[tuple[float, float, Array]], tolerance: float = 1e-11) -> Array:
        """States at even times from rest, (samples, 4 n); pieces of constant force one after the other."""
        state = np.concatenate([self.q, self.motors, np.zeros(2 * self.n)])
        rows: list[Array] = []
        for begin, end, force in pieces:
            inside = time_s[(time_s >= begin - 1e-12) & (time_s < end - 1e-12)]
            done = solve_ivp(
                lambda _, y, force=force: self.rates(y, force),
                (begin, end),
                state,
                method="DOP853",
                t_eval=np.append(inside, end),
                rtol=tolerance,
                atol=1e-3 * tolerance,
            )
            rows.extend(done.y.T[:-1])
            state = done.y[:, -1]
        return np.array([*rows, state])[: len(time_s)]

    def frame_motion(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Velocity and acceleration of the frame's origin in world axes, (samples, 3) each."""
        rows = []
        for state in zip(q, v, a, strict=True):
            pin.forwardKinematics(self.model, self.data, *state)
            pin.updateFramePlacements(self.model, self.data)
            about = (self.model, self.data, self.frame, pin.LOCAL_WORLD_ALIGNED)
            rows.append((pin.getFrameVelocity(*about).linear, pin.getFrameClassicalAcceleration(*about).linear))
        velocity, acceleration = np.array(rows).transpose(1, 0, 2)
        return velocity, acceleration


def states_of(run: am.Run) -> Array:
    """[q, q_m, q̇, q̇_m] of a run, (samples, ...)."""
    kinds = ("joint_position", "motor_position", "joint_velocity", "motor_velocity")
    kept = {channel.quantity for channel in run.series.channels}
    return np.hstack([run.series.select(kind).values for kind in kinds if kind in kept])


def reference(rates: Callable[[float, Array], Array], start: Array, time_s: Array, **options: float) -> Array:
    """States of a small smooth system at some times, (samples, n), by SciPy's DOP853 at 1e-12."""
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15} | options
    done = solve_ivp(rates, (0.0, time_s[-1]), start, t_eval=time_s, **how)
    return np.asarray(done.y.T)
