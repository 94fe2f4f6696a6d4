"""Postures as arrays, and paths: postures evenly spaced between waypoints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from armonic.description.drives import Array
from armonic.description.schema import PathEntry


class Paths(Mapping[str, Array]):
    """The postures along each path, (P, n), read-only, computed at first use: there may be a million.

    The stretches between waypoints take equal shares of the points; where P - 1 is a multiple of their number,
    every waypoint is met.

    Args:
        entries: the paths by name.
        postures: (n,) by name.
        own: the indices of the joints' own coordinates.
        n: the number of all coordinates.
    """

    def __init__(
        self, entries: Mapping[str, PathEntry], postures: Mapping[str, Array], own: Sequence[int], n: int
    ) -> None:
        self._entries, self._postures, self._own, self._n = entries, postures, own, n
        self._made: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        if name not in self._made:
            self._made[name] = self._along(self._entries[name])
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def _along(self, entry: PathEntry) -> Array:
        waypoints = [
            self._postures[point] if isinstance(point, str) else spread(point, self._own, self._n)
            for point in entry.through
        ]
        places = np.linspace(0.0, len(waypoints) - 1.0, entry.points)
        path = np.zeros((entry.points, self._n))
        for i in self._own:
            path[:, i] = np.interp(places, np.arange(len(waypoints)), [point[i] for point in waypoints])
        path.setflags(write=False)
        return path


def spread(values: Iterable[float], own: Sequence[int], n: int) -> Array:
    """All n coordinates from the joints' own, (n,), read-only; the others are zero."""
    q = np.zeros(n)
    q[list(own)] = list(values)
    q.setflags(write=False)
    return q
