"""The peer of surveys: modal analysis posture by posture, as one writes it with Pinocchio and NumPy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import armonic as am


def pinocchio_model(robot: am.Robot) -> pin.Model:
    """The tree of a serial robot; fixed nodes become part of the body that carries them."""
    tree, model = robot.tree, pin.Model()
    model.gravity.linear = robot.gravity
    carriers = {-1: (0, pin.SE3.Identity())}
    for node, (parent, kind) in enumerate(zip(tree.parents, tree.kinds, strict=True)):
        joint, placement = carriers[parent]
        placement = placement * pin.SE3(tree.placements[node])
        if kind != "fixed":
            motion = pin.JointModelRevoluteUnaligned if kind == "revolute" else pin.JointModelPrismaticUnaligned
            joint = model.addJoint(joint, motion(tree.axes[node]), placement, f"node {node}")
            placement = pin.SE3.Identity()
        model.appendBodyToJoint(joint, pin.Inertia(tree.masses[node], tree.coms[node], tree.inertias[node]), placement)
        carriers[node] = (joint, placement)
    return model


class PinocchioLoop:
    """Poles and shapes of a robot whose joints are all driven or sprung, under control of its motors by themselves.

    Everything that does not depend on the posture is made once: a posture costs the mass matrix, the derivative of
    gravity, one solution with the mass matrix, and the eigenvalue problem of the state matrix (Do et al. 2022, Eq. 13).
    """

    def __init__(self, robot: am.Robot) -> None:
        self.model = pinocchio_model(robot)
        self.data = self.model.createData()
        n, drives, control = len(robot.coordinates), robot.drives, robot.control
        self.links, self.size = n, n + len(robot.motors)
        size, driven, motors = self.size, drives.coordinates, np.arange(n, self.size)
        w, k = drives.scale, drives.shaft_stiffness
        springs = np.diag(robot.stiffness)
        springs[driven, driven] += w**2 * k
        dampers = robot.damping.copy()
        dampers[driven] += drives.joint_damping
        # [K, C] over the states; the upper rows wait for gravity and the mass matrix.
        self.forces = np.zeros((n, 2 * size))
        self.forces[driven, motors] = -w * k
        self.forces[np.arange(n), size + np.arange(n)] = dampers
        self.springs = springs
        self.state = np.zeros((2 * size, 2 * size))
        self.state[:size, size:] = np.eye(size)
        rows = size + motors
        self.state[rows, driven] = w * k / drives.inertia
        self.state[rows, motors] = -(k + control.kp) / drives.inertia
        self.state[rows, size + motors] = -(drives.motor_damping + control.kd) / drives.inertia

    def state_matrix(self, q: np.ndarray) -> np.ndarray:
        n, size = self.links, self.size
        mass = pin.crba(self.model, self.data, q)
        self.forces[:, :n] = self.springs
        self.forces[:, :n] += pin.computeGeneralizedGravityDerivatives(self.model, self.data, q)
        self.state[size : size + n] = -np.linalg.solve(mass, self.forces)
        return self.state

    def modes(self, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poles (P, N) above the real axis by natural frequency, and their shapes (P, N, N), if no pole is real."""
        size = self.size
        poles = np.empty((len(postures), size), complex)
        shapes = np.empty((len(postures), size, size), complex)
        for i, q in enumerate(postures):
            values, vectors = np.linalg.eig(self.state_matrix(q))
            above = np.flatnonzero(values.imag > 0)
            above = above[np.argsort(np.abs(values[above]))]
            poles[i], shapes[i] = values[above], vectors[:size, above].T
        return poles, shapes


def blas_kernel() -> str:
    """What NumPy's linear algebra runs on, as far as it can be told."""
    try:
        from threadpoolctl import threadpool_info
    except ImportError:
        return "an unknown kernel (threadpoolctl is not there to tell)"
    found = [f"{part['internal_api']} {part['architecture']}" for part in threadpool_info() if "architecture" in part]
    return ", ".join(found) or "an unknown kernel"


def smooth_path(robot: am.Robot, points: int, seed: int = 0) -> np.ndarray:
    """(points, n) of a random motion about the first posture: five slow sines per joint, up to about ±1 rad or m."""
    rng = np.random.default_rng(seed)
    start = next(iter(robot.tree.postures.values()))
    n = len(start)
    swings, phase, share = (rng.uniform(*ends, (5, n)) for ends in ((1, 10), (0, 2 * np.pi), (0.1, 0.4)))
    time = np.linspace(0, 1, points)[:, None, None]
    return start + (share * np.sin(2 * np.pi * swings * time + phase)).sum(axis=1)
