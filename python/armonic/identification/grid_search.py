"""Grid search: modes as poles that repeat, over the orders, within one cell of frequency and damping."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.identification.selection import SelectedMode, mode_of, oscillating

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.stabilization import Stabilization

    Array: TypeAlias = NDArray[np.float64]
    Indices: TypeAlias = NDArray[np.intp]


def grid_search(
    stabilization: Stabilization,
    *,
    freq_resolution_hz: float = 0.1,
    damping_resolution: float = 0.001,
    repeats: int | None = None,
    only_stable: bool = True,
) -> list[SelectedMode]:
    """Modes whose poles stay within a resolution in frequency and damping over enough orders.

    The algorithm of the tool NAFID (Do, Vu, Liu 2019, Proceedings SURVISHNO, 119 to 127; Do et al. 2022, section 4.3),
    with its resolutions. The cells are laid around the poles themselves and not on a fixed raster, whose lines would
    cut modes in two: the pole with most orders in its cell makes a mode; then the next of what is left. The mode is the
    mean of its poles and not the cell's place, so it is not rounded to the resolution.

    A resolution in Hz suits what varies by as much: modes that are damped strongly scatter more, and two modes within
    one cell are one. `clustering.select_modes` needs no resolution.

    Args:
        stabilization: poles of all model orders.
        freq_resolution_hz: width of a cell in Hz.
        damping_resolution: width of a cell in damping ratio, a fraction.
        repeats: least number of orders; if not given, half of them.
        only_stable: whether to look only at poles that meet the criteria of the stabilization; otherwise at all that
            oscillate and decay.

    Returns:
        Modes by natural frequency.

    Raises:
        SignalError: a resolution that is not positive, or repeats that are below 2 or beyond the number of orders.
    """
    orders = len(stabilization.orders)
    for name, value in (("freq_resolution_hz", freq_resolution_hz), ("damping_resolution", damping_resolution)):
        if not (value > 0 and np.isfinite(value)):
            raise SignalError(name, found=repr(value), expected="a number above 0")
    least = max(2, (orders + 1) // 2) if repeats is None else repeats
    if not 2 <= least <= orders:
        raise SignalError(
            "repeats", found=f"{least} of {orders} orders", expected=f"2 to {orders}, the number of model orders"
        )
    damping = stabilization.damping_ratio
    candidates = np.flatnonzero(oscillating(stabilization))
    if only_stable:
        candidates = candidates[stabilization.stable[candidates]]
    if not len(candidates):
        return []
    cells = np.column_stack(
        [stabilization.natural_freq_hz[candidates] / freq_resolution_hz, damping[candidates] / damping_resolution]
    )
    groups = _cells(cells, stabilization.order[candidates], least)
    modes = (mode_of(stabilization, candidates[group]) for group in groups)
    return sorted(modes, key=lambda mode: mode.natural_freq_hz)


def _cells(place: Array, order: Indices, least: int) -> list[Indices]:
    """Disjoint groups of poles within half a unit of one of them, no two of one order, the largest first."""
    from scipy.spatial import cKDTree

    tree = cKDTree(place)
    upper = np.asarray(tree.query_ball_point(place, 0.5, p=np.inf, return_length=True), np.intp)
    # Largest first; a bound that is out of date is replaced by the true count when its turn comes.
    queue = [(-count, i) for i, count in enumerate(upper.tolist()) if count >= least]
    heapq.heapify(queue)
    free = np.ones(len(place), bool)
    groups: list[Indices] = []
    while queue:
        bound, i = heapq.heappop(queue)
        if not free[i]:
            continue
        near = np.asarray(tree.query_ball_point(place[i], 0.5, p=np.inf), np.intp)
        near = near[free[near]]
        # Of two poles of one order the nearer one.
        near = near[np.argsort(np.abs(place[near] - place[i]).max(axis=1), kind="stable")]
        group = near[np.unique(order[near], return_index=True)[1]]
        if len(group) < -bound:
            if len(group) >= least:
                heapq.heappush(queue, (-len(group), i))
            continue
        groups.append(group)
        free[near] = False
    return groups
