"""Model updating: measured responses and a robot in, the updated robot and how far to trust it out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.linear import linearize
from armonic.modal import mac, modes
from armonic.updating.checkpoint import Checkpoint
from armonic.updating.doubts import beyond_scatter, doubts, nothing_identified, without_resonance
from armonic.updating.genetic import Genetic
from armonic.updating.judging import judged
from armonic.updating.models import models_at, refuse_absent, responses_like, robot_with
from armonic.updating.options import check_kinds, check_options, refuse_few, sorted_measurements, with_held
from armonic.updating.parameters import choose, refuse_loaded
from armonic.updating.priors import Prior, anchors_of
from armonic.updating.record import record_of
from armonic.updating.result import Fit
from armonic.updating.running import Progress
from armonic.updating.search import Search
from armonic.updating.task import Task

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from armonic.response import Frf
    from armonic.robot import Robot
    from armonic.updating.judging import Judgement
    from armonic.updating.laws import Law
    from armonic.updating.measurement import Loss, Measurement
    from armonic.updating.modal_data import ModalMeasurement
    from armonic.updating.options import Cost, Method
    from armonic.updating.parameters import Bounds, Parameter, Patterns
    from armonic.updating.stages import Run
    from armonic.updating.uncertainty import FittedParameter

    Array: TypeAlias = NDArray[np.float64]


def update(
    robot: Robot,
    measurements: Measurement | ModalMeasurement | Sequence[Measurement | ModalMeasurement],
    *,
    parameters: Patterns = "elasticity",
    bounds: Bounds | None = None,
    hold: Patterns | Mapping[str, float] = (),
    ties: Iterable[Patterns] = (),
    laws: Mapping[str, Law] | None = None,
    priors: Mapping[str, Prior | float] | None = None,
    method: Method = "continuation",
    cost: Cost = "logarithmic",
    loss: Loss = "squares",
    genetic: Genetic | None = None,
    starts: int = 1,
    seed: int = 0,
    threads: int | None = None,
    tolerance: float = 1e-10,
    max_evaluations: int | None = None,
    checkpoint: str | Path | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Fit:
    """Fits a robot's numbers to measured frequency responses, or modes, and says what these determine.

    Minimizes Σ W |ln H_s − ln H|², the phase difference taken to its principal value (Huynh et al. 2021, Eq. 22), in
    the logarithms of the parameters, with the analytic Jacobian. By default it follows the minimum down a ladder of
    contours s = σ + iω, where peaks are blunt and the way is clear, to the imaginary axis (docs/updating.md). If the
    model then does not explain the data, it tries again from a few random starts. Ctrl-C ends the run and keeps the
    best so far.

    Args:
        robot: start values, and bounds where its file gives them.
        measurements: one or more, responses or modes; all are fitted with one set of parameters.
        parameters: paths, shell patterns or groups: "elasticity", "stiffness", "links.arm.elasticity.*.stiffness", ...
            Masses, centres of mass, inertia, gains, shafts and placements are named by paths of their own
            ("links.arm.mass"); derivatives with respect to them are exact in s, and central differences in the
            matrices.
        bounds: (low, high) by path or pattern, within those of the file; a factor of a thousand either way where
            neither gives any (ten for masses and the like).
        hold: what is not fitted though it matches; a mapping gives values, others keep those of the robot.
        ties: groups of paths or patterns that share one value.
        laws: by path or pattern, how a stiffness or damping depends on the posture or load.
        priors: by path or pattern, what is known beforehand: a relative standard deviation about the robot's value, or
            a Prior with a value of its own.
        method: "continuation"; "least_squares" from the start as it is; "genetic" for the paper's own procedure
            (Huynh et al. 2021, Fig. 2).
        cost: "logarithmic", or "relative" for Σ W |(H_s − H)/H|².
        loss: "squares", or a robust "huber" or "cauchy" for values that are far off.
        genetic: options of the genetic method.
        starts: the robot's values and this many less one drawn at random from within the bounds; the best is kept.
        seed: of random starts and of the genetic method.
        threads: for several starts; as many as there are cores if not given.
        tolerance: relative change of cost and step at which the fit has converged, from 2.2e-16 to 1.
        max_evaluations: limit on evaluations of each start, over all stages; 1000, or 200 000 of the genetic method.
        checkpoint: a file that holds the state of the run; if it is there the run goes on from it, to the same result.
        progress: called with a Progress at every evaluation.

    Raises:
        UpdateError: parameters, bounds, ties, laws, priors, weights, options or checkpoint are not valid, or the data
            are fewer than the parameters.
        PostureError: a posture or frame does not fit the robot.
        ModelError: the model has no response at the start, or cannot have one that was measured.
    """
    begin = perf_counter()
    responses, modal = sorted_measurements(measurements)
    limit = max_evaluations if max_evaluations is not None else 200_000 if method == "genetic" else 1000
    options = {"cost": cost, "loss": loss, "starts": starts, "tolerance": tolerance, "max_evaluations": limit}
    check_options(method, genetic, modes_alone=not responses, seed=seed, threads=threads, **options)
    check_kinds(robot, checkpoint, progress, bounds=bounds, laws=laws, priors=priors)
    robot, held = with_held(robot, hold)
    models = tuple(linearize(robot, m.posture) for m in responses)
    model = models[0] if models else linearize(robot, modal[0].posture)
    chosen = choose(robot, model.impedances, parameters, bounds, hold=held, ties=ties, laws=laws)
    refuse_loaded(chosen, {name for model in models for name in model.loaded})
    anchors = anchors_of(robot, chosen, priors or {})
    task = Task(robot, responses, models, modal, chosen, anchors, cost == "relative")
    weights = [m.line_weights() for m in responses]
    frf_before = responses_like(task, models)
    for m, model, weight in zip(responses, models, weights, strict=True):
        refuse_absent(m, model, weight)
    refuse_few(task, weights)
    kept = dict(hold) if isinstance(hold, Mapping) else held
    asked = options | {"genetic": genetic, "laws": dict(laws or {}), "priors": dict(priors or {}), "hold": kept}
    del asked["max_evaluations"]  # a checkpoint is gone on with under a higher limit
    record = record_of(robot, [*responses, *modal], chosen, method, seed, asked)
    search = Search(
        task,
        weights,
        method=method,
        genetic=genetic or Genetic(),
        loss=loss,
        starts=starts,
        seed=seed,
        threads=threads,
        tolerance=tolerance,
        limit=limit,
        checkpoint=Checkpoint(checkpoint, record.fingerprint) if checkpoint is not None else None,
        progress=progress,
    )
    run = search.run()
    x0, moved = task.start, task.values(run.x)
    values = np.array([p.start if run.x[i] == x0[i] else _rounded(moved[i], p) for i, p in enumerate(chosen)])
    x = np.array([p.coordinate(v) for p, v in zip(chosen, values, strict=True)])
    after = models_at(task, values)
    frf_after = responses_like(task, after)
    factors, noise = search.robust_at(frf_after)
    known = judged(task, x, values, search.weights, [m.precision() for m in responses], search.anchored, noise)
    fitted, doubtful = _doubted(task, known, frf_after, weights, factors)
    places = [*models, *(linearize(robot, m.posture) for m in modal)]
    ends = [*after, *(linearize(robot_with(robot, chosen, values), m.posture) for m in modal)]
    first = {model.posture: i for i, model in reversed(list(enumerate(places)))}
    order = sorted(first.values())
    modes_before, modes_after = (tuple(modes(side[i]) for i in order) for side in (places, ends))
    return Fit(
        start=robot,
        parameters=fitted,
        coordinates=chosen,
        covariance=known.covariance,
        information=known.information,
        cost=run.cost,
        start_cost=search.start_cost,
        cost_history=np.concatenate([stage.history for stage in run.stages]),
        stages=run.stages,
        evaluations=search.evaluations,
        starts=tuple(search.ends),
        noise=known.noise,
        status=run.status,
        message=search.message or _words(run, limit),
        method=method,
        doubts=doubtful,
        record=record,
        task=task,
        measurements=responses,
        modal_measurements=modal,
        postures=tuple(places[i].posture for i in order),
        before=modes_before,
        after=modes_after,
        mac=tuple(mac(a, b) for a, b in zip(modes_before, modes_after, strict=True)),
        frf_before=frf_before,
        frf_after=frf_after,
        duration_s=perf_counter() - begin,
    )


def _rounded(value: float, parameter: Parameter) -> float:
    """Twelve significant digits, within the bounds."""
    return min(max(float(f"{value:.12g}"), parameter.lower), parameter.upper)


def _doubted(
    task: Task, known: Judgement, frfs: Sequence[Frf], weights: Sequence[Array], factors: Sequence[Array] | None
) -> tuple[tuple[FittedParameter, ...], tuple[str, ...]]:
    """Verdicts as far as the model explains the data, and what speaks against them."""
    fitted = known.parameters
    if not task.measurements:
        return fitted, nothing_identified(fitted, known.noise, max(known.freedom, 1))
    doubtful, explained = doubts(task.measurements, frfs, weights, known.noise, factors)
    if not explained:
        fitted = tuple(replace(p, verdict="weak") if p.verdict == "identified" else p for p in fitted)
    elif not doubtful:
        doubtful = beyond_scatter(task.measurements, weights, known.noise)
    silent = without_resonance(task.measurements, weights)
    return fitted, (*doubtful, *silent, *nothing_identified(fitted, known.noise, known.freedom))


def _words(run: Run, limit: int) -> str:
    if run.status == "interrupted":
        return "stopped by the user"
    if run.status == "limit":
        return f"stopped after {limit} evaluations"
    return "cost and parameters have settled"
