"""Records, frequency responses and modes of a file under the names of a channel map, in SI, with remarks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from armonic.comparison import ModeTable
from armonic.errors import DataFileError, SignalError
from armonic.files.cells import AXES
from armonic.files.channel_map import ChannelMap, ChannelPlace, node_of
from armonic.files.measured_file import Geometry, MeasuredFile, Skipped
from armonic.files.si_units import si_unit, unit_of
from armonic.frf_set import FrfSet
from armonic.series import Channel, Quantity, TimeSeries
from armonic.text import listing

_SHOWN = 6


def mapped_record(
    series: TimeSeries, channels: ChannelMap | None = None, *, where: str = "record", remarks: list[str] | None = None
) -> TimeSeries:
    """A record with its channels named PLACE.AXIS, in SI.

    Values are multiplied by the sign and scale of their entry; where the map tells no unit, that of the channel is
    converted, g and mm among others. What nothing tells the axis of keeps its name.

    Args:
        series: as it was read.
        channels: the map; None takes channels by their own names.
        where: what the record is called in errors and remarks.
        remarks: sentences on units and quantities are added here.

    Raises:
        DataFileError: two channels fall on one degree of freedom, an entry is not alone for its channel, or a strict
            map leaves none.
    """
    chosen = channels or ChannelMap()
    told: list[str] = [] if remarks is None else remarks
    kept: list[int] = []
    made: list[tuple[str, Channel, ChannelPlace]] = []
    factors: list[float] = []
    unitless: list[str] = []
    for column, channel in enumerate(series.channels):
        place = chosen.place_of(*node_of(channel.name), channel.name, channel.quantity)
        if place is None:
            continue
        new, factor = _in_si(channel, place, told, unitless)
        kept.append(column)
        made.append((channel.name, new, place))
        factors.append(factor)
    if not kept:
        raise DataFileError(
            where,
            found=f"no channel of the strict map {chosen.origin}",
            expected="one at least",
            hint=f"The channels are {', '.join(series.labels[:12])}.",
        )
    chosen.refuse_same(where, ((name, new.quantity, place) for name, new, place in made))
    if unitless:
        told.append(f"No unit is stated of {_shortly(unitless)}: the numbers are taken for SI.")
    if unknown := [c.name for _, c, _ in made if c.quantity == "signal"]:
        told.append(f"Nothing says what {_shortly(unknown)} holds: a channel map can.")
    values = series.values[:, kept]
    if any(factor != 1 for factor in factors):
        with np.errstate(all="ignore"):  # what is not finite stays so
            values = values * np.array(factors)
    try:
        return replace(series, values=values, channels=tuple(c for _, c, _ in made))
    except SignalError as error:
        raise DataFileError(f"{where}: {error.where}", found=error.found, expected=error.expected) from error


def mapped_frfs(frfs: FrfSet, channels: ChannelMap | None = None, *, where: str = "FRFs") -> FrfSet:
    """Frequency responses with their degrees of freedom under the names of a map.

    An entry with a quantity of motion is for responses, one of force for forces; without a quantity it is for both.

    Args:
        frfs: as they were read, in SI.
        channels: the map; None takes labels as they are.
        where: what they are called in errors.

    Raises:
        DataFileError: two degrees of freedom fall on one, or a strict map leaves none.
    """
    chosen = channels or ChannelMap()
    sides: list[tuple[list[int], list[ChannelPlace]]] = []
    for quantity, labels in (("motion", frfs.outputs), ("force", frfs.inputs)):
        places = [chosen.place_of(*node_of(label), label, quantity) for label in labels]
        kept = [(k, place) for k, place in enumerate(places) if place is not None]
        if not kept:
            found = f"no {quantity} of the strict map {chosen.origin}"
            hint = f"There are {', '.join(labels[:12])}."
            raise DataFileError(where, found=found, expected="one at least", hint=hint)
        chosen.refuse_same(where, ((labels[k], quantity, place) for k, place in kept))
        sides.append(([k for k, _ in kept], [place for _, place in kept]))
    (rows, outputs), (columns, inputs) = sides
    factors = np.array([p.factor for p in outputs])[:, None] / np.array([p.factor for p in inputs])
    pair = np.ix_(rows, columns)
    return replace(
        frfs,
        values=frfs.values[:, rows][:, :, columns] * factors,
        outputs=tuple(p.label for p in outputs),
        inputs=tuple(p.label for p in inputs),
        coherence=None if frfs.coherence is None else frfs.coherence[:, rows][:, :, columns],
        averages=None if frfs.averages is None else frfs.averages[pair],
        measured=frfs.measured[pair],
    )


def mapped_modes(modes: ModeTable, channels: ChannelMap, *, where: str = "modes") -> ModeTable:
    """Modes with the coordinates of their shapes under the names of a map, signs turned.

    Args:
        modes: as they were read.
        channels: the map.
        where: what they are called in errors.

    Raises:
        DataFileError: two coordinates fall on one, or a strict map leaves none.
    """
    if modes.shapes is None or modes.coordinates is None:
        return modes
    places = [channels.place_of(*node_of(name), name, "motion") for name in modes.coordinates]
    kept = [(k, place) for k, place in enumerate(places) if place is not None]
    if not kept:
        raise DataFileError(where, found=f"no coordinate of the strict map {channels.origin}", expected="one at least")
    channels.refuse_same(where, ((modes.coordinates[k], "motion", place) for k, place in kept))
    signs = np.array([place.sign for _, place in kept])
    return replace(
        modes, shapes=modes.shapes[:, [k for k, _ in kept]] * signs, coordinates=tuple(p.label for _, p in kept)
    )


def measured(
    path: str | Path,
    *,
    channels: ChannelMap | None,
    records: Iterable[TimeSeries] = (),
    frfs: FrfSet | None = None,
    modes: ModeTable | None = None,
    geometry: Geometry | None = None,
    skipped: Sequence[Skipped] = (),
    remarks: Sequence[str] = (),
) -> MeasuredFile:
    """What was read of a file, under the names of a map.

    Args:
        path: the file.
        channels: the map, or None.
        records: as they were read.
        frfs: likewise.
        modes: likewise.
        geometry: likewise.
        skipped: what was not read.
        remarks: what is known of the rest already.

    Raises:
        DataFileError: a map and the file do not go together.
    """
    told, given = list(remarks), list(records)
    named = [
        mapped_record(
            record, channels, where=f"{path}, record {k}" if len(given) > 1 else str(path), remarks=told
        )
        for k, record in enumerate(given, 1)
    ]  # fmt: skip
    return MeasuredFile(
        str(path),
        tuple(named),
        None if frfs is None else mapped_frfs(frfs, channels, where=str(path)),
        modes if modes is None or channels is None else mapped_modes(modes, channels, where=str(path)),
        geometry if geometry is None or channels is None else _mapped_points(geometry, channels),
        tuple(skipped),
        tuple(dict.fromkeys(told)),
    )


def _mapped_points(geometry: Geometry, channels: ChannelMap) -> Geometry:
    """Points under the names of places, as long as these stay different."""
    names = tuple(channels.point_of(int(n) if n.isascii() and n.isdigit() else None, n) for n in geometry.names)
    return replace(geometry, names=names) if len(set(names)) == len(names) else geometry


def _in_si(channel: Channel, place: ChannelPlace, told: list[str], unitless: list[str]) -> tuple[Channel, float]:
    """A channel as it is in SI under its new name, and the factor that leads there."""
    unit = si_unit(channel.unit) if channel.unit else None
    quantity: Quantity = channel.quantity
    if place.quantity is not None:
        quantity = place.quantity
    elif quantity == "signal" and unit is not None and unit.quantity is not None:
        quantity = unit.quantity
    axis = place.label.rpartition(".")[2]
    own = unit_of(quantity, axis) if axis in AXES else unit_of(quantity, "x")
    label = f"{quantity}:{place.label}"
    if place.scaled:
        return Channel(place.label, quantity, place.unit or own or channel.unit), place.factor
    if not channel.unit:
        if own:
            unitless.append(label)
        return Channel(place.label, quantity, own), place.sign
    if unit is None:
        if own and channel.unit != own:
            told.append(f"{label} is in {channel.unit}, which is not converted: a channel map can give its scale.")
        return Channel(place.label, quantity, channel.unit), place.sign
    if own and unit.quantity not in (None, quantity):
        told.append(f"{label} is said to be in {channel.unit}, a unit of {unit.quantity}: its numbers are kept.")
        return Channel(place.label, quantity, channel.unit), place.sign
    if unit.factor != 1:
        told.append(f"{label} was converted from {channel.unit} to {unit.unit}, by {unit.factor:g}.")
    return Channel(place.label, quantity, unit.unit), place.sign * unit.factor


def _shortly(names: list[str]) -> str:
    return listing(names if len(names) <= _SHOWN else [*names[: _SHOWN - 1], f"{len(names) - _SHOWN + 1} more"])
