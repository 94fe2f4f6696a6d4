"""Least-squares fits of vector autoregressions of every order, from one QR factorization of the lagged samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtpqrt

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

RIDGE = float(np.finfo(float).eps)
"""Weight of the coefficients beside channels of unit norm: no more than the rounding of the samples themselves."""
ROWS = 256
"""Rows of lagged samples that are folded into the triangle at a time: so few that they stay in cache."""
PANEL = 8
"""Columns that LAPACK factorizes before it updates the rest: no slower than more, and faster for few channels."""


@dataclass(frozen=True, eq=False, repr=False)
class Autoregression:
    """A fit of y_k = Σ_j A_j y_(k−j) + e_k, j = 1 … p, to samples y of m channels.

    Attributes:
        order: p.
        rows: number of equations, one for each sample from k = p on.
        scale: what each channel was divided by for the fit, (m,), so that all have unit norm.
        coefficients: A_j of the divided channels, (p, m, m); those of the samples are diag(scale) A_j diag(scale)⁻¹.
        residual_covariance: of e in the divided channels, (m, m): the sum of squares over (rows − m p); NaN where that
            is zero, which leaves no equation to judge by.
        triangle: R of the QR factorization of the lagged, divided samples [lag 1 | … | lag p], (m p, m p); RᵀR is their
            Gram matrix, and the covariance of the stacked coefficients is residual_covariance ⊗ (RᵀR)⁻¹.
    """

    order: int
    rows: int
    scale: Array
    coefficients: Array
    residual_covariance: Array
    triangle: Array

    def __repr__(self) -> str:
        """Order, channels and rows, in one line."""
        return f"Autoregression(order {self.order}, {len(self.scale)} channels, {self.rows} rows)"


class Regression:
    """The lagged samples of the largest order, factorized once; `fit` gives the least-squares fit of any lower order.

    The rows k = p_max … N−1 of [lag 1 | … | lag p_max | y] are factorized together: the leading triangle of R with its
    last m columns is the least-squares problem of a lower order p over those rows (Vu et al. 2011). The rows
    k = p … p_max−1, which that order can use as well, are then folded into its triangle, so that every order is fitted
    to all samples it can reach: a motion that dies within a few samples is only in those rows.

    Noise-free samples have fewer independent lags than a high order has. The coefficients they leave open are held by a
    ridge at rounding level (`RIDGE`): they come out finite and small, and the others are not moved beyond rounding.

    Args:
        samples: finite, (N, m), no channel zero throughout.
        largest: the largest order p_max, with N − s p_max ≥ m p_max.
        spacing: s, samples from one lag to the next: y_k = Σ_j A_j y_(k−js) + e_k. The rows begin at k = s p then.
    """

    def __init__(self, samples: Array, largest: int, spacing: int = 1) -> None:
        self.largest, self.spacing = largest, spacing
        # By powers of two near the norm, which round nothing.
        peak = np.abs(samples).max(axis=0)
        norm = peak * np.linalg.norm(samples / peak, axis=0)
        self.scale: Array = np.exp2(np.round(np.log2(norm)))
        self.samples: Array = samples / self.scale
        n, m = self.samples.shape
        triangle = np.diag(np.r_[np.full(m * largest, RIDGE), np.zeros(m)])
        self._triangle: Array = self._fold(triangle, largest * spacing, n, largest)

    def _rows(self, start: int, stop: int, order: int) -> Array:
        """Rows k = start … stop−1 of [lag 1 | … | lag p | y]."""
        back = (self.spacing * j for j in range(1, order + 1))
        return np.hstack([*(self.samples[start - j : stop - j] for j in back), self.samples[start:stop]])

    def _fold(self, triangle: Array, first: int, end: int, order: int) -> Array:
        """The triangle with the rows k = first … end−1 in it."""
        for start in range(first, end, ROWS):
            triangle = _folded(triangle, self._rows(start, min(start + ROWS, end), order))
        return triangle

    def fit(self, order: int) -> Autoregression:
        """The ordinary least-squares fit of one order, at most the largest, over all rows k = p … N−1."""
        n, m = self.samples.shape
        lags, whole = m * order, m * self.largest
        columns = np.r_[0:lags, whole : whole + m]
        top = self._triangle[:lags][:, columns]
        rest = np.linalg.qr(self._triangle[lags:, whole:], mode="r")
        triangle = np.vstack([top, np.hstack([np.zeros((m, lags)), rest])])
        triangle = self._fold(triangle, order * self.spacing, self.largest * self.spacing, order)
        stacked = solve_triangular(triangle[:lags, :lags], triangle[:lags, lags:])
        left = np.triu(triangle[lags:, lags:])
        rows = n - order * self.spacing
        return Autoregression(
            order=order,
            rows=rows,
            scale=self.scale,
            coefficients=np.ascontiguousarray(stacked.reshape(order, m, m).transpose(0, 2, 1)),
            residual_covariance=left.T @ left / (rows - lags) if rows > lags else np.full((m, m), np.nan),
            triangle=np.triu(triangle[:lags, :lags]),
        )


def _folded(triangle: Array, rows: Array) -> Array:
    """R of the QR factorization of a triangle with more rows below it, by LAPACK's tpqrt."""
    panel = min(PANEL, len(triangle))
    folded, *_ = dtpqrt(0, panel, np.asfortranarray(triangle), np.asfortranarray(rows))
    return np.asarray(folded, np.float64)
