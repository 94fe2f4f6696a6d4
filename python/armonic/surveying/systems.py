"""The linear systems of a stretch of postures, stacked: what the core follows modes through."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.closed_loop import ClosedLoop
from armonic.errors import ModelError, SurveyError
from armonic.linear import linearize
from armonic.loads import Load
from armonic.modal import Modes, modes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.robot import Robot
    from armonic.surveying.walk import Indices, Walk

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Systems:
    """P systems of n coordinates and d drives in impedance form, Z(s) = s²M + sC + K − w k t(s) (docs/theory.md).

    Attributes:
        mass: M, (P, n, n).
        damping: C with joint dampers, (P, n, n), or (1, n, n) where all have the same.
        stiffness: K with joint springs and the springs w²k of the shafts, (P, n, n).
        drives: numbers of the drives as the core takes them, (P or 1, d, 9).
        springs: stiffness of every coordinate's own spring, (P or 1, n).
    """

    mass: Array
    damping: Array
    stiffness: Array
    drives: Array
    springs: Array

    def __getitem__(self, part: slice) -> Systems:
        """A stretch of the systems."""

        def of(stack: Array) -> Array:
            return stack if len(stack) == 1 and len(self.mass) > 1 else stack[part]

        return Systems(
            self.mass[part],
            of(self.damping),
            self.stiffness[part],
            of(self.drives),
            of(self.springs),
        )


@dataclass
class Field:
    """A robot with the values that a sweep gives it, and its linear systems anywhere on a walk.

    Attributes:
        robot: the robot as its file has it.
        walk: the walk.
        load: what acts on the robot from outside.
    """

    robot: Robot
    walk: Walk
    load: Load
    _swept: dict[int, Robot] = field(default_factory=dict, repr=False, compare=False)

    def __getstate__(self) -> dict[str, object]:
        """Without the robots of the sweep, which every process makes for itself."""
        return {**self.__dict__, "_swept": {}}

    def variant(self, row: int) -> Robot:
        """The robot at one value of the sweep."""
        if not self.walk.sweep:
            return self.robot
        if row not in self._swept:
            if len(self._swept) > 64:
                self._swept.clear()
            values = {path: float(values[row]) for path, values in self.walk.sweep.items()}
            self._swept[row] = self.robot.with_values(values)
        return self._swept[row]

    @property
    def keep(self) -> Indices:
        """Indices of the coordinates that can deflect."""
        return np.flatnonzero(self.robot.flexible)

    @property
    def places(self) -> list[int]:
        """For every drive, the index of its coordinate among those that can deflect."""
        return [int(i) for i in self._loop(self.robot).driven]

    @cached_property
    def symmetric(self) -> bool:
        """Whether the systems have the symmetric impedance form that can be followed."""
        turns = self.load.frame is not None and (bool(self.load.wrench[3:].any()) or self.load.axes == "frame")
        # Feedback of other joints may enter with a sweep.
        return not turns and all(self._loop(robot).local for robot in (self.robot, *self._extremes()))

    def _extremes(self) -> Iterator[Robot]:
        """The robot at the smallest and largest value of everything that is swept."""
        for values in self.walk.sweep.values():
            for row in (np.argmin(values), np.argmax(values)):
                yield self.variant(int(row))

    def _loop(self, robot: Robot) -> ClosedLoop:
        return ClosedLoop.of(robot, self.keep)

    def refuse(self) -> None:
        """Say what makes the survey impossible before it starts.

        Raises:
            SurveyError: an integral gain is zero for some values of the sweep only, so that poles come and go.
            RobotFileError: the smallest or largest value of a sweep is impossible.
            ModelError: nothing can deflect.
        """
        if self.keep.size == 0:
            raise ModelError(
                self.robot.name,
                found="no coordinate with elasticity or drive",
                expected="at least one",
                hint="Give a joint an `elasticity` or a `drive`.",
            )
        list(self._extremes())  # made now, so that an impossible value is refused now
        swept = [path for path in self.walk.sweep if "ki" in path.split(".")[-2:] or "link_ki" in path]
        for path in swept:
            values = self.walk.sweep[path]
            if (values == 0).any() and (values != 0).any():
                raise SurveyError(
                    f"sweep, {path}",
                    found="zero among values that are not",
                    expected="an integral gain that is zero for all values or for none",
                    hint="With the first integral action new poles appear; survey zero on its own.",
                )

    def at(self, steps: Indices) -> Systems:
        """Systems at some places of the walk's box (row-major).

        Raises:
            ModelError: no mass behind a coordinate.
        """
        rows, q = self.walk.rows_and_postures(steps)
        ends = np.flatnonzero(np.diff(rows)) + 1
        parts = [
            self._of(self.variant(int(rows[start])), q[start:end])
            for start, end in zip([0, *ends], [*ends, len(q)], strict=True)
        ]
        if len(parts) == 1:
            return parts[0]

        def stacked(name: str) -> Array:
            return np.concatenate(
                [np.broadcast_to(a, (len(p.mass), *a.shape[1:])) for p in parts for a in [getattr(p, name)]]
            )

        return Systems(*(stacked(name) for name in (*_MATRICES, "drives", "springs")))

    def _of(self, robot: Robot, q: Array) -> Systems:
        keep, drives = self.keep, robot.drives
        rest = self._loop(robot).impedances()[None], robot.stiffness[keep][None]
        if robot.bushings:
            models = [linearize(robot, row, **self._load) for row in q]
            part = slice(len(keep))
            mass, damping, stiffness = (
                np.array([getattr(model, name)[part, part] for model in models]) for name in _MATRICES
            )
            return Systems(mass, damping, stiffness, *rest)
        # A load that turns with its frame has no symmetric form: those systems are not followed.
        mass, stiffness = robot.mechanism.at_rest(q, wrenches=self.load.at(q[0]))
        if len(keep) < mass.shape[-1]:
            mass, stiffness = (np.ascontiguousarray(a[:, keep[:, None], keep]) for a in (mass, stiffness))
        springs, dampers = robot.stiffness.copy(), robot.damping.copy()
        springs[drives.coordinates] += drives.scale**2 * drives.shaft_stiffness
        dampers[drives.coordinates] += drives.joint_damping
        stiffness[:, range(len(keep)), range(len(keep))] += springs[keep]
        return Systems(mass, np.diag(dampers[keep])[None], stiffness, *rest)

    @property
    def _load(self) -> dict[str, Any]:
        if self.load.frame is None:
            return {}
        frame = self.robot.frames[self.load.frame]
        return {"wrench": self.load.wrench, "frame": frame, "wrench_axes": self.load.axes}

    def dense(self, place: int) -> Modes:
        """All modes at one place of the box by LAPACK, from the explicit form."""
        rows, q = self.walk.rows_and_postures(np.array([place]))
        return modes(self.variant(int(rows[0])), q[0], **self._load)


_MATRICES = ("mass", "damping", "stiffness")
