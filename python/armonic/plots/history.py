"""Figure of how the cost of a fit fell, stage by stage."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import plotly.graph_objects as go

from armonic.plots.look import AFTER, MUTED, TEMPLATE, log_axis
from armonic.text import format_si

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.updating import Fit
    from armonic.updating.stages import StageEnd

    Array: TypeAlias = NDArray[np.float64]

MOST_STAGES = 16
"""More stages than this are not parted by lines."""
MOST_POINTS = 4000
"""Longer histories are drawn by the points where the cost fell, and by no more of these than so many."""
MARKED = 240
"""Below so many evaluations each has a dot: a stage of one would be no line."""
OWN = "#8d99a5"
"""Colour of a stage with a cost of its own."""
PLOT_WIDTH = 1000.0
"""About the pixels that all evaluations share."""


class _Segment(NamedTuple):
    """What is drawn of one stage: evaluations and costs (E,), its name, and whether its cost is its own."""

    x: Array
    y: Array
    name: str
    own: bool


def cost_history(fit: Fit) -> go.Figure:
    """Draw the best cost (Huynh et al. 2021, Eq. 22) over evaluations, on a logarithmic scale.

    Each stage of the run is a curve of its own, parted from the next by a dotted line: grey where the stage has its own
    cost, coloured where it has the one that was asked for. Histories of very many evaluations are drawn by the points
    where the cost fell.

    Args:
        fit: what `armonic.update` returned.
    """
    cost = np.asarray(fit.cost_history, float)
    figure = go.Figure(layout={"template": TEMPLATE, "height": 270, "showlegend": False, "hovermode": "x"})
    figure.update_layout(
        margin={"l": 70, "r": 8, "t": 28, "b": 46},
        xaxis={
            "title": {"text": "Evaluations"},
            "range": [0, max(1, cost.size) * 1.02],
            "tickformat": "d",
            "dtick": 1 if cost.size < 10 else None,
        },
        yaxis={"title": {"text": "Cost"}} | log_axis(cost, least=1.0),
    )
    segments = _segments(fit, cost)
    for own in (True, False):
        chosen = [segment for segment in segments if segment.own == own]
        if chosen or not (own or segments):
            _draw(figure, chosen, OWN if own else AFTER, markers=cost.size < MARKED)
    _part_stages(figure, fit)
    if cost.size and math.isfinite(cost[-1]) and cost[-1] > 0:
        figure.add_annotation(
            x=int(cost.size),
            y=math.log10(cost[-1]),
            text=format_si(float(cost[-1])),
            xanchor="right",
            yanchor="bottom",
            yshift=3,
            showarrow=False,
            font={"size": 12, "color": AFTER},
        )
    return figure


def _segments(fit: Fit, cost: Array) -> list[_Segment]:
    """A curve per stage; one without a name if the stages are not those of the history."""
    if not cost.size:
        return []
    if not _matches(fit):
        return [_segment(1, cost, MOST_POINTS, "", own=False)]
    found, first = list[_Segment](), 1
    for stage in fit.stages:
        length = len(stage.history)
        if length:
            share = max(2, round(MOST_POINTS * length / cost.size))
            part = cost[first - 1 : first - 1 + length]
            found.append(_segment(first, part, share, stage.name, own=_is_own(stage, fit)))
        first += length
    return found


def _segment(first: int, cost: Array, most: int, name: str, *, own: bool) -> _Segment:
    kept = _kept(cost, most)
    drawn = np.where((cost > 0) & np.isfinite(cost), cost, np.nan)  # an exact fit has no logarithm
    return _Segment((first + kept).astype(float), drawn[kept], name, own)


def _matches(fit: Fit) -> bool:
    return bool(fit.stages) and sum(len(stage.history) for stage in fit.stages) == len(fit.cost_history)


def _is_own(stage: StageEnd, fit: Fit) -> bool:
    """Whether a stage's history is in a cost that is not the one that was asked for."""
    if stage.name == "levelled":
        return fit.task.relative or not fit.task.in_core
    return stage.sigma > 0 or stage.name.startswith("deviations")


def _kept(cost: Array, most: int) -> NDArray[np.intp]:
    """The points to draw: all, or if they are too many the first, the last, and those where the cost fell."""
    if len(cost) <= most:
        return np.arange(len(cost))
    fell = np.flatnonzero(np.diff(cost)) + 1
    if len(fell) > most - 2:
        fell = fell[np.unique(np.linspace(0, len(fell) - 1, max(most - 2, 1)).round().astype(np.intp))]
    return np.unique(np.concatenate([[0], fell, [len(cost) - 1]]))


def _draw(figure: go.Figure, segments: Sequence[_Segment], colour: str, *, markers: bool) -> None:
    """Curves of one colour, with a gap between stages."""
    xs, ys, names = list[float](), list[float](), list[str]()
    for segment in segments:
        if xs:
            xs, ys, names = [*xs, math.nan], [*ys, math.nan], [*names, ""]
        xs += segment.x.tolist()
        ys += segment.y.tolist()
        names += [html.escape(segment.name or "cost")] * len(segment.x)
    figure.add_scatter(
        x=xs,
        y=ys,
        mode="lines+markers" if markers else "lines",
        line={"color": colour, "width": 1.8, "shape": "hv"},
        marker={"size": 4.5},
        customdata=names,
        hovertemplate="%{customdata}: %{y:.4g} after %{x} evaluations<extra></extra>",
    )


def _part_stages(figure: go.Figure, fit: Fit) -> None:
    """A line at the beginning of each stage but the first, and its σ or its name above it where there is room."""
    lengths = [len(stage.history) for stage in fit.stages]
    if not _matches(fit) or not 1 < len(lengths) <= MOST_STAGES:
        return
    total, first = sum(lengths), 0
    for stage, length in zip(fit.stages, lengths, strict=True):
        if first:
            line = {"color": "#b9c0c7", "width": 1, "dash": "dot"}
            figure.add_vline(x=first + 0.5, line=line, layer="below")
        name = f"σ {stage.sigma:.2g}" if stage.sigma > 0 else stage.name
        middle = first + 0.5 + length / 2
        if 7.0 * len(name) + 4 < PLOT_WIDTH * length / total and middle < 0.93 * total:  # buttons stand to the right
            figure.add_annotation(
                x=middle,
                y=1,
                yref="paper",
                yanchor="bottom",
                text=html.escape(name),
                showarrow=False,
                font={"size": 11, "color": MUTED},
            )
        first += length
