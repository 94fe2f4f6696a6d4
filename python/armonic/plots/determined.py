"""Figures of what the data determine: correlations, stiff and sloppy directions, bands of responses, profiles."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import plotly.graph_objects as go

from armonic.plots.look import AFTER, BEFORE, GRID, INK, MUTED, TEMPLATE, VERDICT_COLOURS
from armonic.text import format_si, format_spread, parameter_name, split_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.updating import Fit
    from armonic.updating.bands import FrfBands
    from armonic.updating.directions import Direction
    from armonic.updating.parameters import Parameter
    from armonic.updating.profile import Profile

    Array: TypeAlias = NDArray[np.float64]

NORMAL_95 = 1.959963984540054
BAND = "rgba(228, 87, 46, 0.28)"
"""Colour of a 95 % band: that of the fitted response, thinned."""
BAND_NAME = "95 % band"
FARTHEST = 999.0
"""Shares beyond a factor of 1000 end in an arrow at the edge."""
TICKS = {
    1e-6: "0.0001 %", 1e-5: "0.001 %", 1e-4: "0.01 %", 1e-3: "0.1 %", 1e-2: "1 %", 0.1: "10 %", 1.0: "× 2", 9.0: "× 10",
    99.0: "× 100", 999.0: "× 1000",
}  # fmt: skip
LIMITS = (0.25, 2.0)
"""Where a parameter stops to be identified, and to be weak."""
OPEN_FACTOR = 1e4
"""What is open by more than this is open altogether."""
LEAST = 0.04
"""Smaller weights are not drawn."""
STIFFEST, SLOPPIEST = 6, 24
"""Of more directions than these only so many are drawn from either end."""


def correlation_matrix(fit: Fit) -> go.Figure:
    """Draw how the estimates of the parameters hang together, from −1 to 1; grey where the data leave one open.

    Args:
        fit: what `armonic.update` returned.
    """
    from armonic.updating.directions import correlation

    order = _by_quantity(fit.coordinates)
    matrix = correlation(fit.covariance)[np.ix_(order, order)]
    names = [parameter_name(fit.coordinates[i].path) for i in order]
    labels = [html.escape(_shortened(name)) for name in names]
    count = len(names)
    cell = min(44.0, 620 / count)
    written = cell >= 24
    room = 22 + round(6.4 * max(map(len, labels)))
    figure = go.Figure(layout={"template": TEMPLATE, "hovermode": "closest"})
    figure.update_layout(
        height=round(cell * count) + room + 20,
        width=round(cell * count) + room + 150,
        margin={"l": room, "r": 150, "t": 20, "b": room},
        plot_bgcolor="#e3e7ea",
    )
    axis = {
        "showgrid": False,
        "ticks": "",
        "mirror": True,
        "constrain": "domain",
        "tickfont": {"size": 11 if written else 9, "color": INK},
        "tickvals": list(range(count)),
        "ticktext": labels,
    }
    figure.update_xaxes(**axis, tickangle=-90, range=[-0.5, count - 0.5])
    figure.update_yaxes(**axis, range=[count - 0.5, -0.5], scaleanchor="x")
    figure.add_heatmap(
        z=matrix,
        zmin=-1,
        zmax=1,
        colorscale=[[0, "#0b4a80"], [0.25, "#7fb2d6"], [0.5, "#ffffff"], [0.75, "#f2a58c"], [1, "#b5371a"]],
        xgap=1,
        ygap=1,
        colorbar={
            "title": {"text": "Correlation", "font": {"size": 12}},
            "tickvals": [-1, -0.5, 0, 0.5, 1],
            "ticktext": ["−1", "−0.5", "0", "0.5", "1"],
            "thickness": 12,
            "len": min(1.0, 240 / (cell * count)),
            "outlinewidth": 0,
        },
        text=[[_figure(value, i == j) for j, value in enumerate(row)] for i, row in enumerate(matrix)],
        customdata=[[f"{html.escape(a)}, {html.escape(b)}" for b in names] for a in names],
        texttemplate="%{text}" if written else None,
        textfont={"size": 9},
        hovertemplate="%{customdata}<br>%{z:.3f}<extra></extra>",
        hoverongaps=False,
    )
    return figure


def _figure(value: float, own: bool) -> str:
    """A coefficient as it stands in its cell; small ones and the diagonal are left out."""
    return f"{value:.2f}".replace("-", "−") if abs(value) >= 0.095 and not own else ""


def principal_directions(fit: Fit) -> go.Figure:
    """Draw the directions of what the data know, from stiff to sloppy: how far each is open, and what it is made of.

    To the left half a 95 % interval along the direction, on a logarithmic scale, with dotted lines at the limits of the
    verdicts; to the right the weight of each parameter, upward if it rises along the direction, downward if it falls.

    Args:
        fit: what `armonic.update` returned.
    """
    from armonic.updating.directions import directions

    found = directions(fit)
    if len(found) > STIFFEST + SLOPPIEST:
        found = (*found[:STIFFEST], *found[-SLOPPIEST:])
    order = _by_quantity(fit.coordinates)
    names = [parameter_name(fit.coordinates[i].path) for i in order]
    count, rows = len(names), len(found)
    room = 18 + round(6.4 * max(len(_shortened(name)) for name in names))
    figure = go.Figure(layout={"template": TEMPLATE, "hovermode": "closest", "showlegend": False, "bargap": 0.3})
    figure.update_layout(height=28 * rows + room + 66, margin={"l": 84, "r": 8, "t": 30, "b": max(room, 46)})
    shares = [_share(direction) for direction in found]
    low, high = min([*shares, 0.05]) / 2, max([*shares, 2.5]) * 2
    limits = [rows - 0.4, -0.6]
    figure.update_layout(
        xaxis={
            "type": "log",
            "domain": [0, 0.27],
            "range": [math.log10(low), math.log10(high)],
            "tickvals": list(TICKS),
            "ticktext": list(TICKS.values()),
            "tickangle": -90,
            "title": {"text": "Half a 95 % interval along it"},
        },
        xaxis2={
            "domain": [0.29, 1],
            "anchor": "y2",
            "range": [-0.7, count - 0.3],
            "tickvals": list(range(count)),
            "ticktext": [html.escape(_shortened(name)) for name in names],
            "tickangle": -90,
            "tickfont": {"color": INK},
            "ticks": "",
            "showgrid": False,
        },
        yaxis=_rows(rows) | {"range": limits, "ticktext": [_spread(d) for d in found], "tickfont": {"color": INK}},
        yaxis2=_rows(rows) | {"range": limits, "anchor": "x2", "matches": "y", "showticklabels": False},
    )
    for x in LIMITS:
        ends = {"x0": x, "x1": x, "y0": -0.6, "y1": rows - 0.4, "xref": "x", "yref": "y"}
        figure.add_shape(type="line", layer="below", line={"color": "#b9c0c7", "width": 1, "dash": "dot"}, **ends)
    for x, text in ((0.0, "Direction, from stiff to sloppy"), (0.29, "Made of: ▲ rises, ▼ falls along it")):
        place = {"x": x, "y": 1, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom", "yshift": 4}
        figure.add_annotation(text=text, showarrow=False, font={"size": 12, "color": MUTED}, **place)
    _lollipops(figure, found, shares, low, high)
    weights = np.array([direction.weights[order] for direction in found])
    weights[np.abs(weights) < LEAST] = 0.0
    told = [[html.escape(direction.words), html.escape(name)] for direction in found for name in names]
    figure.add_bar(
        x=np.tile(np.arange(count), rows),
        base=np.repeat(np.arange(rows), count),
        width=min(0.7, 0.06 * count),
        y=-0.46 * weights.ravel(),
        xaxis="x2",
        yaxis="y2",
        marker={"color": np.where(weights.ravel() > 0, AFTER, BEFORE).tolist(), "line": {"width": 0}},
        customdata=[[*pair, weight] for pair, weight in zip(told, weights.ravel().tolist(), strict=True)],
        hovertemplate="%{customdata[1]}: %{customdata[2]:.2f}<br>%{customdata[0]}<extra></extra>",
    )
    return figure


def _lollipops(figure: go.Figure, found: Sequence[Direction], shares: Sequence[float], low: float, high: float) -> None:
    """One dot per direction in the colour of the verdict that a parameter so known would have."""
    edge = (high / low) ** 0.97 * low
    colours = [VERDICT_COLOURS[_verdict(share)] for share in shares]
    beyond = [share >= FARTHEST for share in shares]
    at = [edge if far else share for share, far in zip(shares, beyond, strict=True)]
    xs = [x for end in at for x in (low, end, math.nan)]
    ys = [y for row in range(len(found)) for y in (row, row, math.nan)]
    common = {"xaxis": "x", "yaxis": "y", "hoverinfo": "skip"}
    figure.add_scatter(x=xs, y=ys, mode="lines", line={"color": "#dfe3e7", "width": 5}, **common)
    symbols = ["triangle-right" if far else "circle" for far in beyond]
    figure.add_scatter(
        x=at,
        y=list(range(len(found))),
        mode="markers",
        marker={"size": 9, "color": colours, "symbol": symbols},
        customdata=[html.escape(direction.words) for direction in found],
        hovertemplate="%{customdata}<extra></extra>",
        **{"xaxis": "x", "yaxis": "y"},
    )


def _rows(count: int) -> dict[str, Any]:
    return {"tickvals": list(range(count)), "ticks": "", "gridcolor": GRID}


def _share(direction: Direction) -> float:
    """Half a 95 % interval as a share, no more than the farthest."""
    reach = NORMAL_95 * direction.deviation
    return float(np.expm1(reach)) if reach < math.log1p(FARTHEST) else FARTHEST


def _spread(direction: Direction) -> str:
    reach = NORMAL_95 * direction.deviation
    return format_spread(math.exp(-reach), math.exp(reach)) if reach < math.log(OPEN_FACTOR) else "open"


def _verdict(share: float) -> Any:
    return "identified" if share <= LIMITS[0] else "weak" if share <= LIMITS[1] else "not identifiable"


def _by_quantity(parameters: Sequence[Parameter]) -> list[int]:
    """Places of the parameters, those of one quantity together, each kind in the order of the file."""
    quantities = [split_path(p.path)[1] for p in parameters]
    ranks = list(dict.fromkeys(quantities))
    return sorted(range(len(parameters)), key=lambda i: ranks.index(quantities[i]))


def _shortened(name: str) -> str:
    return name if len(name) <= 30 else f"{name[:29]}…"


def add_bands(figure: go.Figure, bands: FrfBands, *, beside: str = "after") -> go.Figure:
    """Lay the 95 % bands of magnitude and phase under the responses that `frf_matrix` drew.

    Args:
        figure: from `frf_matrix`, of responses with the same axes; it is changed.
        bands: from `armonic.frf_bands`, on the same lines as the response they belong to.
        beside: the name of that response, on whose branch the phase is drawn.

    Returns:
        The figure.
    """
    before = len(figure.data)
    phases = {trace.yaxis: trace for trace in figure.data if trace.name == beside}
    f, inputs = bands.frf.freq_hz, len(bands.frf.inputs)
    style = {
        "name": BAND_NAME,
        "legendgroup": BAND_NAME,
        "legendrank": 1999,
        "mode": "lines",
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": BAND,
        "hoverinfo": "skip",
    }
    for i in range(len(bands.frf.outputs)):
        for j in range(inputs):
            pane = 2 * (i * inputs + j) + 1
            upper, lower = str(pane) if pane > 1 else "", str(pane + 1)
            x, y = _outline(f, bands.low[:, i, j], bands.high[:, i, j])
            figure.add_scatter(x=x, y=y, xaxis=f"x{upper}", yaxis=f"y{upper}", showlegend=upper == "", **style)
            if f"y{lower}" in phases:
                x, y = _around(phases[f"y{lower}"], np.degrees(bands.phase_deviation[:, i, j]))
                figure.add_scatter(x=x, y=y, xaxis=f"x{lower}", yaxis=f"y{lower}", showlegend=False, **style)
    figure.data = (*figure.data[before:], *figure.data[:before])
    return figure


def _outline(x: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Once around a band; what lies off all scales stays finite."""
    y = np.concatenate([low, high[::-1]])
    return np.concatenate([x, x[::-1]]), np.clip(y, 1e-30, 1e30)


