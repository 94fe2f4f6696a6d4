"""Profile likelihood: how the fit worsens as one parameter is moved and all others follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import UpdateError
from armonic.updating.bands import student
from armonic.updating.design import deviations

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.updating.residuals import Descending
    from armonic.updating.result import Fit

    Array: TypeAlias = NDArray[np.float64]

STEPS = 20
"""Most steps to either side."""
PER_HALF_WIDTH = 4
"""Steps within the half width that the linear interval has."""
BEYOND = 1.3
"""The walk ends where the rise is this many times the threshold."""
REFINEMENTS = 12
"""Most fits to find where the rise crosses the threshold."""
NEAR = 0.005
"""How near to it, as a share, in the root of the rise."""
WIDEST = 0.5
"""Longest step in x: a parameter that is hardly determined is walked through in factors of 1.6."""
TOLERANCE = 1e-9
EVALUATIONS = 200
HELD = 1e-9
"""Half width of what holds the parameter in its place."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The profile of one parameter.

    Attributes:
        path: of the parameter.
        values: SI, rising, (k,); the best one is among them.
        rise: of −2 ln likelihood above its minimum, (k,).
        threshold: rise at the ends of the 95 % interval.
        interval: where the profile crosses the threshold, SI; a bound of the fit where it does not.
        unit: of the parameter.
        best: the value of the lowest point, SI; under peak weights not quite that of the fit.
    """

    path: str
    values: Array
    rise: Array
    threshold: float
    interval: tuple[float, float]
    unit: str = ""
    best: float = np.nan


def profile(fit: Fit, path: str) -> Profile:
    """The profile likelihood of one parameter under equal relative noise, of the size that the fit found.

    For every value of the parameter all others are fitted again; the sum of squares over the noise variance rises from
    its minimum by −2 ln of the likelihood ratio, and 95 % lie where that stays below Student's t squared (Venzon and
    Moolgavkar 1988). Unlike the interval of the fit this is right where the residual is far from linear. Peak weights
    do not enter: every value that the fit used counts by its precision alone.

    Args:
        fit: what `armonic.update` returned.
        path: of a fitted parameter.

    Raises:
        UpdateError: no such parameter, a fit without any noise, or as many parameters as data.
    """
    paths = [p.path for p in fit.coordinates]
    if path not in paths:
        raise UpdateError("profile", found=repr(path), expected=f"a fitted parameter, such as {paths[0]}")
    if not fit.noise > 0:
        raise UpdateError("profile", found="a residual of zero", expected="data with some noise")
    index, p = paths.index(path), fit.coordinates[paths.index(path)]
    task = fit.task
    known = fit.noise**2 if task.measurements else max(fit.noise, 1.0) ** 2
    weights = [m.precision() * (m.line_weights() > 0) for m in task.measurements]
    residual = replace(task, relative=False).residual(weights, anchored=known if task.measurements else 1.0)
    reach = student(fit)
    if reach is None:
        raise UpdateError("profile", found="as many parameters as data", expected="more data, which tell the noise")
    threshold = reach**2
    walk = _Walk(residual, index, *task.box, known)
    x0 = np.array([q.coordinate(f.value) for q, f in zip(fit.coordinates, fit.parameters, strict=True)])
    best = walk.begin(x0)
    # The bounds keep the first guess of the width finite where the data say nothing.
    weak = np.diag((2 * reach / (walk.upper - walk.lower)) ** 2)
    half = reach * float(deviations(fit.information + weak)[index])
    ends = [walk.to_side(side, min(half / PER_HALF_WIDTH, WIDEST), threshold) for side in (-1.0, 1.0)]
    at = np.array(sorted(walk.rises))
    low, high = (None if end is None else p.value(end) for end in ends)
    return Profile(
        path,
        np.array([p.value(x) for x in at]),
        np.array([walk.rises[x] for x in at]),
        threshold,
        (p.lower if low is None else low, p.upper if high is None else high),
        p.unit,
        p.value(best),
    )


class _Walk:
    """Fits of all parameters but one, each from where the nearest ended."""

    def __init__(self, residual: Descending, index: int, lower: Array, upper: Array, known: float) -> None:
        self.residual, self.index, self.lower, self.upper, self.known = residual, index, lower, upper, known
        self.rises: dict[float, float] = {}

    def begin(self, x: Array) -> float:
        """Fits all of them, the one as well; where that one ends."""
        self.x0, self.least = self._descend(x, self.lower, self.upper)
        self.best = float(self.x0[self.index])
        self.rises[self.best] = 0.0
        return self.best

    def to_side(self, side: float, step: float, threshold: float) -> float | None:
        """Where the rise crosses the threshold on one side, in x; None if it does not as far as the bound."""
        edge = float((self.lower if side < 0 else self.upper)[self.index])
        x, inner = self.x0, self.best
        for k in range(1, STEPS + 1):
            far = np.inf if k == STEPS else step * k
            wanted = float(np.clip(self.best + side * far, min(edge, self.best), max(edge, self.best)))
            if wanted == inner:
                return None
            before, x = x, self._hold(x, wanted)
            if self.rises[wanted] >= threshold:
                crossing = self._crossing(before, inner, wanted, threshold)
                if self.rises[wanted] < BEYOND * threshold:  # so that a picture shows it pass
                    self._hold(x, float(np.clip(wanted + side * step, min(edge, wanted), max(edge, wanted))))
                return crossing
            inner = wanted
        return None

    def _crossing(self, x: Array, inner: float, outer: float, threshold: float) -> float:
        """Between two points by regula falsi in √rise, which is nearly straight, halving where it is not."""
        goal = np.sqrt(threshold)
        guess = inner
        for k in range(REFINEMENTS):
            a, b = (np.sqrt(self.rises[end]) for end in (inner, outer))
            share = (goal - a) / (b - a) if k % 2 == 0 else 0.5
            guess = inner + (outer - inner) * float(share)
            if min(abs(guess - inner), abs(guess - outer)) <= HELD:
                break
            there = self._hold(x, guess)
            if abs(np.sqrt(self.rises[guess]) - goal) <= NEAR * goal:
                break
            if self.rises[guess] < threshold:
                x, inner = there, guess
            else:
                outer = guess
        return guess

    def _hold(self, x: Array, value: float) -> Array:
        """Fits all but the one, which is held at a value."""
        lower, upper, start = self.lower.copy(), self.upper.copy(), x.copy()
        lower[self.index], upper[self.index], start[self.index] = value - HELD, value + HELD, value
        x, cost = self._descend(start, lower, upper)
        self.rises[value] = max((cost - self.least) / self.known, 0.0)
        return x

    def _descend(self, x: Array, lower: Array, upper: Array) -> tuple[Array, float]:
        end = self.residual.descend(x, lower, upper, tolerance=TOLERANCE, evaluations=EVALUATIONS, watch=None)
        return end.x, end.cost
