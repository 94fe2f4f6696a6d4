"""Figure of a plan: the interval of every parameter before and after the measurements that it chose."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

import plotly.graph_objects as go

from armonic.plots.look import BEFORE, INK, TEMPLATE, VERDICT_COLOURS, VERDICT_MARKERS
from armonic.text import VERDICTS, split_path

if TYPE_CHECKING:
    from collections.abc import Iterator

    from armonic.updating.expected import PlannedParameter
    from armonic.updating.planning import Plan

FARTHEST = 999.0
"""Intervals wider than a factor of 1000 either way end in an arrow at the edge."""
TICKS = {
    1e-6: "0.0001 %", 1e-5: "0.001 %", 1e-4: "0.01 %", 1e-3: "0.1 %", 1e-2: "1 %", 0.1: "10 %", 1.0: "× 2", 9.0: "× 10",
    99.0: "× 100", 999.0: "× 1000",
}  # fmt: skip
LIMITS = {0.25: "25 %", 2.0: "× 3"}
"""Where a parameter stops to be identified, and to be weak."""


def planned_intervals(plan: Plan) -> go.Figure:
    """Draw half of every parameter's 95 % interval before and after the plan's measurements, on a logarithmic scale.

    Stiffness and damping stand side by side where both are planned for. Dotted lines mark the limits of the verdicts;
    an interval that is open, or wider than a factor of 1000, is an arrow at the edge.

    Args:
        plan: from `plan_measurement`.
    """
    groups = _groups(plan)
    rows = list(dict.fromkeys(name for group in groups.values() for name in group))
    labels = [html.escape(name if len(name) <= 40 else f"{name[:39]}…") for name in rows]
    room = 22 + round(6.6 * max(map(len, labels), default=0))
    figure = go.Figure(layout={"template": TEMPLATE, "height": 24 * len(rows) + 116, "hovermode": "closest"})
    figure.update_layout(margin={"l": room, "r": 8, "t": 56, "b": 46})
    named: set[str] = set()
    for k, (quantity, parameters) in enumerate(groups.items()):
        members, ys = list(parameters.values()), [rows.index(name) for name in parameters]
        low, high = _range(members)
        suffix = str(k + 1) if k else ""
        axes = {"xaxis": f"x{suffix}", "yaxis": f"y{suffix}"}
        ticks = {x: text for x, text in TICKS.items() if low <= x <= high}
        figure.layout[f"xaxis{suffix}"] = {
            "type": "log",
            "range": [math.log10(low), math.log10(high)],
            "tickvals": list(ticks),
            "ticktext": list(ticks.values()),
            "domain": [k / len(groups) + (0.02 if k else 0), (k + 1) / len(groups)],
            "anchor": f"y{suffix}",
            "title": {"text": f"{quantity.capitalize() or 'Parameter'}, half a 95 % interval"},
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
        for x in (x for x in LIMITS if low < x < high):
            ends = {"x0": x, "x1": x, "y0": -0.6, "y1": len(rows) - 0.4, "xref": axes["xaxis"], "yref": axes["yaxis"]}
            figure.add_shape(type="line", layer="below", line={"color": "#b9c0c7", "width": 1, "dash": "dot"}, **ends)
        for trace in _traces(members, ys, low, high):
            first = trace["showlegend"] and trace["name"] not in named
            named |= {trace["name"]} if first else set()
            figure.add_scatter(**axes, **(trace | {"showlegend": first, "legendgroup": trace["name"]}))
    return figure


def _groups(plan: Plan) -> dict[str, dict[str, PlannedParameter]]:
    """Parameters by quantity and short name; all in one group by full path if short names clash or are too many."""
    groups: dict[str, dict[str, PlannedParameter]] = {}
    for parameter in plan.parameters:
        name, quantity = split_path(parameter.path)
        groups.setdefault(quantity, {})[name] = parameter
    if sum(map(len, groups.values())) < len(plan.parameters) or len(groups) > 2:
        return {"": {parameter.path: parameter for parameter in plan.parameters}}
    return groups


def _range(parameters: list[PlannedParameter]) -> tuple[float, float]:
    shares = [p.share(step) for p in parameters for step in (0, -1)]
    closed = [share for share in shares if 0 < share < math.inf]
    low = min([*closed, 0.1]) / 2
    high = max([min(share, FARTHEST) for share in shares] + [2.5]) * 2
    return low, high


def _traces(parameters: list[PlannedParameter], ys: list[int], low: float, high: float) -> Iterator[dict[str, Any]]:
    """From bottom to top: a line from before to after, rings before, dots after by verdict."""
    edge = (high / low) ** 0.985 * low

    def place(share: float) -> tuple[float, bool]:
        return (share, False) if share <= FARTHEST else (edge, True)

    before, after = ([place(p.share(step)) for p in parameters] for step in (0, -1))
    xs = [x for (a, _), (b, _) in zip(before, after, strict=True) for x in (a, b, math.nan)]
    lines = [y for row in ys for y in (row, row, math.nan)]
    common = {"showlegend": False, "hoverinfo": "skip", "name": "before"}
    yield common | {"x": xs, "y": lines, "mode": "lines", "line": {"color": "#dfe3e7", "width": 5}}
    ring = {"size": 8, "color": "white", "line": {"width": 1.6, "color": BEFORE}}
    yield _dots(parameters, ys, before, 0, "before", ring | {"symbol": _symbols(before, "circle")}, 1000)
    for verdict in VERDICTS:
        chosen = [i for i, p in enumerate(parameters) if p.verdicts[-1] == verdict]
        chosen.sort(key=lambda i: after[i][1])  # the legend shows the first one's sign, which is no arrow if it can
        if chosen:
            places = [after[i] for i in chosen]
            marker = {
                "size": 9,
                "color": VERDICT_COLOURS[verdict],
                "symbol": _symbols(places, VERDICT_MARKERS[verdict]),
            }
            rank = 1001 + VERDICTS.index(verdict)
            told = [parameters[i] for i in chosen], [ys[i] for i in chosen]
            yield _dots(*told, places, -1, f"after: {verdict}", marker, rank)


def _symbols(places: list[tuple[float, bool]], symbol: str) -> list[str]:
    return ["triangle-right" if beyond else symbol for _, beyond in places]


def _dots(
    parameters: list[PlannedParameter],
    ys: list[int],
    places: list[tuple[float, bool]],
    step: int,
    name: str,
    marker: dict[str, Any],
    rank: int,
) -> dict[str, Any]:
    from armonic.updating.advice import spread

    when = "before" if step == 0 else "after"
    return {
        "x": [x for x, _ in places],
        "y": ys,
        "name": name,
        "mode": "markers",
        "marker": marker,
        "legendrank": rank,
        "showlegend": True,
        "customdata": [[html.escape(p.path), spread(p, step)] for p in parameters],
        "hovertemplate": f"%{{customdata[0]}}<br>{when}: %{{customdata[1]}}<extra></extra>",
    }
