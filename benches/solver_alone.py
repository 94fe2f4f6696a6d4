"""The solver's part of `am.update` on the KUKA, with nothing before and after: what the benches of fitting share."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

import armonic as am
from armonic import _core
from armonic.synthesis import system
from armonic.updating.measurement import levelled
from armonic.updating.parameters import choose
from armonic.updating.solver import Objective, Run, minimize

TOLERANCE = 1e-10
LIMIT = 1000


def kuka_start() -> am.Robot:
    """The KUKA with the initial values and bounds of Table 4 of Huynh et al. 2021."""
    return am.load(str(files("armonic.examples") / "kuka_start.yaml"))


class Solver:
    """All elasticity of a robot fitted to one measurement."""

    def __init__(self, robot: am.Robot, data: am.Measurement) -> None:
        model = am.linearize(robot, data.posture)
        chosen = choose(robot, model.impedances, "elasticity", None)
        self.start, self.lower, self.upper = (
            np.array([getattr(p, name) for p in chosen]) for name in ("start", "lower", "upper")
        )
        self.theta, self.free = np.concatenate([model.spring, model.damper]), [p.index for p in chosen]
        s, weights = 2j * np.pi * data.frf.freq_hz, data.line_weights()
        power = {"receptance": 0, "mobility": 1, "accelerance": 2}[data.frf.kind]
        receptance = data.frf.values / s[:, None, None] ** power
        core = system(model, data.frame, data.frf.outputs, data.frf.inputs)
        self.problem, self.levelled = (_core.Problem([(core, s, receptance, w)]) for w in (weights, levelled(weights)))

    def run(self, start: np.ndarray | None = None, *, first_pass: bool = True) -> Run:
        """One fit, with or without the pass under levelled weights."""
        return minimize(
            Objective(self.problem, self.theta, self.free, limit=LIMIT),
            self.start if start is None else start,
            self.lower,
            self.upper,
            tolerance=TOLERANCE,
            levelled=self.levelled if first_pass else None,
        )
