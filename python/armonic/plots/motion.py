"""Figures of mode shapes on the robot: extremes of the motion side by side, and the motion itself."""

from __future__ import annotations

import html
import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import plotly.graph_objects as go

from armonic.plots.look import INK, MUTED, TEMPLATE, mode_colour
from armonic.plots.moving import Moving, moving
from armonic.plots.panes import WIDTH, Pane, Sheet
from armonic.plots.wireframe import Wireframe, eye, picture_axes
from armonic.text import listing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.files.measured_file import Geometry
    from armonic.linear import Posture
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]

FRAME_MS = 50
"""One picture of an animation; a cycle of 24 takes 1.2 s whatever the frequency."""
CYCLES = 25
"""How often an animation runs before it stops by itself."""
_REST = "#b4bcc4"
_COLUMNS, _GAP, _TOP, _HEAD = 4, 12, 34, 24
_RETURN = math.pi
"""The other extreme lies half a cycle from the first."""


def shape_stills(
    robot: Robot | None,
    posture: Posture | None,
    shapes: Any,
    *,
    select: Sequence[int] | None = None,
    geometry: Geometry | None = None,
    share: float = 0.1,
) -> go.Figure:
    """Draw mode shapes on the robot: at rest in grey, in colour at the two extremes, one picture per mode.

    Thin curves are the paths of the points over a cycle: straight where all points move in phase, ellipses where the
    motion travels.

    Args:
        robot: the robot, or None with a geometry.
        posture: where it stands.
        shapes: `Modes` of the robot at that posture, in which all of it moves; or modes with shapes over PLACE.AXIS
            (the result of an identification, a `ModeTable`), in which the measured points move.
        select: modes, counted from 1; by default all that oscillate.
        geometry: positions of places that are no frames of the robot, and lines between measured points; without
            lines, points are joined along the robot's links.
        share: the largest deflection as a share of the robot's size.

    Raises:
        SignalError: no mode to draw, or no measured point with a position.
        PostureError: the posture does not fit the robot.
    """
    motion = moving(robot, posture, shapes, select=select, geometry=geometry, share=share, phases=48)
    everything = _all_points(motion)
    axes = picture_axes(eye(_rest(motion), motion.frame.up), motion.frame.up)
    flat = everything @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    span = np.maximum(1.06 * (high - low), 0.3 * (high - low).max() or 1.0)
    middle = (low + high) / 2
    columns = min(_COLUMNS, max(len(motion.numbers), 2))
    width = (WIDTH - _GAP * (columns - 1)) / columns
    height = min(width * float(span[1] / span[0]), 420.0)
    unit = max(float(span[0]) / width, float(span[1]) / height)  # m per pixel, the same along both axes
    half = unit * np.array([width, height]) / 2
    ranges = np.stack([middle - half, middle + half], axis=1).tolist()
    rows = math.ceil(len(motion.numbers) / columns)
    sheet = Sheet(round(_TOP + rows * (height + _HEAD + 10)))
    hidden = {"showline": False, "showgrid": False, "showticklabels": False, "ticks": "", "fixedrange": True}
    for k, (number, heading) in enumerate(zip(motion.numbers, motion.headings, strict=True)):
        row, column = divmod(k, columns)
        left, top = column * (width + _GAP), _TOP + row * (height + _HEAD + 10) + _HEAD
        pane = sheet.pane(left, top, width, height, x=hidden | {"range": ranges[0]}, y=hidden | {"range": ranges[1]})
        sheet.write(left + 6, top - 2, heading, font={"size": 12, "color": INK})
        _still(pane, motion, k, axes, mode_colour(number), named=k == 0)
    if motion.missing:
        sheet.write(WIDTH - 4, 20, _missing(motion), xanchor="right")
    return sheet.figure


