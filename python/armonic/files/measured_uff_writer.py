"""Measured data out to universal files: records, frequency responses with coherence, modes, points and lines."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armonic.errors import DataFileError
from armonic.files.cells import AXES
from armonic.files.series_uff import MARK, encoded, stem_of
from armonic.files.uff_geometry import encode_geometry
from armonic.files.uff_modes import encode_modes
from armonic.files.uff_notes import Notes, encode_notes
from armonic.files.uff_reader import COHERENCE, FREQUENCY, FRF
from armonic.files.uff_writer import data_set_58, frequencies, header, timestamp
from armonic.frf_set import split_label
from armonic.writing import write_whole

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.comparison import ModeTable
    from armonic.files.measured_file import Geometry
    from armonic.frf_set import FrfSet
    from armonic.series import TimeSeries

FORCE = 13
TYPES = {"receptance": 8, "mobility": 11, "accelerance": 12}
"""Specific data types of responses."""
_PER_TIME = {"receptance": "", "mobility": "/s", "accelerance": "/s^2"}


def write_measured_uff(
    path: str | Path,
    *,
    records: Iterable[TimeSeries] = (),
    frfs: FrfSet | None = None,
    modes: ModeTable | None = None,
    geometry: Geometry | None = None,
    modal_a: ArrayLike | None = None,
    binary: bool = True,
    double: bool = False,
    title: str = "Measured data",
) -> None:
    """Write a universal file in SI units: points and lines (15, 82), functions (58) and modes (55), after 151 and 164.

    A place whose name is a number is the node of that number, and every other a node that is free. Names and notes
    come back by a data set of our own, which other programs pass over. Frequency responses are in double precision;
    their lines, if evenly spaced, come back up to 1e-9 of the highest.

    Args:
        path: the file; an existing one is replaced, once all is written.
        records: time records, one after the other.
        frfs: frequency responses, with their coherence if they have one.
        modes: poles and shapes over PLACE.AXIS.
        geometry: points and lines.
        modal_a: modal A of each mode, (m,).
        binary: data sets 58b, rather than text of 13 digits.
        double: binary records in double precision rather than single, which no converter exceeds.
        title: for other programs to show.

    Raises:
        DataFileError: something has no place in the format, or the file cannot be written.
    """
    listed = list(records)
    nodes = _nodes(path, listed, frfs, modes, geometry)
    parts = [header(title)]
    notes = Notes(
        {node: place for place, node in nodes.items() if place != str(node)},
        {k: dict(record.notes) for k, record in enumerate(listed, 1) if record.notes},
        dict(frfs.notes) if frfs is not None else {},
    )
    if any(notes):
        parts.append(encode_notes(notes))
    if geometry is not None:
        parts.append(encode_geometry(geometry, nodes))
    for k, record in enumerate(listed, 1):
        for column, channel in enumerate(record.channels):
            node = nodes[stem_of(channel.name)[0]]
            parts.append(encoded(path, record, column, node, binary=binary, record=k, double=double))
    if frfs is not None:
        parts += _responses(path, frfs, nodes, binary=binary)
    if modes is not None:
        parts.append(encode_modes(modes, nodes, modal_a))
    write_whole(path, b"".join(parts))


def _nodes(
    path: str | Path,
    records: list[TimeSeries],
    frfs: FrfSet | None,
    modes: ModeTable | None,
    geometry: Geometry | None,
) -> dict[str, int]:
    """A number for each place, in the order of their first use."""
    labels = [channel.name for record in records for channel in record.channels]
    if frfs is not None:
        for label in (*frfs.outputs, *frfs.inputs):
            if split_label(label)[1] not in AXES:
                expected = f"axes among {', '.join(AXES)} for a universal file"
                raise DataFileError(str(path), found=label, expected=expected, hint="Write it as HDF5.")
            labels.append(label)
    labels += (modes.coordinates or ()) if modes is not None else ()
    places = dict.fromkeys([*(geometry.names if geometry is not None else ()), *(stem_of(x)[0] for x in labels)])
    own = {place: int(place) for place in places if _is_number(place)}
    taken, free = set(own.values()), 0
    nodes = {}
    for place in places:
        if place in own:
            nodes[place] = own[place]
            continue
        free += 1
        while free in taken:
            free += 1
        nodes[place] = free
    return nodes


def _is_number(place: str) -> bool:
    return place.isascii() and place.isdecimal() and len(place) <= 9 and place[0] != "0"


def _responses(path: str | Path, frfs: FrfSet, nodes: dict[str, int], *, binary: bool) -> Iterator[bytes]:
    for i, output in enumerate(frfs.outputs):
        for j, force in enumerate(frfs.inputs):
            if not frfs.measured[i, j]:
                continue
            (place, axis), (hit, along) = split_label(output), split_label(force)
            about: dict[str, float | int] = {"decay_rate": float(frfs.decay_rate)} if frfs.decay_rate else {}
            if frfs.averages is not None:
                about["averages"] = int(frfs.averages[i, j])
            note = f"sensor frame: {place}" + (f", force at: {hit}" if hit != place else "")
            # A name that does not fit comes back by the notes of the file alone.
            fits = len(note) <= 80 and note.isascii() and note == " ".join(note.split()) and note.count(", force") < 2
            kinds: list[tuple[int, NDArray[Any]]] = [(FRF, frfs.values[:, i, j])]
            if frfs.coherence is not None:
                kinds.append((COHERENCE, frfs.coherence[:, i, j]))
            for kind, values in kinds:
                unit = ("rad" if axis.startswith("r") else "m") + _PER_TIME[frfs.kind]
                frf = kind == FRF
                yield data_set_58(
                    kind=kind,
                    ids=(
                        f"{output} per {force}",
                        "",
                        timestamp(),
                        note if fits else "",
                        MARK + json.dumps(about) if about else "",
                    ),
                    response=("NONE", nodes[place], AXES.index(axis) + 1),
                    reference=("NONE", nodes[hit], AXES.index(along) + 1),
                    abscissa=(FREQUENCY, "Frequency", "Hz"),
                    ordinate=(TYPES[frfs.kind], "Response", unit) if frf else (0, "Coherence", ""),
                    denominator=(FORCE, "Force", "N m" if along.startswith("r") else "N") if frf else (0, "NONE", ""),
                    form=frequencies(frfs.freq_hz, values, binary=binary),
                    binary=binary,
                )
