"""Frequency responses computed from a linear model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import FrfError, ModelError
from armonic.linear import Equilibrium, LinearModel, model_of
from armonic.loads import WrenchAxes
from armonic.response import KINDS, Frf, Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

AXES = ("x", "y", "z", "rx", "ry", "rz")
"""Rows of a frame's Jacobian: translations, then rotations, about the frame's own axes."""


def frf(
    robot: Robot | LinearModel,
    posture: Posture | None,
    freq_hz: ArrayLike,
    *,
    frame: str,
    kind: Kind = "accelerance",
    outputs: Iterable[str] = ("x", "y", "z"),
    inputs: Iterable[str] = ("x", "y", "z"),
    input_frame: str | None = None,
    wrench: ArrayLike | None = None,
    wrench_axes: WrenchAxes = "world",
    equilibrium: Equilibrium = "reference",
) -> Frf:
    """Frequency response matrix H(iω) = (iω)^p J Z(iω)⁻¹ Jᵀ at a frame, in the frame's own axes.

    Huynh et al. 2021, Eqs. 21 to 28, with the Jacobian in place of the finite pose difference. Drives respond in closed
    loop.

    Args:
        robot: a robot, or a linear model (then `posture` is None).
        posture: a posture's name or joint coordinates.
        freq_hz: lines, (L,), Hz, increasing.
        frame: where the response is taken, and where the force acts unless `input_frame` is given.
        kind: "receptance", "mobility" or "accelerance".
        outputs: response axes among x y z rx ry rz of `frame`.
        inputs: force (x y z) or moment (rx ry rz) axes.
        input_frame: where the force acts.
        wrench: a constant wrench at `frame` that the robot is under, as in `linearize`.
        wrench_axes: as in `linearize`.
        equilibrium: as in `linearize`.

    Returns:
        The responses as an `Frf`, values (L, outputs, inputs).

    Raises:
        PostureError: posture, frame or wrench do not fit the robot, or come with a linear model.
        FrfError: lines or axes are not valid.
        ModelError: an undamped resonance lies exactly on a line, or the model cannot be built.
    """
    loaded = None if wrench is None else frame
    model = model_of(robot, posture, wrench=wrench, frame=loaded, wrench_axes=wrench_axes, equilibrium=equilibrium)
    outputs, inputs = tuple(outputs), tuple(inputs)
    try:
        lines = np.asarray(freq_hz, float)
    except (TypeError, ValueError) as error:
        raise FrfError("freq_hz", found=f"{type(freq_hz).__name__} ({error})", expected="numbers in Hz") from None
    empty = Frf(
        lines, np.zeros((lines.size, len(outputs), len(inputs)), complex), kind, outputs, inputs, frame, input_frame
    )
    values = responses([model], lines, frame=frame, outputs=outputs, inputs=inputs, input_frame=input_frame)[0]
    omega = 2j * np.pi * empty.freq_hz
    return replace(empty, values=values * (omega ** KINDS.index(kind))[:, None, None])


def responses(
    models: Sequence[LinearModel],
    freq_hz: ArrayLike,
    *,
    frame: str,
    outputs: Iterable[str] = ("x", "y", "z"),
    inputs: Iterable[str] = ("x", "y", "z"),
    input_frame: str | None = None,
    spring: ArrayLike | None = None,
    damper: ArrayLike | None = None,
) -> Complex:
    """Receptances of many models, or of one model under many impedance sets, in parallel.

    Args:
        models: P linear models (postures) of one robot, or a single one.
        freq_hz: lines, (L,), Hz.
        frame: where the response is taken.
        outputs: response axes.
        inputs: force axes.
        input_frame: where the force acts, if elsewhere.
        spring: stiffness of every impedance, (P, r) or (r,), in place of the models' own.
        damper: damping of every impedance, likewise.

    Returns:
        Receptances H[posture, line, output, input], (P, L, outputs, inputs).

    Raises:
        PostureError: unknown frame.
        FrfError: unknown axis, or arrays that do not fit.
        ModelError: an undamped resonance lies exactly on a line.
    """
    outputs, inputs = tuple(outputs), tuple(inputs)
    rows = [_rows(model, frame, outputs, inputs, input_frame) for model in models]
    still = bool(np.any(np.asarray(freq_hz) == 0))
    dense = any(_is_dense(model) or (still and _holds_link(model)) for model in models)
    systems = [] if dense else [_system(model, *pair) for model, pair in zip(models, rows, strict=True)]
    loaded = {name for model in models for name in model.loaded}
    if loaded and (spring is not None or damper is not None):
        raise FrfError(
            "spring, damper",
            found=f"values beside the loaded bushings {', '.join(sorted(loaded))}",
            expected="bushings at rest, for the load and its stiffness would change with the springs",
            hint="Change the robot with `with_values` and linearize it again.",
        )
    try:
        springs = np.array([m.spring for m in models]) if spring is None else np.asarray(spring, float)
        dampers = np.array([m.damper for m in models]) if damper is None else np.asarray(damper, float)
        springs, dampers = np.broadcast_arrays(np.atleast_2d(springs), np.atleast_2d(dampers))
        points = 2j * np.pi * np.asarray(freq_hz, float)
        if not systems:
            return _dense(models, rows, springs, dampers, points)
        return _core.responses(systems, springs, dampers, points)[0]
    except ArithmeticError as error:
        raise ModelError(
            f"frequency response at {frame}", found=str(error), expected="damping in every mode, or lines beside it"
        ) from None
    except (TypeError, ValueError) as error:
        raise FrfError("responses", found=str(error), expected="arrays that fit the models") from None


def _is_dense(model: LinearModel) -> bool:
    """Whether feedback from joint to joint comes with integrators, for which the core has no form."""
    return not model.local and bool(model.loop.integrating.size)


def _holds_link(model: LinearModel) -> bool:
    """Whether some control integrates the joint's deviation alone: that joint's impedance is infinite at 0 Hz."""
    loop = model.loop
    return bool((loop.integral[loop.integrating, loop.motors[loop.integrating]] == 0).any())


def _dense(
    models: Sequence[LinearModel],
    rows: Sequence[tuple[Array, Array]],
    springs: Array,
    dampers: Array,
    points: Complex,
) -> Complex:
    """Receptances as `responses` gives them, by LAPACK.

    Raises:
        ValueError: there are neither as many sets of springs as models, nor one of either.
        ArithmeticError: a dynamic stiffness is singular.
    """
    count = max(len(models), len(springs))
    if {len(models), len(springs)} - {1, count}:
        raise ValueError(f"{len(springs)} sets of springs for {len(models)} models")
    found = []
    for i in range(count):
        at, given = min(i, len(models) - 1), min(i, len(springs) - 1)
        model, (watched, hit) = models[at].with_impedances(springs[given], dampers[given]), rows[at]
        s = points[:, None, None]
        Z = s**2 * model.mass + s * model.damping + model.stiffness
        # No force acts on a motor, so that its row may be multiplied by s: G/s then stays finite at 0 Hz.
        integrating = model.links + model.loop.integrating
        Z[:, integrating] = s * Z[:, integrating] + model.integral[integrating]
        try:
            found.append(watched @ np.linalg.solve(Z, np.broadcast_to(hit.T, (len(points), *hit.T.shape))))
        except np.linalg.LinAlgError:
            raise ArithmeticError("dynamic stiffness is singular") from None
    return np.asarray(found)


def _rows(
    model: LinearModel, frame: str, outputs: tuple[str, ...], inputs: tuple[str, ...], input_frame: str | None
) -> tuple[Array, Array]:
    """Rows of the Jacobians where a model is watched and where it is hit.

    Raises:
        PostureError: unknown frame.
        FrfError: unknown axis.
    """
    for name, axes in (("outputs", outputs), ("inputs", inputs)):
        unknown = [axis for axis in axes if axis not in AXES]
        if unknown or not axes:
            raise FrfError(name, found=", ".join(map(repr, unknown)) or "none", expected=f"axes among {' '.join(AXES)}")
    watched = model.jacobian(frame)[[AXES.index(axis) for axis in outputs]]
    hit = model.jacobian(input_frame or frame)[[AXES.index(axis) for axis in inputs]]
    return watched, hit


def system(
    model: LinearModel,
    frame: str,
    outputs: tuple[str, ...] = ("x", "y", "z"),
    inputs: tuple[str, ...] = ("x", "y", "z"),
    *,
    input_frame: str | None = None,
) -> _core.LinearSystem:
    """What the core needs of a model that is watched at one frame and hit at another.

    Where every motor listens to its own joint only, each drive is one impedance on that joint; else its motor is a
    coordinate of its own.

    Raises:
        PostureError: unknown frame.
        FrfError: unknown axis.
        ModelError: feedback from joint to joint with integrators.
    """
    if _is_dense(model):
        raise ModelError(
            f"{model.robot.name}, control",
            found="state feedback from joint to joint beside integral gains",
            expected="one or the other in a fit",
        )
    return _system(model, *_rows(model, frame, outputs, inputs, input_frame))


def _system(model: LinearModel, watched: Array, hit: Array) -> _core.LinearSystem:
    n, loop = (model.links, model.loop) if model.local else (len(model.coordinates), None)
    return _core.LinearSystem(
        mass=model.mass[:n, :n],
        damping=model.free_damping[:n, :n],
        stiffness=model.free_stiffness[:n, :n],
        directions=model.directions[:, :n],
        outputs=watched[:, :n],
        inputs=hit[:, :n],
        drives=loop.impedances() if loop else None,
        drive_coordinates=loop.driven.tolist() if loop else None,
    )
