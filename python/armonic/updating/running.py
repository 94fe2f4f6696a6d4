"""How a fit is run: one start or many over threads, or the paper's procedure; watched, saved, and gone on with."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.updating.stages import Run, StageEnd, Walker

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from armonic.updating.checkpoint import Checkpoint
    from armonic.updating.genetic import Genetic
    from armonic.updating.residuals import Descending
    from armonic.updating.stages import Stage
    from armonic.updating.task import Task

    Array: TypeAlias = NDArray[np.float64]

RETRIES = 4
"""Random starts that are tried when a fit does not explain the data."""


NEARBY = float(np.log(3.0))


@dataclass(frozen=True)
class Progress:
    """How far a fit has come.

    Attributes:
        evaluations: of residual and Jacobian, over all starts.
        cost: lowest cost so far, of the stage at hand.
        done: share of the way, 0 to 1, as far as it can be told.
        elapsed_s: since the call.
    """

    evaluations: int
    cost: float
    done: float
    elapsed_s: float

    @property
    def left_s(self) -> float:
        """Time left at this pace; infinite at the beginning."""
        return self.elapsed_s * (1 - self.done) / self.done if self.done > 0 else np.inf


class Watcher:
    """Adds up what the starts of one fit tell, from any thread, and tells it on; what `report` raises ends them all."""

    def __init__(self, report: Callable[[Progress], object] | None, starts: int) -> None:
        """`starts` of them are expected."""
        self.report, self.begin = report, perf_counter()
        self.error: BaseException | None = None
        self._lock = threading.Lock()
        self._counts, self._done, self._cost = dict[int, int](), dict[int, float](), np.inf
        self._starts = starts

    def of(self, start: int) -> Callable[[int, float, float], None] | None:
        """What one start is to call, or None if nobody listens."""
        if self.report is None and self._starts == 1:
            return None
        return lambda count, cost, done: self._heard(start, count, cost, done)

    def _heard(self, start: int, count: int, cost: float, done: float) -> None:
        if self.error is not None:
            raise KeyboardInterrupt
        with self._lock:
            self._counts[start], self._done[start], self._cost = count, done, cost
            if self.report is None:
                return
            share = sum(self._done.values()) / max(self._starts, len(self._done))
            now = Progress(sum(self._counts.values()), cost, min(share, 1.0), perf_counter() - self.begin)
        try:
            self.report(now)
        except BaseException as error:
            self.error = error
            raise


def random_start(task: Task, seed: int, index: int, near: Array | None = None) -> Array:
    """Draws x evenly from within the bounds, or a factor of three about a point, (c,); number `index` of a seed."""
    lower, upper = task.box
    if near is not None:
        lower, upper = np.maximum(lower, near - NEARBY), np.minimum(upper, near + NEARBY)
    return np.random.default_rng([seed, index]).uniform(lower, upper)


def run_starts(
    task: Task,
    stages: list[Stage],
    starts: Sequence[Array],
    *,
    limit: int,
    threads: int | None,
    watcher: Watcher,
    checkpoint: Checkpoint | None,
    done: Sequence[Run] = (),
) -> list[Run]:
    """Every start through all stages; the order is that of the starts, whichever ends first.

    A Ctrl-C ends them all and keeps what they have; starts that had not begun are left out. Of the first starts those
    that are `done` are not run again.

    Raises:
        KeyboardInterrupt: before anything was evaluated.
    """
    saved: dict[str, Any] = (checkpoint.load() if checkpoint else None) or {}
    lock = threading.Lock()
    lower, upper = task.box
    shared: dict[int, Descending] = {}
    for index, stage in enumerate(stages if len(starts) > 1 else []):
        shared[index] = stage.make()  # before threads would each make their own

    def one(k: int) -> Run:
        def save(state: dict[str, Any]) -> None:
            with lock:
                saved[str(k)] = state
                if checkpoint is not None:
                    checkpoint.save(saved)

        walker = Walker(stages, lower, upper, limit, watcher.of(k), save if checkpoint else None, shared)
        return walker.run(starts[k], saved.get(str(k)))

    which = range(len(done), len(starts))
    workers = min(len(which), threads or os.cpu_count() or 1)
    if workers == 1:
        return _in_turn(one, which)
    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(one, k) for k in which]
        try:
            runs = [future.result() for future in futures]
        except KeyboardInterrupt as error:
            watcher.error = error
            for future in futures:
                future.cancel()
            runs = [f.result() for f in futures if not f.cancelled() and f.exception() is None]
            if not runs:
                raise
            runs[-1] = replace(runs[-1], status="interrupted")
    return runs


def _in_turn(one: Callable[[int], Run], which: range) -> list[Run]:
    runs: list[Run] = []
    for k in which:
        try:
            runs.append(one(k))
        except KeyboardInterrupt:
            if not runs:
                raise
            runs[-1] = replace(runs[-1], status="interrupted")
            break
        if runs[-1].status == "interrupted":
            break
    return runs


def run_genetic(
    task: Task,
    residual: Descending,
    *,
    options: Genetic,
    seed: int,
    limit: int,
    watcher: Watcher,
    checkpoint: Checkpoint | None,
) -> tuple[Run, str]:
    """The paper's procedure from the start in the description (Huynh et al. 2021, Fig. 2), and its words."""
    from armonic.updating.procedure import paper_procedure

    def costs(values: Array) -> Array:
        return residual.costs(
            np.column_stack(
                [
                    np.log(column) if p.scale == "log" else column / p.size
                    for p, column in zip(task.parameters, values.T, strict=True)
                ]
            )
        )

    tell = watcher.of(0)
    expected = min(limit, options.rounds * (options.population * options.generations + options.simplex_iterations))
    outcome = paper_procedure(
        costs,
        np.array([p.start for p in task.parameters]),
        np.array([p.lower for p in task.parameters]),
        np.array([p.upper for p in task.parameters]),
        options=options,
        seed=seed,
        limit=limit,
        watch=None if tell is None else lambda count, cost: tell(count, cost, min(count / expected, 0.99)),
        state=checkpoint.load() if checkpoint else None,
        save=checkpoint.save if checkpoint else None,
    )
    x = np.array([p.coordinate(v) for p, v in zip(task.parameters, outcome.values, strict=True)])
    counts, best = outcome.history[:, 0].astype(int), outcome.history[:, 1]
    after = np.searchsorted(counts, np.arange(1, outcome.evaluations + 1), side="right") - 1
    history = best[np.maximum(after, 0)]
    ends = [0, *(stage.evaluations for stage in outcome.stages)]
    stages = [
        StageEnd(stage.name, 0.0, history[begin:end])
        for stage, begin, end in zip(outcome.stages, ends[:-1], ends[1:], strict=True)
    ]
    if ends[-1] < len(history):
        stages.append(StageEnd("unfinished", 0.0, history[ends[-1] :]))
    return Run(x, outcome.cost, tuple(stages), outcome.status, task.start), outcome.message
