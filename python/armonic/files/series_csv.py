"""Comma-separated text, as a time series."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from armonic.errors import DataFileError
from armonic.files import sheet
from armonic.files.sampling import Array, built, guessed, plain, settle
from armonic.files.uff_reader import NUMBER, shown
from armonic.series import QUANTITIES, TimeSeries
from armonic.writing import write_whole

_COMMENT = re.compile(r"#\s*armonic series\s+(\{.*\})\s*")
_TIME = re.compile(r"(?:time|timestamp|zeit|t)(?:[ _]*[(\[]?(?P<unit>s|sec|seconds|ms|us|µs)[)\]]?)?", re.IGNORECASE)
_SECONDS = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_UNIT = re.compile(r"(?P<label>.*\S) ?(?:\((?P<round>[^()]*)\)|\[(?P<square>[^\[\]]*)\])")
_OURS = re.compile(r"(?P<label>.*) \((?P<unit>.*)\)")
_EXPECTED = "a header such as time (s),motor_position:link_2.z (rad), then one line per sample"


def read_series_csv(path: str | Path, *, sample_rate_hz: float | None = None) -> TimeSeries:
    """Read a time series from comma-separated text, of `write_series_csv` or of another program.

    Lines that start with # are skipped. The first line that is left names the columns, with units in brackets; where
    it holds numbers there are no names. A first column called time or t, with a unit of s, ms or µs, holds the times.
    Columns may be separated by semicolons or tabs, and then have decimal commas. Missing values are written nan.

    Args:
        path: the file.
        sample_rate_hz: the rate, where the file has no times; where it has, they must agree.

    Raises:
        DataFileError: the file is no such table, is cut off, or its times are not even times.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    lines = [(k, line) for k, line in enumerate(sheet.text_of(path, _EXPECTED).split("\n"), 1) if line.strip()]
    comments = [line for _, line in lines if line.startswith("#")]
    table = [(k, line) for k, line in lines if not line.startswith("#")]
    if not table:
        raise DataFileError(str(path), found="no table", expected=_EXPECTED)
    about = _about(path, comments)
    foreign = (";", "\t") if not about else ()  # a name of ours may hold one of them
    mark = next((mark for mark in foreign if mark in table[0][1]), ",")
    header = _words(f"{path}, line {table[0][0]}", table[0][1], mark)
    if all(_is_number(word, mark) for word in header):
        header = [f"column_{k}" for k in range(1, len(header) + 1)]
    else:
        table = table[1:]
    if not table:
        raise DataFileError(str(path), found="a header and no sample", expected="at least one line of numbers")
    numbers = _numbers(path, table, header, mark)
    if len(numbers) != about.get("samples", len(numbers)):
        found, hint = f"{len(numbers)} samples", "The file looks truncated: copy it again."
        raise DataFileError(str(path), found=found, expected=f"{about['samples']}, as its comment says", hint=hint)
    time = _TIME.fullmatch(header[0].strip())
    columns = header[1:] if time else header
    if not columns:
        raise DataFileError(f"{path}, line {table[0][0]}", found="times alone", expected="at least one channel")
    times = numbers[:, 0] * _SECONDS.get((time["unit"] or "s").lower(), 1.0) if time else None
    sampling = settle(
        path,
        times,
        stated_hz=about.get("sample_rate_hz"),
        asked_hz=sample_rate_hz,
        own_start_s=about.get("start_s"),
        place=lambda k: f"{path}, line {table[k][0]}",
    )
    channels = [_own_channel(path, word) if about else _foreign_channel(word) for word in columns]
    start_s = about.get("start_s", sampling[0])
    return built(path, numbers[:, 1:] if time else numbers, (start_s, sampling[1]), channels, about.get("notes"))


