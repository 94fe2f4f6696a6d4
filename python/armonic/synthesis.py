"""Frequency responses computed from a linear model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import FrfError, ModelError
from armonic.linear import Equilibrium, LinearModel, model_of
from armonic.response import KINDS, Frf, Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot

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
    equilibrium: Equilibrium = "reference",
) -> Frf:
    """Frequency response matrix H(iω) = (iω)^p J Z(iω)⁻¹ Jᵀ at a frame, in the frame's own axes.

    Huynh et al. 2021, Eqs. 21 to 28, with the Jacobian in place of the finite pose difference.

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
        equilibrium: as in `linearize`.

    Returns:
        The responses as an `Frf`, values (L, outputs, inputs).

    Raises:
        PostureError: posture, frame or wrench do not fit the robot, or come with a linear model.
        FrfError: lines or axes are not valid.
        ModelError: an undamped resonance lies exactly on a line, or the model cannot be built.
    """
    model = model_of(robot, posture, wrench=wrench, frame=None if wrench is None else frame, equilibrium=equilibrium)
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
    systems = [system(model, frame, tuple(outputs), tuple(inputs), input_frame=input_frame) for model in models]
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
        return _core.responses(systems, springs, dampers, points)[0]
    except ArithmeticError as error:
        raise ModelError(
            f"frequency response at {frame}", found=str(error), expected="damping in every mode, or lines beside it"
        ) from None
    except (TypeError, ValueError) as error:
        raise FrfError("responses", found=str(error), expected="arrays that fit the models") from None


def system(
    model: LinearModel,
    frame: str,
    outputs: tuple[str, ...] = ("x", "y", "z"),
    inputs: tuple[str, ...] = ("x", "y", "z"),
    *,
    input_frame: str | None = None,
) -> _core.LinearSystem:
    """What the core needs of a model that is watched at one frame and hit at another.

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
    return _core.LinearSystem(
        mass=model.mass,
        damping=model.free_damping,
        stiffness=model.free_stiffness,
        directions=model.directions,
        outputs=watched,
        inputs=hit,
    )
