"""Whether a plan keeps its word on the KUKA: what 1 % noise makes of refits of the measurements that it chose.

The milling posture of Huynh et al. 2021 has been measured (9 responses, every 0.5 Hz to 30 Hz), and 500 postures within
30 degrees of it may be next. Two are planned, measured with noise, and all three are fitted together, from the true
values and within a factor of 1000, so that the noise is seen and not the search. Printed beside each other: half the
95 % interval that the plan expects, that of the refits, and how often the refits lie within the expected one. Then the
plan against random choices.

    python benches/plan_check.py [draws]
"""

from __future__ import annotations

import sys
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

import armonic as am
from armonic.text import format_spread, split_path
from armonic.updating.expected import REACH
from armonic.updating.parameters import choose
from armonic.updating.planning import Plan, plan_measurement
from armonic.updating.sensitivities import frf_sensitivities

LINES_HZ = np.arange(1, 61) / 2
NOISE = 0.01
MILLING_DEG = np.array([0.0, 70.0, -100.0])
CANDIDATES, RANDOM, COUNT = 500, 1000, 2


def measured(robot: am.Robot, posture: Any, rng: np.random.Generator) -> am.Measurement:
    """One posture with noise."""
    H = am.frf(robot, posture, LINES_HZ, frame="sensor")
    real, imaginary = NOISE * rng.standard_normal((2, *H.values.shape))
    return am.Measurement(replace(H, values=H.values * np.exp(real + 1j * imaginary)), posture, weights="uniform")


def left_by_chance(plan: Plan) -> np.ndarray:
    """Summed log-intervals after random choices of as many candidates, by arithmetic that the plan does not share."""
    parameters = choose(plan.robot, am.linearize(plan.robot, "milling").impedances, "elasticity")
    added = []
    for one in plan.ranking:
        _, D = frf_sensitivities(plan.robot, one.candidate.posture, LINES_HZ, parameters, frame="sensor")
        rows = D.reshape(-1, D.shape[-1]) / plan.noise
        added.append((rows.conj().T @ rows).real)
    rng = np.random.default_rng(1)
    sets = [rng.choice(len(added), COUNT, replace=False) for _ in range(RANDOM)]
    base = plan.information + np.diag(plan.prior)
    variances = [np.diag(np.linalg.inv(base + sum(added[i] for i in chosen))) for chosen in sets]
    return np.log(2 * REACH * np.sqrt(variances)).sum(axis=1)


def spread(deviation: float) -> str:
    return format_spread(np.exp(-REACH * deviation), np.exp(REACH * deviation))


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    truth = am.load("kuka_kr90")
    rng = np.random.default_rng(2021)
    postures = np.deg2rad(MILLING_DEG + rng.uniform(-30, 30, (CANDIDATES, 3)))
    begin = perf_counter()
    plan = plan_measurement(truth, measured(truth, "milling", rng), postures, count=COUNT, noise=NOISE)
    print(f"{CANDIDATES} candidates in {perf_counter() - begin:.2f} s", *plan.notes, sep="\n")

    errors = []
    for draw in range(draws):
        noisy = np.random.default_rng([7, draw])
        fit = am.update(truth, [measured(truth, p, noisy) for p in ("milling", *(c.posture for c in plan.chosen))])
        errors.append([np.log(p.value / q.value) for p, q in zip(fit.parameters, plan.parameters, strict=True)])
    print(f"\n{draws} refits of all three, half 95 % intervals")
    print(f"{'':24s}{'before':>11s}{'after':>11s}{'refits':>11s}{'ratio':>7s}{'within':>8s}")
    for p, own in zip(plan.parameters, np.transpose(errors), strict=True):
        seen, expected = float(np.sqrt(np.mean(own**2))), p.deviations[-1]
        words = "".join(f"{spread(s):>11s}" for s in (p.deviations[0], expected, seen))
        within = np.mean(np.abs(own) <= REACH * expected)
        print(f"{' '.join(split_path(p.path)):24s}{words}{seen / expected:7.2f}{within:8.1%}")

    fell, chance = plan.log_widths[0] - plan.log_widths[-1], plan.log_widths[0] - left_by_chance(plan)
    print(f"\nsummed log-intervals fall by {fell:.2f}; by chance {np.median(chance):.2f} (median of {RANDOM} choices),")
    print(f"{chance.max():.2f} at best")


if __name__ == "__main__":
    main()
