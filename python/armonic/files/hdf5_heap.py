"""The heaps in which HDF5 keeps texts of any length, checked before the library, which may never return from them."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

_HEAD = struct.Struct("<4sB3xQ")
_OBJECT = struct.Struct("<HH4xQ")


def sound_heaps(path: str | Path) -> bool:
    """Whether every heap in a file is a row of objects that ends where the heap does.

    HDF5 File Format Specification 3.0, section III.E: after signature, version and size come objects, each with its
    number, count and size; number 0 is free space, whose size counts its own head.

    Args:
        path: an HDF5 file with sizes of eight bytes, as good as all of them.
    """
    with Path(path).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at = data.find(b"GCOL")
        while at >= 0:
            if data[at + 4 : at + 8] == b"\x01\0\0\0" and not _is_sound(data, at):
                return False
            at = data.find(b"GCOL", at + 4)
    return True


def _is_sound(data: mmap.mmap, at: int) -> bool:
    if at + _HEAD.size > len(data):
        return False
    size = _HEAD.unpack_from(data, at)[2]
    end, at = at + size, at + _HEAD.size
    if end > len(data):
        return False
    while at + _OBJECT.size <= end:  # what is left may be too little for another
        number, _, length = _OBJECT.unpack_from(data, at)
        step = length if number == 0 else _OBJECT.size + length + -length % 8
        if step < _OBJECT.size or at + step > end:
            return False
        at += step
    return True
