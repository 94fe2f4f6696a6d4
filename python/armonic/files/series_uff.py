"""Universal files (data sets 58 of function type 1), as a time series."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armonic.errors import DataFileError
from armonic.files import uff_reader, uff_writer
from armonic.files.cells import AXES, read_bytes
from armonic.files.sampling import AGREE, Array, built, plain, settle
from armonic.files.uff_reader import FUNCTION_TYPES, NUMBER, TIME, TIME_RESPONSE, Units, shown
from armonic.series import Quantity, TimeSeries
from armonic.writing import write_whole

TYPES: dict[Quantity, int] = {
    "joint_position": 8, "motor_position": 8, "displacement": 8,
    "joint_velocity": 11, "motor_velocity": 11, "velocity": 11,
    "joint_acceleration": 12, "acceleration": 12,
    "shaft_torque": 9, "force": 13, "motor_torque": 13,
    "energy": 1, "power": 1, "signal": 1,
}  # fmt: skip
_QUANTITIES: dict[int, tuple[Quantity, str]] = {
    8: ("displacement", "m"), 11: ("velocity", "m/s"), 12: ("acceleration", "m/s²"), 9: ("force", "N"),
    13: ("force", "N"),
}  # fmt: skip
MARK = "armonic "
_WIDE = (1e-99, 9.9999999999995e99)  # below and from here on, numbers of 13 digits have exponents of three
_PADDING = 6  # zeros with which some exporters fill the last line


class _Record(NamedTuple):
    """One data set: where it stands, what it holds, and when."""

    place: str
    channel: tuple[str, str, str]
    values: Array
    start_s: float
    rate: float


def read_series_uff(path: str | Path, *, sample_rate_hz: float | None = None) -> TimeSeries:
    """Read the time records (data sets 58 or 58b of function type 1) of a universal file.

    Channels of another program are named after node and direction ("node_3.x"); a negative direction turns the sign.
    Lengths and forces are converted to SI with the factors of data set 164, if the file has one other than 1;
    otherwise values stay as they are, with the unit they are labelled with.

    Args:
        path: the file.
        sample_rate_hz: the rate that is expected; None takes what the file says.

    Raises:
        DataFileError: the file is no universal file, is damaged, or its records do not share one sampling.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    records = _records(read_bytes(path), str(path))
    first = records[0]
    seen: dict[tuple[str, str], str] = {}
    for record in records:
        name, quantity, _ = record.channel
        if (quantity, name) in seen:
            found = f"{quantity}:{name} again"
            raise DataFileError(record.place, found=found, expected=f"one record, as at {seen[quantity, name]}")
        seen[quantity, name] = record.place
        # Fields of 13 columns keep about 6 digits of a step, so that two ends may differ by less than a sample.
        slack = 0.01 / first.rate + 1e-6 * abs(first.start_s)
        alike = abs(record.rate - first.rate) <= 1e-6 * first.rate and abs(record.start_s - first.start_s) <= slack
        if record.values.size != first.values.size or not alike:
            raise DataFileError(
                record.place,
                found=f"{quantity}:{name} of {_span(record)}",
                expected=f"{_span(first)}, as {first.channel[1]}:{first.channel[0]} at {first.place}",
            )
    _, rate = settle(path, None, stated_hz=first.rate, asked_hz=sample_rate_hz)
    values = np.column_stack([record.values for record in records])
    return built(path, values, (first.start_s, rate), [record.channel for record in records])


def write_series_uff(path: str | Path, series: TimeSeries, *, binary: bool = False) -> None:
    """Write a universal file, one data set 58 of function type 1 per channel, in double precision.

    Text keeps 13 digits of the values, and 12 of negative ones whose exponent has three; binary keeps every bit. Rate
    and start come back exactly. Channels that stand for an axis ("tool.x", "link_2.z") get its direction code, others
    none. Notes have no place in the format.

    Args:
        path: the file; an existing one is replaced, once all is written.
        series: what to write.
        binary: write data sets 58b, smaller and exact, instead of text.

    Raises:
        DataFileError: the file cannot be written, or a channel's name or unit does not fit into a line of it.
    """
    stems = list(dict.fromkeys(stem_of(channel.name)[0] for channel in series.channels))
    parts = [uff_writer.header("Time series")]
    for k, channel in enumerate(series.channels):
        parts.append(encoded(path, series, k, stems.index(stem_of(channel.name)[0]) + 1, binary=binary))
    write_whole(path, b"".join(parts))


