"""Choosing measurements by the information that they carry: criteria, greedy choice, exchange. Plain linear algebra.

The information of independent measurements adds up; its inverse is the covariance of what is estimated (Fedorov,
*Theory of Optimal Experiments*, 1972; Atkinson, Donev, Tobias, *Optimum Experimental Designs*, 2007).
"""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

Criterion = Literal["intervals", "D", "A"]
CRITERIA: tuple[Criterion, ...] = ("intervals", "D", "A")

EXHAUSTIVE = 5000
"""Up to so many combinations are all looked at."""
STARTS = 16
"""Else an exchange begins from so many sets, beside those of the greedy choices."""
BATCH = 2048


def deviations(information: Array) -> Array:
    """Standard deviations, (..., c), of positive definite information (..., c, c)."""
    return np.sqrt(np.diagonal(_covariance(information), axis1=-2, axis2=-1))


def _covariance(information: Array) -> Array:
    # Of unit diagonal, so that what is known to six digits and what is known to a factor do not spoil each other.
    scale = 1 / np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(both * np.linalg.inv(information * both))


def value(information: Array, criterion: Criterion) -> Array:
    """What a criterion makes as small as it can, (...,), of positive definite information (..., c, c).

    "intervals" is Σ ln σ, half the log det of the covariance's diagonal: what all intervals together lose of their
    logarithmic width, whatever trades against what. "D" is half the log det of the whole covariance, the logarithm of
    the ellipsoid's volume. "A" is the trace of the covariance, which looks at what is known least.
    """
    if criterion == "D":
        return np.asarray(-0.5 * np.linalg.slogdet(information)[1])
    spread = deviations(information)
    return np.asarray(np.log(spread).sum(axis=-1) if criterion == "intervals" else (spread**2).sum(axis=-1))


def values(base: Array, added: Array, criterion: Criterion) -> Array:
    """The criterion, (N,), of a base (c, c) with each of the added ones (N, c, c), in portions."""
    parts = [value(base + added[i : i + BATCH], criterion) for i in range(0, len(added), BATCH)]
    return np.concatenate(parts) if parts else np.zeros(0)


def deviations_beside(base: Array, added: Array) -> Array:
    """Standard deviations, (N, c), of a base (c, c) with each of the added ones (N, c, c), in portions."""
    parts = [deviations(base + added[i : i + BATCH]) for i in range(0, len(added), BATCH)]
    return np.concatenate(parts)


def choose(base: Array, added: Array, count: int, criterion: Criterion) -> tuple[int, ...]:
    """The measurements that make a criterion least, each at most once, the most useful first.

    Few combinations are all tried. Else sets grow greedily, by this criterion and by the others, some begin with other
    measurements, and each is improved by exchange until no swap of one measurement makes it better.

    Args:
        base: information before, (c, c), positive definite.
        added: information of each candidate, (N, c, c).
        count: how many of them, 1 to N.
        criterion: what to make least.

    Returns:
        Their indices, so that the first alone is best, then the second beside it, and so on.
    """
    number = len(added)
    if comb(number, count) <= EXHAUSTIVE:
        sets = np.array(list(combinations(range(number), count)))
        totals = np.zeros((len(sets), *base.shape))
        for column in sets.T:
            totals += added[column]
        best = sets[int(np.argmin(values(base, totals, criterion)))].tolist()
        return _in_order(base, added, best, criterion)
    alone = np.argsort(values(base, added, criterion), kind="stable")
    spread = np.unique(np.linspace(0, number - 1, STARTS // 2).astype(int))
    first = dict.fromkeys([*alone[: STARTS // 2].tolist(), *alone[spread].tolist()])
    starts = [_grown(base, added, [], count, c) for c in CRITERIA]
    starts += [_grown(base, added, [i], count, criterion) for i in first]
    ends = {tuple(sorted(start)): None for start in starts}
    known: dict[tuple[int, ...], tuple[int, float]] = {}
    improved = [_exchanged(base, added, list(start), criterion, known) for start in ends]
    return _in_order(base, added, min(improved, key=lambda end: end[1])[0], criterion)


def _grown(base: Array, added: Array, chosen: Sequence[int], count: int, criterion: Criterion) -> list[int]:
    grown = list(chosen)
    total = base + added[grown].sum(axis=0)
    while len(grown) < count:
        left = values(total, added, criterion)
        left[grown] = np.inf
        grown.append(int(np.argmin(left)))
        total = total + added[grown[-1]]
    return grown


def _exchanged(
    base: Array, added: Array, chosen: list[int], criterion: Criterion, known: dict[tuple[int, ...], tuple[int, float]]
) -> tuple[list[int], float]:
    """A set that no swap of one measurement improves (Fedorov's exchange), and its value.

    `known` remembers the best companion of others, and the value with it: starts soon come to the same sets.
    """
    best = float(value(base + added[chosen].sum(axis=0), criterion))
    settled = 0
    place = 0
    while settled < len(chosen):
        others = chosen[:place] + chosen[place + 1 :]
        if (key := tuple(sorted(others))) not in known:
            swapped = values(base + added[others].sum(axis=0), added, criterion)
            swapped[others] = np.inf
            known[key] = int(np.argmin(swapped)), float(swapped.min())
        winner, value_there = known[key]
        if value_there < best - 1e-12 * max(abs(best), 1.0):
            chosen[place], best, settled = winner, value_there, 0
        settled += 1
        place = (place + 1) % len(chosen)
    return chosen, best


def _in_order(base: Array, added: Array, chosen: Sequence[int], criterion: Criterion) -> tuple[int, ...]:
    kept = list(chosen)
    order = _grown(base, added[kept], [], len(kept), criterion)
    return tuple(kept[i] for i in order)
