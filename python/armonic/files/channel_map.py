"""From the channels and nodes of a measurement to places and axes of a robot."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from armonic.description.names import did_you_mean
from armonic.errors import DataFileError
from armonic.files.cells import AXES
from armonic.files.map_entry import Entry, entry
from armonic.files.sampling import plain
from armonic.files.si_units import unit_of
from armonic.series import Quantity

if TYPE_CHECKING:
    from armonic.robot import Robot

_DOF = re.compile(r"(?P<place>.+)(?:\.(?P<sign>[+-]?)|:(?P<sign2>[+-]?))(?P<axis>[rR]?[xyzXYZ])")
_NODE = re.compile(r"(?:node_)?(?P<node>[1-9]\d{0,8})")


@dataclass(frozen=True)
class ChannelPlace:
    """Where a channel belongs, and what its numbers are to be multiplied by.

    Attributes:
        label: the degree of freedom, PLACE.AXIS; the channel's own name if nothing tells its axis.
        sign: −1 where it runs against the axis.
        scale: factor to SI.
        quantity: what the map says it holds; None if nothing.
        unit: the SI unit after scaling, if the map tells; None leaves it to the file.
        line: of the entry in the map; 0 if the channel is in none.
    """

    label: str
    sign: float = 1.0
    scale: float = 1.0
    quantity: Quantity | None = None
    unit: str | None = None
    line: int = 0

    @property
    def factor(self) -> float:
        """Sign times scale."""
        return self.sign * self.scale

    @property
    def scaled(self) -> bool:
        """Whether the map tells what the numbers are, so that the file's own unit no longer counts."""
        return self.unit is not None or self.scale != 1.0


@dataclass(frozen=True, eq=False, repr=False)
class ChannelMap:
    """Which channel or node of a measurement is which place and axis of a robot.

    Args:
        entries: one for each channel or node, see `ChannelMap.of` and `read_channel_map`.
        strict: leave out channels that are in no entry; otherwise they keep their names.
        origin: the file, for messages.

    Attributes:
        met: entries that some channel asked for, by index; `fresh` begins anew.

    Raises:
        DataFileError: two entries are for one channel.
    """

    entries: tuple[Entry, ...] = ()
    strict: bool = False
    origin: str = "channels"
    met: set[int] = field(default_factory=set, init=False)

    def __post_init__(self) -> None:
        for k, later in enumerate(self.entries):
            for first in self.entries[:k]:
                if first.overlaps(later):
                    raise self._twice(later.source, first, later)

    def __repr__(self) -> str:
        """Origin and number of entries."""
        return f"ChannelMap({self.origin}, {len(self.entries)} entries{', strict' if self.strict else ''})"

    @classmethod
    def of(cls, entries: Iterable[Mapping[str, object]], *, strict: bool = False) -> ChannelMap:
        """A map from entries as a file has them.

        Args:
            entries: mappings with the keys of a map file: channel or node (with a direction or without), place, axis or
                rotate, quantity, unit, scale.
            strict: leave out channels that are in no entry.

        Raises:
            DataFileError: an entry does not make sense, or two are for one channel.
        """
        made = [
            entry(fields, lambda key, k=k: f"channels[{k}]" + (f".{key}" if key else ""), k + 1)  # type: ignore[misc]
            for k, fields in enumerate(entries)
        ]
        return cls(tuple(made), strict)

    def fresh(self) -> ChannelMap:
        """The same map, of which no channel has asked for an entry yet."""
        return replace(self)

    def place_of(
        self, node: int | None, direction: int | None, name: str, quantity: str | None = None
    ) -> ChannelPlace | None:
        """Where a channel belongs; None if it is in no entry of a strict map.

        Names count exactly, or else without regard to case. An entry with a quantity is for channels of that quantity,
        and for those of which the file does not say one.

        Args:
            node: the node of a universal file; None or 0 if there is none.
            direction: its direction code, ±1 to ±6 for x y z rx ry rz; None or 0 if there is none.
            name: the channel's name; "quantity:name" in an entry is for it, too.
            quantity: what it holds by the file, or "motion" for anything but a force; None if that is not known.

        Raises:
            DataFileError: several entries are for it.
        """
        name = plain(name)
        unknown = quantity in (None, "signal")
        fitting = [
            k
            for k in self._named(name, quantity) + self._at(node, direction)
            if (own := self.entries[k].quantity) in (None, quantity)
            or unknown
            or (quantity == "motion" and own != "force")
        ]
        if len(fitting) > 1:
            raise self._twice(repr(name) if name else f"node {node}", *(self.entries[k] for k in fitting[:2]))
        if not fitting:
            return None if self.strict else unmapped(node, direction, name)
        self.met.add(fitting[0])
        found = self.entries[fitting[0]]
        code = found.axis_of(direction or 0)
        axis = AXES[abs(code) - 1]
        unit = found.unit
        if unit is None and found.scale != 1 and found.quantity:  # a scale leads to SI
            unit = unit_of(found.quantity, axis) or None
        return ChannelPlace(
            f"{found.place}.{axis}", 1.0 if code > 0 else -1.0, found.scale, found.quantity, unit, found.line
        )

    def point_of(self, node: int | None, name: str) -> str:
        """The place of a point of the geometry: the one that its node's entries name, or else its own name.

        Args:
            node: its number, if it has one.
            name: what it is called; its number if it has no name.
        """
        places = {e.place for e in self.entries if e.node is not None and e.node == node}
        return places.pop() if len(places) == 1 else name

    def unmet(self) -> tuple[str, ...]:
        """A sentence for each entry that no channel has asked for."""
        return tuple(
            f"{self._at_line(e)}: nothing that was read is {e.source}."
            for k, e in enumerate(self.entries)
            if k not in self.met
        )

    def check(self, robot: Robot) -> tuple[str, ...]:
        """A sentence for each place that is no frame of a robot; such a place may still be a point of the measurement.

        Args:
            robot: whose frames count.
        """
        first = {e.place: e for e in reversed(self.entries)}
        told = []
        for e in sorted(first.values(), key=lambda e: e.line):
            if e.place not in robot.frames:
                near = did_you_mean(e.place, robot.frames)
                told.append(f"{self._at_line(e)}: {robot.name} has no frame {e.place!r}.{f' {near}' if near else ''}")
        return tuple(told)

    def refuse_same(self, where: str, channels: Iterable[tuple[str, str, ChannelPlace]]) -> None:
        """Refuse two channels of one record that fall on one degree of freedom.

        Args:
            where: the record, for the error.
            channels: name, quantity and place of each.

        Raises:
            DataFileError: two fall on one; it names both, with their lines in the map.
        """
        taken: dict[tuple[str, str], tuple[str, ChannelPlace]] = {}
        for name, quantity, place in channels:
            key = quantity, place.label
            if key in taken:
                both = [
                    f"{n!r} ({f'{self.origin}, line {p.line}' if p.line else 'in no entry'})"
                    for n, p in (taken[key], (name, place))
                ]
                raise DataFileError(
                    where,
                    found=f"channels {' and '.join(both)} both mapped onto {quantity}:{place.label}",
                    expected="one channel for each degree of freedom and quantity",
                    hint="Give one of them another place or axis, or leave it out of a strict map.",
                )
            taken[key] = name, place

    def _named(self, name: str, quantity: str | None) -> list[int]:
        texts = [(k, e.channel) for k, e in enumerate(self.entries) if e.channel is not None]
        for level in (f"{quantity}:{name}", name):
            if found := [k for k, text in texts if text == level]:
                return found
        loose = (name.casefold(), f"{quantity}:{name}".casefold())
        return [k for k, text in texts if text.casefold() in loose]

    def _at(self, node: int | None, direction: int | None) -> list[int]:
        if not node or not direction:
            return []
        return [
            k
            for k, e in enumerate(self.entries)
            if e.node == node and (e.direction is None or abs(e.direction) == abs(direction))
        ]

    def _at_line(self, found: Entry) -> str:
        return f"{self.origin}, line {found.line}"

    def _twice(self, what: str, first: Entry, later: Entry) -> DataFileError:
        return DataFileError(
            self._at_line(later),
            found=f"{what} in a second entry",
            expected=f"one entry for each channel (first on line {first.line})",
            hint="Remove one, or tell them apart by quantity.",
        )


