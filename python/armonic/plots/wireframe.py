"""The robot as points and the lines that join them, and from where it is looked at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]

ASIDE, ABOVE = -0.5, 0.45
"""How far a view is turned aside and raised, against one straight across: motion toward the eye is seen as well."""


@dataclass(frozen=True, eq=False)
class Wireframe:
    """Points and lines.

    Attributes:
        names: of the points, (k,).
        points: where they are, (k, 3), m, in the base frame.
        lines: pairs of indices of points.
        up: unit vector that points up, (3,).
    """

    names: tuple[str, ...]
    points: Array
    lines: tuple[tuple[int, int], ...]
    up: Array

    @property
    def size(self) -> float:
        """Longest edge of the box around all points, m; 1 for a single point."""
        return float(np.ptp(self.points, axis=0).max()) or 1.0


def robot_wireframe(robot: Robot, q: Array) -> Wireframe:
    """The frames of a robot at a posture; each link is joined with the one it hangs on, each frame with its link.

    Args:
        robot: a robot.
        q: all its coordinates, (n,).
    """
    points = frame_poses(robot, q[None])[0, :, :3, 3]
    return Wireframe(robot.frames, points, joined_frames(robot), upward(robot))


def frame_poses(robot: Robot, q: Array) -> Array:
    """Transforms base to frame of all frames, (P, frames, 4, 4), for coordinates (P, n)."""
    rows = np.ascontiguousarray(q)
    return np.stack([robot.mechanism.pose(rows, k) for k in range(len(robot.frames))], axis=1)


def upward(robot: Robot | None) -> Array:
    """Against gravity; z where there is none."""
    gravity = np.zeros(3) if robot is None else robot.gravity
    return -gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, 1.0])


def eye(points: Array, up: Array) -> Array:
    """From where to look: across the plane in which points spread, a little from aside and above; unit vector, (3,)."""
    centred = points - points.mean(axis=0)
    level = centred - np.outer(centred @ up, up)
    _, spread, directions = np.linalg.svd(level, full_matrices=True)
    # Points above one another spread nowhere; any level direction does.
    along = directions[0] if spread[0] > 1e-9 else np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    along = along * np.sign(along[np.argmax(np.abs(along))])
    across = np.cross(along, up)
    across /= np.linalg.norm(across)
    seen = across + ASIDE * np.cross(across, up) + ABOVE * up
    return np.asarray(seen / np.linalg.norm(seen), np.float64)


def picture_axes(seen_from: Array, up: Array) -> Array:
    """Directions to the right and upward in a picture seen from there, (2, 3)."""
    right = np.cross(up, seen_from)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(seen_from, right)])


def joined_frames(robot: Robot) -> tuple[tuple[int, int], ...]:
    """Pairs of frames to join, by index: each link with the one it hangs on, each frame of the file with its link."""
    tree = robot.tree
    owner = {-1: 0}
    for frame, node in enumerate(tree.frame_nodes):
        owner.setdefault(node, frame)
    pairs = []
    for frame, node in enumerate(tree.frame_nodes):
        if frame == 0:
            continue
        above = tree.parents[node] if owner[node] == frame else node
        while above not in owner:
            above = tree.parents[above]
        pairs.append((owner[above], frame))
    return tuple(pairs)
