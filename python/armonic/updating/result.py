"""The result of model updating: the robot as it was and is, what became of each parameter, and how the fit went."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ModelError
from armonic.linear import linearize
from armonic.updating.laws import values_in
from armonic.updating.models import robot_with

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.linear import Posture
    from armonic.modal import Modes
    from armonic.response import Frf
    from armonic.robot import Robot
    from armonic.updating.descent import Ending
    from armonic.updating.measurement import Measurement
    from armonic.updating.modal_data import ModalMeasurement
    from armonic.updating.options import Method
    from armonic.updating.parameters import Parameter
    from armonic.updating.record import Record
    from armonic.updating.stages import StageEnd
    from armonic.updating.task import Task
    from armonic.updating.uncertainty import FittedParameter

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The result of model updating.

    Attributes:
        start: the description before.
        parameters: value, bounds, 95 % interval and verdict of each fitted parameter; none is called identified by data
            that the model does not explain.
        coordinates: the same parameters as the fit moved them.
        covariance: of the coordinates x, (c, c); infinite on the diagonal where the data say nothing.
        information: JᵀJ/noise² by x of all values used, under equal weights, and what modes and priors add, (c, c).
        cost: weighted sum of squared differences at the end (Huynh et al. 2021, Eq. 22, unless another cost was asked
            for), priors included.
        start_cost: the same before.
        cost_history: lowest cost after each evaluation, (E,), each stage by its own cost; see `stages`.
        stages: the stages of the run that was kept, in order: name, σ, history.
        evaluations: how often residual and Jacobian were computed, over all stages and starts.
        starts: final cost of each start, in order; only one unless more were asked for or the first explained nothing.
        noise: estimated relative noise of the responses (standard deviation of one real part of ln H); of a fit to
            modes alone, of their differences over the deviations stated.
        status: "converged", "limit" or "interrupted".
        message: how it ended, in words.
        method: "continuation", "least_squares" or "genetic".
        doubts: what speaks against trusting verdicts and intervals, in full sentences; empty if nothing does.
        record: what went in, for the files.
        task: measurements, models and parameters together, as the fit worked with them.
        duration_s: from call to return, wall clock.
        measurements: responses that were fitted.
        modal_measurements: modes that were fitted.
        postures: label of each measurement's posture, once each.
        before: modes before, one per entry of `postures`.
        after: modes after.
        mac: mass-weighted MAC of modes before (rows) and after (columns), one matrix per posture.
        frf_before: model responses before, one per measurement, in its kind and lines.
        frf_after: model responses after.
    """

    start: Robot
    parameters: tuple[FittedParameter, ...]
    coordinates: tuple[Parameter, ...]
    covariance: Array
    information: Array
    cost: float
    start_cost: float
    cost_history: Array
    stages: tuple[StageEnd, ...]
    evaluations: int
    starts: tuple[float, ...]
    noise: float
    status: Ending
    message: str
    method: Method
    doubts: tuple[str, ...]
    record: Record
    task: Task
    duration_s: float
    measurements: tuple[Measurement, ...]
    modal_measurements: tuple[ModalMeasurement, ...]
    postures: tuple[str, ...]
    before: tuple[Modes, ...]
    after: tuple[Modes, ...]
    mac: tuple[Array, ...]
    frf_before: tuple[Frf, ...]
    frf_after: tuple[Frf, ...]

    @cached_property
    def robot(self) -> Robot:
        """The description with the fitted numbers, comments kept; under laws with the values at ξ = 0."""
        return robot_with(self.start, self.coordinates, np.array([p.value for p in self.parameters]))

    def robot_in(self, posture: Posture) -> Robot:
        """The description as its laws have it in a posture; the same everywhere if there is no law.

        Raises:
            PostureError: the posture does not fit the robot.
            ModelError: a law leaves no positive stiffness there.
        """
        model = linearize(self.start, posture)
        try:
            here, _ = values_in(self.coordinates, np.array([p.value for p in self.parameters]), model)
        except ArithmeticError as error:
            raise ModelError("robot_in", found=str(error), expected="a posture where its law holds") from None
        return robot_with(self.start, self.coordinates, here)

    def __repr__(self) -> str:
        """How it ended and what it found, in one line."""
        verdicts = Counter(p.verdict for p in self.parameters)
        found = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        cost = f"cost {self.start_cost:.4g} -> {self.cost:.4g} in {self.evaluations} evaluations"
        return f"Fit({self.status}, {cost}, {len(self.parameters)} parameters: {found})"
