"""Model updating: measured responses and a robot in, the updated robot and how far to trust it out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import ModelError, UpdateError
from armonic.linear import LinearModel, linearize
from armonic.modal import Modes, mac, modes
from armonic.response import Frf
from armonic.synthesis import AXES, frf, system
from armonic.updating.doubts import doubts
from armonic.updating.measurement import Measurement, levelled
from armonic.updating.parameters import Parameter, choose, refuse_loaded
from armonic.updating.solver import Objective, Status, minimize
from armonic.updating.uncertainty import FittedParameter, judge

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from armonic.robot import Robot
    from armonic.updating.parameters import Bounds

    Array: TypeAlias = NDArray[np.float64]


SMALLEST_TOLERANCE = float(np.finfo(float).eps)
ROUNDING = 1e-12
"""A response smaller than this share of the terms it adds up from is zero."""


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The result of model updating.

    Attributes:
        start: the description before.
        parameters: value, bounds, 95 % interval and verdict of each fitted parameter; none is called identified by data
            that the model does not explain.
        cost: weighted sum of squared log differences at the end (Huynh et al. 2021, Eq. 22).
        start_cost: the same before.
        cost_history: best cost after each evaluation, (E,).
        evaluations: how often residual and Jacobian were computed, in both passes.
        noise: estimated relative noise of the responses (standard deviation of one real part of ln H).
        status: "converged", "limit" or "interrupted".
        message: the solver's own words.
        doubts: what speaks against trusting verdicts and intervals, in full sentences; empty if nothing does.
        duration_s: from call to return, wall clock.
        measurements: what was fitted.
        postures: label of each measurement's posture, once each.
        before: modes before, one per entry of `postures`.
        after: modes after.
        mac: mass-weighted MAC of modes before (rows) and after (columns), one matrix per posture.
        frf_before: model responses before, one per measurement, in its kind and lines.
        frf_after: model responses after.
    """

    start: Robot
    parameters: tuple[FittedParameter, ...]
    cost: float
    start_cost: float
    cost_history: Array
    evaluations: int
    noise: float
    status: Status
    message: str
    doubts: tuple[str, ...]
    duration_s: float
    measurements: tuple[Measurement, ...]
    postures: tuple[str, ...]
    before: tuple[Modes, ...]
    after: tuple[Modes, ...]
    mac: tuple[Array, ...]
    frf_before: tuple[Frf, ...]
    frf_after: tuple[Frf, ...]

    @cached_property
    def robot(self) -> Robot:
        """The description with the fitted numbers, comments kept."""
        return self.start.with_values({p.path: p.value for p in self.parameters})

    def __repr__(self) -> str:
        """How it ended and what it found, in one line."""
        verdicts = Counter(p.verdict for p in self.parameters)
        found = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        cost = f"cost {self.start_cost:.4g} -> {self.cost:.4g} in {self.evaluations} evaluations"
        return f"Fit({self.status}, {cost}, {len(self.parameters)} parameters: {found})"


def update(
    robot: Robot,
    measurements: Measurement | Sequence[Measurement],
    *,
    parameters: str | Iterable[str] = "elasticity",
    bounds: Bounds | None = None,
    tolerance: float = 1e-10,
    max_evaluations: int = 1000,
    progress: Callable[[int, float], None] | None = None,
) -> Fit:
    """Fits elastic parameters to measured frequency responses.

    Minimizes Σ W |ln H_s − ln H|², the phase difference taken to its principal value (Huynh et al. 2021, Eq. 22), by
    bounded trust-region least squares on the logarithms of the parameters, with the analytic Jacobian. Emphasis on
    peaks makes it easy to get stuck, so where the weights have any, a first, coarse pass goes without it
    (`benches/success_rate.py` measures what that is worth). Ctrl-C ends the run and keeps the best so far.

    Args:
        robot: start values, and bounds where its file gives them.
        measurements: one or more; all are fitted with one set of parameters.
        parameters: paths, shell patterns or groups: "elasticity", "stiffness", "links.arm.elasticity.*.stiffness", ...
        bounds: (low, high) by path or pattern, within those of the file; a factor of a thousand either way where
            neither gives any.
        tolerance: relative change of cost and step at which the fit has converged, from 2.2e-16 to 1.
        max_evaluations: limit on residual evaluations, both passes together.
        progress: called with the number of evaluations and the best cost so far.

    Raises:
        UpdateError: parameters, bounds, weights, tolerance or limit are not valid.
        PostureError: a posture or frame does not fit the robot.
        ModelError: the model has no response at the start, or cannot have one that was measured.
    """
    begin = perf_counter()
    measurements = (measurements,) if isinstance(measurements, Measurement) else tuple(measurements)
    strange = [m for m in measurements if not isinstance(m, Measurement)]
    if strange or not measurements:
        found = f"a {type(strange[0]).__name__}" if strange else "none"
        raise UpdateError("measurements", found=found, expected="at least one Measurement(frf, posture=..., frame=...)")
    if not SMALLEST_TOLERANCE <= tolerance < 1:
        raise UpdateError("tolerance", found=f"{tolerance}", expected=f"a number from {SMALLEST_TOLERANCE:.1e} to 1")
    if not max_evaluations >= 1:
        raise UpdateError("max_evaluations", found=f"{max_evaluations}", expected="at least 1")
    models = [linearize(robot, m.posture) for m in measurements]
    chosen = choose(robot, models[0].impedances, parameters, bounds)
    refuse_loaded(chosen, {name for model in models for name in model.loaded})
    weights = [m.line_weights() for m in measurements]
    frf_before = tuple(_like(m, model) for m, model in zip(measurements, models, strict=True))
    for m, model, weight in zip(measurements, models, weights, strict=True):
        _refuse_absent(m, model, weight)
    free = [p.index for p in chosen]
    theta = np.concatenate([models[0].spring, models[0].damper])
    problem = _problem(measurements, models, weights)
    objective = Objective(problem, theta, free, progress=progress, limit=max_evaluations)
    even = [levelled(w) for w in weights]
    emphasis = not all(np.array_equal(a, b) for a, b in zip(weights, even, strict=True))
    run = minimize(
        objective,
        np.array([p.start for p in chosen]),
        np.array([p.lower for p in chosen]),
        np.array([p.upper for p in chosen]),
        tolerance=tolerance,
        levelled=_problem(measurements, models, even, prices=weights) if emphasis else None,
    )
    values = np.array([_rounded(v, p) for p, v in zip(chosen, run.values, strict=True)])
    fitted, noise = _judged(measurements, models, weights, objective, chosen, values)
    theta[free] = values
    after = [model.with_impedances(*theta.reshape(2, -1)) for model in models]
    first = {model.posture: i for i, model in reversed(list(enumerate(models)))}
    order = sorted(first.values())
    modes_before, modes_after = (tuple(modes(side[i]) for i in order) for side in (models, after))
    frf_after = tuple(_like(m, model) for m, model in zip(measurements, after, strict=True))
    doubtful, explained = doubts(measurements, frf_after, weights, noise)
    if not explained:
        fitted = tuple(replace(p, verdict="weak") if p.verdict == "identified" else p for p in fitted)
    return Fit(
        start=robot,
        parameters=fitted,
        cost=run.cost,
        start_cost=float(run.history[0]),
        cost_history=run.history,
        evaluations=len(run.history),
        noise=noise,
        status=run.status,
        message=run.message,
        doubts=doubtful,
        measurements=measurements,
        postures=tuple(models[i].posture for i in order),
        before=modes_before,
        after=modes_after,
        mac=tuple(mac(a, b) for a, b in zip(modes_before, modes_after, strict=True)),
        frf_before=frf_before,
        frf_after=frf_after,
        duration_s=perf_counter() - begin,
    )


