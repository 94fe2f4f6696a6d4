"""Modes from frequency responses by the polyreference least-squares complex exponential method (LSCE)."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.identification.impulse_responses import impulse_responses
from armonic.identification.matrix_fraction import Circle, fraction_models
from armonic.identification.references import References, referenced
from armonic.identification.samples import blas_on_one_thread, checked_band, checked_orders

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet
    from armonic.identification.poles import ModelPoles

    Array: TypeAlias = NDArray[np.float64]

RIDGE = float(np.finfo(float).eps)
"""Weight of the coefficients beside samples of unit norm: no more than their rounding. Coefficients that noise-free
samples leave open come out small."""
ROWS = 512
"""Equations that are folded into the triangle at a time: few, so that they stay in cache."""
PANEL = 16
"""Columns that LAPACK factorizes before it updates the rest."""


def complex_exponential(
    frfs: FrfSet,
    *,
    orders: range | tuple[int, int],
    band_hz: tuple[float, float] | None = None,
    references: References | None = None,
) -> list[ModelPoles]:
    """Poles and shapes of every model order by LSCE (Brown et al. 1979; with references, Vold et al. 1982).

    The method of Huynh et al. 2021. Impulse responses, in the kind that was measured, see
    `impulse_responses.impulse_responses`, are fitted by `exponentials_of`. An exponential window on the signals damps
    every motion by the same rate, which is taken off the poles again.

    Args:
        frfs: measured responses at evenly spaced lines.
        orders: orders p, as a range or as the first and last. A model has m p poles with m references.
        band_hz: lines that are used, and natural frequencies for which shapes are computed; all if not given.
        references: "inputs" or "outputs"; "none" for one scalar polynomial of all pairs. By default the smaller side,
            or "none" where not every pair was measured.

    Returns:
        One set of poles for each order, in their order. Shapes are those over the other side than the references, or
        over all measured pairs.

    Raises:
        SignalError: orders, band or references make no sense, or there are too few lines for the largest order.
        FrfError: too few lines, lines that are not evenly spaced, a pair missing, or responses that are zero
            throughout.
    """
    listed, laid = checked_orders(orders), referenced(frfs, references, band_hz)
    found = impulse_responses(laid)
    _check_length(found.samples, listed, f"{len(laid.freq_hz)} lines", "Take lower orders, or a wider band.")
    with blas_on_one_thread():
        return _fitted(found.samples, listed, found.circle, laid.scale, laid.decay_rate, laid.band_hz)


def exponentials_of(
    samples: ArrayLike,
    sample_rate_hz: float,
    *,
    orders: range | tuple[int, int],
    band_hz: tuple[float, float] | None = None,
) -> list[ModelPoles]:
    """Poles and shapes of free motions h_k = Σ_r ψ_r μ_r^k l_rᵀ, of every order p.

    All samples of all responses are predicted from those that follow, h_k = Σ_j h_(k+j) A_j, j = 1 … p, by least
    squares through one QR factorization, of which lower orders are leading parts. The poles are the μ with
    det(I − Σ_j A_j μ^j) = 0; those that the prediction backwards adds grow.

    Args:
        samples: (N, rows, m), the rows' responses to m references.
        sample_rate_hz: samples per second.
        orders: orders p, as a range or as the first and last.
        band_hz: natural frequencies for which shapes are computed; all if not given.

    Returns:
        One set of poles for each order, in their order; shapes over the rows.

    Raises:
        SignalError: samples, rate, orders or band make no sense, or there are too few samples for the largest order.
    """
    given = np.asarray(samples)
    if given.ndim != 3 or not given.size or np.iscomplexobj(given) or not np.isfinite(given).all() or not given.any():
        found = f"{given.dtype} numbers of shape {given.shape}" if given.any() else "only zeros"
        raise SignalError("samples", found=found, expected="finite real numbers (N, rows, references), some not zero")
    if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0):
        raise SignalError("sample_rate_hz", found=repr(sample_rate_hz), expected="a positive number, Hz")
    listed, band = checked_orders(orders), checked_band(band_hz)
    scaled = given / np.abs(given).max()
    _check_length(scaled, listed, f"{len(given)} samples", "Take lower orders, or more samples.")
    with blas_on_one_thread():
        return _fitted(scaled, listed, Circle(0.0, 1 / sample_rate_hz), np.ones(given.shape[1]), 0.0, band)


def _check_length(samples: Array, listed: Sequence[int], what: str, hint: str) -> None:
    count, rows, m = samples.shape
    most = count * rows // (rows + m)
    if listed[-1] > most:
        raise SignalError(
            "orders",
            found=f"order {listed[-1]} for {what} of {rows} responses to {m} references",
            expected=f"at most {most}, with which there are as many equations as unknowns",
            hint=hint,
        )


def _fitted(
    samples: Array,
    listed: Sequence[int],
    circle: Circle,
    scale: Array,
    decay_rate: float,
    band_hz: tuple[float, float] | None,
) -> list[ModelPoles]:
    from scipy.linalg import solve_triangular

    largest, (_, rows, m) = listed[-1], samples.shape
    unknowns = largest * m
    triangle = _triangle(samples, largest)
    backward = []
    for p in listed:
        stacked = solve_triangular(triangle[: p * m, : p * m], triangle[: p * m, unknowns:])
        backward.append(np.ascontiguousarray(stacked.reshape(p, m, m)))
    # H(z) A(z), H = Σ_k h_k z^(−k), has no powers below z¹: block (j, r) of what stands above them is h_(r−j).
    early = np.zeros((largest, rows, largest, m))
    for j in range(largest):
        early[j, :, j:] = samples[: largest - j].transpose(1, 0, 2)

    def numerator(index: int, matrices: Array) -> Array:
        p = listed[index]
        product = early[:p, :, :p].reshape(p * rows, p * m) @ matrices.reshape(p * m, m)
        return np.asarray(product.reshape(p, rows, m))

    return fraction_models(listed, backward, numerator, circle, scale=scale, decay_rate=decay_rate, band_hz=band_hz)


def _triangle(samples: Array, largest: int) -> Array:
    """R of the QR factorization of [h_(k+1) | … | h_(k+p) | h_k], k by k and row by row, over a ridge."""
    from scipy.linalg.lapack import dtpqrt

    count, rows, m = samples.shape
    unknowns = largest * m
    used = count - largest
    norm = float(np.linalg.norm(samples)) / np.sqrt(m)
    triangle = np.asfortranarray(np.diag(np.r_[np.full(unknowns, RIDGE * norm), np.zeros(m)]))
    follow = np.r_[1 : largest + 1, 0]
    step = max(1, ROWS // rows)
    for start in range(0, used, step):
        at = np.arange(start, min(start + step, used))
        block = samples[at[:, None] + follow].transpose(0, 2, 1, 3).reshape(len(at) * rows, unknowns + m)
        triangle, *_ = dtpqrt(
            0, min(PANEL, unknowns + m), triangle, np.asfortranarray(block), overwrite_a=True, overwrite_b=True
        )
    return np.asarray(triangle, np.float64)
