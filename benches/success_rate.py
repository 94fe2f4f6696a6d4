"""How often a fit finds the minimum, from random starts: four methods beside each other, with and without noise.

The KUKA of Huynh et al. 2021, 18 parameters, nine accelerances to 30 Hz under the paper's peak weights, from starts
drawn evenly, in the logarithms, over the whole of Table 4's bounds; and the paper's three-axis robot, 6 parameters,
from starts within a decade either side of the truth. Without noise a run has found the minimum if its cost is below
1e-6, with noise if it is no more than 1 % above the one that is reached from the truth. The genetic method has the
paper's own options (100 individuals and 20 generations, 80 and 15 for three axes, three rounds) and fewer starts, for
it takes seconds.

    python benches/success_rate.py [--write docs/updating.md]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

import armonic as am
from armonic.updating.running import random_start
from solver_alone import LIMIT, TOLERANCE, Solver, kuka_start

STARTS, GENETIC_STARTS = 100, 20
NOISE, DRAWS, STARTS_PER_DRAW = 0.02, 20, 20
FOUND = 1e-6
"""Without noise: a cost below this is zero but for rounding."""
NEAR = 1.01
"""With noise: within 1 % of the cost that is reached from the truth."""
LESS = 1 - 1e-6
"""A cost below this share of it is a lower minimum than the one next to the truth."""
LINES_HZ = {0.5: np.arange(1, 61) / 2, 0.2: np.arange(1, 151) / 5}
KUKA = am.Genetic(population=100, generations=20, simplex_iterations=10_000)
THREE_AXES = am.Genetic(population=80, generations=15, simplex_iterations=5_000)
WAYS = {
    "least squares": "least squares from the start",
    "levelled": "levelled weights first",
    "continuation": "continuation, one run",
}
MARKS = "<!-- written by benches/success_rate.py -->", "<!-- end -->"


@dataclass(frozen=True)
class End:
    """How one run ended: its final cost over the one that would be good enough, evaluations, seconds."""

    cost: float
    aim: float
    evaluations: int
    seconds: float
    lowest: float = -np.inf

    @property
    def found(self) -> bool:
        return self.cost < self.aim

    @property
    def less(self) -> bool:
        return self.cost < self.lowest


@dataclass(frozen=True)
class Row:
    """One method on one problem."""

    problem: str
    method: str
    ends: list[End]


def kuka(step_hz: float, noise_seed: int | None = None) -> am.Measurement:
    """The responses of the KUKA, with noise if there is a seed."""
    H = am.frf(am.load("kuka_kr90"), "milling", LINES_HZ[step_hz], frame="sensor")
    if noise_seed is not None:
        real, imaginary = np.random.default_rng(noise_seed).standard_normal((2, *H.values.shape))
        H = replace(H, values=H.values * (1 + NOISE * (real + 1j * imaginary)))
    return am.Measurement(H, "milling")


def timed(robot: am.Robot, solver: Solver, x: np.ndarray, aim: float, lowest: float, **options: object) -> End:
    """A whole call of `am.update` from x."""
    task = solver.task
    paths = [p.path for p in task.parameters]
    placed = robot.with_values(dict(zip(paths, np.exp(np.clip(x, *task.box)).tolist(), strict=True)))
    begin = perf_counter()
    fit = am.update(placed, task.measurements, tolerance=TOLERANCE, **options)  # type: ignore[arg-type]
    return End(fit.cost, aim, fit.evaluations, perf_counter() - begin, lowest)


def alone(solver: Solver, way: str, x: np.ndarray, aim: float, lowest: float) -> End:
    """The solver's part from x."""
    begin = perf_counter()
    run = solver.run(x, way=way)  # type: ignore[arg-type]
    return End(run.cost, aim, run.evaluations, perf_counter() - begin, lowest)