def _around(trace: Any, deviation: Array) -> tuple[Array, Array]:
    """Once around each unbroken piece of a phase, with a gap between pieces."""
    x, y = np.asarray(trace.x, float), np.asarray(trace.y, float)
    half, gap = np.full(x.shape, np.nan), np.full(1, np.nan)
    half[np.isfinite(x)] = np.minimum(deviation, 180.0)
    xs: list[Array] = []
    ys: list[Array] = []
    for piece in np.split(np.arange(len(x)), np.flatnonzero(~np.isfinite(x))):
        whole = piece[np.isfinite(x[piece])]
        if len(whole):
            outline = _phases(x[whole], y[whole] - half[whole], y[whole] + half[whole])
            xs += [outline[0], gap]
            ys += [outline[1], gap]
    return np.concatenate([*xs[:-1], gap[:0]]), np.concatenate([*ys[:-1], gap[:0]])


def _phases(x: Array, low: Array, high: Array) -> tuple[Array, Array]:
    return np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]])


def profile_curve(profile: Profile) -> go.Figure:
    """Draw a profile likelihood: how −2 ln of the likelihood rises as one parameter is moved, and its 95 % interval.

    Args:
        profile: from `armonic.profile`.
    """
    values = np.asarray(profile.values)
    positive = bool((values > 0).all())
    name = html.escape(parameter_name(profile.path) + (f", {profile.unit}" if profile.unit else ""))
    figure = go.Figure(layout={"template": TEMPLATE, "height": 300, "showlegend": False, "hovermode": "x"})
    top = max(1.6 * profile.threshold, 1.0)
    logarithmic = positive and values.max() > 3 * values.min()
    ends = [float(values.min()), float(values.max())]
    limits = [math.log10(end) for end in ends] if logarithmic else ends
    pad = 0.03 * (limits[1] - limits[0]) or 0.5
    figure.update_layout(
        margin={"l": 70, "r": 8, "t": 28, "b": 46},
        xaxis={
            "title": {"text": name},
            "tickformat": ".5~g",
            "type": "log" if logarithmic else "linear",
            "range": [limits[0] - pad, limits[1] + pad],
        },
        yaxis={"title": {"text": "Rise of −2 ln L"}, "range": [-0.05 * top, top]},
    )
    low, high = (min(max(end, ends[0]), ends[1]) for end in profile.interval)
    figure.add_shape(
        type="rect", layer="below", x0=low, x1=high, y0=0, y1=1, yref="paper", fillcolor="#eef3f7", line={"width": 0}
    )
    figure.add_hline(y=profile.threshold, line={"color": MUTED, "width": 1, "dash": "dash"})
    figure.add_annotation(
        x=1,
        xref="paper",
        xanchor="right",
        y=profile.threshold,
        yanchor="bottom",
        text="95 %",
        showarrow=False,
        font={"size": 11, "color": MUTED},
    )
    figure.add_scatter(
        x=values,
        y=profile.rise,
        mode="lines+markers",
        line={"color": AFTER, "width": 1.8},
        marker={"size": 5.5},
        customdata=[format_si(float(value)) for value in values],
        hovertemplate="%{customdata}: %{y:.3g}<extra></extra>",
    )
    return figure
