"""Figure of measured responses: magnitude, phase and coherence of every pair, with others drawn over them."""

from __future__ import annotations

import html
from itertools import cycle
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.frf_set import split_label
from armonic.plots.look import AFTER, BEFORE, log_axis
from armonic.plots.panes import WIDTH, Pane, Sheet
from armonic.plots.series import thinned
from armonic.text import frf_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import plotly.graph_objects as go
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Pair: TypeAlias = tuple[str, str]

MOST_LINES = 2400
"""Of more lines a part is drawn, in which no peak is lost."""
PHASE_LIMIT_DEG = 225.0
"""Phases are drawn up to here on one side or the other, so that noise around ±180° does not tear a curve apart."""

_COLUMNS = 3
_LINES: dict[str, dict[str, Any]] = {
    "fitted": {"line": {"color": AFTER, "width": 3.2}},
    "synthesized": {"line": {"color": BEFORE, "width": 2, "dash": "dot"}},
    "measured": {"line": {"color": "#000000", "width": 0.9}},
}
"""In the order of drawing: the measurement lies thin on top (Huynh et al. 2021, Figs. 9 and 10)."""
_OTHER_COLOURS = ("#00805e", "#c98a00", "#a2478a", "#56a5d8")
_COHERENCE = "#00805e"

_LEFT, _RIGHT, _TOP, _BETWEEN, _UNDER = 64, 12, 52, 24, 46
_MAGNITUDE, _PHASE, _QUALITY, _GAP, _NAME = 132, 66, 44, 7, 26
"""Heights of the three parts of a cell, what is between them, and what is above them, in pixels."""


def frf_with_coherence(
    frfs: FrfSet,
    *,
    others: Mapping[str, FrfSet] = MappingProxyType({}),
    pairs: Sequence[Pair] | None = None,
    most: int = 12,
) -> go.Figure:
    """Draw measured responses: in a cell per pair magnitude over phase over coherence.

    The cells are the matrix of outputs by inputs where that has three columns at most and no more than `most` cells,
    else they stand in rows of three. Without a coherence its part is left out.

    Args:
        frfs: what was measured: thin and black.
        others: responses to draw along with it by their name in the legend, converted to the same kind; those named
            "synthesized" (dotted, blue) and "fitted" (thick, red) have their own lines. Pairs they lack are left out.
        pairs: (output, input) labels to draw; by default all that were measured, driving points first if not all have
            a cell.
        most: how many cells there are at most; what is left out is said.

    Raises:
        FrfError: a pair that was not measured, or no cell.
    """
    chosen, grid, total = _chosen(frfs, pairs, most)
    styles = _styles(others)
    curves = {name: frfs if name == "measured" else others[name].to(frfs.kind) for name in styles}
    columns = max(column for _, column in grid) + 1
    rows = max(row for row, _ in grid) + 1
    parts = [_MAGNITUDE, _PHASE] + ([_QUALITY] if frfs.coherence is not None else [])
    step = _NAME + sum(parts) + _GAP * (len(parts) - 1) + 8
    width = (WIDTH - _LEFT - _RIGHT - _BETWEEN * (columns - 1)) / columns
    if len(chosen) == 1:
        parts[0], step = 2 * parts[0], step + parts[0]
    sheet = Sheet(_TOP - _NAME + rows * step + _UNDER, hovermode="x unified")
    scales = _scales(chosen, grid, curves)
    limits = _limits(curves)
    first: Pane | None = None
    for (output, force), (row, column) in zip(chosen, grid, strict=True):
        lowest = (row + 1, column) not in grid
        cell = _Cell(sheet, _LEFT + column * (width + _BETWEEN), _TOP + row * step, width, parts, first)
        unit = frf_unit(frfs.kind, split_label(output)[1], split_label(force)[1])
        cell.lay_out(limits, scales[row], unit, outer=column == 0, lowest=lowest, name=_title(output, force))
        cut = _cut(_values(frfs, output, force))
        for name, style in styles.items():
            if first is None:
                rank = 1000 + (list(others).index(name) if name in others else -1)
                key = style | {"name": html.escape(name), "legendgroup": name, "mode": "lines", "legendrank": rank}
                cell.panes[0].scatter(x=[None], y=[None], **key)
            if _has(curves[name], output, force):
                cell.draw(name, curves[name], (output, force), unit, cut, style)
        first = first or cell.panes[0]
    if len(chosen) < total:
        told = f"{len(chosen)} of {total} measured responses drawn"
        sheet.write(WIDTH - _RIGHT, _TOP - _NAME, told, xanchor="right")
    return sheet.figure


