"""Residuals of a fit as functions of its coordinates x: a triangle, a cost, and the way down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from armonic.updating.descent import FIRST_RADIUS, Descent, descend
from armonic.updating.laws import values_in

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic import _core
    from armonic.linear import LinearModel
    from armonic.updating.descent import Watch
    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]


UNSEEN = 1e-11
"""A column of the Jacobian below this share of the largest is rounding: the data do not see that parameter."""


class Residual(Protocol):
    """Σ r² of some residual r(x), known by the triangle of its linearization."""

    def triangle(self, x: Array) -> Array:
        """Upper triangle R with RᵀR = [J r]ᵀ[J r], (c+1, c+1), J by x.

        Raises:
            ArithmeticError: the model has no answer there.
        """
        ...

    def costs(self, X: Array) -> Array:
        """Costs of many points, (P, c) to (P,); infinite where the model has no answer."""
        ...


class Descending(Residual, Protocol):
    """A residual that finds its own way down."""

    def descend(
        self, start: Array, lower: Array, upper: Array, *, tolerance: float, evaluations: int, watch: Watch | None
    ) -> Descent:
        """Bounded least squares from `start`; `watch` gets evaluations and lowest price from time to time."""
        ...


@dataclass(frozen=True)
class Anchors:
    """Rows of known deviation beside those of unknown noise: (x − mean)/deviation of priors.

    Attributes:
        indices: the parameters, (a,).
        means: expected x, (a,).
        deviations: standard deviations of x, (a,).
        scale: by which their squares count beside the squares of the other rows.
    """

    indices: tuple[int, ...] = ()
    means: tuple[float, ...] = ()
    deviations: tuple[float, ...] = ()
    scale: float = 1.0

    def rows(self, x: Array) -> Array:
        """Rows [J r] of these, (a, c+1)."""
        rows = np.zeros((len(self.indices), len(x) + 1))
        for k, (i, mean, deviation) in enumerate(zip(self.indices, self.means, self.deviations, strict=True)):
            rows[k, i], rows[k, -1] = 1 / deviation, (x[i] - mean) / deviation
        rows *= np.sqrt(self.scale)
        return rows


class CoreResidual:
    """Frequency responses in the core: parameters are logarithms of stiffness and damping, shared by all postures."""

    def __init__(
        self, problem: _core.Problem, theta: Array, parameters: Sequence[Parameter], anchors: Anchors | None = None
    ) -> None:
        """`theta` holds all stiffnesses, then all dampings, (2r,)."""
        self.problem, self.theta, self.anchors = problem, theta.reshape(2, 1, -1), anchors or Anchors()
        self.free = [list(p.indices) for p in parameters]

    def triangle(self, x: Array) -> Array:
        """See `Residual.triangle`."""
        stiffness, damping = self._sets(x[None, :])
        triangle = self.problem.reduce(stiffness, damping, self.free)
        return without_unseen(triangle if not self.anchors.indices else stacked(triangle, self.anchors.rows(x)))

    def costs(self, X: Array) -> Array:
        """See `Residual.costs`."""
        costs = self.problem.costs(*self._sets(X))
        if self.anchors.indices:
            costs = costs + [float(np.sum(self.anchors.rows(x)[:, -1] ** 2)) for x in X]
        return costs

    def descend(
        self, start: Array, lower: Array, upper: Array, *, tolerance: float, evaluations: int, watch: Watch | None
    ) -> Descent:
        """Bounded trust-region least squares in the core."""
        root, (stiffness, damping) = float(np.sqrt(self.anchors.scale)), self.theta
        anchors = zip(self.anchors.indices, self.anchors.means, self.anchors.deviations, strict=True)
        return Descent(
            *self.problem.descend(
                stiffness,
                damping,
                self.free,
                start,
                lower,
                upper,
                priors=[(i, mean, root / deviation) for i, mean, deviation in anchors],
                tolerance=tolerance,
                evaluations=evaluations,
                radius=FIRST_RADIUS,
                watch=watch,
            )
        )

    def _sets(self, X: Array) -> Array:
        """Stiffnesses and dampings of many points, (2, P, r)."""
        theta = np.repeat(self.theta.reshape(1, -1), len(X), axis=0)
        for j, indices in enumerate(self.free):
            theta[:, indices] = np.exp(X[:, j, None])
        return np.ascontiguousarray(theta.reshape(len(X), 2, -1).transpose(1, 0, 2))


class LawResidual:
    """Frequency responses of one posture in the core, under laws that make its stiffness from the parameters."""

    def __init__(
        self, problem: _core.Problem, theta: Array, parameters: Sequence[Parameter], model: LinearModel
    ) -> None:
        """`theta` holds all stiffnesses, then all dampings, (2r,)."""
        self.problem, self.theta, self.parameters, self.model = problem, theta, parameters, model
        self.free = [list(p.indices) for p in parameters]

    def triangle(self, x: Array) -> Array:
        """See `Residual.triangle`."""
        (stiffness, damping), chain = self._here(x)
        R = self.problem.reduce(stiffness, damping, self.free)
        return stacked(np.column_stack([R[:, :-1] @ chain, R[:, -1]]))

    def costs(self, X: Array) -> Array:
        """See `Residual.costs`."""
        return np.array([self._cost(x) for x in X])

    def _cost(self, x: Array) -> float:
        try:
            stiffness, damping = self._here(x)[0]
            return float(self.problem.costs(stiffness, damping)[0])
        except ArithmeticError:
            return np.inf

    def _here(self, x: Array) -> tuple[Array, Array]:
        values = np.array([p.value(v) for p, v in zip(self.parameters, x, strict=True)])
        here, chain = values_in(self.parameters, values, self.model)
        theta = self.theta.copy()
        for value, indices in zip(here, self.free, strict=True):
            theta[indices] = value
        return theta.reshape(2, 1, -1), chain


class Scaled:
    """A residual whose squares count by a factor."""

    def __init__(self, inner: Residual, factor: float) -> None:
        """The factor is positive."""
        self.inner, self.factor = inner, factor

    def triangle(self, x: Array) -> Array:
        """See `Residual.triangle`."""
        triangle: Array = np.sqrt(self.factor) * self.inner.triangle(x)
        return triangle

    def costs(self, X: Array) -> Array:
        """See `Residual.costs`."""
        return self.factor * self.inner.costs(X)


class JointResidual:
    """Several residuals of the same coordinates as one, with anchors."""

    def __init__(self, parts: Sequence[Residual], anchors: Anchors | None = None) -> None:
        """Parts count as they are."""
        self.parts, self.anchors = tuple(parts), anchors or Anchors()

    def triangle(self, x: Array) -> Array:
        """See `Residual.triangle`."""
        return without_unseen(stacked(*(part.triangle(x) for part in self.parts), self.anchors.rows(x)))

    def costs(self, X: Array) -> Array:
        """See `Residual.costs`."""
        anchored = np.array([np.sum(self.anchors.rows(x)[:, -1] ** 2) for x in X])
        total: Array = sum((part.costs(X) for part in self.parts), start=anchored)
        return total

    def descend(
        self, start: Array, lower: Array, upper: Array, *, tolerance: float, evaluations: int, watch: Watch | None
    ) -> Descent:
        """Bounded trust-region least squares."""
        return descend(self.triangle, start, lower, upper, tolerance=tolerance, evaluations=evaluations, watch=watch)


def stacked(*blocks: Array) -> Array:
    """The triangle of all rows of several, (c+1, c+1)."""
    rows = np.vstack(blocks)
    short = rows.shape[1] - len(rows)
    return np.asarray(np.linalg.qr(np.pad(rows, ((0, max(short, 0)), (0, 0))), mode="r"))


def without_unseen(triangle: Array) -> Array:
    """A triangle whose columns of rounding are zero."""
    size = np.linalg.norm(triangle[:, :-1], axis=0)
    triangle[:, :-1][:, size <= UNSEEN * size.max(initial=0.0)] = 0.0
    return triangle
