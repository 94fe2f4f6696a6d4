"""The stages of a fit, one after the other: where each starts, what it cost, and what is left if the run breaks off."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.updating.measurement import levelled
from armonic.updating.smoothing import ladder

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from armonic.updating.descent import Ending
    from armonic.updating.residuals import Descending
    from armonic.updating.task import Task

    Array: TypeAlias = NDArray[np.float64]

RUNG_EVALUATIONS = 9
"""A rung of the ladder only has to bring the next one near: a few steps do."""
RUNG_TOLERANCE = 1e-3
ANY = 2**31
"""As many evaluations as the run's limit leaves."""
LEVELLED_TOLERANCE = 1e-5
"""How far the stage under levelled weights goes: near enough for the peaks to lie over each other, and no further."""


@dataclass(frozen=True)
class Stage:
    """One stage: a residual and how far to go down it.

    Attributes:
        name: for figures, "σ = 17.6 rad/s".
        sigma: distance from the imaginary axis, rad/s.
        make: makes the residual, when the stage begins.
        tolerance: relative change of cost and step at which it ends.
        evaluations: most of them; the run's limit holds as well.
        priced: whether the history is in the cost that was asked for.
    """

    name: str
    sigma: float
    make: Callable[[], Descending]
    tolerance: float
    evaluations: int
    priced: bool = True


@dataclass(frozen=True)
class StageEnd:
    """What a stage did.

    Attributes:
        name: as of the stage.
        sigma: distance from the imaginary axis, rad/s.
        history: lowest cost after each evaluation, (E,): of the stage's own residual where σ > 0, else the cost that
            was asked for, if the core computed it.
    """

    name: str
    sigma: float
    history: Array


@dataclass(frozen=True)
class Run:
    """One run through the stages.

    Attributes:
        x: where it ended, (c,).
        cost: the cost there that was asked for; infinite if it never came to it.
        stages: what was done.
        status: "converged", "limit" or "interrupted".
        start: x it started from, (c,).
    """

    x: Array
    cost: float
    stages: tuple[StageEnd, ...]
    status: Ending
    start: Array

    @property
    def evaluations(self) -> int:
        """How often residual and Jacobian were computed."""
        return sum(len(stage.history) for stage in self.stages)


def stages_of(
    task: Task, weights: Sequence[Array], *, tolerance: float, continuation: bool, anchored: float
) -> list[Stage]:
    """The stages of a fit: down the ladder, under levelled weights, then the cost that was asked for.

    On every rung the lines count alike. High weights on the lines around measured peaks make hills between the peaks of
    the model and those of the measurement, so before the last stage there is a coarse one without that emphasis.

    Args:
        task: what is fitted.
        weights: of the cost that was asked for.
        tolerance: of the last stage.
        continuation: with the ladder and the levelled stage; else the last stage alone.
        anchored: see `Task.residual`.
    """

    def last() -> Descending:
        return task.residual(weights, anchored=anchored, relative=task.relative)

    final = Stage("cost", 0.0, last, tolerance, ANY)
    if not continuation:
        return [final]
    if not task.measurements:
        return [*_blurred(task, weights, anchored), final]
    even = [levelled(w) for w in weights]
    sigmas = _common_ladder(task)
    rungs = [
        Stage(
            f"σ = {sigma:.3g} rad/s",
            sigma,
            lambda sigma=sigma: task.residual(even, sigma=sigma, anchored=anchored),  # type: ignore[misc]
            RUNG_TOLERANCE,
            RUNG_EVALUATIONS,
            priced=False,
        )
        for sigma in sigmas
    ]
    if task.relative or not all(np.array_equal(a, b) for a, b in zip(weights, even, strict=True)):

        def level() -> Descending:
            return task.residual(even, prices=weights, anchored=anchored)

        coarse = max(tolerance, LEVELLED_TOLERANCE)
        rungs.append(Stage("levelled", 0.0, level, coarse, ANY, priced=task.in_core and not task.relative))
    return [*rungs, final]


def _blurred(task: Task, weights: Sequence[Array], anchored: float) -> list[Stage]:
    """The stages before the last of a fit to modes alone: their deviations blurred, less and less."""
    from armonic.updating.modal_data import BLURS

    return [
        Stage(
            f"deviations + {100 * blur:g} %",
            0.0,
            lambda blur=blur: task.residual(weights, anchored=anchored, blur=blur),  # type: ignore[misc]
            RUNG_TOLERANCE,
            ANY,
            priced=False,
        )
        for blur in BLURS
        if blur > 0
    ]


