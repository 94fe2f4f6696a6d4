"""Files of time series: Zarr, universal files, CSV and MATLAB, by the ending of the name."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from armonic.errors import DataFileError, SignalError
from armonic.series import TimeSeries

_FORMATS = {".zarr": "zarr", ".uff": "uff", ".unv": "uff", ".uf58": "uff", ".csv": "csv", ".txt": "csv", ".mat": "mat"}


def read_series(path: str | Path, *, sample_rate_hz: float | None = None, **options: Any) -> TimeSeries:
    """Read a time series, by the ending of the name: .zarr, .uff, .unv, .uf58, .csv, .txt or .mat.

    Values that are not finite are kept. What another program wrote is read as far as it says what it is: a channel
    whose quantity is not said is a "signal".

    Args:
        path: the file or folder.
        sample_rate_hz: the rate, where the file tells none; where it does, the two must agree.
        options: for .mat: `variable`, the name of the matrix, and `time_variable`, that of the times.

    Raises:
        DataFileError: the ending is unknown, the file is damaged, or it holds no evenly sampled series.
        SignalError: an option is unknown, or does not make sense.
    """
    read = _function("read", path)
    known = [name for name in inspect.signature(read).parameters if name not in ("path", "sample_rate_hz")]
    _refuse_unknown(path, known, options)
    series: TimeSeries = read(path, sample_rate_hz=sample_rate_hz, **options)
    return series


def write_series(path: str | Path, series: TimeSeries, **options: Any) -> None:
    """Write a time series, by the ending of the name: .zarr, .uff, .unv, .uf58, .csv, .txt or .mat.

    Every number comes back bit for bit, except that a universal file in text keeps 12 or 13 digits of the values and
    no notes.

    Args:
        path: the file or folder; an existing one is replaced, once all is written. A folder is replaced only if it
            holds a time series.
        series: what to write.
        options: for universal files: `binary`, true for data sets 58b.

    Raises:
        DataFileError: the ending is unknown, a label has no place in the format, or the file cannot be written.
        SignalError: an option is unknown.
    """
    write = _function("write", path)
    known = [name for name in inspect.signature(write).parameters if name not in ("path", "series")]
    _refuse_unknown(path, known, options)
    write(path, series, **options)


def _function(verb: str, path: str | Path) -> Callable[..., Any]:
    suffix = Path(path).suffix
    if suffix.lower() not in _FORMATS:
        found = f"the ending {suffix!r}" if suffix else "no ending"
        raise DataFileError(str(path), found=found, expected=f"one of {', '.join(_FORMATS)}")
    name = _FORMATS[suffix.lower()]
    # Each format is imported when it is used: Zarr alone takes as long as all the rest.
    function: Callable[..., Any] = getattr(import_module(f"armonic.files.series_{name}"), f"{verb}_series_{name}")
    return function


def _refuse_unknown(path: str | Path, known: list[str], options: dict[str, Any]) -> None:
    if unknown := [name for name in options if name not in known]:
        expected = f"one of {', '.join(known)}" if known else f"none for {Path(path).suffix}"
        raise SignalError("options", found=f"{unknown[0]}=", expected=expected)
