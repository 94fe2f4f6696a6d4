"""Bounded least squares on the logarithms of the parameters, fed by the core's small triangle, in two passes."""

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

UNSEEN = 1e-11
"""A column of the Jacobian below this share of the largest is rounding: the data do not see that parameter, and it is
left where it started instead of being steered by noise."""
FIRST_TOLERANCE = 1e-5
"""How far the pass under levelled weights goes: near enough for the peaks to lie over each other, and no further."""


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


class EvaluationsUsedUpError(Exception):
    """No evaluation is left."""


class Objective:
    """The cost of a parameter set: values of the free parameters in, the triangle of [J r] out, the best remembered."""

    def __init__(
        self,
        problem: _core.Problem,
        theta: Array,
        free: list[int],
        *,
        progress: Callable[[int, float], None] | None = None,
        limit: int = 1000,
    ) -> None:
        """`theta` holds all stiffnesses, then all dampings; `free` says which of them change."""
        self.problem, self.theta, self.free, self.progress, self.limit = problem, theta, free, progress, limit
        self.best = (np.inf, np.log(theta[free]))
        self.history: list[float] = []
        self._last: tuple[_core.Problem, Array, Array] | None = None

    def triangle(self, values: Array, problem: _core.Problem | None = None) -> Array:
        """Upper triangle R of [J r], (c+1, c+1), J by the logarithms of the free parameters.

        Args:
            values: of the free parameters, (c,).
            problem: another residual than the one whose cost counts.

        Raises:
            ArithmeticError: the response is zero or infinite there.
        """
        return self._priced(values, problem or self.problem)[0]

    def _priced(self, values: Array, problem: _core.Problem) -> tuple[Array, float]:
        triangle, price = problem.reduce_priced(*self._impedances(values), self.free)
        size = np.linalg.norm(triangle[:, :-1], axis=0)
        triangle[:, :-1][:, size <= UNSEEN * size.max(initial=0.0)] = 0.0
        return triangle, price

    def evaluate(self, logarithms: Array, problem: _core.Problem) -> Array:
        """The triangle of a problem, remembered until the next point; infinite where the model has no answer.

        What counts as the best, and what the history holds, is the price of the problem: the cost under the weights
        that were asked for, whichever weights the pass works with.

        Raises:
            EvaluationsUsedUpError: no evaluation is left.
        """
        if self._last is not None and self._last[0] is problem and np.array_equal(self._last[1], logarithms):
            return self._last[2]
        if len(self.history) >= self.limit:
            raise EvaluationsUsedUpError
        values = np.exp(logarithms)
        try:
            triangle, cost = self._priced(values, problem)
        except ArithmeticError:
            triangle, cost = np.full((len(values) + 1,) * 2, np.inf), np.inf
        if cost < self.best[0]:
            self.best = (cost, logarithms.copy())
        self.history.append(self.best[0])
        self._last = (problem, logarithms.copy(), triangle)
        if self.progress is not None:
            self.progress(len(self.history), self.best[0])
        return triangle

    def _impedances(self, values: Array) -> tuple[Array, Array]:
        theta = self.theta.copy()
        theta[self.free] = values
        stiffness, damping = theta.reshape(2, 1, -1)
        return stiffness, damping


def minimize(
    objective: Objective,
    start: Array,
    lower: Array,
    upper: Array,
    *,
    tolerance: float,
    levelled: _core.Problem | None = None,
) -> Run:
    """Bounded trust-region least squares (SciPy) on the logarithms; Ctrl-C keeps the best so far.

    High weights on the lines around measured peaks make hills between the peaks of the model and those of the
    measurement, and a run that starts among them gets stuck. So a first, coarse pass minimizes the `levelled` problem,
    and the run proper starts where that ends. Should a point on the way have been better than its end, it goes on from
    there.

    Args:
        objective: the cost.
        start: values to start from, (c,).
        lower: bounds, (c,).
        upper: bounds, (c,).
        tolerance: relative change of cost and step at which the run has converged.
        levelled: the same residuals without emphasis, if the objective has any.

    Raises:
        ModelError: the model has no answer at the start.
    """
    box = (np.log(lower), np.log(upper))

    def descend(problem: _core.Problem, x: Array, tolerance: float) -> tuple[Array, float, str]:
        def residual(x: Array) -> Array:
            return objective.evaluate(x, problem)[:, -1]

        def jacobian(x: Array) -> Array:
            return objective.evaluate(x, problem)[:, :-1]

        solution = least_squares(
            residual,
            x,
            jac=jacobian,
            bounds=box,
            xtol=tolerance,
            ftol=tolerance,
            gtol=tolerance,
            max_nfev=objective.limit + 2,  # out of reach: the objective counts, over all passes
        )
        return solution.x, 2 * float(solution.cost), str(solution.message)

    status: Status = "interrupted"
    message = "stopped by the user"
    x = np.log(start)
    try:
        if not np.isfinite(objective.evaluate(x, objective.problem)).all():
            raise ModelError(
                "update", found="a response that is zero or infinite at the start", expected="another start"
            )
        if levelled is not None:
            x, _, _ = descend(levelled, x, max(tolerance, FIRST_TOLERANCE))
        _, cost, message = descend(objective.problem, x, tolerance)
        best, x = objective.best
        if best < (1 - tolerance) * cost:
            _, _, message = descend(objective.problem, x, tolerance)
        status = "converged"
    except EvaluationsUsedUpError:
        status, message = "limit", f"stopped after {objective.limit} evaluations"
    except KeyboardInterrupt:
        if not objective.history:
            raise
    cost, x = objective.best
    values = np.where(x == np.log(start), start, np.exp(x))  # what did not move keeps its digits
    return Run(np.clip(values, lower, upper), cost, np.array(objective.history), status, message)
