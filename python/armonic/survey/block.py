"""One block of a survey: the modes at a stretch of the walk, computed without knowing any other block.

A block begins one place before its own, where the one before it ends: there the modes of both are the same numbers,
which tells how the block's modes are called in the whole survey. So blocks may be computed anywhere and in any order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from armonic.errors import SurveyError
from armonic.modal import STABILITY_TOLERANCE
from armonic.survey.events import events
from armonic.survey.following import follow
from armonic.survey.walk import reflected

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.survey.systems import Field
    from armonic.survey.walk import Indices

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

SAME = 1e-6
"""Poles of one system that two blocks found differ by less than this share of their size."""


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
        before: (m, 2) poles at the place before the block, in the order of its modes; None at the beginning.
    """

    places: Indices
    poles: Complex
    mac: Array
    event: NDArray[np.int8]
    residual: Array
    method: NDArray[np.int8]
    shapes: Complex | None
    participation: NDArray[np.float32] | None
    before: Complex | None

    def named_after(self, last: Complex | None) -> Block:
        """The block with its modes in the order of the survey, of which `last` (m, 2) are those at the place before.

        Raises:
            SurveyError: they are not the poles that the block found there.
        """
        if self.before is None or last is None:
            return self
        size = np.abs(last[:, None]) + np.abs(self.before[None])
        # A slot's two poles may stand in either order where they are real.
        cost = np.nan_to_num(np.abs(last[:, None] - self.before[None]) / np.where(size > 0, size, 1.0)).sum(axis=-1)
        _, order = linear_sum_assignment(cost)
        if not cost[np.arange(len(order)), order].max() < SAME:
            raise SurveyError(
                "survey",
                found="modes that do not continue those of the block before",
                expected="the same poles at the place where two blocks meet",
                hint="Repeated poles can do this; survey fewer postures at a time.",
            )
        return replace(
            self,
            poles=self.poles[:, order],
            mac=self.mac[:, order],
            event=self.event[:, order],
            shapes=None if self.shapes is None else self.shapes[:, order],
            participation=None if self.participation is None else self.participation[:, order],
            before=self.before[order],
        )

    @property
    def stability(self) -> NDArray[np.int8]:
        """(P,) 1 asymptotically stable, 0 marginal, -1 unstable (Do et al. 2022, section 3.2)."""
        # The first pole of a slot is the one further right.
        worst = self.poles[:, :, 0].real.max(axis=1)
        squares = self.poles.real**2 + self.poles.imag**2
        tolerance = STABILITY_TOLERANCE * np.sqrt(np.fmax.reduce(squares, axis=(1, 2)))
        return np.where(worst > tolerance, -1, np.where(worst >= -tolerance, 0, 1)).astype(np.int8)


def compute(field: Field, start: int, stop: int, *, shapes: bool, participation: bool) -> Block:
    """The block of steps `start` to `stop` (exclusive) of a walk.

    Args:
        field: the robot and the walk.
        start: first step.
        stop: step after the last.
        shapes: whether to keep mode shapes.
        participation: whether to keep energy shares.

    Raises:
        ModelError: some posture has no modes.
    """
    # One place more on both sides: to continue from, and to see an event at the last place.
    first, last = max(start - 1, 0), min(stop + 1, field.walk.count)
    places = reflected(field.walk.shape, np.arange(first, last))
    systems = field.at(places)
    found = follow(field, systems, places)
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
        before=found.poles[0] if first < start else None,
    )
