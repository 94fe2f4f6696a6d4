"""Time responses of a universal file (data sets 58 of function type 1) as records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from armonic.errors import DataFileError, SignalError
from armonic.files.mapped import mapped_record
from armonic.files.measured_file import Skipped
from armonic.files.sampling import Array, settle
from armonic.files.series_uff import exact, of_ours
from armonic.files.uff_functions import Function58, Names, largest_agreeing, quantity_of, reason_of, si_factor, units_of
from armonic.files.uff_index import UffSource
from armonic.files.uff_notes import Notes
from armonic.files.uff_table import rows
from armonic.series import Channel, TimeSeries

_FIELD, _FIGURES = 5, 12  # digits of E13.5 behind the point, and as many as a field of 13 columns may have
_Channel = tuple[int, int, int, str, str]  # node, direction without sign, data type, entity, name where it needs one


class _Response(NamedTuple):
    """A time response before its values are read."""

    function: Function58
    channel: Channel
    factor: float
    length: int
    start_s: float
    rate: float

    @property
    def span(self) -> str:
        return f"{self.length} samples at {self.rate:.9g} Hz from {self.start_s:.6g} s"

    def agrees(self, other: _Response) -> bool:
        """Whether both are samples of the same times."""
        # Fields of 13 columns keep about 6 digits of a start, so that two may differ by less than a sample.
        slack = 0.01 / other.rate + 1e-6 * abs(other.start_s)
        return (
            self.length == other.length
            and abs(self.rate - other.rate) <= 1e-6 * other.rate
            and abs(self.start_s - other.start_s) <= slack
        )


def read_records(
    source: UffSource,
    functions: list[Function58],
    names: Names,
    notes: tuple[Notes, Mapping[str, str]],
    skipped: list[Skipped],
    remarks: list[str],
) -> list[TimeSeries]:
    """The time responses of a file, those that were taken at once in a record, under the names of a map.

    What belongs together is told by the numbers of a data set where these distinguish anything: function
    identification, version and load case. Otherwise a record begins where a channel comes again.

    Args:
        source: the file.
        functions: its time responses.
        names: what they are called.
        notes: of the file, and those that every record has.
        skipped: what cannot be read is added.
        remarks: sentences are added.

    Raises:
        DataFileError: a map and the file do not go together.
    """
    records = []
    for group in _grouped(functions):
        found = []
        for function in group:
            try:
                found.append(_response(source, function, names, remarks))
            except DataFileError as error:
                skipped.append(function.skipped(reason_of(error), source.line_of(function.data_set.at)))
        kept = _alike(source, _once(source, found, skipped), skipped)
        if kept:
            number = _number(kept[0].function)
            about = {**notes[1], **notes[0].records.get(number or 0, {})}
            record = _read(source, kept, names, about, skipped, remarks)
            if record is not None:
                records.append(record)
    return records


def _response(source: UffSource, function: Function58, names: Names, remarks: list[str]) -> _Response:
    head = function.head
    if not head.real:
        raise DataFileError("form", found="complex values", expected="real ones (ordinate data type 2 or 4)")
    if not head.even:
        place = source.place(function.data_set.at)
        times = np.concatenate([block[:, 0] for block in rows(source, function.data_set, head, function.start)])
        start_s, rate = settle(place, times)
    elif head.step > 0:
        start_s, rate = exact(head.lines[4].strip(), head.start, _rate(head.step))
    else:
        raise DataFileError("step", found=f"a time step of {head.step:g} s", expected="a positive one")
    about = of_ours(head.lines[3].strip())
    label = units_of(function)[0]
    name, place_ = names.of(function, 0, quantity_of(head.types[1], label))
    factor = 1.0
    if isinstance(about.get("quantity"), str) and isinstance(about.get("unit"), str):
        quantity, unit = about["quantity"], about["unit"]
    else:
        known = quantity_of(head.types[1], label) or (place_.quantity if place_ else None)
        if known is None:
            found = f"data type {head.types[1]}" + (f" in {label}" if label else " and no unit")
            raise DataFileError("type", found=found, expected="a force or a motion, which a channel map could tell")
        quantity, unit = known, label
        if place_ is not None and not place_.scaled:
            axis = place_.label.rpartition(".")[2]
            factor, unit = si_factor(label, quantity, axis, function.units, remarks)
    try:
        channel = Channel(name, quantity, unit)
    except SignalError as error:
        raise DataFileError(error.where, found=error.found, expected=error.expected) from error
    return _Response(function, channel, factor, head.length, start_s, rate)


def _read(
    source: UffSource,
    found: list[_Response],
    names: Names,
    notes: Mapping[str, str],
    skipped: list[Skipped],
    remarks: list[str],
) -> TimeSeries | None:
    first = found[0]
    where = f"{source.name}, record of {first.function.numbered}"
    # Two samples tell which channels the map keeps and what it does to them, before any values are read.
    probe = np.ones((2, len(found)))
    probe[1] = np.arange(len(found)) + 1
    told: list[str] = []
    try:
        asked = TimeSeries(probe, first.rate, tuple(r.channel for r in found), first.start_s, notes)
    except SignalError as error:
        raise DataFileError(where, found=error.found, expected=error.expected, hint=error.hint) from error
    mapped = mapped_record(asked, names.channels, where=where, remarks=told)
    remarks += told
    factors = mapped.values[0]
    kept = [found[round(float(k)) - 1] for k in mapped.values[1] / factors]
    values = np.empty((first.length, len(kept)))
    whole = []
    for column, (response, factor) in enumerate(zip(kept, factors * [r.factor for r in kept], strict=True)):
        try:
            _fill(values[:, column], source, response.function, factor)
            whole.append(column)
        except DataFileError as error:
            line = source.line_of(response.function.data_set.at)
            skipped.append(response.function.skipped(reason_of(error), line))
    if not whole:
        return None
    if len(whole) < len(kept):
        values = values[:, whole]
    return TimeSeries(values, first.rate, tuple(mapped.channels[c] for c in whole), first.start_s, notes)


def _fill(values: Array, source: UffSource, function: Function58, factor: float) -> None:
    row = 0
    for block in rows(source, function.data_set, function.head, function.start):
        np.multiply(block[:, -1], factor, out=values[row : row + len(block)])
        row += len(block)


def _once(source: UffSource, found: list[_Response], skipped: list[Skipped]) -> list[_Response]:
    """Every channel once, the first."""
    first: dict[str, _Response] = {}
    for response in found:
        earlier = first.setdefault(response.channel.label, response)
        if earlier is not response:
            reason = f"{response.channel.label} again, as in {earlier.function.numbered}, which is kept"
            skipped.append(response.function.skipped(reason, source.line_of(response.function.data_set.at)))
    return list(first.values())


def _alike(source: UffSource, found: list[_Response], skipped: list[Skipped]) -> list[_Response]:
    """Those of a record that share one sampling; the others, fewer of them, are left and named."""
    kept, left = largest_agreeing(found, _Response.agrees)
    for response in left:
        reason = f"{response.span}, where {kept[0].function.numbered} of the same record has {kept[0].span}"
        skipped.append(response.function.skipped(reason, source.line_of(response.function.data_set.at)))
    return kept


def _grouped(functions: list[Function58]) -> Iterator[list[Function58]]:
    """Functions by record, in the order of the file."""
    if not functions:
        return
    channels: list[_Channel] = [
        (node, abs(code), f.head.types[1], f.entities[0], "" if code else f.title)
        for f in functions
        for node, code in (f.head.response,)
    ]
    numbers = _distinguishing(functions, channels)
    if numbers is not None:
        groups: dict[tuple[int, ...], list[Function58]] = {}
        for function, numbered in zip(functions, numbers, strict=True):
            groups.setdefault(numbered, []).append(function)
        yield from groups.values()
        return
    group: list[Function58] = []
    seen: set[object] = set()
    previous = None
    for function, channel in zip(functions, channels, strict=True):
        number = _number(function)
        if group and (channel in seen or number != previous):
            yield group
            group, seen = [], set()
        group.append(function)
        seen.add(channel)
        previous = number
    yield group


def _distinguishing(functions: list[Function58], channels: list[_Channel]) -> list[tuple[int, ...]] | None:
    """A number of each function that is the same within a record; None if the file has none.

    Some programs number all functions of a file, and some none: a number counts only if no channel comes twice under
    it, and it either holds several channels each time or comes as often as the channel that comes most.
    """
    if any(_number(function) is not None for function in functions):
        return None
    most = max(Counter(channels).values())
    for parts in ((0, 1, 2), (1, 2), (1,), (2,), (0,)):
        numbers = [tuple(function.head.numbers[k] for k in parts) for function in functions]
        sizes = Counter(numbers)
        once = len(set(zip(numbers, channels, strict=True))) == len(functions)
        if once and len(sizes) > 1 and (min(sizes.values()) > 1 or len(sizes) == most):
            return numbers
    return None


def _number(function: Function58) -> int | None:
    """The number of the record, as files of ours note it."""
    number = of_ours(function.head.lines[1].strip()).get("record")
    return number if isinstance(number, int) else None


def _rate(step: float) -> float:
    """The roundest rate of which the step is the inverse, rounded as it is written: 512 Hz of 1.95313E-03 s."""
    mantissa, exponent = f"{step:.{_FIGURES}e}".split("e")
    digits = max(_FIELD, len(mantissa.rstrip("0")) - 2)
    half = 0.501 * 10.0 ** (int(exponent) - digits)  # some round halves up, and some to even
    for figures in range(1, _FIGURES):
        rate = float(f"{1 / step:.{figures}g}")
        if abs(1 / rate - step) <= half:
            return rate
    return float(f"{1 / step:.{_FIGURES}g}")
