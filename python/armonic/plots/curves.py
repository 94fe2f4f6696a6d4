"""A survey over one dim as curves: grouped, thinned for drawing, with the events among the modes."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armonic.errors import SurveyError
from armonic.plots.dataset import (
    EVENTS,
    blocks,
    evenly,
    layout_of,
    mode_numbers,
    mode_positions,
    ordered,
    place_of,
    shown_values,
    title_of,
    unit_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from armonic.plots.dataset import Array, Indices

MAX_POINTS = 2000
"""Points per curve that are drawn; of more, the least and the greatest of each stretch."""
MAX_CASES = 4
MAX_MARKS = 400
"""Events of one kind that are drawn per case."""
MAX_PANELS = 8
SEPARATE = 1.1
"""Modes whose bands are further apart than this factor may have panels of their own."""
DRAWN = ("natural_freq_hz", "damping_ratio")


@dataclass(frozen=True)
class Marks:
    """Events of one kind: where along the curve, in which case and mode, and how many there are in all."""

    case: Indices
    at: Indices
    mode: Indices
    total: int


class Survey:
    """A survey over one dim with at most four cases, thinned for drawing."""

    def __init__(self, ds: xr.Dataset, modes: Sequence[int] | None) -> None:
        layout = layout_of(ds)
        if len(layout.axes) > 1:
            where = " x ".join(str(ds.sizes[axis]) for axis in layout.axes)
            hint = f"Draw it with heat_map, or take one line of it: ds.isel({{{layout.axes[1]!r}: 0}})."
            raise SurveyError("ds", found=f"a grid of {where} postures", expected="postures along one dim", hint=hint)
        self.along = layout.axes[0] if layout.axes else str(layout.sweep)
        self.numbers = mode_numbers(ds, modes)
        ds = ds.isel(mode=mode_positions(ds, self.numbers))
        self.x, self.title = shown_values(ds, self.along), title_of(ds, self.along)
        self.labels, self.all_cases, case = [""], 1, "case"
        if layout.axes and layout.sweep is not None:
            case, self.all_cases = layout.sweep, ds.sizes[layout.sweep]
            kept = evenly(self.all_cases, MAX_CASES)
            self.labels = [html.escape(place_of(ds, {case: int(i)})) for i in kept]
            self.ds = ds.isel({case: kept})
        else:
            self.ds = ds.expand_dims("case")
            also = [str(n) for n, c in ds.coords.items() if c.dims == (self.along,) and n != self.along]
            if layout.sweep is not None:
                self.title += "".join(f" (with {_range(ds, name)})" for name in also[:2])
        self.dims = (case, self.along)
        self.curves = {name: thinned(self.ds, name, self.dims) for name in DRAWN}
        self.marks = {code: self._marks(code) for code in EVENTS}
        self.faster = self._faster()

    def groups(self, most: int = MAX_PANELS) -> list[list[int]]:
        """Modes by panel, at most so many: the widest gaps between their bands part them."""
        _, values = self.curves["natural_freq_hz"]
        return bands(np.nanmin(values, axis=(0, 2)), np.nanmax(values, axis=(0, 2)), most)

    def _marks(self, code: int) -> Marks:
        found: list[tuple[Indices, ...]] = []
        if "event" in self.ds:
            for start, piece in blocks(self.ds, self.along):
                case, at, mode = np.nonzero(ordered(piece["event"], (*self.dims, "mode")) == code)
                found.append((case, at + start, mode))
        case, at, mode = (
            (np.concatenate(part) for part in zip(*found, strict=True)) if found else (np.zeros(0, int),) * 3
        )
        kept = evenly(case.size, MAX_MARKS * len(self.labels)) if case.size else np.zeros(0, int)
        return Marks(case[kept], at[kept], mode[kept], case.size)

    def _faster(self) -> Array | None:
        """|λ| / 2π of the faster of two real poles in one slot, NaN elsewhere; (cases, modes, points)."""
        if not {"pole", "partner"} <= set(self.ds.data_vars) or len(self.x) > MAX_POINTS:
            return None
        pole, partner = (ordered(self.ds[name], (self.dims[0], "mode", self.along)) for name in ("pole", "partner"))
        real = (pole.imag == 0) & (pole != 0) & np.isfinite(partner)
        return np.where(real, np.abs(partner) / (2 * np.pi), np.nan) if real.any() else None

    def values_at(self, name: str, marks: Marks) -> Array:
        """The variable at events."""
        if not marks.at.size:
            return np.zeros(0)
        at, back = np.unique(marks.at, return_inverse=True)
        values = ordered(self.ds[name].isel({self.along: at}), (*self.dims, "mode"))
        return np.asarray(values[marks.case, back, marks.mode], float)

    def unstable(self) -> list[tuple[float, float]]:
        """Stretches of the dim in which a case is unstable, at most 200 of them."""
        if "stability" not in self.ds:
            return []
        bad = (ordered(self.ds["stability"], self.dims) < 0).any(axis=0)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(np.int8))).reshape(-1, 2)
        borders = np.concatenate([self.x[:1], 0.5 * (self.x[1:] + self.x[:-1]), self.x[-1:]])
        return [(float(borders[low]), float(borders[high])) for low, high in edges[:200]]


def _range(ds: xr.Dataset, name: str) -> str:
    values, unit = shown_values(ds, name), unit_of(ds, name)
    return html.escape(f"{name} from {values[0]:.4g} to {values[-1]:.4g} {unit}".rstrip())


def thinned(ds: xr.Dataset, name: str, dims: tuple[str, str], *, limit: int = MAX_POINTS) -> tuple[Indices, Array]:
    """Curves with at most `limit` points each, of which none of the extremes is lost.

    Args:
        ds: a survey; with dims `dims` and "mode" only.
        name: the variable.
        dims: the cases, then the dim along which curves run.
        limit: points per curve.

    Returns:
        Indices along the curve and values there, (cases, modes, points) both.
    """
    along, total = dims[1], ds.sizes[dims[1]]
    if total <= limit:
        values = ordered(ds[name], (dims[0], "mode", along)).astype(float)
        return np.broadcast_to(np.arange(total), values.shape), values
    stretch = math.ceil(total / (limit // 2 - 1))
    indices, values_of = [], []
    for start, piece in blocks(ds, along, multiple=stretch):
        values = ordered(piece[name], (dims[0], "mode", along)).astype(float)
        cut = np.arange(0, values.shape[-1], stretch)
        for low in cut:
            part = values[..., low : low + stretch]
            ends = [np.nan_to_num(part, nan=np.inf).argmin(-1), np.nan_to_num(part, nan=-np.inf).argmax(-1)]
            if start + low == 0:
                ends.append(np.zeros_like(ends[0]))
            if start + low + part.shape[-1] == total:
                ends.append(np.full_like(ends[0], part.shape[-1] - 1))
            chosen = np.sort(np.stack(ends, axis=-1), axis=-1)
            indices.append(start + low + chosen)
            values_of.append(np.take_along_axis(part, chosen, axis=-1))
    return np.concatenate(indices, axis=-1), np.concatenate(values_of, axis=-1)


def bands(low: Array, high: Array, most: int = MAX_PANELS) -> list[list[int]]:
    """Modes in at most so many groups, by the widest gaps between the bands from `low` to `high` in which they stay."""
    order = np.argsort(low, kind="stable")
    reach = np.maximum.accumulate(high[order])
    ratios = np.log(np.maximum(low[order][1:], 1e-300)) - np.log(np.maximum(reach[:-1], 1e-300))
    widest = np.sort(np.argsort(-ratios, kind="stable")[: most - 1])
    cuts = [int(i) + 1 for i in widest if ratios[i] > math.log(SEPARATE)]
    return [sorted(part.tolist()) for part in np.split(order, cuts)]
