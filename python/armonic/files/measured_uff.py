"""Measured data in from universal files: what can be read is, in bounded memory, and what cannot is named."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armonic.errors import DataFileError
from armonic.files.mapped import mapped_modes
from armonic.files.measured_file import Geometry, MeasuredFile, Skipped
from armonic.files.uff_frfs import read_frfs
from armonic.files.uff_functions import Function58, Names, reason_of
from armonic.files.uff_geometry import Points
from armonic.files.uff_index import DataSet, UffSource, data_sets
from armonic.files.uff_modes import UffMode, mode_table, read_mode
from armonic.files.uff_notes import NOTES, Notes, decode_notes
from armonic.files.uff_reader import (
    COHERENCE,
    FREQUENCY,
    FRF,
    FUNCTION_TYPES,
    TIME,
    TIME_RESPONSE,
    Units,
    read_164,
    read_head_58,
    read_lines_58,
    refuse_other_abscissa,
)
from armonic.files.uff_records import read_records
from armonic.files.uff_table import refuse_impossible_length

if TYPE_CHECKING:
    from armonic.files.channel_map import ChannelMap

_LONGEST_UNITS = 1 << 12
"""Bytes of a data set 164 that are looked at; it has 230."""
_SORTS = {15: ", points", 2411: ", points", 82: ", a line", 55: ", data at nodes", 164: ", units"}
_NO_USE = "a data set of which Armonic makes no use"


@dataclass(eq=False)
class _Found:
    """What the data sets of a file are, before any values of functions are read."""

    functions: dict[int, list[Function58]] = field(default_factory=dict)
    points: Points = field(default_factory=Points)
    modes: list[UffMode] = field(default_factory=list)
    notes: tuple[Notes, Mapping[str, str]] = (Notes({}, {}, {}), {})
    units: Units | None = None
    skipped: list[Skipped] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    numbers: Counter[int] = field(default_factory=Counter)


def read_measured_uff(
    path: str | Path, *, channels: ChannelMap | None = None, progress: Callable[[float], object] | None = None
) -> MeasuredFile:
    """Read what a universal file holds of a measurement, in SI units.

    Time responses, frequency responses and coherences (data sets 58 and 58b of function types 1, 4 and 6), modes (55),
    points and the lines between them (15, 2411, 82), with units (164) and what else files of ours note. A data set
    that is damaged, or of a sort for which Armonic has no use, is left and named; the others are read. Values are read
    in pieces into the arrays that are returned, so that a file needs little memory beyond these.

    Degrees of freedom are PLACE.AXIS: a place is what a map says, or the file notes, or else the number of the node.
    Values are converted by the factors of data set 164 or else by the units beside them; where these two contradict
    each other, the function is left.

    Args:
        path: the file.
        channels: from nodes, or names of channels, to places and axes of the robot; None takes them as they are.
        progress: called with the share of the file that is read, from 0 to 1.

    Returns:
        All of it, with what was left and why.

    Raises:
        DataFileError: the file is no universal file, nothing in it can be read, or the map and it do not go together.
    """
    with UffSource(path, progress) as source:
        found = _Found()
        for data_set in data_sets(source):
            _take(source, data_set, found)
        listed = [function for functions in found.functions.values() for function in functions]
        names = Names(channels, found.notes[0].places, listed)
        skipped, remarks = found.skipped, found.remarks
        with np.errstate(all="ignore"):  # values that are none are kept in records, and looked for in responses
            records = read_records(source, found.functions.get(TIME_RESPONSE, []), names, found.notes, skipped, remarks)
            responses, coherences = found.functions.get(FRF, []), found.functions.get(COHERENCE, [])
            frfs = read_frfs(source, responses, coherences, names, found.notes[0].frfs, skipped, remarks)
        modes = mode_table(found.modes, names.places, skipped, source)
        if modes is not None and channels is not None:
            modes = mapped_modes(modes, channels, where=source.name)
        geometry = found.points.geometry(names.places, remarks)
        if geometry is not None and channels is not None:
            geometry = _mapped_points(geometry, channels)
        if not records and frfs is None and modes is None and geometry is None:
            raise _nothing(source, found)
        source.done(1.0)
    skipped.sort(key=lambda one: (one.line, one.dataset))
    return MeasuredFile(str(path), tuple(records), frfs, modes, geometry, tuple(skipped), tuple(dict.fromkeys(remarks)))


def function_types(path: str | Path) -> set[int]:
    """Which function types the data sets 58 of a file are: 1 time responses, 4 frequency responses, and others.

    Raises:
        DataFileError: the file is no universal file.
    """
    found = set()
    with UffSource(path) as source:
        for data_set in data_sets(source):
            if data_set.number == 58 and not data_set.fault:
                with suppress(DataFileError):  # a damaged one is of no type
                    found.add(read_lines_58(source.reader(data_set))[0])
    return found


def _take(source: UffSource, data_set: DataSet, found: _Found) -> None:
    """Look at a data set; what is short of it is read at once, and what cannot be is left."""
    number = data_set.number
    found.numbers[number] += 1
    try:
        if number == 58 and not data_set.fault:
            _take_function(source, data_set, found)
            return
        reason = data_set.fault or _taken(source, data_set, found)
    except DataFileError as error:
        reason = reason_of(error)
    if reason:
        what = f"data set {number}{_SORTS.get(number, '')}" if number else "text between data sets"
        found.skipped.append(Skipped(data_set.ordinal, source.line_of(data_set.at), what, reason))


def _taken(source: UffSource, data_set: DataSet, found: _Found) -> str:
    """Read a data set that is no function; why it is left, if it is."""
    if data_set.number in (15, 2411):
        found.points.add_nodes(source, data_set, found.units.length if found.units else 1.0)
    elif data_set.number == 82:
        found.points.add_trace(source, data_set)
    elif data_set.number == 55:
        found.modes.append(read_mode(source, data_set, found.units))
    elif data_set.number == 164:
        body = source.read(data_set.start, min(data_set.stop, data_set.start + _LONGEST_UNITS))
        found.units = read_164(source.reader(data_set), body)
    elif data_set.number == NOTES:
        found.notes = decode_notes(text for _, text in source.lines(data_set.start, data_set.stop))
    elif data_set.number != 151:
        return _NO_USE
    return ""


def _take_function(source: UffSource, data_set: DataSet, found: _Found) -> None:
    reader = source.reader(data_set)
    kind, lines, places = read_lines_58(reader)
    if kind not in (TIME_RESPONSE, FRF, COHERENCE):
        reason = f"function type {kind} ({FUNCTION_TYPES.get(kind, 'other')}), of which Armonic makes no use"
        found.skipped.append(Skipped(data_set.ordinal, source.line_of(data_set.at), "data set 58", reason))
        return
    head = read_head_58(reader, kind, lines, places)
    function = Function58(data_set, head, data_set.start + reader.offset, found.units)
    try:
        if head.storage not in (2, 4, 5, 6):
            raise reader.error(f"ordinate data type {head.storage}", "2, 4 (real), 5 or 6 (complex)", at=places[6])
        refuse_other_abscissa(reader, head, TIME if kind == TIME_RESPONSE else FREQUENCY)
        refuse_impossible_length(source, data_set, head, function.start)
    except DataFileError as error:
        found.skipped.append(function.skipped(reason_of(error), source.line_of(data_set.at)))
        return
    found.functions.setdefault(kind, []).append(function)


def _mapped_points(geometry: Geometry, channels: ChannelMap) -> Geometry:
    """Points under the names of places, as long as these stay different."""
    names = tuple(channels.point_of(int(n) if n.isascii() and n.isdigit() else None, n) for n in geometry.names)
    return Geometry(names, geometry.positions, geometry.lines) if len(set(names)) == len(names) else geometry


def _nothing(source: UffSource, found: _Found) -> DataFileError:
    """That a file has nothing to read, with the first reason for it."""
    first = next((s for s in found.skipped if s.reason != _NO_USE), None)
    told = ", ".join(str(n) if k == 1 else f"{k} of {n}" for n, k in sorted(found.numbers.items()) if n)
    return DataFileError(
        source.name if first is None or not first.line else f"{source.name}, line {first.line}",
        found=f"only data sets {told}" if first is None else f"nothing that can be read ({first.what}: {first.reason})",
        expected="time or frequency responses, modes or points: data sets 58, 55, 15",
    )
