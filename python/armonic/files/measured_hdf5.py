"""HDF5 files of measured data: our own layout both ways, and what others wrote, MATLAB 7.3 among them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
from numpy.typing import NDArray

from armonic.comparison import ModeTable
from armonic.errors import ArmonicError, DataFileError
from armonic.files.frf_arrays import found_frfs, holds_frfs
from armonic.files.hdf5_tree import Group, Tree, opened
from armonic.files.mapped import measured
from armonic.files.measured_file import Geometry, MeasuredFile, Skipped
from armonic.files.named_arrays import Stored, found_record, listing
from armonic.files.sampling import built, settle
from armonic.frf_set import FrfSet
from armonic.series import TimeSeries
from armonic.writing import write_whole

if TYPE_CHECKING:
    from armonic.files.channel_map import ChannelMap

MARK = "armonic_measured"
"""Attribute of every file that was written here: the version of its layout."""
_CHUNK = 1 << 20
"""Bytes of one chunk, so that a checksum stands for little."""
_RECORDS, _FRFS, _MODES, _GEOMETRY = "records", "frfs", "modes", "geometry"


def read_measured_hdf5(
    path: str | Path,
    *,
    channels: ChannelMap | None = None,
    sample_rate_hz: float | None = None,
    variable: str | None = None,
    time_variable: str | None = None,
    freq_variable: str | None = None,
    kind: str | None = None,
    outputs: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    progress: Callable[[float], object] | None = None,
) -> MeasuredFile:
    """Read records, frequency responses, modes and geometry from an HDF5 file or a MATLAB file of version 7.3.

    Of a file of another program every group is one record, if it holds a matrix (or vectors of one length) and times
    or a rate, or the frequency responses, if it holds complex numbers and frequencies. Names are the usual ones (time,
    fs, dt, freq_hz, coherence; channels or names, units, outputs, inputs, kind), also as attributes.

    Nothing outside the file is read: links, virtual and external data, references and data packed by plugins are
    left, and `skipped` says so.

    Args:
        path: the file.
        channels: from channels to places; None takes their names.
        sample_rate_hz: the rate, where the file tells none; where it does, the two must agree.
        variable: of another program's file the array to take, "group/name".
        time_variable: its times, where they are called otherwise, by the name within the group.
        freq_variable: its frequencies likewise.
        kind: what its responses are: receptance, mobility or accelerance.
        outputs: their degrees of freedom, such as sensor.x.
        inputs: those of the forces.
        progress: called with the share that is read.

    Raises:
        DataFileError: the file is none, is damaged, or holds nothing that can be read.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    asked = {"freq_variable": freq_variable, "kind": kind, "outputs": outputs, "inputs": inputs}
    with opened(path) as tree:
        if MARK in tree.root.attributes:
            return _own(path, tree, channels, sample_rate_hz, progress)
        return _foreign(path, tree, channels, sample_rate_hz, (variable, time_variable), asked, progress)


def write_measured_hdf5(
    path: str | Path,
    *,
    records: Iterable[TimeSeries] = (),
    frfs: FrfSet | None = None,
    modes: ModeTable | None = None,
    geometry: Geometry | None = None,
) -> None:
    """Write measured data as HDF5; all of it comes back bit for bit.

    The groups records/0000, ... hold values (samples, channels), names, quantities, units and notes (JSON), and the
    attributes sample_rate_hz and start_s; frfs holds freq_hz, values (lines, outputs, inputs) complex, outputs,
    inputs, measured, perhaps coherence and averages, notes, and the attributes frf_kind and decay_rate; modes holds
    poles, shapes and coordinates; geometry holds names, positions and lines. Each group says its `kind`, the file
    its version of `armonic`. Everything has checksums; HDF5 of version 1.10 and later opens it.

    Args:
        path: the file; an existing one is replaced, once all is written.
        records: time records.
        frfs: frequency responses.
        modes: modes.
        geometry: points and lines.

    Raises:
        DataFileError: there is nothing to write, or the file cannot be written.
    """
    from armonic import __version__

    listed = tuple(records)
    if not listed and frfs is None and modes is None and geometry is None:
        raise DataFileError(str(path), found="nothing to write", expected="records, FRFs, modes or geometry")
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=("v110", "v110")) as file:  # whose headers and indices have checksums
        file.attrs[MARK] = 1
        _say(file, "armonic", __version__)
        for k, record in enumerate(listed):
            group = _group(file, f"{_RECORDS}/{k:04d}", "record", record.notes)
            group.attrs["sample_rate_hz"], group.attrs["start_s"] = record.sample_rate_hz, record.start_s
            _put(group, "values", record.values)
            _put_texts(group, "names", [c.name for c in record.channels])
            _put_texts(group, "quantities", [c.quantity for c in record.channels])
            _put_texts(group, "units", [c.unit for c in record.channels])
        if frfs is not None:
            group = _group(file, _FRFS, "frfs", frfs.notes)
            _say(group, "frf_kind", frfs.kind)
            group.attrs["decay_rate"] = frfs.decay_rate
            _put(group, "freq_hz", frfs.freq_hz)
            _put(group, "values", frfs.values)
            _put(group, "measured", frfs.measured.astype("u1"))
            _put_texts(group, "outputs", frfs.outputs)
            _put_texts(group, "inputs", frfs.inputs)
            for name in ("coherence", "averages"):
                if (array := getattr(frfs, name)) is not None:
                    _put(group, name, array)
        if modes is not None:
            group = _group(file, _MODES, "modes", {})
            _put(group, "poles", modes.poles)
            if modes.shapes is not None and modes.coordinates is not None:
                _put(group, "shapes", modes.shapes)
                _put_texts(group, "coordinates", modes.coordinates)
        if geometry is not None:
            group = _group(file, _GEOMETRY, "geometry", {})
            _put(group, "positions", geometry.positions)
            _put(group, "lines", np.array(geometry.lines, np.int64).reshape(-1, 2))
            _put_texts(group, "names", geometry.names)
    write_whole(path, buffer.getvalue())


