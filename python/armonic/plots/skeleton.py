"""Figure of the robot itself: its skeleton in a few postures, in the base frame."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import plotly.graph_objects as go

from armonic.errors import PostureError
from armonic.plots.dataset import evenly
from armonic.plots.look import INK, MUTED, TEMPLATE
from armonic.plots.wireframe import joined_frames

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]

MAX_TRACE = 500
"""Points of the tool's path that are drawn."""

_FIRST, _LAST = np.array([0xB5, 0xD2, 0xEA]), np.array([0x0B, 0x3D, 0x6B])
_TIP = "#e4572e"


def skeleton(
    robot: Robot, postures: Array | Sequence[Any], *, shown: int = 6, names: Sequence[str] | None = None
) -> go.Figure:
    """Draw the robot as lines through the origins of its link frames, in a few postures (Do et al. 2022, Fig. 2).

    The first posture is light, the last dark; the path of the tool, or of the last frame, goes through all of them. The
    picture stands upright where gravity points down.

    Args:
        robot: a robot.
        postures: (P, n) joint coordinates or all coordinates, or a list of what `Robot.posture` takes, names too.
        shown: how many postures to draw, evenly among those given, at least one.
        names: what to call the postures, one each; by default their place from 0, or their name.

    Raises:
        PostureError: there is no posture, one does not fit the robot, or there are not as many names.
    """
    q, own = _coordinates(robot, postures)
    names = own if names is None else list(names)
    if len(names) != len(q):
        raise PostureError("names", found=str(len(names)), expected=f"one for each of {len(q)} postures")
    if shown < 1:
        raise PostureError("shown", found=str(shown), expected="at least one posture")
    kept = evenly(len(q), shown)
    origins = np.stack([_pose(robot, q[kept], name)[:, :3, 3] for name in robot.frames], axis=1)
    lines = joined_frames(robot)
    tip = _tip(robot)
    trail = _pose(robot, q[evenly(len(q), MAX_TRACE)], tip)[:, :3, 3]
    figure = go.Figure(layout={"template": TEMPLATE, "height": 520, "hovermode": "closest"})
    for k, index in enumerate(kept):
        share = k / (len(kept) - 1) if len(kept) > 1 else 1.0
        colour = "#{:02x}{:02x}{:02x}".format(*(_FIRST + share * (_LAST - _FIRST)).round().astype(int))
        name = html.escape(names[index])
        _robot(figure, robot, origins[k], lines, {"name": name, "legendgroup": name}, colour)
    if len(trail) > 1:
        line = {"color": _TIP, "width": 2.5, "dash": "dot"}
        _line(figure, trail, mode="lines", line=line, name=f"path of {html.escape(tip)}", hoverinfo="skip")
    tips = origins[:, robot.frame_index(tip)]
    marker = {"symbol": "diamond", "size": 4.5, "color": _TIP}
    hover = "%{text}<br>x %{x:.4f} m, y %{y:.4f} m, z %{z:.4f} m<extra></extra>"
    words = [f"{html.escape(tip)}, {html.escape(names[index])}" for index in kept]
    _line(figure, tips, mode="markers", marker=marker, name=html.escape(tip), text=words, hovertemplate=hover)
    size = float(np.ptp(origins.reshape(-1, 3), axis=0).max()) or 1.0
    _triad(figure, np.eye(4), 0.12 * size)
    _triad(figure, _pose(robot, q[kept[-1:]], tip)[0], 0.08 * size)
    gravity = robot.gravity
    if gravity.any():
        _gravity(figure, gravity / np.linalg.norm(gravity), 0.16 * size)
    figure.update_layout(margin={"l": 0, "r": 0, "t": 34, "b": 0}, scene=_scene(figure, origins, gravity))
    return figure


def _coordinates(robot: Robot, postures: Array | Sequence[Any]) -> tuple[Array, list[str]]:
    """All coordinates of every posture, (P, n), and what each is called."""
    expected = "postures: joint coordinates (P, n), or a list of names or joint coordinates"
    single = isinstance(postures, str | Mapping) or (isinstance(postures, np.ndarray) and postures.ndim != 2)
    if single or not hasattr(postures, "__iter__") or any(isinstance(entry, int | float) for entry in postures):
        raise PostureError("postures", found="a single posture", expected=expected, hint="Put it into a list.")
    given = list(postures)
    if not given:
        raise PostureError("postures", found="none", expected=expected)
    names = [f"posture {entry}" if isinstance(entry, str) else f"posture {k}" for k, entry in enumerate(given)]
    return np.array([robot.posture(entry) for entry in given]), names


