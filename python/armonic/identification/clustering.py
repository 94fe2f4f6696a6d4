"""Automatic selection: the modes of a stabilization without a threshold to set, and why other groups are none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.identification.combinations import without_combinations
from armonic.identification.selection import SelectedMode, Selection, mode_of, oscillating, pole_scatter, rejected_for

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.stabilization import Stabilization

    Array: TypeAlias = NDArray[np.float64]
    Indices: TypeAlias = NDArray[np.intp]

NEIGHBOURS = 4
"""Poles of an order that measure how crowded it is around a pole: more would reach into other regions of the plane."""
CLOSENESS = 0.12
"""A pole of another order is the same mode if it lies within this share of the distance to the fourth pole there. Of
poles strewn at random, 1 − (1 − 0.12²)⁴ = 6 % have one so close, before their shapes are looked at."""
CLOSENESS_PER_CHANNEL = 0.035
"""With fewer than four channels the share is only this much of each. Shapes then say little or nothing against false
poles, and those of noise drift slowly from order to order: found on noise of one to six channels."""
LEAST_LIKENESS = 0.5
"""A MAC below this counts as this. Shapes of weakly excited modes are far less certain than their poles: these come
back to a thousandth at nearly every order; what is that repeatable is no chance, whatever the shape."""
SHAPE_WEIGHT = 0.5
"""Weight of 1 − MAC beside |Δ ln λ| where several poles of an order are near enough to be the mode."""
MOST_CHANGE = 0.15
"""And within this distance, however empty the plane is around it: a mode that moves by more is of no use."""
LEAST_SHARE = 0.6
"""Share of the orders that hold a mode. Of a robot's decays with and without noise, modes are held by 70 to 99 % of the
orders, chains of false poles that drift from order to order by up to two thirds of them"""
MOST_SCATTER = 0.3
"""A pole scatters over the orders by no more than this share of its decay rate: of decays, those of modes by 0.27 at
most with 1 % of noise, those of false poles close to |μ| = 1, which take each other's places, by 0.3 to 0.8."""
SURE = 0.7
"""What more of the orders hold is a mode, however its poles scatter: no chain was seen to last that long, and those of
a random response scatter by as much as they are damped."""
UNDAMPED = 1e-3
"""Motion damped by less counts as damped by this: a sine is steady although it has no decay rate."""
CHAIN = "its poles scatter by more than 0.3 of their decay rate: a chain of false poles that drift from order to order"


def select_modes(
    stabilization: Stabilization, *, least_share: float = LEAST_SHARE, combinations: bool = True
) -> Selection:
    """Groups the poles of all orders into modes, by how much closer they lie than the poles around them.

    A mode comes back at every order at the same place; a pole of noise does not, but in a crowd one always finds
    another near by. So distance is measured in units of the crowd: a pole of another order stands for the same mode if
    |Δ ln λ| / MAC² is below 0.12 of the distance |Δ ln λ| to the fourth nearest pole of that order (less with
    few channels). |Δ ln λ| is |Δλ| / |λ| for small changes, and the fourth nearest adapts it to damped and undamped,
    low and high modes and to the size of the model alike. The pole that is held by most orders makes a mode with its
    partners, at most one of each order; then the next of what is left, until fewer than `least_share` of the orders
    hold one. Two modes that lie as close as one likes stay two as long as their poles scatter less than they are apart.

    Methods whose orders are cut out of one and the same factorization (subspace methods) repeat false poles too; ask
    for half of the orders there.

    The criteria of the stabilization are not used. The stages follow Reynders, Houbrechts & De Roeck 2012 (impossible
    poles, groups, groups too small); the measure of distance is our own. Groups whose poles scatter by too much of
    their decay rate are chains of false poles. Of the modes, combinations of two others are taken out, see
    `combinations.without_combinations`.

    Args:
        stabilization: poles of all model orders.
        least_share: share of the model orders that must hold a mode.
        combinations: whether to take out combinations.

    Raises:
        SignalError: fewer than three model orders, or a share outside (0, 1].
    """
    orders = len(stabilization.orders)
    if orders < 3:
        raise SignalError("stabilization", found=f"{orders} model orders", expected="at least three")
    if not 0 < least_share <= 1:
        raise SignalError("least_share", found=f"{least_share!r}", expected="a share above 0 and up to 1")
    least = max(3, int(np.ceil(least_share * orders - 1e-9)))
    groups = _groups(_holds(stabilization, least, int(np.ceil(1 / least_share))), least)
    found = sorted((mode_of(stabilization, group) for group in groups), key=lambda mode: mode.natural_freq_hz)
    steady = [mode for mode in found if mode.orders >= SURE * orders or _steady(mode)]
    chosen = without_combinations(steady) if combinations else Selection(tuple(steady))
    chains = tuple(rejected_for(mode, CHAIN) for mode in found if mode not in steady)
    return Selection(chosen.modes, tuple(sorted(chosen.rejected + chains, key=lambda mode: mode.natural_freq_hz)))


