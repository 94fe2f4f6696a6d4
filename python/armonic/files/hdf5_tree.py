"""HDF5 files opened with care: nothing outside the file is touched, no reference is followed, sizes come first."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from h5py import h5t
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.hdf5_heap import sound_heaps
from armonic.files.measured_file import Skipped
from armonic.files.named_arrays import Stored

MOST_BYTES: Final = 1 << 32
"""A dataset may be this large, unpacked."""
INFLATION: Final = 2000
"""It may be so many times as large as what is stored of it; deflate reaches 1032."""
_MOST_CHUNK: Final = 1 << 30
_MOST_CHUNKS: Final = 1 << 20
_MOST_OBJECTS, _DEEPEST = 20000, 16
_MOST_TEXTS, _MOST_ATTRIBUTE = 20000, 1 << 20
_FILTERS = frozenset((1, 2, 3, 32000))
"""Deflate, shuffle, Fletcher32 and LZF, which HDF5 and h5py have inside; no plugin is loaded."""
_CHECKSUM, _PACKING = 3, {1, 32000}
_NUMBERS = [
    order + kind for order in "<>" for kind in ("f8", "f4", "f2", "i8", "i4", "i2", "i1", "u8", "u4", "u2", "u1")
]
_PARTS = ((b"r", b"i"), (b"real", b"imag"), (b"re", b"im"))
_EXPECTED = "an HDF5 file"
_SIGNATURE = b"\x89HDF\r\n\x1a\n"


@dataclass
class Group:
    """A group of a file with what can be read in it.

    Attributes:
        path: from the root, without a slash ahead; empty for the root.
        attributes: numbers and texts by name.
        arrays: datasets of numbers by name, not yet read.
        texts: datasets of text by name.
        groups: by name.
    """

    path: str
    attributes: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, Stored] = field(default_factory=dict)
    texts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    groups: dict[str, Group] = field(default_factory=dict)

    def all(self) -> Iterator[Group]:
        """It and all groups in it."""
        yield self
        for group in self.groups.values():
            yield from group.all()


@dataclass
class Tree:
    """All groups of an open file.

    Attributes:
        root: of the file.
        matlab: whether MATLAB wrote it, whose arrays lie transposed.
        skipped: what cannot be read in safety, and why.
    """

    root: Group
    matlab: bool
    skipped: list[Skipped]


def is_hdf5(path: str | Path) -> bool:
    """Whether a file begins as HDF5 does, or as MATLAB's version 7.3."""
    try:
        with Path(path).open("rb") as file:
            return file.read(8) == _SIGNATURE or (file.seek(512) == 512 and file.read(8) == _SIGNATURE)
    except (OSError, ValueError):
        return False


@contextmanager
def opened(path: str | Path) -> Iterator[Tree]:
    """The groups of a file, as long as it is open.

    Soft and external links, virtual datasets and those stored outside, filters of plugins, references and data of
    unknown kinds are left, with a reason; what is larger than `MOST_BYTES`, or not stored in full, too.

    Args:
        path: the file.

    Raises:
        DataFileError: it is no HDF5 file, or a damaged one.
    """
    place = Path(path)
    try:
        if not place.is_file():
            found = "a directory" if place.is_dir() else "no file there"
            raise DataFileError(str(path), found=found, expected=_EXPECTED)
        if not is_hdf5(path):
            found = "an empty file" if place.stat().st_size == 0 else "a file of another kind"
            raise DataFileError(str(path), found=found, expected=_EXPECTED)
        file = h5py.File(place, "r", locking="best-effort")
    except DataFileError:
        raise
    except Exception as error:  # a damaged file shows in whatever its bytes lead the library to
        raise _damaged(path, error) from error
    with file:
        try:
            with place.open("rb") as start:
                matlab = start.read(10) == b"MATLAB 7.3"
            tree = Tree(Group(""), matlab, [])
            _Walk(tree, place).into(file, tree.root, 0)
        except Exception as error:
            raise _damaged(path, error) from error
        yield tree


def _damaged(path: str | Path, error: Exception) -> DataFileError:
    reason = " ".join(str(error).split())[:120]
    return DataFileError(
        str(path), found=f"a damaged HDF5 file ({reason})", expected="a whole one", hint="Copy it again."
    )