def _pose(robot: Robot, q: Array, frame: str) -> Array:
    """Transforms base to frame, (P, 4, 4)."""
    return robot.mechanism.pose(np.ascontiguousarray(q), robot.frame_index(frame))


def _tip(robot: Robot) -> str:
    """The frame of the tool; without one, the last frame."""
    tool = getattr(robot.description, "tool", None)
    return str(tool.frame) if tool is not None else robot.frames[-1]


def _robot(
    figure: go.Figure,
    robot: Robot,
    origins: Array,
    lines: Sequence[tuple[int, int]],
    common: dict[str, Any],
    colour: str,
) -> None:
    gap = np.full(3, np.nan)
    path = np.array([point for a, b in lines for point in (origins[a], origins[b], gap)])
    labels = [html.escape(robot.frames[i]) for pair in lines for i in (*pair, 0)]
    _line(
        figure,
        path,
        mode="lines+markers",
        line={"color": colour, "width": 5},
        marker={"size": 3.2, "color": colour},
        text=labels,
        hovertemplate="%{text}<br>x %{x:.4f} m, y %{y:.4f} m, z %{z:.4f} m<extra>" + common["name"] + "</extra>",
        **common,
    )


def _triad(figure: go.Figure, pose: Array, size: float) -> None:
    for axis, (letter, colour) in enumerate(zip("xyz", ("#c0392b", "#2e8b57", "#2f5fa8"), strict=True)):
        ends = np.stack([pose[:3, 3], pose[:3, 3] + size * pose[:3, axis]])
        style = {"mode": "lines+text", "line": {"color": colour, "width": 3}, "textfont": {"size": 11, "color": colour}}
        _line(figure, ends, text=["", letter], showlegend=False, hoverinfo="skip", **style)


def _gravity(figure: go.Figure, down: Array, size: float) -> None:
    """An arrow beside the base."""
    across = np.cross(down, [0.0, 0.0, 1.0] if abs(down[2]) < 0.9 else [0.0, 1.0, 0.0])
    start = -1.2 * size * across / np.linalg.norm(across)
    ends = np.stack([start, start + size * down])
    style = {"line": {"color": MUTED, "width": 3}, "textfont": {"size": 11, "color": MUTED}}
    head = {"marker": {"size": [0, 5], "color": MUTED, "symbol": "diamond", "line": {"width": 0}}}
    text = {"text": ["gravity", ""], "textposition": "top center"}
    _line(figure, ends, mode="lines+markers+text", showlegend=False, hoverinfo="skip", **text, **style, **head)


def _line(figure: go.Figure, points: Array, **style: Any) -> None:
    figure.add_scatter3d(x=points[:, 0], y=points[:, 1], z=points[:, 2], **style)


def _scene(figure: go.Figure, origins: Array, gravity: Array) -> dict[str, Any]:
    """Axes to one scale; a camera that looks across the plane in which the robot spreads, upright against gravity."""
    drawn = np.concatenate([np.stack([trace[axis] for axis in "xyz"], axis=-1) for trace in figure.data])
    low, high = np.nanmin(drawn, axis=0), np.nanmax(drawn, axis=0)
    size = np.maximum(1.1 * (high - low), 0.2 * (high - low).max() or 1.0)
    limits = 0.5 * (low + high) + 0.5 * np.array([-size, size])
    up = -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])
    points = origins.reshape(-1, 3) - origins.reshape(-1, 3).mean(axis=0)
    level = points - np.outer(points @ up, up)
    _, _, directions = np.linalg.svd(level, full_matrices=True)
    eye = np.cross(up, directions[0])
    eye = eye / (np.linalg.norm(eye) or 1.0) + 0.35 * np.cross(up, eye) + 0.35 * up
    eye *= 1.1 / np.linalg.norm(eye)
    axis = {
        "backgroundcolor": "white",
        "gridcolor": "#d9dee3",
        "showbackground": True,
        "zerolinecolor": "#d9dee3",
        "tickfont": {"size": 10, "color": MUTED},
        "color": INK,
        "nticks": 5,
    }
    axes = {
        f"{letter}axis": axis
        | {"title": {"text": f"{letter}, m", "font": {"size": 11}}, "range": limits[:, k].tolist()}
        for k, letter in enumerate("xyz")
    }
    camera = {"up": _xyz(up), "eye": _xyz(eye), "projection": {"type": "orthographic"}}
    return {"aspectmode": "manual", "aspectratio": _xyz(1.55 * size / size.max()), "camera": camera, **axes}


def _xyz(vector: Array) -> dict[str, float]:
    return dict(zip("xyz", map(float, vector), strict=True))
