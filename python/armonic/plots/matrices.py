"""Figures of matrices: frequency responses over each other, and modal assurance criteria."""

from __future__ import annotations

import html
from itertools import cycle
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import plotly.graph_objects as go

from armonic.errors import FrfError
from armonic.plots.look import AFTER, BEFORE, MUTED, TEMPLATE, log_axis
from armonic.text import frf_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.response import Frf

    Array: TypeAlias = NDArray[np.float64]

_LINES: dict[str, dict[str, Any]] = {
    "before": {"line": {"color": BEFORE, "width": 1.4, "dash": "dot"}},
    "synthesized": {"line": {"color": BEFORE, "width": 1.8, "dash": "dot"}},
    "after": {"line": {"color": AFTER, "width": 3.2}},
    "measured": {"line": {"color": "#000000", "width": 0.9}},
}
"""In the order of drawing: the measurement lies thin on top of the model that should meet it."""
_OTHER_COLOURS = ("#00805e", "#c98a00", "#a2478a", "#56a5d8")

PHASE_LIMIT_DEG = 225.0
"""Phases are drawn up to here on both sides, so that noise around ±180° does not tear a curve apart."""
BESIDE_DEG = 60.0
"""Two curves closer than this are drawn on one branch."""


def frf_matrix(frfs: Mapping[str, Frf], *, cell_height: int | None = None) -> go.Figure:
    """Draw responses over each other: a grid of outputs by inputs, magnitude above phase in each cell.

    Args:
        frfs: responses by their label in the legend, all of one kind and with the same axes. "measured",
            "synthesized", "before" and "after" have their own lines. A phase near that of the first is drawn on its
            branch.
        cell_height: pixels per row of the matrix; by default 270, or 400 if there is only one.

    Raises:
        FrfError: there is no response, or they differ in kind or axes.

    """
    first = _common(frfs)
    rows, columns = len(first.outputs), len(first.inputs)
    height = cell_height or (400 if rows == 1 else 270)
    styles = _styles(list(frfs))
    figure = go.Figure(layout={"template": TEMPLATE, "height": rows * height + 68, "hovermode": "x unified"})
    figure.update_layout(margin={"l": 70, "r": 8, "t": 56, "b": 46})
    for i, output in enumerate(first.outputs):
        scale = log_axis(np.concatenate([frf.magnitude[:, i].ravel() for frf in frfs.values()]))
        for j, force in enumerate(first.inputs):
            cell = _Cell(figure, i, j, rows=rows, columns=columns, height=height)
            unit = frf_unit(first.kind, output, force)
            shared = unit == frf_unit(first.kind, output, first.inputs[0])
            label = f"{_direction('response', output)}, {_direction('force', force)}"
            cell.lay_out(_frequency_limits(frfs), scale, unit, label if shared else f"{label}: {unit}")
            guide = first.freq_hz, _phase_deg(first.freq_hz, first.values[:, i, j], None)
            for name, style in styles.items():
                frf = frfs[name]
                phase = guide[1] if frf is first else _phase_deg(frf.freq_hz, frf.values[:, i, j], guide)
                cell.draw(html.escape(name), frf.freq_hz, frf.magnitude[:, i, j], phase, unit, style)
    return figure


def _common(frfs: Mapping[str, Frf]) -> Frf:
    if not frfs:
        raise FrfError("frfs", found="no response", expected="at least one")
    first = next(iter(frfs.values()))
    for label, frf in frfs.items():
        if (frf.kind, frf.outputs, frf.inputs) != (first.kind, first.outputs, first.inputs):
            raise FrfError(f"frfs[{label!r}]", found=repr(frf), expected=f"kind and axes of the first: {first!r}")
    return first


def _styles(names: list[str]) -> dict[str, dict[str, Any]]:
    """Line and place in the legend by name, in the order of drawing."""
    spare = cycle(_OTHER_COLOURS)
    others = {name: {"line": {"color": next(spare), "width": 1.4}} for name in names if name not in _LINES}
    drawn = others | {name: line for name, line in _LINES.items() if name in names}
    return {name: line | {"legendrank": 1000 + names.index(name)} for name, line in drawn.items()}


