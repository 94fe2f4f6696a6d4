"""A frequency response off the imaginary axis: what a contour continuation compares.

A stable response is analytic to the right of the imaginary axis, and its value at s = σ + iω is the mean of the
measured one under a bell of half width σ, Poisson's kernel. Every peak melts to a width of σ at least, so that a model
whose peaks are elsewhere still feels where the measured ones are.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

WIDEST = 0.2
"""First σ as a share of the band, in rad/s: peaks over a fifth of the band are as good as melted."""
NARROWEST = 0.05
"""Last σ as a share of the first: what is left is narrower than the error of the smoothing."""
FINEST = 0.6
"""No σ below this share of the distance between lines: narrower bells see single lines."""
LEVELS = 5
"""Rungs of the ladder."""
OVERLAP = 3.0
"""Lines that are compared on a rung, per σ."""
TAIL_NODES = 32


def ladder(freq_hz: Array) -> tuple[float, ...]:
    """The values of σ that a continuation goes down, rad/s, falling; none if the lines are too few for any.

    They fall geometrically from a fifth of the band, taken to begin at 0 Hz, to a twentieth of that, but not below what
    the lines resolve.

    Args:
        freq_hz: the lines, rising, (L,).
    """
    lines = 2 * np.pi * np.asarray(freq_hz)
    if len(lines) < 4:
        return ()
    widest = WIDEST * (lines[-1] - min(lines[0], np.median(np.diff(lines))))
    finest = max(NARROWEST * widest, FINEST * float(np.median(np.diff(lines))))
    if finest >= widest:
        return ()
    rungs = np.geomspace(widest, max(finest, NARROWEST * widest), LEVELS)
    return tuple(float(sigma) for sigma in rungs)


def thinned(freq_hz: Array, sigma: float) -> NDArray[np.intp]:
    """Which lines to compare on a rung: at a distance of a third of σ, for what is smoothed says no more than that."""
    lines = 2 * np.pi * np.asarray(freq_hz)
    step = max(int(sigma / OVERLAP / np.median(np.diff(lines))), 1)
    return np.arange(len(lines) - 1, -1, -step)[::-1]


def smoothed(
    freq_hz: Array,
    mobility: Complex,
    sigma: float,
    used: NDArray[np.bool_] | None = None,
    at: NDArray[np.intp] | None = None,
) -> Complex:
    """H(σ + iω) from H(iω) on a band: Poisson's integral over the lines and their mirror images below zero.

    H(σ+iω) = 1/π ∫ H(iω') σ/((ω−ω')² + σ²) dω'. It is the mobility that is smoothed: a noise floor of the accelerance
    would swell at low frequencies in the receptance, and the accelerance does not fall off above the band. There the
    mobility is taken to fall as 1/ω (free masses), below the band to keep its first value. The bells are normalized, so
    that it stays a mean where lines are too coarse for them.

    Args:
        freq_hz: the lines, rising, (L,).
        mobility: measured, (L, p, m).
        sigma: σ > 0, rad/s.
        used: which values count, (L, p, m); the others are bridged. All if not given.
        at: indices of the lines where it is wanted, (K,); all if not given.

    Returns:
        The mobility at σ + iω, (K, p, m).
    """
    lines = 2 * np.pi * np.asarray(freq_hz)
    wanted = lines if at is None else lines[at]
    shape = (len(wanted), *mobility.shape[1:])
    if used is None or used.all():
        return _smoothed(wanted, lines, mobility.reshape(len(lines), -1), sigma).reshape(shape)
    out = np.ones(shape, complex)
    for pair in np.ndindex(mobility.shape[1:]):
        kept = used[(slice(None), *pair)]
        if kept.any() and lines[kept][-1] > 0:
            values = mobility[(kept, *pair)][:, None]
            out[(slice(None), *pair)] = _smoothed(wanted, lines[kept], values, sigma)[:, 0]
    return out


def _smoothed(at: Array, lines: Array, values: Complex, sigma: float) -> Complex:
    """Smoothed `values` (K, w), given at `lines` (K,), at the points `at` (L,)."""
    middles = (lines[1:] + lines[:-1]) / 2
    edges = np.concatenate([[0.0], middles, [lines[-1]]])
    near = _bells(at[:, None] - lines, sigma) * np.diff(edges)
    far = _bells(at[:, None] + lines, sigma) * np.diff(edges)
    # The tail: with t = ω_e/ω' it has the range (0, 1], and dω' = −ω_e dt/t², of which the fall takes one t.
    t, share = _nodes()
    share = share * lines[-1] / t
    tail_near, tail_far = (_bells(at[:, None] - side * lines[-1] / t, sigma) * share for side in (1.0, -1.0))
    total = near.sum(axis=1) + far.sum(axis=1) + ((tail_near + tail_far) / t).sum(axis=1)
    near[:, -1] += tail_near.sum(axis=1)
    far[:, -1] += tail_far.sum(axis=1)
    sums: Complex = ((near @ values) + (far @ values.conj())) / total[:, None]
    return sums


@cache
def _nodes() -> tuple[Array, Array]:
    """Nodes and weights of Gauss's rule on (0, 1)."""
    t, share = np.polynomial.legendre.leggauss(TAIL_NODES)
    return (t + 1) / 2, share / 2


def _bells(distance: Array, sigma: float) -> Array:
    bells: Array = sigma / np.pi / (distance**2 + sigma**2)
    return bells