def _rounded(value: float, parameter: Parameter) -> float:
    """Twelve significant digits, within the bounds; what the fit left alone keeps its own."""
    if value == parameter.start:
        return parameter.start
    return min(max(float(f"{value:.12g}"), parameter.lower), parameter.upper)


def _refuse_absent(m: Measurement, model: LinearModel, weight: Array) -> None:
    """Raises a ModelError for a response that the model cannot have, as across the plane of a planar robot.

    It comes out as zero, or as what rounding leaves of it, whatever the parameters; its logarithm means nothing.
    """
    watched, hit = model.jacobian(m.frame), model.jacobian(m.frf.input_frame or m.frame)
    reach_out, reach_in = (np.repeat(np.abs(J).reshape(2, 3, -1).max(axis=1), 3, axis=0) for J in (watched, hit))
    rows, columns = ([AXES.index(axis) for axis in axes] for axes in (m.frf.outputs, m.frf.inputs))
    used = np.flatnonzero((weight > 0).any(axis=(1, 2)))
    s = 2j * np.pi * m.frf.freq_hz[used[[0, len(used) // 2, -1]], None, None]
    try:
        X = np.linalg.inv(s**2 * model.mass + s * model.damping + model.stiffness)
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


def _problem(
    measurements: Sequence[Measurement],
    models: Sequence[LinearModel],
    weights: Sequence[Array],
    *,
    prices: Sequence[Array] | None = None,
) -> _core.Problem:
    """The core's residual under some weights, and its price under others (the same if not given).

    The factor (iω)^p of the kind cancels in a log difference, so receptances are compared.
    """
    targets, told = [], []
    for m, model, weight, price in zip(measurements, models, weights, prices or weights, strict=True):
        power = {"receptance": 0, "mobility": 1, "accelerance": 2}[m.frf.kind]
        points = 2j * np.pi * m.frf.freq_hz
        kept = (points != 0) | (power == 0)
        values = m.frf.values[kept] / (points[kept] ** power)[:, None, None]
        core = system(model, m.frame, m.frf.outputs, m.frf.inputs, input_frame=m.frf.input_frame)
        targets.append((core, points[kept], values, weight[kept]))
        told.append(price[kept])
    try:
        return _core.Problem(targets, prices=told)
    except ValueError as error:
        raise UpdateError(
            "measurements", found=str(error), expected="responses of ordinary size, in SI units"
        ) from None


def _judged(
    measurements: Sequence[Measurement],
    models: Sequence[LinearModel],
    weights: Sequence[Array],
    objective: Objective,
    chosen: tuple[Parameter, ...],
    values: Array,
) -> tuple[tuple[FittedParameter, ...], float]:
    """Verdicts, and the noise that the residual left by the fit speaks of."""
    used = [(w > 0).astype(float) for w in weights]
    equal, squared = (
        Objective(_problem(measurements, models, w), objective.theta, objective.free).triangle(values)
        for w in (used, [w**2 for w in weights])
    )
    freedom = int(2 * sum(w.sum() for w in used)) - len(chosen)
    noise = float(np.sqrt(np.sum(equal[:, -1] ** 2) / max(freedom, 1)))
    return judge(chosen, values, objective.triangle(values), squared, noise=noise, freedom=freedom), noise


def _like(m: Measurement, model: LinearModel) -> Frf:
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
