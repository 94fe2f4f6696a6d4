"""Poles and shapes of right matrix fractions B(z) A(z)⁻¹, and where frequencies lie on the unit circle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.identification.autoregressive import poles_of
from armonic.identification.poles import ModelPoles, in_band, kept_poles, unit_shapes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

LOWER_GAP = 0.2
"""Most of the upper half circle that is left free below the lowest line. With a band that begins at zero, or not far
above, z = e^(iωΔt) as always, and negative frequencies lie where they belong. A band farther up would leave so much of
the circle without data that powers of z could not be told apart; it is turned towards z = 1."""


@dataclass(frozen=True)
class Circle:
    """A motion e^(λt) as z = e^(i offset + slope λ).

    Attributes:
        offset: angle of zero frequency, rad.
        slope: angle per rad/s: the sampling interval, s.
    """

    offset: float
    slope: float

    @classmethod
    def of_lines(cls, low_hz: float, high_hz: float, upper_gap: float) -> Circle:
        """Lines on the upper half circle, so that a share of it is left free above them."""
        top = np.pi * (1.0 - upper_gap)
        bottom = min(top * low_hz / high_hz, np.pi * LOWER_GAP)
        slope = (top - bottom) / (2 * np.pi * (high_hz - low_hz))
        return cls(bottom - slope * 2 * np.pi * low_hz, slope)

    def angles(self, freq_hz: Array) -> Array:
        """Angle of each frequency, rad."""
        return np.asarray(self.offset + self.slope * 2 * np.pi * freq_hz, np.float64)

    def poles(self, discrete: Complex) -> Complex:
        """λ in rad/s of z, (k,), other than zero, of the upper half plane."""
        # Adding zero turns an imaginary part of −0, which lies below the cut of the logarithm, into +0.
        return np.asarray((np.log(discrete + 0.0) - 1j * self.offset) / self.slope, np.complex128)


def fraction_models(
    orders: Sequence[int],
    backward: Sequence[Array],
    numerator: Callable[[int, Array], Array],
    circle: Circle,
    *,
    scale: Array,
    decay_rate: float,
    band_hz: tuple[float, float] | None,
) -> list[ModelPoles]:
    """Poles and shapes of the fractions B(z) A(z)⁻¹ with A(z) = I − Σ_r A_r z^r, r = 1 … p.

    A coefficient fixed at the lowest power is that of a prediction backwards in time. Poles of noise then grow
    (Kumaresan and Tufts 1982; Cauberghe 2004): nearly all that decay are modes. With w = 1/z the polynomial is monic,
    and near a pole μ the fraction is B(μ) v uᵀ / (z − μ) with A(μ) v = 0: B(μ) v is the shape over the rows.

    Args:
        orders: p, ascending.
        backward: A_r of each, (p, m, m).
        numerator: gives the coefficients of B in ascending powers of z, (k, rows, m), from index and A_r.
        circle: of z.
        scale: by which the rows of the shapes are multiplied, (rows,).
        decay_rate: of the exponential window, which is taken off again.
        band_hz: natural frequencies for which shapes are computed; all if not given.
    """
    found = []
    for index, (order, matrices, w) in enumerate(zip(orders, backward, poles_of(backward), strict=True)):
        chosen = w[kept_poles(w)]
        # 1/w̄ stands for the same pair and lies in the upper half plane as w does.
        discrete = 1.0 / chosen.conj()
        seen_poles = circle.poles(discrete)
        poles = seen_poles + decay_rate
        sorting = np.lexsort((poles.imag, np.abs(poles)))
        sorting = sorting[seen_poles.imag[sorting] >= 0]
        poles, discrete = poles[sorting], discrete[sorting]
        shapes = np.full((len(poles), len(scale)), np.nan, np.complex128)
        seen = np.flatnonzero(in_band(poles, band_hz))
        if len(seen):
            raw = _shapes(matrices, numerator(index, matrices), discrete[seen]) * scale
            # A pole that grows fast can be in A and cancel in the fraction, to the last digit: it has no shape.
            there = np.abs(raw).max(axis=1) > 0
            shapes[seen[there]] = unit_shapes(raw[there])
        found.append(ModelPoles(int(order), poles, shapes))
    return found


def _shapes(matrices: Array, numerator: Array, discrete: Complex) -> Complex:
    """B(μ) v of each pole, by rows, (k, rows), each of any size."""
    vectors = _core.polynomial_shapes(matrices, 1.0 / discrete)
    count, rows, m = numerator.shape
    # Powers fall where |μ| > 1, so that none overflows.
    ascending = np.arange(count) - np.where(np.abs(discrete) > 1, count - 1, 0)[:, None]
    at = (discrete[:, None] ** ascending) @ numerator.reshape(count, rows * m)
    return np.asarray(np.einsum("krm,km->kr", at.reshape(-1, rows, m), vectors))
