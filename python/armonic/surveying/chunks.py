"""Chunks of a Zarr array on disk: what Zarr itself would write, with a fraction of its Python.

A chunk is its numbers by rows, least byte first, then Blosc (Zarr specification 3, codecs "bytes" and "blosc"). Zarr's
own way leads through an event loop and three threads, which wait for those that compute; here one call writes a file.
"""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numcodecs.blosc import Blosc
from zarr.codecs import BloscCodec

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Values: TypeAlias = NDArray[Any]

LEVEL = 1
"""Fast rather than tight: the last digits of poles do not shrink."""
KEYS: Final[dict[str, Any]] = {"name": "default", "configuration": {"separator": "."}}
"""How Zarr is to name the files: all in the array's own folder, for making folders is slow."""


def compressor(dtype: str) -> BloscCodec:
    """The codec of an array of such numbers, as Zarr takes it; shuffled by parts of complex numbers."""
    return BloscCodec(cname="lz4", clevel=LEVEL, shuffle="shuffle", typesize=_size(dtype))


def write(path: Path, values: Values) -> None:
    """Put a chunk in its place; who reads sees the old one or the new one, whole.

    Args:
        path: the chunk's file.
        values: all numbers of the chunk, of the array's dtype.

    Raises:
        OSError: it cannot be written.
    """
    dtype = values.dtype.newbyteorder("<")
    numbers = np.ascontiguousarray(values, dtype).reshape(-1).view(f"u{_size(dtype)}")
    # Of its own, for a thread of a run that was interrupted may still be writing the same chunk.
    draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}.partial")
    try:
        draft.write_bytes(Blosc(cname="lz4", clevel=LEVEL, shuffle=Blosc.SHUFFLE).encode(numbers))
        draft.replace(path)
    except OSError:
        draft.unlink(missing_ok=True)
        raise


def _size(dtype: Any) -> int:
    return min(8, int(np.dtype(dtype).itemsize))