def encoded(
    path: str | Path,
    series: TimeSeries,
    column: int,
    node: int,
    *,
    binary: bool,
    record: int | None = None,
    double: bool = True,
) -> bytes:
    """One channel as a data set 58.

    Args:
        path: the file, for errors.
        series: the record.
        column: which of its channels.
        node: the number of its place.
        binary: whether the values are.
        record: the number of the record where a file has several.
        double: whether binary values are in double precision.

    Raises:
        DataFileError: the channel's name or unit does not fit into a line.
    """
    channel, values = series.channels[column], series.values[:, column]
    stem, direction = stem_of(channel.name)
    if direction in (1, 2, 3) and re.match(r"rad|N[· ]?m\b", channel.unit):
        direction += 3
    about = MARK + json.dumps({"quantity": channel.quantity, "unit": channel.unit})
    when = MARK + json.dumps({"rate_hz": series.sample_rate_hz, "start_s": series.start_s})
    for what, line in (("name", channel.name), ("unit", about)):
        if len(line) > 80 or not line.isascii() or " ".join(line.split()) != line or line == "NONE":
            raise DataFileError(
                str(path),
                found=f"the {what} of {channel.label}",
                expected="one that fits into a line of 80 ASCII characters",
                hint="Write it as CSV, MATLAB or Zarr." if record is None else "Write it as HDF5.",
            )
    return uff_writer.data_set_58(
        kind=TIME_RESPONSE,
        ids=(
            channel.name,
            "" if record is None else MARK + json.dumps({"record": record}),
            uff_writer.timestamp(),
            about,
            when,
        ),
        response=(stem if stem.isalnum() and len(stem) <= 10 else "NONE", node, direction),
        reference=("NONE", 0, 0),
        abscissa=(TIME, "Time", "s"),
        ordinate=(TYPES[channel.quantity], channel.quantity, channel.unit.replace("²", "^2").replace("·", " ")),
        denominator=(0, "NONE", "NONE"),
        form=uff_writer.Form(
            4 if double or not binary else 2,
            uff_writer.decimal(series.start_s),
            uff_writer.decimal(1 / series.sample_rate_hz),
            True,
            values.size,
            values.astype("<f8" if double else "<f4").tobytes() if binary else _text_values(values),
        ),
        binary=binary,
        version=0 if record is None else min(record, 99999),
    )


def _text_values(values: Array) -> bytes:
    size = np.abs(values)
    # These would fill all 20 columns and merge with a nan or inf ahead of them: they get a digit less.
    wide = (values < 0) & np.isfinite(values) & ((size >= _WIDE[1]) | (size < _WIDE[0]))
    forms = np.where(wide, "%20.11e", "%20.12e").tolist()
    lines = ["".join(forms[k : k + 4]) for k in range(0, values.size, 4)]
    return ("\n".join([*lines, ""]) % tuple(values.tolist())).encode()


def stem_of(name: str) -> tuple[str, int]:
    """What stands before the axis in a name, and the direction code of the axis; 0 if it has none."""
    stem, _, axis = name.rpartition(".")
    return (stem, AXES.index(axis) + 1) if stem and axis in AXES else (name, 0)


def _span(record: _Record) -> str:
    return f"{record.values.size} samples at {record.rate:.9g} Hz from {record.start_s:.9g} s"


def _records(data: bytes, name: str) -> list[_Record]:
    reader = uff_reader.Reader(data.removeprefix(b"\xef\xbb\xbf"), name)
    records: list[_Record] = []
    ignored: Counter[str] = Counter()
    units = Units()
    if not reader.data.strip(b" \r\n\t\x00\x1a"):
        raise DataFileError(name, found="an empty file", expected="a universal file with data sets 58")
    while reader.enter():
        number, binary = reader.identify()
        if number == 58:
            kind, record = _record(reader, units, binary)
            if record is None:
                ignored[f"58 of function type {kind} ({FUNCTION_TYPES.get(kind, 'other')})"] += 1
            else:
                records.append(record)
            continue
        ignored[str(number)] += 1
        body = reader.to_close(binary=binary is not None)
        if number == 164:
            units = uff_reader.read_164(reader, body)
    if not records:
        there = ", ".join(what if n == 1 else f"{n} of {what}" for what, n in ignored.items())
        found = f"only data sets {there}" if there else "no data set"
        raise DataFileError(name, found=found, expected="time records: data sets 58 of function type 1")
    return records


