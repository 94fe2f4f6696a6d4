"""Standard deviations of natural frequencies and damping ratios of an autoregression, to first order."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import solve_triangular

from armonic import _core
from armonic.identification.poles import continuous_poles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.regression import Autoregression

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]


def pole_deviations(fit: Autoregression, discrete: Complex, sample_rate_hz: float) -> tuple[Array, Array]:
    """Standard deviations of natural frequency (Hz) and damping ratio for poles of one fit.

    The coefficients of a least-squares fit, stacked as B = [A_1 … A_p]ᵀ, have the covariance Σ_e ⊗ (XᵀX)⁻¹ over the
    lagged samples X (Lütkepohl 2005, section 3.2). A pole moves with them by

        dμ = Σ_j μ^(p−j) yᵀ dA_j x / (yᵀ P'(μ) x),   P(μ) x = 0,  yᵀ P(μ) = 0,

    and natural frequency and damping ratio with the pole λ = log(μ) · sample rate (the delta method).

    They are those of a random response that the autoregression describes. Where the residuals are mostly noise on the
    sensors, or the order is too low to hold all modes, the estimates have a bias that is not counted.

    Args:
        fit: an autoregression of order p over m channels.
        discrete: poles μ of that fit, (k,), in discrete time, none of them zero.
        sample_rate_hz: samples per second.

    Returns:
        Standard deviations of the natural frequencies, (k,), Hz, and of the damping ratios, (k,). Infinite for a
        multiple pole, which has no first derivative; NaN for a frequency that is zero, and for a fit with as many
        unknowns as equations.
    """
    if not len(discrete):
        return np.zeros(0), np.zeros(0)
    p, m = fit.order, len(fit.scale)
    right = _core.polynomial_shapes(fit.coefficients, discrete)
    left = _core.polynomial_shapes(np.ascontiguousarray(fit.coefficients.transpose(0, 2, 1)), discrete)
    # Powers μ^(p−1) … 1, for |μ| > 1 divided by the first of them, so that none overflows.
    falling = np.arange(p - 1, -1, -1)
    large = np.abs(discrete) > 1
    powers = discrete[:, None] ** np.where(large[:, None], falling - (p - 1), falling)
    # P'(μ) = p μ^(p−1) I − Σ_j (p−j) A_j μ^(p−j−1), by the powers above: each is its neighbour over μ.
    slope = np.einsum("kj,jab->kab", falling * powers / discrete[:, None], fit.coefficients)
    slope = p * powers[:, 0, None, None] * np.eye(m) - slope
    steepness = np.einsum("ka,kab,kb->k", left, slope, right)
    lagged = (powers[:, :, None] * right[:, None, :]).reshape(len(discrete), p * m)
    spread = solve_triangular(fit.triangle, lagged.T, trans="T", check_finite=False)
    # Second moments of dμ over μ: E|dμ|² and E dμ², the latter complex.
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = 1 / (steepness * discrete)
        noise = fit.residual_covariance
        size = np.sum(np.abs(spread) ** 2, axis=0) * np.einsum("ka,ab,kb->k", left, noise, left.conj()).real
        size = size * np.abs(gain) ** 2
        square = np.sum(spread * spread, axis=0) * np.einsum("ka,ab,kb->k", left, noise, left) * gain**2
        poles = continuous_poles(discrete, sample_rate_hz)
        length = np.abs(poles)
        # |λ| and −Re λ / |λ| change by Re(g dλ), with dλ = dμ / μ · sample rate.
        of_freq = poles.conj() / (2 * np.pi * length)
        of_damping = -1 / length + poles.real * poles.conj() / length**3
    return _spread_of(of_freq, size, square) * sample_rate_hz, _spread_of(of_damping, size, square) * sample_rate_hz


def _spread_of(slope: Complex, size: Array, square: Complex) -> Array:
    """Standard deviation of Re(g dz) from the second moments E|dz|² and E dz² of a complex deviation of zero mean."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.maximum(np.abs(slope) ** 2 * size + (slope**2 * square).real, 0) / 2))
