"""Zarr folders, as a time series; xarray opens them too."""

from __future__ import annotations

import secrets
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec

from armonic.errors import DataFileError
from armonic.files.sampling import built, settle
from armonic.series import TimeSeries

MARK = "armonic_series"
"""Attribute of every folder that was written here: the version of its layout."""
_CHUNK = 131072
"""Samples times channels in one chunk, 1 MB."""
_OURS = "a Zarr folder of a time series, as write_series makes it"
_COMPRESSOR = BloscCodec(cname="zstd", clevel=3, shuffle="shuffle", typesize=8)


def read_series_zarr(path: str | Path, *, sample_rate_hz: float | None = None) -> TimeSeries:
    """Read a time series from a Zarr folder.

    Args:
        path: the folder.
        sample_rate_hz: the rate that is expected; None takes what is stored.

    Raises:
        DataFileError: there is no such folder, it holds something else, or a part of it is missing or damaged.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    if not Path(path).is_dir():
        found = "a file" if Path(path).exists() else "no such folder"
        raise DataFileError(str(path), found=found, expected=_OURS)
    try:
        group = zarr.open_group(Path(path), mode="r")
        attributes = dict(group.attrs)
    except Exception as error:  # a damaged store shows in whatever its bytes lead the reader to
        raise DataFileError(str(path), found="a folder that is no Zarr group", expected=_OURS) from error
    if MARK not in attributes:
        raise DataFileError(str(path), found="a Zarr group of something else", expected=_OURS)
    if attributes[MARK] != 1:
        found = f"version {attributes[MARK]!r:.20} of the layout"
        raise DataFileError(str(path), found=found, expected="version 1", hint="Update Armonic.")
    try:
        array: Any = group["values"]
        missing = array.nchunks - array.nchunks_initialized
        values = np.array(array[...], dtype=np.float64)
        stated: Any = attributes["sample_rate_hz"]
        start: Any = attributes["start_s"]
        listed: Any = attributes["channels"]
        noted: Any = attributes["notes"]
        channels = [(str(name), str(quantity), str(unit)) for name, quantity, unit in listed]
        notes = {str(name): str(text) for name, text in noted.items()}
        rate, start_s = float(stated), float(start)
    except Exception as error:
        raise DataFileError(str(path), found=f"a damaged folder ({error!r:.80})", expected=_OURS) from error
    if missing:  # Zarr would read them as NaN
        found = f"{missing} of {array.nchunks} chunks missing"
        raise DataFileError(str(path), found=found, expected="all of them", hint="Copy the folder again.")
    _, rate = settle(path, None, stated_hz=rate, asked_hz=sample_rate_hz)
    return built(path, values, (start_s, rate), channels, notes)


def write_series_zarr(path: str | Path, series: TimeSeries) -> None:
    """Write a Zarr folder; every number comes back bit for bit.

    The array values has the dimensions time and channel; time (s), channel (labels), quantity and unit go along, and
    the attributes hold the rest.

    Args:
        path: the folder; one of a time series is replaced, once all is written, and anything else left alone.
        series: what to write.

    Raises:
        DataFileError: something else stands there, or it cannot be written.
    """
    target = Path(path)
    draft = target.with_name(f".{target.name[:80]}.{secrets.token_hex(4)}.tmp")
    old = draft.with_suffix(".old")
    try:
        refuse_other_zarr(target)
        _fill(draft, series)
        if target.exists():
            target.rename(old)
        try:
            draft.rename(target)
        except OSError:
            if old.exists():
                old.rename(target)
            raise
    except DataFileError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        found = f"a place that cannot be written ({getattr(error, 'strerror', None) or error})"
        raise DataFileError(str(path), found=found, expected="a folder that exists and has room") from error
    finally:
        for leftover in (draft, old):
            with suppress(OSError):
                shutil.rmtree(leftover)


def refuse_other_zarr(target: Path) -> None:
    """Refuse a place where something else than the Zarr folder of a time series stands.

    Raises:
        DataFileError: it does, or there is no folder for it.
    """
    if not target.parent.is_dir():
        raise DataFileError(str(target), found=f"no folder {target.parent}", expected="a folder that exists")
    if not (target.exists() or target.is_symlink()):
        return
    ours = False
    if target.is_dir() and not target.is_symlink():
        with suppress(Exception):  # whatever cannot be opened is not ours
            ours = MARK in zarr.open_group(target, mode="r").attrs
    if not ours:
        expected = "a new name, or the Zarr folder of a time series"
        raise DataFileError(str(target), found="something else there", expected=expected, hint="Choose another name.")


def _fill(draft: Path, series: TimeSeries) -> None:
    group = zarr.open_group(draft, mode="w-", zarr_format=3)
    group.attrs.update(
        {
            MARK: 1,
            "sample_rate_hz": series.sample_rate_hz,
            "start_s": series.start_s,
            "channels": [[channel.name, channel.quantity, channel.unit] for channel in series.channels],
            "notes": dict(series.notes),
            "coordinates": "quantity unit",
        }
    )
    samples, width = series.values.shape
    values = group.create_array(
        "values",
        shape=(samples, width),
        dtype="f8",
        chunks=(min(samples, max(1, _CHUNK // width)), width),
        compressors=_COMPRESSOR,
        dimension_names=("time", "channel"),
        fill_value=float("nan"),
        config={"write_empty_chunks": True},  # so that one of NaN can be told from one that was lost
    )
    values[...] = series.values
    group.create_array(
        "time",
        data=series.time_s,
        chunks=(min(samples, _CHUNK),),
        compressors=_COMPRESSOR,
        dimension_names=("time",),
        attributes={"units": "s", "long_name": "time"},
    )
    for name, texts in {
        "channel": series.labels,
        "quantity": tuple(channel.quantity for channel in series.channels),
        "unit": tuple(channel.unit for channel in series.channels),
    }.items():
        column = np.array(texts).astype(np.dtypes.StringDType())  # the one text that Zarr specifies
        group.create_array(name, data=column, chunks=(width,), dimension_names=("channel",))
