"""MATLAB files of version 5 to 7 in: numbers, text and cells, every tag checked.

The format is that of MathWorks, "MAT-File Format", chapter 1 (Level 5). The reader is our own because SciPy's trusts
the tags of a file: a damaged one takes the process down with it. Structures, objects, functions and sparse matrices
are passed over, so that nothing in a file is ever run.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Value: TypeAlias = "NDArray[np.generic] | Text | Cells | None"

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _CHAR = 1, 4
_COMPLEX = 0x0800
_DEEPEST = 8


class DamageError(ValueError):
    """What is wrong with the bytes of a file, in words."""


class Text(NamedTuple):
    """A char array: its rows."""

    rows: tuple[str, ...]


class Cells(NamedTuple):
    """A cell array, by columns."""

    items: tuple[Value, ...]


class _Element(NamedTuple):
    kind: int
    data: bytes


def parse(data: bytes) -> dict[str, Value]:
    """The variables of a MATLAB file by name; None for what is neither numbers nor text nor cells.

    Numbers have the shape and the class they have in MATLAB.

    Raises:
        DamageError: the bytes are no such file, or not all of one.
    """
    if len(data) < _HEADER:
        raise DamageError(f"{len(data)} bytes, too few for a header")
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None or data[125 if order == "<" else 124] != 1:
        raise DamageError("no header of version 5")
    variables: dict[str, Value] = {}
    for element in _elements(data[_HEADER:], order, padded=False):
        kind, body = element
        if kind == _COMPRESSED:
            kind, body = _inflated(body, order)
        if kind != _MATRIX:
            raise DamageError(f"data of type {kind} where a variable should start")
        name, value = _variable(body, order, 0)
        if name in variables:
            raise DamageError(f"variable {name!r:.40} twice")
        if name:  # what MATLAB keeps for its objects has none
            variables[name] = value
    return variables


def _inflated(body: bytes, order: str) -> _Element:
    machine = zlib.decompressobj()
    try:
        plain = machine.decompress(body)
    except zlib.error as error:
        raise DamageError(f"a compressed variable that does not unpack ({error})") from error
    if not machine.eof:
        raise DamageError("a compressed variable that is cut off")
    inner = list(_elements(plain, order, padded=True))
    if len(inner) != 1:
        raise DamageError(f"{len(inner)} variables in one that is compressed")
    return inner[0]


def _elements(data: bytes, order: str, *, padded: bool) -> Iterator[_Element]:
    """Every data element; those of a variable start at multiples of eight bytes, compressed ones follow at once."""
    at = 0
    while at < len(data):
        if at + 8 > len(data):
            raise DamageError("an end within a tag")
        (word,) = struct.unpack_from(f"{order}I", data, at)
        if word >> 16:  # a small element: type, size and up to four bytes in the place of a tag
            size, kind, start, after = word >> 16, word & 0xFFFF, at + 4, at + 8
            if size > 4:
                raise DamageError(f"a small element of {size} bytes")
        else:
            (size,) = struct.unpack_from(f"{order}I", data, at + 4)
            kind, start = word, at + 8
            after = start + size + (-size % 8 if padded or kind != _COMPRESSED else 0)
        if start + size > len(data):
            raise DamageError(f"{len(data) - start} bytes of a variable's {size}")
        yield _Element(kind, data[start : start + size])
        at = after


def _variable(body: bytes, order: str, depth: int) -> tuple[str, Value]:
    """Name and value of a matrix element."""
    if depth > _DEEPEST:
        raise DamageError(f"cells within cells, more than {_DEEPEST} deep")
    if not body:  # so an empty cell may be written
        return "", np.empty((0, 0))
    parts = _elements(body, order, padded=True)
    flags = _numbers(next(parts, None), order, "flags")
    if flags.size != 2:
        raise DamageError(f"{flags.size} words of flags")
    kind = int(flags[0]) & 0xFF
    if kind not in (_CELL, _CHAR, *_CLASSES):
        return (_name(body, order) if 2 <= kind <= 5 else ""), None
    shape = tuple(int(n) for n in _numbers(next(parts, None), order, "dimensions"))
    if len(shape) < 2 or min(shape) < 0:
        raise DamageError(f"dimensions {shape}")
    count = math.prod(shape)
    name = _decoded(next(parts, None), order)
    if kind == _CELL:
        items = list(parts)
        if len(items) != count or any(item.kind != _MATRIX for item in items):
            raise DamageError(f"{len(items)} cells of {count}")
        return name, Cells(tuple(_variable(item.data, order, depth + 1)[1] for item in items))
    if kind == _CHAR:
        letters = _decoded(next(parts, None), order) if count else ""
        if len(letters) != count:
            raise DamageError(f"{len(letters)} letters of {count}")
        height = shape[0]
        return name, Text(tuple(letters[row::height] for row in range(height)) if count else ("",))
    columns = [_numbers(next(parts, None), order, name) for _ in range(2 if flags[0] & _COMPLEX else 1)]
    if any(column.size != count for column in columns):
        raise DamageError(f"{columns[0].size} numbers of {count} in {name!r:.40}")
    with np.errstate(all="ignore"):
        values = [column.astype(_CLASSES[kind]) for column in columns]
    whole = values[0] if len(values) == 1 else values[0] + 1j * values[1]
    return name, whole.reshape(shape, order="F")


def _name(body: bytes, order: str) -> str:
    """The name of a variable that is passed over."""
    parts = list(_elements(body, order, padded=True))
    return _decoded(parts[2], order) if len(parts) > 2 else ""


def _numbers(element: _Element | None, order: str, what: str) -> NDArray[np.generic]:
    if element is None or element.kind not in _NUMBERS:
        found = "nothing" if element is None else f"data of type {element.kind}"
        raise DamageError(f"{found} for the numbers of {what!r:.40}")
    number = np.dtype(f"{order}{_NUMBERS[element.kind]}")
    if len(element.data) % number.itemsize:
        raise DamageError(f"{len(element.data)} bytes of numbers of {number.itemsize} each in {what!r:.40}")
    return np.frombuffer(element.data, number)


def _decoded(element: _Element | None, order: str) -> str:
    if element is None or element.kind not in _TEXTS:
        raise DamageError("no text" if element is None else f"data of type {element.kind} for text")
    coding = _TEXTS[element.kind]
    if coding in ("utf-16", "utf-32"):
        coding += "-le" if order == "<" else "-be"
    try:
        return element.data.decode(coding)
    except UnicodeDecodeError as error:
        raise DamageError(f"bytes that are no text in {coding}") from error
