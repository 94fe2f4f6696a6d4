"""Nyquist figures: the circle that each mode draws in the complex plane."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.identification.poles import natural_freq_hz
from armonic.plots.look import BEFORE, INK, MUTED, mode_colour
from armonic.plots.panes import WIDTH, Pane, Sheet
from armonic.response import KINDS
from armonic.text import count, format_hz

if TYPE_CHECKING:
    from collections.abc import Sequence

    import plotly.graph_objects as go
    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet
    from armonic.identification.modal_model import ModalModel
    from armonic.response import Kind

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Pair: TypeAlias = tuple[str, str]

REACH = 8.0
"""Lines are drawn up to so many half-power half-widths to either side of a mode: 166° of its circle each way."""
LEAST_LINES = 5
"""Of coarse lines at least so many, around the mode."""
MOST_MODES = 12
"""Rows of a figure; the modes that follow are left out, which it says."""

_LEFT, _TOP, _GAP, _ROW = 92, 58, 44, 30
_CURVE = 241
"""Points of a synthesized curve."""


def nyquist(
    frfs: FrfSet,
    poles: ArrayLike,
    *,
    model: ModalModel | None = None,
    pairs: Sequence[Pair] | None = None,
    kind: Kind = "mobility",
) -> go.Figure:
    """Draw responses around each mode in the complex plane: a row per mode, a column per pair.

    Near a mode with viscous damping mobility runs along a circle (Kennedy and Pancu 1947; Ewins 2000, section 4.3); one
    that is dented or open says that the mode is not alone, not linear, or that lines are too coarse. Dots are measured
    lines, the ring is the one nearest to the mode; dotted is the modal model.

    Args:
        frfs: what was measured.
        poles: of the modes, (m,), rad/s, Im λ > 0.
        model: a model to draw over the lines, where they lie (beside the imaginary axis with an exponential window).
        pairs: (output, input) labels; by default driving points, or the pairs that respond most, four at most.
        kind: what is drawn, whatever was measured.

    Raises:
        FrfError: no poles, a pair that was not measured, or an unknown kind.
    """
    found = np.asarray(poles, np.complex128).ravel()
    if not found.size:
        raise FrfError("poles", found="none", expected="the pole of one mode at least")
    chosen = _pairs(frfs, pairs)
    side = min(250.0, (WIDTH - _LEFT - _GAP * len(chosen)) / len(chosen))
    shown = min(len(found), MOST_MODES)
    step = side + _ROW
    sheet = Sheet(round(_TOP + shown * step + 12))
    for row in range(shown):
        top = _TOP + row * step
        freq = float(natural_freq_hz(found[row]))
        head = f"<b>{row + 1}</b><br>{format_hz(freq)} Hz"
        font = {"size": 12, "color": mode_colour(row + 1)}
        sheet.write(0, top + side / 2, head, align="left", yanchor="middle", font=font)
        lines = around(frfs, found, row)
        part = frfs.lines(lines).to(kind)
        for column, pair in enumerate(chosen):
            left = _LEFT + column * (side + _GAP)
            curve = None if model is None else _synthesized(model, part, pair)
            _draw(sheet, (left, top, side), part, pair, curve, row, complex(found[row]), first=row == column == 0)
    for column, (output, force) in enumerate(chosen):
        title = f"<b>{html.escape(output)}</b>, force <b>{html.escape(force)}</b>"
        sheet.write(_LEFT + column * (side + _GAP), _TOP - 6, title)
    unit = {"receptance": "m/N", "mobility": "(m/s)/N", "accelerance": "(m/s²)/N"}[kind]
    told = f"{kind}, {unit}, of forces and translations"
    told += f"; {count(shown, 'mode')} of {len(found)} drawn" if shown < len(found) else ""
    sheet.write(WIDTH - 8, 18, told, xanchor="right")
    return sheet.figure


def around(frfs: FrfSet, poles: Complex, mode: int) -> NDArray[np.intp]:
    """Which lines belong to the circle of a mode: those near it, up to halfway to the next one, five at least.

    Args:
        frfs: the responses.
        poles: of all modes, rad/s.
        mode: which one, by index.
    """
    f, centres = frfs.freq_hz, poles.imag / (2 * np.pi)
    centre, width = centres[mode], (frfs.decay_rate - poles[mode].real) / (2 * np.pi)
    below, above = centres[centres < centre], centres[centres > centre]
    low = max(centre - REACH * width, (centre + below.max()) / 2 if below.size else 0.0)
    high = min(centre + REACH * width, (centre + above.min()) / 2 if above.size else np.inf)
    inside = np.flatnonzero((f >= low) & (f <= high) & (f > 0))
    if len(inside) < LEAST_LINES:
        inside = np.sort(np.argsort(np.where(f > 0, np.abs(f - centre), np.inf), kind="stable")[:LEAST_LINES])
        inside = inside[f[inside] > 0]
    return inside


def _pairs(frfs: FrfSet, pairs: Sequence[Pair] | None) -> list[Pair]:
    if pairs is None:
        there = [(frfs.outputs[i], frfs.inputs[j]) for i, j in np.argwhere(frfs.measured)]
        driven = [pair for pair in there if pair[0] == pair[1]]
        size = np.linalg.norm(frfs.values, axis=0)
        there.sort(key=lambda pair: -size[frfs.outputs.index(pair[0]), frfs.inputs.index(pair[1])])
        return (driven or there)[:4]
    chosen = [(str(output), str(force)) for output, force in pairs]
    for output, force in chosen:
        there_is = output in frfs.outputs and force in frfs.inputs
        if not (there_is and frfs.measured[frfs.outputs.index(output), frfs.inputs.index(force)]):
            raise FrfError("pairs", found=f"{output} to {force}", expected=f"a measured pair of {frfs!r}")
    if not chosen:
        raise FrfError("pairs", found="none", expected="one pair at least")
    return chosen


def _values(frfs: FrfSet, pair: Pair) -> Complex:
    return frfs.values[:, frfs.outputs.index(pair[0]), frfs.inputs.index(pair[1])]


def _synthesized(model: ModalModel, part: FrfSet, pair: Pair) -> tuple[Array, Complex] | None:
    """A smooth curve of the model along the lines, where they lie, and its frequencies."""
    if pair[0] not in model.outputs or pair[1] not in model.inputs:
        return None
    f = np.linspace(part.freq_hz[0], part.freq_hz[-1], _CURVE)
    s = 2j * np.pi * f + part.decay_rate
    values = model.receptance(s)[:, model.outputs.index(pair[0]), model.inputs.index(pair[1])]
    return f, values * s ** KINDS.index(part.kind)


def _draw(
    sheet: Sheet,
    place: tuple[float, float, float],
    part: FrfSet,
    pair: Pair,
    curve: tuple[Array, Complex] | None,
    mode: int,
    pole: complex,
    *,
    first: bool,
) -> None:
    """One circle, on axes of one scale."""
    left, top, side = place
    values = _values(part, pair)
    drawn = values if curve is None else np.concatenate([values, curve[1]])
    span = 1.12 * max(float(np.ptp(drawn.real)), float(np.ptp(drawn.imag))) or 1.0
    middle = [float(x.min() + x.max()) / 2 for x in (drawn.real, drawn.imag)]
    look = {"nticks": 5, "tickformat": "~s", "tickfont": {"size": 9.5, "color": MUTED}}
    look |= {"zeroline": True, "zerolinecolor": "#c3c9cf", "zerolinewidth": 1}
    x, y = (look | {"range": [at - span / 2, at + span / 2]} for at in middle)
    pane = sheet.pane(left, top, side, side, x=x | {"constrain": "domain"}, y=y | {"constrain": "domain"})
    sheet.figure.layout[f"yaxis{pane.y[1:]}"].scaleanchor = pane.x
    if curve is not None:
        line = {"color": BEFORE, "width": 2, "dash": "dot"}
        _scatter(pane, "synthesized", *curve, first, mode="lines", line=line)
    dots = {"marker": {"size": 4, "color": INK}, "line": {"color": INK, "width": 0.6}}
    _scatter(pane, "measured", part.freq_hz, values, first, mode="lines+markers", **dots)
    nearest = int(np.argmin(np.abs(part.freq_hz - pole.imag / (2 * np.pi))))
    ring = {"symbol": "circle-open", "size": 10, "color": mode_colour(mode + 1), "line": {"width": 2}}
    at = slice(nearest, nearest + 1)
    _scatter(pane, "line nearest to the mode", part.freq_hz[at], values[at], first, mode="markers", marker=ring)


def _scatter(pane: Pane, name: str, freq_hz: Array, values: Complex, shown: bool, **style: Any) -> None:
    pane.scatter(
        x=values.real.astype(np.float32),
        y=values.imag.astype(np.float32),
        customdata=freq_hz.astype(np.float32),
        name=name,
        legendgroup=name,
        showlegend=shown,
        hovertemplate="%{customdata:.6~g} Hz<br>Re %{x:.3e}, Im %{y:.3e}<extra></extra>",
        **style,
    )