class _Walk:
    """Goes through the groups of a file once each, also where they contain themselves."""

    def __init__(self, tree: Tree, path: Path) -> None:
        self.tree, self.path, self.seen, self.count = tree, path, set[Any](), 0

    @cached_property
    def heaps(self) -> bool:
        """Whether texts of any length may be read; asked for only where there are some."""
        sound = sound_heaps(self.path)
        if not sound:
            self.leave("texts", "their heap is damaged")
        return sound

    def into(self, opened: h5py.Group, group: Group, depth: int) -> None:
        self.seen.add(_address(opened))
        group.attributes = self.attributes(opened)
        for name in opened:
            path = f"{group.path}/{name}".lstrip("/")
            self.count += 1
            if self.count > _MOST_OBJECTS:
                raise ValueError(f"more than {_MOST_OBJECTS} objects")
            if self.tree.matlab and name in ("#refs#", "#subsystem#"):
                continue
            link = opened.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                kind = "an external link" if isinstance(link, h5py.ExternalLink) else "a link"
                self.leave(path, f"{kind}, which is not followed")
                continue
            try:
                found = opened[name]
            except Exception as error:
                self.leave(path, f"it cannot be opened ({' '.join(str(error).split())[:80]})")
                continue
            if isinstance(found, h5py.Dataset):
                self.dataset(found, group, name, path)
            elif isinstance(found, h5py.Group):
                if _address(found) in self.seen:
                    self.leave(path, "a group that was met before")
                elif depth >= _DEEPEST:
                    self.leave(path, f"groups in groups, more than {_DEEPEST} deep")
                elif "MATLAB_sparse" not in found.attrs:
                    group.groups[str(name)] = inner = Group(path)
                    self.into(found, inner, depth + 1)

    def leave(self, path: str, reason: str) -> None:
        self.tree.skipped.append(Skipped(0, 0, path, reason))

    def dataset(self, data: h5py.Dataset, group: Group, name: str, path: str) -> None:
        try:
            if reason := _refusal(data):
                self.leave(path, reason)
                return
            attributes = self.attributes(data)
            kind = data.dtype
            if "MATLAB_empty" in attributes:
                return
            if (
                attributes.get("MATLAB_class") == "char"
                and _kind(data.id.get_type()) == "u"
                and data.size < _MOST_ATTRIBUTE
            ):
                group.texts[name] = ("".join(map(chr, np.asarray(data[()]).ravel("F").tolist())),)
            elif text := h5py.check_string_dtype(kind):
                if data.size > _MOST_TEXTS:
                    self.leave(path, f"{data.size} texts, more than {_MOST_TEXTS}")
                elif text.length is None and data.id.get_create_plist().get_nfilters():
                    self.leave(path, "texts of any length, packed")  # where they point cannot be checked
                elif text.length is not None or self.heaps:
                    group.texts[name] = tuple(_text(item) for item in np.asarray(data[()]).ravel())
            elif letter := _kind(data.id.get_type()):
                group.arrays[name] = _stored(data, letter, self.tree.matlab)
                for key, value in attributes.items():  # such as the rate of a matrix
                    group.attributes.setdefault(key, value)
            elif kind.kind != "O" or not self.tree.matlab:  # cells of MATLAB are references: left without a word
                self.leave(path, "data that are neither numbers nor text")
        except (TypeError, ValueError, OSError, RuntimeError, KeyError, UnicodeDecodeError) as error:
            self.leave(path, f"it cannot be read ({' '.join(str(error).split())[:80]})")

    def attributes(self, holder: h5py.Group | h5py.Dataset) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name in holder.attrs:
            try:
                handle = holder.attrs.get_id(name)
                text = h5py.check_string_dtype(handle.dtype)
                fits = handle.get_storage_size() <= _MOST_ATTRIBUTE and (
                    text or _kind(handle.get_type()) in ("f", "i", "u")
                )
            except (TypeError, ValueError, OSError, RuntimeError, KeyError):
                continue  # an attribute of a strange kind says nothing that is needed
            if not fits or (text and text.length is None and not self.heaps):
                continue
            with suppress(OSError, UnicodeDecodeError):
                value: Any = holder.attrs[name]
                if text:
                    value = _text(value) if np.ndim(value) == 0 else tuple(map(_text, np.ravel(value)))
                found[str(name)] = value
        return found


