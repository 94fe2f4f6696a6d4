"""What might be measured next: a posture, where the sensor sits, where the force acts, along which axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import ArmonicError, UpdateError
from armonic.synthesis import AXES

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot
    from armonic.surveying import Grid, Sample

    Array: TypeAlias = NDArray[np.float64]
    Postures: TypeAlias = str | Grid | Sample | Array | Sequence[Any]

MOST = 20_000
"""More candidates than this are a mistake: each costs about a millisecond."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A measurement that could be made: the responses of one sensor in one posture.

    Args:
        posture: name of the robot's posture, or joint coordinates (rad, m).
        frame: the sensor's frame on the robot.
        outputs: axes of the response among x y z rx ry rz, of the sensor's frame.
        inputs: axes of the force (x y z) or moment (rx ry rz).
        input_frame: where the force acts, if elsewhere than at the sensor.
        freq_hz: its lines, (L,), Hz; those of the plan if not given.
        label: a name for tables and sentences.

    Raises:
        UpdateError: axes that are none, or lines that are not rising frequencies.
    """

    posture: Posture
    frame: str
    outputs: tuple[str, ...] = ("x", "y", "z")
    inputs: tuple[str, ...] = ("x", "y", "z")
    input_frame: str | None = None
    freq_hz: ArrayLike | None = None
    label: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "label", self.label or _shown(self.posture))
        for name in ("outputs", "inputs"):
            object.__setattr__(self, name, axes_of(f"candidate {self.label}, {name}", getattr(self, name)))
        if self.freq_hz is not None:
            object.__setattr__(self, "freq_hz", lines_of(f"candidate {self.label}, freq_hz", self.freq_hz))


def candidates(
    robot: Robot,
    postures: Postures,
    *,
    frames: str | Iterable[str] | None = None,
    impacts: str | Iterable[str] | None = None,
    outputs: Iterable[str] = ("x", "y", "z"),
    inputs: Iterable[str] = ("x", "y", "z"),
    each_input: bool = False,
    freq_hz: ArrayLike | None = None,
) -> tuple[Candidate, ...]:
    """Candidates in every posture, for every sensor, every impact point and, on request, every direction of force.

    Args:
        robot: the robot.
        postures: the name of a posture or of a path in the robot file; a list of postures, by name or coordinates; an
            array (P, n) or (P, joints); a `Grid` or a `Sample` of the workspace, as for `survey`.
        frames: the sensor's frame, or several; by default the only one that the robot file defines.
        impacts: frames where the force acts; by default that of the sensor.
        outputs: axes of the response.
        inputs: axes of the force.
        each_input: one candidate per axis of the force, as for a hammer that hits along one axis at a time.
        freq_hz: lines of all candidates, (L,), Hz; by default those of the plan.

    Returns:
        The candidates: postures vary slowest, then sensors, impact points and directions.

    Raises:
        UpdateError: names, axes, lines or coordinates that do not fit, or too many candidates.
        SurveyError: a grid or sample that does not fit the robot.
    """
    places = _places(robot, postures)
    sensors = _frames(robot, "frames", frames)
    hit = (None,) if impacts is None else _frames(robot, "impacts", impacts)
    across, along = axes_of("outputs", outputs), axes_of("inputs", inputs)
    forces = tuple((axis,) for axis in along) if each_input else (along,)
    if (count := len(places) * len(sensors) * len(hit) * len(forces)) > MOST:
        raise UpdateError("candidates", found=f"{count} of them", expected=f"at most {MOST}")
    lines = None if freq_hz is None else lines_of("freq_hz", freq_hz)

    def label(place: str, sensor: str, impact: str | None, force: tuple[str, ...]) -> str:
        told = [f"at {sensor}"] if len(sensors) > 1 else []
        told += [f"force at {impact}"] if len(hit) > 1 else []
        told += [f"force along {force[0]}"] if len(forces) > 1 else []
        return ", ".join([place, *told])

    return tuple(
        Candidate(
            posture,
            sensor,
            across,
            force,
            None if impact == sensor else impact,
            lines,
            label(place, sensor, impact, force),
        )
        for posture, place in places
        for sensor in sensors
        for impact in hit
        for force in forces
    )


def axes_of(where: str, axes: Any) -> tuple[str, ...]:
    """Different axes of a frame, in a tuple.

    Raises:
        UpdateError: they are none.
    """
    found = tuple(axes) if isinstance(axes, Iterable) else ()
    if not found or len(set(found)) < len(found) or not set(found) <= set(AXES):
        raise UpdateError(where, found=f"{axes!r:.60}", expected=f"different axes among {' '.join(AXES)}")
    return found


def lines_of(where: str, freq_hz: Any) -> Array:
    """Frequency lines, (L,), read-only.

    Raises:
        UpdateError: they are no rising frequencies.
    """
    try:
        lines = np.array(freq_hz, float)
    except (TypeError, ValueError):
        lines = np.array(np.nan)
    if lines.ndim != 1 or not lines.size or not np.isfinite(lines).all() or lines[0] < 0 or (np.diff(lines) <= 0).any():
        raise UpdateError(where, found=f"{freq_hz!r:.60}", expected="rising frequencies in Hz, at least one")
    lines.flags.writeable = False
    return lines


def posture_label(robot: Robot, q: Array) -> str:
    """A posture as the command line reads it: "12.5deg,70deg,-100deg", or coordinate by coordinate where it must."""
    joints = [robot.coordinates.index(name) for name in robot.joint_coordinates]
    shown = joints if not np.delete(q, joints).any() else list(range(len(q)))
    kinds = [kind for kind in robot.tree.kinds if kind != "fixed"]
    scale = {True: (180 / np.pi, "deg"), False: (1000.0, "mm")}
    parts = ((*scale[kinds[i] == "revolute"], float(q[i])) for i in shown)
    return ",".join(f"{round(factor * value, 1) + 0.0:g}{unit}" for factor, unit, value in parts)


def _places(robot: Robot, postures: Any) -> list[tuple[Posture, str]]:
    """Postures with what to call them.

    Raises:
        UpdateError: one does not fit the robot.
        SurveyError: a grid or sample does not.
    """
    from armonic.surveying.walk import Grid, Sample, walk_of

    if isinstance(postures, Grid | Sample) or (isinstance(postures, str) and postures in robot.paths):
        walk = walk_of(robot, postures, None)
        if walk.count > MOST:
            raise UpdateError("candidates", found=f"{walk.count} postures", expected=f"at most {MOST}")
        return [(q, posture_label(robot, q)) for q in walk.rows_and_postures(np.arange(walk.count))[1]]
    one = isinstance(postures, str | Mapping) or not _is_list(postures)
    listed = [postures] if one else list(postures)
    if not listed:
        raise UpdateError("candidates", found="none", expected="at least one posture")
    found: list[tuple[Posture, str]] = []
    for i, posture in enumerate(listed):
        try:
            q = robot.posture(posture)
        except ArmonicError as error:
            where = f"candidate {i + 1} of {len(listed)}"
            raise UpdateError(where, found=error.found, expected=error.expected, hint=error.hint) from None
        found.append((posture, posture) if isinstance(posture, str) else (q, posture_label(robot, q)))
    return found


def _is_list(postures: Any) -> bool:
    """Whether there are several postures, and not the numbers of one."""
    if isinstance(postures, np.ndarray):
        return postures.ndim != 1
    return not all(isinstance(entry, int | float | np.number) for entry in postures) or not len(postures)


def _frames(robot: Robot, where: str, names: str | Iterable[str] | None) -> tuple[str, ...]:
    if names is None:
        defined = tuple(frame.name for frame in robot.description.frames)
        if len(defined) == 1:
            return defined
        expected = f"one of {', '.join(defined or robot.frames)}"
        raise UpdateError(where, found="no frame", expected=expected, hint="Say where the sensor sits.")
    found = (names,) if isinstance(names, str) else tuple(names)
    unknown = [name for name in found if name not in robot.frames]
    if unknown or not found or len(set(found)) < len(found):
        shown = repr(unknown[0]) if unknown else f"{found!r:.60}"
        raise UpdateError(where, found=shown, expected=f"different ones of the robot's: {', '.join(robot.frames)}")
    return found


def _shown(posture: Any) -> str:
    if isinstance(posture, str):
        return posture
    if isinstance(posture, Mapping):
        return ", ".join(f"{name} = {value}" for name, value in posture.items())
    return ", ".join(f"{value:.4g}" if isinstance(value, float) else str(value) for value in np.atleast_1d(posture))
