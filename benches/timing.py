"""Fair timing on a noisy machine: candidates take turns, medians are compared."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import perf_counter


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