def unmapped(node: int | None, direction: int | None, name: str) -> ChannelPlace:
    """Where a channel belongs by its own name ("sensor.x", "tip:-Z"), or else by its node and direction.

    Args:
        node: None or 0 if there is none.
        direction: ±1 to ±6; None or 0 if there is none.
        name: of the channel; it is the label where neither tells an axis.
    """
    if match := _DOF.fullmatch(name):
        sign = -1.0 if "-" in (match["sign"] or "", match["sign2"] or "") else 1.0
        return ChannelPlace(f"{match['place']}.{match['axis'].lower()}", sign)
    if node and direction and 1 <= abs(direction) <= len(AXES):
        return ChannelPlace(f"{node}.{AXES[abs(direction) - 1]}", 1.0 if direction > 0 else -1.0)
    return ChannelPlace(name or str(node or "channel"))


def node_of(name: str) -> tuple[int | None, int | None]:
    """Node and direction code that a channel's name tells: (12, -3) of "12:-z", "12.-z" or "node_12.-z"."""
    match = _DOF.fullmatch(name)
    number = match and _NODE.fullmatch(match["place"])
    if not match or not number:
        return None, None
    code = AXES.index(match["axis"].lower()) + 1
    return int(number["node"]), -code if "-" in (match["sign"] or "", match["sign2"] or "") else code


def read_channel_map(path: str | Path) -> ChannelMap:
    """Read a channel map: YAML, or comma-separated text if its name ends in .csv.

    YAML holds `armonic_channels: 1`, a list `channels` and perhaps `strict: true`. An entry is for the channel of a
    name (`channel`), or for a `node` in one `direction` or in all, and says its `place` (a frame of the robot or a
    point), the `axis` there ("z", "-z"), or of a whole node how its axes are turned (`rotate: {x: -z, z: x}`). It may
    say the `quantity`, a `scale` by which numbers are multiplied, and the `unit` they then have. CSV has the columns
    channel, node, direction, place, axis, quantity, unit and scale, any of them, and perhaps a comment
    `# strict: true`.

    Args:
        path: the file.

    Raises:
        DataFileError: it is no such file, an entry does not make sense, or two are for one channel.
    """
    from armonic.files.map_text import entries_of

    entries, strict = entries_of(path)
    return ChannelMap(entries, strict, str(path))
