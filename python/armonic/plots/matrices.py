"""Figures of matrices: frequency responses over each other, and modal assurance criteria."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

from armonic.errors import FrfError
from armonic.plots.look import AFTER, BEFORE, MUTED, TEMPLATE, log_axis
from armonic.text import frf_unit

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.response import Frf

_LINES: dict[str, dict[str, Any]] = {
    "measured": {"line": {"color": "#000000", "width": 1}, "zorder": 3},
    "before": {"line": {"color": BEFORE, "width": 1.4, "dash": "dot"}, "zorder": 1},
    "after": {"line": {"color": AFTER, "width": 2.2}, "zorder": 2},
}
_OTHER_COLOURS = ("#00805e", "#c98a00", "#a2478a", "#56a5d8")

PHASE_LIMIT_DEG = 225.0
"""Phases are drawn up to here on both sides, so that noise around ±180° does not tear a curve apart."""


def frf_matrix(frfs: Mapping[str, Frf], *, cell_height: int | None = None) -> go.Figure:
    """Draw responses over each other: a grid of outputs by inputs, magnitude above phase in each cell.

    Args:
        frfs: responses by their label in the legend, all of one kind and with the same axes. "measured", "before"
            and "after" have their own lines. Phases of the later ones are drawn within half a turn of the first.
        cell_height: pixels per row of the matrix; by default 270, or 400 if there is only one.

    Raises:
        FrfError: there is no response, or they differ in kind or axes.
    """
    first = _common(frfs)
    rows, columns = len(first.outputs), len(first.inputs)
    height, gap, top, bottom = cell_height or (400 if rows == 1 else 270), 34, 56, 46
    total = rows * height - gap
    figure = go.Figure(layout={"template": TEMPLATE, "height": total + top + bottom, "hovermode": "x unified"})
    figure.update_layout(margin={"l": 70, "r": 8, "t": top, "b": bottom})
    width, between = 1 / (columns + 0.05 * (columns - 1)), 0.05
    for i, output in enumerate(first.outputs):
        upper = 1 - i * height / total
        split = upper - 0.6 * (height - gap) / total
        lower = upper - (height - gap) / total
        scale = log_axis(np.concatenate([frf.magnitude[:, i].ravel() for frf in frfs.values()]))
        for j, force in enumerate(first.inputs):
            k = i * columns + j
            x, magnitude, phase = (f"{a}{n}" for a, n in (("x", k + 1), ("y", 2 * k + 1), ("y", 2 * k + 2)))
            left = j * width * (1 + between)
            figure.layout[_axis(x)] = {
                "domain": [left, left + width],
                "anchor": phase,
                "matches": None if k == 0 else "x",
                "range": _frequency_limits(frfs),
                "nticks": 8,
                "showticklabels": i == rows - 1,
                "title": {"text": "Frequency (Hz)" if i == rows - 1 else None},
            }
            figure.layout[_axis(magnitude)] = {
                "domain": [split + 5 / total, upper],
                "anchor": x,
                **scale,
                "matches": None if j == 0 else f"y{2 * i * columns + 1}",
                "showticklabels": j == 0,
                "title": {"text": f"|H|, {frf_unit(first.kind, output, force)}" if j == 0 else None},
            }
            figure.layout[_axis(phase)] = {
                "domain": [lower, split - 5 / total],
                "anchor": x,
                "matches": None if k == 0 else "y2",
                "range": [-PHASE_LIMIT_DEG, PHASE_LIMIT_DEG],
                "tickvals": [-180, -90, 0, 90, 180],
                "ticktext": ["−180", "", "0", "", "180"],
                "showticklabels": j == 0,
                "title": {"text": "Phase, °" if j == 0 else None},
            }
            figure.add_annotation(
                text=f"{_direction('response', output)}, {_direction('force', force)}",
                x=left,
                y=upper,
                xref="paper",
                yref="paper",
                xanchor="left",
                yanchor="bottom",
                showarrow=False,
                font={"size": 11, "color": MUTED},
            )
            _draw_cell(figure, frfs, i, j, axes=(x, magnitude, phase), legend=k == 0)
    return figure


def _common(frfs: Mapping[str, Frf]) -> Frf:
    if not frfs:
        raise FrfError("frfs", found="no response", expected="at least one")
    first = next(iter(frfs.values()))
    for label, frf in frfs.items():
        if (frf.kind, frf.outputs, frf.inputs) != (first.kind, first.outputs, first.inputs):
            raise FrfError(f"frfs[{label!r}]", found=repr(frf), expected=f"kind and axes of the first: {first!r}")
    return first


def _draw_cell(
    figure: go.Figure, frfs: Mapping[str, Frf], i: int, j: int, *, axes: tuple[str, str, str], legend: bool
) -> None:
    reference: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    spare = iter(_OTHER_COLOURS * (1 + len(frfs) // len(_OTHER_COLOURS)))
    for label, frf in frfs.items():
        style = _LINES.get(label) or {"line": {"color": next(spare), "width": 1.4}}
        same = reference is not None and np.array_equal(reference[0], frf.freq_hz)
        phase = _phase_deg(frf.values[:, i, j], reference[1] if reference is not None and same else None)
        if reference is None:
            reference = frf.freq_hz, phase
        name = html.escape(label)
        torn = 1 + np.flatnonzero(np.abs(np.diff(phase)) > 180)
        for x, y, yaxis, number, unit in (
            (frf.freq_hz, frf.magnitude[:, i, j], axes[1], "%{y:.3e} ", frf_unit(frf.kind, frf.outputs[i], frf.inputs[j])),
            (np.insert(frf.freq_hz, torn, np.nan), np.insert(phase, torn, np.nan), axes[2], "%{y:.1f}", "°"),
        ):
            figure.add_scatter(
                x=x,
                y=y,
                name=name,
                legendgroup=name,
                showlegend=legend and yaxis == axes[1],
                mode="lines+markers" if len(frf.freq_hz) == 1 else "lines",
                xaxis=axes[0],
                yaxis=yaxis,
                hovertemplate=f"{number}{unit}",
                **style,
            )


def _phase_deg(values: NDArray[np.complex128], near: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Phase on the branch that stays near another curve, or else that leaves the drawn range least often."""
    wrapped = np.degrees(np.angle(values))
    if near is not None:
        phase = near + (wrapped - near + 180) % 360 - 180
        return np.where(np.abs(phase) > PHASE_LIMIT_DEG, wrapped, phase)
    starts = [wrapped[0] + turn for turn in (0, -360, 360) if abs(wrapped[0] + turn) <= PHASE_LIMIT_DEG]
    curves = [_followed(wrapped, start) for start in starts]
    return min(curves, key=lambda curve: np.count_nonzero(np.abs(np.diff(curve)) > 180))


