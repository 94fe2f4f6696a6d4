"""The genetic stage of Huynh et al. 2021, Fig. 2: a population that selects, crosses and mutates itself within bounds.

The paper runs MATLAB's `ga` with its defaults. They are rebuilt here: rank scaling, stochastic uniform selection,
scattered crossover, Gaussian mutation that shrinks, and an elite.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from armonic.errors import UpdateError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Costs: TypeAlias = Callable[[Array], Array]

Scale = Literal["linear", "log"]


@dataclass(frozen=True)
class Genetic:
    """Options of the paper's procedure (`method="genetic"`): genetic stage, Nelder-Mead, and again.

    Args:
        population: individuals of a generation; the paper has 80 for 6 parameters and 100 for 18.
        generations: generations of a stage, the initial one included; the paper has 15 and 20.
        elite: share of the population that passes on unchanged, at least one individual.
        crossover: share of the others that two parents make, each parameter from either; the rest are mutants.
        mutation: standard deviation of a mutation in the first generation, as a share of the range within the bounds.
        shrink: how far that has fallen in the end: 1 to nothing, 0 not at all.
        spread: half width of the initial population about its guess, as a share of that range; 1 is all of it.
        stall_generations: a stage ends if so many generations
        stall_tolerance: lower the best cost by less than this in the mean, relative to it (absolute below one).
        tolerance: the cost δ that is low enough: it ends a genetic stage, and the procedure. The paper has 300 for the
            KUKA and 1e-12 for the three-axis robot; it depends on lines and weights, so by default only a perfect
            fit is good enough.
        rounds: how often genetic stage and simplex run at most.
        simplex_iterations: Nelder-Mead iterations of a round at most.
        scale: "linear" to work on SI values, as the paper does, or "log" on their logarithms.

    Raises:
        UpdateError: an option is no number of its kind or out of range.
    """

    population: int = 100
    generations: int = 20
    elite: float = 0.05
    crossover: float = 0.8
    mutation: float = 1.0
    shrink: float = 1.0
    spread: float = 0.5
    stall_generations: int = 50
    stall_tolerance: float = 1e-6
    tolerance: float = 1e-6
    rounds: int = 3
    simplex_iterations: int = 10_000
    scale: Scale = "linear"

    def __post_init__(self) -> None:
        for name, (lowest, highest) in _WHOLE.items():
            _settle(self, name, Integral, f"a whole number from {lowest} to {highest:g}", lowest, highest)
        for name, most in _REAL.items():
            _settle(self, name, Real, f"a number from 0 to {most:g}", 0.0, most)
        if self.scale not in get_args(Scale):
            raise UpdateError("Genetic.scale", found=repr(self.scale), expected='"linear" or "log"')
        if self.elites >= self.population:
            raise UpdateError(
                "Genetic.elite",
                found=f"{self.elite:g}, which is all {self.population} individuals",
                expected="a share that leaves room for others",
            )

    @property
    def elites(self) -> int:
        """How many individuals pass on unchanged."""
        return max(1, math.ceil(self.elite * self.population))


_WHOLE = {
    "population": (4, 10**6),
    "generations": (1, 10**9),
    "stall_generations": (1, 10**9),
    "rounds": (1, 10**9),
    "simplex_iterations": (1, 10**9),
}
_REAL = {
    "elite": 1.0,
    "crossover": 1.0,
    "mutation": 10.0,
    "shrink": 1.0,
    "spread": 1.0,
    "stall_tolerance": 1.0,
    "tolerance": 1e300,
}


def _settle(options: Genetic, name: str, kind: type, expected: str, lowest: float, highest: float) -> None:
    """Checks a number and makes it Python's own, so that a record of it is plain data."""
    value: Any = getattr(options, name)
    number = isinstance(value, kind) and not isinstance(value, bool)
    if not number or not lowest <= value <= highest:
        raise UpdateError(f"Genetic.{name}", found=repr(value), expected=expected)
    object.__setattr__(options, name, int(value) if kind is Integral else float(value))


class Space:
    """The box of admissible values, and the coordinates in which populations and simplices move: linear or log.

    Args:
        lower: bounds, (c,), SI.
        upper: bounds, (c,), SI.
        scale: "linear" or "log".

    Raises:
        UpdateError: bounds that do not fit each other or the scale.
    """

    def __init__(self, lower: Array, upper: Array, scale: Scale) -> None:
        self.lower, self.upper = (np.array(bound, np.float64, ndmin=1) for bound in (lower, upper))
        self.scale: Scale = scale
        fit = self.lower.ndim == 1 and self.lower.size and self.lower.shape == self.upper.shape
        finite = np.isfinite(self.lower).all() and np.isfinite(self.upper).all()
        if not fit or not finite or not (self.lower < self.upper).all():
            raise UpdateError(
                "bounds", found=f"{lower} and {upper}", expected="finite bounds for every parameter, lower < upper"
            )
        if scale == "log" and not (self.lower > 0).all():
            raise UpdateError(
                "bounds",
                found=f"a lower bound of {self.lower.min():g}",
                expected="positive ones on a logarithmic scale",
                hint='Use scale="linear".',
            )
        self.low, self.high = self.coordinates(self.lower), self.coordinates(self.upper)

    def coordinates(self, values: Array) -> Array:
        """Coordinates of values, (..., c)."""
        return np.log(values) if self.scale == "log" else np.array(values)

    def values(self, coordinates: Array) -> Array:
        """Values at coordinates, (..., c), within the bounds."""
        values = np.exp(coordinates) if self.scale == "log" else coordinates
        return np.clip(values, self.lower, self.upper)

    def folded(self, coordinates: Array) -> Array:
        """Coordinates that left the box mirrored back into it, as often as it takes."""
        width = self.high - self.low
        along = np.mod(coordinates - self.low, 2 * width)
        return self.low + (width - np.abs(width - along))

    def checked(self, values: Array, where: str) -> Array:
        """A point of the box, (c,).

        Raises:
            UpdateError: it has another shape or lies outside.
        """
        point = np.array(values, np.float64, ndmin=1)
        if point.shape != self.lower.shape or not ((self.lower <= point) & (point <= self.upper)).all():
            raise UpdateError(where, found=f"{values}", expected=f"{self.lower.size} values within the bounds")
        return point


