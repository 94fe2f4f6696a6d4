"""Figures of time series: motor positions and torques, accelerations with their force, on one axis or a panel each."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
import plotly.graph_objects as go

from armonic.plots.look import MUTED, TEMPLATE, mode_colour

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.series import Channel, TimeSeries

    Array: TypeAlias = NDArray[np.float64]
    Indices: TypeAlias = NDArray[np.intp]

MAX_POINTS = 4000
"""Points per curve that are drawn; of more samples, the least and the greatest of each stretch."""
MAX_ENCODED = 60_000
"""Points of one figure; many channels share them, so that the page stays light."""
MAX_CHANNELS = 24
"""More channels than this are not drawn."""

_TOP, _BOTTOM = 54, 46
_ROW = {"quantity": 190, "channel": 108}
_GAP = {"quantity": 30, "channel": 32}


class _Panel(NamedTuple):
    """One pair of axes: what is above it, the title of its y axis, and the columns drawn in it."""

    heading: str
    title: str
    columns: list[int]


def time_histories(
    series: TimeSeries,
    *patterns: str,
    by: Literal["quantity", "channel"] = "quantity",
    about: Literal["zero", "mean"] = "zero",
    window_s: tuple[float, float] | None = None,
) -> go.Figure:
    """Draw channels over time (Do et al. 2022, Figs. 7, B.1 and B.2); angles in degrees.

    Of long series the least and the greatest sample of each stretch are drawn, so that no peak is lost; the figure says
    so. A stretch of missing samples is a gap.

    Args:
        series: N samples of one or more channels.
        patterns: channels to draw, as in `TimeSeries.select`, "motor_position" or "acceleration", "force"; by default
            all.
        by: "quantity" has one axis per quantity, with a legend of the channels, which keep their colours from one axis
            to the next; "channel" has a panel per channel, each with its own scale.
        about: "mean" draws each channel less its mean, so that motors far apart share an axis.
        window_s: first and last time to draw, s.

    Returns:
        The figure; all its panels share the time axis. More than 24 channels are not drawn, which it says.

    Raises:
        SignalError: no channel has such a name, or there are no samples in the window.
    """
    drawn = series.select(*patterns) if patterns else series
    if window_s is not None:
        drawn = drawn.window(*window_s)
    if about == "mean":
        drawn = drawn.with_values(drawn.values - _means(drawn.values))
    shown = list(range(min(len(drawn.channels), MAX_CHANNELS)))
    panels = _by_quantity(drawn.channels, shown) if by == "quantity" else _by_channel(drawn.channels, shown)
    columns = 2 if by == "channel" and len(panels) > 1 else 1
    rows = max(1, math.ceil(len(panels) / columns))
    total = rows * _ROW[by] + (rows - 1) * _GAP[by]
    figure = go.Figure(layout={"template": TEMPLATE, "height": total + _TOP + _BOTTOM, "hovermode": "closest"})
    figure.update_layout(margin={"l": 70, "r": 8, "t": _TOP, "b": _BOTTOM}, showlegend=by == "quantity")
    colours = _colours(drawn.channels, shown)
    limit = max(200, min(MAX_POINTS, MAX_ENCODED // max(1, len(shown))))
    named = set[str]()
    for k, panel in enumerate(panels):
        row, column = divmod(k, columns)
        suffix = str(k + 1) if k else ""
        _lay_out(
            figure, suffix, panel, drawn, _domains(row, column, columns, total, by), lowest=k + columns >= len(panels)
        )
        for c in panel.columns:
            name = drawn.channels[c].name
            _curve(figure, suffix, drawn, c, limit, color=colours[name], named=name not in named)
            named.add(name)
    notes = ["each less its mean"] if about == "mean" else []
    if len(drawn) > limit:
        notes.append(f"{limit} of {len(drawn)} samples per curve drawn, extremes among them")
    if len(drawn.channels) > len(shown):
        notes.append(f"{len(shown)} of {len(drawn.channels)} channels drawn")
    if notes:
        place = {"x": 1, "xref": "paper", "y": 1, "yref": "paper", "xanchor": "right", "yanchor": "bottom"}
        font = {"size": 11, "color": MUTED}
        figure.add_annotation(text="; ".join(notes), showarrow=False, yshift=16, font=font, **place)
    return figure


def _means(values: Array) -> Array:
    """Of the finite samples of each column; zero where there are none."""
    finite = np.isfinite(values)
    return np.asarray(np.where(finite, values, 0.0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1))


def _by_quantity(channels: Sequence[Channel], shown: list[int]) -> list[_Panel]:
    """A panel per quantity and unit, in the order in which they come."""
    found = dict[tuple[str, str], list[int]]()
    for c in shown:
        found.setdefault((channels[c].quantity, channels[c].unit), []).append(c)
    return [_Panel("", _title(channels[columns[0]]), columns) for columns in found.values()]


def _by_channel(channels: Sequence[Channel], shown: list[int]) -> list[_Panel]:
    return [
        _Panel(html.escape(", ".join(filter(None, [f"{c.name}: {_words(c)}", _unit(c)]))), "", [column])
        for column, c in ((column, channels[column]) for column in shown)
    ]


def _colours(channels: Sequence[Channel], shown: list[int]) -> dict[str, str]:
    """A colour per name: the motor of a joint has the same for its position as for its torque."""
    names = dict.fromkeys(channels[c].name for c in shown)
    return {name: mode_colour(number) for number, name in enumerate(names, 1)}


def _words(channel: Channel) -> str:
    return channel.quantity.replace("_", " ")


def _unit(channel: Channel) -> str:
    return "°" if channel.unit == "rad" else channel.unit.replace(" ", "·")


def _title(channel: Channel) -> str:
    """Of an axis: "Motor position, °"."""
    words, unit = _words(channel), _unit(channel)
    return html.escape(f"{words[:1].upper()}{words[1:]}, {unit}" if unit else f"{words[:1].upper()}{words[1:]}")


def _domains(row: int, column: int, columns: int, total: int, by: str) -> tuple[list[float], list[float]]:
    top = 1 - row * (_ROW[by] + _GAP[by]) / total
    width, gap = (1.0, 0.0) if columns == 1 else (0.455, 0.09)
    left = column * (width + gap)
    return [left, left + width], [max(0.0, top - _ROW[by] / total), top]


def _lay_out(
    figure: go.Figure,
    suffix: str,
    panel: _Panel,
    series: TimeSeries,
    at: tuple[list[float], list[float]],
    *,
    lowest: bool,
) -> None:
    first, last = float(series.time_s[0]), float(series.time_s[-1])
    figure.layout[f"xaxis{suffix}"] = {
        "domain": at[0],
        "anchor": f"y{suffix}",
        "range": [first, last] if last > first else [first - 0.5, first + 0.5],
        "matches": "x" if suffix else None,
        "showticklabels": lowest,
        "title": {"text": "Time, s" if lowest else None},
    }
    figure.layout[f"yaxis{suffix}"] = {
        "domain": at[1],
        "anchor": f"x{suffix}",
        "title": {"text": panel.title, "standoff": 6},
        "nticks": 5,
        "exponentformat": "power",
    } | _limits(series, panel)
    if panel.heading:
        place: dict[str, Any] = {"x": 0, "xref": f"x{suffix} domain", "xanchor": "left"}
        place |= {"y": 1, "yref": f"y{suffix} domain", "yanchor": "bottom"}
        figure.add_annotation(text=panel.heading, showarrow=False, font={"size": 11, "color": MUTED}, **place)


def _limits(series: TimeSeries, panel: _Panel) -> dict[str, Any]:
    """A range in which a signal that hardly moves is a line, not its rounding errors blown up."""
    values = np.concatenate([_shown(series, c) for c in panel.columns])
    values = values[np.isfinite(values)]
    if not values.size:
        return {"range": [-1.0, 1.0]}
    low, high = float(values.min()), float(values.max())
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    half = max(half, 1e-9 * max(abs(low), abs(high))) or 1.0
    return {"range": [middle - 1.08 * half, middle + 1.08 * half]}


def _shown(series: TimeSeries, column: int) -> Array:
    values = series.values[:, column]
    return np.degrees(values) if series.channels[column].unit == "rad" else values


def _curve(
    figure: go.Figure, suffix: str, series: TimeSeries, column: int, limit: int, *, color: str, named: bool
) -> None:
    channel, values = series.channels[column], _shown(series, column)
    kept = thinned(values, limit=limit)
    name, unit = html.escape(channel.name), html.escape(_unit(channel))
    hover = f"%{{y:.6g}} {unit} at %{{x:.6g}} s<extra>{name}<br>{_words(channel)}</extra>"
    figure.add_scatter(
        x=series.time_s[kept],
        y=np.where(np.isfinite(values[kept]), values[kept], np.nan),
        mode="lines" if np.count_nonzero(np.isfinite(values[kept])) > 1 else "markers",
        line={"color": color, "width": 1.3},
        name=name,
        legendgroup=name,
        showlegend=named,
        hovertemplate=hover,
        xaxis=f"x{suffix}",
        yaxis=f"y{suffix}",
    )


def thinned(values: Array, *, limit: int = MAX_POINTS) -> Indices:
    """Which samples of a curve to draw so that none of its extremes is lost.

    Args:
        values: (N,); NaN where there is none.
        limit: samples that are kept at most, four or more.

    Returns:
        Their indices, rising: all, or the first, the last, and the least and greatest of each stretch.
    """
    total = len(values)
    if total <= limit:
        return np.arange(total)
    stretch = math.ceil(total / (limit // 2 - 1))
    count = math.ceil(total / stretch)
    padded = np.full(count * stretch, np.nan)
    padded[:total] = values
    parts = padded.reshape(count, stretch)
    start = stretch * np.arange(count)
    least = start + np.where(np.isnan(parts), np.inf, parts).argmin(axis=1)
    greatest = start + np.where(np.isnan(parts), -np.inf, parts).argmax(axis=1)
    return np.unique(np.concatenate([[0], least, greatest, [total - 1]]))
