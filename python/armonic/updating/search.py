"""The search for the lowest cost: by which method, from how many starts, and again where weights depend on it."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ModelError
from armonic.updating.doubts import doubts
from armonic.updating.genetic import Genetic
from armonic.updating.judging import robust
from armonic.updating.models import models_at, responses_like
from armonic.updating.running import RETRIES, Progress, Watcher, random_start, run_genetic, run_starts
from armonic.updating.stages import Run, Stage, Walker, stages_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from armonic.updating.checkpoint import Checkpoint
    from armonic.updating.measurement import Loss
    from armonic.updating.options import Method
    from armonic.updating.task import Task

    Array: TypeAlias = NDArray[np.float64]

REWEIGHTINGS = 10
"""Most rounds in which weights that depend on the outcome settle."""
FIRST_NOISE = 0.01
"""Relative noise that is expected before any residual has told it."""
LEAST_ANCHOR = 1e-12
SETTLED = 0.01
"""Weights and anchors that change by less from round to round have settled."""


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
        if self.starts == 1 and len(direct) < len(stages) and best.status == "converged" and not self._explains(best.x):
            # A good start deserves to be tried without a ladder that garbage in the data may have bent.
            straight = Walker(direct, *task.box, self.limit, watcher.of(0)).run(task.start)
            straight = self._count([straight])
            best = straight if straight.cost < best.cost or self._explains(straight.x) else best
        retries = RETRIES if self.method == "continuation" and self.starts == 1 else 0
        for k in range(1, retries + 1):
            if best.status != "converged" or self._explains(best.x):
                break
            points.append(random_start(task, self.seed, k))
            again = run_starts(task, stages, points, **options, done=runs)  # type: ignore[arg-type]
            runs += again
            better = self._count(again)
            best = better if better.cost < best.cost else best
        return best

    def _count(self, runs: list[Run]) -> Run:
        self.ends += [run.cost for run in runs]
        self.evaluations += sum(run.evaluations for run in runs)
        return min(runs, key=lambda run: run.cost)

    def _explains(self, x: Array) -> bool:
        task = self.task
        if not task.measurements:
            return True
        frfs = responses_like(task, models_at(task, task.values(x)))
        return doubts(task.measurements, frfs, self.weights, 0.0)[1]

    def _mean_weight(self) -> float:
        used = [w[w > 0] for w in self.weights]
        return float(np.mean(np.concatenate(used))) if used else 1.0

    def _reweighted(self, run: Run, mean: float) -> Run:
        """The run gone on with, until robust weights and the noise behind anchors have settled."""
        task = self.task
        anchors = bool(task.measurements) and bool(task.modal or task.anchors.indices)
        if self.loss == "squares" and not anchors:
            return run
        asked = self.weights
        precision = [m.precision() for m in task.measurements]
        factors = [np.ones_like(w) for w in asked]
        for _ in range(REWEIGHTINGS):
            frfs = responses_like(task, models_at(task, task.values(run.x)))
            measured = [m.frf for m in task.measurements]
            if self.loss != "squares":
                old, factors = factors, robust(frfs, measured, precision, self.loss)
                self.weights = [w * f for w, f in zip(asked, factors, strict=True)]
                change = max(float(np.abs(a - b).max()) for a, b in zip(old, factors, strict=True))
            else:
                change = 0.0
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
        """Relative noise of the responses at x."""
        from dataclasses import replace

        from armonic.updating.residuals import Anchors

        used = [(w > 0).astype(float) for w in self.weights]
        bare = replace(self.task, modal=(), anchors=Anchors())
        count = 2 * sum(u.sum() for u in used)
        return float(np.sqrt(bare.residual(used).costs(x[None, :])[0] / count))
