"""Figures of mode shapes: complex shapes as arrows in small polar plots."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from armonic.errors import SurveyError
from armonic.plots.look import GRID, INK, MUTED, TEMPLATE, mode_colour
from armonic.text import format_hz, format_percent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.modal import Modes

DECADES = 3
"""From the rim, where the largest entry of a shape ends, to the centre."""

_COLUMNS, _ROW, _ABOVE, _BELOW = 4, 240, 38, 16
_MOTOR = ".motor"


def mode_shapes(
    modes: Modes, *, select: Sequence[int] | None = None, numbers: Sequence[int] | None = None
) -> go.Figure:
    """Draw complex mode shapes as arrows (Do et al. 2022, Fig. 6): one polar plot per mode, one arrow per coordinate.

    An arrow's angle is the phase of the coordinate; its length is the logarithm of its magnitude relative to the
    largest of the mode, three decades from centre to rim. Coordinates of links (rad or m) are solid, those of motors
    (rad after the gear) dotted, in the colour of the coordinate they drive.

    Args:
        modes: what `armonic.modes` returned.
        select: which modes to draw, counted from 1 in order of frequency; by default all, by their `numbers`.
        numbers: what to call the modes, such as their numbers in a survey that tracked them; by default 1 to m.

    Raises:
        SurveyError: `select` names no mode, or one that is not there; `numbers` are not one for each mode.
    """
    if numbers is not None and len(numbers) != len(modes):
        raise SurveyError("numbers", found=f"{len(numbers)}", expected=f"one for each of {len(modes)} modes")
    names = list(range(1, len(modes) + 1)) if numbers is None else [int(number) for number in numbers]
    chosen = sorted(range(1, len(modes) + 1), key=lambda k: names[k - 1]) if select is None else list(select)
    missing = [number for number in chosen if not 1 <= number <= len(modes)]
    if missing or not chosen:
        found = f"mode {missing[0]}" if missing else "no mode"
        raise SurveyError("select", found=found, expected=f"mode numbers from 1 to {len(modes)}")
    columns = min(_COLUMNS, len(chosen))
    rows = math.ceil(len(chosen) / columns)
    keys, colours = _legend(modes.coordinates)
    top = 34 + 20 * math.ceil(len(keys) / 8)
    figure = go.Figure(layout={"template": TEMPLATE, "height": rows * _ROW + top, "hovermode": "closest"})
    figure.update_layout(margin={"l": 8, "r": 8, "t": top, "b": 0}, legend={"traceorder": "normal"})
    for name, style in keys.items():
        figure.add_scatterpolar(
            r=[None], theta=[None], name=name, legendgroup=name, mode="lines", hoverinfo="skip", **style
        )
    for k, number in enumerate(chosen):
        row, column = divmod(k, columns)
        polar = f"polar{k + 1}" if k else "polar"
        domain = {
            "x": [column / columns, (column + 1) / columns],
            "y": [1 - (row + 1 - _BELOW / _ROW) / rows, 1 - (row + _ABOVE / _ROW) / rows],
        }
        figure.layout[polar] = _axes(domain, written=k == 0)
        _arrows(figure, modes, number - 1, polar, colours)
        figure.add_annotation(
            text=_heading(modes, number - 1, names[number - 1]),
            x=(column + 0.5) / columns,
            y=1 - row / rows,
            xref="paper",
            yref="paper",
            xanchor="center",
            yanchor="top",
            showarrow=False,
            font={"size": 11.5},
        )
    return figure


def _legend(coordinates: tuple[str, ...]) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Entries of the legend, and colours by coordinate; a motor takes that of the first coordinate of its link."""
    links = [name for name in coordinates if not name.endswith(_MOTOR)]
    colours = {name: mode_colour(k + 1) for k, name in enumerate(links)}
    keys = {html.escape(name): {"line": {"color": colour, "width": 2.2}} for name, colour in colours.items()}
    motors = [name for name in coordinates if name.endswith(_MOTOR)]
    for motor in motors:
        stem = motor.removesuffix(_MOTOR)
        driven = next((name for name in links if name.rsplit(".", 1)[0] == stem), None)
        colours[motor] = colours[driven] if driven else MUTED
    if motors:
        keys["motors"] = {"line": {"color": INK, "width": 1.6, "dash": "dot"}}
    return keys, colours


def _axes(domain: dict[str, list[float]], *, written: bool) -> dict[str, Any]:
    small = {"size": 9, "color": MUTED}
    return {
        "domain": domain,
        "bgcolor": "white",
        "radialaxis": {
            "type": "log",
            "range": [-DECADES, 0.04],
            "tickvals": [10.0**-k for k in range(DECADES)],
            "ticktext": ["1", "0.1", "0.01"],
            "showticklabels": written,
            "angle": 45,
            "tickangle": 0,
            "tickfont": small,
            "gridcolor": GRID,
            "showline": False,
            "ticks": "",
        },
        "angularaxis": {
            "tickvals": [0, 45, 90, 135, 180, 225, 270, 315],
            "ticktext": ["0°", "", "90°", "", "180°", "", "270°", ""],
            "showticklabels": written,
            "tickfont": small,
            "gridcolor": GRID,
            "linecolor": "#aab2ba",
            "ticks": "",
        },
    }


def _arrows(figure: go.Figure, modes: Modes, mode: int, polar: str, colours: dict[str, str]) -> None:
    shape = modes.shapes[:, mode]
    size = np.abs(shape) / (np.abs(shape).max() or 1.0)
    phase = np.degrees(np.angle(shape))
    for k in np.argsort(-size):  # the shortest on top
        name = modes.coordinates[k]
        motor = name.endswith(_MOTOR)
        label = html.escape(name)
        told = f"{abs(shape[k]):.4g}, %{{r:.3g}} of the largest, at %{{theta:.1f}}°"
        seen = size[k] >= 10.0**-DECADES
        figure.add_scatterpolar(
            r=[10.0**-DECADES, size[k]] if seen else [None, None],
            theta=[phase[k], phase[k]],
            subplot=polar,
            name=label,
            legendgroup=label,
            showlegend=False,
            mode="lines+markers",
            line={"color": colours[name], "width": 1.4 if motor else 2.2, "dash": "dot" if motor else "solid"},
            marker={
                "symbol": "arrow-open" if motor else "arrow",
                "angleref": "previous",
                "size": [0, 9 if motor else 10],
                "color": colours[name],
                "opacity": 1,
            },
            hovertemplate=f"{label}<br>{told}<extra></extra>",
        )


def _heading(modes: Modes, mode: int, number: int) -> str:
    frequency = format_hz(float(modes.natural_freq_hz[mode]))
    damping = format_percent(float(modes.damping_ratio[mode]))
    return f"<b>{number}</b>  {frequency} Hz, {damping if modes.oscillatory[mode] else 'real pole'}"
