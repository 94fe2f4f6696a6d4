"""Poles, shapes and selection of orders 2 to 100 beside a least-squares and an eigenvalue problem per order in NumPy.

Data: six motor positions of Scompi after an impulse, 2 795 samples. `--orders 2:60` takes another range, `--pyoma` puts
pyOMA2's SSI beside ours, if it is installed. Ratios are of medians of one run.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ.setdefault(name, "2")

import numpy as np
from numpy.typing import NDArray

import armonic as am


def decay() -> am.TimeSeries:
    hit = am.Impulse(axis="y0", force=50.0, duration_s=0.006)
    run = am.simulate(am.load("scompi"), "c8", hit, duration_s=3.0)
    moving = run.series.select("motor_position").window(0.206)
    return moving.with_values(moving.values - run.series.values[0, run.series.matching("motor_position")])


def by_numpy(values: NDArray[np.float64], first: int, last: int) -> float:
    """One least-squares problem and one dense eigenproblem with vectors per order; sum of all poles, to be of use."""
    count, m = values.shape
    total = 0.0
    for p in range(first, last + 1):
        lags = np.hstack([values[p - j : count - j] for j in range(1, p + 1)])
        A = np.linalg.lstsq(lags, values[p:], rcond=None)[0]
        companion = np.eye(m * p, k=-m)
        companion[:m] = A.T
        poles, _ = np.linalg.eig(companion)
        total += float(np.abs(poles).sum())
    return total


def pyoma(values: NDArray[np.float64], rate: float, last: int) -> None:
    from pyoma2.algorithms import SSI
    from pyoma2.setup import SingleSetup

    setup = SingleSetup(values, rate)
    setup.add_algorithms(SSI(name="ssi", method="cov", br=30, ordmax=last))
    setup.run_by_name("ssi")


def seconds(task: Callable[[], object], repeats: int) -> float:
    taken = []
    for _ in range(repeats):
        began = time.perf_counter()
        task()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", default="2:100")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--pyoma", action="store_true")
    arguments = parser.parse_args()
    first, last = (int(word) for word in arguments.orders.split(":"))
    series = decay()
    own = seconds(lambda: am.oma(series, orders=(first, last), detrend="none"), arguments.repeats)
    print(f"armonic, orders {first} to {last}, poles, shapes, selection   {own:8.2f} s")
    ssi = seconds(lambda: am.oma(series, orders=(2, last), detrend="none", method="ssi"), arguments.repeats)
    print(f"armonic, SSI of 2 to {last} states, with selection            {ssi:8.2f} s")
    if arguments.pyoma:
        other = seconds(lambda: pyoma(series.values, series.sample_rate_hz, last), 1)
        print(f"pyOMA2, SSI of up to {last} states                            {other:8.2f} s")
    other = seconds(lambda: by_numpy(series.values, first, last), 1)
    print(f"NumPy, lstsq and eig per order                          {other:8.2f} s   {other / own:5.1f} x")


if __name__ == "__main__":
    main()
