"""Small robots written as robot files, with vibration known in closed form or random, and dense algebra on them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

import armonic as am
from armonic import _core
from armonic.linear import LinearModel
from trees import Array, random_body

Complex = NDArray[np.complex128]
AXES = ("x", "y", "z", "rx", "ry", "rz")
G = 9.81


def robot_of(links: list[dict[str, Any]], **rest: Any) -> am.Robot:
    """A robot from its links; JSON is YAML."""
    return am.Robot.from_yaml(json.dumps({"armonic": 1, "name": "test robot", "links": links, **rest}))


def spring(stiffness: float, damping: float = 0.0) -> dict[str, float]:
    return {"stiffness": stiffness, "damping": damping}


def slides(masses: list[float], springs: list[dict[str, float] | str], *, axis: str = "x", **rest: Any) -> am.Robot:
    """Masses in a row, each on a slide along one axis of the one before; frame i is the link mass_i."""
    links = [
        {
            "name": f"mass_{i}",
            "parent": f"mass_{i - 1}" if i else "base",
            "joint": {"type": "prismatic", "axis": axis},
            "elasticity": {f"t{axis}": held},
            "mass": mass,
        }
        for i, (mass, held) in enumerate(zip(masses, springs, strict=True))
    ]
    return robot_of(links, **rest)


def oscillator(mass: float, stiffness: float, damping: float = 0.0) -> am.Robot:
    """One mass on a slide along x."""
    return slides([mass], [spring(stiffness, damping)])


def pendulum(stiffness: float, *, mass: float, length: float, inertia: float = 0.0, **rest: Any) -> am.Robot:
    """A mass straight above a hinge about y while the hinge is at zero; frame "tip" is at the mass."""
    link = {
        "name": "rod",
        "parent": "base",
        "joint": {"type": "revolute", "axis": "y"},
        "elasticity": {"y": spring(stiffness)},
        "mass": mass,
        "com": [0, 0, length],
        "inertia": {"xx": inertia, "yy": inertia, "zz": inertia},
    }
    return robot_of([link], frames=[{"name": "tip", "link": "rod", "placement": [{"z": length}]}], **rest)


def random_robot(seed: int, n: int, *, damping: float = 1e-3, **rest: Any) -> am.Robot:
    """A branching robot of n joints about and along any axis, all elastic.

    Args:
        seed: of the random numbers.
        n: number of joints.
        damping: largest damper over its spring, s.
        rest: further keys of the file.
    """
    rng = np.random.default_rng([seed, n])

    def placement() -> list[dict[str, float]]:
        turns = [{key: float(rng.uniform(-2, 2))} for key in ("rx", "ry", "rz")]
        return [*turns, dict(zip("xyz", rng.uniform(-0.5, 0.5, 3).tolist(), strict=True))]

    links = []
    for i in range(n):
        mass, com, tensor = random_body(rng)
        stiffness = float(10 ** rng.uniform(5, 6))
        pairs = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
        links.append(
            {
                "name": f"link_{i}",
                "parent": "base" if i == 0 else f"link_{i - 1 if rng.random() < 0.75 else rng.integers(i)}",
                "placement": placement(),
                "joint": {"type": str(rng.choice(["revolute", "prismatic"])), "axis": rng.normal(size=3).tolist()},
                "elasticity": {"joint": spring(stiffness, stiffness * damping * rng.uniform(0.1, 1.0))},
                "mass": mass,
                "com": com.tolist(),
                "inertia": {key: float(tensor[at]) for key, at in pairs.items()},
            }
        )
    frames = [
        {"name": name, "link": f"link_{i}", "placement": placement()} for name, i in (("tip", n - 1), ("mid", n // 2))
    ]
    return robot_of(links, **{"frames": frames, "postures": {"bent": rng.uniform(-1, 1, n).tolist()}, **rest})


def random_driven_robot(seed: int, n: int, *, feedback: bool = False, **rest: Any) -> am.Robot:
    """A random robot whose joints are driven or sprung, at least one of them driven, with random gains of every kind.

    Args:
        seed: of the random numbers.
        n: number of joints.
        feedback: whether the control also has a full state feedback.
        rest: further keys of the file.
    """
    data = json.loads(random_robot(seed, n).to_yaml())
    rng = np.random.default_rng([seed, n, 1])
    chosen = rng.permutation(n)[: rng.integers(1, n + 1)]
    for i in chosen:
        link = data["links"][i]
        del link["elasticity"]
        link["drive"] = {
            "gear_ratio": float(rng.uniform(50, 200)),
            "rotor_inertia": float(10 ** rng.uniform(-4.5, -3.5)),
            "shaft_stiffness": float(10 ** rng.uniform(4.5, 5.5)),
            "motor_damping": float(rng.uniform(0, 1)),
            "joint_damping": float(rng.uniform(1, 30)),
        }
        if link["joint"]["type"] == "prismatic":
            link["drive"]["radius"] = float(rng.uniform(0.05, 0.2))
    nm = len(chosen)

    def gains(largest: float, share: float = 1.0) -> list[float]:
        return (rng.uniform(0.1, 1.0, nm) * largest * (rng.random(nm) < share)).tolist()

    control: dict[str, Any] = {"kp": gains(2e4), "kd": gains(100), "ki": gains(2e4, 0.5)}
    control |= {"link_kp": gains(2e3, 0.5), "link_kd": gains(5, 0.5), "link_ki": gains(1e3, 0.3)}
    if feedback:
        control["state_feedback"] = {
            key: (size * rng.uniform(-1, 1, (nm, 2 * nm))).tolist()
            for key, size in (("position", 200), ("velocity", 2))
        }
    return robot_of(
        data["links"], **{"frames": data["frames"], "postures": data["postures"], "control": control, **rest}
    )


def random_positive(rng: np.random.Generator, n: int) -> Array:
    """A symmetric positive definite matrix with a condition number of some tens."""
    root = rng.normal(size=(n, n)) / np.sqrt(n)
    return root @ root.T + 0.3 * np.eye(n)


def dynamic_stiffness(s: Complex, mass: Array, damping: Array, stiffness: Array) -> Complex:
    """Z(s), (L, n, n)."""
    s = np.asarray(s, complex)[:, None, None]
    return s**2 * mass + s * damping + stiffness


def dense_response(model: LinearModel, freq_hz: Array, output: Array, into: Array) -> Complex:
    """Receptances J_out Z⁻¹ J_inᵀ, (L, p, m), by LAPACK."""
    z = dynamic_stiffness(2j * np.pi * np.asarray(freq_hz), model.mass, model.damping, model.stiffness)
    return output @ np.linalg.solve(z, np.broadcast_to(into.T, (len(z), *into.T.shape)).astype(complex))


def rows_of(model: LinearModel, frame: str, axes: tuple[str, ...] = ("x", "y", "z")) -> Array:
    """Jacobian rows of a frame in its own axes, by turning those in world axes with the pose."""
    mechanism, index = model.robot.mechanism, model.robot.frame_index(frame)
    turn = mechanism.pose(model.q, index)[:3, :3].T
    world = mechanism.jacobian(model.q, index)[:, model.robot.flexible]
    return (np.kron(np.eye(2), turn) @ world)[[AXES.index(axis) for axis in axes]]


def system_of(mass: Array, damping: Array, stiffness: Array, directions: Array, out: Array, into: Array) -> Any:
    return _core.LinearSystem(
        mass=mass, damping=damping, stiffness=stiffness, directions=directions, outputs=out, inputs=into
    )


def difference(found: Complex | Array, expected: Complex | Array) -> float:
    """Largest deviation on a line over the largest entry on that line (lines lead)."""
    assert found.shape == expected.shape
    lines = range(1, expected.ndim)
    scale = np.abs(expected).max(axis=tuple(lines))
    return float((np.abs(found - expected).max(axis=tuple(lines)) / scale).max())
