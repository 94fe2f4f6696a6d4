"""The search for the lowest cost: by which method, from how many starts, and again where weights depend on it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ModelError
from armonic.updating.doubts import doubts, scatter
from armonic.updating.genetic import Genetic
from armonic.updating.judging import robust
from armonic.updating.models import models_at, responses_like
from armonic.updating.running import RETRIES, Progress, Watcher, random_start, run_genetic, run_starts
from armonic.updating.stages import Run, Stage, Walker, stages_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from armonic.response import Frf
    from armonic.updating.checkpoint import Checkpoint
    from armonic.updating.measurement import Loss
    from armonic.updating.options import Method
    from armonic.updating.task import Task

    Array: TypeAlias = NDArray[np.float64]

REWEIGHTINGS = 10
"""Most rounds in which weights that depend on the outcome settle."""
FIRST_NOISE = 0.01
"""Relative noise that is expected before any residual has told it."""
ASTRAY = 3.0
"""A residual so many times what the data scatter by themselves is worth another start: the minimum may be a local one,
or the model too simple."""
LEAST_ANCHOR = 1e-12
SETTLED = 0.01
"""Weights and anchors that change by less from round to round have settled."""
FAIR = 200
"""A run that has had so many evaluations and explains nothing crawls along a bad valley; others deserve the chance."""


@dataclass(eq=False)
class Search:
    """One search; after `run` its attributes tell how it went.

    Attributes:
        task: what is fitted.
        weights: of the cost that was asked for; of a robust loss, those of the last round.
        anchored: by which modes and priors, whose deviations are known, count beside responses.
        start_cost: at the robot's own values.
        ends: final cost of every start.
        evaluations: of all of them.
        message: how it ended, if the method has words of its own.
    """

    task: Task
    weights: list[Array]
    _: KW_ONLY
    method: Method
    genetic: Genetic
    loss: Loss
    starts: int
    seed: int
    threads: int | None
    tolerance: float
    limit: int
    checkpoint: Checkpoint | None
    progress: Callable[[Progress], object] | None
    anchored: float = 1.0
    start_cost: float = np.inf
    ends: list[float] = field(default_factory=list)
    evaluations: int = 0
    message: str = ""

    def run(self) -> Run:
        """The best run there was.

        Raises:
            ModelError: the model has no answer at the start.
            KeyboardInterrupt: before anything was evaluated.
        """
        task = self.task
        mean = self._mean_weight()
        self.anchored = FIRST_NOISE**2 * mean if task.measurements else 1.0
        final = self._stages()[-1].make()
        self.start_cost = float(final.costs(task.start[None, :])[0])
        if not np.isfinite(self.start_cost):
            raise ModelError(
                "update", found="a response that is zero or infinite at the start", expected="another start"
            )
        watcher = Watcher(self.progress, 1 if self.method == "genetic" else self.starts)
        if self.method == "genetic":
            best, self.message = run_genetic(
                task,
                final,
                options=self.genetic,
                seed=self.seed,
                limit=self.limit,
                watcher=watcher,
                checkpoint=self.checkpoint,
            )
            self._count([best])
        else:
            best = self._from_starts(watcher)
        return self._reweighted(best, mean) if best.status == "converged" else best

    def _stages(self) -> list[Stage]:
        return stages_of(
            self.task,
            self.weights,
            tolerance=self.tolerance,
            continuation=self.method == "continuation",
            anchored=self.anchored,
        )

    def _from_starts(self, watcher: Watcher) -> Run:
        task, stages = self.task, self._stages()
        points = [task.start, *(random_start(task, self.seed, k) for k in range(1, self.starts))]
        options = {"limit": self.limit, "threads": self.threads, "watcher": watcher, "checkpoint": self.checkpoint}
        runs = run_starts(task, stages, points, **options)  # type: ignore[arg-type]
        best = self._count(runs)
        direct = [stage for stage in stages if stage.sigma == 0]
        try:
            astray = self.method == "continuation" and self.starts == 1 and self._is_astray(best)
            if astray and len(direct) < len(stages):
                # A good start deserves to be tried without a ladder that garbage in the data may have bent.
                straight = self._count([Walker(direct, *task.box, self.limit, watcher.of(0)).run(task.start)])
                best = _better(best, straight, or_else=self._explains(straight.x))
                astray = self._is_astray(best)
            for k in range(1, RETRIES + 1):
                if not astray:
                    break
                points.append(random_start(task, self.seed, k, near=best.x if k % 2 else None))
                again = run_starts(task, stages, points, **options, done=runs)  # type: ignore[arg-type]
                runs += again
                best = _better(best, self._count(again))
                astray = self._is_astray(best)
        except KeyboardInterrupt:
            best = replace(best, status="interrupted")
        return best

    def _count(self, runs: list[Run]) -> Run:
        self.ends += [run.cost for run in runs]
        self.evaluations += sum(run.evaluations for run in runs)
        best = min(runs, key=lambda run: run.cost)
        return replace(best, status="interrupted") if any(run.status == "interrupted" for run in runs) else best

    def _is_astray(self, run: Run) -> bool:
        """Whether a run that had its chance ended where the model does not explain the data, or not to their noise."""
        had = run.status == "converged" or (run.status == "limit" and run.evaluations >= FAIR)
        if not had or not self.task.measurements:
            return False
        return not self._explains(run.x) or self._noise(run.x) > ASTRAY * scatter(self.task.measurements, self.weights)

    def _explains(self, x: Array) -> bool:
        task = self.task
        if not task.measurements:
            return True
        frfs = responses_like(task, models_at(task, task.values(x)))
        return doubts(task.measurements, frfs, self.weights, 0.0, self.robust_at(frfs)[0])[1]

    def robust_at(self, frfs: Sequence[Frf]) -> tuple[list[Array] | None, float | None]:
        """Factors of a robust loss where the model has these responses, and the noise; of squares neither."""
        if self.loss == "squares":
            return None, None
        measurements = self.task.measurements
        return robust(frfs, [m.frf for m in measurements], [m.precision() for m in measurements], self.loss)

    def _mean_weight(self) -> float:
        """Of what was asked for beyond the precision of the values."""
        precision = [m.precision() for m in self.task.measurements]
        used = [w[w > 0] / v[w > 0] for w, v in zip(self.weights, precision, strict=True)]
        return float(np.mean(np.concatenate(used))) if used else 1.0

    def _reweighted(self, run: Run, mean: float) -> Run:
        """The run gone on with, until robust weights and the noise behind anchors have settled."""
        task = self.task
        anchors = bool(task.measurements) and bool(task.modal or task.anchors.indices)
        if self.loss == "squares" and not anchors:
            return run
        asked = self.weights
        factors = [np.ones_like(w) for w in asked]
        for _ in range(REWEIGHTINGS):
            change = 0.0
            if self.loss != "squares":
                found, _ = self.robust_at(responses_like(task, models_at(task, task.values(run.x))))
                old, factors = factors, found or factors
                self.weights = [w * f for w, f in zip(asked, factors, strict=True)]
                change = max(float(np.abs(a - b).max()) for a, b in zip(old, factors, strict=True))
            if anchors:
                before, self.anchored = self.anchored, max(self._noise(run.x) ** 2 * mean, LEAST_ANCHOR)
                change = max(change, abs(np.log(self.anchored / before)))
            if change < SETTLED:
                break
            last = self._stages()[-1:]
            more = Walker(last, *task.box, max(self.limit - run.evaluations, 1)).run(run.x)
            self.evaluations += more.evaluations
            run = Run(more.x, more.cost, (*run.stages, *more.stages), more.status, run.start)
            if more.status != "converged":
                break
        self.ends[int(np.argmin(self.ends))] = run.cost
        return run

    def _noise(self, x: Array) -> float:
        """Relative noise of the responses at x, of those of ordinary precision."""
        task = self.task
        _, noise = self.robust_at(responses_like(task, models_at(task, task.values(x))))
        if noise is not None:
            return noise
        precision = [m.precision() * (w > 0) for m, w in zip(task.measurements, self.weights, strict=True)]
        count = 2 * sum(np.count_nonzero(v) for v in precision)
        return float(np.sqrt(task.bare.residual(precision).costs(x[None, :])[0] / count))


def _better(best: Run, other: Run, *, or_else: bool = False) -> Run:
    """The one that cost less, or the other for another reason; interrupted if the other was."""
    chosen = other if other.cost < best.cost or or_else else best
    return replace(chosen, status="interrupted") if other.status == "interrupted" else chosen
