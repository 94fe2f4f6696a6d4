"""Several measured files as one: records in a row, frequency responses in one set where their lines agree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.coherence import SAME_LINE
from armonic.files.measured_file import Geometry, MeasuredFile, Skipped
from armonic.frf_set import FrfSet
from armonic.response import KINDS


def joined(files: Sequence[MeasuredFile]) -> MeasuredFile:
    """Several files as one.

    Of a response that is in two files the first is kept, and of modes those of the first file that has some; the
    others are among `skipped`.

    Args:
        files: at least one.

    Raises:
        DataFileError: their frequency responses have different lines or exponential windows.
    """
    if len(files) == 1:
        return files[0]
    skipped = [Skipped(s.dataset, s.line, f"{f.path}: {s.what}", s.reason) for f in files for s in f.skipped]
    remarks = [text if f.path in text else f"{f.path}: {text}" for f in files for text in f.remarks]
    sets = [(f.path, f.frfs) for f in files if f.frfs is not None]
    with_modes = [f for f in files if f.modes is not None]
    skipped += [Skipped(0, 0, f"{f.path}: modes", f"those of {with_modes[0].path} are kept") for f in with_modes[1:]]
    return MeasuredFile(
        ", ".join(f.path for f in files),
        tuple(record for f in files for record in f.records),
        joined_frfs(sets, skipped, remarks) if sets else None,
        with_modes[0].modes if with_modes else None,
        _joined_geometry([(f.path, f.geometry) for f in files if f.geometry is not None], remarks),
        tuple(skipped),
        tuple(dict.fromkeys(remarks)),
    )


def joined_frfs(sets: Sequence[tuple[str, FrfSet]], skipped: list[Skipped], remarks: list[str]) -> FrfSet:
    """Several sets of frequency responses as one, over all of their degrees of freedom.

    Args:
        sets: each with the file it is from; at least one.
        skipped: responses that are in two of them are added here.
        remarks: sentences are added here.

    Raises:
        DataFileError: two sets have different lines or exponential windows.
    """
    first_path, first = sets[0]
    if len(sets) == 1:
        return first
    for path, other in sets[1:]:
        _refuse_other_lines(first_path, first, path, other)
    highest = KINDS[max(KINDS.index(frfs.kind) for _, frfs in sets)]  # to it no line at 0 Hz is divided by zero
    if changed := [path for path, frfs in sets if frfs.kind != highest]:
        remarks.append(f"The responses of {', '.join(changed)} were converted to {highest}.")
    outputs = tuple(dict.fromkeys(label for _, frfs in sets for label in frfs.outputs))
    inputs = tuple(dict.fromkeys(label for _, frfs in sets for label in frfs.inputs))
    shape = (first.freq_hz.size, len(outputs), len(inputs))
    values, coherence = np.zeros(shape, np.complex128), np.zeros(shape)
    averages, owner = np.zeros(shape[1:], np.int64), np.full(shape[1:], -1)
    for k, (path, frfs) in enumerate(sets):
        rows, columns = ([side.index(x) for x in own] for side, own in ((outputs, frfs.outputs), (inputs, frfs.inputs)))
        pair = np.ix_(rows, columns)
        taken = owner[pair] >= 0
        for i, j in np.argwhere(taken & frfs.measured):
            name = f"{path}: response {frfs.outputs[i]} to {frfs.inputs[j]}"
            skipped.append(Skipped(0, 0, name, f"that of {sets[int(owner[pair][i, j])][0]} is kept"))
        new = frfs.measured & ~taken
        _fill(values, rows, columns, new, frfs.to(highest).values)
        if frfs.coherence is not None:
            _fill(coherence, rows, columns, new, frfs.coherence)
        if frfs.averages is not None:
            averages[pair] = np.where(new, frfs.averages, averages[pair])
        owner[pair] = np.where(new, k, owner[pair])
    without = [path for path, frfs in sets if frfs.coherence is None]
    if 0 < len(without) < len(sets):
        remarks.append(f"{', '.join(without)} has no coherence: that of the other files is left out.")
    counted = all(frfs.averages is not None for _, frfs in sets)
    notes = dict(first.notes)
    for _, frfs in sets[1:]:
        notes = {name: text for name, text in notes.items() if frfs.notes.get(name) == text}
    return FrfSet(
        first.freq_hz,
        values,
        highest,
        outputs,
        inputs,
        coherence=None if without else coherence,
        averages=averages if counted else None,
        measured=owner >= 0,
        decay_rate=first.decay_rate,
        notes=notes,
    )


def _fill(
    whole: NDArray[np.complex128] | NDArray[np.float64],
    rows: list[int],
    columns: list[int],
    new: NDArray[np.bool_],
    part: NDArray[np.complex128] | NDArray[np.float64],
) -> None:
    """Puts the new pairs of a part in their places."""
    i, j = np.nonzero(new)
    whole[:, np.array(rows)[i], np.array(columns)[j]] = part[:, i, j]


def _refuse_other_lines(first_path: str, first: FrfSet, path: str, other: FrfSet) -> None:
    """Refuse sets of different resolution, or under different exponential windows."""
    f, g = first.freq_hz, other.freq_hz
    if f.size != g.size or (np.abs(f - g) > SAME_LINE * f[-1]).any():
        raise DataFileError(
            path,
            found=f"different resolutions: {_span(g)}",
            expected=f"{_span(f)}, as in {first_path}",
            hint="Read the files one by one, or export both with the same lines.",
        )
    if abs(first.decay_rate - other.decay_rate) > 1e-9 * max(first.decay_rate, other.decay_rate):
        raise DataFileError(
            path,
            found=f"an exponential window of {other.decay_rate:g}/s",
            expected=f"one of {first.decay_rate:g}/s, as in {first_path}",
            hint="Read the files one by one.",
        )


def _joined_geometry(parts: Sequence[tuple[str, Geometry]], remarks: list[str]) -> Geometry | None:
    """All points by name, where the first file has them, and all lines."""
    if not parts:
        return None
    points: dict[str, NDArray[np.float64]] = {}
    lines: dict[tuple[int, int], None] = {}
    for path, geometry in parts:
        for name, position in zip(geometry.names, geometry.positions, strict=True):
            if not np.allclose(points.setdefault(name, position), position, rtol=1e-6, atol=1e-6):  # digits of a file
                remarks.append(f"{path}: point {name} lies elsewhere than in another file, whose place is kept.")
        index = {name: k for k, name in enumerate(points)}
        for a, b in geometry.lines:
            lines[index[geometry.names[a]], index[geometry.names[b]]] = None
    return Geometry(tuple(points), np.array(list(points.values())).reshape(-1, 3), tuple(lines))


def _span(f: NDArray[np.float64]) -> str:
    step = f", first step {f[1] - f[0]:.7g} Hz" if f.size > 1 else ""
    return f"{f.size} lines from {f[0]:.7g} to {f[-1]:.7g} Hz{step}"
