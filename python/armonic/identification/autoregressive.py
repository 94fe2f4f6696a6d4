"""Modes from responses alone by vector autoregression: poles and shapes of every model order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import SignalError
from armonic.identification.deviations import pole_deviations
from armonic.identification.poles import ModelPoles, continuous_poles, in_band, kept_poles, unit_shapes
from armonic.identification.regression import Regression
from armonic.identification.samples import blas_on_one_thread, checked_band, checked_orders, checked_samples

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

SUM_TOLERANCE = 1e-6
"""Sums of poles agree to within this share of their sizes: rounding is far less, a pole that is missing far more."""


def vector_autoregression(
    values: ArrayLike,
    sample_rate_hz: float,
    *,
    orders: range | tuple[int, int],
    band_hz: tuple[float, float] | None = None,
    deviations: bool = False,
    spacing: int = 1,
) -> list[ModelPoles]:
    """Poles and shapes of vector autoregressions y_k = Σ_j A_j y_(k−j) + e_k, j = 1 … p, of every order p.

    Each order is fitted by ordinary least squares to all rows k = p … N−1 that it can use, through one QR factorization
    (Vu et al. 2011; Do et al. 2022, section 4.3). Its poles in discrete time are the μ with det P(μ) = 0,
    P(μ) = μᵖ I − Σ_j A_j μ^(p−j), all m p of them, and its shapes the φ with P(μ) φ = 0.

    The response is free or random; a constant offset is carried by a pole at zero frequency. White noise on the samples
    is no part of the model: it draws damping up at low orders, and high orders absorb it.

    Args:
        values: samples, (N, m), in any unit; a channel's own unit is that of its entries in the shapes.
        sample_rate_hz: samples per second.
        orders: model orders p, as a range or as the first and last.
        band_hz: natural frequencies for which shapes and deviations are computed; all if not given. A motion above half
            the sampling rate, or a strongly damped one just below, has |λ| / 2π above half the rate.
        spacing: samples from one lag to the next. With s of them a model of the same order looks s times as far back
            and tells slow modes apart that lie close together; motion above half the rate over s is aliased.
        deviations: also give the standard deviation of every natural frequency and damping ratio in the band.

    Returns:
        One set of poles for each order, in their order. Growing poles and those at half the sampling rate are kept.

    Raises:
        SignalError: samples, sampling rate, orders or band make no sense, or there are too few samples for the largest
            order, which needs N ≥ (m + s) p for a spacing of s.
    """
    samples, listed, band = checked_samples(values, sample_rate_hz), checked_orders(orders), checked_band(band_hz)
    n, m = samples.shape
    if not (isinstance(spacing, int) and spacing >= 1):
        raise SignalError("spacing", found=repr(spacing), expected="a whole number of at least 1")
    most = n // (m + spacing)
    sample_rate_hz = sample_rate_hz / spacing  # of the lags, from here on
    if listed[-1] > most:
        raise SignalError(
            "orders",
            found=f"order {listed[-1]} for {n} samples of {m} channels",
            expected=f"at most {most}, with which there are as many equations as unknowns"
            if most
            else f"at least {m + spacing} samples, for order 1",
            hint="Take lower orders, a longer record or fewer channels.",
        )
    with blas_on_one_thread():
        return _fitted(Regression(samples, listed[-1], spacing), listed, sample_rate_hz, band, deviations=deviations)


def _fitted(
    regression: Regression,
    listed: list[int],
    sample_rate_hz: float,
    band: tuple[float, float] | None,
    *,
    deviations: bool,
) -> list[ModelPoles]:
    m = len(regression.scale)
    coefficients = [regression.fit(order).coefficients for order in listed]
    unit = regression.scale / regression.scale.max()
    found = []
    for order, matrices, discrete in zip(listed, coefficients, poles_of(coefficients), strict=True):
        chosen = discrete[kept_poles(discrete)]
        poles = continuous_poles(chosen, sample_rate_hz)
        seen = in_band(poles, band)
        shapes = np.full((len(poles), m), np.nan, np.complex128)
        shapes[seen] = unit_shapes(_core.polynomial_shapes(matrices, chosen[seen]) * unit)
        freq_std, damping_std = None, None
        if deviations:
            freq_std, damping_std = np.full(len(poles), np.nan), np.full(len(poles), np.nan)
            # Fitted again rather than kept: the triangles of all orders together are large.
            fit = regression.fit(order)
            freq_std[seen], damping_std[seen] = pole_deviations(fit, chosen[seen], sample_rate_hz)
        found.append(ModelPoles(order, poles, shapes, freq_std, damping_std))
    return found


def poles_of(coefficients: Sequence[Array]) -> list[Complex]:
    """All poles μ in discrete time of autoregressions, of each the m p roots of det(μᵖ I − Σ_j A_j μ^(p−j)).

    By simultaneous iteration on the polynomials, each order from the poles of the one before. Where that does not
    converge, or its poles do not add up, the eigenvalues of the block companion matrix, by LAPACK.

    Args:
        coefficients: A_j of each order, (p, m, m), orders ascending.
    """
    poles, _, converged = _core.polynomial_eigenvalues(list(coefficients))
    return [
        found if done and _adds_up(found, matrices) else companion_poles(matrices)
        for found, done, matrices in zip(poles, converged, coefficients, strict=True)
    ]


def _adds_up(poles: Complex, coefficients: Array) -> bool:
    """Whether poles, and their squares, have the sums that all of them together have.

    Those are the traces of the companion matrix and of its square, tr A_1 and tr(A_1² + 2 A_2). Each number may be a
    pole and the set still lack one, if another is there twice.
    """
    first = coefficients[0]
    square = np.trace(first @ first) + (2 * np.trace(coefficients[1]) if len(coefficients) > 1 else 0.0)
    return all(
        abs(np.sum(poles**power) - trace) <= SUM_TOLERANCE * np.sum(np.abs(poles) ** power)
        for power, trace in ((1, np.trace(first)), (2, square))
    )


def companion_poles(coefficients: Array) -> Complex:
    """The poles of one autoregression as eigenvalues of its block companion matrix, (m p,).

    Args:
        coefficients: A_j, (p, m, m).
    """
    p, m, _ = coefficients.shape
    companion = np.eye(m * p, k=-m)
    companion[:m] = coefficients.transpose(1, 0, 2).reshape(m, m * p)
    return np.asarray(np.linalg.eigvals(companion), np.complex128)
