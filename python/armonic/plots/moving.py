"""How points move in a mode: the whole robot in a mode of a model, its measured points in an identified one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.comparison import mode_table
from armonic.errors import SignalError
from armonic.frf_set import split_label
from armonic.modal import Modes
from armonic.plots.wireframe import Wireframe, frame_poses, robot_wireframe, upward
from armonic.text import format_hz, format_percent, listing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.files.measured_file import Geometry
    from armonic.linear import Posture
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

MOST_TURN = 0.35
"""No coordinate turns farther, rad: a mode that turns a link on the spot moves no point."""
_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class Moving:
    """Modes as motions of a wireframe, large enough to be seen.

    Attributes:
        frame: what moves, at rest.
        backdrop: what does not, at rest, or None.
        numbers: of the modes, counted from 1.
        headings: of the modes: frequency and damping.
        paths: where every point is over one cycle, (modes, phases, points, 3), m; it begins where the motion is largest
            and does not come back to it.
        missing: places of measured degrees of freedom that have no position, or no known motion.
    """

    frame: Wireframe
    backdrop: Wireframe | None
    numbers: tuple[int, ...]
    headings: tuple[str, ...]
    paths: Array
    missing: tuple[str, ...] = ()


def moving(
    robot: Robot | None,
    posture: Posture | None,
    shapes: Any,
    *,
    select: Sequence[int] | None = None,
    geometry: Geometry | None = None,
    share: float = 0.1,
    phases: int = 24,
) -> Moving:
    """Motions x(t) = Re(φ e^{iωt}) of the modes, undamped, each scaled to the same largest deflection.

    Args:
        robot: the robot; without one, measured points have the positions of `geometry` and its axes.
        posture: where it stands, as `Robot.posture` takes it; not used with `Modes` of the robot at a named posture.
        shapes: `Modes` of the robot, in which all of it moves; or what `armonic.compare` takes with shapes over
            PLACE.AXIS, x y z along the axes of the frame of that name, in which those points move.
        select: modes, counted from 1; by default all that oscillate and have a shape.
        geometry: positions of places that are no frames of the robot, in its base frame, and lines.
        share: largest deflection, as a share of the robot's size.
        phases: how many pictures one cycle has.

    Raises:
        SignalError: no mode to draw, one that is not there or has no shape, or no degree of freedom with a position.
        PostureError: the posture does not fit the robot.
    """
    if isinstance(shapes, Modes):
        if robot is None:
            raise SignalError("robot", found="None", expected="the robot whose modes these are")
        known = np.asarray(shapes.oscillatory, bool)
        chosen = _selected(select, known)
        return _of_robot(robot, _coordinates(robot, posture, shapes.posture), shapes, chosen, share, phases)
    table = mode_table(shapes, "shapes")
    if table.shapes is None or table.coordinates is None:
        raise SignalError("shapes", found="modes without shapes", expected="shapes over PLACE.AXIS")
    there = np.isfinite(table.shapes)
    chosen = _selected(select, there.any(axis=1) & np.asarray(table.poles.imag > 0))
    rows = [k - 1 for k in chosen]
    columns = np.flatnonzero(there[rows].all(axis=0))
    labels = [table.coordinates[d] for d in columns]
    back = None if robot is None else robot_wireframe(robot, _coordinates(robot, posture, ""))
    frame, directions = _measured_points(robot, posture, labels, geometry)
    missing = tuple(dict.fromkeys(place for place, _ in map(split_label, table.coordinates)))
    missing = tuple(place for place in missing if place not in frame.names)
    # Row d of a place's matrix is the direction of its degree of freedom d, so that their sum is the motion.
    motion = np.einsum("md,dkx->mkx", table.shapes[rows][:, columns], directions)
    size = max(frame.size if len(frame.names) > 1 else 0.0, back.size if back is not None else 0.0) or 1.0
    paths = frame.points + _cycle(motion, share * size, phases)
    heads = tuple(_heading(k, table.natural_freq_hz[k - 1], table.damping_ratio[k - 1]) for k in chosen)
    return Moving(frame, back, tuple(chosen), heads, paths, missing)


def _selected(select: Sequence[int] | None, known: NDArray[np.bool_]) -> list[int]:
    """Numbers of the modes to draw, from 1."""
    there = [int(k) + 1 for k in np.flatnonzero(known)]
    chosen = there if select is None else [int(k) for k in select]
    wrong = [k for k in chosen if k not in there]
    if wrong or not chosen:
        found = f"mode {wrong[0]}" if wrong else "no mode"
        expected = f"modes that oscillate and have a shape: {listing([str(k) for k in there]) or 'there are none'}"
        raise SignalError("select", found=found, expected=expected)
    return chosen


def _coordinates(robot: Robot, posture: Posture | None, named: str) -> Array:
    if posture is None and named in robot.postures:
        posture = named
    if posture is None and len(robot.postures) == 1:
        posture = next(iter(robot.postures))
    return robot.posture({} if posture is None else posture)


def _of_robot(robot: Robot, q: Array, modes: Modes, chosen: list[int], share: float, phases: int) -> Moving:
    """The whole robot, by its kinematics: links keep their length however far it swings."""
    frame = robot_wireframe(robot, q)
    own = [(i, robot.coordinates.index(name)) for i, name in enumerate(modes.coordinates) if name in robot.coordinates]
    shapes = np.zeros((len(chosen), len(q)), np.complex128)
    rows, columns = [i for i, _ in own], [k for _, k in own]
    shapes[:, columns] = modes.shapes[np.ix_(rows, [k - 1 for k in chosen])].T
    jacobians = np.stack([robot.mechanism.jacobian(q, k) for k in range(len(robot.frames))])
    travel = np.einsum("kxn,mn->mkx", jacobians[:, :3], shapes)
    turning = np.array([kind == "revolute" for kind in robot.tree.kinds if kind != "fixed"])
    turn = np.abs(np.where(turning, shapes, 0.0)).max(axis=1)
    reach = _largest(travel)
    with np.errstate(divide="ignore"):
        scale = np.minimum(share * frame.size / reach, MOST_TURN / turn)
    scale = np.where(np.isfinite(scale), scale, 0.0)
    # The phase of the points, not that of the coordinates, decides where a cycle begins.
    turned = shapes * (scale * _toward_real(travel))[:, None]
    angles = np.exp(2j * np.pi * np.arange(phases) / phases)
    moved = q + np.real(angles[None, :, None] * turned[:, None, :])
    paths = frame_poses(robot, moved.reshape(-1, len(q)))[:, :, :3, 3].reshape(len(chosen), phases, -1, 3)
    heads = tuple(_heading(k, modes.natural_freq_hz[k - 1], modes.damping_ratio[k - 1]) for k in chosen)
    return Moving(frame, frame, tuple(chosen), heads, paths)


def _measured_points(
    robot: Robot | None, posture: Posture | None, labels: Sequence[str], geometry: Geometry | None
) -> tuple[Wireframe, Array]:
    """Points with a position, and the direction of every degree of freedom at its point, (d, k, 3)."""
    places = list(dict.fromkeys(split_label(label)[0] for label in labels if split_label(label)[1] in _AXES))
    frames = () if robot is None else robot.frames
    poses = np.zeros((0, 4, 4))
    if robot is not None:
        poses = frame_poses(robot, _coordinates(robot, posture, "")[None])[0]
    given = {} if geometry is None else dict(zip(geometry.names, geometry.positions, strict=True))
    there = [place for place in places if place in frames or place in given]
    if not there:
        found = f"degrees of freedom at {listing(places) or 'no place'}"
        expected = "x, y or z at frames of the robot, or at points of the geometry"
        raise SignalError("shapes", found=found, expected=expected)
    points, directions = np.zeros((len(there), 3)), np.zeros((len(labels), len(there), 3))
    for k, place in enumerate(there):
        own = poses[frames.index(place)] if place in frames else np.eye(4)
        points[k] = own[:3, 3] if place in frames else given[place]
        for d, label in enumerate(labels):
            at, axis = split_label(label)
            if at == place and axis in _AXES:
                directions[d, k] = own[:3, _AXES.index(axis)]
    wire = Wireframe(tuple(there), points, _lines(robot, there, geometry), upward(robot))
    return wire, directions


def _lines(robot: Robot | None, places: list[str], geometry: Geometry | None) -> tuple[tuple[int, int], ...]:
    """The lines of the geometry between these places; without any, along the links of the robot."""
    if geometry is not None and geometry.lines:
        named = [(geometry.names[a], geometry.names[b]) for a, b in geometry.lines]
        return tuple((places.index(a), places.index(b)) for a, b in named if a in places and b in places)
    along = [] if robot is None else [places.index(name) for name in robot.frames if name in places]
    return tuple(pairwise(along))


def _cycle(motion: Complex, largest: float, phases: int) -> Array:
    """Displacements over a cycle, (modes, phases, points, 3), of motions (modes, points, 3)."""
    reach = _largest(motion)
    scale = np.divide(largest, reach, out=np.zeros(len(reach)), where=reach > 0) * _toward_real(motion)
    angles = np.exp(2j * np.pi * np.arange(phases) / phases)
    return np.real(angles[None, :, None, None] * (scale[:, None, None] * motion)[:, None])


def _largest(motion: Complex) -> Array:
    """Largest deflection of any point over a cycle, (modes,): half the long axis of its ellipse."""
    square = np.sum(motion * motion, axis=2)
    both = np.sum(np.abs(motion) ** 2, axis=2) + np.abs(square)
    return np.asarray(np.sqrt(both.max(axis=1, initial=0.0) / 2))


def _toward_real(motion: Complex) -> Complex:
    """Factor of size one, (modes,), after which the real part is as large as it gets."""
    return np.asarray(np.exp(-0.5j * np.angle(np.sum(motion * motion, axis=(1, 2)))))


def _heading(number: int, freq_hz: float, damping: float) -> str:
    return f"<b>{number}</b>  {format_hz(float(freq_hz))} Hz, {format_percent(float(damping))}"
