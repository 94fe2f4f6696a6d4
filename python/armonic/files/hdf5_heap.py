"""The heaps in which HDF5 keeps texts of any length, checked before the library, which trusts their sizes."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

_HEAD = struct.Struct("<4sB3xQ")
_OBJECT = struct.Struct("<HH4xQ")
_POINTER = struct.Struct("<IQI")
_MOST = 64


def sound_heaps(path: str | Path) -> bool:
    """Whether every heap of a file is a row of objects, and nothing that points at one says it is longer than it is.

    HDF5 File Format Specification 3.0, sections III.E and IV.B: after signature, version and size come objects, each
    with its number, count and size; number 0 is free space, whose size counts its own head. A pointer is a length,
    the address of the heap and the number of the object.

    Args:
        path: an HDF5 file with addresses and sizes of eight bytes, as good as all of them.
    """
    with Path(path).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        found = 0
        at = data.find(b"GCOL")
        while at >= 0:
            if data[at + 4 : at + 8] == b"\x01\0\0\0":
                found += 1
                sizes = _sizes(data, at)
                if sizes is None or found > _MOST or not _fits(data, at, sizes):
                    return False
            at = data.find(b"GCOL", at + 4)
    return True


def _sizes(data: mmap.mmap, at: int) -> dict[int, int] | None:
    """The size of each object of a heap by its number; None if they do not fill it."""
    if at + _HEAD.size > len(data):
        return None
    end = at + _HEAD.unpack_from(data, at)[2]
    at += _HEAD.size
    if end > len(data):
        return None
    sizes: dict[int, int] = {}
    while at + _OBJECT.size <= end:  # what is left may be too little for another
        number, _, length = _OBJECT.unpack_from(data, at)
        step = length if number == 0 else _OBJECT.size + length + -length % 8
        if step < _OBJECT.size or at + step > end:
            return None
        sizes[number] = length
        at += step
    return sizes


def _fits(data: mmap.mmap, heap: int, sizes: dict[int, int]) -> bool:
    """Whether no pointer at a heap asks for more of an object than there is."""
    address = struct.pack("<Q", heap)
    at = data.find(address, 4)
    while at >= 0 and at + 12 <= len(data):
        length, _, number = _POINTER.unpack_from(data, at - 4)
        if number in sizes and length > sizes[number]:
            return False
        at = data.find(address, at + 1)
    return True
