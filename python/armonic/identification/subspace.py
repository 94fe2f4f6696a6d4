"""Modes from responses alone by covariance-driven stochastic subspace identification: poles of every model order."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.linalg import solve_triangular

from armonic.errors import SignalError
from armonic.identification.poles import ModelPoles, continuous_poles, in_band, kept_poles, unit_shapes
from armonic.identification.samples import blas_on_one_thread, checked_band, checked_orders, checked_samples

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array: TypeAlias = NDArray[np.float64]


def covariance_ssi(
    values: ArrayLike,
    sample_rate_hz: float,
    *,
    orders: range | tuple[int, int],
    block_rows: int,
    band_hz: tuple[float, float] | None = None,
) -> list[ModelPoles]:
    """Poles and shapes of state-space models x_(k+1) = A x_k + w_k, y_k = C x_k + v_k of every number of states.

    The covariances R_τ = Σ y_(k+τ) y_kᵀ of the samples at the lags τ = 1 … 2i−1 fill the block Toeplitz matrix of i
    block rows and columns, with R_(i+r−c) in block row r and column c; its left singular vectors span the observability
    matrix [C; CA; …; CA^(i−1)] (Peeters & De Roeck 1999, section 3; Reynders et al. 2012, section 2). The first n of
    them give A of n states by the least-squares solution of its shift: one SVD and one QR factorization serve all n.

    The sums run over the same k for all lags. So they are the exact C A^τ G of a noise-free free decay as well, which
    needs no stationarity, at the cost of 2i − 1 samples. Noise on the sensors that is white drops out of a random
    response, since lag 0 is not used.

    Args:
        values: samples, (N, m), in any unit; a channel's own unit is that of its entries in the shapes.
        sample_rate_hz: samples per second.
        orders: numbers of states n, as a range, or the first and last, between which every second one is taken.
        block_rows: i, at least 2. The longest lag, 2i−1 samples, should hold a period or more of the lowest mode.
        band_hz: natural frequencies for which shapes are computed; all if not given.

    Returns:
        One set of poles for each order, in their order; no deviations. Growing poles are kept.

    Raises:
        SignalError: samples, sampling rate, orders, block rows or band make no sense, there are too few block rows for
            the largest order, which needs n ≤ m (i−1), or too few samples, N ≥ (m + 2) i.
    """
    samples, band = checked_samples(values, sample_rate_hz), checked_band(band_hz)
    listed = checked_orders(orders, step=2)
    count, m = samples.shape
    if not isinstance(block_rows, (int, np.integer)) or isinstance(block_rows, bool) or block_rows < 2:
        raise SignalError("block_rows", found=repr(block_rows), expected="an integer from 2 up")
    if count < (m + 2) * block_rows:
        raise SignalError(
            "block_rows",
            found=f"{block_rows} block rows for {count} samples of {m} channels",
            expected=f"at most {count // (m + 2)}",
            hint="Take fewer block rows or a longer record.",
        )
    if listed[-1] > m * (block_rows - 1):
        raise SignalError(
            "orders",
            found=f"{listed[-1]} states from {block_rows} block rows of {m} channels",
            expected=f"at most {m * (block_rows - 1)} states",
            hint="Take more block rows or lower orders.",
        )
    with blas_on_one_thread():
        return _fitted(samples, sample_rate_hz, listed, block_rows, band)


def _fitted(
    samples: Array, sample_rate_hz: float, listed: list[int], block_rows: int, band: tuple[float, float] | None
) -> list[ModelPoles]:
    m = samples.shape[1]
    scale = np.linalg.norm(samples / np.abs(samples).max(axis=0), axis=0) * np.abs(samples).max(axis=0)
    observed = _observability(samples / scale, block_rows, listed[-1])
    # The columns are a basis of the observability's, each state scaled freely, which leaves the poles as they are and
    # the triangle well conditioned whatever the singular values.
    basis, triangle = np.linalg.qr(observed[:-m])
    shifted = basis.T @ observed[m:]
    found = []
    for n in listed:
        discrete, vectors = np.linalg.eig(solve_triangular(triangle[:n, :n], shifted[:n, :n]))
        discrete = discrete.astype(np.complex128)
        keep = kept_poles(discrete)
        poles = continuous_poles(discrete[keep], sample_rate_hz)
        seen = in_band(poles, band)
        shapes = np.full((len(poles), m), np.nan, np.complex128)
        shapes[seen] = unit_shapes(((scale[:, None] * observed[:m, :n]) @ vectors[:, keep[seen]]).T)
        found.append(ModelPoles(n, poles, shapes))
    return found


def _observability(samples: Array, block_rows: int, states: int) -> Array:
    """The first left singular vectors of the block Toeplitz matrix of covariances, (m i, states)."""
    count, m = samples.shape
    length = count - 2 * block_rows + 1
    first = samples[:length]
    lags = [samples[lag : lag + length].T @ first for lag in range(1, 2 * block_rows)]
    toeplitz = np.empty((block_rows, m, block_rows, m))
    for row in range(block_rows):
        for column in range(block_rows):
            toeplitz[row, :, column] = lags[block_rows + row - column - 1]
    left, _, _ = np.linalg.svd(toeplitz.reshape(m * block_rows, m * block_rows), full_matrices=False)
    return np.asarray(left[:, :states], np.float64)
