"""Poles of frequency responses by least squares of complex exponentials in their impulse responses (LSCE)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.identification.denominators import denominator_poles, references_last
from armonic.identification.poles import ModelPoles
from armonic.identification.samples import blas_on_one_thread, checked_band, checked_orders

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]

UNEVEN = 1e-3
"""A line may lie this share of a step beside its place: files round their frequencies."""
SKIPPED = 1
"""First samples of an impulse response hold what the cut at the highest line leaves there."""


def complex_exponential(
    frfs: FrfSet, *, orders: range | Sequence[int], band_hz: tuple[float, float] | None = None
) -> list[ModelPoles]:
    """Poles and participations by the polyreference complex exponential method (Vold, Kundrat, Rocklin, Russell 1982).

    The inverse Fourier transform of mobilities gives impulse responses, of which the first half is used. It is the
    method that Huynh et al. 2021 measured with.

    Args:
        frfs: responses of any kind on even lines; lines missing below the first are taken for zero.
        orders: lags p, ascending: a range, or the first and last. m references have m p poles.
        band_hz: natural frequencies for which participations are computed; all if not given.

    Raises:
        FrfError: lines are not even, or too few.
        SignalError: orders or band make no sense.
    """
    H = references_last(frfs)
    first, step = _grid(frfs.freq_hz)
    spectrum = np.zeros((first + len(H), *H.shape[1:]), np.complex128)
    spectrum[first:] = H
    spectrum[-1] = spectrum[-1].real  # the highest line of a real signal is real
    samples = np.fft.irfft(spectrum, axis=0)
    rate_hz = step * len(samples)
    return exponentials_of(
        samples[SKIPPED : len(samples) // 2], rate_hz, orders=orders, band_hz=band_hz, decay_rate=frfs.decay_rate
    )


def exponentials_of(
    samples: Array,
    sample_rate_hz: float,
    *,
    orders: range | Sequence[int],
    band_hz: tuple[float, float] | None = None,
    decay_rate: float = 0.0,
) -> list[ModelPoles]:
    """Poles of impulse responses h(t) = Σ_r ψ_r e^(λ_r t) L_rᵀ, sampled, from h(t) + Σ_j h(t + j) W_j = 0.

    Args:
        samples: (N, rows, references).
        sample_rate_hz: samples per second.
        orders: lags.
        band_hz: natural frequencies for which participations are computed.
        decay_rate: of a window that is in the samples, 1/s; the poles come out without it.

    Raises:
        FrfError: too few samples.
    """
    listed, band = checked_orders(orders), checked_band(band_hz)
    count, rows, m = samples.shape
    most = listed[-1]
    if (count - most) * rows < most * m:
        found = f"order {most} for {count} samples of the impulse responses"
        raise FrfError("orders", found=found, expected="lower orders, or more lines")
    with blas_on_one_thread():
        scaled = samples / np.linalg.norm(samples, axis=(0, 2), keepdims=True)
        lagged = np.concatenate([scaled[j : count - most + j] for j in range(most + 1)], axis=2).reshape(
            -1, (most + 1) * m
        )
        triangle: Any = np.linalg.qr(lagged, mode="r")

        def form(order: int) -> Array:
            leading = triangle[:, : (order + 1) * m]
            return np.asarray(leading.T @ leading)

        return denominator_poles(form, m, listed, 1 / sample_rate_hz, shift=decay_rate, band_hz=band)


def _grid(freq_hz: Array) -> tuple[int, float]:
    """Which multiple of the step the first line is, and the step.

    Raises:
        FrfError: the lines are not multiples of one step.
    """
    if len(freq_hz) < 4:
        raise FrfError("FrfSet.freq_hz", found=f"{len(freq_hz)} lines", expected="four lines at least")
    step = float((freq_hz[-1] - freq_hz[0]) / (len(freq_hz) - 1))
    first = round(freq_hz[0] / step)
    off = np.abs(freq_hz - step * (first + np.arange(len(freq_hz))))
    if off.max() > UNEVEN * step:
        line = int(np.argmax(off > UNEVEN * step))
        raise FrfError(
            "FrfSet.freq_hz",
            found=f"{freq_hz[line]:.9g} Hz at index {line}, off a grid of {step:.6g} Hz",
            expected="lines at multiples of one step, as impulse responses need",
            hint='Use method="plscf", which takes any lines.',
        )
    return first, step