def _steady(mode: SelectedMode) -> bool:
    return pole_scatter(mode) <= MOST_SCATTER * max(-mode.pole.real, UNDAMPED * abs(mode.pole))


@dataclass(frozen=True)
class _Holds:
    """For each of S seeds and each order: the pole that stands for the same mode there.

    Attributes:
        pole: its index into the stabilization, (S, orders); −1 where there is none.
        distance: to it, (S, orders); infinite where there is none.
        count: number of poles in the stabilization.
    """

    pole: Indices
    distance: Array
    count: int


def _holds(stabilization: Stabilization, least: int, reach: int) -> _Holds:
    """Looks up every possible mode's partners in every order; seeds without one within `reach` orders are left out."""
    from scipy.spatial import cKDTree

    size = np.abs(stabilization.pole)
    known = np.isfinite(stabilization.shape).all(axis=1) & (size > 0)
    possible = oscillating(stabilization)
    place = np.log(np.where(size > 0, stabilization.pole, 1.0))
    plane = np.column_stack([place.real, place.imag])
    unit = stabilization.shape / np.where(known, np.linalg.norm(stabilization.shape, axis=1), 1.0)[:, None]
    of_order = [np.flatnonzero(known & (stabilization.order == order)) for order in stabilization.orders]
    closeness = min(CLOSENESS, CLOSENESS_PER_CHANNEL * stabilization.shape.shape[1])
    trees = [cKDTree(plane[poles]) if len(poles) else None for poles in of_order]

    def look(seeds: Indices, at: int) -> tuple[Indices, Array]:
        poles, tree = of_order[at], trees[at]
        if tree is None:
            return np.full(len(seeds), -1, np.intp), np.full(len(seeds), np.inf)
        apart, place_of = (np.asarray(x) for x in tree.query(plane[seeds], k=range(1, NEIGHBOURS + 1)))
        # Where there are fewer than four poles, the fourth is infinitely far.
        near_enough = np.minimum(closeness * apart[:, -1], MOST_CHANGE)
        rows = poles[np.minimum(place_of, len(poles) - 1)]
        product = np.einsum("sm,skm->sk", unit[seeds].conj(), unit[rows])
        alike = product.real**2 + product.imag**2
        distance = apart / np.maximum(alike, LEAST_LIKENESS) ** 2
        # Of several that are near enough, the shape decides as well.
        near = (distance <= near_enough[:, None]) & possible[rows]
        unlike = np.where(near, apart + SHAPE_WEIGHT * (1.0 - alike), np.inf)
        best = np.argmin(unlike, axis=1)
        nearest, chosen = unlike[np.arange(len(seeds)), best], rows[np.arange(len(seeds)), best]
        held = np.isfinite(nearest)
        return np.where(held, chosen, -1), nearest

    seeds = np.flatnonzero(possible)
    # Of a mode that a share of 1/r of the orders holds, some two poles lie within r orders of each other.
    beside = np.zeros(len(stabilization), bool)
    for step in range(1, reach + 1):
        for at, ahead in enumerate(of_order[:-step]):
            own = ahead[possible[ahead]]
            if len(own):
                partner = look(own, at + step)[0]
                beside[own[partner >= 0]] = True
                beside[partner[partner >= 0]] = True
    seeds = seeds[beside[seeds]]
    pole = np.full((len(seeds), len(of_order)), -1, np.intp)
    distance = np.full(pole.shape, np.inf)
    for at in range(len(of_order)):
        if len(seeds):
            pole[:, at], distance[:, at] = look(seeds, at)
    enough = (pole >= 0).sum(axis=1) >= least
    return _Holds(pole[enough], distance[enough], len(stabilization))


def _groups(holds: _Holds, least: int) -> list[Indices]:
    """Disjoint groups of poles: again and again the largest that is left; of equal ones the tightest."""
    groups: list[Indices] = []
    # One place more than there are poles: index −1, no pole, is taken from the start.
    taken = np.zeros(holds.count + 1, bool)
    taken[-1] = True
    rows = np.arange(len(holds.pole))
    while len(rows):
        free = ~taken[holds.pole[rows]]
        size = free.sum(axis=1)
        rows, size, free = rows[size >= least], size[size >= least], free[size >= least]
        if not len(rows):
            break
        largest = np.flatnonzero(size == size.max())
        spread = np.where(free[largest], holds.distance[rows[largest]], 0.0).sum(axis=1)
        winner = largest[np.argmin(spread)]
        group = holds.pole[rows[winner]][free[winner]]
        taken[group] = True
        groups.append(group)
    return groups
