"""Modes from frequency responses by the polyreference least-squares complex frequency method (pLSCF)."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.identification.matrix_fraction import Circle, fraction_models
from armonic.identification.references import Referenced, References, referenced
from armonic.identification.samples import blas_on_one_thread, checked_orders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet
    from armonic.identification.poles import ModelPoles

    Array: TypeAlias = NDArray[np.float64]

UPPER_GAP = 0.03
"""Share of the half circle above the highest line: at z = −1 all powers of z are real, which the responses are not."""
RIDGE = 1e-15
"""Weight of the coefficients beside the normal equations: below their rounding, so that noise-free responses, which
leave coefficients open, give finite ones."""


def polyreference_lscf(
    frfs: FrfSet,
    *,
    orders: range | tuple[int, int],
    band_hz: tuple[float, float] | None = None,
    weights: ArrayLike | None = None,
    references: References | None = None,
) -> list[ModelPoles]:
    """Poles and shapes of every model order by pLSCF (Guillaume et al. 2003; Peeters et al. 2004).

    Each row of the responses is H_o = B_o(z) A(z)⁻¹ at z = e^(iωΔt), with real coefficients, one denominator matrix
    A = I + α_1 z + … + α_p z^p of the m references for all of them, and numerators of the same order. Σ |H_o A − B_o|²
    is least, so that each order is a linear problem: the numerators are eliminated from reduced normal equations
    Σ_o (T_o − S_oᵀ R_o⁻¹ S_o) of which lower orders are leading parts.

    With the lowest coefficient fixed, poles of noise grow and those of modes decay. The price is a bias: with 1 % of
    noise some percent of damping, mostly towards less of it. Poles are meant to be refined.

    Responses are fitted in the kind that was measured, since that is what has noise of equal size along the lines.

    Args:
        frfs: measured responses, at any lines.
        orders: orders p of A, as a range or as the first and last. A model has m p poles.
        band_hz: lines that are used, and natural frequencies for which shapes are computed; all if not given.
        weights: of the values, such as one over their standard deviations, (L, outputs, inputs) or what broadcasts to
            it; references of one row and line share their RMS. By default every row counts alike.
        references: "inputs" or "outputs"; "none" for one scalar denominator of all pairs. By default the smaller side,
            or "none" where not every pair was measured.

    Returns:
        One set of poles for each order, in their order, without the damping of an exponential window. Shapes are those
        over the other side than the references, or over all measured pairs.

    Raises:
        SignalError: orders, band or references make no sense, or there are too few lines for the largest order.
        FrfError: too few lines, weights that do not fit, a pair missing, or responses that are zero throughout.
    """
    listed, laid = checked_orders(orders), referenced(frfs, references, band_hz, weights)
    lines, rows, m = laid.values.shape
    most = int(max(0, (2 * lines - 1) * rows // (rows + m)))
    if listed[-1] > most:
        raise SignalError(
            "orders",
            found=f"order {listed[-1]} for {lines} lines of {rows} responses to {m} references",
            expected=f"at most {most}, with which there are as many equations as unknowns",
            hint="Take lower orders, or a wider band.",
        )
    with blas_on_one_thread():
        return _fitted(laid, listed)


def _fitted(laid: Referenced, listed: Sequence[int]) -> list[ModelPoles]:
    circle = Circle.of_lines(float(laid.freq_hz[0]), float(laid.freq_hz[-1]), UPPER_GAP)
    _, rows, m = laid.values.shape
    equations = _Equations(laid, circle, listed[-1])
    wanted, backward = set(listed), []
    reduced = equations.denominator
    ridge = RIDGE * np.trace(reduced) / len(reduced)
    for p, row in enumerate(equations.projected):
        reduced -= row.T @ row
        if p in wanted:
            inner = reduced[m : m * (p + 1), m : m * (p + 1)] + ridge * np.eye(m * p)
            backward.append(np.linalg.solve(inner, reduced[m : m * (p + 1), :m]).reshape(p, m, m))

    def numerator(index: int, matrices: Array) -> Array:
        p = listed[index]
        stacked = np.concatenate([np.eye(m), -matrices.reshape(p * m, m)])
        return equations.solved((equations.projected[: p + 1, :, : m * (p + 1)] @ stacked).reshape(p + 1, rows, m))

    return fraction_models(
        listed, backward, numerator, circle, scale=laid.scale, decay_rate=laid.decay_rate, band_hz=laid.band_hz
    )


class _Equations:
    """Normal equations of the largest order, numerators apart.

    On the unit circle z^r* z^s depends on s − r alone: all blocks are Toeplitz, of sums over lines for each difference.

    Attributes:
        denominator: Σ_o T_o, (m (P+1), m (P+1)).
        projected: C_o⁻¹ S_o by power of the numerator, (P+1, rows, m (P+1)), with R_o = C_o C_oᵀ. A leading part of C_o
            is the factor of a lower order, so each order adds one slice.
    """

    def __init__(self, laid: Referenced, circle: Circle, largest: int) -> None:
        from scipy.linalg import solve_triangular

        lines, rows, m = laid.values.shape
        size = largest + 1
        powers = np.exp(1j * np.outer(np.arange(-largest, size), circle.angles(laid.freq_hz)))
        difference = np.arange(size) - np.arange(size)[:, None] + largest
        weighted = laid.values if laid.weights is None else laid.values * laid.weights[:, :, None]
        squares = weighted.conj().transpose(0, 2, 1) @ weighted
        T = _real_product(powers, squares.reshape(lines, m * m)).reshape(-1, m, m)[difference]
        if laid.weights is not None:
            weighted *= laid.weights[:, :, None]
        S = _real_product(powers, weighted.reshape(lines, rows * m)).reshape(-1, rows, m)
        weight = np.ones((lines, 1)) if laid.weights is None else laid.weights**2
        R = (powers.real @ weight).T[:, difference]
        # At rounding level: of a row whose weights leave too few lines, powers that they do not tell apart.
        floor = R[:, 0, 0] * len(difference) * np.finfo(float).eps + np.finfo(float).tiny
        self.factors: Array = np.linalg.cholesky(R + floor[:, None, None] * np.eye(size))
        self.denominator: Array = T.transpose(0, 2, 1, 3).reshape(m * size, m * size)
        self.projected: Array = np.empty((size, rows, size * m))
        for row, factor in self._of_rows(rows):
            block = S[:, row][difference].transpose(0, 2, 1, 3).reshape(size, -1)
            self.projected[:, row] = solve_triangular(factor, block, lower=True).reshape(size, -1, size * m)

    def _of_rows(self, rows: int) -> list[tuple[slice, Array]]:
        """Factors with the rows they belong to."""
        if len(self.factors) == 1:
            return [(slice(0, rows), self.factors[0])]
        return [(slice(row, row + 1), factor) for row, factor in enumerate(self.factors)]

    def solved(self, values: Array) -> Array:
        """C_o⁻ᵀ of values by power, (p+1, rows, m): the numerators, of an order p."""
        from scipy.linalg import solve_triangular

        size, rows, m = values.shape
        out = np.empty(values.shape)
        for row, factor in self._of_rows(rows):
            part = values[:, row].reshape(size, -1)
            out[:, row] = solve_triangular(factor[:size, :size], part, lower=True, trans="T").reshape(size, -1, m)
        return out


def _real_product(powers: NDArray[np.complex128], values: NDArray[np.complex128]) -> Array:
    """Re Σ_k z_k^d x_k of every difference d, (2P+1, columns)."""
    return np.asarray(powers.real @ values.real - powers.imag @ values.imag, np.float64)
