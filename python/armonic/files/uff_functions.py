"""A function of a data set 58 before its values are read: what it is, where it belongs, and its factor to SI."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeVar

from armonic.errors import DataFileError
from armonic.files.cells import AXES
from armonic.files.channel_map import ChannelMap, ChannelPlace, node_of
from armonic.files.measured_file import Skipped
from armonic.files.sampling import plain
from armonic.files.series_uff import of_ours, stem_of
from armonic.files.si_units import si_unit, unit_of
from armonic.files.uff_index import DataSet
from armonic.files.uff_reader import FUNCTION_TYPES, Head, Units

QUANTITIES = {8: "displacement", 9: "force", 11: "velocity", 12: "acceleration", 13: "force"}
"""What the specific data types of a function hold; 9 is a reaction force."""
_NOTE = re.compile(r"sensor frame: (?P<place>.+?)(?:, force at: (?P<hit>.+))?")
_RATIO = re.compile(r"\(?(?P<over>[^()]+?)\)?/\(?(?P<under>k?N|mN|lbf|kgf)\)?")
_SAME = 1e-6
"""Factors of units this near are one."""


_Read = TypeVar("_Read")


class Function58(NamedTuple):
    """A function of a data set 58.

    Attributes:
        data_set: where it stands.
        head: its header.
        start: offset of its values.
        units: of the data set 164 ahead of it; None if there is none.
    """

    data_set: DataSet
    head: Head
    start: int
    units: Units | None

    @property
    def what(self) -> str:
        """What it is, for messages."""
        kind = FUNCTION_TYPES.get(self.head.kind, f"function type {self.head.kind}")
        ends = shown_dof(*self.head.response)
        return f"data set 58, {kind} at {ends}" + (f" per {shown_dof(*self.head.reference)}" if self.two_ends else "")

    @property
    def two_ends(self) -> bool:
        """Whether it has a reference."""
        return self.head.kind != 1

    @property
    def numbered(self) -> str:
        """How messages on others refer to it."""
        return f"data set {self.data_set.ordinal}"

    @property
    def entities(self) -> tuple[str, str]:
        """Entity of the response and of the reference, empty if they have none."""
        dof = self.head.lines[5]
        first, second = (plain(dof[a:b]) for a, b in ((31, 41), (56, 66)))
        return ("" if first == "NONE" else first), ("" if second == "NONE" else second)

    @property
    def title(self) -> str:
        """Its first line, empty if it says nothing."""
        text = plain(self.head.lines[0])
        return "" if text == "NONE" else text

    def skipped(self, reason: str, line: int) -> Skipped:
        """That it was left, and why."""
        return Skipped(self.data_set.ordinal, line, self.what, reason)


def shown_dof(node: int, direction: int) -> str:
    """A degree of freedom for messages, such as 12:-Z."""
    if not 1 <= abs(direction) <= len(AXES):
        return str(node) if direction == 0 else f"{node}:{direction}"
    return f"{node}:{'-' if direction < 0 else '+'}{AXES[abs(direction) - 1].upper()}"


def reason_of(error: DataFileError) -> str:
    """What an error says, as the reason for which something is left."""
    return f"found {error.found}, expected {error.expected}" + (f". {error.hint}" if error.hint else "")


class Names:
    """Which place and axis the two ends of a function are at.

    Names that the file notes come first, then those of a map, then node and direction. Nodes of one number in several
    components are told apart by the component, the entity of the format.

    Args:
        channels: from nodes and names to places; None takes them as they are.
        places: names of nodes, from `Notes`.
        functions: all functions of the file.
    """

    def __init__(self, channels: ChannelMap | None, places: Mapping[int, str], functions: Iterable[Function58]) -> None:
        self.channels = channels or ChannelMap()
        self.places = dict(places)
        components: dict[int, set[str]] = {}
        for function in functions:
            noted = self._noted(function)
            for end, (node, _) in enumerate((function.head.response, function.head.reference)):
                components.setdefault(node, set()).add(function.entities[end])
                if node and noted[end]:
                    self.places.setdefault(node, stem_of(noted[end])[0])
        self._several = {node for node, found in components.items() if len(found) > 1}

    def of(self, function: Function58, end: int, quantity: str | None) -> tuple[str, ChannelPlace | None]:
        """Its name in the file and its place by the map; the place is None if a strict map leaves it out.

        Args:
            function: any.
            end: 0 for its response, 1 for its reference.
            quantity: what is there, or "motion"; None if that is not known.

        Raises:
            DataFileError: several entries of the map are for it, or its direction is none.
        """
        node, direction = (function.head.response, function.head.reference)[end]
        if abs(direction) > len(AXES):
            raise DataFileError("direction", found=f"direction {direction}", expected="0, or ±1 to ±6")
        for text in dict.fromkeys((function.title if not end else "", function.entities[end])):
            # A map may name a channel as the program that recorded it did.
            if text and (place := self.channels.place_of(None, None, text, quantity)) and place.line:
                return text, place
        name = self._name(function, end, node, direction)
        return name, self.channels.place_of(*node_of(name), name, quantity)

    def _name(self, function: Function58, end: int, node: int, direction: int) -> str:
        if noted := self._noted(function)[end]:
            return noted
        entity = function.entities[end]
        if not direction:
            return entity or function.title or f"channel {function.data_set.ordinal}"
        place = self.places.get(node) or (f"{entity}:{node}" if entity and node in self._several else str(node))
        if not node and entity:
            place = entity
        return f"{place}.{'-' if direction < 0 else ''}{AXES[abs(direction) - 1]}"

    def _noted(self, function: Function58) -> tuple[str, str]:
        """Names of both ends as files of ours note them, empty if they do not."""
        lines = function.head.lines
        if not function.two_ends:
            return (function.title if of_ours(lines[3].strip()) else ""), ""
        match = _NOTE.fullmatch(lines[3].strip())
        if match is None:
            return "", ""
        codes = (function.head.response[1], function.head.reference[1])
        if not all(1 <= abs(code) <= len(AXES) for code in codes):
            return "", ""
        places = (match["place"], match["hit"] or match["place"])
        first, second = (
            f"{place}.{'-' if code < 0 else ''}{AXES[abs(code) - 1]}" for place, code in zip(places, codes, strict=True)
        )
        return first, second


def quantity_of(number: int, unit: str) -> str | None:
    """What a specific data type holds, or else a unit; None if neither tells."""
    if number in QUANTITIES:
        return QUANTITIES[number]
    known = si_unit(unit)
    return known.quantity if known and number in (0, 1) else None


def units_of(function: Function58) -> tuple[str, str]:
    """Unit labels of ordinate and denominator, empty if there are none; of an FRF the first may hold both."""
    over, under = ("" if unit.upper() == "NONE" else unit for unit in function.head.units[1:])
    match = _RATIO.fullmatch(over.replace(" ", "")) if function.two_ends else None
    return (match["over"], under or match["under"]) if match else (over, under)


def si_factor(label: str, quantity: str, axis: str, units: Units | None, told: list[str]) -> tuple[float, str]:
    """The factor from the numbers of a file to SI, and the unit they then have.

    Args:
        label: the unit as it stands beside them; empty if there is none.
        quantity: what they are.
        axis: along which.
        units: of the data set 164; None if the file has none.
        told: a sentence is added on what was converted by the label, or is not known.

    Raises:
        DataFileError: label and data set 164 contradict each other.
    """
    own, hint = unit_of(quantity, axis), "A channel map can give its scale."
    rotation = axis.startswith("r")
    stated = 1.0
    if units is not None:
        length = 1.0 if rotation and quantity != "force" else units.length
        stated = 1 / (units.force * (units.length if rotation else 1.0) if quantity == "force" else length)
        if units.code == 1 and abs(stated - 1) > _SAME:
            found = f"units code 1 (SI) with a factor of {1 / stated:g}"
            raise DataFileError("units", found=found, expected="factors of 1 for SI (data set 164)", hint=hint)
    known = si_unit(label) if label else None
    if known is None:
        named = bool(label) and plain(label).replace(" ", "") not in (own, "Nm", "N*m")
        if named and units is None:
            told.append(f"{quantity.capitalize()} in {label} is not converted: a channel map can give its scale.")
            return 1.0, label
        if named:
            told.append(f"{quantity.capitalize()} in {label}, an unknown unit, is taken as the data set 164 says.")
        elif not label and units is None:
            told.append("The file states no units (data set 164): numbers without any are taken for SI.")
        return stated, own
    if known.quantity not in (None, quantity) or (known.quantity is None) is not (rotation and quantity != "force"):
        raise DataFileError("unit", found=f"{quantity} in {label}", expected=own, hint=hint)
    if units is not None and abs(stated - 1) > _SAME and abs(known.factor / stated - 1) > _SAME:
        found = f"values labelled {label!r}, where a data set 164 says that 1 {own} is {1 / stated:g}"
        raise DataFileError("unit", found=found, expected="one unit", hint=hint)
    if abs(known.factor - stated) > _SAME * stated:
        told.append(f"{quantity.capitalize()} was converted from {label} to {own}, by {known.factor:g}.")
    return known.factor, own


def largest_agreeing(found: Sequence[_Read], agree: Callable[[_Read, _Read], bool]) -> tuple[list[_Read], list[_Read]]:
    """The most of them that agree with each other, the first of equals, and the others."""
    sets: list[list[_Read]] = []
    for one in found:
        for other in sets:
            if agree(one, other[0]):
                other.append(one)
                break
        else:
            sets.append([one])
    kept = max(sets, key=len, default=[])
    return kept, [one for other in sets if other is not kept for one in other]