def _refusal(data: h5py.Dataset) -> str | None:
    """Why a dataset is not read."""
    if data.is_virtual:
        return "a virtual dataset, whose data are in other files"
    if data.external:
        return "data stored in another file"
    plan = data.id.get_create_plist()
    codes = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
    if foreign := [code for code in codes if code not in _FILTERS]:
        return f"data packed by filter {foreign[0]}, which is not unpacked here"
    if data.shape is None:
        return "no data"
    size = math.prod(data.shape) * data.id.get_type().get_size()
    if size > MOST_BYTES:
        return f"{size / 2**30:.1f} GB, more than {MOST_BYTES >> 30}"
    stored = data.id.get_storage_size()
    if data.chunks is not None:
        if math.prod(data.chunks) * data.id.get_type().get_size() > _MOST_CHUNK:
            return "chunks larger than 1 GB"
        if (count := math.prod(-(-n // c) for n, c in zip(data.shape, data.chunks, strict=True))) > _MOST_CHUNKS:
            return f"{count} chunks, more than {_MOST_CHUNKS}"
        if fault := _chunk_fault(data, codes):
            return fault
        if size > INFLATION * max(stored, 1):
            return f"{stored} bytes that unpack to {size}"
    elif stored < size:
        return f"{stored} bytes stored of {size}"
    return None


def _chunk_fault(data: h5py.Dataset, codes: list[int]) -> str | None:
    """What is wrong with the index of the chunks, which has no checksum of its own: each is asked for as in reading."""
    places = itertools.product(*(range(0, n, c) for n, c in zip(data.shape, data.chunks, strict=True)))
    found = [data.id.get_chunk_info_by_coord(place) for place in places]
    there = [info for info in found if info.byte_offset is not None]
    if len(there) < len(found):  # HDF5 would read them as zeros
        return f"{len(found) - len(there)} of {len(found)} chunks missing"
    plain = math.prod(data.chunks) * data.id.get_type().get_size()
    for info in there:
        used = [code for k, code in enumerate(codes) if not info.filter_mask >> k & 1]
        if _CHECKSUM in codes and _CHECKSUM not in used:
            return "a chunk without its checksum"
        if not _PACKING & set(used) and info.size != plain + 4 * (_CHECKSUM in used):
            return f"a chunk of {info.size} bytes instead of {plain}"
    return None


def _kind(stored: Any) -> str | None:
    """The letter of its numbers: f i u, c of complex ones, as MATLAB too stores them; None if it is something else.

    Only the common formats count: converting what a damaged header makes of one writes beyond the library's memory.
    """
    form = stored.get_class()
    if form in (h5t.FLOAT, h5t.INTEGER):
        return next((code[1] for code in _NUMBERS if stored.equal(h5t.py_create(np.dtype(code)))), None)
    if form == h5t.ENUM:  # so h5py stores what is true or false
        return "u" if stored.dtype.kind == "b" and _kind(stored.get_super()) else None
    if form != h5t.COMPOUND or stored.get_nmembers() != 2:
        return None
    names = tuple(stored.get_member_name(k) for k in range(2))
    parts = tuple(stored.get_member_type(k) for k in range(2))
    offsets = tuple(stored.get_member_offset(k) for k in range(2))
    size = parts[0].get_size()
    tight = offsets == (0, size) and stored.get_size() == 2 * size and parts[0].equal(parts[1])
    return "c" if names in _PARTS and tight and _kind(parts[0]) == "f" else None


def _stored(data: h5py.Dataset, letter: str, matlab: bool) -> Stored:
    def read() -> NDArray[Any]:
        try:
            values: NDArray[Any] = np.asarray(data[()])
        except Exception as error:  # checksums that do not match, damaged chunks
            raise _damaged(f"{data.file.filename}: {data.name}", error) from error
        if values.dtype.fields is not None:
            first, second = (name for name in ("real", "r", "re", "imag", "i", "im") if name in values.dtype.fields)
            whole = np.empty(values.shape, np.complex128)
            whole.real, whole.imag = values[first], values[second]
            values = whole
        return values.T if matlab else values

    return Stored(tuple(data.shape[::-1] if matlab else data.shape), letter, read)


def _text(item: Any) -> str:
    return bytes(item).decode("utf-8") if isinstance(item, bytes | np.bytes_) else str(item)


def _address(opened: h5py.Group) -> Any:
    return h5py.h5o.get_info(opened.id).addr
