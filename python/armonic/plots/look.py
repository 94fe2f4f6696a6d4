"""The look of every figure: palette, type, and what axes have in common; stated once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from armonic.text import VERDICTS, format_si

if TYPE_CHECKING:
    from numpy.typing import NDArray

INK, MUTED, GRID = "#1a1e23", "#5c6670", "#e7eaed"
BEFORE, AFTER = "#0072b2", "#e4572e"
VERDICT_COLOURS = dict(zip(VERDICTS, ("#00805e", "#c98a00", "#6b747d", "#a2478a"), strict=True))
"""Told apart with the common colour deficiencies; each verdict has its own marker as well."""
VERDICT_MARKERS = dict(zip(VERDICTS, ("circle", "diamond", "x", "square"), strict=True))

FONT_STACK = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', 'Liberation Sans', Arial, sans-serif"

_AXIS = {
    "showline": True,
    "linecolor": "#aab2ba",
    "linewidth": 1,
    "mirror": True,
    "gridcolor": GRID,
    "gridwidth": 1,
    "zeroline": False,
    "ticks": "outside",
    "ticklen": 4,
    "tickcolor": "#aab2ba",
    "tickfont": {"size": 11, "color": MUTED},
    "title": {"font": {"size": 12, "color": INK}, "standoff": 8},
    "automargin": False,
}
TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": FONT_STACK, "size": 12, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "legend": {
            "orientation": "h",
            "x": 0,
            "xanchor": "left",
            "yref": "container",
            "y": 1,
            "yanchor": "top",
            "font": {"size": 12},
        },
        "hoverlabel": {"font": {"family": FONT_STACK, "size": 12}, "bgcolor": "white"},
        "title": {"font": {"size": 13}, "x": 0, "xref": "paper", "xanchor": "left"},
        "modebar": {"bgcolor": "rgba(0,0,0,0)", "color": "#c3c9cf", "activecolor": MUTED},
        "dragmode": "zoom",
    }
)
"""The look of every figure: white, thin grid, quiet type."""


DECADES = 6
"""What lies further than this below the largest value is out of view until one zooms out."""


def log_axis(values: NDArray[np.float64], *, least: float = 0.0) -> dict[str, Any]:
    """Type, range and ticks of a logarithmic axis for these values; those not above zero are left out.

    Args:
        values: what the axis should show, any shape.
        least: decades that the axis spans at least.

    """
    shown = np.log10(values[(values > 0) & np.isfinite(values)])
    high = float(shown.max()) if shown.size else 0.5
    low = max(float(shown.min()), high - DECADES) if shown.size else -0.5
    margin = max(0.06 * (high - low) + 0.05, 0.5 * (least - high + low))
    low, high = low - margin, high + margin
    axis = {"type": "log", "range": [low, high]}
    if high - low < 1.3:
        ticks = [figure * 10.0**n for n in range(math.floor(low), math.ceil(high) + 1) for figure in (1, 2, 5)]
        return axis | {"tickvals": ticks, "ticktext": [format_si(tick, digits=1) for tick in ticks]}
    # Powers of ten are drawn a quarter larger than the size given.
    power = {"exponentformat": "power", "tickfont": {"size": 9, "color": MUTED}}
    return axis | power | {"dtick": max(1, math.ceil((high - low) / 5))}


_MODE_COLOURS = (
    "#0072b2", "#e4572e", "#00805e", "#c98a00", "#a2478a", "#2f9fbd",
    "#8a5a3c", "#3d4a8f", "#d1628f", "#76941c", "#5c6670", "#a8302b",
)  # fmt: skip


def mode_colour(number: int) -> str:
    """The colour of a tracked mode by its number from 1, or of a coordinate; twelve, then the first again."""
    return _MODE_COLOURS[(number - 1) % len(_MODE_COLOURS)]


EVENT_MARKERS = {
    1: {"symbol": "x-thin", "size": 8, "line": {"width": 1.6, "color": INK}},
    2: {"symbol": "diamond-open", "size": 9, "color": INK, "line": {"width": 1.4}},
}
"""How a crossing (1) and a veering (2) of modes are marked."""