def _chosen(frfs: FrfSet, pairs: Sequence[Pair] | None, most: int) -> tuple[list[Pair], list[tuple[int, int]], int]:
    """The pairs, the row and column of each, and how many there could be."""
    if most < 1:
        raise FrfError("most", found=repr(most), expected="one cell at least")
    if pairs is None:
        there = [(int(i), int(j)) for i, j in np.argwhere(frfs.measured)]
        if frfs.measured.size <= most and len(frfs.inputs) <= _COLUMNS:
            return [(frfs.outputs[i], frfs.inputs[j]) for i, j in there], there, len(there)
        found = [(frfs.outputs[i], frfs.inputs[j]) for i, j in there]
        if len(found) > most:
            found.sort(key=lambda pair: pair[0] != pair[1])  # stable: the order of the set is kept otherwise
    else:
        found = [(str(output), str(force)) for output, force in pairs]
    for output, force in found:
        if not _has(frfs, output, force):
            raise FrfError("pairs", found=f"{output} to {force}", expected=f"a measured pair of {frfs!r}")
    if not found:
        raise FrfError("pairs", found="none", expected="one pair at least")
    kept = found[:most]
    return kept, [divmod(k, _COLUMNS) for k in range(len(kept))], len(found)


def _has(frfs: FrfSet, output: str, force: str) -> bool:
    there = output in frfs.outputs and force in frfs.inputs
    return there and bool(frfs.measured[frfs.outputs.index(output), frfs.inputs.index(force)])


def _values(frfs: FrfSet, output: str, force: str) -> NDArray[np.complex128]:
    return frfs.values[:, frfs.outputs.index(output), frfs.inputs.index(force)]


def _styles(others: Mapping[str, FrfSet]) -> dict[str, dict[str, Any]]:
    """The line of each curve, in the order of drawing."""
    colours = cycle(_OTHER_COLOURS)
    spare = {name: {"line": {"color": next(colours), "width": 1.5}} for name in others if name not in _LINES}
    return spare | {name: line for name, line in _LINES.items() if name in others or name == "measured"}


def _scales(chosen: list[Pair], grid: list[tuple[int, int]], curves: Mapping[str, FrfSet]) -> dict[int, dict[str, Any]]:
    """The logarithmic axis of each row, which its cells share."""
    sizes: dict[int, list[Array]] = {}
    for (output, force), (row, _) in zip(chosen, grid, strict=True):
        for curve in curves.values():
            if _has(curve, output, force):
                sizes.setdefault(row, []).append(np.abs(_values(curve, output, force)))
    return {row: log_axis(np.concatenate(parts)) for row, parts in sizes.items()}


def _limits(curves: Mapping[str, FrfSet]) -> list[float]:
    """The frequencies that were measured, all of them."""
    f = curves["measured"].freq_hz
    return [float(f[0]), float(f[-1])] if len(f) > 1 else [float(f[0]) - 0.5, float(f[0]) + 0.5]


def _title(output: str, force: str) -> str:
    axes = [split_label(label)[1] for label in (output, force)]
    words = [name if axis.startswith("r") else plain for axis, (name, plain) in zip(axes, _WORDS, strict=True)]
    return f"{words[0]}<b>{html.escape(output)}</b>, {words[1]}<b>{html.escape(force)}</b>"


_WORDS = (("rotation ", ""), ("moment ", "force "))


