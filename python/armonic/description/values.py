"""The numbers of a robot file that a fit may change: their paths, units and bounds, and writing them back."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fnmatch import fnmatchcase
from typing import Any, Final

import numpy as np

from armonic.description.document import Document, Location, Node
from armonic.description.fields import DIRECTIONS
from armonic.description.reading import did_you_mean
from armonic.description.schema import BushingEntry, Link, RobotDescription
from armonic.description.units import Dimension, number
from armonic.errors import RobotFileError, UpdateError

GROUPS: Final = ("elasticity", "stiffness", "damping")
"""Words that stand for many parameters: all, and those of one kind."""


@dataclass(frozen=True)
class Parameter:
    """One stiffness or damping of a robot file.

    Attributes:
        path: "links.arm.elasticity.z.stiffness" or "bushings.cable.damping.rx".
        value: in SI.
        dimension: what it measures.
        bounds: lowest and highest value, if the file gives them.
        at: where the number stands, or would stand, in the file.
    """

    path: str
    value: float
    dimension: Dimension
    bounds: tuple[float, float] | None
    at: Location


def list_parameters(description: RobotDescription, data: Any) -> dict[str, Parameter]:
    """Every stiffness and damping of the file by its path: links first, then bushings, in the file's order.

    A bushing has a parameter for each direction in which it acts; of a 6x6 matrix, the diagonal.

    Args:
        description: the checked description.
        data: the plain data it was read from.

    Returns:
        The parameters.
    """
    found = [p for i, link in enumerate(description.links) for p in _of_link(i, link)]
    for i, bushing in enumerate(description.bushings):
        found += _of_bushing(i, bushing, data["bushings"][i])
    return {parameter.path: parameter for parameter in found}


def select(parameters: Mapping[str, Parameter], pattern: str | Iterable[str]) -> list[str]:
    """The paths that match a pattern, in the order of the parameters.

    Args:
        parameters: all there are, by path.
        pattern: a path, a shell pattern, one of `GROUPS`, or several, separated by commas or in a list.

    Returns:
        The matching paths, each once.

    Raises:
        UpdateError: a pattern matches nothing.
    """
    patterns = pattern.split(",") if isinstance(pattern, str) else list(pattern)
    chosen: set[str] = set()
    for one in (p.strip() for p in patterns):
        matches = [path for path, parameter in parameters.items() if _matches(parameter, one)]
        if not matches:
            raise unknown_path(one, parameters)
        chosen.update(matches)
    if not chosen:
        raise UpdateError("parameters", found="no pattern", expected="at least one pattern or path")
    return [path for path in parameters if path in chosen]


def _matches(parameter: Parameter, pattern: str) -> bool:
    if pattern in GROUPS:
        return pattern == "elasticity" or parameter.dimension.endswith(pattern)
    return fnmatchcase(parameter.path, pattern)


def unknown_path(path: str, known: Iterable[str]) -> UpdateError:
    """The error for a path or pattern that is no parameter of the robot."""
    names = list(known)
    hint = _in_full(path, names) or did_you_mean(path, names)
    if hint is None:
        hint = f"The first of {len(names)} is {names[0]}." if names else "The robot has no elasticity yet."
    return UpdateError("parameters", found=repr(path), expected="the path of a stiffness or damping", hint=hint)


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


def write(document: Document, parameters: Mapping[str, Parameter], values: Mapping[str, float | str]) -> Document:
    """A new document with other numbers; numbers that stay equal keep their text, and so does all the rest.

    Args:
        document: the text the parameters were read from.
        parameters: all parameters of the robot.
        values: new values by path, in SI or as a text with a unit.

    Returns:
        The new document.

    Raises:
        UpdateError: a path is unknown or a value is not a finite number.
        RobotFileError: the file is written in a way that leaves no place for a number that it lacks.
    """
    expected = copy.deepcopy(document.data)
    edits: list[tuple[int, int, str]] = []
    missing: dict[Location, dict[str | int, float]] = {}
    for path, given in values.items():
        if path not in parameters:
            raise unknown_path(path, parameters)
        parameter = parameters[path]
        value = _new_value(path, given, parameter.dimension)
        if value == parameter.value:
            continue
        place = _existing(document, parameter.at)
        if place is not None:
            edits.append((place.start, place.end, written(value)))
            _put(expected, parameter.at, value)
        elif parameter.at[0] == "links":
            missing.setdefault(parameter.at, {})["value"] = value
        else:
            missing.setdefault(parameter.at[:-1], {})[parameter.at[-1]] = value
    for at, entries in missing.items():
        data: float | list[float]
        if "value" in entries:
            data = entries["value"]
            text = written(data)
        else:
            data = [entries.get(i, 0.0) for i in range(len(DIRECTIONS))]
            text = f"[{', '.join(written(entry) for entry in data)}]"
        edits.append(_insertion(document, at, text))
        _put(expected, at, data)
    if not edits:
        return document
    result = document.edited(edits)
    if result.data != expected:
        where = document.where(next(iter(missing), ()))
        raise RobotFileError(where, found="an unusual layout", expected="one key per line, or a mapping in braces")
    return result


def written(value: float) -> str:
    """A number as robot files have it (20, 0.35, 5.0e6), with the fewest digits that give it back."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e5:
        return repr(value).removesuffix(".0")
    mantissa, exponent = f"{Decimal(repr(value)).normalize():e}".split("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}e{int(exponent)}"


def _of_link(i: int, link: Link) -> Iterable[Parameter]:
    for key, spring in link.elasticity.items():
        if spring is None:
            continue
        turns = link.joint.kind(key) == "revolute"
        path, at = f"links.{link.name}.elasticity.{key}", ("links", i, "elasticity", key)
        stiffness: Dimension = "rotational stiffness" if turns else "translational stiffness"
        damping: Dimension = "rotational damping" if turns else "translational damping"
        yield Parameter(f"{path}.stiffness", spring.stiffness, stiffness, spring.stiffness_bounds, (*at, "stiffness"))
        yield Parameter(f"{path}.damping", spring.damping, damping, spring.damping_bounds, (*at, "damping"))


def _of_bushing(i: int, bushing: BushingEntry, data: Mapping[str, Any]) -> Iterable[Parameter]:
    for name, matrix in (("stiffness", bushing.stiffness), ("damping", bushing.damping)):
        square = any(isinstance(row, list) for row in data.get(name, []))
        for k, direction in enumerate(DIRECTIONS):
            acts = matrix[k][k] > 0.0 or (name == "damping" and bushing.stiffness[k][k] > 0.0)
            if acts:
                at: Location = ("bushings", i, name, k, k) if square else ("bushings", i, name, k)
                dimension = _bushing_dimension(name, turns=k >= 3)
                yield Parameter(f"bushings.{bushing.name}.{name}.{direction}", matrix[k][k], dimension, None, at)


def _bushing_dimension(name: str, *, turns: bool) -> Dimension:
    if name == "stiffness":
        return "rotational stiffness" if turns else "translational stiffness"
    return "rotational damping" if turns else "translational damping"


def _new_value(path: str, given: object, dimension: Dimension) -> float:
    if isinstance(given, np.generic):
        given = given.item()
    try:
        return number(given, dimension)
    except RobotFileError as error:
        raise UpdateError(path, found=error.found, expected=error.expected, hint=error.hint) from None


def _existing(document: Document, at: Location) -> Node | None:
    parent = document.node(at[:-1])
    return parent.items.get(at[-1]) if parent is not document.node(at[:-2]) else None


def _put(data: Any, at: Location, value: Any) -> None:
    for part in at[:-1]:
        data = data[part]
    data[at[-1]] = value


def _insertion(document: Document, at: Location, text: str) -> tuple[int, int, str]:
    """An edit that adds a key behind `stiffness`, in the way the mapping is written."""
    mapping = document.node(at[:-1])
    key, value = mapping.keys["stiffness"], mapping.items["stiffness"]
    entry = f"{at[-1]}: {text}"
    if mapping.flow:
        return value.end, value.end, f", {entry}"
    line_break = re.compile(r"\r\n|\r|\n").search(document.text, value.end)
    end = line_break.start() if line_break else len(document.text)
    separator = (line_break.group() if line_break else "\n") + " " * key.column
    if value.flow:
        return end, end, f"{separator}{entry}"
    # A list in block style has no exact end, so the new key goes before it.
    return key.start, key.start, f"{entry}{separator}"