def _record(reader: uff_reader.Reader, units: Units, binary: str | None) -> tuple[int, _Record | None]:
    kind, lines, places = uff_reader.read_lines_58(reader)
    if kind != TIME_RESPONSE:
        reader.to_close(binary=binary is not None)
        return kind, None
    head = uff_reader.read_head_58(reader, kind, lines, places)
    if not head.real:
        raise reader.error(f"ordinate data type {head.storage}", "2 or 4 (real) for a time record", at=places[6])
    uff_reader.refuse_other_abscissa(reader, head, TIME)
    if binary is None:
        table = _text_table(reader, head.length, len(head.columns))
    else:
        table = uff_reader.binary_table(reader, binary, head.length, head.columns, double=head.double)
    place = f"{reader.name}, line {1 + reader.data.count(bytes([10]), 0, reader.start)}"
    if not head.even:
        start_s, rate = settle(place, table[:, 0])
    elif head.step > 0:
        start_s, rate = head.start, float(f"{1 / head.step:.12g}")
    else:
        raise reader.error(f"a time step of {head.step:g} s", "a positive one", at=places[6])
    start_s, rate = exact(lines[4], start_s, rate)
    channel, factor = _channel(reader, lines, *head.response, units, places[8])
    return kind, _Record(place, channel, table[:, -1] * factor, start_s, rate)


def _text_table(reader: uff_reader.Reader, count: int, width: int) -> Array:
    """(count, width) numbers; unlike those of an FRF they may be NaN or infinite."""
    at = reader.offset
    text = reader.to_close().decode("latin-1")
    words = uff_reader.SIGN_IN_WORD.sub(" ", re.sub("[dD](?=[-+0-9])", "e", text)).split()
    needed = count * width
    try:
        numbers = np.array([float(word) for word in words])
        if "_" in text:
            raise ValueError
    except ValueError:
        word = next(w for w in words if not (NUMBER.fullmatch(w) or w.lower().lstrip("+-") in ("nan", "inf")))
        raise reader.error(shown(word), "a number", at=at + max(text.find(word), 0)) from None
    padded = needed < len(words) < needed + _PADDING and not numbers[needed:].any()
    if len(words) != needed and not padded:
        hint = uff_reader.TRUNCATED if len(words) < needed else None
        raise reader.error(f"{len(words)} numbers", f"{needed}, for {count} samples", hint, at=at)
    return numbers[:needed].reshape(count, width)


def of_ours(line: str) -> dict[str, Any]:
    """What a line of `write_series_uff` says; nothing for that of another program."""
    if line.startswith(MARK):
        try:
            found = json.loads(line.removeprefix(MARK))
        except ValueError:
            return {}
        if isinstance(found, dict):
            return found
    return {}


def exact(line: str, start_s: float, rate: float) -> tuple[float, float]:
    """Start and rate in full, where our own line has them and the fields do not say otherwise."""
    about = of_ours(line)
    own_start, own_rate = about.get("start_s"), about.get("rate_hz")
    if not (isinstance(own_start, float) and isinstance(own_rate, float)):
        return start_s, rate
    same = abs(own_rate - rate) <= AGREE * rate and abs(own_start - start_s) <= AGREE * abs(start_s)
    return (own_start, own_rate) if same else (start_s, rate)


def _channel(
    reader: uff_reader.Reader, lines: list[str], node: int, direction: int, units: Units, at: int
) -> tuple[tuple[str, str, str], float]:
    """Name, quantity and unit of a record, and the factor of its values."""
    about = of_ours(lines[3].strip())
    if isinstance(about.get("quantity"), str) and isinstance(about.get("unit"), str):
        return (lines[0].strip(), about["quantity"], about["unit"]), 1.0
    if abs(direction) > len(AXES):
        raise reader.error(f"direction {direction}", "0, or ±1 to ±6 for ±x, ±y, ±z and rotations about them", at=at)
    entity, ordinate = plain(lines[5][31:41]), lines[8]
    stem = f"node_{node}" if entity in ("", "NONE") else f"{entity}.node_{node}"
    axis = AXES[abs(direction) - 1] if direction else ""
    number = reader.integer(ordinate[:10], "specific data type", at)
    quantity, si = _QUANTITIES.get(number, ("signal", ""))
    unit = plain(ordinate[46:67])
    rotation = abs(direction) > 3
    factor, labelled = 1.0, "" if unit == "NONE" else unit
    if si.startswith("m") and not rotation and units.length != 1:
        factor, labelled = 1 / units.length, si
    elif si == "N" and (units.force != 1 or (rotation and units.length != 1)):
        factor, labelled = 1 / units.force / (units.length if rotation else 1.0), "N·m" if rotation else si
    default = (si.replace("m", "rad", 1) if si.startswith("m") else "N·m" if si else "") if rotation else si
    sign = -1.0 if direction < 0 else 1.0
    return (f"{stem}.{axis}" if axis else stem, quantity, labelled or default), sign * factor
