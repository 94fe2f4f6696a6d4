"""What would be known about each parameter: the interval and the verdict that a fit is expected to give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.updating.uncertainty import IDENTIFIED_FACTOR, OPEN, WEAK_FACTOR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.updating.parameters import Parameter, Scale
    from armonic.updating.uncertainty import Verdict

    Array: TypeAlias = NDArray[np.float64]

REACH = 1.959963984540054
"""Half a 95 % interval in standard deviations."""
SEEN = 1e-6
"""Data that add a smaller share than this to what the weak prior knows say nothing."""


@dataclass(frozen=True)
class PlannedParameter:
    """What would be known about one parameter.

    Each tuple has an entry for what is known before, and one after each chosen measurement.

    Attributes:
        path: where it stands in the description.
        unit: its SI unit.
        value: the value that the plan takes for the true one.
        scale: "log" where x = ln(value), else "linear", where x = value/size.
        size: of a linear parameter, SI; 1 on the logarithmic scale.
        deviations: standard deviation of the coordinate x of the fit; inf where the data say nothing.
        intervals: 95 % intervals (low, high) of the value; (0, inf) or (-inf, inf) where the data say nothing.
        verdicts: "identified" (interval within 25 %), "weak" (within a factor of three) or "not identifiable".
        with_all: the standard deviation of x if all candidates were measured.
        verdict_with_all: and the verdict.
    """

    path: str
    unit: str
    value: float
    scale: Scale
    size: float
    deviations: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]
    verdicts: tuple[Verdict, ...]
    with_all: float
    verdict_with_all: Verdict

    def share(self, step: int) -> float:
        """Half the 95 % interval as a share of the value: 0.1 where its upper end is 10 % above.

        Of a number that may be zero, as a share of it or of its size, whichever is larger.

        Args:
            step: 0 before, then after each measurement.
        """
        half = REACH * self.deviations[step]
        if self.scale == "linear":
            return half * self.size / max(abs(self.value), self.size)
        return float(np.expm1(half)) if half < OPEN else float("inf")


def of_data(spread: Array, weak: Array) -> Array:
    """Standard deviations (..., c) without what the weak prior (c,) knows of the parameter itself; inf if that is all.

    What it knows of the others stays in: what only trades against a number that lies within its bounds is not open.
    """
    told = spread**-2.0 - weak
    seen = told > SEEN * weak
    return np.where(seen, 1 / np.sqrt(np.where(seen, told, 1.0)), np.inf)


def limits(parameters: Sequence[Parameter], values: Array) -> tuple[Array, Array]:
    """The largest standard deviations of x, (c,) each, of what a fit calls identified, and of what it calls weak."""
    linear = np.array([p.scale == "linear" for p in parameters])
    size = np.array([p.size for p in parameters])
    span = np.array([p.upper - p.lower for p in parameters])
    share = (IDENTIFIED_FACTOR - 1) * np.maximum(np.abs(values), size) / size
    identified = np.where(linear, share, np.log(IDENTIFIED_FACTOR))
    weak = np.where(linear, span / 2 / size, np.log(WEAK_FACTOR))
    return identified / REACH, weak / REACH


def expected(parameters: Sequence[Parameter], values: Array, spread: Array) -> tuple[PlannedParameter, ...]:
    """Intervals and verdicts, from standard deviations (before, after each, after all candidates; c)."""
    identified, weak = limits(parameters, values)

    def verdict(i: int, deviation: float) -> Verdict:
        if deviation <= identified[i]:
            return "identified"
        return "weak" if deviation <= weak[i] else "not identifiable"

    return tuple(
        PlannedParameter(
            path=p.path,
            unit=p.unit,
            value=value,
            scale=p.scale,
            size=p.size,
            deviations=tuple(own[:-1]),
            intervals=tuple(_interval(p, value, deviation) for deviation in own[:-1]),
            verdicts=tuple(verdict(i, deviation) for deviation in own[:-1]),
            with_all=own[-1],
            verdict_with_all=verdict(i, own[-1]),
        )
        for i, (p, value, own) in enumerate(zip(parameters, values.tolist(), spread.T.tolist(), strict=True))
    )


def _interval(p: Parameter, value: float, deviation: float) -> tuple[float, float]:
    half = REACH * deviation
    if p.scale == "linear":
        return (value - half * p.size, value + half * p.size) if half < np.exp(OPEN) else (-np.inf, np.inf)
    return (float(value * np.exp(-half)), float(value * np.exp(half))) if half < OPEN else (0.0, np.inf)