class _Cell:
    """One response: a pane for the magnitude above one for the phase, above one for the coherence if it is known."""

    def __init__(
        self, sheet: Sheet, left: float, top: float, width: float, parts: list[int], first: Pane | None
    ) -> None:
        self.sheet, self.left, self.top, self.width, self.parts, self.first = sheet, left, top, width, parts, first
        self.panes: list[Pane] = []

    def lay_out(
        self, limits: list[float], scale: dict[str, Any], unit: str, *, outer: bool, lowest: bool, name: str
    ) -> None:
        """Axes: all share the frequency, and magnitudes of a row their range."""
        aligned = {"type": "linear", "ticks": "outside" if outer else "", "showticklabels": outer}
        phase = {"range": [-PHASE_LIMIT_DEG, PHASE_LIMIT_DEG], "tickvals": [-180, -90, 0, 90, 180]}
        phase["ticktext"] = ["−180", "", "0", "", "180"]
        quality = {"range": [0, 1.04], "tickvals": [0, 0.5, 1], "ticktext": ["0", "", "1"]}
        ups = [aligned | scale, aligned | phase, aligned | quality][: len(self.parts)]
        titles = [f"|H|, {unit}", "Phase, °", "γ²"]
        at = self.top
        for k, (height, up) in enumerate(zip(self.parts, ups, strict=True)):
            bottom = k == len(self.parts) - 1
            across = {"range": limits, "nticks": 8, "ticks": "outside" if bottom else ""}
            across |= {"showticklabels": bottom and lowest, "hoverformat": ".6~g"}
            across["title"] = {"text": "Frequency (Hz)" if bottom and lowest else None}
            across["matches"] = None if self.first is None and k == 0 else "x"
            title = {"title": {"text": titles[k] if outer else None}}
            self.panes.append(self.sheet.pane(self.left, at, self.width, height, x=across, y=up | title))
            at += height + _GAP
        self.sheet.write(self.left, self.top - 2, name)

    def draw(self, name: str, curve: FrfSet, pair: Pair, unit: str, cut: float, style: dict[str, Any]) -> None:
        """One curve, thinned, its phase torn where it leaves the pane and comes back on the other side."""
        values = _values(curve, *pair)
        size = np.where(np.abs(values) > 0, np.abs(values), np.nan)
        kept = thinned(np.log(size), limit=MOST_LINES)
        mode = "lines" if len(kept) > 1 else "markers"
        common = style | {"name": html.escape(name), "legendgroup": name, "showlegend": False, "mode": mode}
        f = curve.freq_hz[kept]
        self.panes[0].scatter(x=_plain(f), y=_plain(size[kept]), hovertemplate=f"%{{y:.3e}} {unit}", **common)
        phase = _phase_deg(values[kept], cut)
        torn = 1 + np.flatnonzero(np.abs(np.diff(phase)) > 180)
        broken = {"x": _plain(np.insert(f, torn, np.nan)), "y": _plain(np.insert(phase, torn, np.nan))}
        self.panes[1].scatter(**broken, hovertemplate="%{y:.1f}°", **common)
        if name == "measured" and curve.coherence is not None:
            quality = curve.coherence[kept, curve.outputs.index(pair[0]), curve.inputs.index(pair[1])]
            common |= {"line": {"color": _COHERENCE, "width": 1}}
            self.panes[2].scatter(x=_plain(f), y=_plain(quality), hovertemplate="γ² %{y:.4f}", **common)


def _cut(values: NDArray[np.complex128]) -> float:
    """Where to cut the circle of phases open so that a curve is torn least, degrees."""
    cuts = (-180.0, -PHASE_LIMIT_DEG, PHASE_LIMIT_DEG - 360)
    # A jump counts by the size of the response there: that of noise has none.
    torn = [np.abs(values[1:])[np.abs(np.diff(_phase_deg(values, cut))) > 180].sum() for cut in cuts]
    return cuts[int(np.argmin(torn))]


def _phase_deg(values: NDArray[np.complex128], cut: float) -> Array:
    """Phases from `cut` to a turn above it, degrees."""
    return np.asarray((np.degrees(np.angle(values)) - cut) % 360 + cut, np.float64)


def _plain(values: Array) -> NDArray[np.float32]:
    """In single precision: seven digits are more than a screen shows, and half the size of the page."""
    return np.asarray(values, np.float32)