def rows_of(
    problem: str,
    robot: am.Robot,
    runs: list[tuple[Solver, np.ndarray, float, float]],
    genetic: am.Genetic,
    bounds: dict[str, tuple[float, float]] | None = None,
) -> list[Row]:
    """Every method on the same starts: solver, start, cost that is good enough, and what would be less."""
    rows = [Row(problem, words, [alone(solver, way, *rest) for solver, *rest in runs]) for way, words in WAYS.items()]
    print(f"{problem}: the solver's part", *map(shown, rows), sep="\n", flush=True)
    whole = [timed(robot, solver, *rest, max_evaluations=LIMIT, seed=k) for k, (solver, *rest) in enumerate(runs)]
    rows.append(Row(problem, "`am.update`", whole))
    print(shown(rows[-1]), flush=True)
    few = runs[:: max(len(runs) // GENETIC_STARTS, 1)]
    slow = [
        timed(robot, solver, *rest, method="genetic", genetic=genetic, bounds=bounds, seed=k)
        for k, (solver, *rest) in enumerate(few)
    ]
    rows.append(Row(problem, "genetic and simplex", slow))
    print(shown(rows[-1]), flush=True)
    return rows


def noise_free(step_hz: float) -> list[Row]:
    solver = Solver(kuka_start(), kuka(step_hz))
    runs = [(solver, random_start(solver.task, 0, k), FOUND, -np.inf) for k in range(STARTS)]
    return rows_of(f"KUKA, {step_hz} Hz, no noise", kuka_start(), runs, KUKA)


def noisy(step_hz: float) -> list[Row]:
    truth = am.load("kuka_kr90")
    runs = []
    for draw in range(DRAWS):
        solver = Solver(kuka_start(), kuka(step_hz, noise_seed=draw))
        x = np.log([truth.parameters()[p.path] for p in solver.task.parameters])
        reached = solver.run(np.clip(x, *solver.task.box), way="least squares").cost
        for k in range(STARTS_PER_DRAW):
            start = random_start(solver.task, draw + 1, k)
            runs.append((solver, start, NEAR * reached, LESS * reached))
    return rows_of(f"KUKA, {step_hz} Hz, {100 * NOISE:g} % noise", kuka_start(), runs, KUKA)


def three_axes() -> list[Row]:
    robot = am.load("huynh_3r")
    H = am.frf(robot, "milling", LINES_HZ[0.2], frame="sensor")
    solver = Solver(robot, am.Measurement(H, "milling", weights=am.peak_weights(H, peak_gain=50.0)))
    truth, rng = solver.task.start, np.random.default_rng(3)
    runs = [(solver, truth + np.log(10) * rng.uniform(-1, 1, len(truth)), FOUND, -np.inf) for _ in range(STARTS)]
    decade = {p.path: (p.start / 10, p.start * 10) for p in solver.task.parameters}
    return rows_of("three axes, 0.2 Hz, no noise", robot, runs, THREE_AXES, decade)


def shown(row: Row) -> str:
    costs, evaluations, seconds = np.transpose([(e.cost, e.evaluations, e.seconds) for e in row.ends])
    found, count = sum(e.found for e in row.ends), len(row.ends)
    less = str(sum(e.less for e in row.ends)) if np.isfinite(row.ends[0].lowest) else ""
    cells = [row.problem, row.method, f"{found} of {count}", less, f"{np.median(evaluations):.0f}"]
    return "| " + " | ".join([*cells, f"{1e3 * np.median(seconds):.0f}", cost(float(np.median(costs)))]) + " |"


def cost(value: float) -> str:
    return "0" if value < FOUND * 1e-3 else f"{value:.3g}"


def table(rows: list[Row]) -> list[str]:
    head = "| problem | method | found | less | evaluations | ms | cost |"
    return [head, "|---|---|--:|--:|--:|--:|--:|", *map(shown, rows)]


def main() -> None:
    rows = [*noise_free(0.5), *noise_free(0.2), *noisy(0.5), *noisy(0.2), *three_axes()]
    print(*table(rows), sep="\n")
    if "--write" in sys.argv:
        page = Path(sys.argv[sys.argv.index("--write") + 1])
        before, _, rest = page.read_text("utf-8").partition(MARKS[0])
        after = rest.partition(MARKS[1])[2]
        page.write_text("\n".join([before + MARKS[0], "", *table(rows), "", MARKS[1] + after]), "utf-8")


if __name__ == "__main__":
    main()
