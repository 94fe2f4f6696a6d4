"""The paper's whole procedure (Huynh et al. 2021, Fig. 2): genetic stage, Nelder-Mead, and again from there.

It stands still at boundaries, after every generation and every chunk of simplex iterations, where its whole state is
plain data. A run that goes on from such a state takes the same steps as one that was never interrupted, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import Bounds, minimize

from armonic.errors import UpdateError
from armonic.updating.genetic import Herd, Space, evolve

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from armonic.updating.genetic import Costs, Genetic

    Array: TypeAlias = NDArray[np.float64]

Status = Literal["converged", "limit", "interrupted"]

FORMAT = 1
"""Version of the layout of a state."""
CHUNK = 500
"""Simplex iterations between two boundaries."""
FIRST_STEP = 0.05
"""Edge of the first simplex as a share of each value (MATLAB's `fminsearch` and SciPy have the same)."""
FIRST_STEP_AT_ZERO = 0.00025
"""The same where a value is zero, as a share of its range."""
SMALLEST_SIZE = 1e-4
"""A value nearer to zero than this share of its range is not worth more digits than one of that size."""
SIMPLEX_EXTENT = 1e-8
"""A simplex this small, as a share of each value, has closed in on a minimum, ..."""
SIMPLEX_COSTS = 1e-4
"""... if its costs differ by no more than this, which is the TolFun of `fminsearch`."""
HUGE = float(np.finfo(float).max)
"""What an infinite cost is to the simplex, which subtracts them."""


class Stage(NamedTuple):
    """A stage that is over.

    Attributes:
        name: "genetic" or "simplex".
        evaluations: of the whole run when it ended.
        cost: the best by then.
    """

    name: str
    evaluations: int
    cost: float


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where the procedure ended.

    Attributes:
        values: best parameter values, (c,), SI.
        cost: their cost.
        history: evaluations so far and best cost, (E, 2): one row for the first individual, which is the start, one per
            generation, one per simplex iteration that found something better, and one for the end.
        evaluations: how many parameter sets were evaluated.
        stages: the stages that came to their end.
        status: "converged" (a cost within the tolerance, or a simplex that closed in on a minimum in the last round),
            "limit" (rounds or evaluations used up) or "interrupted" (Ctrl-C).
        message: the same in words.
    """

    values: Array
    cost: float
    history: Array
    evaluations: int
    stages: tuple[Stage, ...]
    status: Status
    message: str


def paper_procedure(
    costs: Costs,
    start: Array | None,
    lower: Array,
    upper: Array,
    *,
    options: Genetic,
    seed: int,
    limit: int,
    watch: Callable[[int, float], None] | None = None,
    state: dict[str, Any] | None = None,
    save: Callable[[dict[str, Any]], None] | None = None,
) -> Outcome:
    """Minimizes a cost by genetic stage and Nelder-Mead in turns (Huynh et al. 2021, section 3.2, Fig. 2).

    A round ends when its simplex has closed in on a minimum or its iterations are over; if the cost is then above the
    tolerance, the next round starts from there.

    Args:
        costs: costs (P,) of parameter sets (P, c), SI; whole generations in one call, single ones from the simplex.
        start: values to start from, (c,), SI; None for a random start.
        lower: bounds, (c,), SI.
        upper: bounds, (c,), SI.
        options: of the procedure.
        seed: of all chance; without meaning if there is a state.
        limit: evaluations at most.
        watch: told evaluations and best cost, after every generation and simplex iteration.
        state: what `save` was given in an earlier run with the same arguments, to go on from; `limit` may differ.
        save: given the state at every boundary: ints, floats as hexadecimal text, lists, dicts and None.

    Returns:
        The best there was. An interrupted run has kept its best, and the last state that was saved.

    Raises:
        UpdateError: start, bounds, seed, limit or state do not fit.
        KeyboardInterrupt: before anything was evaluated.
    """
    if not limit >= 1:
        raise UpdateError("max_evaluations", found=f"{limit}", expected="at least 1")
    if not isinstance(seed, Integral) or seed < 0:
        raise UpdateError("seed", found=repr(seed), expected="a whole number from 0 on")
    space = Space(lower, upper, options.scale)
    guess = None if start is None else space.checked(start, "start")
    run = _Run(costs, space, options, np.random.Generator(np.random.PCG64(int(seed))), limit, watch, save)
    if state is not None:
        run.restore(state)
    return run.finish(guess)


class _UsedUpError(Exception):
    """No evaluation is left."""


@dataclass(eq=False)
class _Simplex:
    """A Nelder-Mead run between two chunks.

    Its coordinates are those of the space divided by powers of two, which rounds nothing and makes them all of order
    one, so that one bound on its extent serves parameters of any unit.
    """

    sizes: Array
    vertices: Array
    costs: Array | None = None
    iterations: int = 0
    closed: bool = False


@dataclass(eq=False)
class _Run:
    costs: Costs
    space: Space
    options: Genetic
    generator: np.random.Generator
    limit: int
    watch: Callable[[int, float], None] | None
    save: Callable[[dict[str, Any]], None] | None
    evaluations: int = 0
    best: Array | None = None
    cost: float = np.inf
    history: list[tuple[int, float]] = field(default_factory=list)
    stages: list[Stage] = field(default_factory=list)
    rounds: int = 0
    herd: Herd | None = None
    simplex: _Simplex | None = None
    end: tuple[Status, str] | None = None

    def finish(self, guess: Array | None) -> Outcome:
        """Runs to the end, whichever comes first."""
        try:
            while self.end is None:
                self._round(guess)
            status, message = self.end
        except _UsedUpError:
            status, message = "limit", f"stopped after {self.evaluations} evaluations"
        except KeyboardInterrupt:
            if self.best is None:
                raise
            status, message = "interrupted", "stopped by the user"
        assert self.best is not None
        rows = self.history
        if rows[-1] != (self.evaluations, self.cost):
            rows = [*rows, (self.evaluations, self.cost)]
        history = np.array(rows, np.float64)
        return Outcome(self.best, self.cost, history, self.evaluations, tuple(self.stages), status, message)

    def _round(self, guess: Array | None) -> None:
        """What is left of a round."""
        if self.simplex is None:
            start = guess if self.best is None or self.rounds == 0 else self.best
            options, generator = self.options, self.generator
            evolve(
                self._priced, start, self.space, options=options, generator=generator, begun=self.herd, each=self._bred
            )
            self._over("genetic")
            self.simplex = self._first_simplex()
        while not self.simplex.closed and self.simplex.iterations < self.options.simplex_iterations:
            self._chunk(self.simplex)
            self._boundary()
        self._over("simplex")
        self.rounds += 1
        self.end = self._verdict(self.simplex.closed)
        self.herd = self.simplex = None
        self._boundary()

    def _bred(self, herd: Herd) -> None:
        self.herd = herd
        self._boundary()

    def _over(self, name: str) -> None:
        self.stages.append(Stage(name, self.evaluations, self.cost))

    def _verdict(self, closed: bool) -> tuple[Status, str] | None:
        tolerance, rounds = self.options.tolerance, self.options.rounds
        if self.cost <= tolerance:
            return "converged", f"cost within the tolerance of {tolerance:g} after round {self.rounds}"
        if self.rounds < rounds:
            return None
        if closed:
            return "converged", f"the simplex of round {rounds} closed in on a minimum, above the tolerance"
        return "limit", f"stopped after round {rounds}, the simplex still moving"

    def _priced(self, values: Array) -> Array:
        """Costs of parameter sets, counted, the best of them remembered; the room that is left is used to the last."""
        room = max(self.limit - self.evaluations, 0)
        found = np.array(self.costs(values[:room]), np.float64) if room else np.empty(0)
        found[np.isnan(found)] = np.inf
        if found.size:
            if self.best is None:
                self.history.append((1, float(found[0])))
            lowest = int(np.argmin(found))
            self.evaluations += len(found)
            if self.best is None or found[lowest] < self.cost:
                self.best, self.cost = values[lowest].copy(), float(found[lowest])
        if room and len(values) > 1:
            self._noted(always=True)
        if room < len(values):
            raise _UsedUpError
        return found

    def _noted(self, *, always: bool = False) -> None:
        if always or self.cost < self.history[-1][1]:
            self.history.append((self.evaluations, self.cost))
        if self.watch is not None:
            self.watch(self.evaluations, self.cost)

    def _first_simplex(self) -> _Simplex:
        """About the best, as `fminsearch` and SciPy make it; edges that would leave the bounds point inwards."""
        assert self.best is not None
        space, centre = self.space, self.space.coordinates(self.best)
        if space.scale == "log":
            sizes, out = np.ones(len(centre)), centre + np.log1p(FIRST_STEP)
        else:
            width = space.high - space.low
            sizes = np.exp2(np.floor(np.log2(np.maximum(np.abs(centre), SMALLEST_SIZE * width))))
            out = np.where(centre == 0, FIRST_STEP_AT_ZERO * width, (1 + FIRST_STEP) * centre)
        out = np.where((out > space.high) | (out < space.low), 2 * centre - out, out)
        vertices = np.vstack([centre, np.where(np.eye(len(centre), dtype=bool), out, centre)])
        return _Simplex(sizes, np.clip(vertices, space.low, space.high) / sizes)

    def _chunk(self, simplex: _Simplex) -> None:
        """Up to CHUNK iterations; costs of vertices that are known are not computed again."""
        known = {}
        if simplex.costs is not None:
            known = {v.tobytes(): float(f) for v, f in zip(simplex.vertices, simplex.costs, strict=True)}

        def cost(x: Array) -> float:
            found = known.get(x.tobytes())
            if found is None:
                found = min(float(self._priced(self.space.values(x * simplex.sizes)[None])[0]), HUGE)
            return found

        count = min(CHUNK, self.options.simplex_iterations - simplex.iterations)
        solution = minimize(
            cost,
            simplex.vertices[0],
            method="Nelder-Mead",
            bounds=Bounds(self.space.low / simplex.sizes, self.space.high / simplex.sizes),
            callback=lambda _: self._noted(),
            options={
                "initial_simplex": simplex.vertices,
                "maxiter": count + 1,  # SciPy counts from one
                "xatol": SIMPLEX_EXTENT,
                "fatol": SIMPLEX_COSTS,
            },
        )
        simplex.vertices, simplex.costs = solution.final_simplex
        simplex.iterations += int(solution.nit) - 1
        simplex.closed = bool(solution.success)

    def _boundary(self) -> None:
        if self.save is not None:
            self.save(self.state())

    def state(self) -> dict[str, Any]:
        """All that the steps to come depend on, as plain data."""
        herd, simplex = self.herd, self.simplex
        return {
            "procedure": FORMAT,
            "generator": self.generator.bit_generator.state,
            "evaluations": self.evaluations,
            "best": _texts(self.best),
            "cost": self.cost.hex(),
            "history": [[count, cost.hex()] for count, cost in self.history],
            "stages": [[name, count, cost.hex()] for name, count, cost in self.stages],
            "rounds": self.rounds,
            "herd": None
            if herd is None
            else {
                "number": herd.number,
                "values": _texts(herd.values),
                "costs": _texts(herd.costs),
                "best": [cost.hex() for cost in herd.best],
            },
            "simplex": None
            if simplex is None
            else {
                "sizes": _texts(simplex.sizes),
                "vertices": _texts(simplex.vertices),
                "costs": _texts(simplex.costs),
                "iterations": simplex.iterations,
                "closed": simplex.closed,
            },
            "end": None if self.end is None else list(self.end),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Takes up a state.

        Raises:
            UpdateError: it is not one of this procedure, or of another number of parameters.
        """
        c = len(self.space.lower)
        try:
            if state["procedure"] != FORMAT:
                raise ValueError("another format")
            self.generator.bit_generator.state = state["generator"]
            self.evaluations, self.rounds = int(state["evaluations"]), int(state["rounds"])
            self.best, self.cost = _numbers(state["best"], (c,)), float.fromhex(state["cost"])
            self.history = [(int(count), float.fromhex(cost)) for count, cost in state["history"]]
            self.stages = [Stage(str(name), int(n), float.fromhex(cost)) for name, n, cost in state["stages"]]
            if (herd := state["herd"]) is not None:
                size = self.options.population
                best = tuple(float.fromhex(cost) for cost in herd["best"])
                values, costs = _numbers(herd["values"], (size, c)), _numbers(herd["costs"], (size,))
                self.herd = Herd(int(herd["number"]), values, costs, best)
            if (simplex := state["simplex"]) is not None:
                self.simplex = _Simplex(
                    _numbers(simplex["sizes"], (c,)),
                    _numbers(simplex["vertices"], (c + 1, c)),
                    _numbers(simplex["costs"], (c + 1,)),
                    int(simplex["iterations"]),
                    bool(simplex["closed"]),
                )
            if state["end"] is not None:
                status, message = state["end"]
                self.end = (status, message)
        except (KeyError, TypeError, ValueError) as error:
            raise UpdateError(
                "state", found=f"one that does not fit this run ({error})", expected="what the same run had saved"
            ) from error


def _texts(numbers: Array | None) -> Any:
    """Nested lists of hexadecimal numbers: no digit is lost, and inf is no special case."""
    if numbers is None:
        return None
    return [_texts(row) for row in numbers] if numbers.ndim > 1 else [float(x).hex() for x in numbers]


def _numbers(texts: Any, shape: tuple[int, ...]) -> Array:
    rows = texts if len(shape) > 1 else [texts]
    numbers = np.array([[float.fromhex(x) for x in row] for row in rows], np.float64)
    return numbers.reshape(shape)
