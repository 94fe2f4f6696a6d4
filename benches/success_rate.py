"""How often the KUKA fit finds the minimum under noise, with and without the pass under levelled weights.

FRFs of the KUKA of Huynh et al. 2021 with 1 % noise, 2 to 29.8 Hz, the paper's peak weights. A run has succeeded if it
ends within 1 % of the lowest cost that any run on the same noise reached, one that starts from the truth among them.

    python benches/success_rate.py [draws]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import groupby

import numpy as np

import armonic as am
from solver_alone import Solver, kuka_start

LINES_HZ = np.arange(10, 150) / 5
NOISE = 0.01
LABELS = ("Table 4", "within a factor of 2", "within a factor of 5", "anywhere in the bounds")


def starts(solver: Solver, rng: np.random.Generator) -> list[tuple[str, np.ndarray]]:
    """The start of Table 4, and three random ones of each kind around it."""
    size = len(solver.start)
    near = [
        (label, np.clip(solver.start * factor ** rng.uniform(-1, 1, size), solver.lower, solver.upper))
        for label, factor in ((LABELS[1], 2.0), (LABELS[2], 5.0))
        for _ in range(3)
    ]
    box = np.log(solver.lower), np.log(solver.upper)
    return [(LABELS[0], solver.start), *near, *((LABELS[3], np.exp(rng.uniform(*box))) for _ in range(3))]


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    truth, robot = am.load("kuka_kr90"), kuka_start()
    clean = am.frf(truth, "milling", LINES_HZ, frame="sensor")
    rows: list[tuple[str, bool, bool, int]] = []
    for draw in range(draws):
        real, imaginary = np.random.default_rng(draw).standard_normal((2, *clean.values.shape))
        noisy = replace(clean, values=clean.values * (1 + NOISE * (real + 1j * imaginary)))
        solver = Solver(robot, am.Measurement(noisy, "milling"))
        runs = [
            (label, two, solver.run(start, first_pass=two))
            for label, start in starts(solver, np.random.default_rng([draw, 7]))
            for two in (False, True)
        ]
        from_truth = solver.run(np.array(list(truth.parameters().values())))
        lowest = min(from_truth.cost, *(run.cost for _, _, run in runs))
        rows += [(label, two, run.cost < 1.01 * lowest, len(run.history)) for label, two, run in runs]
    print(f"{draws} noise draws; found the minimum, evaluations (median, mean)")
    rows.sort(key=lambda row: (LABELS.index(row[0]), row[1]))
    for (label, two), group in groupby(rows, key=lambda row: row[:2]):
        _, _, found, evaluations = zip(*group, strict=True)
        name = f"{label}, {'two passes' if two else 'one pass'}"
        print(f"{name:36s} {np.mean(found):6.0%} {np.median(evaluations):6.0f} {np.mean(evaluations):6.0f}")


if __name__ == "__main__":
    main()
