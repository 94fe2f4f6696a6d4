"""Figures of a fit: how the cost fell, and how well the data determine each parameter."""

from __future__ import annotations

import html
import itertools
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
    from collections.abc import Iterator

    from armonic.updating import Fit, FittedParameter
    from armonic.updating.uncertainty import Verdict

MOST_STAGES = 16
"""More stages than this are not parted."""
FARTHEST = 1000.0
"""Ratios to the fitted value beyond this, or below its inverse, end in an arrow at the edge."""


def cost_history(fit: Fit) -> go.Figure:
    """Draw the best cost (Huynh et al. 2021, Eq. 22) over evaluations, on a logarithmic scale.

    Dotted lines part the stages of the run, each of which has its own cost; those off the imaginary axis are named by
    their distance from it.
    """
    cost = np.asarray(fit.cost_history, float)
    evaluations = np.arange(1, cost.size + 1)
    figure = go.Figure(layout={"template": TEMPLATE, "height": 270, "showlegend": False, "hovermode": "x"})
    figure.update_layout(
        margin={"l": 70, "r": 8, "t": 28, "b": 46},
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
    _part_stages(figure, fit)
    if cost.size and cost[-1] > 0:
        figure.add_annotation(
            x=int(evaluations[-1]),
            y=math.log10(cost[-1]),
            text=format_si(float(cost[-1])),
            xanchor="right",
            yanchor="bottom",
            yshift=3,
            showarrow=False,
            font={"size": 12, "color": AFTER},
        )
    return figure


def _part_stages(figure: go.Figure, fit: Fit) -> None:
    """A line at the beginning of each stage but the first, and σ above those that have one."""
    lengths = [len(stage.history) for stage in fit.stages]
    if not 1 < len(lengths) <= MOST_STAGES or sum(lengths) != len(fit.cost_history):
        return
    total, first = sum(lengths), 0
    for stage, length in zip(fit.stages, lengths, strict=True):
        if first:
            line = {"color": "#b9c0c7", "width": 1, "dash": "dot"}
            figure.add_vline(x=first + 0.5, line=line, layer="below")
        if stage.sigma > 0 and length > 0.03 * total:
            figure.add_annotation(
                x=first + 0.5 + length / 2,
                y=1,
                yref="paper",
                yanchor="bottom",
                text=f"σ {stage.sigma:.2g}",
                showarrow=False,
                font={"size": 11, "color": MUTED},
            )
        first += length


def parameter_intervals(fit: Fit) -> go.Figure:
    """Draw every parameter's 95 % interval, start and bounds relative to its value, on a logarithmic scale.

    Stiffness and damping stand side by side where both were fitted. An interval without an end is an arrow
    to the edge.
    """
    groups = _groups(fit)
    rows = list(dict.fromkeys(name for group in groups.values() for name in group))
    labels = [html.escape(name if len(name) <= 40 else f"{name[:39]}…") for name in rows]
    room = 22 + round(6.6 * max(map(len, labels), default=0))
    figure = go.Figure(layout={"template": TEMPLATE, "height": 24 * len(rows) + 116, "hovermode": "closest"})
    figure.update_layout(margin={"l": room, "r": 4, "t": 56, "b": 46})
    for k, (quantity, parameters) in enumerate(groups.items()):
        panel = _Panel(parameters, [rows.index(name) for name in parameters])
        right = (k + 1) / len(groups) - 0.09
        suffix = str(k + 1) if k else ""
        figure.layout[f"xaxis{suffix}"] = panel.scale() | {
            "domain": [k / len(groups), right],
            "anchor": f"y{suffix}",
            "title": {"text": f"{quantity.capitalize() or 'Parameter'}, relative to its fitted value"},
        }
        figure.layout[f"yaxis{suffix}"] = {
            "anchor": f"x{suffix}",
            "matches": "y" if k else None,
            "tickvals": list(range(len(rows))),
            "ticktext": labels,
            "showticklabels": k == 0,
            "range": [len(rows) - 0.4, -0.6],
            "ticks": "",
            "tickfont": {"color": INK},
        }
        unity = {
            "x0": 1,
            "x1": 1,
            "y0": -0.6,
            "y1": len(rows) - 0.4,
            "line": {"color": "#b9c0c7", "width": 1},
        }
        figure.add_shape(type="line", layer="below", xref=f"x{suffix}", yref=f"y{suffix}", **unity)
        for trace in panel.traces():
            figure.add_scatter(xaxis=f"x{suffix}", yaxis=f"y{suffix}", legendgroup=trace["name"], **trace)
        for y, parameter in zip(panel.rows, parameters.values(), strict=True):
            place = {
                "x": right,
                "xref": "paper",
                "xanchor": "left",
                "xshift": 5,
                "y": y,
                "yref": f"y{suffix}",
            }
            note = {"text": format_spread(*parameter.interval), "font": {"size": 11, "color": MUTED}}
            figure.add_annotation(showarrow=False, **place, **note)
    _name_once(figure)
    return figure


def _groups(fit: Fit) -> dict[str, dict[str, FittedParameter]]:
    """Parameters by quantity and short name; all in one group by full path if short names clash."""
    groups: dict[str, dict[str, FittedParameter]] = {}
    for parameter in fit.parameters:
        name, quantity = split_path(parameter.path)
        groups.setdefault(quantity, {})[name] = parameter
    if sum(map(len, groups.values())) < len(fit.parameters):
        return {"": {parameter.path: parameter for parameter in fit.parameters}}
    return groups


def _name_once(figure: go.Figure) -> None:
    """Keep one entry in the legend of those that panels share."""
    named: set[str] = set()
    for trace in figure.data:
        trace.showlegend = trace.showlegend is not False and trace.name not in named
        named.update([trace.name] if trace.showlegend else [])


class _Panel:
    """Parameters of one quantity, one per row, as ratios to their fitted values."""

    def __init__(self, parameters: dict[str, FittedParameter], rows: list[int]) -> None:
        self.parameters, self.rows = list(parameters.values()), rows
        self.bounds = [(p.lower / p.value, p.upper / p.value) for p in self.parameters]
        self.starts = [p.start / p.value for p in self.parameters]
        self.reach = [tuple(end / p.value for end in p.interval) for p in self.parameters]
        ends = [*self.starts, *itertools.chain(*self.bounds, *self.reach)]
        ends = [min(max(end, 1 / FARTHEST), FARTHEST) for end in ends if 0 < end < math.inf]
        self.low, self.high = min([*ends, 1 / 3]) / 1.3, max([*ends, 3.0]) * 1.3

    def scale(self) -> dict[str, Any]:
        """Range and ticks of the axis of ratios."""
        decades = [10.0**n for n in range(-3, 4)]
        limits = [math.log10(self.low), math.log10(self.high)]
        return {
            "type": "log",
            "range": limits,
            "tickvals": decades,
            "ticktext": [f"× {d:g}" for d in decades],
        }

    def traces(self) -> list[dict[str, Any]]:
        """Scatters from bottom to top: bounds, dots with intervals by verdict, starts."""
        return [
            *self._bounds(),
            *(trace for verdict in VERDICTS for trace in self._dots(verdict)),
            self._start(),
        ]

    def _bounds(self) -> list[dict[str, Any]]:
        xs, ys = [], []
        for (lower, upper), y in zip(self.bounds, self.rows, strict=True):
            xs += [max(lower, self.low), min(upper, self.high), math.nan]
            ys += [y, y, math.nan]
        ends = [(x, y) for pair, y in zip(self.bounds, self.rows, strict=True) for x in pair]
        ends = [(x, y) for x, y in ends if self.low < x < self.high]
        tick = {"symbol": "line-ns", "size": 9, "line": {"width": 1.4, "color": "#98a1aa"}}
        common = {"name": "bounds", "legendrank": 999, "hoverinfo": "skip"}
        return [
            common
            | {
                "x": xs,
                "y": ys,
                "mode": "lines",
                "line": {"color": "#dfe3e7", "width": 5},
                "showlegend": False,
            },
            common | {"x": [x for x, _ in ends], "y": [y for _, y in ends], "mode": "markers", "marker": tick},
        ]

    def _dots(self, verdict: Verdict) -> Iterator[dict[str, Any]]:
        chosen = [i for i, parameter in enumerate(self.parameters) if parameter.verdict == verdict]
        if not chosen:
            return
        colour = VERDICT_COLOURS[verdict]
        common = {"name": verdict, "mode": "markers"}
        edge = (self.high / self.low) ** 0.012  # so that an arrow's head is all in view
        first, last = self.low * edge, self.high / edge
        closed = [(self.reach[i][0] >= first, self.reach[i][1] <= last) for i in chosen]
        left = [self.reach[i][0] if ends[0] else first for i, ends in zip(chosen, closed, strict=True)]
        right = [self.reach[i][1] if ends[1] else last for i, ends in zip(chosen, closed, strict=True)]
        yield common | {
            "x": [1.0] * len(chosen),
            "y": [self.rows[i] for i in chosen],
            "legendrank": 1001 + VERDICTS.index(verdict),
            "marker": {"symbol": VERDICT_MARKERS[verdict], "size": 8, "color": colour},
            "error_x": {
                "array": [end - 1 for end in right],
                "arrayminus": [1 - end for end in left],
                "symmetric": False,
                "color": colour,
                "thickness": 2.2,
                "width": 0,
            },
            "customdata": [_hover(self.parameters[i]) for i in chosen],
            "hovertemplate": "%{customdata[0]}<br>%{customdata[1]}<br>95 %: %{customdata[2]}<extra></extra>",
        }
        for side, symbol, x in ((0, "triangle-left", first), (1, "triangle-right", last)):
            ys = [self.rows[i] for i, ends in zip(chosen, closed, strict=True) if not ends[side]]
            marker = {"symbol": symbol, "size": 9, "color": colour}
            if ys:
                yield common | {
                    "x": [x] * len(ys),
                    "y": ys,
                    "marker": marker,
                    "hoverinfo": "skip",
                    "showlegend": False,
                }

    def _start(self) -> dict[str, Any]:
        ring = {"symbol": "circle", "size": 7, "color": "white", "line": {"width": 1.5, "color": BEFORE}}
        return {
            "x": self.starts,
            "y": self.rows,
            "name": "start",
            "legendrank": 1000,
            "mode": "markers",
            "marker": ring,
            "customdata": [format_si(p.start, p.unit) for p in self.parameters],
            "hovertemplate": "start %{customdata}<extra></extra>",
        }


def _hover(p: FittedParameter) -> list[str]:
    interval = format_interval(*p.interval)
    return [html.escape(p.path), format_si(p.value, p.unit), interval]
