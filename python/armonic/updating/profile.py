"""Profile likelihood: how the fit worsens as one parameter is moved and all others follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import UpdateError
from armonic.updating.bands import student

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
        values: SI, rising, (k,); the fitted one is among them.
        rise: of −2 ln likelihood above its minimum, (k,).
        threshold: rise at the ends of the 95 % interval.
        interval: where the profile crosses the threshold, SI; a bound (or 0 and infinity, if the profile ends below the
            threshold) where it does not.
        unit: of the parameter.
    """

    path: str
    values: Array
    rise: Array
    threshold: float
    interval: tuple[float, float]
    unit: str = ""


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
    walk = _Walk(residual, index, *task.box)
    x0 = np.array([q.coordinate(f.value) for q, f in zip(fit.coordinates, fit.parameters, strict=True)])
    x0, least = walk.free(x0)
    spread = np.linalg.pinv(fit.information, hermitian=True)[index, index]
    half = np.sqrt(threshold * max(spread, 0.0))
    step = min(half / PER_HALF_WIDTH, WIDEST) if half > 0 else WIDEST
    points = {float(x0[index]): 0.0}
    ends = []
    for side in (-1.0, 1.0):
        x, inner, end = x0, (float(x0[index]), 0.0), None
        for k in range(1, STEPS + 1):
            far = np.inf if k == STEPS else step * k  # the last step goes to the bound
            wanted = float(np.clip(x0[index] + side * far, walk.lower[index], walk.upper[index]))
            if wanted == inner[0]:
                break
            x, cost = walk.held(x, wanted)
            rise = max((cost - least) / known, 0.0)
            points[wanted] = rise
            if rise >= threshold and end is None:
                a, b = np.sqrt(inner[1]), np.sqrt(rise)
                end = inner[0] + (wanted - inner[0]) * (np.sqrt(threshold) - a) / (b - a)
            inner = (wanted, rise)
            if rise > BEYOND * threshold:
                break
        ends.append(end)
    at = np.array(sorted(points))
    low, high = (p.value(end) if end is not None else None for end in ends)
    reached = walk.lower[index] in points, walk.upper[index] in points
    return Profile(
        path,
        np.array([p.value(x) for x in at]),
        np.array([points[x] for x in at]),
        threshold,
        (
            low if low is not None else p.lower if reached[0] else (0.0 if p.scale == "log" else -np.inf),
            high if high is not None else p.upper if reached[1] else np.inf,
        ),
        p.unit,
    )


class _Walk:
    """Fits of all parameters but one, each from where the last ended."""

    def __init__(self, residual: Descending, index: int, lower: Array, upper: Array) -> None:
        self.residual, self.index, self.lower, self.upper = residual, index, lower, upper

    def free(self, x: Array) -> tuple[Array, float]:
        """All of them, the one as well."""
        return self._descend(x, self.lower, self.upper)

    def held(self, x: Array, value: float) -> tuple[Array, float]:
        """The one at a value."""
        lower, upper, start = self.lower.copy(), self.upper.copy(), x.copy()
        lower[self.index], upper[self.index], start[self.index] = value - HELD, value + HELD, value
        return self._descend(start, lower, upper)

    def _descend(self, x: Array, lower: Array, upper: Array) -> tuple[Array, float]:
        end = self.residual.descend(x, lower, upper, tolerance=TOLERANCE, evaluations=EVALUATIONS, watch=None)
        return end.x, end.cost
