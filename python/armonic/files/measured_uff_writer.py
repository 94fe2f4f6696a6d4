"""Measured data out to universal files: records, responses with coherence, and points."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import DataFileError
from armonic.files.cells import AXES
from armonic.files.uff_writer import ascii_lines, header, timestamp
from armonic.frf_set import split_label
from armonic.writing import write_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.comparison import ModeTable
    from armonic.files.measured_file import Geometry
    from armonic.frf_set import FrfSet
    from armonic.series import TimeSeries

    Array: TypeAlias = NDArray[np.float64]

FORCE = 13
TYPES = {"displacement": 8, "velocity": 11, "acceleration": 12, "force": FORCE}
"""Specific data types of quantities."""
KIND_TYPES = {"receptance": 8, "mobility": 11, "accelerance": 12}
NOTE = "armonic "
"""Begins the ID line that keeps what the format has no field for, as JSON."""
_UNITS = {8: "m", 11: "m/s", 12: "m/s^2", FORCE: "N"}


def write_measured_uff(
    path: str | Path,
    *,
    records: Iterable[TimeSeries] = (),
    frfs: FrfSet | None = None,
    modes: ModeTable | None = None,
    geometry: Geometry | None = None,
    title: str = "Measured data",
    double: bool = False,
) -> None:
    """Write a universal file in SI units, in binary (data sets 58b, 15).

    Places become nodes 1, 2, …; their names come back when Armonic reads the file.

    Args:
        path: the file; an existing one is replaced, once all is written.
        records: channels of force and motion named PLACE.AXIS; others are refused.
        frfs: responses and coherences.
        modes: not yet written.
        geometry: points.
        title: for other programs to show.
        double: records in double precision rather than in single, which measured signals never exceed.

    Raises:
        DataFileError: something has no place in the format, or the file cannot be written.
    """
    if modes is not None:
        raise DataFileError(str(path), found="modes", expected="records or responses", hint="Write modes to .h5.")
    listed = list(records)
    labels = [c.name for record in listed for c in record.channels] + ([*frfs.outputs, *frfs.inputs] if frfs else [])
    names = dict.fromkeys([*(geometry.names if geometry else ()), *(_dof(path, label)[0] for label in labels)])
    nodes = {name: k for k, name in enumerate(names, 1)}
    parts = [header(title)]
    if geometry is not None:
        parts.append(_points(geometry, nodes))
    for number, record in enumerate(listed, 1):
        for column, channel in enumerate(record.channels):
            if channel.quantity not in TYPES:
                raise DataFileError(str(path), found=channel.label, expected="channels of force or motion")
            place, axis = _dof(path, channel.name)
            note = {"place": place, "record": number, "rate": record.sample_rate_hz}
            parts.append(
                _data_set(
                    (1, number, 1), (nodes[place], axis), (0, 0), (17, TYPES[channel.quantity], 0),
                    record.values[:, column], (record.start_s, 1 / record.sample_rate_hz), None,
                    channel.label, note, double=double,
                )
            )  # fmt: skip
    if frfs is not None:
        parts += _responses(path, frfs, nodes)
    notes = dict(listed[0].notes) if listed else dict(frfs.notes) if frfs else {}
    if notes:
        parts.append(_notes(notes))
    write_whole(Path(path), b"".join(parts))


def _dof(path: str | Path, label: str) -> tuple[str, int]:
    """Place and direction code of a degree of freedom."""
    place, axis = split_label(label)
    if axis not in AXES:
        raise DataFileError(str(path), found=label, expected=f"axes among {' '.join(AXES)}")
    return place, AXES.index(axis) + 1


def _responses(path: str | Path, frfs: FrfSet, nodes: dict[str, int]) -> list[bytes]:
    f = frfs.freq_hz
    even = len(f) > 1 and bool(np.allclose(np.diff(f), f[1] - f[0], rtol=1e-9, atol=0))
    grid = (float(f[0]), float((f[-1] - f[0]) / max(len(f) - 1, 1)))
    parts = []
    for i, output in enumerate(frfs.outputs):
        for j, force in enumerate(frfs.inputs):
            if not frfs.measured[i, j]:
                continue
            (place, axis), (hit, along) = _dof(path, output), _dof(path, force)
            note: dict[str, Any] = {"place": place, "hit": hit, "decay": frfs.decay_rate}
            note["n"] = 0 if frfs.averages is None else int(frfs.averages[i, j])
            note |= {"f0": grid[0], "df": grid[1]} if even else {}
            ends = (nodes[place], axis), (nodes[hit], along)
            types = (18, KIND_TYPES[frfs.kind], FORCE)
            x = None if even else f
            named = f"{output} to {force}"
            parts.append(_data_set((4, 1, 1), *ends, types, frfs.values[:, i, j], grid, x, named, note, double=True))
            if frfs.coherence is not None:
                gamma = frfs.coherence[:, i, j]
                parts.append(_data_set((6, 1, 1), *ends, (18, 0, 0), gamma, grid, x, named, note, double=True))
    return parts


def _data_set(
    kind: tuple[int, int, int],
    response: tuple[int, int],
    reference: tuple[int, int],
    types: tuple[int, int, int],
    values: NDArray[Any],
    grid: tuple[float, float],
    x: Array | None,
    title: str,
    note: dict[str, Any],
    *,
    double: bool,
) -> bytes:
    """One data set 58b: function type, sequence and load case; ends; data types; values over a grid or over x."""
    complex_ = np.iscomplexobj(values)
    number = "<f8" if double else "<f4"
    columns = [] if x is None else [np.asarray(x)]
    columns += [values.real, values.imag] if complex_ else [values]
    body = np.ascontiguousarray(np.column_stack(columns), np.dtype(number)).tobytes()
    storage = (6 if double else 5) if complex_ else (4 if double else 2)
    first = f"{58:6d}b{1:6d}{2:6d}{11:12d}{len(body):12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    (function, sequence, case), (abscissa, ordinate, denominator) = kind, types
    lines = [
        "    -1",
        first,
        title,
        _note(note, ("f0", "df")),
        timestamp(),
        _note(note, ("place", "hit", "record")),
        _note(note, ("rate", "decay", "n")),
        f"{function:5d}{sequence:10d}{sequence:5d}{case:10d} {'NONE':10}{response[0]:10d}{response[1]:4d}"
        f" {'NONE':10}{reference[0]:10d}{reference[1]:4d}",
        f"{storage:10d}{len(values):10d}{1 if x is None else 0:10d}{grid[0]:13.5E}{grid[1]:13.5E}{0.0:13.5E}",
        _axis(abscissa, "Time" if abscissa == 17 else "Frequency", "s" if abscissa == 17 else "Hz"),
        _axis(ordinate, "NONE", _UNITS.get(ordinate, "NONE")),
        _axis(denominator, "NONE", _UNITS.get(denominator, "NONE")),
        _axis(0, "NONE", "NONE"),
    ]
    if len(lines[5]) > 80:
        raise DataFileError(title, found="names of places that are too long", expected="short ones")
    return ascii_lines(lines) + body + b"\n    -1\n"


def _note(note: dict[str, Any], keys: tuple[str, ...]) -> str:
    """Some of what the format has no field for, as an ID line."""
    chosen = {key: note[key] for key in keys if key in note}
    return NOTE + json.dumps(chosen, separators=(",", ":")) if chosen else "NONE"


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:20} {unit:20}"


def _points(geometry: Geometry, nodes: dict[str, int]) -> bytes:
    rows = [
        f"{nodes[name]:10d}{0:10d}{0:10d}{0:10d}" + "".join(f"{value:13.5E}" for value in position)
        for name, position in zip(geometry.names, geometry.positions, strict=True)
    ]
    return ascii_lines(["    -1", "    15", *rows, "    -1"])


def _notes(notes: dict[str, str]) -> bytes:
    """Notes as text after the data, in a data set 151 of their own name; others pass it over."""
    text = json.dumps(notes)
    rows = [text[k : k + 78] for k in range(0, len(text), 78)]
    return ascii_lines(["    -1", "  9151", *(f"> {row}" for row in rows), "    -1"])
