"""Bounded least squares over the triangles of any residual: what the core does for its own, for those that Python has.

The method is that of core/src/least_squares.rs. SciPy's trust region does not serve: where parameters are not
determined, as masses often are not, its steps stay on the surface of the ball and it crawls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Watch: TypeAlias = Callable[[int, float], object]

Ending = Literal["converged", "limit", "interrupted"]

UNSEEN = 1e-11
"""A column of the Jacobian, or a direction, below this share of the largest is rounding: the data do not see it, and
the parameter is left where it is instead of being steered by noise."""
FIRST_RADIUS = 1.0
"""The first step changes no parameter by more than a factor of e."""
ON_SURFACE = 0.1
"""How near to the ball's surface a step must end."""
DAMPINGS = 20
"""Trials of the damping before the step is cut."""
HOLDINGS = 6
"""Most often that parameters are put on their bounds within one step."""


@dataclass(frozen=True)
class Descent:
    """Where one stage of a fit ended.

    Attributes:
        x: its lowest point, (c,).
        cost: the cost there.
        best: the point of the lowest price on the way, (c,).
        price: that price: the cost under the weights that were asked for; of a stage that has no other, its own cost.
        history: lowest price after each evaluation, (E,).
        ending: "converged", "limit" or "interrupted".
    """

    x: Array
    cost: float
    best: Array
    price: float
    history: Array
    ending: Ending


def descend(
    triangle: Callable[[Array], Array],
    start: Array,
    lower: Array,
    upper: Array,
    *,
    tolerance: float,
    evaluations: int,
    watch: Watch | None,
) -> Descent:
    """Minimizes the cost of triangles within bounds.

    Args:
        triangle: R with RᵀR = [J r]ᵀ[J r] at x, (c+1, c+1); an ArithmeticError says that there is no answer.
        start: x to start from, (c,); outside of the bounds it is put on them.
        lower: bounds, (c,).
        upper: bounds, (c,).
        tolerance: relative change of the cost, and of x, at which the run has converged.
        evaluations: most of them.
        watch: gets evaluations and lowest cost after each of them; a KeyboardInterrupt from it ends the run.
    """
    x = candidate = np.clip(start, lower, upper)
    cost, history = np.inf, list[float]()
    here: Array | None = None
    radius, promised = FIRST_RADIUS, 0.0
    ending: Ending = "limit"
    try:
        while len(history) < evaluations:
            there = _answer(triangle, candidate)
            reached = np.inf if there is None else float(np.sum(there[:, -1] ** 2))
            length = float(np.linalg.norm(candidate - x))
            gain, settled = 0.0, False
            if here is None:
                if there is not None:
                    cost, here = reached, there
            else:
                gain = (cost - reached) / promised
                if there is not None and gain > 1e-4:
                    settled = gain > 0.25 and cost - reached <= tolerance * cost
                    x, cost, here = candidate, reached, there
                radius = _next_radius(radius, gain, length)
            history.append(cost)
            if watch is not None:
                watch(len(history), cost)
            if here is None:  # no answer at the start
                break
            if settled:
                ending = "converged"
                break
            step = _step(here[:, :-1], here[:, -1], x, lower, upper, radius)
            promised = cost - float(np.sum((here[:, -1] + here[:, :-1] @ step) ** 2))
            shortest = tolerance * (tolerance + float(np.linalg.norm(x)))
            if np.linalg.norm(step) <= shortest or not promised > np.finfo(float).eps * tolerance * cost:
                ending = "converged"
                break
            candidate = np.clip(x + step, lower, upper)
    except KeyboardInterrupt:
        ending = "interrupted"
    return Descent(x, cost, x, cost, np.array(history), ending)


def _answer(triangle: Callable[[Array], Array], x: Array) -> Array | None:
    try:
        found = triangle(x)
    except ArithmeticError:
        return None
    return found if np.isfinite(found).all() else None


def _next_radius(radius: float, gain: float, length: float) -> float:
    if gain > 0.75:
        return max(radius, 2 * length)
    if gain > 0.25:
        return radius
    return (0.5 if gain > 0 else 0.25) * length


def _step(J: Array, r: Array, x: Array, lower: Array, upper: Array, radius: float) -> Array:
    """The step within the ball and the bounds: what it would carry through a bound is put on it and held."""
    gradient, step = J.T @ r, np.zeros(len(x))
    pushed_out = ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))
    free = np.flatnonzero((gradient != 0) & ~pushed_out)
    for _ in range(HOLDINGS):
        if not len(free):
            break
        held = step.copy()
        held[free] = 0.0
        rest = max(np.sqrt(max(radius**2 - float(held @ held), 0.0)), 0.1 * radius)
        aim = x[free] + _within_ball(J[:, free], r + J @ held, rest)
        inside = np.clip(aim, lower[free], upper[free])
        step[free] = inside - x[free]
        if (inside == aim).all():
            break
        free = free[inside == aim]
    return step


def _within_ball(J: Array, r: Array, radius: float) -> Array:
    """Argmin |r + J p| over |p| ≤ radius, by the singular values of J."""
    left, sizes, right = np.linalg.svd(J, full_matrices=False)
    seen = sizes > UNSEEN * sizes.max(initial=0.0)
    sizes, right, target = sizes[seen], right[seen], -(left.T @ r)[seen]
    part, damping = target / sizes, 0.0
    length = float(np.linalg.norm(part))
    for _ in range(DAMPINGS):
        if length <= radius * (1 + ON_SURFACE):
            break
        slope = float(np.sum(part**2 / (sizes**2 + damping)))  # Newton's step on 1/|p|, from below (Moré 1978)
        damping += (length - radius) / radius * length**2 / slope
        part = sizes * target / (sizes**2 + damping)
        length = float(np.linalg.norm(part))
    step: Array = right.T @ (part if length <= radius * (1 + ON_SURFACE) else part * (radius / length))
    return step
