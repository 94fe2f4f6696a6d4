"""Which figures the report of a survey holds, by its dims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic import plots
from armonic.errors import ArmonicError
from armonic.modal import modes
from armonic.plots.curves import MAX_CASES
from armonic.plots.dataset import evenly, mode_numbers, place_of, specification

if TYPE_CHECKING:
    from collections.abc import Callable

    import plotly.graph_objects as go
    import xarray as xr
    from markupsafe import Markup
    from numpy.typing import NDArray

    from armonic.modal import Modes
    from armonic.plots.dataset import Layout
    from armonic.robot import Robot

    Embed = Callable[[go.Figure], Markup]

HEAT_MAP_MODES = 3
SAME = 1e-6
"""Poles of the map and of a posture that is computed again agree at least to this, relative."""


@dataclass(frozen=True)
class Section:
    """A heading with a text and figures, side by side if they are paired."""

    title: str
    text: str
    figures: list[Markup]
    paired: bool = False


def sections(ds: xr.Dataset, layout: Layout, robot: Robot | None, embed: Embed) -> list[Section]:
    """The figures of a survey.

    Args:
        ds: what `armonic.survey` returned.
        layout: its dims.
        robot: the robot, if it is known; without it there are neither skeletons nor mode shapes.
        embed: makes HTML of a figure.
    """
    if layout.kind == "sweep":
        return [_sweep(ds, embed), *_shapes(ds, layout, robot, embed)]
    if layout.kind == "sample":
        text = "Each dot is a posture. A joint whose column shows a curve governs that mode."
        return [Section("Natural frequencies over the joints", text, [embed(plots.sample_map(ds))])]
    if layout.kind == "grid" and len(layout.axes) > 1:
        return [_heat_maps(ds, layout, embed)]
    found = []
    if robot is not None and layout.axes == ("posture",):
        found.append(_skeletons(ds, robot, embed))
    over = "the path" if layout.axes == ("posture",) else layout.axes[0]
    text = "A panel holds modes whose frequencies lie close; each has its own scale."
    found.append(Section(f"Natural frequencies over {over}", text, [embed(plots.frequency_map(ds))]))
    text = "Panels hold the same modes as above."
    found.append(Section(f"Damping over {over}", text, [embed(plots.damping_map(ds))]))
    if layout.sweep is not None and ds.sizes[layout.sweep] > MAX_CASES:
        found.append(_sweep(ds.isel({layout.axes[0]: 0}), embed, at=place_of(ds, {layout.axes[0]: 0})))
    return [*found, *_shapes(ds, layout, robot, embed)]


def _sweep(ds: xr.Dataset, embed: Embed, *, at: str = "") -> Section:
    text = "Frequencies on the left, damping on the right, each mode in one colour. Where modes come close it is marked"
    text += " whether they cross or veer."
    name = str(ds["natural_freq_hz"].dims[0])
    return Section(f"Modes over {name}{f' at {at}' if at else ''}", text, [embed(plots.campbell(ds))])


def _heat_maps(ds: xr.Dataset, layout: Layout, embed: Embed) -> Section:
    """The lowest modes over the first two joints, in the middle of all others and at the first value of a sweep."""
    x, y = layout.axes[:2]
    others = {dim: ds.sizes[dim] // 2 for dim in layout.axes[2:]}
    if layout.sweep is not None:
        others = {layout.sweep: 0} | others
    piece = ds.isel(others)
    lowest = mode_numbers(ds)[:HEAT_MAP_MODES]
    figures = [
        embed(plots.heat_map(piece, mode, x=x, y=y, variable=variable))
        for mode in lowest
        for variable in ("natural_freq_hz", "damping_ratio")
    ]
    text = "Lines join equal values."
    if layout.axes[-1] in (x, y):
        text += " Dots show where the mode crosses another or veers from it."
    if others:
        text = f"A slice at {place_of(ds, others)}. {text}"
    return Section(f"Lowest modes over {x} and {y}", text, figures, paired=True)


def _skeletons(ds: xr.Dataset, robot: Robot, embed: Embed) -> Section:
    kept = evenly(ds.sizes["posture"], 500)
    q = np.array([_posture(ds, robot, {"posture": int(k)}) for k in kept])
    text = "Lines join the origins of the link frames. Drag to turn."
    return Section(
        "The robot along the path", text, [embed(plots.skeleton(robot, q, names=[f"posture {k}" for k in kept]))]
    )


def _posture(ds: xr.Dataset, robot: Robot, at: dict[str, int]) -> NDArray[np.float64]:
    """All coordinates at a place of the survey, (n,)."""
    base = specification(ds).get("base")
    q = np.array(base, float) if base is not None else np.zeros(len(robot.coordinates))
    for i, name in enumerate(robot.coordinates):
        if name in ds.coords:
            values = ds[name]
            q[i] = float(values.isel({dim: at[str(dim)] for dim in values.dims}))
    return q


def _shapes(ds: xr.Dataset, layout: Layout, robot: Robot | None, embed: Embed) -> list[Section]:
    """Mode shapes at the first posture and, of a sweep at one posture, at its ends."""
    if robot is None:
        return []
    first = dict.fromkeys(layout.dims, 0)
    places = [first]
    if layout.kind == "sweep" and ds.sizes[layout.dims[0]] > 1:
        places.append({layout.dims[0]: ds.sizes[layout.dims[0]] - 1})
    found = []
    for at in places:
        try:
            there = _modes(ds, robot, at)
        except ArmonicError:
            there = None
        numbers = None if there is None else _numbers(ds, there, at)
        if there is None or numbers is None:
            continue
        text = (
            "An arrow per coordinate: its angle is the phase, its length the logarithm of the magnitude relative to the"
            " largest, three decades from centre to rim."
        )
        figure = plots.mode_shapes(there, numbers=numbers)
        found.append(Section(f"Mode shapes at {place_of(ds, at)}", text, [embed(figure)]))
    return found


def _modes(ds: xr.Dataset, robot: Robot, at: dict[str, int]) -> Modes:
    """The modes at a place, computed again: with the swept values and the load that the survey had."""
    spec = specification(ds)
    swept = {name: float(ds[name][at[str(ds[name].dims[0])]]) for name in spec.get("sweep", {}) if name in ds.coords}
    if swept:
        robot = robot.with_values(swept)
    load: dict[str, Any] = spec.get("load") or {}
    wrench = {"wrench": load["wrench"], "frame": load["frame"], "wrench_axes": load["axes"]} if load else {}
    return modes(robot, _posture(ds, robot, at), **wrench)


def _numbers(ds: xr.Dataset, there: Modes, at: dict[str, int]) -> list[int] | None:
    """The numbers that the survey gives these modes, by their poles; None if it has others."""
    place = ds.isel(at)
    poles = np.stack([place["pole"].values, place["partner"].values if "partner" in place else place["pole"].values])
    apart = np.abs(poles[None] - there.poles[:, None, None])
    apart = np.where(np.isfinite(apart), apart, np.inf).min(axis=1)
    nearest = apart.argmin(axis=1)
    if (apart.min(axis=1) > SAME * np.abs(there.poles) + 1e-9).any():
        return None
    present = mode_numbers(ds)
    return [present[k] for k in nearest]
