"""What a measured file holds once it is read: time records, frequency responses, modes, geometry, and what was left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.comparison import ModeTable
    from armonic.frf_set import FrfSet
    from armonic.series import TimeSeries

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Skipped:
    """Something in a file that was not read.

    Attributes:
        dataset: which data set of the file, counted from 1; 0 where the format has none.
        line: where it begins, counted from 1; 0 for a binary format.
        what: what it is, such as "data set 58, time response at 3:+X".
        reason: why it was left, in one sentence.
    """

    dataset: int
    line: int
    what: str
    reason: str

    def __str__(self) -> str:
        """One line that says where, what and why."""
        where = f"data set {self.dataset}, line {self.line}: " if self.dataset else ""
        return f"{where}{self.what}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Geometry:
    """Points of a measurement and lines that join them.

    Attributes:
        names: of the points, the places of responses and forces.
        positions: (points, 3), m.
        lines: pairs of indices.
    """

    names: tuple[str, ...]
    positions: Array
    lines: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, eq=False)
class MeasuredFile:
    """A measured file, or several read as one.

    Attributes:
        path: of the file, or of all of them with commas.
        records: time records in the file's order; of a tap test one for each recording, with channels of force and of
            motion named PLACE.AXIS.
        frfs: frequency responses with their coherence, or None.
        modes: modes by data set 55, shapes over PLACE.AXIS, or None.
        geometry: points and lines, or None.
        skipped: what was not read, and why.
        remarks: what a user should know of what was read, in full sentences.
    """

    path: str
    records: tuple[TimeSeries, ...] = ()
    frfs: FrfSet | None = None
    modes: ModeTable | None = None
    geometry: Geometry | None = None
    skipped: tuple[Skipped, ...] = ()
    remarks: tuple[str, ...] = ()
