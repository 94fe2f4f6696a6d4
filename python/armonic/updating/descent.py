"""Bounded least squares by the core's trust region, over the triangles of any residual, and where it ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic import _core

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Watch: TypeAlias = Callable[[int, float], object]

Ending = Literal["converged", "limit", "interrupted"]

FIRST_RADIUS = 1.0
"""The first step changes no parameter by more than a factor of e."""


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

    SciPy's trust region does not serve: where parameters are not determined, as masses often are not, its steps stay on
    the surface of the ball and it crawls.

    Args:
        triangle: R with RᵀR = [J r]ᵀ[J r] at x, (c+1, c+1); an ArithmeticError says that there is no answer.
        start: x to start from, (c,); outside of the bounds it is put on them.
        lower: bounds, (c,).
        upper: bounds, (c,).
        tolerance: relative change of the cost, and of x, at which the run has converged.
        evaluations: most of them.
        watch: gets evaluations and lowest cost before each of them; a KeyboardInterrupt from it ends the run.
    """
    return Descent(
        *_core.descend(
            triangle,
            np.asarray(start, np.float64),
            lower,
            upper,
            tolerance=tolerance,
            evaluations=evaluations,
            radius=FIRST_RADIUS,
            watch=watch,
        )
    )
