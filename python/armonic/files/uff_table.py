"""The numbers of a data set 58, in blocks of rows: text with every word checked, or binary in its byte order."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.uff_index import CHUNK, SCANNED, DataSet, UffSource
from armonic.files.uff_reader import HEADER_LINES, TRUNCATED, Head, shown

Array = NDArray[np.float64]

_OF_NUMBERS = b"0123456789+-.eE \r\n"
_FORTRAN = bytes.maketrans(b"dD", b"ee")
_GLUED = re.compile(rb"(?<=[\d.])(?=[+-])")  # full columns may leave no blank before a sign
_NOT_A_NUMBER = re.compile(rb"[+-]?1\.#[^\s]*")  # as some C libraries print it
_WORD = re.compile(rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE)
_PADDING = 6  # zeros with which some exporters fill the last line
_ODD_SIZE = (1e-25, 1e25)
"""No measured value is smaller or larger; one whose bytes are in the wrong order nearly always is."""
_MANY, _FEW = 0.2, 0.02
"""Of values in the wrong byte order at least this share, and in the right one at most that, have an odd size: of single
precision a third do, whatever the mantissa was."""


def refuse_impossible_length(source: UffSource, data_set: DataSet, head: Head, start: int) -> None:
    """Refuse a data set whose values cannot stand in its bytes, before anything is allocated for them.

    Args:
        source: the file.
        data_set: with text or binary values.
        head: its header.
        start: offset of its values.

    Raises:
        DataFileError: there are too few bytes, or of a binary data set any other number of them.
    """
    there = data_set.stop - start
    rows = f"for {head.length} lines of {', '.join(head.columns)}"
    if data_set.binary is not None:
        _layout(source, data_set, head, start)
    elif there + 1 < 2 * head.length * len(head.columns):  # a digit and a blank each
        found, expected = f"{there} characters", f"{head.length * len(head.columns)} numbers, {rows}"
        raise DataFileError(source.place(start), found=found, expected=expected, hint=TRUNCATED)


def rows(source: UffSource, data_set: DataSet, head: Head, start: int) -> Iterator[Array]:
    """The values of a data set 58, (rows, columns) at a time, one after the other.

    Text may hold NaN and infinity, and exponents written with D.

    Args:
        source: the file.
        data_set: where they stand.
        head: its header, which says how many there are and of which columns.
        start: offset of the first.

    Raises:
        DataFileError: a word is no number, there are too few or too many, or their byte order is not the one stated.
    """
    if data_set.binary is not None:
        yield from _binary_rows(source, data_set, head, start)
        return
    width, needed = len(head.columns), head.length * len(head.columns)
    expected = f"{needed}, for {head.length} lines of {', '.join(head.columns)}"
    taken = extra = 0
    rest = np.empty(0)
    for numbers in _numbers(source, start, data_set.stop):
        surplus = numbers[needed - taken :]
        extra += surplus.size
        if extra >= _PADDING or surplus.any():
            raise DataFileError(source.place(start), found=f"more than {needed} numbers", expected=expected)
        block = np.concatenate([rest, numbers[: needed - taken]])
        taken += numbers.size - surplus.size
        full = block.size // width * width
        yield block[:full].reshape(-1, width)
        rest = block[full:]
    if taken < needed:
        found = f"{taken} numbers"
        raise DataFileError(source.place(start), found=found, expected=expected, hint=TRUNCATED)


def _numbers(source: UffSource, start: int, stop: int) -> Iterator[Array]:
    """All numbers of a text, those of so many lines at a time."""
    while start < stop:
        data = source.read(start, min(stop, start + CHUNK))
        if not data:
            return
        if start + len(data) < stop:
            data = data[: data.rfind(b"\n") + 1 or data.rfind(b" ") + 1 or len(data)]
        yield _parsed(source, start, data)
        start += len(data)
        source.done(SCANNED + (1 - SCANNED) * start / source.size)


def _parsed(source: UffSource, start: int, data: bytes) -> Array:
    text = data.translate(_FORTRAN)
    if not text.translate(None, _OF_NUMBERS):
        # The parser of NumPy is strict on what is made of these characters alone, but wants blanks between numbers.
        if not text.strip():
            return np.empty(0)
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # older versions of NumPy only warn
            try:
                return np.fromstring(text, sep=" ")
            except (ValueError, DeprecationWarning):
                pass
    words = _NOT_A_NUMBER.sub(b" nan ", _GLUED.sub(b" ", text)).split()
    for word in words:
        if not _WORD.fullmatch(word):
            at = start + max(text.find(word), 0)
            raise DataFileError(source.place(at), found=shown(word.decode("latin-1")), expected="a number")
    return np.array([float(word) for word in words])


def _layout(source: UffSource, data_set: DataSet, head: Head, start: int) -> np.dtype[np.void]:
    """How the rows of a binary data set are stored."""
    rest = data_set.binary or ""
    order, floats, lines = (
        int(word) if (word := rest[a:b].strip()).isdecimal() else -1 for a, b in ((0, 6), (6, 12), (12, 24))
    )
    if order not in (1, 2) or floats != 2 or lines != HEADER_LINES:
        raise DataFileError(
            source.place(data_set.at),
            found=f"58b with byte order {order}, float format {floats}, {lines} header lines",
            expected=f"byte order 1 or 2, float format 2 (IEEE 754), {HEADER_LINES} header lines",
        )
    number = f"{'<' if order == 1 else '>'}f{8 if head.double else 4}"
    layouts = [np.dtype([(column, number) for column in head.columns])]
    if head.double and not head.even:  # by the format abscissas stay single, but most programs write them double
        layouts.append(np.dtype([("x", number[:2] + "4"), *((column, number) for column in head.columns[1:])]))
    there = data_set.stop - start
    for layout in layouts:
        if 0 <= there - head.length * layout.itemsize <= 2:  # a line end, which some exporters write
            return layout
    raise DataFileError(
        source.place(start),
        found=f"{there} bytes of values",
        expected=f"{head.length * layouts[0].itemsize}, for {head.length} lines of {', '.join(head.columns)}",
        hint=TRUNCATED,
    )


def _binary_rows(source: UffSource, data_set: DataSet, head: Head, start: int) -> Iterator[Array]:
    layout = _layout(source, data_set, head, start)
    at_once = max(1, CHUNK // layout.itemsize)
    for first in range(0, head.length, at_once):
        count = min(at_once, head.length - first)
        at = start + first * layout.itemsize
        data = source.read(at, at + count * layout.itemsize)
        if len(data) < count * layout.itemsize:
            raise DataFileError(source.name, found="a file that shrinks while it is read", expected="a whole file")
        stored = np.frombuffer(data, dtype=layout, count=count)
        if first == 0:
            _refuse_other_order(source, data_set, stored)
        with np.errstate(all="ignore"):  # signalling NaN among the values
            yield np.column_stack([stored[column].astype(np.float64) for column in head.columns])
        source.done(SCANNED + (1 - SCANNED) * (at + len(data)) / source.size)


def _refuse_other_order(source: UffSource, data_set: DataSet, stored: NDArray[np.void]) -> None:
    """Refuse values that make sense only in the other byte order."""
    names = stored.dtype.names or ()
    if _odd_share([stored[n] for n in names]) > _MANY:
        other = _odd_share([stored[n].view(stored[n].dtype.newbyteorder()) for n in names])
        if other < _FEW:
            little = stored.dtype[0].str[0] == "<"
            raise DataFileError(
                source.place(data_set.at),
                found=f"numbers that make sense only with the {'most' if little else 'least'} significant byte first",
                expected=f"byte order {1 if little else 2}, as the data set states",
            )


def _odd_share(columns: list[NDArray[np.floating]]) -> float:
    """Share of the values other than zero that are not finite, or of a size that nothing measured has."""
    odd = there = 0
    for column in columns:
        with np.errstate(all="ignore"):
            size = np.abs(column[column != 0].astype(np.float64))
        there += size.size
        odd += int(np.count_nonzero(~((size > _ODD_SIZE[0]) & (size < _ODD_SIZE[1]))))
    return odd / there if there else 0.0
