"""Files of measured data read and written, by the ending of the name: one or several as one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armonic.description.names import did_you_mean
from armonic.errors import DataFileError
from armonic.files.channel_map import ChannelMap, read_channel_map
from armonic.files.joined import joined
from armonic.files.measured_file import Geometry, MeasuredFile

if TYPE_CHECKING:
    from armonic.comparison import ModeTable
    from armonic.frf_set import FrfSet
    from armonic.series import TimeSeries

FORMATS = {
    ".uff": "uff", ".unv": "uff", ".uf58": "uff", ".h5": "hdf5", ".hdf5": "hdf5", ".mat": "mat", ".csv": "csv",
    ".txt": "csv", ".zarr": "zarr",
}  # fmt: skip
"""What endings of names stand for."""
_GENERAL = ("path", "channels", "progress")


def read_measured(
    path: str | Path | Sequence[str | Path],
    *,
    channels: ChannelMap | str | Path | None = None,
    sample_rate_hz: float | None = None,
    progress: Callable[[float], object] | None = None,
    **options: Any,
) -> MeasuredFile:
    """Read measured data: time records, frequency responses with coherence, modes and geometry.

    Universal files (.uff, .unv, .uf58), HDF5 (.h5, .hdf5), MATLAB (.mat), comma-separated text (.csv, .txt) and Zarr
    folders of one record (.zarr). Of several files records follow each other, and frequency responses become one set.

    Args:
        path: the file, or several.
        channels: from channels and nodes to places and axes of the robot, or the file of a map (see
            `read_channel_map`); None takes the names that the files have.
        sample_rate_hz: the rate of records, where a file tells none; where it does, the two must agree.
        progress: called with the share that is read.
        options: of CSV: `kind`, `frame`, `coherence` (a file); of MATLAB and foreign HDF5: `variable`,
            `time_variable`, `freq_variable`, `kind`, `outputs`, `inputs`.

    Returns:
        What was read, what was left and why, and what a user should know.

    Raises:
        DataFileError: an ending or option is unknown, a file or the map is damaged, they do not go together, or the
            frequency responses of two files have different lines.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    paths = [path] if isinstance(path, str | Path) else list(path)
    if not paths:
        raise DataFileError("path", found="no file", expected="at least one")
    readers = [_function("read", one) for one in paths]
    _refuse_unknown(paths, readers, options)
    chosen = channels if isinstance(channels, ChannelMap) or channels is None else read_channel_map(channels)
    chosen = chosen and chosen.fresh()
    sizes = [_size(one) for one in paths]
    files, before = [], 0
    for one, read, size in zip(paths, readers, sizes, strict=True):
        known = inspect.signature(read).parameters
        given = {name: value for name, value in options.items() if name in known}
        if "sample_rate_hz" in known:
            given["sample_rate_hz"] = sample_rate_hz
        shown = progress and _part(progress, before / sum(sizes), size / sum(sizes))
        file: MeasuredFile = read(one, channels=chosen, progress=shown, **given)
        if "sample_rate_hz" not in known:
            _refuse_other_rate(file, sample_rate_hz)
        files.append(file)
        before += size
    whole = joined(files)
    unmet = chosen.unmet() if chosen is not None else ()
    if progress is not None:
        progress(1.0)
    remarks = dict.fromkeys((*whole.remarks, *_on_forces(whole), *unmet))
    return replace(whole, remarks=tuple(remarks))


