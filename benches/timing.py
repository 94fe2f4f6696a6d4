"""Fair timing on a noisy machine: candidates take turns, medians are compared."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter, sleep


def interleaved(*candidates: Callable[[], object], rounds: int = 30, inner: int = 1) -> list[float]:
    """Median seconds per call of each candidate, run in turn `rounds` times, `inner` calls at a time."""
    times: list[list[float]] = [[] for _ in candidates]
    for candidate in candidates:
        candidate()
    for _ in range(rounds):
        for candidate, taken in zip(candidates, times, strict=True):
            begin = perf_counter()
            for _ in range(inner):
                candidate()
            taken.append((perf_counter() - begin) / inner)
    return [median(taken) for taken in times]


def busy_elsewhere(patience: float = 120.0, *, enough: float = 0.05) -> float:
    """Share of the processors that other programs keep busy, once it is below `enough` or after so many seconds.

    Threads can be compared only while nobody else takes processors away. NaN where the system does not tell.
    """
    stat = Path("/proc/stat")
    if not stat.exists():
        return float("nan")
    end = perf_counter() + patience
    while True:
        ticks = []
        for pause in (1.0, 0.0):
            user, nice, system, idle, waiting, *rest = map(int, stat.read_text().split("\n", 1)[0].split()[1:])
            ticks.append((user + nice + system + sum(rest[:3]), idle + waiting))
            sleep(pause)
        busy, idle = (after - before for before, after in zip(*ticks, strict=True))
        share = busy / max(1, busy + idle)
        if share < enough or perf_counter() > end:
            return share
