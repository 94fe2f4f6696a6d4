"""What the data determine: an interval and a verdict for every fitted parameter, from the Jacobian at the solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.special import stdtrit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]

Verdict = Literal["identified", "weak", "not identifiable", "at bound"]

IDENTIFIED_FACTOR = 1.25
"""A 95 % interval within this factor of the value counts as identified."""
WEAK_FACTOR = 3.0
"""Within this factor as weak; what is wider the data do not determine."""
OPEN = np.log(1e6)
"""An interval wider than this says nothing and is given as (0, inf)."""
NULL_DIRECTION = 1e-9
"""Singular values, and whole columns, below this share of the largest are what rounding leaves of a direction that the
data do not see at all."""


@dataclass(frozen=True)
class FittedParameter:
    """One parameter of a fit.

    Attributes:
        path: where it stands in the description.
        unit: its SI unit.
        start: value before.
        value: value after.
        lower: lower bound.
        upper: upper bound.
        interval: 95 % interval (low, high); (0, inf) where the data say nothing.
        verdict: "identified" (interval within 25 %), "weak" (within a factor of three), "not identifiable", or "at
            bound".
    """

    path: str
    unit: str
    start: float
    value: float
    lower: float
    upper: float
    interval: tuple[float, float]
    verdict: Verdict


def judge(
    parameters: tuple[Parameter, ...], values: Array, weighted: Array, squared: Array, *, noise: float, freedom: int
) -> tuple[FittedParameter, ...]:
    """Intervals and verdicts.

    The weights of a fit say where to look, not how noisy the data are. So the covariance is that of weighted least
    squares under equal relative noise, σ² A⁻¹ B A⁻¹ with A = JᵀWJ and B = JᵀW²J (the sandwich), J by the logarithms.
    Parameters at a bound take part as if they could move: what they might trade against is not known any better.

    Args:
        parameters: what was fitted, c of them.
        values: where it ended, (c,).
        weighted: triangle of [J r] under the weights W, (c+1, c+1).
        squared: the same under W².
        noise: standard deviation σ of one real part of a log response.
        freedom: degrees of freedom behind σ.
    """
    gradient = weighted[:, :-1].T @ weighted[:, -1]
    lower = np.array([p.lower for p in parameters])
    upper = np.array([p.upper for p in parameters])
    touching = [np.log(values / lower) < 1e-3, np.log(upper / values) < 1e-3]
    bound = (touching[0] & (gradient >= 0)) | (touching[1] & (gradient <= 0))
    spread = _standard_deviations(weighted[:, :-1], squared[:, :-1])
    # Without any noise, too, what the data do not see stays open: infinity times more than zero.
    reach = spread * max(noise, np.finfo(float).tiny) * float(stdtrit(max(freedom, 1), 0.975))
    if freedom < 1:  # as many parameters as data: no residual is left to tell the noise
        reach = np.full(len(values), np.inf)

    def one(i: int) -> FittedParameter:
        p, value, half = parameters[i], float(values[i]), float(reach[i])
        interval = (value * np.exp(-half), value * np.exp(half)) if half < OPEN else (0.0, np.inf)
        verdict: Verdict = "not identifiable"
        if bound[i]:
            verdict = "at bound"
        elif half <= np.log(IDENTIFIED_FACTOR):
            verdict = "identified"
        elif half <= np.log(WEAK_FACTOR):
            verdict = "weak"
        return FittedParameter(
            p.path, p.unit, p.start, value, p.lower, p.upper, (float(interval[0]), float(interval[1])), verdict
        )

    return tuple(one(i) for i in range(len(values)))


def _standard_deviations(weighted: Array, squared: Array) -> Array:
    """Square roots of diag(A⁺ B A⁺) for A = WᵀW, B = SᵀS; infinite along directions that A does not see."""
    scale = np.linalg.norm(weighted, axis=0)
    seen = scale > NULL_DIRECTION * scale.max()
    out = np.full(weighted.shape[1], np.inf)
    if not seen.any():
        return out
    scale = scale[seen]
    _, sizes, right = np.linalg.svd(weighted[:, seen] / scale, full_matrices=False)
    kept = sizes > NULL_DIRECTION * sizes[0]
    inverse = (right[kept].T / sizes[kept] ** 2) @ right[kept]
    deviation = np.linalg.norm((squared[:, seen] / scale) @ inverse, axis=0) / scale
    blind = np.abs(right[~kept]).max(axis=0, initial=0.0) > 1e-3
    out[seen] = np.where(blind, np.inf, deviation)
    return out