def write_measured(
    path: str | Path,
    *,
    records: Iterable[TimeSeries] = (),
    frfs: FrfSet | None = None,
    modes: ModeTable | None = None,
    geometry: Geometry | None = None,
    **options: Any,
) -> None:
    """Write measured data, by the ending of the name.

    HDF5 (.h5, .hdf5) keeps all of it bit for bit, universal files (.uff, .unv, .uf58) as far as the format goes. The
    other formats have room for one thing: .csv for the frequency responses or one record, .mat and .zarr for one
    record.

    Args:
        path: the file; an existing one is replaced, once all is written.
        records: time records.
        frfs: frequency responses.
        modes: modes.
        geometry: points and lines.
        options: those of the format's own function: `write_measured_uff`, `write_measured_hdf5`, `write_series`.

    Raises:
        DataFileError: the ending or an option is unknown, there is nothing to write, the format has no place for
            something, or the file cannot be written.
    """
    format_ = _format(path)
    listed = tuple(records)
    parts = {"records": listed, "frfs": frfs, "modes": modes, "geometry": geometry}
    there = [name for name, part in parts.items() if part is not None and part != ()]
    if not there:
        raise DataFileError(str(path), found="nothing to write", expected="records, FRFs, modes or geometry")
    if format_ in ("uff", "hdf5"):
        write = _function("write", path)
        _refuse_unknown([path], [write], options, tuple(parts))
        write(path, **{name: parts[name] for name in there}, **options)
        return
    if there == ["frfs"] and format_ == "csv" and frfs is not None:
        from armonic.files.measured_csv import write_measured_csv

        _refuse_unknown([path], [write_measured_csv], options, ("frfs",))
        write_measured_csv(path, frfs)
        return
    if there != ["records"] or len(listed) != 1:
        found = f"{len(listed)} records" if there == ["records"] else " and ".join(there)
        expected = "one record" + (", or FRFs alone" if format_ == "csv" else "")
        hint = "Write .h5 or .uff, which hold everything."
        raise DataFileError(str(path), found=found, expected=f"{expected}, for {Path(path).suffix}", hint=hint)
    from armonic.files.series_files import write_series

    write_series(path, listed[0], **options)


def _format(path: str | Path) -> str:
    suffix = Path(path).suffix
    if suffix.lower() not in FORMATS:
        found = f"the ending {suffix!r}" if suffix else "no ending"
        raise DataFileError(str(path), found=found, expected=f"one of {', '.join(FORMATS)}")
    return FORMATS[suffix.lower()]


def _function(verb: str, path: str | Path) -> Callable[..., Any]:
    name = _format(path)
    if name == "zarr":
        return _read_zarr
    # Each format is imported when it is used; that of UFF has its writer apart.
    module = f"armonic.files.measured_{name}" + ("_writer" if (verb, name) == ("write", "uff") else "")
    function: Callable[..., Any] = getattr(import_module(module), f"{verb}_measured_{name}")
    return function


def _read_zarr(
    path: str | Path,
    *,
    channels: ChannelMap | None = None,
    sample_rate_hz: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> MeasuredFile:
    from armonic.files.mapped import measured
    from armonic.files.series_zarr import read_series_zarr

    series = read_series_zarr(path, sample_rate_hz=sample_rate_hz)
    if progress is not None:
        progress(1.0)
    return measured(path, channels=channels, records=(series,))


def _refuse_unknown(
    paths: Sequence[str | Path],
    functions: Sequence[Callable[..., Any]],
    options: dict[str, Any],
    general: tuple[str, ...] = _GENERAL,
) -> None:
    known = {n: None for f in functions for n in inspect.signature(f).parameters if n not in (*general, "path")}
    if unknown := [name for name in options if name not in known]:
        kinds = ", ".join(dict.fromkeys(Path(path).suffix for path in paths))
        expected = f"one of {', '.join(known)} for {kinds}" if known else f"none for {kinds}"
        hint = did_you_mean(unknown[0], known)
        raise DataFileError("options", found=f"{unknown[0]}=", expected=expected, hint=hint)


def _refuse_other_rate(file: MeasuredFile, asked_hz: float | None) -> None:
    """Refuse records of another rate than is asked for."""
    from armonic.files.sampling import settle

    for record in file.records if asked_hz is not None else ():
        settle(file.path, None, stated_hz=record.sample_rate_hz, asked_hz=asked_hz)


def _size(path: str | Path) -> int:
    try:
        return max(1, Path(path).stat().st_size)
    except (OSError, ValueError):
        return 1


def _part(progress: Callable[[float], object], start: float, share: float) -> Callable[[float], object]:
    return lambda done: progress(start + share * done)


def _on_forces(file: MeasuredFile) -> tuple[str, ...]:
    """What a user should know of records that hold responses alone."""
    without = [k for k, r in enumerate(file.records, 1) if all(c.quantity != "force" for c in r.channels)]
    if not without:
        return ()
    if len(without) == len(file.records):
        return ("No record has a channel of force: frequency responses need one.",)
    shown = ", ".join(map(str, without[:12])) + (", ..." if len(without) > 12 else "")
    return (
        f"{len(without)} of {len(file.records)} records have no channel of force ({shown}): "
        "frequency responses cannot be made of them.",
    )
