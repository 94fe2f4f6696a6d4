"""Poles of one model order, as every identification method hands them on, and what is read off a pole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

LEAST_DISCRETE_POLE = float(np.finfo(float).eps)
"""A motion that falls below rounding within one sample leaves nothing in the data: smaller |μ| are dropped."""


@dataclass(frozen=True, eq=False, repr=False)
class ModelPoles:
    """Poles and shapes of one model order, in continuous time, sorted by natural frequency.

    Attributes:
        order: the model order, as its method counts it (lags of an autoregression, states of a subspace model).
        poles: λ, (k,), rad/s; of each conjugate pair the one with Im λ > 0, and the real ones.
        shapes: by rows, (k, m) over the m channels, of unit length with the largest entry real and positive; rows of
            NaN where no shape was asked for (outside the band).
        freq_std_hz: standard deviation of each natural frequency, (k,), or None where none was computed.
        damping_std: standard deviation of each damping ratio, (k,), or None.
    """

    order: int
    poles: Complex
    shapes: Complex
    freq_std_hz: Array | None = None
    damping_std: Array | None = None

    def __len__(self) -> int:
        """Number of poles."""
        return len(self.poles)

    def __repr__(self) -> str:
        """The order and how many poles it has, in one line."""
        return f"ModelPoles(order {self.order}, {len(self)} poles over {self.shapes.shape[1]} channels)"


def natural_freq_hz(poles: Complex) -> Array:
    """Natural frequencies |λ| / 2π in Hz of poles λ in rad/s, of any shape."""
    return np.asarray(np.abs(poles) / (2 * np.pi), np.float64)


def damping_ratio(poles: Complex) -> Array:
    """Damping ratios −Re λ / |λ| of poles λ, of any shape; a fraction, negative for a growing motion, 0 for λ = 0."""
    size = np.abs(poles)
    return np.divide(-np.real(poles), size, out=np.zeros(np.shape(size)), where=size > 0)


def continuous_poles(discrete: Complex, sample_rate_hz: float) -> Complex:
    """Poles λ = log(μ) · sample rate, in rad/s, of poles μ in discrete time other than zero.

    A motion above half the sampling rate comes out at the frequency it is aliased to: |Im λ| is at most π times the
    rate, and that of a negative real μ is +π times the rate.
    """
    # Adding zero turns an imaginary part of −0, which lies below the cut of the logarithm, into +0.
    return np.asarray(np.log(np.asarray(discrete, np.complex128) + 0.0) * sample_rate_hz, np.complex128)


def kept_poles(discrete: Complex) -> NDArray[np.intp]:
    """Which poles μ of a real model in discrete time are handed on, as indices, in the order of |log μ|.

    One of each conjugate pair (Im μ > 0), and all real ones except those too small to have left a trace. Poles that
    grow (|μ| ≥ 1) stay: what is a mode is for the selection to say. A negative real μ stays too: it is what becomes of
    a pair close to half the sampling rate, and stands in continuous time with that frequency, Im λ = π · sample rate.
    """
    keep = np.flatnonzero(np.isfinite(discrete) & (discrete.imag >= 0) & (np.abs(discrete) > LEAST_DISCRETE_POLE))
    rate = np.log(discrete[keep].astype(np.complex128))
    return keep[np.lexsort((rate.imag, np.abs(rate)))]


def unit_shapes(shapes: Complex) -> Complex:
    """Shapes by rows, (k, m), scaled to unit length and turned so that the largest entry is real and positive."""
    if not shapes.size:
        return np.asarray(shapes, np.complex128)
    largest = np.take_along_axis(shapes, np.argmax(np.abs(shapes), axis=1)[:, None], axis=1)
    length = np.linalg.norm(shapes, axis=1, keepdims=True)
    size = np.abs(largest)
    turn = np.divide(largest.conj(), size, out=np.ones_like(largest), where=size > 0)
    return np.asarray(np.divide(shapes, length, out=np.zeros_like(shapes), where=length > 0) * turn, np.complex128)


def in_band(poles: Complex, band_hz: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Which poles have their natural frequency in the band, ends included; all of them without a band."""
    if band_hz is None:
        return np.ones(np.shape(poles), bool)
    freq = natural_freq_hz(poles)
    return np.asarray((band_hz[0] <= freq) & (freq <= band_hz[1]))
