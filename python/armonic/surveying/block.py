"""One block of a survey: the modes at a stretch of the walk, computed without knowing any other block.

A block begins one place before its own, where the one before it ends, or further back while poles are equal there: at
that place the modes of both are the same numbers, which tells how the block's modes are called in the whole survey. So
blocks may be computed anywhere and in any order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from armonic.modal import STABILITY_TOLERANCE
from armonic.surveying.events import events
from armonic.surveying.following import apart, distinct, follow
from armonic.surveying.walk import reflected

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.surveying.systems import Field
    from armonic.surveying.walk import Indices

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

SAME = 1e-6
"""Poles of one system that two blocks found differ by less than this share of their size."""
FURTHEST = 8
"""Places to look back for distinct poles; a robot that has none for longer has joints that are alike."""


@dataclass(frozen=True)
class Block:
    """Modes at P places in the order of the walk.

    Attributes:
        places: where in the box each one stands (row-major), (P,).
        poles: (P, m, 2), see `following.Stretch`.
        mac: with the shape before, (P, m).
        event: crossing or veering, (P, m).
        residual: (P,) relative, NaN from the dense solver.
        method: (P,) continuation or dense solver.
        shapes: (P, m, N), or None.
        participation: (P, m, n) share of each coordinate's springs in the elastic energy, or None.
        start: the place (row-major) from which the block was followed; None at the beginning of the walk.
        before: (m, 2) poles at that place, in the order of the block's modes.
    """

    places: Indices
    poles: Complex
    mac: Array
    event: NDArray[np.int8]
    residual: Array
    method: NDArray[np.int8]
    shapes: Complex | None
    participation: NDArray[np.float32] | None
    start: int | None
    before: Complex

    def named_after(self, known: Complex) -> Block | None:
        """The block with its modes in the order of the survey, of which `known` (m, 2) are those at `start`.

        None where slots do not hold the same poles.
        """
        # One pole in a slot has no partner in both.
        cost = np.nan_to_num(apart(known[:, None], self.before), nan=0.0).max(axis=-1)
        cost[np.isnan(known[:, None]).any(axis=-1) != np.isnan(self.before).any(axis=-1)] = 1.0
        _, order = linear_sum_assignment(cost)
        if cost[np.arange(len(order)), order].max() >= SAME:
            return None
        if (order == np.arange(len(order))).all():
            return self
        return replace(
            self,
            poles=self.poles.take(order, axis=1),
            mac=self.mac.take(order, axis=1),
            event=self.event.take(order, axis=1),
            shapes=None if self.shapes is None else self.shapes.take(order, axis=1),
            participation=None if self.participation is None else self.participation.take(order, axis=1),
            before=self.before[order],
        )

    @property
    def where(self) -> Indices | slice:
        """The places, as a slice where they follow each other: copies are faster then."""
        first, last = int(self.places[0]), int(self.places[-1])
        return slice(first, last + 1) if (np.diff(self.places) == 1).all() else self.places

    @property
    def stability(self) -> NDArray[np.int8]:
        """(P,) 1 asymptotically stable, 0 marginal, -1 unstable (Do et al. 2022, section 3.2)."""
        # The first pole of a slot is the one further right; of a pair both have the same size.
        first = np.ascontiguousarray(self.poles[:, :, 0].T)
        worst, square = first.real.max(axis=0), (first.real**2 + first.imag**2).max(axis=0)
        slots = (first.imag == 0).any(axis=1)
        if slots.any():
            partners = self.poles[:, slots, 1]
            square = np.fmax(square, np.fmax.reduce(partners.real**2 + partners.imag**2, axis=1))
        tolerance = STABILITY_TOLERANCE * np.sqrt(square)
        return np.where(worst > tolerance, -1, np.where(worst >= -tolerance, 0, 1)).astype(np.int8)


def compute(
    field: Field, start: int, stop: int, known: Complex | None = None, *, shapes: bool, participation: bool
) -> Block:
    """The block of steps `start` to `stop` (exclusive) of a walk.

    Args:
        field: the robot and the walk.
        start: first step.
        stop: step after the last.
        known: poles (m, 2) of the survey at the place from which the block is followed, if its modes are to be theirs.
        shapes: whether to keep mode shapes.
        participation: whether to keep energy shares.

    Raises:
        ModelError: some posture has no modes.
    """
    # Places more on both sides: to continue from, and to see an event at the last place.
    steps = np.arange(max(start - FURTHEST, 0), min(stop + 1, field.walk.count))
    places = reflected(field.walk.shape, steps)
    at = nearest = max(start - steps[0] - 1, 0)
    modes = field.dense(int(places[at]))
    while at > 0 and not distinct(modes):
        at -= 1
        modes = field.dense(int(places[at]))
    if not distinct(modes):
        at, modes = nearest, field.dense(int(places[nearest]))
    first, places = steps[at], places[at:]
    systems = field.at(places)
    found = follow(field, systems, places, modes, known, shares=participation)
    weight = np.concatenate([np.diag(systems.mass[0]), field.robot.drives.inertia])
    happened = events(found.poles[:, :, 0], found.shapes, weight)
    own = slice(start - first, start - first + stop - start)
    return Block(
        places=places[own],
        poles=found.poles[own],
        mac=found.mac[own],
        event=happened[own],
        residual=found.residual[own],
        method=found.method[own],
        shapes=found.shapes[own] if shapes else None,
        participation=found.shares[own] if participation else None,
        start=int(places[0]) if first < start else None,
        before=found.poles[0],
    )