def _common_ladder(task: Task) -> tuple[float, ...]:
    """The ladder of the measurement that reaches highest, without rungs that another one's lines do not resolve."""
    ladders = [ladder(m.frf.freq_hz) for m in task.measurements]
    if not all(ladders):
        return ()
    highest = max(ladders, key=lambda rungs: rungs[0])
    finest = max(rungs[-1] for rungs in ladders)
    return tuple(sigma for sigma in highest if sigma >= 0.999 * finest)


@dataclass
class Walker:
    """Runs through stages, from one start.

    Attributes:
        stages: in their order.
        lower: bounds of x, (c,).
        upper: bounds, (c,).
        limit: most evaluations over all stages.
        watch: gets evaluations so far, the lowest cost, and the share of the way that is done.
        save: gets the state after each stage, plain data.
    """

    stages: list[Stage]
    lower: Array
    upper: Array
    limit: int
    watch: Callable[[int, float, float], object] | None = None
    save: Callable[[dict[str, Any]], object] | None = None
    _residuals: dict[int, Descending] = field(default_factory=dict)

    def run(self, start: Array, state: dict[str, Any] | None = None) -> Run:
        """Goes through the stages from `start`, or on from where a state was saved: to the same bits."""
        x, ends = np.array(start, float), list[StageEnd]()
        cost, best = np.inf, (np.inf, x)
        if state is None and len(self.stages) > 1:
            best = (self._last_cost(x), x)  # the stages may lead to what is worse than where they began
        elif state is not None:
            x, ends = np.array(state["x"], float), [_end(kept) for kept in state["stages"]]
            cost, price = (np.inf if state[key] is None else state[key] for key in ("cost", "price"))
            best = (price, np.array(state["best"], float))
        status: Ending = "converged"
        for index in range(len(ends), len(self.stages)):
            stage = self.stages[index]
            used = sum(len(end.history) for end in ends)
            allowed = min(stage.evaluations, self.limit - used)
            if allowed < 1:
                status = "limit"
                break
            descent = self._residual(index).descend(
                x,
                self.lower,
                self.upper,
                tolerance=stage.tolerance,
                evaluations=allowed,
                watch=self._watch(used, index),
            )
            history, last = descent.history, stage is self.stages[-1]
            if stage.priced and not last and descent.price < best[0]:
                best = (descent.price, descent.best)
            x, cost = descent.x, descent.cost if last else np.inf
            if last and best[0] < (1 - stage.tolerance) * cost and len(history) < allowed:
                # A point on the way was better than this end: on from there.
                again = self._residual(index).descend(
                    best[1],
                    self.lower,
                    self.upper,
                    tolerance=stage.tolerance,
                    evaluations=allowed - len(history),
                    watch=self._watch(used + len(history), index),
                )
                history = np.concatenate([history, np.minimum(again.history, history.min(initial=np.inf))])
                if again.cost < cost:
                    x, cost, descent = again.x, again.cost, again
                descent = replace(descent, ending=again.ending)
            ends.append(StageEnd(stage.name, stage.sigma, history))
            if descent.ending == "interrupted" or (
                descent.ending == "limit" and (last or used + len(history) >= self.limit)
            ):
                status = descent.ending
                break
            if self.save is not None:
                self.save(
                    {
                        "x": x.tolist(),
                        "cost": cost if np.isfinite(cost) else None,
                        "price": best[0] if np.isfinite(best[0]) else None,
                        "best": best[1].tolist(),
                        "stages": [[end.name, end.sigma, _plain(end.history)] for end in ends],
                    }
                )
        if status != "converged" or not np.isfinite(cost):
            reached = cost if np.isfinite(cost) else self._last_cost(x)  # it may never have come to the last stage
            cost, x = min((reached, x), best, key=lambda option: option[0])
        return Run(x, float(cost), tuple(ends), status, np.array(start, float))

    def _last_cost(self, x: Array) -> float:
        return float(self._residual(len(self.stages) - 1).costs(x[None, :])[0])

    def _residual(self, index: int) -> Descending:
        if index not in self._residuals:
            self._residuals[index] = self.stages[index].make()
        return self._residuals[index]

    def _watch(self, used: int, index: int) -> Callable[[int, float], object] | None:
        if self.watch is None:
            return None
        watch, expected = self.watch, 3 * RUNG_EVALUATIONS
        return lambda count, cost: watch(used + count, cost, (index + min(count / expected, 0.9)) / len(self.stages))


def _end(kept: list[Any]) -> StageEnd:
    name, sigma, history = kept
    return StageEnd(str(name), float(sigma), np.array([np.inf if cost is None else cost for cost in history], float))


def _plain(costs: Array) -> list[float | None]:
    """As JSON has it, where infinity is nothing."""
    return [cost if np.isfinite(cost) else None for cost in costs.tolist()]
