"""One entry of a channel map: from the words of a file to what they mean, every one checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from armonic.description.names import did_you_mean
from armonic.errors import DataFileError
from armonic.files.cells import AXES
from armonic.files.sampling import plain
from armonic.files.si_units import si_unit
from armonic.files.uff_reader import shown
from armonic.series import QUANTITIES, Quantity

KEYS = ("channel", "node", "direction", "place", "axis", "rotate", "quantity", "unit", "scale")
"""All keys of an entry."""
_AS_THEY_ARE = {code: code for code in range(1, len(AXES) + 1)}
_AXIS = "an axis x, y, z, rx, ry or rz, with a sign or without"
_Place = Callable[[str], str]


@dataclass(frozen=True)
class Entry:
    """What a map says of one channel or node; direction and axis are codes ±1 to ±6 for x y z rx ry rz.

    Attributes:
        place: where it is.
        channel: the name it is for, or None.
        node: the node it is for, or None.
        direction: the direction of the node it is for; None for all.
        axis: along which axis of the place the channel, or that direction, runs.
        turns: of a whole node, the axis of the place for each of its own.
        quantity: what it holds; None if that is not said.
        unit: the SI unit after scaling; None if no unit is said.
        scale: factor to SI.
        line: where the entry begins.
    """

    place: str
    channel: str | None = None
    node: int | None = None
    direction: int | None = None
    axis: int = 1
    turns: Mapping[int, int] = field(default_factory=lambda: dict(_AS_THEY_ARE))
    quantity: Quantity | None = None
    unit: str | None = None
    scale: float = 1.0
    line: int = 0

    @property
    def source(self) -> str:
        """What the entry is for, in words."""
        if self.node is None:
            return f"channel {self.channel!r}"
        return f"node {self.node}" + (f" along {AXES[abs(self.direction) - 1]}" if self.direction else "")

    def axis_of(self, direction: int) -> int:
        """The signed axis of the place along which a channel runs that has this direction at its node."""
        if self.node is None:
            return self.axis
        sign = 1 if direction > 0 else -1
        if self.direction is None:
            return sign * self.turns[abs(direction)]
        return sign * self.axis if self.direction > 0 else -sign * self.axis

    def overlaps(self, other: Entry) -> bool:
        """Whether a channel may be meant by both."""
        if None not in (self.quantity, other.quantity) and self.quantity != other.quantity:
            return False
        if self.node is None or other.node is None:
            return self.node is other.node and self.channel == other.channel
        alike = None in (self.direction, other.direction) or abs(self.direction or 0) == abs(other.direction or 0)
        return self.node == other.node and alike


def entry(fields: Mapping[str, object], where: _Place, line: int) -> Entry:
    """An entry from its fields as a file has them.

    Args:
        fields: by key; empty text and None count as missing.
        where: from a key, or "" for the entry, to its place for errors.
        line: where the entry begins.

    Raises:
        DataFileError: a key is unknown, or the fields make no sense.
    """
    for key in fields:
        if key not in KEYS:
            hint = did_you_mean(str(key), KEYS)
            found = f"the unknown key {shown(str(key))}"
            raise DataFileError(where(str(key)), found=found, expected=f"one of {', '.join(KEYS)}", hint=hint)
    given = {key: value for key, value in fields.items() if value is not None and value != ""}
    if ("channel" in given) == ("node" in given):
        found = "both channel and node" if "node" in given else "neither channel nor node"
        raise DataFileError(where(""), found=found, expected="one of them")
    if "place" not in given:
        raise DataFileError(where(""), found="no place", expected="the name of a frame of the robot, or of a point")
    node = _node(given["node"], where) if "node" in given else None
    _refuse_misplaced(given, where)
    scale, unit = _scale(given, where)
    direction = _axis(given["direction"], where("direction")) if "direction" in given else None
    axis = _axis(given["axis"], where("axis")) if "axis" in given else abs(direction or 1)
    if direction is not None and "axis" not in given:
        axis = direction
    if direction is not None and (abs(direction) > 3) != (abs(axis) > 3):
        found = f"the direction {given['direction']} along the axis {given['axis']}"
        raise DataFileError(where("axis"), found=found, expected="both translations, or both rotations")
    return Entry(
        place=_word(given["place"], where("place")),
        channel=_word(given["channel"], where("channel")) if "channel" in given else None,
        node=node,
        direction=direction,
        axis=axis,
        turns=_turns(given["rotate"], where("rotate")) if "rotate" in given else dict(_AS_THEY_ARE),
        quantity=_quantity(given.get("quantity"), where("quantity")),
        unit=unit,
        scale=scale,
        line=line,
    )


def _refuse_misplaced(given: Mapping[str, object], where: _Place) -> None:
    """Refuse keys that do not go together."""
    whole = "node" in given and "direction" not in given
    if "direction" in given and "channel" in given:
        raise DataFileError(where("direction"), found="the direction of a channel", expected="a direction of a node")
    if "channel" in given and "axis" not in given:
        raise DataFileError(where(""), found="no axis", expected=_AXIS)
    if whole and "axis" in given:
        hint = "Say which direction of the node lies there, or turn all of its axes with rotate."
        raise DataFileError(where("axis"), found="one axis for a whole node", expected="a direction", hint=hint)
    if "rotate" in given and not whole:
        raise DataFileError(where("rotate"), found="rotate for one channel", expected="it for a node without direction")


def _word(value: object, where: str) -> str:
    text = plain(str(value)) if isinstance(value, str | int) and not isinstance(value, bool) else ""
    if not text:
        raise DataFileError(where, found=shown(str(value)), expected="a name")
    return text


def _node(value: object, where: _Place) -> int:
    text = str(value).strip() if isinstance(value, str | int) and not isinstance(value, bool) else ""
    if not (text.isascii() and text.isdigit() and 0 < int(text) < 1 << 31):
        raise DataFileError(where("node"), found=shown(str(value)), expected="the number of a node")
    return int(text)


def _axis(value: object, where: str) -> int:
    text = value.strip().lower() if isinstance(value, str) else ""
    bare = text.removeprefix("-").removeprefix("+")
    if bare not in AXES or len(text) - len(bare) > 1:
        hint = "Write it as text, such as '-z'." if isinstance(value, int | float | bool) else None
        raise DataFileError(where, found=shown(str(value)), expected=_AXIS, hint=hint)
    code = AXES.index(bare) + 1
    return -code if text.startswith("-") else code


def _quantity(value: object, where: str) -> Quantity | None:
    for quantity in QUANTITIES:
        if value == quantity:
            return quantity
    if value is None:
        return None
    hint = did_you_mean(str(value), QUANTITIES)
    raise DataFileError(where, found=shown(str(value)), expected=f"one of {', '.join(QUANTITIES)}", hint=hint)


def _scale(given: Mapping[str, object], where: _Place) -> tuple[float, str | None]:
    """The factor to SI, and the SI unit if one is said."""
    value = given.get("scale", 1.0)
    try:
        scale = float(value) if isinstance(value, str | int | float) and not isinstance(value, bool) else math.nan
    except (ValueError, OverflowError):
        scale = math.nan
    if not (math.isfinite(scale) and scale > 0):
        hint = "A sign belongs to the axis: '-z'." if scale < 0 else None
        raise DataFileError(where("scale"), found=shown(str(value)), expected="a positive factor", hint=hint)
    if "unit" not in given:
        return scale, None
    text = _word(given["unit"], where("unit"))
    unit = si_unit(text)
    if unit is None:  # the user knows what it is: kept as a word
        return scale, text
    if "quantity" in given and unit.quantity not in (None, given["quantity"]):
        found = f"the unit {text} of {given['quantity']}"
        raise DataFileError(where("unit"), found=found, expected="a unit of that quantity")
    if scale != 1 and math.isclose(scale, unit.factor, rel_tol=1e-3):
        hint = "A unit is converted to SI by itself; a scale comes ahead of that."
        found = f"the unit {text} and the factor {scale:g} that converts it"
        raise DataFileError(where("scale"), found=found, expected="one of them", hint=hint)
    return scale * unit.factor, unit.unit


def _turns(value: object, where: str) -> dict[int, int]:
    """The signed axis of the place for each axis of a node; rotations turn as their axes do."""
    if not isinstance(value, Mapping) or not value:
        raise DataFileError(where, found=shown(str(value)), expected="axes by axis, such as {x: -z, z: x}")
    turns = {1: 1, 2: 2, 3: 3}
    for source, target in value.items():
        codes = _axis(source, where), _axis(target, where)
        if not 1 <= codes[0] <= 3 or abs(codes[1]) > 3:
            found = f"{source}: {target}"
            raise DataFileError(where, found=found, expected="x, y or z each, signs on the right; rx, ry, rz follow")
        turns[codes[0]] = codes[1]
    columns = [abs(code) for code in turns.values()]
    if len(set(columns)) < 3:
        named = ", ".join(f"{AXES[s - 1]}: {'-' if t < 0 else ''}{AXES[abs(t) - 1]}" for s, t in turns.items())
        raise DataFileError(where, found=f"two axes that fall on one ({named})", expected="each axis once")
    inversions = sum(columns[i] > columns[j] for i in range(3) for j in range(i + 1, 3))
    if (-1) ** inversions * math.prod(1 if code > 0 else -1 for code in turns.values()) < 0:
        hint = "Check the signs: a right-handed sensor has x × y = z. If its axes are not, map each direction alone."
        raise DataFileError(where, found="a mirror image of the axes", expected="a rotation", hint=hint)
    return turns | {source + 3: target + (3 if target > 0 else -3) for source, target in turns.items()}
