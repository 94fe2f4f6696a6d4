"""Frequency responses and coherences of a universal file (data sets 58 of function types 4 and 6) as one set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError, FrfError
from armonic.files.channel_map import ChannelPlace
from armonic.files.coherence import ABOVE_ONE, SAME_LINE
from armonic.files.measured_file import Skipped
from armonic.files.sampling import Array
from armonic.files.series_uff import of_ours
from armonic.files.uff_functions import (
    Function58,
    Names,
    largest_agreeing,
    quantity_of,
    reason_of,
    shown_dof,
    si_factor,
    units_of,
)
from armonic.files.uff_index import UffSource
from armonic.files.uff_table import rows
from armonic.frf_set import FrfSet
from armonic.response import KINDS, Kind

MOST_BAD = 0.5
"""Of the lines of a function fewer than this share may be no numbers; they are left out."""
_OF_QUANTITY: dict[str, Kind] = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}


class _Response(NamedTuple):
    """A frequency response before its values are read; factor and kind are those that lead to SI."""

    function: Function58
    output: str
    input: str
    kind: Kind
    factor: float
    freq_hz: Array
    decay_rate: float
    averages: int

    @property
    def span(self) -> str:
        f = self.freq_hz
        step = f", first step {f[1] - f[0]:.7g} Hz" if f.size > 1 else ""
        window = f", under an exponential window of {self.decay_rate:g}/s" if self.decay_rate else ""
        return f"{f.size} lines from {f[0]:.7g} to {f[-1]:.7g} Hz{step}{window}"

    def agrees(self, other: _Response) -> bool:
        """Whether both have the same lines."""
        return _same(self.freq_hz, other.freq_hz) and self.decay_rate == other.decay_rate


class _Reading:
    """What is shared while the functions of a file are read."""

    def __init__(self, source: UffSource, names: Names, skipped: list[Skipped], remarks: list[str]) -> None:
        self.source, self.names, self.skipped, self.remarks = source, names, skipped, remarks
        self._lines: dict[tuple[float, float, int] | None, Array] = {}  # under None the last uneven ones
        self._placed: dict[tuple[str, str], tuple[str, ChannelPlace]] = {}

    def skip(self, function: Function58, reason: str) -> None:
        self.skipped.append(function.skipped(reason, self.source.line_of(function.data_set.at)))

    def place(self, function: Function58, end: int, side: str) -> ChannelPlace | None:
        """Where an end of a function is; None if a strict map leaves it out.

        Raises:
            DataFileError: it has no axis.
        """
        name, place = self.names.of(function, end, side)
        if place is None:
            return None
        _, direction = (function.head.response, function.head.reference)[end]
        if not direction and not place.line:
            ending = ("response", "reference")[end]
            raise DataFileError("direction", found=f"{ending} direction 0 (scalar)", expected="±1 to ±6")
        # One degree of freedom whichever way it runs, and whatever number its node has in files put together.
        self._placed.setdefault((side, name.replace(".-", ".")), (name, place))
        return place

    def refuse_mapped_twice(self) -> None:
        """Refuse two degrees of freedom of the file that fall on one of the robot."""
        told = ((name, side, place) for (side, _), (name, place) in self._placed.items())
        self.names.channels.refuse_same(self.source.name, told)

    def values(self, function: Function58, out: NDArray[np.complex128] | Array) -> None:
        """Fill in the values of a function."""
        row = 0
        for block in rows(self.source, function.data_set, function.head, function.start):
            part = out[row : row + len(block)]
            if function.head.real:
                part[:] = block[:, -1]
            else:
                part.real, part.imag = block[:, -2], block[:, -1]
            row += len(block)

    def lines(self, function: Function58) -> Array:
        """Its frequencies in Hz.

        Raises:
            DataFileError: they are none.
        """
        head = function.head
        key = (head.start, head.step, head.length) if head.even else None
        if key is not None and key in self._lines:
            return self._lines[key]
        if head.even:
            f = np.float64(head.start) + head.step * np.arange(head.length)
        else:
            f = np.concatenate([block[:, 0] for block in rows(self.source, function.data_set, head, function.start)])
        if not (np.isfinite(f).all() and f[0] >= 0 and (np.diff(f) > 0).all()):
            raise DataFileError(
                "abscissa", found="frequencies that do not increase from 0 Hz on", expected="some in Hz"
            )
        last = self._lines.setdefault(key, f)
        if not np.array_equal(last, f):
            last = self._lines[key] = f
        return last  # one array for all that share it


def read_frfs(
    source: UffSource,
    functions: list[Function58],
    coherences: list[Function58],
    names: Names,
    notes: Mapping[str, str],
    skipped: list[Skipped],
    remarks: list[str],
) -> FrfSet | None:
    """The frequency responses of a file with their coherence, under the names of a map; None if it has none.

    Of different resolutions that with the most responses is kept. Lines at which a response or its coherence is no
    number are left out of all, as long as that are fewer than half of them.

    Args:
        source: the file.
        functions: those of function type 4.
        coherences: those of function type 6.
        names: what their ends are called.
        notes: of the set.
        skipped: what cannot be read is added.
        remarks: sentences are added.

    Raises:
        DataFileError: a map and the file do not go together.
    """
    reading = _Reading(source, names, skipped, remarks)
    found: list[_Response] = []
    for function in functions:
        try:
            response = _response(reading, function)
        except DataFileError as error:
            reading.skip(function, reason_of(error))
            continue
        if response is not None:
            found.append(response)
    reading.refuse_mapped_twice()
    kept = _of_one_resolution(reading, _once(reading, found))
    frfs = _assembled(reading, kept, coherences, notes) if kept else None
    if frfs is None:
        for function in coherences:
            reading.skip(function, "there is no frequency response it could belong to")
    return frfs


def _response(reading: _Reading, function: Function58) -> _Response | None:
    head = function.head
    if head.real:
        raise DataFileError("form", found=f"ordinate data type {head.storage} (real)", expected="complex values")
    units = units_of(function)
    quantity, under = (quantity_of(t, unit) for t, unit in zip(head.types[1:], units, strict=True))
    if under != "force":
        found = f"a reference of data type {head.types[2]} at {shown_dof(*head.reference)}"
        raise DataFileError("reference", found=found, expected="13 (force): a response without force")
    output, force = reading.place(function, 0, "motion"), reading.place(function, 1, "force")
    if output is None or force is None:
        return None
    quantity = output.quantity or quantity
    if quantity not in _OF_QUANTITY:
        found = f"a response of data type {head.types[1]}"
        raise DataFileError("response", found=found, expected="8 (displacement), 11 (velocity) or 12 (acceleration)")
    factor = 1.0
    for place, what, label in ((output, quantity, units[0]), (force, "force", units[1])):
        axis = place.label.rpartition(".")[2]
        own = 1.0 if place.scaled else si_factor(label, what, axis, function.units, reading.remarks)[0]
        factor = factor * own * place.factor if place is output else factor / (own * place.factor)
    about = of_ours(head.lines[4].strip())
    decay, averages = about.get("decay_rate", 0.0), about.get("averages", 0)
    return _Response(
        function,
        output.label,
        force.label,
        _OF_QUANTITY[quantity],
        factor,
        reading.lines(function),
        float(decay) if isinstance(decay, float) and 0 <= decay < np.inf else 0.0,
        averages if isinstance(averages, int) and 0 < averages < 1 << 31 else 0,
    )


def _once(reading: _Reading, found: list[_Response]) -> list[_Response]:
    """Every pair of degrees of freedom once, the first."""
    first: dict[tuple[str, str], _Response] = {}
    for response in found:
        earlier = first.setdefault((response.output, response.input), response)
        if earlier is not response:
            pair = f"{response.output} to {response.input}"
            reading.skip(response.function, f"{pair} again, as in {earlier.function.numbered}, which is kept")
    return list(first.values())


def _of_one_resolution(reading: _Reading, found: list[_Response]) -> list[_Response]:
    kept, left = largest_agreeing(found, _Response.agrees)
    for response in left:
        reason = f"different resolutions in one set: {response.span}; {kept[0].function.numbered} has {kept[0].span}"
        reading.skip(response.function, reason)
    return kept


def _assembled(
    reading: _Reading, kept: list[_Response], coherences: list[Function58], notes: Mapping[str, str]
) -> FrfSet | None:
    f, decay_rate = kept[0].freq_hz, kept[0].decay_rate
    outputs, inputs = (
        tuple(dict.fromkeys(labels)) for labels in zip(*((r.output, r.input) for r in kept), strict=True)
    )
    highest = KINDS[max(KINDS.index(r.kind) for r in kept)]  # to it no line at 0 Hz is divided by zero
    values, own = np.zeros((f.size, len(outputs), len(inputs)), np.complex128), np.empty(f.size, np.complex128)
    measured, averages = np.zeros(values.shape[1:], bool), np.zeros(values.shape[1:], np.int64)
    bad = _Bad(f)
    converted: list[str] = []
    for response in kept:
        i, j = outputs.index(response.output), inputs.index(response.input)
        try:
            with np.errstate(all="ignore"):  # what is not finite is dealt with below
                reading.values(response.function, own)
                own *= response.factor
                if power := KINDS.index(highest) - KINDS.index(response.kind):
                    own *= (2j * np.pi * f + decay_rate) ** power
                    converted.append(f"{response.output} to {response.input}")
            bad.add(~np.isfinite(own), f"{response.output} to {response.input}")
        except DataFileError as error:
            reading.skip(response.function, reason_of(error))
            continue
        values[:, i, j] = own
        measured[i, j], averages[i, j] = True, response.averages
    if not measured.any():
        return None
    coherence = _coherence(reading, coherences, f, outputs, inputs, measured, bad)
    if converted:
        reading.remarks.append(f"{len(converted)} responses were converted to {highest}, {converted[0]} among them.")
    rows_, columns = np.flatnonzero(measured.any(axis=1)), np.flatnonzero(measured.any(axis=0))
    if bad.lines.any() or len(rows_) < len(outputs) or len(columns) < len(inputs):
        part = np.ix_(np.flatnonzero(~bad.lines), rows_, columns)
        values, coherence = values[part], None if coherence is None else coherence[part]
        measured, averages = measured[np.ix_(rows_, columns)], averages[np.ix_(rows_, columns)]
    if bad.lines.any():
        reading.remarks.append(bad.told())
    values.setflags(write=False)  # the set takes both as they are
    if coherence is not None:
        coherence.setflags(write=False)
    try:
        return FrfSet(
            f[~bad.lines],
            values,
            highest,
            tuple(outputs[i] for i in rows_),
            tuple(inputs[j] for j in columns),
            coherence=coherence,
            averages=averages if averages[measured].all() else None,
            measured=measured,
            decay_rate=decay_rate,
            notes=notes,
        )
    except FrfError as error:
        raise DataFileError(
            f"{reading.source.name}: {error.where}", found=error.found, expected=error.expected, hint=error.hint
        ) from error


class _Bad:
    """Lines at which something is no number."""

    def __init__(self, freq_hz: Array) -> None:
        self.freq_hz, self.lines = freq_hz, np.zeros(freq_hz.size, bool)
        self.named: list[str] = []

    def add(self, lines: NDArray[np.bool_], name: str) -> None:
        """Leave out some more.

        Raises:
            DataFileError: half of all would be left out.
        """
        if not lines.any():
            return
        together = self.lines | lines
        if together.sum() >= MOST_BAD * lines.size:
            found = f"{int(lines.sum())} of {lines.size} lines that are no finite numbers"
            raise DataFileError(name, found=found, expected="fewer than half, with those of other responses")
        self.lines = together
        self.named.append(name)

    def told(self) -> str:
        """Which, in a sentence."""
        k = int(np.argmax(self.lines))
        others = f" and {len(self.named) - 1} more" if len(self.named) > 1 else ""
        return (
            f"{int(self.lines.sum())} of {self.lines.size} lines are left out, the first at {self.freq_hz[k]:.6g} Hz: "
            f"no finite numbers in {self.named[0]}{others}."
        )


def _coherence(
    reading: _Reading,
    functions: list[Function58],
    f: Array,
    outputs: tuple[str, ...],
    inputs: tuple[str, ...],
    measured: NDArray[np.bool_],
    bad: _Bad,
) -> Array | None:
    """(L, outputs, inputs), or None if it is missing for a response that was measured."""
    if not functions:
        return None
    coherence, there = np.zeros((f.size, *measured.shape)), np.zeros(measured.shape, bool)
    rows_, columns = ({label: k for k, label in enumerate(labels)} for labels in (outputs, inputs))
    for function in functions:
        try:
            output, force = reading.place(function, 0, "motion"), reading.place(function, 1, "force")
            if output is None or force is None:
                continue
            pair = f"{output.label} to {force.label}"
            i, j = rows_.get(output.label, -1), columns.get(force.label, -1)
            if min(i, j) < 0 or not measured[i, j]:
                raise DataFileError("pair", found=pair, expected="a response that is read")
            if there[i, j]:
                raise DataFileError("pair", found=f"{pair} again", expected="it once")
            own = np.empty(f.size)
            _fill_coherence(reading, function, f, own)
            bad.add(~np.isfinite(own), f"the coherence of {pair}")
        except DataFileError as error:
            reading.skip(function, reason_of(error))
            continue
        coherence[:, i, j] = np.clip(np.nan_to_num(own), 0.0, 1.0)
        there[i, j] = True
    if (there & measured).sum() < measured.sum():
        i, j = (int(k) for k in np.argwhere(measured & ~there)[0])
        missing = int((measured & ~there).sum())
        reading.remarks.append(
            f"Coherence is missing for {missing} of {int(measured.sum())} responses, {outputs[i]} to {inputs[j]} among "
            "them: none is used."
        )
        return None
    return coherence


def _fill_coherence(reading: _Reading, function: Function58, f: Array, out: Array) -> None:
    if not function.head.real:
        raise DataFileError("form", found="complex values", expected="real ones (ordinate data type 2 or 4)")
    own = reading.lines(function)
    if not _same(own, f):
        raise DataFileError("lines", found=f"{own.size} other lines", expected=f"the {f.size} of its response")
    reading.values(function, out)
    finite = out[np.isfinite(out)]
    if ((finite < -ABOVE_ONE) | (finite > 1 + ABOVE_ONE)).any():
        worst = finite[np.argmax(np.abs(finite - 0.5))]
        raise DataFileError("coherence", found=f"{worst:g}", expected="values from 0 to 1")


def _same(f: Array, g: Array) -> bool:
    return f.size == g.size and bool((np.abs(f - g) <= SAME_LINE * f[-1]).all())
