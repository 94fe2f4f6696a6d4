"""Measured data in from universal files: what can be read is, and what cannot is named."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import ArmonicError, DataFileError
from armonic.files.cells import AXES, read_bytes
from armonic.files.mapped import measured
from armonic.files.measured_file import Geometry, MeasuredFile, Skipped
from armonic.files.measured_uff_writer import FORCE, KIND_TYPES, NOTE, TYPES
from armonic.files.uff_reader import (
    FUNCTION_TYPES,
    HEADER_LINES,
    NUMBER,
    SIGN_IN_WORD,
    Reader,
    Units,
    binary_table,
    read_164,
)
from armonic.frf_set import FrfSet
from armonic.series import Channel, TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.files.channel_map import ChannelMap

    Array: TypeAlias = NDArray[np.float64]

QUANTITIES = {number: quantity for quantity, number in TYPES.items()}
KINDS = {number: kind for kind, number in KIND_TYPES.items()}
_OPENS = re.compile(rb"^    -1[ \r]*\n *\d+", re.MULTILINE)
_SI = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s²", "force": "N"}
MOST_BAD = 0.5
"""Share of the lines of a function that may hold no numbers and be left out."""


@dataclass(frozen=True, eq=False)
class Found:
    """One function of a data set 58: where it stands, what it is, and its values in the units of the file."""

    dataset: int
    line: int
    kind: int
    group: tuple[int, int, int]
    response: tuple[int, int]
    reference: tuple[int, int]
    types: tuple[int, int, int]
    unit: str
    start: float
    step: float
    x: Array | None
    values: NDArray[Any]
    title: str
    note: dict[str, Any]
    units: Units

    @property
    def what(self) -> str:
        """What it is, in words."""
        node, code = self.response
        return f"data set 58, {FUNCTION_TYPES.get(self.kind, f'function type {self.kind}')} at {node}:{code:+d}"

    def skipped(self, reason: str) -> Skipped:
        """That it was left, and why."""
        return Skipped(self.dataset, self.line, self.what, reason)

    def label(self, end: tuple[int, int], name: str) -> tuple[str, float]:
        """Degree of freedom and sign of one of its ends."""
        place = str(self.note.get(name) or end[0])
        return f"{place}.{AXES[abs(end[1]) - 1]}", 1.0 if end[1] > 0 else -1.0


def read_measured_uff(
    path: str | Path, *, channels: ChannelMap | None = None, progress: Callable[[float], object] | None = None
) -> MeasuredFile:
    """Read records, frequency responses, coherences and points (data sets 58 and 58b, 15, 164).

    What is damaged or unknown is left out and named; the rest is read.

    Args:
        path: the file.
        channels: what its channels are.
        progress: called with the share that was read.

    Raises:
        DataFileError: the file is no universal file, or nothing in it can be read.
    """
    data = read_bytes(path).removeprefix(b"\xef\xbb\xbf")
    reader = Reader(data, str(path))
    found: list[Found] = []
    skipped: list[Skipped] = []
    points: list[tuple[int, Array]] = []
    notes: dict[str, str] = {}
    units, number, stated = Units(), 0, False
    with np.errstate(all="ignore"):  # values that are none are found as such
        while True:
            at = reader.offset
            try:
                if not reader.enter():
                    break
                number += 1
                at = reader.start
                kind, binary = reader.identify()
                if kind == 58:
                    _read_58(reader, binary, number, units, found, skipped)
                    continue
                body = reader.to_close(binary=binary is not None)
                if kind == 164:
                    units, stated = read_164(reader, body), True
                elif kind == 15:
                    points += _points(reader, body, units)
                elif kind == 9151:
                    notes = _notes(body)
                elif kind not in (82, 151):
                    line = 1 + data.count(b"\n", 0, at)
                    skipped.append(Skipped(number, line, f"data set {kind}", "a type that Armonic has no use for"))
            except DataFileError as error:
                if not number:
                    raise
                line = 1 + data.count(b"\n", 0, at)
                told = f"found {error.found}, expected {error.expected}"
                skipped.append(Skipped(number, line, "data set", f"damaged: {told}"))
                again = _OPENS.search(data, max(at, reader.start))
                if again is None:
                    break
                reader.offset = again.start()
            if progress is not None:
                progress(reader.offset / max(len(data), 1))
    remarks = [] if stated or not found else ["The file states no units (data set 164): its numbers are taken for SI."]
    records = _records([f for f in found if f.kind == 1], notes, skipped)
    frfs = _frfs([f for f in found if f.kind == 4], [f for f in found if f.kind == 6], notes, skipped, remarks)
    names = {f.response[0]: str(f.note["place"]) for f in found if "place" in f.note}
    geometry = None
    if points:
        geometry = Geometry(tuple(names.get(n, str(n)) for n, _ in points), np.array([p for _, p in points]))
    if not records and frfs is None and geometry is None:
        left = "; ".join(map(str, skipped[:3])) or "no data set that holds any"
        raise DataFileError(str(path), found=f"no measured data ({left})", expected="time or frequency responses")
    return measured(
        path, channels=channels, records=records, frfs=frfs, geometry=geometry, skipped=skipped, remarks=remarks
    )


def _read_58(
    reader: Reader, binary: str | None, number: int, units: Units, found: list[Found], skipped: list[Skipped]
) -> None:
    start = reader.start
    records = [reader.line() for _ in range(HEADER_LINES)]
    line = 1 + reader.data.count(b"\n", 0, start)
    dof, form, abscissa, ordinate, denominator = records[5:10]
    kind = reader.integer(dof[0:5], "function type", start)
    if kind not in (1, 4, 6):
        reader.to_close(binary=binary is not None)
        skipped.append(Skipped(number, line, f"data set 58 of function type {kind}", "neither response nor coherence"))
        return
    whole = [reader.integer(dof[a:b], "a field of the sixth line", start) for a, b in ((5, 15), (15, 20), (20, 30))]
    ends = [reader.integer(dof[a:b], "node or direction", start) for a, b in ((41, 51), (51, 55), (66, 76), (76, 80))]
    storage, count, spacing = (reader.integer(form[10 * i : 10 * i + 10], "a field", start) for i in range(3))
    first, step = (reader.number(form[a:b], "abscissa", start) for a, b in ((30, 43), (43, 56)))
    types = [reader.integer(text[:10], "data type", start) for text in (abscissa, ordinate, denominator)]
    is_complex = storage in (5, 6)
    if storage not in (2, 4, 5, 6) or count < 1:
        raise reader.error(f"ordinate data type {storage} with {count} values", "2, 4, 5 or 6 and a value", at=start)
    columns = (*(() if spacing == 1 else ("x",)), "re", *(("im",) if is_complex else ()))
    if binary is not None:
        table = binary_table(reader, binary, count, columns, double=storage in (4, 6))
        _refuse_swapped(reader, table, binary, start)
    else:
        table = _text_values(reader, count * len(columns), start).reshape(count, len(columns))
    note: dict[str, Any] = {}
    for text in (records[1], records[3], records[4]):
        if text.startswith(NOTE):
            try:
                note |= json.loads(text.removeprefix(NOTE))
            except (json.JSONDecodeError, TypeError):
                continue  # a title of somebody else's
    values = table[:, -2] + 1j * table[:, -1] if is_complex else table[:, -1]
    found.append(
        Found(
            number, line, kind, (whole[0], whole[1], whole[2]), (ends[0], ends[1]), (ends[2], ends[3]),
            (types[0], types[1], types[2]), ordinate[46:67].strip(), float(note.get("f0", first)),
            float(note.get("df", 1 / note["rate"] if "rate" in note else step)), None if spacing == 1 else table[:, 0],
            values, records[0].strip(), note, units,
        )
    )  # fmt: skip


def _refuse_swapped(reader: Reader, table: Array, binary: str, start: int) -> None:
    """Refuse values that only the other byte order makes sense of."""
    size = np.abs(table[table != 0])
    if size.size and (not np.isfinite(size).all() or np.median(size) < 1e-30 or np.median(size) > 1e30):
        swapped = np.abs(table.astype("<f4").byteswap().astype(float))
        usual = swapped[np.isfinite(swapped) & (swapped > 0)]
        if usual.size > 0.9 * size.size and 1e-15 < np.median(usual) < 1e15:
            raise reader.error(
                "values in the other byte order", f"byte order {binary[:6].strip()}, as it says", at=start
            )


def _text_values(reader: Reader, needed: int, start: int) -> Array:
    text = reader.to_close().decode("latin-1").replace("D", "E").replace("d", "e")
    words = SIGN_IN_WORD.sub(" ", text).split()
    if not needed <= len(words) < needed + 6:
        raise reader.error(f"{len(words)} numbers", f"{needed}", at=start)
    return np.array([float(w) if NUMBER.fullmatch(w) else np.nan for w in words[:needed]])


def _records(found: list[Found], notes: dict[str, str], skipped: list[Skipped]) -> list[TimeSeries]:
    """Functions of one sequence number, or between two of one channel, make a record."""
    told = len({f.group for f in found}) > 1
    groups: list[list[Found]] = []
    for f in found:
        if f.types[1] not in QUANTITIES:
            skipped.append(f.skipped(f"a data type {f.types[1]} that is neither force nor motion"))
            continue
        if not 1 <= abs(f.response[1]) <= len(AXES):
            skipped.append(f.skipped(f"direction {f.response[1]}, which is none"))
            continue
        key = (f.response, f.types[1])
        last = groups[-1] if groups else []
        fresh = not last or (told and last[0].group != f.group) or key in [(g.response, g.types[1]) for g in last]
        if fresh:
            groups.append([f])
        elif len(f.values) != len(last[0].values) or abs(f.step / last[0].step - 1) > 1e-6:
            skipped.append(f.skipped("different resolution or length than the rest of its record"))
        else:
            last.append(f)
    records = []
    for group in groups:
        columns, channels = [], []
        for f in group:
            label, sign = f.label(f.response, "place")
            quantity = QUANTITIES[f.types[1]]
            factor = 1 / (f.units.force if quantity == "force" else f.units.length)
            unit = _SI[quantity] if f.units.length != 1 or f.units.force != 1 or not f.unit else f.unit
            unit = _SI[quantity] if unit in ("NONE", "m/s^2") else unit
            columns.append(np.real(f.values) * sign * factor)
            channels.append(Channel(label, quantity, unit))  # type: ignore[arg-type]
        try:
            records.append(
                TimeSeries(np.column_stack(columns), 1 / group[0].step, tuple(channels), group[0].start, notes)
            )
        except (ArmonicError, ZeroDivisionError) as error:
            skipped.append(group[0].skipped(str(error)))
    return records


def _frfs(
    found: list[Found], coherences: list[Found], notes: dict[str, str], skipped: list[Skipped], remarks: list[str]
) -> FrfSet | None:
    usable: dict[tuple[str, str], tuple[Found, NDArray[Any]]] = {}
    for f in found:
        if f.types[1] not in KINDS or f.types[2] != FORCE:
            skipped.append(f.skipped(f"a response of type {f.types[1]} without force (type {f.types[2]})"))
            continue
        (output, sign), (force, turned) = f.label(f.response, "place"), f.label(f.reference, "hit")
        if (output, force) in usable:
            skipped.append(f.skipped(f"{output} to {force} for the second time"))
            continue
        factor = sign * turned * f.units.force / f.units.length
        usable[output, force] = f, f.values * factor
    if not usable:
        return None
    grids: dict[bytes, list[tuple[str, str]]] = {}
    for pair, (f, _) in usable.items():
        grids.setdefault(_lines(f).round(9).tobytes(), []).append(pair)
    kept = max(grids.values(), key=len)
    for pair in [pair for pair in usable if pair not in kept]:
        skipped.append(usable[pair][0].skipped(f"different resolution than data set {usable[kept[0]][0].dataset}"))
    first = usable[kept[0]][0]
    freq = _lines(first)
    outputs, inputs = (tuple(dict.fromkeys(pair[k] for pair in kept)) for k in (0, 1))
    values = np.zeros((len(freq), len(outputs), len(inputs)), np.complex128)
    measured_pairs = np.zeros(values.shape[1:], bool)
    averages = np.zeros(values.shape[1:], np.int64)
    gamma = np.full(values.shape, np.nan)
    s, power = 2j * np.pi * freq + float(first.note.get("decay", 0.0)), list(KIND_TYPES).index(KINDS[first.types[1]])
    for pair in kept:
        f, own = usable[pair]
        i, j = outputs.index(pair[0]), inputs.index(pair[1])
        values[:, i, j] = own * s ** float(power - list(KIND_TYPES).index(KINDS[f.types[1]]))
        measured_pairs[i, j], averages[i, j] = True, int(f.note.get("n", 0))
    for c in coherences:
        pair = c.label(c.response, "place")[0], c.label(c.reference, "hit")[0]
        if pair in kept and len(c.values) == len(freq):
            gamma[:, outputs.index(pair[0]), inputs.index(pair[1])] = np.real(c.values)
    good = np.isfinite(values).all(axis=(1, 2))
    if not good.any() or np.mean(~good) > MOST_BAD:
        skipped.append(first.skipped("most of its lines, or of those beside it, are no numbers"))
        return None
    if not good.all():
        remarks.append(f"{int((~good).sum())} of {len(freq)} lines hold values that are no numbers: left out.")
    coherence = gamma[good] if np.isfinite(gamma[good][:, measured_pairs]).all() else None
    if coherences and coherence is None:
        remarks.append("Coherence is missing for some responses: none is used.")
    return FrfSet(
        freq[good], values[good], KINDS[first.types[1]], outputs, inputs,  # type: ignore[arg-type]
        coherence=None if coherence is None else np.nan_to_num(np.clip(coherence, 0, 1)),
        averages=averages if averages[measured_pairs].all() else None, measured=measured_pairs,
        decay_rate=float(first.note.get("decay", 0.0)), notes=notes,
    )  # fmt: skip


def _lines(f: Found) -> Array:
    return f.x if f.x is not None else np.asarray(f.start + f.step * np.arange(len(f.values)), np.float64)


def _points(reader: Reader, body: bytes, units: Units) -> list[tuple[int, Array]]:
    rows = [line for line in body.decode("latin-1").splitlines() if line.strip()]
    points = []
    for row in rows:
        place = [reader.number(row[40 + 13 * k : 53 + 13 * k], "a coordinate", reader.start) for k in range(3)]
        points.append((reader.integer(row[:10], "a node", reader.start), np.array(place) / units.length))
    return points


def _notes(body: bytes) -> dict[str, str]:
    text = "".join(line[2:] for line in body.decode("latin-1").splitlines() if line.startswith("> "))
    try:
        given = json.loads(text)
    except json.JSONDecodeError:
        return {}
    return {str(k): str(v) for k, v in given.items()} if isinstance(given, dict) else {}
