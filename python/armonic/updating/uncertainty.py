"""What the data determine: covariance, an interval and a verdict for every fitted parameter, from the Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.special import stdtrit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.updating.parameters import Parameter, Scale

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
        path: where it stands in the description; where several are tied, the first of them.
        unit: its SI unit.
        start: value before.
        value: value after.
        lower: lower bound.
        upper: upper bound.
        interval: 95 % interval (low, high); where the data say nothing (0, inf), or (-inf, inf) on a linear scale.
        verdict: "identified" (interval within 25 %), "weak" (within a factor of three), "not identifiable", or "at
            bound". Of a number that may be zero, shares are taken of its size or of a tenth of its bounds, whichever is
            larger, and "weak" is whatever the data narrow down within the bounds.
        scale: "log" where ln(value) was fitted, else "linear".
        deviation: standard deviation of x, that is of ln(value), or of the value in tenths of its bounds; infinite
            where the data say nothing.
        tied: all paths that have this value, where it is more than one.
    """

    path: str
    unit: str
    start: float
    value: float
    lower: float
    upper: float
    interval: tuple[float, float]
    verdict: Verdict
    scale: Scale = "log"
    deviation: float = np.inf
    tied: tuple[str, ...] = ()


def judge(
    parameters: Sequence[Parameter],
    values: Array,
    gradient: Array,
    covariance: Array,
    freedom: int,
) -> tuple[FittedParameter, ...]:
    """Intervals and verdicts.

    Parameters at a bound take part in the covariance as if they could move: what they might trade against is not known
    any better.

    Args:
        parameters: what was fitted, c of them.
        values: where it ended, (c,).
        gradient: Jᵀr there, (c,); says whether a bound holds a parameter.
        covariance: of x, (c, c); infinite on the diagonal where the data say nothing.
        freedom: degrees of freedom behind the noise; below one nothing is certain.
    """
    spread = np.sqrt(np.diag(covariance))
    reach = spread * float(stdtrit(max(freedom, 1), 0.975))
    if freedom < 1:  # as many parameters as data: no residual is left to tell the noise
        reach = np.full(len(values), np.inf)
    return tuple(
        _judged(p, float(values[i]), float(gradient[i]), float(spread[i]), float(reach[i]))
        for i, p in enumerate(parameters)
    )


def _judged(p: Parameter, value: float, gradient: float, spread: float, half: float) -> FittedParameter:
    at, low, high = (p.coordinate(v) for v in (value, p.lower, p.upper))
    inside = min(at - low, high - at)
    pushed = (at - low < 1e-3 and gradient >= 0) or (high - at < 1e-3 and gradient <= 0)
    bound = pushed or inside < 1e-9  # a minimum that lies on the bound leaves a gradient of rounding
    if p.scale == "log":
        interval = (value * np.exp(-half), value * np.exp(half)) if half < OPEN else (0.0, np.inf)
        identified, weak = half <= np.log(IDENTIFIED_FACTOR), half <= np.log(WEAK_FACTOR)
    else:
        interval = (value - half * p.size, value + half * p.size) if half < np.exp(OPEN) else (-np.inf, np.inf)
        identified = half * p.size <= (IDENTIFIED_FACTOR - 1) * max(abs(value), p.size)
        weak = half * p.size <= (p.upper - p.lower) / 2
    verdict: Verdict = "not identifiable"
    if bound:
        verdict = "at bound"
    elif identified:
        verdict = "identified"
    elif weak:
        verdict = "weak"
    return FittedParameter(
        p.path,
        p.unit,
        p.start,
        value,
        p.lower,
        p.upper,
        (float(interval[0]), float(interval[1])),
        verdict,
        p.scale,
        spread,
        p.paths if len(p.paths) > 1 else (),
    )


def covariance_of(weighted: Array, scatter: Array) -> Array:
    """Covariance A⁺ B A⁺ of x for A = WᵀW, B = SᵀS, (c, c).

    The weights of a fit say where to look, not how noisy the data are. So the covariance is that of weighted least
    squares under the noise as it is (the sandwich): with weights W and rows of standard deviation σ, A = JᵀWJ and
    B = σ² JᵀW²J.

    Args:
        weighted: rows whose squares are A, (R, c).
        scatter: rows whose squares are B, (S, c).

    Returns:
        Infinite variance, and covariances of zero, for parameters that a direction runs through which A does not see.
    """
    count = weighted.shape[1]
    scale = np.linalg.norm(weighted, axis=0)
    seen = scale > NULL_DIRECTION * scale.max(initial=0.0)
    out = np.diag(np.full(count, np.inf))
    if not seen.any():
        return out
    scale = scale[seen]
    _, sizes, right = np.linalg.svd(weighted[:, seen] / scale, full_matrices=False)
    kept = sizes > NULL_DIRECTION * sizes[0]
    inverse = (right[kept].T / sizes[kept] ** 2) @ right[kept]
    spread = (scatter[:, seen] / scale) @ inverse / scale
    unseen = np.eye(int(seen.sum())) - right[kept].T @ right[kept]
    blind = np.sqrt(np.maximum(np.diag(unseen), 0.0)) > 1e-3
    block = spread.T @ spread
    block[blind], block[:, blind] = 0.0, 0.0
    block[blind, blind] = np.inf
    out[np.ix_(seen, seen)] = block
    return out
