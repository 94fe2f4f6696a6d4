"""Figure of a survey over two dims: a slice of a grid as a heat map."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from armonic.errors import SurveyError
from armonic.plots.dataset import (
    EVENTS,
    evenly,
    layout_of,
    mode_numbers,
    mode_positions,
    ordered,
    shown_values,
    specification,
    title_of,
)
from armonic.plots.look import INK, MUTED, TEMPLATE

if TYPE_CHECKING:
    import xarray as xr

    from armonic.plots.dataset import Array

MAX_CELLS = 250
"""Rows and columns of a heat map that are drawn; of more, evenly spaced ones."""

_QUANTITIES = {
    "natural_freq_hz": ("natural frequency, Hz", 1.0),
    "damped_freq_hz": ("damped frequency, Hz", 1.0),
    "damping_ratio": ("damping ratio, %", 100.0),
}
_MARKERS = {1: {"symbol": "circle", "size": 3, "color": INK}, 2: {"symbol": "diamond-open", "size": 5, "color": INK}}
# Not so dark at their ends that the numbers of iso-lines could not be read.
_BLUES = [[0, "#f1f6fa"], [0.5, "#9cc4e0"], [1, "#2f7fb8"]]
_REDS = [[0, "#fdf4f0"], [0.5, "#f4b59f"], [1, "#dc6542"]]


def heat_map(
    ds: xr.Dataset, mode: int, *, x: str | None = None, y: str | None = None, variable: str = "natural_freq_hz"
) -> go.Figure:
    """Draw a mode over two dims as a heat map with iso-lines, and dots where it crosses another or veers from it.

    A survey of a grid steps along its last dim and sees modes meet between such steps, so that a slice without that dim
    has no dots.

    Args:
        ds: what `armonic.survey` returned, over two dims; of more, take a slice first: `ds.isel({"link_3.z": 5})`.
        mode: the number of the mode.
        x: the dim to the right; by default the first, or the first other than `y`.
        y: the dim upwards; by default the second, or the first other than `x`.
        variable: which variable to draw.

    Raises:
        SurveyError: the dataset is no survey or its slice is not over two dims, or there is no such mode or variable.
    """
    x, y = _two_dims(ds, x, y)
    (number,) = mode_numbers(ds, [mode])
    (position,) = mode_positions(ds, [number])
    if variable not in ds.data_vars or not {x, y} <= set(ds[variable].dims) or ds[variable].dtype.kind not in "fiub":
        suited = [str(name) for name, v in ds.data_vars.items() if {x, y} <= set(v.dims) and v.dtype.kind in "fiub"]
        raise SurveyError("variable", found=repr(variable), expected=f"one of {', '.join(suited)}")
    columns, rows = (evenly(ds.sizes[dim], MAX_CELLS) for dim in (x, y))
    piece = ds.isel({x: columns, y: rows}).isel(mode=position)
    title, factor = _QUANTITIES.get(variable, (variable, 1.0))
    values = factor * ordered(piece[variable], (y, x)).astype(float)
    across, up = shown_values(piece, x), shown_values(piece, y)
    name = f"Mode {number}: {title}" if "mode" in ds[variable].dims else title
    figure = go.Figure(layout={"template": TEMPLATE, "height": 400, "width": 528, "hovermode": "closest"})
    figure.update_layout(
        title={"text": html.escape(name), "y": 0.985, "yanchor": "top"},
        margin={"l": 62, "r": 8, "t": 44, "b": 46},
        legend={"x": 1, "xanchor": "right"},
    )
    drawn = {x: (columns, ds.sizes[x]), y: (rows, ds.sizes[y])}
    titles = {
        dim: title_of(ds, dim) + ("" if kept.size == total else f" ({kept.size} of {total} drawn)")
        for dim, (kept, total) in drawn.items()
    }
    figure.update_xaxes(title={"text": titles[x]}, showgrid=False, range=_limits(across))
    figure.update_yaxes(title={"text": titles[y]}, showgrid=False, range=_limits(up))
    figure.add_heatmap(
        x=across,
        y=up,
        z=values,
        colorscale=_REDS if variable == "damping_ratio" else _BLUES,
        colorbar={"thickness": 12, "outlinewidth": 0, "tickfont": {"size": 11, "color": MUTED}, "ticks": "outside"},
        hovertemplate=f"{title_of(ds, x)}: %{{x:.4g}}<br>{title_of(ds, y)}: %{{y:.4g}}<br>%{{z:.5g}}<extra></extra>",
    )
    if min(values.shape) > 1 and np.isfinite(values).all() and np.ptp(values) > 1e-6 * np.abs(values).max():
        figure.add_contour(
            x=across,
            y=up,
            z=values,
            autocontour=True,
            ncontours=9,
            contours={"coloring": "none", "showlabels": True, "labelfont": {"size": 10, "color": INK}},
            line={"color": "rgba(26,30,35,.55)", "width": 0.8, "smoothing": 0},
            showscale=False,
            showlegend=False,
            hoverinfo="skip",
        )
    _events(figure, piece, (y, x), across, up)
    return figure


def _two_dims(ds: xr.Dataset, x: str | None, y: str | None) -> tuple[str, str]:
    dims = layout_of(ds).dims
    for argument, dim in (("x", x), ("y", y)):
        if dim is not None and dim not in dims:
            raise SurveyError(argument, found=repr(dim), expected=f"a dim of the survey: {', '.join(dims)}")
    if x is not None and x == y:
        raise SurveyError("y", found=f"{y!r}, as for x", expected="two different dims")
    free = [dim for dim in dims if dim not in (x, y)]
    if len(dims) > 2:
        rest = ([dim for dim in dims if dim in free[-(len(dims) - 2) :]])[: len(dims) - 2]
        found = f"a survey over {len(dims)} dims: {', '.join(f'{dim} ({ds.sizes[dim]})' for dim in dims)}"
        middle = ", ".join(f"{dim!r}: {ds.sizes[dim] // 2}" for dim in rest)
        raise SurveyError("ds", found=found, expected="a slice over two", hint=f"Take one: ds.isel({{{middle}}}).")
    if len(dims) < 2:
        hint = "Draw it with frequency_map and damping_map."
        raise SurveyError("ds", found=f"a survey over {dims[0]} alone", expected="a slice over two dims", hint=hint)
    across = x or free.pop(0)
    return across, y or next(dim for dim in free if dim != across)


def _events(figure: go.Figure, piece: xr.Dataset, dims: tuple[str, str], across: Array, up: Array) -> None:
    walked = specification(piece).get("axes") or dims
    if "event" not in piece or walked[-1] not in dims:
        return
    codes = ordered(piece["event"], dims)
    for code, name in EVENTS.items():
        rows, columns = np.nonzero(codes == code)
        if rows.size:
            kept = evenly(rows.size, 1000)
            figure.add_scatter(
                x=across[columns[kept]],
                y=up[rows[kept]],
                name=name if kept.size == rows.size else f"{name} ({kept.size} of {rows.size} drawn)",
                showlegend=True,
                mode="markers",
                marker=_MARKERS[code],
                hoverinfo="skip",
            )


def _limits(values: Array) -> list[float]:
    """From the border of the first cell to that of the last."""
    half = [0.5 * (values[1] - values[0]), 0.5 * (values[-1] - values[-2])] if values.size > 1 else [0.5, 0.5]
    return [float(values[0] - half[0]), float(values[-1] + half[1])]
