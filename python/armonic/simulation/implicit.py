"""Implicit steps for motion much faster and more damped than vibration: SciPy's Radau IIA on the core's equations."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from armonic import _core

    Array: TypeAlias = NDArray[np.float64]
    Outcome: TypeAlias = tuple[Array, str, float, int, int, int, int]

BEYOND = 1e3
"""A deviation, rad or m, that no robot reaches; as in the core."""
SAME = 1e-9
"""Two instants closer than this share of the sampling time are one; as in the core."""


def run_implicit(
    plant: _core.Plant,
    start: Array,
    *,
    bodies: int,
    step: float,
    samples: int,
    relative: float,
    absolute: Array,
    progress: Callable[[float], object] | None,
) -> Outcome:
    """What `Plant.run` does and returns, with implicit steps.

    Radau IIA of order 5 (Hairer and Wanner 1996, IV.8), begun anew where an excitation jumps.
    """
    from scipy.integrate import Radau

    rows: list[Array] = []
    last, near, y = step * (samples - 1), SAME * step, start
    steps = evaluations = 0
    at = 0.0

    def ended(how: str, body: int = 0) -> Outcome:
        width = len(plant.record(0.0, start, 0.0))
        return np.array(rows).reshape(len(rows), width), how, at, body, steps, 0, evaluations

    edges = _edges(plant, last, step)
    try:
        for begin, end in pairwise(edges.tolist()):
            within = (begin + end) / 2
            while len(rows) < samples and step * len(rows) <= begin + near:
                rows.append(plant.record(begin, y, within))

            def rates(t: float, y: Array, within: float = within) -> Array:
                return plant.rates(t, y, within)

            solver = Radau(rates, begin, y, end, rtol=max(relative, 1e-13), atol=absolute)  # type: ignore[arg-type]  # an array will do
            while solver.t < end:
                # Nothing depends on works, so that SciPy tries ever larger steps to differentiate by them.
                with np.errstate(over="ignore"):
                    solver.step()
                steps += 1
                if solver.status == "failed":
                    evaluations += solver.nfev
                    return ended("stalled")
                at = float(solver.t)
                beyond = ~(np.abs(solver.y[:bodies]) <= BEYOND)
                if beyond.any():
                    evaluations += solver.nfev
                    return ended("diverged", int(np.argmax(beyond)))
                dense = None
                while len(rows) < samples and step * len(rows) < min(at, end - near):
                    dense = dense or solver.dense_output()
                    rows.append(plant.record(step * len(rows), dense(step * len(rows)), within))
                if progress is not None:
                    progress(at)
            evaluations += solver.nfev
            y = solver.y
        while len(rows) < samples:
            rows.append(plant.record(last, y, (edges[-2] + edges[-1]) / 2))
    except KeyboardInterrupt:
        return ended("interrupted")
    return ended("complete")


def _edges(plant: _core.Plant, last: float, step: float) -> Array:
    """Both ends of the run and the jumps between them, on the samples that they nearly meet."""
    jumps = np.array(plant.breaks())
    on_samples = np.round(jumps / step) * step
    jumps = np.where(np.abs(jumps - on_samples) <= SAME * step, on_samples, jumps)
    inside = jumps[(jumps > SAME * step) & (jumps < last - SAME * step)]
    edges = np.concatenate([[0.0], np.unique(inside), [last]])
    return np.asarray(edges[np.concatenate([[True], np.diff(edges) > SAME * step])], np.float64)
