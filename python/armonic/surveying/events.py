"""Where modes come close along a walk: crossings, which they pass unchanged, and veerings, where they trade shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

NONE, CROSSING, VEERING = 0, 1, 2
TIE = 1e-11
"""Frequencies closer than this share of them are one frequency: poles are not known better."""
CLOSE = 0.1
"""Modes further apart than this share of their frequency do not veer from each other."""
TRADED = 0.5
"""Least share of the rotation of an ideal veering of two modes."""


def events(poles: Complex, shapes: Complex, weight: Array) -> NDArray[np.int8]:
    """What happens to each mode at each place of a stretch; its first and last place are not judged.

    Frequencies that change order between two places have crossed at the second of them, or at the first in between
    where they are the same. Where the gap g of two neighbours has its least value, an ideal veering turns their shapes
    into each other at the rate θ' with 4gθ'² = g'' (the avoided crossing of two modes; du Bois, Adhikari, Lieven 2011
    use the same rotation). Modes that only come near do not turn.

    Args:
        poles: (P, m) of one pole per mode.
        shapes: (P, m, N).
        weight: (N,) positive weights that give the entries of a shape one unit, as the diagonal of the mass matrix.

    Returns:
        (P, m) `NONE`, `CROSSING` or `VEERING`, the veering at the place of the least gap.
    """
    P, m = poles.shape
    out = np.zeros((P, m), np.int8)
    if P < 2 or m < 2:
        return out
    f = np.abs(poles)
    rank = np.argsort(f[0], kind="stable")
    gaps = np.diff(f[:, rank], axis=1)
    if (gaps > TIE * f[:, rank[1:]]).all():  # the order never changes, as on most stretches
        low, high = np.broadcast_to(rank[:-1], gaps.shape), np.broadcast_to(rank[1:], gaps.shape)
        now, before, after = gaps, gaps[_shifted(P, -1)], gaps[_shifted(P, 1)]
    else:
        rank = np.argsort(f, axis=1, kind="stable")
        low, high = rank[:, :-1], rank[:, 1:]
        ordered = np.take_along_axis(f, rank, axis=1)
        now = np.diff(ordered, axis=1)
        before, after = now[_shifted(P, -1)], now[_shifted(P, 1)]
        # Where the order changes, the gap of the same two modes is another one at the place beside.
        turned = np.flatnonzero((rank[1:] != rank[:-1]).any(axis=1))
        for gap, row, beside in ((before, turned + 1, turned), (after, turned, turned + 1)):
            gap[row] = f[beside[:, None], high[row]] - f[beside[:, None], low[row]]
        tied = now <= TIE * ordered[:, 1:]
        now = np.where(tied, 0.0, now)
        rows = np.flatnonzero(((before < 0) | tied).any(axis=1))
        changed = _order(f[rows, :, None], f[rows, None]) != _order(f[rows - 1, :, None], f[rows - 1, None])
        for a, b in np.argwhere(np.triu(changed.any(axis=0))):
            out[np.ix_(_passed(f[:, a], f[:, b]), [a, b])] = CROSSING
    least = (before > now) & (after >= now) & (now > 0)
    least[[0, -1]] = False
    i, k = np.nonzero(least & (now < CLOSE * np.take_along_axis(f, high, axis=1)))
    a, b = low[i, k], high[i, k]
    around = shapes[i[:, None, None] + np.array([[-1], [0], [1]]), np.stack([a, b], axis=1)[:, None]]
    traded = _trade(around, weight, now[i, k], before[i, k], after[i, k])
    for modes in (a, b):
        out[i[traded], modes[traded]] = VEERING
    return out


def _order(f: Array, g: Array) -> Array:
    """Which of two frequencies is the higher one: one, minus one, or zero where they are the same."""
    return np.asarray(np.where(np.abs(f - g) > TIE * np.maximum(f, g), np.sign(f - g), 0.0))


def _passed(f: Array, g: Array) -> NDArray[np.intp]:
    """The places at which two frequencies pass each other, (c,)."""
    order = _order(f, g)
    apart = np.flatnonzero(order)
    return np.asarray(apart[:-1][np.diff(order[apart]) != 0] + 1, np.intp)


def _shifted(P: int, by: int) -> NDArray[np.intp]:
    return np.clip(np.arange(P) + by, 0, P - 1)


def _trade(shapes: Complex, weight: Array, now: Array, before: Array, after: Array) -> NDArray[np.bool_]:
    """Whether two shapes turn into each other around the middle of three places, (c,) of shapes (c, 3, 2, N)."""
    a, b = shapes[:, :, 0], shapes[:, :, 1]

    def product(x: Complex, y: Complex) -> Complex:
        return np.asarray(np.sum(x.conj() * weight * y, axis=-1))

    def mac(x: Complex, y: Complex) -> Array:
        return np.asarray(np.abs(product(x, y)) ** 2 / np.maximum(product(x, x).real * product(y, y).real, 1e-300))

    swapped = mac(a[:, 0], b[:, 2]) > mac(a[:, 0], a[:, 2])
    size = np.maximum(product(b[:, 1], b[:, 1]).real, 1e-300)
    turn = 0.5 * np.abs(product(b[:, 1], a[:, 2] - a[:, 0])) / size
    return swapped | (4.0 * now * turn**2 >= TRADED * (before - 2.0 * now + after))
