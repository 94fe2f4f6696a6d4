"""Stabilization diagrams: the poles of every model order over frequency or damping, and the modes chosen from them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from armonic.errors import SignalError
from armonic.plots.look import GRID, INK, MUTED, TEMPLATE, log_axis, mode_colour
from armonic.plots.maps import apart
from armonic.plots.series import thinned
from armonic.text import format_si

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.frf_set import FrfSet
    from armonic.identification.selection import SelectedMode
    from armonic.identification.stabilization import Stabilization
    from armonic.modal import Modes

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.intp]
What = Literal["frequency", "damping"]

MAX_POINTS = 5000
"""Stable poles, and unstable ones, that are drawn; of more, evenly spread ones. Those of selected modes all are."""
LOGARITHMIC = 10.0
"""Modes that span more than this factor have a logarithmic axis."""
TICKS_DECADES = 3.2
"""A logarithmic axis of up to so many decades has ticks at 1, 2 and 5."""

UNSTABLE, STABLE, RESPONSE = "#b4bcc4", "#5a9bd0", "#c9a26b"
WIDTH, HEIGHT = 1080, 480
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 24, 118, 46

_QUANTITIES = {"frequency": ("Natural frequency, Hz", 1.0), "damping": ("Damping ratio, %", 100.0)}
_BOUNDS = (
    ("freq_change", "freq_tolerance", "frequency", False),
    ("damping_change", "damping_tolerance", "damping", False),
    ("mac", "mac", "MAC", True),
    ("omac", "omac", "OMAC", True),
    ("mpc", "mpc", "MPC", True),
    ("mpd_deg", "mpd_deg", "MPD", False),
)
"""What was measured, its bound among the criteria, its name in words, and whether the bound is the least allowed."""


def stabilization_diagram(
    stabilization: Stabilization,
    selected: Sequence[SelectedMode] = (),
    *,
    what: What = "frequency",
    reference: Modes | None = None,
    band_hz: tuple[float, float] | None = None,
    log: bool | None = None,
    frfs: FrfSet | None = None,
) -> go.Figure:
    """Draw poles over natural frequency or damping, by model order (Do et al. 2022, Figs. 8, 9 and B.3).

    Grey: poles that fail a criterion against the order before, which a pointer on them names. Blue: stable poles. In
    the colour of their mode: the poles of a selected mode, with a line at its mean; hollow where one of them failed.
    Only poles that decay and vibrate are drawn, 0 < ζ < 1.

    Args:
        stabilization: poles of all orders, judged.
        selected: the modes chosen from them, numbered from 1 in this order.
        what: "frequency" or "damping", the x axis.
        reference: modes of a model, drawn as dashed lines.
        band_hz: natural frequencies that are drawn; by default all. The axis spans the selected modes and the
            reference; zooming out shows the rest.
        log: whether the x axis is logarithmic; by default if what it spans exceeds a factor of ten.
        frfs: responses that the poles were found in; behind a diagram over frequency their sum is drawn, each as a
            share of its own RMS, on a logarithmic axis of its own.

    Returns:
        The figure. Of more than 5000 poles of one kind a part is drawn, which it says; of selected modes all are.

    Raises:
        SignalError: `what` is none of the two, or the band is empty.
    """
    if what not in _QUANTITIES:
        raise SignalError("what", found=repr(what), expected="'frequency' or 'damping'")
    if band_hz is not None and not band_hz[0] < band_hz[1]:
        raise SignalError("band_hz", found=f"{band_hz[0]:g} to {band_hz[1]:g} Hz", expected="a rising pair, in Hz")
    poles = _Poles(stabilization, selected, what, band_hz)
    title, factor = _QUANTITIES[what]
    means = [factor * (mode.natural_freq_hz if what == "frequency" else mode.damping_ratio) for mode in selected]
    known = _reference(reference, what, band_hz)
    axis = _axis(poles, np.array(means + known), log)
    figure = go.Figure(layout={"template": TEMPLATE, "height": HEIGHT, "width": WIDTH, "hovermode": "closest"})
    figure.update_layout(
        margin={"l": _LEFT, "r": _RIGHT, "t": _TOP, "b": _BOTTOM},
        xaxis=axis | {"title": {"text": title}},
        yaxis={"title": {"text": "Model order"}, "range": poles.span, "nticks": 8},
        legend={"traceorder": "normal", "itemsizing": "constant"},
    )
    if frfs is not None and what == "frequency":
        _responses(figure, frfs)
    notes = [
        poles.scatter(figure, poles.unstable, "unstable", {"color": UNSTABLE, "size": 2.6}),
        poles.scatter(figure, poles.stable, "stable", {"color": STABLE, "size": 3.8}),
    ]
    for number, (mode, mean) in enumerate(zip(selected, means, strict=True), 1):
        poles.mark(figure, mode, number)
        _line(figure, mean, poles.span, color=mode_colour(number), width=1.1)
    _key(figure, "selected modes", bool(selected))
    _reference_lines(figure, known, poles.span)
    _name_lines(figure, means, axis, what)
    if told := "; ".join(note for note in notes if note):
        place = {"x": 1, "xref": "paper", "y": 1, "yref": "paper", "xanchor": "right", "yanchor": "bottom"}
        figure.add_annotation(text=told, showarrow=False, yshift=84, font={"size": 11, "color": MUTED}, **place)
    return figure


def failed_criteria(stabilization: Stabilization) -> list[str]:
    """The criteria that each pole fails, in words: "frequency, MAC"; empty where it fails none.

    Args:
        stabilization: of P poles.

    Returns:
        P texts. A pole of the lowest order, or one without a partner in the order before, fails every criterion that
        needs one.
    """
    criteria, rows = stabilization.criteria, dict[str, NDArray[np.bool_]]()
    for measured, bound, name, least in _BOUNDS:
        limit = getattr(criteria, bound)
        if limit is not None:
            values = getattr(stabilization, measured)
            rows[name] = ~(values >= limit if least else values <= limit)  # so that what is not known fails
    if criteria.damping_range is not None:
        low, high = criteria.damping_range
        rows["damping range"] = ~((stabilization.damping_ratio > low) & (stabilization.damping_ratio < high))
    if criteria.freq_range_hz is not None:
        low, high = criteria.freq_range_hz
        rows["frequency range"] = ~((stabilization.natural_freq_hz >= low) & (stabilization.natural_freq_hz <= high))
    codes = np.zeros(len(stabilization.order), int)
    for bit, failed in enumerate(rows.values()):
        codes += failed.astype(int) << bit
    words = {
        code: ", ".join(name for bit, name in enumerate(rows) if code >> bit & 1) for code in np.unique(codes).tolist()
    }
    return [words[code] for code in codes.tolist()]


@dataclass(frozen=True)
class _Drawn:
    """Poles of one kind that are drawn, and how many there are."""

    at: Indices
    total: int


class _Poles:
    """The poles of a stabilization as a diagram draws them: by kind, within the band, thinned."""

    def __init__(
        self,
        stabilization: Stabilization,
        selected: Sequence[SelectedMode],
        what: What,
        band_hz: tuple[float, float] | None,
    ) -> None:
        self.order = np.asarray(stabilization.order, float)
        self.freq_hz = np.asarray(stabilization.natural_freq_hz, float)
        self.damping = np.asarray(stabilization.damping_ratio, float)
        self.x = self.freq_hz if what == "frequency" else 100 * self.damping
        self.mac, self.failed = np.asarray(stabilization.mac, float), failed_criteria(stabilization)
        self.good = np.asarray(stabilization.stable, bool)
        self.inside = (self.freq_hz > 0) & np.isfinite(self.freq_hz) & (self.damping > 0) & (self.damping < 1)
        if band_hz is not None:
            self.inside &= (self.freq_hz >= band_hz[0]) & (self.freq_hz <= band_hz[1])
        free = self.inside.copy()
        for mode in selected:
            free[np.asarray(mode.members, np.intp)] = False
        self.stable, self.unstable = (_spread(np.flatnonzero(free & kind)) for kind in (self.good, ~self.good))
        low, high = (float(self.order.min()), float(self.order.max())) if self.order.size else (0.0, 1.0)
        margin = 0.03 * (high - low) + 0.5
        self.span = [low - margin, high + margin]

    def scatter(self, figure: go.Figure, drawn: _Drawn, name: str, marker: dict[str, Any]) -> str:
        """Dots for poles of one kind; returns what is left out, in words."""
        self._dots(figure, drawn.at, name, marker, showlegend=bool(drawn.total), legendgroup=name)
        return f"{drawn.at.size} of {drawn.total} {name} poles drawn" if drawn.at.size < drawn.total else ""

    def mark(self, figure: go.Figure, mode: SelectedMode, number: int) -> None:
        """Dots for the poles of a selected mode, hollow where they failed a criterion."""
        at = np.asarray(mode.members, np.intp)
        at = at[self.inside[at]]
        colour = mode_colour(number)
        fill = np.where(self.good[at], colour, "white").tolist()
        marker = {"size": 5, "color": fill, "line": {"width": 1, "color": colour}}
        self._dots(figure, at, f"mode {number}", marker, showlegend=False, legendgroup="selected modes")

    def _dots(self, figure: go.Figure, at: Indices, name: str, marker: dict[str, Any], **more: Any) -> None:
        figure.add_scatter(
            x=self.x[at],
            y=self.order[at],
            mode="markers",
            marker=marker,
            name=name,
            customdata=np.column_stack([self.freq_hz[at], 100 * self.damping[at]]),
            text=[self._told(int(i)) for i in at],
            hovertemplate="order %{y:.0f}<br>%{customdata[0]:.6g} Hz, damping %{customdata[1]:.4g} %"
            f"<br>%{{text}}<extra>{name}</extra>",
            **more,
        )

    def _told(self, i: int) -> str:
        mac = f"MAC {self.mac[i]:.4f}" if np.isfinite(self.mac[i]) else "no MAC with the order before"
        return f"{mac}<br>fails: {self.failed[i]}" if self.failed[i] else mac


def _spread(at: Indices) -> _Drawn:
    if at.size <= MAX_POINTS:
        return _Drawn(at, at.size)
    kept = np.unique(np.linspace(0, at.size - 1, MAX_POINTS).round().astype(np.intp))
    return _Drawn(at[kept], at.size)


def _reference(reference: Modes | None, what: What, band_hz: tuple[float, float] | None) -> list[float]:
    """Where the lines of the reference stand; a real pole, which does not vibrate, has none."""
    if reference is None:
        return []
    freq_hz, vibrating = np.asarray(reference.natural_freq_hz, float), np.asarray(reference.oscillatory, bool)
    if band_hz is not None:
        vibrating = vibrating & (freq_hz >= band_hz[0]) & (freq_hz <= band_hz[1])
    values = freq_hz if what == "frequency" else 100 * np.asarray(reference.damping_ratio, float)
    return [float(value) for value in values[vibrating]]


def _axis(poles: _Poles, lines: Array, log: bool | None) -> dict[str, Any]:
    """Type, range and ticks along x, for the lines; with less than two for the stable poles, then for all."""
    shown = lines[np.isfinite(lines) & (lines > 0)]
    # What was not selected should be seen as well, but for what lies far out.
    stable = poles.x[poles.stable.at]
    stable = stable[np.isfinite(stable) & (stable > 0)]
    if stable.size:
        shown = np.concatenate([shown, np.quantile(stable, [0.05, 0.95])])
    for others in (poles.stable.at, np.flatnonzero(poles.inside)):
        if shown.size < 2:
            shown = np.concatenate([shown, poles.x[others]])
    if not shown.size:
        return {"range": [0.0, 1.0], "type": "linear"}
    low, high = float(shown.min()), float(shown.max())
    if not (high > LOGARITHMIC * low if log is None else log):
        margin = 0.06 * (high - low) or 0.05 * high
        return {"type": "linear", "range": [max(0.0, low - margin), high + margin], "nticks": 14}
    axis = log_axis(shown)
    decades = axis["range"][1] - axis["range"][0]
    if 1.3 <= decades <= TICKS_DECADES:
        first, last = math.floor(axis["range"][0]), math.ceil(axis["range"][1])
        ticks = [figure * 10.0**n for n in range(first, last + 1) for figure in (1, 2, 5)]
        axis |= {"tickvals": ticks, "ticktext": [f"{tick:.6g}" for tick in ticks], "gridcolor": GRID}
        axis |= {"tickfont": {"size": 11, "color": MUTED}}
    return axis


def _responses(figure: go.Figure, frfs: FrfSet) -> None:
    """The sum of all responses, behind the poles."""
    size = np.abs(frfs.values[:, frfs.measured])
    rms = np.sqrt(np.mean(size**2, axis=0))
    total = np.sum(np.divide(size, rms, out=np.zeros_like(size), where=rms > 0), axis=1)
    shown = (total > 0) & (frfs.freq_hz > 0)
    f, total = frfs.freq_hz[shown], total[shown]
    kept = thinned(np.log(total))
    figure.update_layout(yaxis2={"overlaying": "y", "side": "right", "visible": False} | log_axis(total))
    figure.add_scatter(
        x=f[kept],
        y=total[kept],
        yaxis="y2",
        mode="lines",
        line={"color": RESPONSE, "width": 1.2},
        name="sum of |H|",
        hoverinfo="skip",
    )


def _line(figure: go.Figure, x: float, span: list[float], **line: Any) -> None:
    figure.add_shape(type="line", x0=x, x1=x, y0=span[0], y1=span[1], line=line, layer="below")


def _reference_lines(figure: go.Figure, known: list[float], span: list[float]) -> None:
    """Dashed lines in one trace, so that the legend switches them off."""
    xs = [value for x in known for value in (x, x, None)]
    ys = [value for _ in known for value in (*span, None)]
    line = {"color": INK, "width": 1.1, "dash": "dash"}
    figure.add_scatter(
        x=xs, y=ys, mode="lines", line=line, name="reference", showlegend=bool(known), hoverinfo="skip", opacity=0.75
    )


def _key(figure: go.Figure, name: str, shown: bool) -> None:
    marker = {"size": 7, "color": MUTED, "line": {"width": 1, "color": INK}}
    figure.add_scatter(
        x=[None],
        y=[None],
        mode="markers",
        marker=marker,
        name=name,
        legendgroup=name,
        showlegend=shown,
        hoverinfo="skip",
    )


def _name_lines(figure: go.Figure, means: list[float], axis: dict[str, Any], what: What) -> None:
    """Number and mean above each line, upright, moved apart where lines lie close, with a leader back to its line."""
    if not means:
        return
    room, (low, high) = float(WIDTH - _LEFT - _RIGHT), axis["range"]
    along = [math.log10(mean) if axis["type"] == "log" else mean for mean in means]
    own = [room * (x - low) / (high - low) for x in along]
    unit, digits = ("Hz", 4) if what == "frequency" else ("%", 3)
    for k, at in enumerate(apart(own, least=14.0, room=room)):
        text, colour = f"{k + 1}: {format_si(means[k], unit, digits=digits)}", mode_colour(k + 1)
        figure.add_annotation(
            x=along[k],
            y=1,
            yref="paper",
            ax=at - own[k],
            ay=-15 - 3.1 * len(text),  # of its middle
            xanchor="center",
            yanchor="middle",
            text=text,
            textangle=-90,
            showarrow=True,
            arrowhead=0,
            arrowwidth=1,
            arrowcolor=colour,
            font={"size": 10.5, "color": colour},
        )
