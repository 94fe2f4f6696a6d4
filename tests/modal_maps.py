"""Surveys in closed form, laid out as those of armonic.survey: one crossing, one veering, modes from 6 to 850 Hz."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Array = NDArray[np.float64]

CROSSING_AT, VEERING_AT = 0.25, 0.75
"""Where along 0 to 1 modes 3 and 4 cross, and modes 5 and 6 veer."""
ROBOT = """\
armonic: 1
name: two arms
links:
  - name: one
    parent: base
    joint: {type: revolute, axis: z}
    elasticity: {z: {stiffness: 1e5, damping: 20}}
    mass: 20
    com: [0.3, 0, 0]
    inertia: {xx: 0.2, yy: 1, zz: 1}
  - name: two
    parent: one
    placement: [{x: 0.6}]
    joint: {type: revolute, axis: z}
    elasticity: {z: {stiffness: 5e4, damping: 10}}
    mass: 10
    com: [0.2, 0, 0]
    inertia: {xx: 0.1, yy: 0.5, zz: 0.5}
frames:
  - {name: tip, link: two, placement: [{x: 0.5}]}
postures: {start: [0, 0.5]}
"""


def natural_hz(s: Array, mass: Array | float = 0.0) -> Array:
    """Seven modes by columns, (..., 7): 3 and 4 are lines that cross, 5 and 6 branches of a hyperbola."""
    s, mass = np.broadcast_arrays(s, mass)
    drop = 1 - 0.02 * mass
    apart = np.hypot(6 * (s - VEERING_AT), 0.15)
    return np.stack(
        [
            (6 + 0.8 * np.sin(3 * s)) * drop,
            (7.6 - 0.5 * s) * drop,
            20 + 4 * (s - CROSSING_AT),
            20 - 4 * (s - CROSSING_AT),
            (60 - apart) * drop,
            (60 + apart) * drop,
            850.6 + 0.4 * s,
        ],
        axis=-1,
    )


def damping(s: Array) -> Array:
    """Damping ratios by columns, (..., 7)."""
    one = np.ones_like(s)
    return np.stack(
        [0.07 + 0.01 * s, 0.11 - 0.01 * s, 0.02 * one, 0.03 * one, 0.0125 + 0.01 * s, 0.025 * one, 0.8 * one], axis=-1
    )


def dataset(
    dims: Sequence[str], s: Array, mass: Array | float, coords: Mapping[str, Any], *, robot: str = ROBOT
) -> xr.Dataset:
    """A survey over these dims from the place s along 0 to 1, and the tool's mass, both over the dims."""
    s, mass = np.broadcast_arrays(s, mass)
    f, zeta = natural_hz(s, mass), damping(s)
    pole = 2 * np.pi * f * (-zeta + 1j * np.sqrt(1 - zeta**2))
    event = np.zeros(f.shape, np.int8)
    for code, modes, where in ((1, (2, 3), CROSSING_AT), (2, (4, 5), VEERING_AT)):
        nearest = np.abs(s - where) <= np.abs(s - where).min() + 1e-12
        for mode in modes:
            event[..., mode] = np.where(nearest, code, 0)
    over = (*dims, "mode")
    data = {
        "pole": (over, pole, {"units": "rad/s", "long_name": "pole"}),
        "partner": (over, pole.conj(), {"units": "rad/s", "long_name": "partner pole"}),
        "natural_freq_hz": (over, f, {"units": "Hz", "long_name": "natural frequency"}),
        "damped_freq_hz": (over, pole.imag / (2 * np.pi), {"units": "Hz", "long_name": "damped frequency"}),
        "damping_ratio": (over, zeta, {"units": "1", "long_name": "damping ratio"}),
        "mac": (over, np.ones(f.shape, np.float32), {"units": "1", "long_name": "MAC"}),
        "event": (over, event, {"units": "1", "long_name": "event"}),
        "stability": (dims, np.ones(f.shape[:-1], np.int8), {"units": "1", "long_name": "stability"}),
        "method": (dims, np.zeros(f.shape[:-1], np.int8), {"units": "1", "long_name": "method"}),
        "residual": (dims, np.full(f.shape[:-1], 1e-14, np.float32), {"units": "1", "long_name": "residual"}),
    }
    attrs = {"robot": "two arms", "robot_file": robot, "armonic": "0.0", "spec": json.dumps({"made": "by hand"})}
    return xr.Dataset(data, {"mode": np.arange(1, f.shape[-1] + 1), **coords}, attrs)


def path(count: int = 50, masses: Sequence[float] = (0.0, 4.0)) -> xr.Dataset:
    """A path of postures, for each mass of the tool."""
    s, mass = np.linspace(0, 1, count), np.array(masses)
    coords: dict[str, Any] = {
        "posture": np.arange(count),
        "one.z": ("posture", 0.5 * s, {"units": "rad"}),
        "two.z": ("posture", 0.5 - s, {"units": "rad"}),
    }
    if not masses:
        return dataset(("posture",), s, 0.0, coords)
    coords["tool.mass"] = ("tool.mass", mass, {"units": "kg"})
    return dataset(("tool.mass", "posture"), s[None], mass[:, None], coords)


def sweep(count: int = 30) -> xr.Dataset:
    """One posture over the gain kp, along with kd."""
    kp = np.linspace(2000, 15000, count)
    coords = {
        "control.kp": ("control.kp", kp, {"units": "N m/rad"}),
        "control.kd": ("control.kp", 0.425 * np.sqrt(kp), {"units": "N m s/rad"}),
        "one.z": ((), 0.0, {"units": "rad"}),
        "two.z": ((), 0.5, {"units": "rad"}),
    }
    return dataset(("control.kp",), np.linspace(0, 1, count), 0.0, coords)


def grid(shape: Sequence[int] = (21, 11)) -> xr.Dataset:
    """A grid of two or three joints; the place along 0 to 1 goes up along all of them."""
    names = [f"{word}.z" for word in ("one", "two", "three")[: len(shape)]]
    values = [np.linspace(-0.5, 0.5, count) for count in shape]
    mesh = np.meshgrid(*values, indexing="ij")
    s = np.mean(mesh, axis=0) + 0.5
    coords = {name: (name, value, {"units": "rad"}) for name, value in zip(names, values, strict=True)}
    return dataset(names, s, 0.0, coords)


def sample(count: int = 64) -> xr.Dataset:
    """Postures at random."""
    rng = np.random.default_rng(7)
    one, two = rng.uniform(-1, 1, (2, count))
    coords = {
        "posture": np.arange(count),
        "one.z": ("posture", one, {"units": "rad"}),
        "two.z": ("posture", two, {"units": "rad"}),
    }
    return dataset(("posture",), 0.5 + 0.5 * one, 0.0, coords)
