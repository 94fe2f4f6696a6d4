"""Figures of how well the data determine each parameter of a fit."""

from __future__ import annotations

import html
import itertools
import math
from typing import TYPE_CHECKING, Any

import plotly.graph_objects as go

from armonic.plots.look import (
    BEFORE,
    INK,
    MUTED,
    TEMPLATE,
    VERDICT_COLOURS,
    VERDICT_MARKERS,
)
from armonic.text import VERDICTS, format_interval, format_si, format_spread, parameter_name, split_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from armonic.updating import Fit, FittedParameter
    from armonic.updating.uncertainty import Verdict

FARTHEST = 1000.0
"""Ratios to the fitted value beyond this, or below its inverse, end in an arrow at the edge."""
PAGE_WIDTH, TICK_WIDTH = 1080.0, 50.0
"""Pixels of a figure, and of one label on the axis of ratios."""


def parameter_intervals(fit: Fit) -> go.Figure:
    """Draw every positive parameter's 95 % interval, start and bounds relative to its value, on a logarithmic scale.

    Stiffness and damping stand side by side where both were fitted. An interval without an end is an arrow
    to the edge. Numbers that may be zero or negative have no ratio; see `bounded_intervals`.

    Args:
        fit: what `armonic.update` returned.
    """
    groups = _groups(fit)
    return _draw([_Panel(parameters, quantity) for quantity, parameters in groups.items()])


def bounded_intervals(fit: Fit) -> go.Figure:
    """Draw the parameters that may be zero or negative: start, value and 95 % interval between their bounds.

    Args:
        fit: what `armonic.update` returned.
    """
    chosen = {parameter_name(p.path): p for p in fit.parameters if p.scale == "linear"}
    return _draw([_Places(chosen, "")])