def write_series_csv(path: str | Path, series: TimeSeries) -> None:
    """Write comma-separated text, as `read_series_csv` reads it; every number comes back bit for bit.

    Args:
        path: the file; an existing one is replaced, once all is written.
        series: what to write.

    Raises:
        DataFileError: the file cannot be written, or a unit has no place in the header.
    """
    if wrong := [channel.unit for channel in series.channels if " (" in channel.unit]:
        raise DataFileError(str(path), found=f"the unit {wrong[0]!r}", expected="units without a blank and a bracket")
    about = {
        "sample_rate_hz": series.sample_rate_hz,
        "start_s": series.start_s,
        "samples": len(series),
        "notes": dict(series.notes),
    }
    file = io.StringIO()
    file.write(f"# armonic series {json.dumps(about, ensure_ascii=False)}\n")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["time (s)", *(f"{channel.label} ({channel.unit})" for channel in series.channels)])
    for row in np.column_stack([series.time_s, series.values]):
        file.write(",".join(map(repr, row.tolist())) + "\n")
    # Half a character, which only notes may hold, has no UTF-8; written as \udc80 it is what JSON calls it.
    write_whole(path, file.getvalue().encode(errors="backslashreplace"))


def _about(path: str | Path, comments: list[str]) -> dict[str, Any]:
    """What a file of ours says of itself in its comment; nothing for another one."""
    found = next(filter(None, map(_COMMENT.fullmatch, comments)), None)
    if found is None:
        return {}
    expected = (
        'a comment such as # armonic series {"sample_rate_hz": 1000.0, "start_s": 0.0, "samples": 9, "notes": {}}'
    )
    try:
        about: dict[str, Any] = json.loads(found[1])
        about = {
            "sample_rate_hz": float(about["sample_rate_hz"]),
            "start_s": float(about["start_s"]),
            "samples": int(about["samples"]),
            "notes": {str(name): str(text) for name, text in about["notes"].items()},
        }
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise DataFileError(str(path), found=shown(found[0]), expected=expected) from error
    return about


def _words(place: str, line: str, mark: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=mark))
    except (csv.Error, StopIteration) as error:
        raise DataFileError(place, found=f"a line that cannot be split ({error})", expected=_EXPECTED) from error


def _is_number(word: str, mark: str) -> bool:
    word = word.strip().lower()
    if mark != ",":
        word = word.replace(",", ".")
    return bool(NUMBER.fullmatch(word)) or word.lstrip("+-") in ("nan", "inf", "infinity")


def _numbers(path: str | Path, table: list[tuple[int, str]], header: list[str], mark: str) -> Array:
    rows = [line if mark == "," else line.replace(",", ".") for _, line in table]
    try:
        numbers = np.loadtxt(rows, delimiter=mark, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        numbers = np.empty((0, 0))
    if numbers.shape == (len(rows), len(header)):
        return numbers
    for (k, _), row in zip(table, rows, strict=True):
        place = f"{path}, line {k}"
        words = _words(place, row, mark)
        if len(words) != len(header):
            raise DataFileError(place, found=f"{len(words)} values", expected=f"{len(header)}, one per column")
        for word, column in zip(words, header, strict=True):
            if not _is_number(word, mark):
                hint = "Write nan where a value is missing." if not word.strip() else None
                raise DataFileError(place, found=f"{shown(word)} for {column.strip()}", expected="a number", hint=hint)
    raise DataFileError(str(path), found="text that makes no table", expected=_EXPECTED)


def _own_channel(path: str | Path, word: str) -> tuple[str, str, str]:
    match = _OURS.fullmatch(word)
    quantity, colon, name = match["label"].partition(":") if match else ("", "", "")
    if match is None or not colon:
        raise DataFileError(str(path), found=f"column {shown(word)}", expected="such as motor_position:link_2.z (rad)")
    return name, quantity, match["unit"]


def _foreign_channel(word: str) -> tuple[str, str, str]:
    match = _UNIT.fullmatch(word.strip())
    label, unit = (match["label"], match["round"] or match["square"] or "") if match else (word, "")
    label, unit = plain(label), plain(unit)
    quantity, colon, name = label.partition(":")
    if colon and quantity in QUANTITIES and name.strip():
        return name.strip(), quantity, unit
    return label or "column", guessed(unit), unit
