"""Figures of a survey over one dim: frequencies and damping over a path or a parameter, and events among the modes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
from scipy.optimize import isotonic_regression

from armonic.plots.curves import MAX_POINTS, Survey
from armonic.plots.dataset import EVENTS
from armonic.plots.look import EVENT_MARKERS, INK, MUTED, TEMPLATE, log_axis, mode_colour

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import xarray as xr

    from armonic.plots.dataset import Array

QUANTITIES = {
    "natural_freq_hz": ("Natural frequency, Hz", 1.0, "%{y:.5g} Hz"),
    "damping_ratio": ("Damping ratio, %", 100.0, "%{y:.4g} %"),
}
"""Title, factor from the dataset's unit to the figure's, and how a value is printed."""
CASE_DASHES = ("solid", "dash", "dot", "dashdot")
LOGARITHMIC = 10.0
"""A panel that spans more than this factor has a logarithmic axis."""

_PANEL, _GAP, _TOP, _BOTTOM = 208, 48, 54, 46
_UNSTABLE = "#fbe3dd"


def frequency_map(ds: xr.Dataset, *, modes: Sequence[int] | None = None) -> go.Figure:
    """Draw the natural frequency of every tracked mode over a path (Do et al. 2022, Fig. 3).

    Modes whose bands lie close share a panel with its own scale, for they span decades. A leading sweep, such as one of
    tool.mass, gives each mode one line per case, solid and dashed, of at most four cases.

    Args:
        ds: what `armonic.survey` returned, over a path, one gridded joint or one parameter.
        modes: numbers of the modes to draw; by default all.

    Raises:
        SurveyError: the dataset is no survey, is a map over several joints, or lacks a mode.
    """
    return _multiples(Survey(ds, modes), "natural_freq_hz")


def damping_map(ds: xr.Dataset, *, modes: Sequence[int] | None = None) -> go.Figure:
    """Draw the damping ratio of every tracked mode over a path (Do et al. 2022, Fig. 4), in per cent.

    Panels hold the same modes as those of `frequency_map`.

    Args:
        ds: as in `frequency_map`.
        modes: as in `frequency_map`.

    Raises:
        SurveyError: as in `frequency_map`.
    """
    return _multiples(Survey(ds, modes), "damping_ratio")


def campbell(ds: xr.Dataset, *, modes: Sequence[int] | None = None) -> go.Figure:
    """Draw frequencies beside damping of tracked modes over a parameter (Do et al. 2022, Fig. 5).

    Where two modes come close it is marked whether they cross or veer. A real pole goes on as the slower of its two;
    the faster is dotted.

    Args:
        ds: what `armonic.survey` returned for a sweep; of a sweep over a path, one posture: `ds.isel(posture=0)`.
        modes: numbers of the modes to draw; by default all.

    Raises:
        SurveyError: the dataset is no survey over one dim, or lacks a mode.
    """
    survey = Survey(ds, modes)
    groups = survey.groups(6)
    figure = _figure(len(groups), survey)
    for row, group in enumerate(groups):
        for column, name in enumerate(QUANTITIES):
            number = 2 * row + column + 1
            panel = _Panel(figure, number, *_cell(row, len(groups), column, 2), lowest=row == len(groups) - 1)
            panel.draw(survey, name, group, titled=True)
    _explain(survey, figure)
    return figure


def _multiples(survey: Survey, name: str) -> go.Figure:
    groups = survey.groups()
    columns = 1 if len(groups) == 1 else 2
    rows = math.ceil(len(groups) / columns)
    figure = _figure(rows, survey)
    for k, group in enumerate(groups):
        row, column = divmod(k, columns)
        alone = k == len(groups) - 1 and column == 0  # it takes the place of two
        cell = _cell(row, rows, column, 1 if alone else columns)
        panel = _Panel(figure, k + 1, *cell, lowest=row == rows - 1)
        panel.draw(survey, name, group, titled=column == 0)
    _explain(survey, figure)
    return figure


def _figure(rows: int, survey: Survey) -> go.Figure:
    height = rows * _PANEL + (rows - 1) * _GAP + _TOP + _BOTTOM
    figure = go.Figure(layout={"template": TEMPLATE, "height": height, "hovermode": "closest"})
    figure.update_layout(margin={"l": 62, "r": 24, "t": _TOP, "b": _BOTTOM}, legend={"traceorder": "normal"})
    return figure


def _cell(row: int, rows: int, column: int, columns: int) -> tuple[list[float], list[float]]:
    """Domains of a cell along x and y, from the top left."""
    total = rows * _PANEL + (rows - 1) * _GAP
    top = 1 - row * (_PANEL + _GAP) / total
    width, gap = (1.0, 0.0) if columns == 1 else (0.455, 0.09)
    left = column * (width + gap)
    return [left, left + width], [max(0.0, top - _PANEL / total), top]


def _explain(survey: Survey, figure: go.Figure) -> None:
    """The legend, and a word on what is left out."""
    if len(survey.labels) > 1:
        for case, label in enumerate(survey.labels):
            line = {"color": INK, "width": 1.8, "dash": CASE_DASHES[case]}
            _key(figure, label, mode="lines", line=line, legendgroup=f"case {case}")
    for code, name in EVENTS.items():
        if survey.marks[code].total:
            _key(figure, name, mode="markers", marker=EVENT_MARKERS[code], legendgroup=name)
    if survey.unstable():
        _key(figure, "unstable", mode="markers", marker={"symbol": "square", "size": 12, "color": _UNSTABLE})
    notes = []
    if len(survey.x) > MAX_POINTS:
        notes.append(f"{MAX_POINTS} of {len(survey.x)} points per curve drawn, extremes among them")
    if survey.all_cases > len(survey.labels):
        notes.append(f"{len(survey.labels)} of {survey.all_cases} cases drawn")
    notes += [
        f"{mark.at.size} of {mark.total} marks of {EVENTS[code]} drawn"
        for code, mark in survey.marks.items()
        if mark.at.size < mark.total
    ]
    if notes:
        place = {"x": 1, "xref": "paper", "y": 1, "yref": "paper", "xanchor": "right", "yanchor": "bottom"}
        font = {"size": 11, "color": MUTED}
        figure.add_annotation(text="; ".join(notes), showarrow=False, yshift=18, font=font, **place)


def _key(figure: go.Figure, name: str, **style: Any) -> None:
    """An entry of the legend without a curve."""
    figure.add_scatter(x=[None], y=[None], name=name, showlegend=True, hoverinfo="skip", **style)


class _Panel:
    """One pair of axes with the curves of a few modes."""

    def __init__(self, figure: go.Figure, number: int, x: list[float], y: list[float], *, lowest: bool) -> None:
        self.figure, self.suffix, self.x, self.y, self.lowest = figure, str(number) if number > 1 else "", x, y, lowest

    def draw(self, survey: Survey, name: str, group: list[int], *, titled: bool) -> None:
        """Axes, curves, events and numbers of the modes at the right end."""
        title, factor, hover = QUANTITIES[name]
        at, values = survey.curves[name]
        values = factor * values
        faster = survey.faster if name == "natural_freq_hz" else None
        spread = values[:, group] if faster is None else np.concatenate([values[:, group], faster[:, group]])
        scale = linear_or_log(spread, name)
        self._lay_out(survey, title if titled else None, scale, [survey.numbers[k] for k in group])
        for k in group:
            colour = mode_colour(survey.numbers[k])
            for case, label in enumerate(survey.labels):
                words = f"mode {survey.numbers[k]}" + (f", {label}" if label else "")
                dash = CASE_DASHES[case]
                self._curve(
                    survey.x[at[case, k]],
                    values[case, k],
                    name=words,
                    legendgroup=f"case {case}",
                    line={"color": colour, "width": 1.8, "dash": dash},
                    hovertemplate=f"{hover} at %{{x:.5g}}<extra>{words}</extra>",
                )
                if faster is not None and np.isfinite(faster[case, k]).any():
                    self._curve(
                        survey.x,
                        faster[case, k],
                        name=f"{words}, faster real pole",
                        legendgroup=f"case {case}",
                        line={"color": colour, "width": 1.2, "dash": "dot"},
                        hovertemplate=f"{hover} at %{{x:.5g}}<extra>{words}, faster real pole</extra>",
                    )
        for code, marks in survey.marks.items():
            here = np.isin(marks.mode, group)
            if here.any():
                y = factor * survey.values_at(name, marks)[here]
                numbers = [survey.numbers[k] for k in marks.mode[here]]
                self.figure.add_scatter(
                    x=survey.x[marks.at[here]],
                    y=y,
                    mode="markers",
                    marker=EVENT_MARKERS[code],
                    name=EVENTS[code],
                    legendgroup=EVENTS[code],
                    showlegend=False,
                    customdata=numbers,
                    hovertemplate=f"{EVENTS[code]} of mode %{{customdata}}<br>{hover} at %{{x:.5g}}<extra></extra>",
                    **self._axes(),
                )
        ends = {survey.numbers[k]: _last(values[0, k]) for k in group}
        number_curves(self.figure, self.suffix, ends, scale, _PANEL)

    def _axes(self) -> dict[str, str]:
        return {"xaxis": f"x{self.suffix}", "yaxis": f"y{self.suffix}"}

    def _curve(self, x: Array, y: Array, **style: Any) -> None:
        drawn = "lines" if np.count_nonzero(np.isfinite(y)) > 1 else "markers"
        self.figure.add_scatter(x=x, y=y, mode=drawn, showlegend=False, **style, **self._axes())

    def _lay_out(self, survey: Survey, title: str | None, scale: dict[str, Any], numbers: list[int]) -> None:
        limits = [float(survey.x.min()), float(survey.x.max())]
        if limits[0] == limits[1]:
            limits = [limits[0] - 0.5, limits[1] + 0.5]
        layout = self.figure.layout
        layout[f"xaxis{self.suffix}"] = {
            "domain": self.x,
            "anchor": f"y{self.suffix}",
            "range": limits,
            "matches": "x" if self.suffix else None,
            "exponentformat": "none" if max(map(abs, limits)) < 1e5 else "power",
            "title": {"text": survey.title if self.lowest else None},
        }
        layout[f"yaxis{self.suffix}"] = scale | {
            "domain": self.y,
            "anchor": f"x{self.suffix}",
            "title": {"text": title, "standoff": 6},
        }
        for low, high in survey.unstable():
            area = {"x0": low, "x1": high, "y0": 0, "y1": 1, "fillcolor": _UNSTABLE, "line": {"width": 0}}
            area |= {"xref": f"x{self.suffix}", "yref": f"y{self.suffix} domain"}
            self.figure.add_shape(type="rect", layer="below", **area)
        place: dict[str, Any] = {"x": 0, "xref": f"x{self.suffix} domain", "xanchor": "left"}
        place |= {"y": 1, "yref": f"y{self.suffix} domain", "yanchor": "bottom"}
        font = {"size": 11, "color": MUTED}
        self.figure.add_annotation(text=mode_list(numbers), showarrow=False, font=font, **place)


def _last(values: Array) -> float:
    """The last finite value, or zero."""
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if finite.size else 0.0


def number_curves(
    figure: go.Figure, suffix: str, ends: Mapping[int, float], scale: Mapping[str, Any], height: float
) -> None:
    """The numbers of modes right of a panel, beside where their curves end, moved apart where these lie close.

    Args:
        figure: it gets an annotation per mode.
        suffix: of the panel's axes.
        ends: values by number of the mode.
        scale: the panel's y axis, with its range.
        height: of the panel, in pixels.
    """
    low, high = scale["range"]
    at = [math.log10(end) if scale.get("type") == "log" else end for end in ends.values()]
    heights = apart([height * (y - low) / (high - low) for y in at], least=12.0, room=height)
    for number, y in zip(ends, heights, strict=True):
        place: dict[str, Any] = {"x": 1, "xref": f"x{suffix} domain", "xanchor": "left", "xshift": 3}
        place |= {"y": y / height, "yref": f"y{suffix} domain", "yanchor": "middle"}
        font = {"size": 11, "color": mode_colour(number)}
        figure.add_annotation(text=str(number), showarrow=False, font=font, **place)


def mode_list(numbers: list[int]) -> str:
    """In words: "Modes 1 to 5", "Mode 6", "Modes 7, 9"."""
    numbers = sorted(numbers)
    if len(numbers) == 1:
        return f"Mode {numbers[0]}"
    if len(numbers) > 2 and numbers == list(range(numbers[0], numbers[-1] + 1)):
        return f"Modes {numbers[0]} to {numbers[-1]}"
    return f"Modes {', '.join(map(str, numbers))}"


def linear_or_log(values: Array, name: str) -> dict[str, Any]:
    """Type and range of an axis for these values; a nearly constant one is not blown up to fill it."""
    shown = values[np.isfinite(values)]
    low, high = (float(shown.min()), float(shown.max())) if shown.size else (0.0, 1.0)
    if low > 0 and high > LOGARITHMIC * low:
        return log_axis(shown)
    if name == "damping_ratio" and 0 <= low < 0.4 * high:
        low = 0.0
    least = 0.01 * max(abs(low), abs(high)) or 1.0
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, least)
    margin = 0.08 * 2 * half
    bottom = 0.0 if low == 0.0 and middle - half >= 0 else middle - half - margin
    return {"range": [bottom, middle + half + margin], "nticks": 6, "zeroline": low < 0, "zerolinecolor": MUTED}


def apart(positions: list[float], *, least: float, room: float) -> list[float]:
    """Positions moved as little as needed to lie `least` apart, or closer if there is no room."""
    order = np.argsort(positions, kind="stable")
    least = min(least, room / len(positions))
    steps = least * np.arange(len(positions))
    moved = isotonic_regression(np.array(positions)[order] - steps).x
    moved = np.clip(moved, 0.0, room - steps[-1]) + steps
    result = np.empty(len(positions))
    result[order] = moved
    return [float(value) for value in result]