def _draw(panels: Sequence[_Panel]) -> go.Figure:
    """Panels side by side that share their rows, one per name."""
    rows = list(dict.fromkeys(name for panel in panels for name in panel.names))
    labels = [html.escape(name if len(name) <= 40 else f"{name[:39]}…") for name in rows]
    room = 22 + round(6.6 * max(map(len, labels), default=0))
    figure = go.Figure(layout={"template": TEMPLATE, "height": 24 * len(rows) + 116, "hovermode": "closest"})
    figure.update_layout(margin={"l": room, "r": 4, "t": 56, "b": 46})
    for k, panel in enumerate(panels):
        panel.rows = [rows.index(name) for name in panel.names]
        right = (k + 1) / len(panels) - 0.09
        suffix = str(k + 1) if k else ""
        figure.layout[f"xaxis{suffix}"] = panel.scale((PAGE_WIDTH - room) * (1 / len(panels) - 0.09)) | {
            "domain": [k / len(panels), right],
            "anchor": f"y{suffix}",
            "tickangle": 0,
            "title": {"text": panel.title},
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
        for x in panel.marks:
            ends = {"x0": x, "x1": x, "y0": -0.6, "y1": len(rows) - 0.4, "line": {"color": "#b9c0c7", "width": 1}}
            figure.add_shape(type="line", layer="below", xref=f"x{suffix}", yref=f"y{suffix}", **ends)
        for trace in panel.traces():
            figure.add_scatter(xaxis=f"x{suffix}", yaxis=f"y{suffix}", legendgroup=trace["name"], **trace)
        for y, parameter in zip(panel.rows, panel.parameters, strict=True):
            place = {
                "x": right,
                "xref": "paper",
                "xanchor": "left",
                "xshift": 5,
                "y": y,
                "yref": f"y{suffix}",
            }
            note = {"text": panel.spread(parameter), "font": {"size": 11, "color": MUTED}}
            figure.add_annotation(showarrow=False, **place, **note)
    _name_once(figure)
    return figure


def _groups(fit: Fit) -> dict[str, dict[str, FittedParameter]]:
    """Positive parameters by quantity and short name; all in one group by full path if short names clash."""
    groups: dict[str, dict[str, FittedParameter]] = {}
    positive = [p for p in fit.parameters if p.scale == "log"]
    for parameter in positive:
        name, quantity = split_path(parameter.path)
        groups.setdefault(quantity, {})[name] = parameter
    if sum(map(len, groups.values())) < len(positive):
        return {"": {parameter.path: parameter for parameter in positive}}
    return groups


def _name_once(figure: go.Figure) -> None:
    """Keep one entry in the legend of those that panels share."""
    named: set[str] = set()
    for trace in figure.data:
        trace.showlegend = trace.showlegend is not False and trace.name not in named
        named.update([trace.name] if trace.showlegend else [])


class _Panel:
    """Parameters of one quantity, one per row, as ratios to their fitted values."""

    marks: tuple[float, ...] = (1.0,)
    """Where upright lines stand."""

    def __init__(self, parameters: dict[str, FittedParameter], quantity: str) -> None:
        self.names, self.parameters, self.rows = list(parameters), list(parameters.values()), list[int]()
        self.title = f"{quantity.capitalize() or 'Parameter'}, relative to its fitted value"
        self.values = [self.place(p, p.value) for p in self.parameters]
        self.bounds = [(self.place(p, p.lower), self.place(p, p.upper)) for p in self.parameters]
        self.starts = [self.place(p, p.start) for p in self.parameters]
        self.reach = [(self.place(p, p.interval[0]), self.place(p, p.interval[1])) for p in self.parameters]
        self.low, self.high = self.limits()

    def place(self, p: FittedParameter, value: float) -> float:
        """Where a value of a parameter stands."""
        return value / p.value

    def limits(self) -> tuple[float, float]:
        """Both ends of the axis."""
        ends = [*self.starts, *itertools.chain(*self.bounds, *self.reach)]
        ends = [min(max(end, 1 / FARTHEST), FARTHEST) for end in ends if 0 < end < math.inf]
        return min([*ends, 1 / 3]) / 1.3, max([*ends, 3.0]) * 1.3

    def heads(self) -> tuple[float, float]:
        """Where arrows end, so that their heads are all in view."""
        edge = (self.high / self.low) ** 0.012
        return self.low * edge, self.high / edge

    def spread(self, p: FittedParameter) -> str:
        """What stands beside a row."""
        return format_spread(*p.interval)

    def scale(self, width: float) -> dict[str, Any]:
        """Range and ticks of the axis, which is so many pixels wide."""
        limits = [math.log10(self.low), math.log10(self.high)]
        step = math.ceil(TICK_WIDTH / (width / (limits[1] - limits[0])))
        decades = [10.0**n for n in range(-6, 7) if n % step == 0]
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
        first, last = self.heads()
        closed = [(self.reach[i][0] >= first, self.reach[i][1] <= last) for i in chosen]
        left = [self.reach[i][0] if ends[0] else first for i, ends in zip(chosen, closed, strict=True)]
        right = [self.reach[i][1] if ends[1] else last for i, ends in zip(chosen, closed, strict=True)]
        yield common | {
            "x": [self.values[i] for i in chosen],
            "y": [self.rows[i] for i in chosen],
            "legendrank": 1001 + VERDICTS.index(verdict),
            "marker": {"symbol": VERDICT_MARKERS[verdict], "size": 8, "color": colour},
            "error_x": {
                "array": [end - self.values[i] for i, end in zip(chosen, right, strict=True)],
                "arrayminus": [self.values[i] - end for i, end in zip(chosen, left, strict=True)],
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


class _Places(_Panel):
    """Parameters that may be zero or negative, as places between their bounds, from 0 to 1."""

    marks = (0.0, 1.0)

    def __init__(self, parameters: dict[str, FittedParameter], quantity: str) -> None:
        super().__init__(parameters, quantity)
        self.title = "Place between the bounds"

    def place(self, p: FittedParameter, value: float) -> float:
        """Share of the way from the lower bound to the upper one."""
        return (value - p.lower) / (p.upper - p.lower)

    def limits(self) -> tuple[float, float]:
        """Both bounds, and a little more to show what lies beyond."""
        return -0.08, 1.08

    def heads(self) -> tuple[float, float]:
        """Where arrows end."""
        return self.low + 0.01, self.high - 0.01

    def spread(self, p: FittedParameter) -> str:
        """Half the interval, SI."""
        half = (p.interval[1] - p.interval[0]) / 2
        return f"± {format_si(half, digits=2)}" if math.isfinite(half) else "open"

    def scale(self, width: float) -> dict[str, Any]:
        """Ticks at the bounds and between."""
        ends = {"lower bound": 0.0, "": 0.25, "middle": 0.5, " ": 0.75, "upper bound": 1.0}
        return {"range": [self.low, self.high], "tickvals": list(ends.values()), "ticktext": list(ends)}


def _hover(p: FittedParameter) -> list[str]:
    interval = format_interval(*p.interval, signed=p.scale == "linear")
    return [html.escape(p.path), format_si(p.value, p.unit), interval]
