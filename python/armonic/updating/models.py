"""The models of a fit at some values: linear models and responses in the lines, axes and kind of each measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ModelError
from armonic.linear import linearize
from armonic.synthesis import AXES, frf
from armonic.updating.laws import values_in

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.linear import LinearModel
    from armonic.response import Frf
    from armonic.robot import Robot
    from armonic.updating.measurement import Measurement
    from armonic.updating.parameters import Parameter
    from armonic.updating.task import Task

    Array: TypeAlias = NDArray[np.float64]

ROUNDING = 1e-12
"""A response smaller than this share of the terms it adds up from is zero."""


def robot_with(robot: Robot, parameters: Sequence[Parameter], values: Array) -> Robot:
    """The robot with the values of parameters, (c,), wherever they stand; slopes of laws stand nowhere."""
    return robot.with_values({path: float(v) for p, v in zip(parameters, values, strict=True) for path in p.paths})


def models_at(task: Task, values: Array) -> tuple[LinearModel, ...]:
    """The linear models of a task's measurements at some values, (c,)."""
    if not all(p.is_impedance or not p.paths for p in task.parameters):
        changed = robot_with(task.robot, task.parameters, values)
        return tuple(linearize(changed, m.posture) for m in task.measurements)
    models = []
    for model in task.models:
        here, _ = values_in(task.parameters, values, model)
        theta = np.concatenate([model.spring, model.damper])
        for p, value in zip(task.parameters, here, strict=True):
            theta[list(p.indices)] = value
        models.append(model.with_impedances(*theta.reshape(2, -1)))
    return tuple(models)


def responses_like(task: Task, models: Sequence[LinearModel]) -> tuple[Frf, ...]:
    """What models answer where a task's measurements were taken."""
    return tuple(response_like(m, model) for m, model in zip(task.measurements, models, strict=True))


def response_like(m: Measurement, model: LinearModel) -> Frf:
    """The model's response in the lines, axes and kind of a measurement."""
    H = m.frf
    return frf(
        model,
        None,
        H.freq_hz,
        frame=m.frame,
        kind=H.kind,
        outputs=H.outputs,
        inputs=H.inputs,
        input_frame=H.input_frame,
    )


def refuse_absent(m: Measurement, model: LinearModel, weight: Array) -> None:
    """Refuses a response that the model cannot have, as across the plane of a planar robot.

    It comes out as zero, or as what rounding leaves of it, whatever the parameters; its logarithm means nothing.

    Raises:
        ModelError: there is one.
    """
    watched, hit = model.jacobian(m.frame), model.jacobian(m.frf.input_frame or m.frame)
    reach_out, reach_in = (np.repeat(np.abs(J).reshape(2, 3, -1).max(axis=1), 3, axis=0) for J in (watched, hit))
    rows, columns = ([AXES.index(axis) for axis in axes] for axes in (m.frf.outputs, m.frf.inputs))
    used = np.flatnonzero((weight > 0).any(axis=(1, 2)))
    s = 2j * np.pi * m.frf.freq_hz[used[[0, len(used) // 2, -1]], None, None]
    Z = s**2 * model.mass + s * model.damping + model.stiffness
    if len(model.loop) and len(model.loop.integrating):
        Z = Z + model.integral / np.where(s == 0, 1, s)
    try:
        X = np.linalg.inv(Z)
    except np.linalg.LinAlgError:
        return
    size = np.abs(watched[rows] @ X @ hit[columns].T)
    scale = reach_out[rows] @ np.abs(X) @ reach_in[columns].T
    absent = (size <= ROUNDING * scale).all(axis=0) & (weight > 0).any(axis=0)
    if absent.any():
        a, b = (int(i) for i in np.argwhere(absent)[0])
        out, into = m.frf.outputs[a], m.frf.inputs[b]
        raise ModelError(
            f"{m.label}: H_{out}{into}",
            found="a measured response that is zero in the model, whatever its parameters",
            expected=f"a model that moves along {out} under a load along {into}",
            hint="Leave it out with frf.select(...), give it weight zero, or add the elasticity that it comes from.",
        )
