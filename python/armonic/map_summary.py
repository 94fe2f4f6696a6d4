"""A survey in numbers: the range of every mode, crossings and veerings, stability, and how it was computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.plots.dataset import EVENTS, blocks, layout_of, mode_numbers, ordered

if TYPE_CHECKING:
    from collections.abc import Iterator

    import xarray as xr
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

    from armonic.plots.dataset import Layout

CLOSE = 1.1
"""Modes whose frequencies are further apart than this factor do not meet."""

Place = dict[str, int]
"""Index along every dim of a survey."""


@dataclass(frozen=True)
class Extreme:
    """A least or greatest value and the first place that has it."""

    value: float
    at: Place


@dataclass(frozen=True)
class ModeRange:
    """A mode over the whole survey: natural frequency in Hz, damping ratio as a fraction.

    Attributes:
        number: of the mode.
        slowest: least natural frequency.
        fastest: greatest natural frequency.
        least_damped: least damping ratio.
        most_damped: greatest damping ratio.
        real: share of the places where its pole is real.
    """

    number: int
    slowest: Extreme
    fastest: Extreme
    least_damped: Extreme
    most_damped: Extreme
    real: float


@dataclass(frozen=True)
class Event:
    """Modes that cross or veer at a place, and their mean natural frequency in Hz there."""

    name: str
    modes: tuple[int, ...]
    at: Place
    freq_hz: float


@dataclass(frozen=True)
class Pair:
    """All crossings or veerings of the same modes: how many places, between which frequencies in Hz, where first."""

    name: str
    modes: tuple[int, ...]
    count: int
    low_hz: float
    high_hz: float
    first: Place


@dataclass(frozen=True)
class MapSummary:
    """A survey in numbers.

    Attributes:
        layout: its dims.
        count: places in all, over all dims.
        modes: range of every mode.
        events: the first of the crossings and veerings.
        pairs: all of them, by the modes that meet.
        totals: how many there are of each.
        unstable: places where the robot is unstable; None if the survey does not say.
        marginal: places where it is marginal.
        first_unstable: the first of them.
        dense: places that the dense solver did; None if the survey does not say.
        residual: largest residual, NaN if the survey does not say.
    """

    layout: Layout
    count: int
    modes: tuple[ModeRange, ...]
    events: tuple[Event, ...]
    pairs: tuple[Pair, ...]
    totals: dict[str, int]
    unstable: int | None
    marginal: int
    first_unstable: Place | None
    dense: int | None
    residual: float


def summarize(ds: xr.Dataset, *, most_events: int = 40) -> MapSummary:
    """Read a survey once, piece by piece, in bounded memory.

    Args:
        ds: what `armonic.survey` returned.
        most_events: so many crossings and veerings of the same modes are listed at least; all are counted.

    Raises:
        SurveyError: the dataset is no survey.
    """
    layout = layout_of(ds)
    numbers = mode_numbers(ds)
    along = max(layout.dims, key=lambda dim: ds.sizes[dim])
    reader = _Reader(layout.dims, along, numbers, most_events)
    for start, piece in blocks(ds, along):
        reader.read(start, piece)
    count = int(np.prod([ds.sizes[dim] for dim in layout.dims]))
    return MapSummary(
        layout=layout,
        count=count,
        modes=tuple(reader.range_of(k, count) for k in range(len(numbers))),
        events=tuple(sorted(reader.events, key=lambda event: (event.name, *event.at.values()))),
        pairs=tuple(sorted(reader.pairs.values(), key=lambda pair: (pair.name, pair.modes))),
        totals=reader.totals,
        unstable=reader.unstable if "stability" in ds else None,
        marginal=reader.marginal,
        first_unstable=reader.first_unstable,
        dense=reader.dense if "method" in ds else None,
        residual=reader.residual,
    )


class _Reader:
    """What was found so far."""

    def __init__(self, dims: tuple[str, ...], along: str, numbers: list[int], most_events: int) -> None:
        self.dims, self.along, self.numbers, self.most = dims, along, numbers, most_events
        self.extremes: dict[tuple[str, int, int], Extreme] = {}
        self.real = np.zeros(len(numbers), int)
        self.events: list[Event] = []
        self.pairs: dict[tuple[str, tuple[int, ...]], Pair] = {}
        self.totals = dict.fromkeys(EVENTS.values(), 0)
        self.unstable, self.marginal, self.dense = 0, 0, 0
        self.first_unstable: Place | None = None
        self.residual = float("nan")

    def read(self, start: int, piece: xr.Dataset) -> None:
        over = (*self.dims, "mode")
        frequency = ordered(piece["natural_freq_hz"], over).astype(float)
        shape = frequency.shape[:-1]
        damping = ordered(piece["damping_ratio"], over).astype(float)
        for name, values in (("frequency", frequency), ("damping", damping)):
            flat = values.reshape(-1, values.shape[-1])
            for sign in (1, -1):
                worst = np.where(np.isfinite(flat), sign * flat, np.inf)
                for k, place in enumerate(worst.argmin(axis=0)):
                    found = self.extremes.get((name, sign, k))
                    if found is None or worst[place, k] < sign * found.value:
                        at = self._at(np.unravel_index(place, shape), start)
                        self.extremes[name, sign, k] = Extreme(float(flat[place, k]), at)
        if "damped_freq_hz" in piece:
            damped = ordered(piece["damped_freq_hz"], over).reshape(-1, len(self.numbers))
            self.real += (damped == 0).sum(axis=0)
        if "event" in piece:
            self._events(ordered(piece["event"], over), frequency, start)
        if "stability" in piece:
            verdict = ordered(piece["stability"], self.dims)
            self.unstable += int((verdict < 0).sum())
            self.marginal += int((verdict == 0).sum())
            if self.first_unstable is None and (verdict < 0).any():
                self.first_unstable = self._at(np.argwhere(verdict < 0)[0], start)
        if "method" in piece:
            self.dense += int((ordered(piece["method"], self.dims) == 1).sum())
        if "residual" in piece:
            residual = ordered(piece["residual"], self.dims)
            self.residual = float(np.fmax(self.residual, np.nanmax(residual, initial=0.0)))

    def _events(self, codes: NDArray[Any], frequency: NDArray[np.float64], start: int) -> None:
        for code, name in EVENTS.items():
            places = np.argwhere((codes == code).any(axis=-1))
            at = tuple(places.T)
            struck, there = codes[at] == code, frequency[at]
            patterns, which = np.unique(struck, axis=0, return_inverse=True)
            for number, pattern in enumerate(patterns):
                modes, here = np.flatnonzero(pattern), np.flatnonzero(which == number)
                if len(modes) == 2:
                    f = there[here][:, modes]
                    close = f.max(axis=-1) <= CLOSE * f.min(axis=-1)
                    if close.any():
                        self._meet(name, modes, f[close].mean(axis=-1), places[here[close]], start)
                    here = here[~close]
                for k in here:
                    for group in _groups(modes, there[k][modes]):
                        self._meet(name, group, there[k][group].mean(keepdims=True), places[k][None], start)

    def _meet(self, name: str, modes: NDArray[np.intp], freq_hz: Array, places: NDArray[Any], start: int) -> None:
        """Some modes meet at some places."""
        named = tuple(sorted(self.numbers[k] for k in modes))
        low, high, first = float(freq_hz.min()), float(freq_hz.max()), self._at(places[0], start)
        before = self.pairs.get((name, named), Pair(name, named, 0, low, high, first))
        count = before.count + len(places)
        self.pairs[name, named] = Pair(
            name, named, count, min(low, before.low_hz), max(high, before.high_hz), before.first
        )
        self.totals[name] += len(places)
        self.events += [
            Event(name, named, self._at(place, start), float(f))
            for place, f in zip(places[: self.most], freq_hz[: self.most], strict=True)
        ]

    def _at(self, index: Any, start: int) -> Place:
        return {dim: int(i) + (start if dim == self.along else 0) for dim, i in zip(self.dims, index, strict=True)}

    def range_of(self, k: int, count: int) -> ModeRange:
        least, most = (self.extremes["frequency", sign, k] for sign in (1, -1))
        damped, overdamped = (self.extremes["damping", sign, k] for sign in (1, -1))
        return ModeRange(self.numbers[k], least, most, damped, overdamped, float(self.real[k] / count))


def _groups(modes: NDArray[np.intp], freq_hz: Array) -> Iterator[NDArray[np.intp]]:
    """Modes that are struck at one place by those that meet: two neighbours in frequency, an odd one with the last two.

    A mode alone has met one that is struck by something else.
    """
    order = np.argsort(freq_hz)
    far = 1 + np.flatnonzero(freq_hz[order][1:] > CLOSE * freq_hz[order][:-1])
    for group in np.split(modes[order], far):
        whole = max(1, len(group) // 2)
        for k in range(whole):
            yield group[2 * k :] if k == whole - 1 else group[2 * k : 2 * k + 2]
