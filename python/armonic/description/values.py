"""Numbers written into the text of a robot file, with all else in it left as it was."""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

import numpy as np

from armonic.description.document import Document, Location, Node
from armonic.description.numbers import Number, unknown_path
from armonic.description.units import Dimension, number
from armonic.errors import RobotFileError, UpdateError

_AFTER = {"damping": "stiffness", "gravity": "name"}
"""Behind which other key a key is added; others go last."""


def write(document: Document, numbers: Mapping[str, Number], values: Mapping[str, float | str]) -> Document:
    """A new document with other numbers; numbers that stay equal keep their text, and so does all the rest.

    Args:
        document: the text the numbers were read from.
        numbers: all numbers of the robot.
        values: new values by path, in SI or as a text with a unit.

    Returns:
        The new document.

    Raises:
        UpdateError: a path is unknown or a value is not a finite number.
        RobotFileError: the file is written in a way that leaves no place for a number that it lacks.
    """
    data = document.data
    changed: dict[Location, float] = {}
    missing: dict[Location, None] = {}
    for path, given in values.items():
        if path not in numbers:
            raise unknown_path(path, numbers)
        value = _new_value(path, given, numbers[path].dimension)
        for part in numbers[path].parts or (numbers[path],):
            if value == part.value and part.at not in changed:
                continue
            data = _put(data, part.at, value, part.template)
            changed[part.at] = value
    edits: list[tuple[int, int, str]] = []
    for at, value in changed.items():
        known = _known(document.data, at)
        if known == at:
            place = document.node(at)
            edits.append((place.start, place.end, written(value)))
        else:
            missing[at[: len(known) + 1]] = None
    by_mapping: dict[Location, list[str]] = {}
    for at in missing:
        by_mapping.setdefault(at[:-1], []).append(str(at[-1]))
    for mapping, keys in by_mapping.items():
        edits += _additions(document, document.node(mapping), {key: _at(data, (*mapping, key)) for key in keys})
    if not edits:
        return document
    added = frozenset(missing)
    if added and added not in document.tried:
        # Where a number is only replaced, the text cannot come to hold anything else; an added key might.
        try:
            fits = document.edited(edits).data == data
        except RobotFileError:
            fits = False
        if not fits:
            where = document.where(next(iter(missing)))
            raise RobotFileError(where, found="an unusual layout", expected="one key per line, or a mapping in braces")
        document.tried.add(added)
    return document.edited_into(data, edits)


def written(value: float) -> str:
    """A number as robot files have it (20, 0.35, 5.0e6), with the fewest digits that give it back."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e5:
        return repr(value).removesuffix(".0")
    mantissa, exponent = f"{Decimal(repr(value)).normalize():e}".split("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}e{int(exponent)}"


def _new_value(path: str, given: object, dimension: Dimension | None) -> float:
    if isinstance(given, np.generic):
        given = given.item()
    try:
        return number(given, dimension)
    except RobotFileError as error:
        raise UpdateError(path, found=error.found, expected=error.expected, hint=error.hint) from None


def _known(data: Any, at: Location) -> Location:
    """The part of a location that exists in the data."""
    for i, part in enumerate(at):
        if part not in (data if isinstance(data, dict) else range(len(data))):
            return at[:i]
        data = data[part]
    return at


def _at(data: Any, at: Location) -> Any:
    for part in at:
        data = data[part]
    return data


def _put(data: Any, at: Location, value: float, template: tuple[float, ...]) -> Any:
    """The data with another value at a location, copied along the way to it."""
    if not at:
        return value
    copied = data.copy()
    part: Any = at[0]
    if isinstance(data, list) or part in data:
        inner = data[part]
    else:
        inner = list(template) if at[1:] and isinstance(at[1], int) else {}
    copied[part] = _put(inner, at[1:], value, template)
    return copied


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_flow(entry)}' for key, entry in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(_flow(entry) for entry in value)}]"
    return written(value)


def _additions(document: Document, mapping: Node, added: Mapping[str, Any]) -> list[tuple[int, int, str]]:
    """Edits that add keys to a mapping, in the way it is written."""
    if not mapping.items:
        return [(mapping.start + 1, mapping.end - 1, _flow(added)[1:-1])]
    edits: dict[int, str] = {}
    for name, value in added.items():
        entry = f"{name}: {_flow(value)}"
        start, text = _addition(document, mapping, _AFTER.get(name, ""), entry)
        edits[start] = edits.get(start, "") + text
    return [(start, start, text) for start, text in edits.items()]


def _addition(document: Document, mapping: Node, behind: str, entry: str) -> tuple[int, str]:
    if behind not in mapping.items:
        # A collection in block style has no exact end, so one that is written in a line is preferred.
        behind = next((name for name in reversed(mapping.keys) if mapping.items[name].flow), next(iter(mapping.keys)))
    key, value = mapping.keys[behind], mapping.items[behind]
    if mapping.flow:
        return value.end, f", {entry}"
    line_break = re.compile(r"\r\n|\r|\n").search(document.text, value.end)
    end = line_break.start() if line_break else len(document.text)
    separator = (line_break.group() if line_break else "\n") + " " * key.column
    return (end, f"{separator}{entry}") if value.flow else (key.start, f"{entry}{separator}")
