"""One least-squares run on the logarithms of the parameters, fed by the core's small triangle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.optimize import least_squares

from armonic.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from armonic import _core

    Array: TypeAlias = NDArray[np.float64]

Status = Literal["converged", "limit", "interrupted"]


@dataclass(frozen=True)
class Run:
    """Where a least-squares run ended.

    Attributes:
        values: best parameter values, (c,).
        cost: their cost (Huynh et al. 2021, Eq. 22).
        history: best cost after each evaluation, (E,).
        status: "converged", "limit" (evaluations used up) or "interrupted" (Ctrl-C).
        message: the solver's own words.
    """

    values: Array
    cost: float
    history: Array
    status: Status
    message: str


class Objective:
    """The cost of a parameter set: values of the free parameters in, the triangle of [J r] out, the best remembered."""

    def __init__(
        self,
        problem: _core.Problem,
        theta: Array,
        free: list[int],
        progress: Callable[[int, float], None] | None = None,
    ) -> None:
        """`theta` holds all stiffnesses, then all dampings; `free` says which of them change."""
        self.problem, self.theta, self.free, self.progress = problem, theta, free, progress
        self.best = (np.inf, theta[free])
        self.history: list[float] = []
        self._last: tuple[Array, Array] | None = None

    def triangle(self, values: Array) -> Array:
        """Upper triangle R of [J r], (c+1, c+1), J by the logarithms of the free parameters.

        Raises:
            ArithmeticError: the response is zero or infinite there.
        """
        theta = self.theta.copy()
        theta[self.free] = values
        stiffness, damping = theta.reshape(2, 1, -1)
        return self.problem.reduce(stiffness, damping, self.free)

    def __call__(self, logarithms: Array) -> Array:
        """The triangle, remembered until the next point; infinite where the model has no answer."""
        if self._last is not None and np.array_equal(self._last[0], logarithms):
            return self._last[1]
        values = np.exp(logarithms)
        try:
            triangle = self.triangle(values)
        except ArithmeticError:
            triangle = np.full((len(values) + 1,) * 2, np.inf)
        cost = float(np.sum(triangle[:, -1] ** 2))
        if cost < self.best[0]:
            self.best = (cost, values)
        self.history.append(self.best[0])
        self._last = (logarithms.copy(), triangle)
        if self.progress is not None:
            self.progress(len(self.history), self.best[0])
        return triangle


def minimize(
    objective: Objective, start: Array, lower: Array, upper: Array, *, tolerance: float, max_evaluations: int
) -> Run:
    """Bounded trust-region least squares (SciPy) on the logarithms; Ctrl-C keeps the best so far.

    Args:
        objective: the cost.
        start: values to start from, (c,).
        lower: bounds, (c,).
        upper: bounds, (c,).
        tolerance: relative change of cost and step at which the run has converged.
        max_evaluations: limit.

    Raises:
        ModelError: the model has no answer at the start.
    """
    status: Status = "interrupted"
    message = "stopped by the user"
    try:
        if not np.isfinite(objective(np.log(start))).all():
            raise ModelError("update", found="a response that is zero or infinite at the start", expected="another start")
        solution = least_squares(
            lambda x: objective(x)[:, -1],
            np.log(start),
            jac=lambda x: objective(x)[:, :-1],
            bounds=(np.log(lower), np.log(upper)),
            xtol=tolerance,
            ftol=tolerance,
            gtol=tolerance,
            max_nfev=max_evaluations,
        )
        status = "converged" if solution.status > 0 else "limit"
        message = str(solution.message)
    except KeyboardInterrupt:
        if not objective.history:
            raise
    cost, values = objective.best
    return Run(np.clip(values, lower, upper), cost, np.array(objective.history), status, message)