def _group(file: Any, name: str, kind: str, notes: Mapping[str, str]) -> Any:
    group = file.create_group(name)
    _say(group, "kind", kind)
    if notes:
        _put_texts(group, "notes", [json.dumps(dict(notes))])  # escaped, so that every character has a place
    return group


def _say(holder: Any, name: str, text: str) -> None:
    holder.attrs[name] = np.array(text.encode(), h5py.string_dtype("utf-8", len(text.encode())))  # not in a heap


def _put(group: Any, name: str, array: NDArray[Any]) -> None:
    if not array.size:
        group[name] = array
        return
    rows = max(1, min(array.shape[0], _CHUNK // max(1, array[0].nbytes)))
    chunks = (rows, *array.shape[1:])
    group.create_dataset(name, data=array, chunks=chunks, shuffle=True, compression=1, fletcher32=True)


def _put_texts(group: Any, name: str, texts: Sequence[str]) -> None:
    coded = [text.encode() for text in texts]
    width = max([1, *map(len, coded)])
    array = np.array(coded, dtype=h5py.string_dtype("utf-8", width))
    if coded:
        group.create_dataset(name, data=array, chunks=(len(coded),), compression=1, fletcher32=True)
    else:
        group[name] = array


def _own(
    path: str | Path,
    tree: Tree,
    channels: ChannelMap | None,
    asked_hz: float | None,
    progress: Callable[[float], object] | None,
) -> MeasuredFile:
    if (version := tree.root.attributes[MARK]) != 1:
        found = f"version {version!r:.20} of the layout"
        raise DataFileError(str(path), found=found, expected="version 1", hint="Update Armonic.")
    skipped = list(tree.skipped)
    parts: dict[str, list[Any]] = {"record": [], "frfs": [], "modes": [], "geometry": []}
    groups = [group for group in tree.root.all() if group.attributes.get("kind") in parts]
    for k, group in enumerate(groups, 1):
        kind = group.attributes["kind"]
        lost = [item.what for item in tree.skipped if item.what.startswith(f"{group.path}/")]
        try:
            if lost:
                raise KeyError(f"{lost[0]} cannot be read")
            if kind == "record":
                parts[kind].append(_record(path, group))
            else:
                parts[kind].append({"frfs": _frfs, "modes": _modes, "geometry": _geometry}[kind](group))
        except (ArmonicError, KeyError, TypeError, ValueError, AttributeError, IndexError, OSError) as error:
            reason = " ".join(str(error).split()).strip("'\"")[:160]
            skipped.append(Skipped(0, 0, group.path, f"damaged ({reason})"))
        if progress is not None:
            progress(k / len(groups))
    if not any(parts.values()):
        found = f"a damaged file ({skipped[0]})" if skipped else "a file with nothing in it"
        raise DataFileError(str(path), found=found, expected="records, FRFs, modes or geometry")
    for record in parts["record"]:
        settle(path, None, stated_hz=record.sample_rate_hz, asked_hz=asked_hz)
    one = {kind: items[0] if items else None for kind, items in parts.items()}
    return measured(
        path,
        channels=channels,
        records=parts["record"],
        frfs=one["frfs"],
        modes=one["modes"],
        geometry=one["geometry"],
        skipped=skipped,
        remarks=[f"{path} has no coherence."] if one["frfs"] is not None and one["frfs"].coherence is None else (),
    )


def _record(path: str | Path, group: Group) -> TimeSeries:
    rate, start = float(group.attributes["sample_rate_hz"]), float(group.attributes["start_s"])
    channels = list(zip(*(group.texts[name] for name in ("names", "quantities", "units")), strict=True))
    return built(path, group.arrays["values"].numbers(), (start, rate), channels, _notes(group))


def _frfs(group: Group) -> FrfSet:
    read = {name: array.read() for name, array in group.arrays.items()}
    return FrfSet(
        read["freq_hz"],
        read["values"],
        group.attributes["frf_kind"],
        group.texts["outputs"],
        group.texts["inputs"],
        coherence=read.get("coherence"),
        averages=read.get("averages"),
        measured=read["measured"].astype(bool),
        decay_rate=float(group.attributes["decay_rate"]),
        notes=_notes(group),
    )


def _modes(group: Group) -> ModeTable:
    shapes = group.arrays["shapes"].read() if "shapes" in group.arrays else None
    return ModeTable(group.arrays["poles"].read(), shapes, group.texts.get("coordinates"))


def _geometry(group: Group) -> Geometry:
    names, positions = group.texts["names"], group.arrays["positions"].numbers()
    lines = tuple((int(a), int(b)) for a, b in group.arrays["lines"].read())
    if positions.shape != (len(names), 3) or not all(0 <= k < len(names) for line in lines for k in line):
        raise ValueError(f"{len(names)} points with positions {positions.shape}")
    return Geometry(names, positions, lines)


def _notes(group: Group) -> dict[str, str]:
    noted = json.loads(group.texts["notes"][0]) if "notes" in group.texts else {}
    return {str(name): str(text) for name, text in noted.items()}


def _foreign(
    path: str | Path,
    tree: Tree,
    channels: ChannelMap | None,
    sample_rate_hz: float | None,
    names: tuple[str | None, str | None],
    asked: dict[str, Any],
    progress: Callable[[float], object] | None,
) -> MeasuredFile:
    wanted, times = names
    groups = [group for group in tree.root.all() if any(array.size > 1 for array in group.arrays.values())]
    if wanted is not None:
        home, _, wanted = wanted.strip("/").rpartition("/")
        groups = [group for group in groups if group.path == home and wanted in group.arrays]
        if not groups:
            found = f"no array {names[0]} ({_everything(tree)})"
            raise DataFileError(str(path), found=found, expected="the array that variable= names")
    skipped, remarks = list(tree.skipped), list[str]()
    records: list[TimeSeries] = []
    frfs: FrfSet | None = None
    refusals: list[ArmonicError] = []
    for k, group in enumerate(groups, 1):
        where = f"{path}: {group.path}" if group.path else str(path)
        arrays = _with_attributes(tree, group)
        try:
            if holds_frfs(arrays, wanted):
                found_set = found_frfs(where, arrays, texts=_texts(tree, group), variable=wanted, **asked)
                if frfs is not None:
                    hint = "Name the one to take with variable=."
                    raise DataFileError(where, found="a second set of FRFs", expected="one in each file", hint=hint)
                frfs = found_set.frfs
                skipped += found_set.skipped
                remarks += found_set.remarks
            else:
                texts = _texts(tree, group)
                record = found_record(
                    where,
                    arrays,
                    sample_rate_hz=sample_rate_hz,
                    variable=wanted,
                    time_variable=times,
                    names=texts.get("channels") or texts.get("names") or (),
                    units=texts.get("units") or (),
                )
                records.append(record)
        except ArmonicError as error:
            refusals.append(error)
            skipped.append(Skipped(0, 0, group.path or "the root group", " ".join(str(error).split())[:240]))
        if progress is not None:
            progress(k / len(groups))
    if frfs is None and not records:
        if refusals:
            raise refusals[0]
        found = f"nothing to read ({skipped[0]})" if skipped else "no array of numbers"
        raise DataFileError(str(path), found=found, expected="records or FRFs")
    return measured(path, channels=channels, records=records, frfs=frfs, skipped=skipped, remarks=remarks)


def _with_attributes(tree: Tree, group: Group) -> dict[str, Stored]:
    """The arrays of a group, with the single numbers among its attributes and the root's, such as a rate."""
    arrays = dict(group.arrays)
    for name, value in {**tree.root.attributes, **group.attributes}.items():
        number = np.asarray(value)
        if name not in arrays and number.size == 1 and number.dtype.kind in "fiu":
            arrays[name] = Stored((), number.dtype.kind, lambda n=number: n)  # type: ignore[misc]
    return arrays


def _texts(tree: Tree, group: Group) -> dict[str, tuple[str, ...]]:
    texts: dict[str, tuple[str, ...]] = {}
    for source in (tree.root.attributes, tree.root.texts, group.attributes, group.texts):
        for name, value in source.items():
            if isinstance(value, str):
                texts[name] = (value,)
            elif isinstance(value, tuple) and all(isinstance(text, str) for text in value):
                texts[name] = value
    return texts


def _everything(tree: Tree) -> str:
    return listing({f"{g.path}/{n}".lstrip("/"): a for g in tree.root.all() for n, a in g.arrays.items()})
