"""The numbers of a robot file by dotted path: what they measure, their bounds, and where they stand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Final

from armonic.description.actuation import GAINS, ControlEntry
from armonic.description.document import Location
from armonic.description.fields import DIRECTIONS
from armonic.description.names import did_you_mean, feedback_dimension, motor_names, moving_links
from armonic.description.parts import InertiaTensor, Motion
from armonic.description.schema import BushingEntry, Link, RobotDescription, Tool
from armonic.description.units import Dimension
from armonic.errors import UpdateError

GROUPS: Final = ("elasticity", "stiffness", "damping")
"""Words that stand for many parameters: all that a fit may change, and those of one kind."""

_AXES: Final = ("x", "y", "z")
_WANTED: Final = "the path of a number in the robot file"
_FITTED: Final = "the path of a stiffness or damping"


@dataclass(frozen=True)
class Number:
    """One number of a robot file.

    Attributes:
        path: "links.arm.elasticity.z.stiffness", "links.arm.mass", "control.kp".
        value: in SI; that of the default where the file leaves it out.
        dimension: what it measures; None for a pure number.
        at: where it stands, or would stand, in the file.
        fits: whether a fit may change it: stiffness and damping of elasticity and bushings.
        bounds: lowest and highest value of a fit, if the file gives them.
        template: the list that it stands in where the file leaves the whole list out.
        parts: the numbers that it stands for together, such as the gains of all motors.
    """

    path: str
    value: float
    dimension: Dimension | None
    at: Location
    fits: bool = False
    bounds: tuple[float, float] | None = None
    template: tuple[float, ...] = ()
    parts: tuple[Number, ...] = ()


def list_numbers(description: RobotDescription, data: Any) -> dict[str, Number]:
    """Every number of the file that can be changed, by its path, also where the file leaves it at its default.

    Bounds, axes, postures and paths are left out. A bushing has numbers for each direction in which it acts; of a
    6x6 matrix, the diagonal.

    Args:
        description: the checked description.
        data: the plain data it was read from.

    Returns:
        The numbers: links first, then frames, bushings, tool, control and gravity.
    """
    found: list[Number] = []
    for i, link in enumerate(description.links):
        found += _of_link(link, ("links", i))
    for i, frame in enumerate(description.frames):
        found += _of_placement(f"frames.{frame.name}", frame.placement, ("frames", i))
    for i, bushing in enumerate(description.bushings):
        found += _of_bushing(i, bushing, data["bushings"][i])
    if description.tool is not None:
        found += _of_body("tool", description.tool, ("tool",))
    if description.control is not None:
        found += _of_control(description.control, moving_links(description))
    found += _of_vector("gravity", description.gravity, "acceleration", ("gravity",), (0.0, 0.0, -9.81))
    return {number.path: number for number in found}


def select(numbers: Mapping[str, Number], pattern: str | Iterable[str], *, fits: bool) -> list[str]:
    """The paths that match a pattern, in the order of the numbers.

    Args:
        numbers: all there are, by path.
        pattern: a path, a shell pattern, one of `GROUPS`, or several, separated by commas or in a list.
        fits: whether only what a fit may change is meant.

    Returns:
        The matching paths, each once.

    Raises:
        UpdateError: a pattern matches nothing.
    """
    patterns = pattern.split(",") if isinstance(pattern, str) else list(pattern)
    known = {path: number for path, number in numbers.items() if not number.parts and (number.fits or not fits)}
    chosen: set[str] = set()
    for one in (p.strip() for p in patterns):
        matches = [path for path, number in known.items() if _matches(number, one)]
        if not matches:
            raise _no_fit(one, numbers, known) if fits else unknown_path(one, numbers)
        chosen.update(matches)
    if not chosen:
        raise UpdateError("parameters", found="no pattern", expected="at least one pattern or path")
    return [path for path in known if path in chosen]


def _matches(number: Number, pattern: str) -> bool:
    if pattern in GROUPS:
        return number.fits and (pattern == "elasticity" or (number.dimension or "").endswith(pattern))
    return fnmatchcase(number.path, pattern)


def unknown_path(path: str, numbers: Mapping[str, Number]) -> UpdateError:
    """The error for a path or pattern that is no number of the robot."""
    parts = path.split(".")
    if path in numbers:
        hint: str | None = f"It stands for {', '.join(part.path for part in numbers[path].parts[:12])}."
    elif (section := _absent(parts, numbers)) is not None:
        hint = f"The file has no {section}; add it, with zeros where they are allowed."
    elif parts[0] == "control" and parts[1:2] and parts[1] in GAINS:
        whole = numbers[f"control.{parts[1]}"]
        hint = f"{whole.path} is one number for all motors; make it a list to change one of them."
        if whole.parts:
            hint = did_you_mean(path, [part.path for part in whole.parts])
    else:
        hint = _in_full(path, numbers) or did_you_mean(path, numbers)
    return UpdateError("parameters", found=repr(path), expected=_WANTED, hint=hint)


def _absent(parts: list[str], numbers: Iterable[str]) -> str | None:
    """The section of the file that a path leads into, if the file lacks it."""
    starts = {known.rpartition(".")[0] + "." for known in numbers}
    if parts[0] in ("tool", "control"):
        section = parts[0]
    elif parts[0] == "links" and len(parts) > 3 and parts[2] in ("drive", "dh"):
        link = ".".join(parts[:2]) + "."
        section = link + parts[2] if any(start.startswith(link) for start in starts) else ""
    else:
        return None
    return section if section and not any(start.startswith(section + ".") for start in starts) else None


def _no_fit(path: str, numbers: Mapping[str, Number], known: Mapping[str, Number]) -> UpdateError:
    """The error for a path or pattern that is nothing a fit may change."""
    others = [other for other in numbers if fnmatchcase(other, path)]
    if others:
        hint: str | None = f"{others[0]} can be given another value, but a fit does not change it."
    elif not known:
        hint = "The robot has no elasticity yet."
    else:
        hint = _in_full(path, known) or did_you_mean(path, known)
        hint = hint or f"The first of {len(known)} is {next(iter(known))}."
    return UpdateError("parameters", found=repr(path), expected=_FITTED, hint=hint)


def _in_full(short: str, paths: Iterable[str]) -> str | None:
    """A hint for a path with parts left out, such as "arm.z": the paths that have them all, as one pattern."""

    def has_all(path: str) -> bool:
        parts = iter(path.split("."))
        return all(any(fnmatchcase(part, word) for part in parts) for word in short.split("."))

    found = [path.split(".") for path in paths if has_all(path)]
    if not found:
        return None
    alike = [parts for parts in found if len(parts) == len(found[0])]
    pattern = (column[0] if len(set(column)) == 1 else "*" for column in zip(*alike, strict=True))
    return f"Did you mean {'.'.join(pattern)}?"


def _of_link(link: Link, at: Location) -> Iterator[Number]:
    path = f"links.{link.name}"
    if link.dh is None:
        yield from _of_placement(path, link.placement, at)
    else:
        for key in ("theta", "d", "a", "alpha"):
            angle = key in ("theta", "alpha")
            yield Number(f"{path}.dh.{key}", getattr(link.dh, key), "angle" if angle else "length", (*at, "dh", key))
    for key, spring in link.elasticity.items():
        if spring is not None:
            turns, of, place = link.joint.kind(key) == "revolute", f"{path}.elasticity.{key}", (*at, "elasticity", key)
            stiffness, damping = _dimensions(turns=turns)
            bounds = spring.stiffness_bounds, spring.damping_bounds
            yield Number(f"{of}.stiffness", spring.stiffness, stiffness, (*place, "stiffness"), True, bounds[0])
            yield Number(f"{of}.damping", spring.damping, damping, (*place, "damping"), True, bounds[1])
    if link.drive is not None:
        dimensions: dict[str, Dimension | None] = {
            "gear_ratio": None,
            "rotor_inertia": "inertia",
            "shaft_stiffness": "rotational stiffness",
            "motor_damping": "rotational damping",
            "joint_damping": _dimensions(turns=link.joint.type == "revolute")[1],
        }
        if link.drive.radius is not None:
            dimensions["radius"] = "length"
        for key, dimension in dimensions.items():
            yield Number(f"{path}.drive.{key}", getattr(link.drive, key), dimension, (*at, "drive", key))
    yield from _of_body(path, link, at)


def _of_placement(path: str, motions: Iterable[Motion], at: Location) -> Iterator[Number]:
    for i, motion in enumerate(motions):
        shifts = all(getattr(motion, key) is None for key in ("rx", "ry", "rz"))
        for key in DIRECTIONS:
            value = getattr(motion, key)
            if value is not None or (shifts and key in _AXES):
                dimension: Dimension = "length" if key in _AXES else "angle"
                yield Number(f"{path}.placement.{i}.{key}", value or 0.0, dimension, (*at, "placement", i, key))


def _of_body(path: str, body: Link | Tool, at: Location) -> Iterator[Number]:
    yield Number(f"{path}.mass", body.mass, "mass", (*at, "mass"))
    yield from _of_vector(f"{path}.com", body.com, "length", (*at, "com"), (0.0, 0.0, 0.0))
    for key in InertiaTensor.model_fields:
        yield Number(f"{path}.inertia.{key}", getattr(body.inertia, key), "inertia", (*at, "inertia", key))


def _of_vector(
    path: str, values: Iterable[float], dimension: Dimension, at: Location, template: tuple[float, ...]
) -> Iterator[Number]:
    for k, (axis, value) in enumerate(zip(_AXES, values, strict=True)):
        yield Number(f"{path}.{axis}", value, dimension, (*at, k), template=template)


def _of_bushing(i: int, bushing: BushingEntry, data: Mapping[str, Any]) -> Iterator[Number]:
    for name, matrix in (("stiffness", bushing.stiffness), ("damping", bushing.damping)):
        square = any(isinstance(row, list) for row in data.get(name, []))
        for k, direction in enumerate(DIRECTIONS):
            acts = matrix[k][k] > 0.0 or (name == "damping" and bushing.stiffness[k][k] > 0.0)
            if acts:
                at: Location = ("bushings", i, name, k, k) if square else ("bushings", i, name, k)
                dimension = _dimensions(turns=k >= 3)[0 if name == "stiffness" else 1]
                path = f"bushings.{bushing.name}.{name}.{direction}"
                yield Number(path, matrix[k][k], dimension, at, fits=True, template=(0.0,) * 6)


def _of_control(control: ControlEntry, moving: Iterable[Link]) -> Iterator[Number]:
    driven = [link for link in moving if link.drive is not None]
    for key, dimension in GAINS.items():
        gain, path, at = getattr(control, key), f"control.{key}", ("control", key)
        if not isinstance(gain, tuple):
            yield Number(path, gain, dimension, at)
            continue
        pairs = enumerate(zip(driven, gain, strict=True))
        parts = tuple(Number(f"{path}.{link.name}", value, dimension, (*at, i)) for i, (link, value) in pairs)
        yield from parts
        yield Number(path, gain[0] if len(set(gain)) == 1 else math.nan, dimension, at, parts=parts)
    columns = [f"{link.name}.{link.joint.own}" for link in driven] + motor_names(driven)
    for key in control.state_feedback.given:
        for i, row in enumerate(getattr(control.state_feedback, key)):
            for j, value in enumerate(row):
                path = f"control.state_feedback.{key}.{driven[i].name}.{columns[j]}"
                yield Number(path, value, feedback_dimension(key, driven, j), ("control", "state_feedback", key, i, j))


def _dimensions(*, turns: bool) -> tuple[Dimension, Dimension]:
    """What the stiffness and the damping of a coordinate measure."""
    if turns:
        return "rotational stiffness", "rotational damping"
    return "translational stiffness", "translational damping"