class _Cell:
    """One response of the matrix: a pane for the magnitude above one for the phase, each with two axes."""

    def __init__(self, figure: go.Figure, i: int, j: int, *, rows: int, columns: int, height: int) -> None:
        self.figure, self.row, self.column, self.rows, self.columns = figure, i, j, rows, columns
        self.upper, self.lower = (str(2 * (i * columns + j) + n) for n in (1, 2))
        gap, total = 34, rows * height - 34
        width = 1 / (columns + 0.05 * (columns - 1))
        self.left, self.right = j * 1.05 * width, min(1.0, j * 1.05 * width + width)
        self.top, self.bottom = 1 - i * height / total, max(0.0, 1 - (i * height + height - gap) / total)
        self.split, self.half_gap = self.bottom + 0.4 * (self.top - self.bottom), 5 / total

    def lay_out(self, limits: list[float], scale: dict[str, Any], unit: str, label: str) -> None:
        """Axes: all share the frequency, phases share their range, and magnitudes do so along a row."""
        leftmost, lowest, layout = self.column == 0, self.row == self.rows - 1, self.figure.layout
        frequency = {
            "domain": [self.left, self.right],
            "matches": None if leftmost and self.row == 0 else "x",
            "range": limits,
            "nticks": 8,
        }
        upper, lower = (n if n != "1" else "" for n in (self.upper, self.lower))
        layout[f"xaxis{upper}"] = frequency | {"anchor": f"y{upper}", "showticklabels": False, "ticks": ""}
        if upper == "":
            layout["xaxis"].matches = None
        layout[f"xaxis{lower}"] = frequency | {
            "matches": "x",
            "anchor": f"y{lower}",
            "showticklabels": lowest,
            "title": {"text": "Frequency (Hz)" if lowest else None},
        }
        layout[f"yaxis{upper}"] = scale | {
            "domain": [self.split + self.half_gap, self.top],
            "anchor": f"x{upper}",
            "matches": None if leftmost else f"y{self._first_of_row()}",
            "showticklabels": leftmost,
            "ticks": "outside" if leftmost else "",
            "title": {"text": f"|H|, {unit}" if leftmost else None},
        }
        layout[f"yaxis{lower}"] = {
            "domain": [self.bottom, self.split - self.half_gap],
            "anchor": f"x{lower}",
            "matches": None if lower == "2" else "y2",
            "range": [-PHASE_LIMIT_DEG, PHASE_LIMIT_DEG],
            "tickvals": [-180, -90, 0, 90, 180],
            "ticktext": ["−180", "", "0", "", "180"],
            "showticklabels": leftmost,
            "ticks": "outside" if leftmost else "",
            "title": {"text": "Phase, °" if leftmost else None},
        }
        place = {
            "x": self.left,
            "y": self.top,
            "xref": "paper",
            "yref": "paper",
            "xanchor": "left",
            "yanchor": "bottom",
        }
        self.figure.add_annotation(text=label, showarrow=False, font={"size": 11, "color": MUTED}, **place)

    def _first_of_row(self) -> str:
        return "" if self.row == 0 else str(2 * self.row * self.columns + 1)

    def draw(self, name: str, freq_hz: Array, magnitude: Array, phase: Array, unit: str, style: dict[str, Any]) -> None:
        """One response; the phase is torn where it leaves the pane and comes back on the other side."""
        torn = 1 + np.flatnonzero(np.abs(np.diff(phase)) > 180)
        torn_freq_hz, torn_phase = np.insert(freq_hz, torn, np.nan), np.insert(phase, torn, np.nan)
        common = style | {
            "name": name,
            "legendgroup": name,
            "mode": "lines" if freq_hz.size > 1 else "markers",
        }
        named = self.upper == "1"
        self._scatter(self.upper, common, freq_hz, magnitude, hovertemplate=f"%{{y:.3e}} {unit}", showlegend=named)
        self._scatter(self.lower, common, torn_freq_hz, torn_phase, hovertemplate="%{y:.1f}°", showlegend=False)

    def _scatter(self, pane: str, common: dict[str, Any], x: Array, y: Array, **more: Any) -> None:
        number = pane if pane != "1" else ""
        self.figure.add_scatter(x=x, y=y, xaxis=f"x{number}", yaxis=f"y{number}", **common, **more)


def _phase_deg(freq_hz: Array, values: NDArray[np.complex128], near: tuple[Array, Array] | None) -> Array:
    """Phase followed along the lines with the fewest jumps, on the branch of another curve if near it."""
    wrapped = np.degrees(np.angle(values))
    guide = near[1] if near is not None and np.array_equal(near[0], freq_hz) else np.full(freq_hz.shape, np.nan)
    starts = [wrapped[0] + turn for turn in (0, -360, 360) if abs(wrapped[0] + turn) <= PHASE_LIMIT_DEG]
    curves = [_followed(wrapped, start, guide) for start in starts]
    return min(curves, key=lambda curve: np.count_nonzero(np.abs(np.diff(curve)) > 180))


def _followed(wrapped: Array, start: float, guide: Array) -> Array:
    phase, last = np.empty_like(wrapped), start
    apart = (wrapped - guide + 180) % 360 - 180
    beside = (np.abs(apart) < BESIDE_DEG) & (np.abs(guide + apart) <= PHASE_LIMIT_DEG)
    for line, angle in enumerate(wrapped):
        if beside[line]:
            last = float(guide[line] + apart[line])
        else:
            on = float(angle + 360 * round((last - angle) / 360))
            last = on if abs(on) <= PHASE_LIMIT_DEG else float(angle)
        phase[line] = last
    return phase


def _direction(role: str, axis: str) -> str:
    if axis.startswith("r"):
        role = {"response": "rotation", "force": "moment"}[role]
    return f"{role} {html.escape(axis)}"


def _frequency_limits(frfs: Mapping[str, Frf]) -> list[float]:
    low = min(float(frf.freq_hz[0]) for frf in frfs.values())
    high = max(float(frf.freq_hz[-1]) for frf in frfs.values())
    return [low, high] if high > low else [low - 0.5, high + 0.5]


def mac_matrix(
    values: ArrayLike,
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    row_title: str = "",
    column_title: str = "",
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
        height=round(cell * len(rows)) + 118,
        width=round(cell * len(columns)) + 116,
        margin={"l": 88, "r": 28, "t": 30, "b": 88},
        hovermode="closest",
    )
    axis = {
        "showgrid": False,
        "ticks": "",
        "mirror": True,
        "constrain": "domain",
        "tickfont": {"size": 10.5 if written else 9},
    }
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
