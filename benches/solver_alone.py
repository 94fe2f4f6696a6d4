"""The solver's part of `am.update`, with nothing before and after: what the benches of fitting share."""

from __future__ import annotations

from importlib.resources import files
from typing import Literal

import numpy as np

import armonic as am
from armonic.updating.parameters import choose
from armonic.updating.residuals import Descending
from armonic.updating.stages import Run, Walker, stages_of
from armonic.updating.task import Task

TOLERANCE = 1e-10
LIMIT = 1000

Way = Literal["continuation", "levelled", "least squares"]


def kuka_start() -> am.Robot:
    """The KUKA with the initial values and bounds of Table 4 of Huynh et al. 2021."""
    return am.load(str(files("armonic.examples") / "kuka_start.yaml"))


class Solver:
    """All elasticity of a robot fitted to measurements, from any start; every problem is made once."""

    def __init__(self, robot: am.Robot, *data: am.Measurement) -> None:
        models = tuple(am.linearize(robot, m.posture) for m in data)
        self.task = Task(robot, data, models, (), choose(robot, models[0].impedances, "elasticity"))
        weights = [m.line_weights() for m in data]
        options = {"tolerance": TOLERANCE, "anchored": 1.0}
        stages = stages_of(self.task, weights, continuation=True, **options)
        self.stages = {
            "continuation": stages,
            "levelled": [stage for stage in stages if stage.sigma == 0],
            "least squares": stages_of(self.task, weights, continuation=False, **options),
        }
        self._made: dict[str, dict[int, Descending]] = {way: {} for way in self.stages}

    def run(self, start: np.ndarray | None = None, *, way: Way = "continuation") -> Run:
        """One run: down the ladder, from the levelled stage on, or under the cost alone; no second try."""
        walker = Walker(self.stages[way], *self.task.box, LIMIT, _residuals=self._made[way])
        return walker.run(self.task.start if start is None else start)
