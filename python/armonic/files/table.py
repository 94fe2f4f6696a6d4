"""Comma-separated text, as a matrix of frequency responses."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from armonic.errors import DataFileError, FrfError
from armonic.files.cells import Cell, matrix, remapping
from armonic.files.sheet import read_sheet
from armonic.files.uff_reader import shown
from armonic.response import KINDS, Frf, Kind
from armonic.writing import write_whole

_COMMENT = re.compile(
    r"#\s*armonic frf\b(?:.*?\bkind=(?P<kind>\w+))?"
    r"(?:.*?\binput_frame=(?P<input_frame>\S+))?(?:.*?\bframe=(?P<frame>.*\S))?"
)
_COLUMN = re.compile(r"(?P<output>[^\s,/\"]+)/(?P<input>[^\s,/\"]+) (?P<part>re|im)")
_HEADER = "a header such as freq_hz,x/x re,x/x im (response/force, real and imaginary part)"


def read_csv(
    path: str | Path,
    *,
    frame: str | None = None,
    kind: Kind | None = None,
    axes: Mapping[str, str] | None = None,
    outputs: str | Sequence[str] | None = None,
    inputs: str | Sequence[str] | None = None,
) -> Frf:
    """Read an FRF matrix from comma-separated text in SI units.

    A comment `# armonic frf kind=accelerance frame=sensor`, then the header `freq_hz,x/y re,x/y im,...`,
    where x/y is the response along x per force along y, then one line per frequency. Other lines that start
    with # are skipped.

    Args:
        path: the file.
        frame: the sensor frame; default: that of the comment.
        kind: what was measured; default: that of the comment.
        axes: from an axis of the file to the axis of the sensor frame it lies along, as in `read_uff`.
        outputs: read only these axes of the response (of the sensor frame), in this order.
        inputs: read only these axes of the force.

    Raises:
        DataFileError: the file is not such a table, or does not hold one whole FRF matrix.
        FrfError: `axes` does not make sense.
    """
    sheet = read_sheet(path, _HEADER)
    if comment := next(filter(None, map(_COMMENT.match, sheet.comments)), None):
        kind, frame = kind or _as_kind(path, comment["kind"]), frame or comment["frame"]
    if kind is None:
        expected = "a first line such as # armonic frf kind=accelerance"
        hint = f"Add it, or pass kind= as one of {', '.join(KINDS)}."
        raise DataFileError(str(path), found="no word on what was measured", expected=expected, hint=hint)
    columns = _columns(sheet.place, sheet.header)
    if not sheet.rows:
        raise DataFileError(str(path), found="a header and no frequency line", expected="at least one line")
    table = sheet.numbers()
    remap = remapping(axes)
    cells = []
    for (source, target), parts in columns.items():
        (output, sign), (force, force_sign) = (remap.get(axis, (axis, 1)) for axis in (source, target))
        values = np.asarray(table[:, parts["re"]] + 1j * table[:, parts["im"]], np.complex128) * (sign * force_sign)
        cells.append(Cell(f"{path}, column {source}/{target}", output, force, table[:, 0], values))
    return replace(matrix(path, cells, kind, frame, outputs, inputs), input_frame=comment and comment["input_frame"])


def write_csv(path: str | Path, frf: Frf) -> None:
    """Write comma-separated text, as `read_csv` reads it; every number comes back bit for bit.

    Args:
        path: the file; an existing one is replaced, once all is written.
        frf: what to write.

    Raises:
        DataFileError: the file cannot be written.
        FrfError: a label holds a blank, comma, slash or quote, or the frame's name a line break.
    """
    header = ["freq_hz"]
    for output in frf.outputs:
        for force in frf.inputs:
            header += [f"{output}/{force} re", f"{output}/{force} im"]
    if wrong := [column for column in header[1:] if not _COLUMN.fullmatch(column)]:
        raise FrfError("Frf.outputs", found=wrong[0], expected="axes without blanks, commas, slashes and quotes")
    if frf.frame is not None and (not frf.frame.isprintable() or frf.frame != frf.frame.strip()):
        raise FrfError("Frf.frame", found=repr(frf.frame), expected="a name in one line")
    comment = f"# armonic frf kind={frf.kind}"
    if frf.input_frame not in (None, frf.frame):
        if len(str(frf.input_frame).split()) != 1 or not str(frf.input_frame).isprintable():
            raise FrfError("Frf.input_frame", found=repr(frf.input_frame), expected="a name without blanks")
        comment += f" input_frame={frf.input_frame}"
    comment += f" frame={frf.frame}" if frf.frame else ""
    parts = frf.values.reshape(frf.freq_hz.size, -1).view(np.float64)
    rows = np.column_stack([frf.freq_hz, parts]).tolist()
    table = "".join(",".join(map(repr, row)) + "\n" for row in rows)
    write_whole(path, f"{comment}\n{','.join(header)}\n{table}".encode())


def _as_kind(path: str | Path, word: str | None) -> Kind | None:
    for kind in KINDS:
        if word == kind:
            return kind
    if word is None:
        return None
    raise DataFileError(str(path), found=f"kind={shown(word)}", expected=f"kind= one of {', '.join(KINDS)}")


def _columns(place: str, words: list[str]) -> dict[tuple[str, str], dict[str, int]]:
    """The positions of real and imaginary part of every response/force in the header."""
    if words[0].strip() != "freq_hz" or len(words) < 2:
        raise DataFileError(place, found=shown(",".join(words)), expected=_HEADER)
    columns: dict[tuple[str, str], dict[str, int]] = {}
    for position, word in enumerate(words[1:], 1):
        match = _COLUMN.fullmatch(word.strip())
        if match is None:
            raise DataFileError(place, found=f"column {shown(word)}", expected=_HEADER)
        parts = columns.setdefault((match["output"], match["input"]), {})
        if match["part"] in parts:
            raise DataFileError(place, found=f"column {shown(word)} twice", expected="every column once")
        parts[match["part"]] = position
    for (output, force), parts in columns.items():
        if len(parts) == 1:
            raise DataFileError(place, found=f"{output}/{force} {next(iter(parts))} alone", expected="both re and im")
    return columns
