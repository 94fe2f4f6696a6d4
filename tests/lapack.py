"""Poles of surveys held against those of dense eigenvalue solvers, and postures to survey."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import linear_sum_assignment

import armonic as am
from models import Complex
from trees import Array

TOLERANCE = 1e-9
"""The accuracy that surveys promise, relative to each pole."""


def all_poles(found: xr.Dataset) -> Complex:
    """Every pole of a survey, (P, number of poles), without the places of slots that hold only one."""
    both = np.concatenate([found.pole.values, found.partner.values], axis=-1)
    flat = both.reshape(-1, both.shape[-1])
    there = ~np.isnan(flat)
    assert (there.sum(axis=1) == there[0].sum()).all()
    return flat[there].reshape(len(flat), -1)


def deviation(found: Complex, expected: Complex, *, floor: float = 0.0) -> float:
    """Largest distance of poles (P, k) from those they are assigned to, one to one, relative to the latter.

    Poles smaller than `floor` times the largest one are rigid-body modes, which no solver knows better.
    """
    assert found.shape == expected.shape
    size = np.abs(expected)
    scale = np.maximum(size, np.maximum(floor * size.max(axis=1, keepdims=True), np.finfo(float).tiny))
    cost = np.minimum(np.abs(found[:, :, None] - expected[:, None]) / scale[:, None], 1.0)
    nearest = cost.argmin(axis=2)
    worst = cost.min(axis=2).max(axis=1)
    for i in np.flatnonzero((np.sort(nearest, axis=1) != np.arange(found.shape[1])).any(axis=1)):
        worst[i] = cost[i][linear_sum_assignment(cost[i])].max()
    return float(worst.max())


def lapack_poles(robot: am.Robot, postures: Array, **load: Any) -> Complex:
    """Eigenvalues of the state matrix of every posture, (P, k)."""
    return np.linalg.eigvals(np.array([am.linearize(robot, q, **load).state_matrix() for q in postures])).astype(
        complex
    )


def scompi_states(robot: am.Robot, postures: Array) -> Array:
    """State matrices of a robot on PD drives, (P, 4n, 4n), written out from Do et al. 2022, Eqs. 9 to 14."""
    drives, control, n = robot.drives, robot.control, len(robot.coordinates)
    mass, gravity = robot.mechanism.at_rest(postures)
    k, w, count = drives.shaft_stiffness, drives.scale, len(postures)
    M, K, D = (np.zeros((count, 2 * n, 2 * n)) for _ in range(3))
    link, motor, i = slice(n), slice(n, None), np.arange(n)
    M[:, link, link], M[:, n + i, n + i] = mass, drives.inertia
    K[:, link, link] = gravity + np.diag(w**2 * k)
    K[:, i, n + i] = K[:, n + i, i] = -w * k
    K[:, motor, motor] = np.diag(k + control.kp)
    D[:, i, i], D[:, n + i, n + i] = drives.joint_damping, drives.motor_damping + control.kd
    state = np.zeros((count, 4 * n, 4 * n))
    state[:, : 2 * n, 2 * n :] = np.eye(2 * n)
    state[:, 2 * n :] = -np.linalg.solve(M, np.concatenate([K, D], axis=2))
    return state


def smooth(robot: am.Robot, count: int, *, seed: int = 0, amplitude: float = 1.0) -> Array:
    """Postures on a random smooth closed curve, (count, n)."""
    rng = np.random.default_rng(seed)
    s, n = np.linspace(0, 2 * np.pi, count)[:, None], len(robot.coordinates)
    waves = (rng.normal(size=n) / k * np.sin(k * s + rng.uniform(0, 2 * np.pi, n)) for k in (1, 2, 3))
    return np.asarray(amplitude * sum(waves))


def same(a: xr.Dataset, b: xr.Dataset) -> bool:
    """Whether two surveys have the same variables with the same bits."""
    names = sorted(set(map(str, a.variables)) - {"surveyed"})
    assert names == sorted(set(map(str, b.variables)) - {"surveyed"})
    return all(a[name].dims == b[name].dims and _bits(a[name]) == _bits(b[name]) for name in names)


def _bits(variable: xr.DataArray) -> object:
    values = variable.values
    return values.tolist() if values.dtype.kind in "OUT" else (values.dtype, values.shape, values.tobytes())