def shape_animation(
    robot: Robot | None,
    posture: Posture | None,
    shapes: Any,
    *,
    select: Sequence[int] | None = None,
    geometry: Geometry | None = None,
    share: float = 0.1,
    steps: int = 24,
) -> go.Figure:
    """Draw mode shapes moving on the robot, x(t) = Re(φ e^{iωt}) without decay; a button per mode starts it.

    A mode of a model moves the whole robot by its kinematics; a measured one moves the measured points beside the robot
    at rest. A complex shape is seen to travel.

    Args:
        robot: as in `shape_stills`, as are the next four.
        posture: where it stands.
        shapes: the modes.
        select: modes, counted from 1.
        geometry: positions and lines of measured points.
        share: the largest deflection as a share of the robot's size.
        steps: pictures per cycle.

    Returns:
        A figure with frames and buttons, which works in a page without a connection.

    Raises:
        SignalError: no mode to draw, or no measured point with a position.
        PostureError: the posture does not fit the robot.
    """
    motion = moving(robot, posture, shapes, select=select, geometry=geometry, share=share, phases=steps)
    figure = go.Figure(layout={"template": TEMPLATE, "height": 480, "hovermode": "closest"})
    back = motion.backdrop
    if back is not None:
        _add(figure, back, back.points, _REST, width=4, name="at rest", hover=True)
    _add_paths(figure, motion, 0)
    colour = mode_colour(motion.numbers[0])
    _add(figure, motion.frame, motion.paths[0, 0], colour, width=6, name="moving", hover=False)
    moved = list(range(len(figure.data)))[-2:]
    frames: list[go.Frame] = []
    buttons: list[dict[str, Any]] = []
    for k, number in enumerate(motion.numbers):
        names = [f"{number}.{step}" for step in range(steps)]
        look = mode_colour(number)
        for step, name in enumerate(names):
            wire = _trace(motion.frame, motion.paths[k, step]) | {"line": {"color": look}, "marker": {"color": look}}
            curve = _path_points(motion, k) if step == 0 else None
            line = {} if curve is None else _xyz_arrays(curve) | {"line": {"color": look}}
            frames.append(go.Frame(name=name, data=[go.Scatter3d(**line), go.Scatter3d(**wire)], traces=moved))
        run = {"frame": {"duration": FRAME_MS, "redraw": True}, "transition": {"duration": 0}, "mode": "immediate"}
        buttons.append({"label": f"▶ {_plain(motion.headings[k])}", "method": "animate", "args": [names * CYCLES, run]})
    stop = {"frame": {"duration": 0, "redraw": False}, "transition": {"duration": 0}, "mode": "immediate"}
    buttons.append({"label": "❚❚ stop", "method": "animate", "args": [[None], stop]})
    figure.frames = frames
    menu = {"type": "buttons", "direction": "down", "showactive": False, "x": 1.0, "xanchor": "right", "y": 0.98}
    menu |= {"yanchor": "top", "pad": {"r": 0, "t": 24}, "font": {"size": 11.5}, "bgcolor": "white"}
    menu |= {"bordercolor": "#dfe3e7"}
    figure.update_layout(margin={"l": 0, "r": 0, "t": 34, "b": 0}, scene=_scene(motion))
    figure.update_layout(updatemenus=[menu | {"buttons": buttons}])
    if motion.missing:
        note = {"x": 0, "y": 0, "xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
        figure.add_annotation(text=_missing(motion), showarrow=False, font={"size": 11, "color": MUTED}, **note)
    return figure


def _all_points(motion: Moving) -> Array:
    return np.concatenate([motion.paths.reshape(-1, 3), _rest(motion)])


def _rest(motion: Moving) -> Array:
    back = [] if motion.backdrop is None else [motion.backdrop.points]
    return np.concatenate([motion.frame.points, *back])


def _missing(motion: Moving) -> str:
    return f"without a position or a known motion, not drawn: {html.escape(listing(list(motion.missing)))}"


def _plain(heading: str) -> str:
    return heading.replace("<b>", "").replace("</b>", "").replace("  ", ": ")


def _still(pane: Pane, motion: Moving, k: int, axes: Array, colour: str, *, named: bool) -> None:
    """One picture: robot at rest, paths, and both extremes."""
    back, frame = motion.backdrop, motion.frame
    if back is not None:
        _flat(pane, back, back.points @ axes.T, _REST, 3.0, "at rest", named, hover=True)
    phases = motion.paths.shape[1]
    curves = _path_points(motion, k) @ axes.T
    thin: dict[str, Any] = {"mode": "lines", "line": {"color": colour, "width": 1}, "hoverinfo": "skip"}
    thin |= {"opacity": 0.7, "name": "paths", "legendgroup": "paths", "showlegend": named}
    pane.scatter(x=_single(curves[:, 0]), y=_single(curves[:, 1]), **thin)
    for phase, name, opacity in ((0, "one extreme", 1.0), (round(phases * _RETURN / (2 * math.pi)), "the other", 0.4)):
        points = motion.paths[k, phase] @ axes.T
        _flat(pane, frame, points, colour, 2.6, name, named, opacity=opacity)


def _flat(
    pane: Pane, frame: Wireframe, points: Array, colour: str, width: float, name: str, named: bool, *,
    hover: bool = False, opacity: float = 1.0,
) -> None:  # fmt: skip
    path, labels = _strokes(frame, points)
    pane.scatter(
        x=_single(path[:, 0]),
        y=_single(path[:, 1]),
        mode="lines+markers",
        line={"color": colour, "width": width},
        marker={"color": colour, "size": 5},
        opacity=opacity,
        name=name,
        legendgroup=name,
        showlegend=named,
        text=labels,
        **({"hovertemplate": "%{text}<extra></extra>"} if hover else {"hoverinfo": "skip"}),
    )


def _strokes(frame: Wireframe, points: Array) -> tuple[Array, list[str]]:
    """All lines as one curve with gaps, and points that no line ends at; with the name of each."""
    gap = np.full((1, points.shape[1]), np.nan)
    lonely = set(range(len(points))) - {k for line in frame.lines for k in line}
    strokes = [*frame.lines, *((k,) for k in sorted(lonely))]
    path = np.concatenate([part for stroke in strokes for part in (points[list(stroke)], gap)])
    labels = [text for stroke in strokes for text in (*(html.escape(frame.names[k]) for k in stroke), "")]
    return path, labels


def _path_points(motion: Moving, k: int) -> Array:
    """Where every point goes over a cycle, closed, as one curve with gaps."""
    cycle = motion.paths[k]
    closed = np.concatenate([cycle, cycle[:1], np.full((1, *cycle.shape[1:]), np.nan)])
    return closed.transpose(1, 0, 2).reshape(-1, 3)


def _single(values: Array) -> NDArray[np.float32]:
    return np.asarray(values, np.float32)


def _xyz_arrays(points: Array) -> dict[str, Any]:
    return {axis: _single(points[:, k]) for k, axis in enumerate("xyz")}


def _trace(frame: Wireframe, points: Array) -> dict[str, Any]:
    return _xyz_arrays(_strokes(frame, points)[0])


def _add(
    figure: go.Figure, frame: Wireframe, points: Array, colour: str, *, width: float, name: str, hover: bool
) -> None:
    style = {"mode": "lines+markers", "line": {"color": colour, "width": width}}
    style |= {"marker": {"size": 4, "color": colour}, "name": name}
    told = {"hovertemplate": "%{text}<extra></extra>"} if hover else {"hoverinfo": "skip"}
    figure.add_scatter3d(**_trace(frame, points), text=_strokes(frame, points)[1], **told, **style)


def _add_paths(figure: go.Figure, motion: Moving, k: int) -> None:
    line = {"color": mode_colour(motion.numbers[k]), "width": 1.5}
    curve = _xyz_arrays(_path_points(motion, k))
    figure.add_scatter3d(**curve, mode="lines", line=line, name="paths", hoverinfo="skip")


def _scene(motion: Moving) -> dict[str, Any]:
    """Axes to one scale, around all that is ever drawn, seen as the stills are."""
    points = _all_points(motion)
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(1.1 * (high - low), 0.2 * (high - low).max() or 1.0)
    limits = 0.5 * (low + high) + 0.5 * np.array([-size, size])
    up = motion.frame.up
    seen = 1.1 * eye(_rest(motion), up)
    look = {"backgroundcolor": "white", "gridcolor": "#d9dee3", "showbackground": True, "zerolinecolor": "#d9dee3"}
    look |= {"tickfont": {"size": 10, "color": MUTED}, "color": INK}
    ticks = np.maximum(np.round(5 * size / size.max()), 2).astype(int)
    axes = {
        f"{letter}axis": look
        | {
            "title": {"text": f"{letter}, m", "font": {"size": 11}},
            "range": limits[:, k].tolist(),
            "nticks": int(ticks[k]),
        }
        for k, letter in enumerate("xyz")
    }
    camera = {"up": _xyz(up), "eye": _xyz(seen), "projection": {"type": "orthographic"}}
    return {"aspectmode": "manual", "aspectratio": _xyz(2.1 * size / size.max()), "camera": camera, **axes}


def _xyz(vector: Array) -> dict[str, float]:
    return dict(zip("xyz", map(float, vector), strict=True))
