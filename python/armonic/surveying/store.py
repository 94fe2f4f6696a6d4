"""A survey on disk: a Zarr group that fills block by block, and that another run goes on with where one was ended."""

from __future__ import annotations

import json
import math
import secrets
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import zarr

from armonic.errors import SurveyError
from armonic.surveying import chunks

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from armonic.surveying.dataset import Layout

    Values: TypeAlias = NDArray[Any]

DONE = "surveyed"
"""Scalar variable: how many postures of the walk are in the store. It is written after the data it counts."""


class Store:
    """The Zarr group of one survey, new or begun by an earlier run.

    Args:
        path: the folder.
        layout: what the survey will hold.
        block: extent of the blocks that are written one by one, which are Zarr's chunks too.

    Raises:
        SurveyError: something else is there, a store of another robot or survey, or there is no room.
    """

    def __init__(self, path: str | Path, layout: Layout, block: tuple[int, ...]) -> None:
        self.path, self._layout, self._block = Path(path), layout, block
        try:
            if self.path.exists():
                self._group = self._opened()
            else:
                self._refuse_without_room()
                self._group = self._created()
        except (OSError, ValueError) as error:
            if isinstance(error, SurveyError):
                raise
            found = f"a place that cannot be used ({getattr(error, 'strerror', None) or error})"
            raise SurveyError(str(path), found=found, expected="a new folder, or the store of this survey") from error
        names = [*(variable.name for variable, _, _ in layout.variables()), DONE]
        self._arrays = {name: _array(self._group, name) for name in names}

    @property
    def done(self) -> int:
        """Postures of the walk that are in the store."""
        return int(np.asarray(self._arrays[DONE][...]))

    def write(self, box: tuple[slice, ...], places: NDArray[np.intp], values: dict[str, Values]) -> None:
        """Add a block; several threads may do so at the same time.

        Args:
            box: the part of the survey's axes that it fills.
            places: where each of its postures stands (row-major in the whole survey), (P,).
            values: its variables, (P, ...).

        Raises:
            SurveyError: the disk is full, or the folder has gone.
        """
        shape = tuple(part.stop - part.start for part in box)
        there = np.unravel_index(places, self._layout.field.walk.shape)
        flat = np.ravel_multi_index(tuple(i - part.start for i, part in zip(there, box, strict=True)), shape)
        index = tuple(part.start // size for part, size in zip(box, self._block, strict=True))
        for name, rows in values.items():
            tail = rows.shape[1:]
            chunk = np.empty_like(rows)
            chunk[flat] = rows
            chunk = chunk.reshape(shape + tail)
            if shape != self._block:
                # Chunks are whole on disk, also where they stick out of the array.
                inside, chunk = chunk, np.full(self._block + tail, self._arrays[name].fill_value, rows.dtype)
                chunk[tuple(slice(size) for size in shape)] = inside
            self._put(name, index + (0,) * len(tail), chunk)

    def count(self, done: int) -> None:
        """Say how many postures of the walk are there."""
        self._put(DONE, (), np.array(done))

    def _put(self, name: str, index: tuple[int, ...], chunk: Values) -> None:
        key = self._arrays[name].metadata.encode_chunk_key(index)
        try:
            chunks.write(self.path / name / key, chunk)
        except OSError as error:
            raise SurveyError(
                str(self.path),
                found=f"a place that cannot be written ({error.strerror or error})",
                expected="room for the map",
                hint="Mend that and make the survey again: it goes on where it stopped.",
            ) from error

    def poles(self, place: int) -> NDArray[np.complex128]:
        """Poles (m, 2) at a posture that is in the store."""
        index = tuple(int(i) for i in np.unravel_index(place, self._layout.field.walk.shape))
        pairs = [np.asarray(self._arrays[name][index]) for name in ("pole", "partner")]
        return np.stack(pairs, axis=-1)

    def dataset(self) -> xr.Dataset:
        """The stored survey, read as it is used."""
        import xarray as xr

        stored: xr.Dataset = xr.open_zarr(self.path, consolidated=False, chunks=None)
        return stored[list(self._arrays)]

    def _created(self) -> zarr.Group:
        """A new group, made beside its place and moved there whole."""
        draft = self.path.with_name(f".{self.path.name[:80]}.{secrets.token_hex(4)}.tmp")
        try:
            group = zarr.open_group(draft, mode="w-", zarr_format=3)
            group.attrs.update(self._layout.attributes() | {"coordinates": " ".join(self._layout.coords())})
            for variable, dims, shape in self._layout.variables():
                tail = shape[len(self._block) :]
                group.create_array(
                    variable.name,
                    shape=shape,
                    chunks=(*self._block, *tail),
                    dtype=variable.dtype,
                    compressors=chunks.compressor(variable.dtype),
                    chunk_key_encoding=chunks.KEYS,
                    dimension_names=dims,
                    attributes={"units": variable.units, "long_name": variable.long_name},
                    fill_value=_nothing(variable.dtype),
                )
            for name, (dims, values, attributes) in self._layout.coords().items():
                if values.dtype.kind == "U":
                    values = values.astype(np.dtypes.StringDType())  # the one text that Zarr specifies
                group.create_array(name, data=values, chunks=values.shape, dimension_names=dims, attributes=attributes)
            count = group.create_array(
                DONE,
                shape=(),
                dtype="i8",
                compressors=chunks.compressor("i8"),
                dimension_names=(),
                attributes={"long_name": "postures that are in this map"},
            )
            count[...] = 0
            draft.rename(self.path)
        finally:
            with suppress(OSError):
                shutil.rmtree(draft)  # left over only if something failed
        return zarr.open_group(self.path, mode="r+")

    def _opened(self) -> zarr.Group:
        try:
            group = zarr.open_group(self.path, mode="r+")
            there = {key: group.attrs.get(key) for key in ("robot", "robot_file", "spec")}
        except (OSError, ValueError, KeyError) as error:
            raise SurveyError(
                str(self.path), found="something that is no map", expected="a new folder, or the store of this survey"
            ) from error
        wanted = self._layout.attributes()
        if there["spec"] is None:
            raise SurveyError(str(self.path), found="a store that is no map", expected="the store of this survey")
        hint = "Choose another name, or remove that store."
        if there["robot_file"] != wanted["robot_file"]:
            found = f"the map of another robot or version of its file ({there['robot']!s:.60})"
            raise SurveyError(str(self.path), found=found, expected=f"the map of {wanted['robot']}", hint=hint)
        if there["spec"] != wanted["spec"]:
            found = f"another survey of this robot ({_differs(str(there['spec']), str(wanted['spec']))})"
            raise SurveyError(str(self.path), found=found, expected="the survey that is asked for", hint=hint)
        block = _array(group, "pole").chunks[: len(self._block)]
        if block != self._block:
            found = f"a map in parts of {' x '.join(map(str, block))} postures, as another version makes them"
            raise SurveyError(str(self.path), found=found, expected=f"parts of {self._block}", hint=hint)
        for leftover in self.path.rglob("*.partial"):
            leftover.unlink(missing_ok=True)
        return group

    def _refuse_without_room(self) -> None:
        """Before anything is computed: compression saves little, for the last digits of poles are noise."""
        needed = sum(math.prod(shape) * np.dtype(v.dtype).itemsize for v, _, shape in self._layout.variables())
        folder = self.path.resolve().parent
        if not folder.is_dir():
            raise SurveyError(str(self.path), found=f"no folder {folder}", expected="a folder that exists")
        free = shutil.disk_usage(folder).free
        if needed > free:
            count = self._layout.field.walk.count
            raise SurveyError(
                str(self.path),
                found=f"a map of {count} postures that needs {needed / 1e9:.3g} GB",
                expected=f"at most the {free / 1e9:.3g} GB that are free there",
                hint="Take a coarser grid, or leave out shapes and participation.",
            )


def _array(group: zarr.Group, name: str) -> zarr.Array[Any]:
    array = group[name]
    assert isinstance(array, zarr.Array)
    return array


def _nothing(dtype: str) -> Any:
    return np.array(np.nan if dtype[0] in "fc" else 0).astype(dtype)[()]


def _differs(there: str, wanted: str) -> str:
    try:
        a, b = json.loads(there), json.loads(wanted)
    except ValueError:
        return "unreadable"
    keys = [key for key in b if a.get(key) != b[key]]
    return f"other {', '.join(keys)}" if keys else "of another version"