@dataclass(frozen=True, eq=False)
class Herd:
    """One generation.

    Attributes:
        number: how many generations there have been, this one included.
        values: its individuals, the best first, (P, c), SI.
        costs: their costs, (P,).
        best: lowest cost of every generation so far, (number,).
    """

    number: int
    values: Array
    costs: Array
    best: tuple[float, ...]


def evolve(
    costs: Costs,
    guess: Array | None,
    space: Space,
    *,
    options: Genetic,
    generator: np.random.Generator,
    begun: Herd | None = None,
    each: Callable[[Herd], None] | None = None,
) -> Herd:
    """One genetic stage: until the cost is low enough, nothing improves any more, or the generations are over.

    Huynh et al. 2021, section 3.2. What passed on unchanged is not evaluated again.

    Args:
        costs: costs (P,) of parameter sets (P, c); inf is a cost, and nan counts as one.
        guess: values about which the initial population is spread, and its first individual, (c,); a random one if not
            given.
        space: bounds and scale.
        options: of the stage.
        generator: where chance comes from.
        begun: a generation to go on from, with the generator in the state of that time.
        each: told of every new generation.

    Returns:
        The last generation.

    Raises:
        UpdateError: the guess lies outside of the bounds.
    """
    herd = begun
    while herd is None or not _ended(herd, options):
        if herd is None:
            values = _initial(guess, space, options, generator)
            herd = _ranked(1, values, _priced(costs, values), ())
        else:
            kept = options.elites
            values = _offspring(herd, space, options, generator)
            new = _priced(costs, values)
            herd = _ranked(
                herd.number + 1,
                np.concatenate([herd.values[:kept], values]),
                np.concatenate([herd.costs[:kept], new]),
                herd.best,
            )
        if each is not None:
            each(herd)
    return herd


def _ended(herd: Herd, options: Genetic) -> bool:
    best, window = herd.best, options.stall_generations
    if best[-1] <= options.tolerance or herd.number >= options.generations:
        return True
    if len(best) <= window or not math.isfinite(best[-1 - window]):
        return False
    return (best[-1 - window] - best[-1]) / window <= options.stall_tolerance * max(1.0, best[-1])


def _priced(costs: Costs, values: Array) -> Array:
    found = np.array(costs(values), np.float64)
    if found.shape != (len(values),):
        raise ValueError(f"costs of shape {found.shape} for {len(values)} parameter sets")
    found[np.isnan(found)] = np.inf
    return found


def _ranked(number: int, values: Array, costs: Array, before: tuple[float, ...]) -> Herd:
    order = np.argsort(costs, kind="stable")
    return Herd(number, values[order], costs[order], (*before, float(costs[order[0]])))


def _initial(guess: Array | None, space: Space, options: Genetic, generator: np.random.Generator) -> Array:
    """Uniform about the guess as far as the bounds let it; the guess itself is the first individual."""
    random = space.values(generator.uniform(space.low, space.high)) if guess is None else guess
    first = space.checked(random, "start")
    middle, reach = space.coordinates(first), options.spread * (space.high - space.low)
    low, high = np.maximum(space.low, middle - reach), np.minimum(space.high, middle + reach)
    values = space.values(generator.uniform(low, high, (options.population, len(first))))
    values[0] = first
    return values


def _offspring(herd: Herd, space: Space, options: Genetic, generator: np.random.Generator) -> Array:
    """Children of a generation that stands in the order of its costs: the crossed, then the mutants."""
    room = options.population - options.elites
    crossed = round(options.crossover * room)
    parents = space.coordinates(herd.values)[_selected(options.population, room + crossed, generator)]
    mothers, fathers, others = np.split(parents, [crossed, 2 * crossed])
    mixed = np.where(generator.random(mothers.shape) < 0.5, mothers, fathers)
    share = options.mutation * (1 - options.shrink * herd.number / options.generations)
    steps = share * (space.high - space.low) * generator.standard_normal(others.shape)
    return space.values(np.concatenate([mixed, space.folded(others + steps)]))


def _selected(population: int, count: int, generator: np.random.Generator) -> NDArray[np.intp]:
    """Places of parents, drawn in equal steps along a line on which each rank n has the length 1/√n, then shuffled."""
    line = np.cumsum(1 / np.sqrt(np.arange(1, population + 1)))
    marks = (generator.random() + np.arange(count)) / count * line[-1]
    return generator.permutation(np.minimum(np.searchsorted(line, marks, side="right"), population - 1))
