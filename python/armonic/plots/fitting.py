"""Figures of a fit: how the cost fell, and how well the data determine each parameter."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from armonic.plots.look import (
    AFTER,
    BEFORE,
    INK,
    MUTED,
    TEMPLATE,
    VERDICT_COLOURS,
    VERDICT_MARKERS,
    log_axis,
)
from armonic.text import VERDICTS, format_interval, format_si, format_spread, split_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.updating import Fit, FittedParameter

FARTHEST = 1000.0
"""Ratios to the fitted value beyond this, or below its inverse, end in an arrow at the edge."""


def cost_history(fit: Fit) -> go.Figure:
    """Draw the best cost (Huynh et al. 2021, Eq. 22) over the number of evaluations, on a logarithmic scale."""
    cost = np.asarray(fit.cost_history, float)
    evaluations = np.arange(1, cost.size + 1)
    figure = go.Figure(layout={"template": TEMPLATE, "height": 270, "showlegend": False, "hovermode": "x"})
    figure.update_layout(
        margin={"l": 70, "r": 80, "t": 16, "b": 46},
        xaxis={"title": {"text": "Evaluations"}, "range": [0, max(1, cost.size) * 1.02], "tickformat": "d"},
        yaxis={"title": {"text": "Cost"}} | log_axis(cost, least=1.0),
    )
    figure.add_scatter(
        x=evaluations,
        y=np.where(cost > 0, cost, np.nan),  # an exact fit has no logarithm
        mode="lines+markers" if cost.size < 80 else "lines",
        line={"color": AFTER, "width": 1.8, "shape": "hv"},
        marker={"size": 4.5},
        hovertemplate="cost %{y:.4g} after %{x} evaluations<extra></extra>",
    )
    if cost.size and cost[-1] > 0:
        figure.add_annotation(
            x=int(evaluations[-1]),
            y=math.log10(cost[-1]),
            text=format_si(float(cost[-1])),
            xanchor="left",
            xshift=8,
            showarrow=False,
            font={"size": 12, "color": AFTER},
        )
    return figure


def parameter_intervals(fit: Fit) -> go.Figure:
    """Draw every parameter's 95 % interval, start and bounds relative to its value, on a logarithmic scale.

    Stiffness and damping stand side by side where both were fitted. An interval without an end is an arrow to the edge.
    """
    panels, rows = _panels(fit)
    labels = [html.escape(name if len(name) <= 40 else f"{name[:39]}…") for name in rows]
    figure = go.Figure(layout={"template": TEMPLATE, "height": 24 * len(rows) + 116, "hovermode": "closest"})
    figure.update_layout(margin={"l": 22 + round(6.6 * max(map(len, labels), default=0)), "r": 4, "t": 56, "b": 46})
    named: set[str] = set()
    for k, (quantity, parameters) in enumerate(panels.items()):
        left, right = k / len(panels), (k + 1) / len(panels)
        right -= 0.09 if len(panels) > 1 else 0.08
        suffix = str(k + 1) if k else ""
        limits = _limits(list(parameters.values()))
        figure.layout[f"xaxis{suffix}"] = {
            "domain": [left, right],
            "anchor": f"y{suffix}",
            "type": "log",
            "range": [math.log10(limit) for limit in limits],
            "tickvals": (decades := [10.0**n for n in range(-3, 4)]),
            "ticktext": [f"× {decade:g}" for decade in decades],
            "title": {"text": f"{quantity.capitalize() or 'Parameter'}, relative to its fitted value"},
        }
        figure.layout[f"yaxis{suffix}"] = {
            "domain": [0, 1],
            "anchor": f"x{suffix}",
            "matches": "y" if k else None,
            "tickvals": list(range(len(rows))),
            "ticktext": labels,
            "showticklabels": k == 0,
            "range": [len(rows) - 0.4, -0.6],
            "ticks": "",
            "tickfont": {"color": INK},
        }
        axes = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
        figure.add_shape(type="line", x0=1, x1=1, y0=-0.6, y1=len(rows) - 0.4, layer="below",
                         line={"color": "#b9c0c7", "width": 1}, xref=axes["xaxis"], yref=axes["yaxis"])  # fmt: skip
        for trace in _panel_traces(parameters, rows, limits):
            new = trace["name"] not in named and trace.get("showlegend", True)
            named.update([trace["name"]] if new else [])
            figure.add_scatter(**{**trace, "legendgroup": trace["name"], "showlegend": new} | axes)
        for name, parameter in parameters.items():
            figure.add_annotation(
                text=format_spread(*parameter.interval),
                x=right,
                xref="paper",
                y=rows.index(name),
                yref=axes["yaxis"],
                xanchor="left",
                xshift=5,
                showarrow=False,
                font={"size": 11, "color": MUTED},
            )
    return figure


def _panels(fit: Fit) -> tuple[dict[str, dict[str, FittedParameter]], list[str]]:
    """Parameters by quantity and short name, and the names in the order of their rows; full paths if names clash."""
    panels: dict[str, dict[str, FittedParameter]] = {}
    for parameter in fit.parameters:
        name, quantity = split_path(parameter.path)
        panels.setdefault(quantity, {})[name] = parameter
    if sum(map(len, panels.values())) < len(fit.parameters):
        panels = {"": {parameter.path: parameter for parameter in fit.parameters}}
    return panels, list(dict.fromkeys(name for panel in panels.values() for name in panel))


def _limits(parameters: Sequence[FittedParameter]) -> tuple[float, float]:
    ends = [1 / 3, 3.0]
    for parameter in parameters:
        for end in (parameter.lower, parameter.upper, parameter.start, *parameter.interval):
            ratio = end / parameter.value
            if math.isfinite(ratio) and ratio > 0:
                ends.append(min(max(ratio, 1 / FARTHEST), FARTHEST))
    return min(ends) / 1.3, max(ends) * 1.3


def _panel_traces(
    parameters: dict[str, FittedParameter], rows: list[str], limits: tuple[float, float]
) -> list[dict[str, Any]]:
    """Bounds, starts, then dots with intervals per verdict and arrows at the edges, as arguments of a scatter."""
    low, high = limits
    inside = (low * 1.04, high / 1.04)
    span: dict[str, list[float]] = {"x": [], "y": []}
    ticks: dict[str, list[float]] = {"x": [], "y": []}
    for name, p in parameters.items():
        y, ends = rows.index(name), (p.lower / p.value, p.upper / p.value)
        span["x"] += [max(ends[0], low), min(ends[1], high), math.nan]
        span["y"] += [y, y, math.nan]
        for end in ends:
            if low < end < high:
                ticks["x"].append(end)
                ticks["y"].append(y)
    tick = {"symbol": "line-ns", "size": 9, "line": {"width": 1.4, "color": "#98a1aa"}}
    traces: list[dict[str, Any]] = [
        {**span, "name": "bounds", "mode": "lines", "line": {"color": "#dfe3e7", "width": 5}, "hoverinfo": "skip",
         "showlegend": False},
        {**ticks, "name": "bounds", "mode": "markers", "marker": tick, "hoverinfo": "skip"},
        {
            "x": [p.start / p.value for p in parameters.values()],
            "y": [rows.index(name) for name in parameters],
            "name": "start",
            "mode": "markers",
            "marker": {"symbol": "circle-open", "size": 8, "color": BEFORE, "line": {"width": 1.4}},
            "customdata": [format_si(p.start, p.unit) for p in parameters.values()],
            "hovertemplate": "start %{customdata}<extra></extra>",
        },
    ]  # fmt: skip
    for verdict in VERDICTS:
        chosen = {name: p for name, p in parameters.items() if p.verdict == verdict}
        if not chosen:
            continue
        colour = VERDICT_COLOURS[verdict]
        reach = [(p.interval[0] / p.value, p.interval[1] / p.value) for p in chosen.values()]
        drawn = [(max(a, inside[0]), min(b, inside[1])) for a, b in reach]
        ys = [rows.index(name) for name in chosen]
        traces.append(
            {
                "x": [1.0] * len(chosen),
                "y": ys,
                "name": verdict,
                "legendrank": 1001 + VERDICTS.index(verdict),
                "mode": "markers",
                "marker": {"symbol": VERDICT_MARKERS[verdict], "size": 8, "color": colour},
                "error_x": {
                    "array": [b - 1 for _, b in drawn],
                    "arrayminus": [1 - a for a, _ in drawn],
                    "symmetric": False,
                    "color": colour,
                    "thickness": 2.2,
                    "width": 0,
                },
                "customdata": [
                    [html.escape(p.path), format_si(p.value, p.unit), format_interval(*p.interval, (p.lower, p.upper))]
                    for p in chosen.values()
                ],
                "hovertemplate": "%{customdata[0]}<br>%{customdata[1]}<br>95 %: %{customdata[2]}<extra></extra>",
            }
        )
        for side, symbol, edge in ((0, "triangle-left", inside[0]), (1, "triangle-right", inside[1])):
            beyond = [y for y, ends in zip(ys, reach, strict=True) if not inside[0] <= ends[side] <= inside[1]]
            if beyond:
                marker = {"symbol": symbol, "size": 9, "color": colour}
                traces.append(
                    {"x": [edge] * len(beyond), "y": beyond, "name": verdict, "mode": "markers", "marker": marker,
                     "hoverinfo": "skip", "showlegend": False}
                )  # fmt: skip
    return traces
