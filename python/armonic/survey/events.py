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

    Frequencies that change order between two places have crossed at the second of them, or at the first place in between
    where they are the same. Where the gap g of two neighbours has its least
    value, an ideal veering turns their shapes into each other at the rate θ' with 4gθ'² = g'' (the avoided crossing of
    two modes; du Bois, Adhikari, Lieven 2011 use the same rotation). Modes that only come near do not turn.

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
        now, before, after = (
            np.take_along_axis(f[i], high, axis=1) - np.take_along_axis(f[i], low, axis=1)
            for i in (_shifted(P, 0), _shifted(P, -1), _shifted(P, 1))
        )
        met = (before < 0) | (now <= TIE * np.take_along_axis(f, high, axis=1))
        # Of modes that passed several others at once all are marked.
        for a, b in np.unique(np.sort(np.stack([low[met], high[met]], axis=1), axis=1), axis=0):
            out[np.ix_(_passed(f[:, a], f[:, b]), [a, b])] = CROSSING
    least = (before > now) & (after >= now)
    least[[0, -1]] = False
    for i, k in np.argwhere(least):
        a, b = low[i, k], high[i, k]
        close = now[i, k] < CLOSE * f[i, b]
        if close and _trade(shapes[i - 1 : i + 2, [a, b]], weight, now[i, k], before[i, k], after[i, k]):
            out[i, a] = out[i, b] = VEERING
    return out


def _passed(f: Array, g: Array) -> NDArray[np.intp]:
    """The places at which two frequencies pass each other, (c,)."""
    order = np.where(np.abs(f - g) > TIE * np.maximum(f, g), np.sign(f - g), 0.0)
    apart = np.flatnonzero(order)
    return apart[:-1][np.diff(order[apart]) != 0] + 1


def _shifted(P: int, by: int) -> NDArray[np.intp]:
    return np.clip(np.arange(P) + by, 0, P - 1)


def _trade(shapes: Complex, weight: Array, now: float, before: float, after: float) -> bool:
    """Whether two shapes (3, 2, N) turn into each other around the middle place."""
    a, b = shapes[:, 0], shapes[:, 1]

    def product(x: Complex, y: Complex) -> complex:
        return complex(np.sum(x.conj() * weight * y))

    def mac(x: Complex, y: Complex) -> float:
        return float(abs(product(x, y)) ** 2 / max(product(x, x).real * product(y, y).real, 1e-300))

    if mac(a[0], b[2]) > mac(a[0], a[2]):
        return True
    turn = 0.5 * abs(product(b[1], a[2] - a[0])) / max(product(b[1], b[1]).real, 1e-300)
    curvature = before - 2.0 * now + after
    return bool(4.0 * now * turn**2 >= TRADED * curvature)
