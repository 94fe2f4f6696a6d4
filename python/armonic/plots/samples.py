"""Figure of a survey at sampled postures: frequencies as dots over each joint."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np
import plotly.graph_objects as go

from armonic.errors import SurveyError
from armonic.plots.curves import bands
from armonic.plots.dataset import (
    evenly,
    joints,
    layout_of,
    mode_numbers,
    mode_positions,
    ordered,
    place_of,
    shown_values,
    title_of,
)
from armonic.plots.look import MUTED, TEMPLATE, mode_colour
from armonic.plots.maps import linear_or_log, mode_list, number_curves
from armonic.text import count

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

MAX_DOTS = 12_000
"""Dots of a figure; of larger samples, evenly spaced postures are drawn."""
MAX_JOINTS = 8

_PANEL, _GAP, _TOP, _BOTTOM, _APART = 132, 14, 34, 46, 0.012


def sample_map(ds: xr.Dataset, *, modes: Sequence[int] | None = None) -> go.Figure:
    """Draw natural frequencies at sampled postures as dots: a column per joint that moves, a row per group of modes.

    Args:
        ds: what `armonic.survey` returned over postures; of a leading sweep the first case is drawn.
        modes: numbers of the modes to draw; by default all.

    Raises:
        SurveyError: the dataset is no survey over postures, no joint moves in it, or it lacks a mode.
    """
    layout = layout_of(ds)
    if layout.axes != ("posture",):
        found = f"a survey over {', '.join(layout.dims)}"
        raise SurveyError("ds", found=found, expected="a survey over postures, with their joint coordinates")
    names = [name for name in joints(ds) if np.ptp(np.asarray(ds[name], float)) > 0]
    if not names:
        raise SurveyError("ds", found="no joint that moves", expected="joint coordinates over the postures")
    numbers = mode_numbers(ds, modes)
    ds = ds.isel(mode=mode_positions(ds, numbers))
    total = ds.sizes["posture"]
    kept = evenly(total, max(2, MAX_DOTS // (len(numbers) * len(names[:MAX_JOINTS]))))
    notes = [count(total, "posture") if kept.size == total else f"{kept.size} of {total} postures drawn"]
    if len(names) > MAX_JOINTS:
        notes.append(f"{MAX_JOINTS} of {len(names)} joints drawn")
        names = names[:MAX_JOINTS]
    ds = ds.isel(posture=kept)
    if layout.sweep is not None:
        notes.append(place_of(ds, {layout.sweep: 0}))
        ds = ds.isel({layout.sweep: 0})
    values = ordered(ds["natural_freq_hz"], ("mode", "posture")).astype(float)
    groups = bands(np.nanmin(values, axis=1), np.nanmax(values, axis=1))
    columns, rows = len(names), len(groups)
    height = rows * _PANEL + (rows - 1) * _GAP
    figure = go.Figure(layout={"template": TEMPLATE, "height": height + _TOP + _BOTTOM, "hovermode": "closest"})
    figure.update_layout(margin={"l": 62, "r": 24, "t": _TOP, "b": _BOTTOM}, showlegend=False)
    width = (1 - _APART * (columns - 1)) / columns
    for row, group in enumerate(groups):
        scale, words = linear_or_log(values[group], "natural_freq_hz"), mode_list([numbers[k] for k in group])
        upper = 1 - row * (_PANEL + _GAP) / height
        for column, name in enumerate(names):
            number = row * columns + column + 1
            suffix = str(number) if number > 1 else ""
            first = str(row * columns + 1) if row else ""
            figure.layout[f"xaxis{suffix}"] = {
                "domain": [column * (width + _APART), min(1.0, column * (width + _APART) + width)],
                "anchor": f"y{suffix}",
                "matches": f"x{column + 1 if column else ''}" if row else None,
                "showticklabels": row == rows - 1,
                "nticks": 6,
                "title": {"text": title_of(ds, name) if row == rows - 1 else None},
            }
            figure.layout[f"yaxis{suffix}"] = scale | {
                "domain": [max(0.0, upper - _PANEL / height), upper],
                "anchor": f"x{suffix}",
                "matches": f"y{first}" if column else None,
                "showticklabels": column == 0,
                "ticks": "outside" if column == 0 else "",
                "title": {"text": f"{words}, Hz" if column == 0 else None, "font": {"size": 11}},
            }
            for k in group:
                figure.add_scatter(
                    x=shown_values(ds, name),
                    y=values[k],
                    name=f"mode {numbers[k]}",
                    mode="markers",
                    marker={"size": 3.2, "color": mode_colour(numbers[k]), "opacity": 0.7},
                    hovertemplate=f"%{{y:.5g}} Hz at %{{x:.4g}}<extra>mode {numbers[k]}</extra>",
                    xaxis=f"x{suffix}",
                    yaxis=f"y{suffix}",
                )
        middle = {numbers[k]: float(np.nanmedian(values[k])) for k in group}
        number_curves(figure, suffix, middle, scale, _PANEL)
    place = {"x": 0, "xref": "paper", "y": 1, "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
    font = {"size": 11, "color": MUTED}
    figure.add_annotation(text=html.escape(", ".join(notes)), showarrow=False, font=font, yshift=2, **place)
    return figure