def _followed(wrapped: NDArray[np.float64], start: float) -> NDArray[np.float64]:
    phase, last = np.empty_like(wrapped), start
    for line, angle in enumerate(wrapped):
        near = angle + 360 * round((last - angle) / 360)
        last = near if abs(near) <= PHASE_LIMIT_DEG else float(angle)
        phase[line] = last
    return phase


def _axis(name: str) -> str:
    return f"{name[0]}axis{name[1:]}"


def _direction(role: str, axis: str) -> str:
    if axis.startswith("r"):
        role = {"response": "rotation", "force": "moment"}[role]
    return f"{role} {html.escape(axis)}"


def _frequency_limits(frfs: Mapping[str, Frf]) -> list[float]:
    low = min(float(frf.freq_hz[0]) for frf in frfs.values())
    high = max(float(frf.freq_hz[-1]) for frf in frfs.values())
    return [low, high] if high > low else [low - 0.5, high + 0.5]


def mac_matrix(
    values: ArrayLike, rows: Sequence[str], columns: Sequence[str], *, row_title: str = "", column_title: str = ""
) -> go.Figure:
    """Draw a matrix of modal assurance criteria with its numbers, coloured from 0 to 1.

    Args:
        values: (len(rows), len(columns)), between 0 and 1, as from `armonic.mac`.
        rows: a label for each row, such as "11.1 Hz"; labels may repeat.
        columns: a label for each column.
        row_title: what the rows are.
        column_title: what the columns are.

    Raises:
        FrfError: the labels do not fit the matrix.
    """
    mac = np.asarray(values, float)
    if mac.shape != (len(rows), len(columns)):
        raise FrfError("mac", found=f"shape {mac.shape}", expected=f"{len(rows)} rows and {len(columns)} columns")
    largest = max(1, *mac.shape)
    cell = min(64.0, 400 / largest)
    written = cell >= 24
    figure = go.Figure(layout={"template": TEMPLATE})
    figure.update_layout(
        height=round(cell * len(rows)) + 108,
        width=round(cell * len(columns)) + 116,
        margin={"l": 88, "r": 28, "t": 20, "b": 88},
        hovermode="closest",
    )
    axis = {"showgrid": False, "ticks": "", "mirror": True, "constrain": "domain", "tickfont": {"size": 10.5 if written else 9}}
    figure.update_xaxes(
        **axis,
        tickvals=list(range(len(columns))),
        ticktext=[html.escape(label) for label in columns],
        title={"text": html.escape(column_title)},
        tickangle=-90,
        range=[-0.5, len(columns) - 0.5],
    )
    figure.update_yaxes(
        **axis,
        tickvals=list(range(len(rows))),
        ticktext=[html.escape(label) for label in rows],
        title={"text": html.escape(row_title)},
        range=[len(rows) - 0.5, -0.5],
        scaleanchor="x",
    )
    figure.add_heatmap(
        z=mac,
        zmin=0,
        zmax=1,
        colorscale=[[0, "#ffffff"], [0.25, "#cfe1f0"], [0.5, "#7fb2d6"], [0.75, "#2f7fb8"], [1, "#0b4a80"]],
        xgap=1,
        ygap=1,
        showscale=False,
        text=[[f"{value:.2f}" if value >= 0.005 else "0" for value in row] for row in mac],
        customdata=[[f"{html.escape(row)}, {html.escape(column)}" for column in columns] for row in rows],
        texttemplate="%{text}" if written else None,
        textfont={"size": min(12.0, 0.3 * cell)},
        hovertemplate="%{customdata}<br>MAC %{z:.4f}<extra></extra>",
    )
    return figure
