"""What a fit may be trusted with: noise, covariance, information and verdicts at the point where it ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.updating.residuals import stacked
from armonic.updating.uncertainty import FittedParameter, covariance_of, judge

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.response import Frf
    from armonic.updating.measurement import Loss
    from armonic.updating.task import Task

    Array: TypeAlias = NDArray[np.float64]

TUNING = {"huber": 1.345, "cauchy": 2.385}
"""Residuals, in standard deviations, from which on a value counts less: 95 % efficient where there are no outliers."""
STATED = 10**6
"""Degrees of freedom behind a noise that was stated."""
LEAST_NOISE = 1e-150
"""Without any noise, too, what the data do not see stays open: infinity times more than zero."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is known at the end of a fit.

    Attributes:
        parameters: intervals and verdicts.
        noise: standard deviation of one real part of a log response of ordinary precision; without responses, of the
            differences of modes over their stated deviations.
        covariance: of x, (c, c).
        information: JᵀJ/noise² of what was used, under equal weights, with what modes and priors add, (c, c).
        freedom: degrees of freedom behind the noise.
    """

    parameters: tuple[FittedParameter, ...]
    noise: float
    covariance: Array
    information: Array
    freedom: int


def judged(
    task: Task,
    x: Array,
    values: Array,
    weights: Sequence[Array],
    precision: Sequence[Array],
    anchored: float,
    noise: float | None = None,
) -> Judgement:
    """Noise, covariance and verdicts at a solution.

    Args:
        task: what was fitted.
        x: where it ended, (c,).
        values: the same in SI, rounded, (c,).
        weights: of the cost, those of a robust loss included.
        precision: relative inverse variance of every value, from its coherence.
        anchored: by which modes and priors counted beside responses.
        noise: of the responses, if a robust scale has told it; of their residuals if not given.
    """
    known, rows = _known(task, x)
    gradient_of = task.residual(weights, anchored=anchored, relative=task.relative).triangle(x)
    gradient = gradient_of[:, :-1].T @ gradient_of[:, -1]
    if not task.measurements:
        freedom = rows - len(x)
        noise = float(np.sqrt(np.sum(known[:, -1] ** 2) / max(freedom, 1)))
        widened = max(noise, 1.0)  # the deviations were stated; a residual below them does not shrink them
        covariance = covariance_of(known[:, :-1], widened * known[:, :-1])
        verdicts = judge(task.parameters, values, gradient, covariance, STATED if noise <= 1 else max(freedom, 1))
        return Judgement(verdicts, noise, covariance, known[:, :-1].T @ known[:, :-1] / widened**2, freedom)
    bare = task.bare
    used = [(w > 0).astype(float) for w in weights]
    equal = bare.residual([v * u for v, u in zip(precision, used, strict=True)]).triangle(x)
    freedom = int(2 * sum(u.sum() for u in used)) - len(x)
    if noise is None:
        noise = float(np.sqrt(np.sum(equal[:, -1] ** 2) / max(freedom, 1)))
    sigma = max(noise, LEAST_NOISE)
    weighted = bare.residual(weights).triangle(x)[:, :-1]
    spread = bare.residual([_over(w**2, v) for w, v in zip(weights, precision, strict=True)]).triangle(x)[:, :-1]
    blocks = np.sqrt(anchored) * known[:, :-1], anchored / sigma * known[:, :-1]
    covariance = sigma**2 * covariance_of(np.vstack([weighted, blocks[0]]), np.vstack([spread, blocks[1]]))
    information = equal[:, :-1].T @ equal[:, :-1] / sigma**2 + known[:, :-1].T @ known[:, :-1]
    verdicts = judge(task.parameters, values, gradient, covariance, freedom + (rows if rows else 0))
    return Judgement(verdicts, noise, covariance, information, freedom)


def _over(numerator: Array, precision: Array) -> Array:
    return np.where(precision > 0, numerator / np.where(precision > 0, precision, 1.0), 0.0)


def _known(task: Task, x: Array) -> tuple[Array, int]:
    """The triangle of rows over their stated deviations, those of modes and priors, (c+1, c+1), and how many rows."""
    blocks, rows = [task.anchors.rows(x)], len(task.anchors.indices)
    if task.modal:
        from armonic.updating.modal_data import ModalResidual

        J, r = ModalResidual(task.robot, task.modal, task.parameters).rows(x)
        blocks.append(np.column_stack([J, r]))
        rows += len(r)
    return stacked(*blocks), rows


def robust(
    frfs: Sequence[Frf], measured: Sequence[Frf], precision: Sequence[Array], loss: Loss
) -> tuple[list[Array], float]:
    """The factor on every weight under a robust loss, and the noise without those values that are far off.

    The noise is the median absolute deviation; a value's two parts share one factor (iteratively reweighted least
    squares, Holland and Welsch 1977).

    Args:
        frfs: of the model.
        measured: likewise.
        precision: relative inverse variance of every value; those of zero are left out of the noise.
        loss: "huber" or "cauchy".

    Returns:
        Factors, (L, outputs, inputs) per measurement, and the standard deviation of one real part of ln H.
    """
    sizes = []
    for model, data, v in zip(frfs, measured, precision, strict=True):
        ratio = np.divide(model.values, data.values, out=np.ones_like(data.values), where=data.values != 0)
        with np.errstate(divide="ignore"):
            size = np.sqrt(v / 2) * np.abs(np.log(np.abs(ratio)) + 1j * np.angle(ratio))
        sizes.append(np.where(np.isfinite(size), size, np.inf))
    used = np.concatenate([size[v > 0] for size, v in zip(sizes, precision, strict=True)])
    scale = float(np.median(used)) / 0.8326  # of a Rayleigh law, whose half squares have mean one
    if scale == 0:
        return [np.ones_like(size) for size in sizes], scale
    relative = [size / (scale * TUNING[loss]) for size in sizes]
    if loss == "huber":
        return [1 / np.maximum(size, 1.0) for size in relative], scale
    return [1 / (1 + size**2) for size in relative], scale
