"""What the mode shapes of a pole say: how alike two are (MAC, OMAC) and how nearly real one is (MPC, MPD)."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

PERIODS = 4
"""Natural periods over which OMAC compares two motions: enough to tell 1 % of frequency, short for any damping."""
LAGS_PER_PERIOD = 16
"""Lags in one natural period."""
FAR_APART = 100.0
"""Ratio of two rates |λ| from which on two motions have nothing in common, and the sums could overflow."""
STANDSTILL = 1e-200
"""Rates |λ| below this, in rad/s, are none; it keeps quotients finite."""


def mac_rows(a: Complex, b: Complex) -> Array:
    """Modal assurance criterion |aᴴb|² / (aᴴa · bᴴb) of shapes row by row, (k,) (Allemang & Brown 1982).

    Args:
        a: shapes by rows, (k, m).
        b: shapes by rows, (k, m).

    Returns:
        Between 0 and 1; NaN where a shape is zero or not known.
    """
    product = np.abs(np.einsum("km,km->k", a.conj(), b)) ** 2
    return _share(product, _squares(a) * _squares(b))


def mac_table(a: Complex, b: Complex) -> Array:
    """Modal assurance criterion of every pair of shapes, (k_a, k_b); NaN as in `mac_rows`.

    Args:
        a: shapes by rows, (k_a, m).
        b: shapes by rows, (k_b, m).
    """
    # A NaN in a product of matrices would raise floating-point warnings on some machines.
    known = [np.where(np.isfinite(x), x, 0.0) for x in (a, b)]
    product = known[0].conj() @ known[1].T
    return _share(product.real**2 + product.imag**2, np.outer(_squares(a), _squares(b)))


def omac_rows(poles_a: Complex, shapes_a: Complex, poles_b: Complex, shapes_b: Complex) -> Array:
    """Order modal assurance criterion of modes row by row, (k,): the MAC of their motions over time.

    Vu et al. 2011 compare the eigenvectors of the state matrices of two successive orders, which are shapes extended by
    their own past: [φ, φ e^{λτ}, φ e^{2λτ}, …]. Their length there depends on order and sampling rate. Here the lags τ
    are sixteenths of the natural period 2π / √(|λ_a||λ_b|) and cover four of them, so that the criterion judges a mode
    at 6 Hz as one at 400 Hz, whatever the method. It factors into the MAC of the shapes and that of e^{λ_a t} and
    e^{λ_b t}, and so falls below the MAC where frequency or damping differ. It has no unit.

    Args:
        poles_a: λ, (k,), rad/s.
        shapes_a: by rows, (k, m).
        poles_b: λ, (k,), rad/s.
        shapes_b: by rows, (k, m).

    Returns:
        Between 0 and 1; NaN where a shape is zero or not known. Motions of which one is a hundred times faster than the
        other, or stands still, count as unlike: 0.
    """
    size_a, size_b = np.abs(poles_a), np.abs(poles_b)
    moving = (size_a > STANDSTILL) & (size_b > STANDSTILL)
    alike = moving & (size_a > size_b / FAR_APART) & (size_b > size_a / FAR_APART)
    rate = np.where(alike, np.sqrt(size_a) * np.sqrt(size_b), np.inf)
    a, b = (np.asarray(poles * (2 * np.pi / LAGS_PER_PERIOD / rate), np.complex128) for poles in (poles_a, poles_b))
    cross = _geometric_sum(a.conj() + b)
    own = _geometric_sum(2 * a.real).real * _geometric_sum(2 * b.real).real
    return np.asarray(mac_rows(shapes_a, shapes_b) * np.where(alike, np.minimum(np.abs(cross) ** 2 / own, 1.0), 0.0))


def _geometric_sum(exponent: Complex | Array) -> Complex:
    """Σ e^{x l} over the lags l = 0 … L−1, accurate where x is close to zero."""
    x = np.asarray(exponent, np.complex128)
    lags = PERIODS * LAGS_PER_PERIOD
    below = np.expm1(x)
    return np.divide(np.expm1(lags * x), below, out=np.full(x.shape, lags, np.complex128), where=below != 0)


def modal_phase_collinearity(shapes: Complex) -> Array:
    """MPC of shapes by rows, (k,): 1 if all channels move in phase or opposition, 0 if in a circle.

    ((s_1 − s_2) / (s_1 + s_2))² with the eigenvalues s of the covariance of real and imaginary parts about zero, which
    is |φᵀφ|² / (φᴴφ)² (Pappa, Elliott & Schenk 1993, "Consistent-mode indicator for the eigensystem realization
    algorithm"). About zero and not about the mean, since a multiple of a real shape must count as real wherever its
    mean lies.

    Args:
        shapes: (k, m).

    Returns:
        Between 0 and 1; NaN where a shape is zero or not known.
    """
    return _share(np.abs(np.einsum("km,km->k", shapes, shapes)) ** 2, _squares(shapes) ** 2)


def mean_phase_deviation_deg(shapes: Complex) -> Array:
    """MPD of shapes by rows, (k,): mean angle in degrees between the channels and the line that fits them best.

    The line is the first right singular vector of [Re φ, Im φ], which lies at half the angle of φᵀφ; the mean is
    weighted by the amplitudes |φ_j| (Reynders, Houbrechts & De Roeck 2012, "Fully automated (operational) modal
    analysis").

    Args:
        shapes: (k, m).

    Returns:
        From 0 for a real shape to about 45 for one without a preferred phase; NaN where it is zero or not known.
    """
    line = np.exp(0.5j * np.angle(np.einsum("km,km->k", shapes, shapes)))
    turned = shapes * line.conj()[:, None]
    size = np.abs(shapes)
    deviation = np.arctan2(np.abs(turned.imag), np.abs(turned.real))
    return np.rad2deg(_share(np.sum(size * deviation, axis=1), np.sum(size, axis=1), most=np.inf))


def mean_shape(shapes: Complex, weights: Array) -> Complex:
    """The one shape, (m,), that is most like the given ones, (k, m), whatever their phases: unit length.

    It is the first right singular vector of the weighted shapes, which maximizes the weighted sum of MACs; turned so
    that the largest entry is real and positive.

    Args:
        shapes: by rows, (k, m), finite.
        weights: (k,), not negative.
    """
    length = np.sqrt(_squares(shapes))[:, None]
    unit = np.divide(shapes, length, out=np.zeros_like(shapes), where=length > 0)
    _, vectors = np.linalg.eigh((unit * weights[:, None]).T @ unit.conj())
    shape = vectors[:, -1]
    largest = shape[np.argmax(np.abs(shape))]
    return np.asarray(shape * (largest.conj() / abs(largest)), np.complex128)


def _squares(shapes: Complex) -> Array:
    return np.asarray(np.sum(shapes.real**2 + shapes.imag**2, axis=1), np.float64)


def _share(part: Array, whole: Array, *, most: float = 1.0) -> Array:
    """The quotient, at most `most` beside rounding, NaN where the whole is zero or not known."""
    ratio = np.divide(part, whole, out=np.full(np.shape(whole), np.nan), where=whole > 0)
    return np.asarray(np.minimum(ratio, most), np.float64)
