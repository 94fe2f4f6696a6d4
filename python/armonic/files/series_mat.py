"""MATLAB files of version 5 to 7, as a time series."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from armonic.errors import DataFileError
from armonic.files.cells import read_bytes
from armonic.files.mat_reader import Cells, DamageError, Text, Value, parse
from armonic.files.sampling import Array, built, plain, settle
from armonic.series import TimeSeries
from armonic.writing import write_whole

_TIMES = ("t", "time", "time_s", "tid", "zeit", "tout")
_RATES = ("sample_rate_hz", "fs", "samplerate", "sample_rate", "sampling_rate", "samplingrate", "srate")
_STEPS = ("dt", "ts")
_EXPECTED = "a MATLAB file of version 5 to 7 (save with -v7)"


def read_series_mat(
    path: str | Path,
    *,
    sample_rate_hz: float | None = None,
    variable: str | None = None,
    time_variable: str | None = None,
) -> TimeSeries:
    """Read a time series from a MATLAB file, of `write_series_mat` or of another program.

    Of a file of another program the one matrix is taken, samples along its longer side, or the vectors that are as
    long as the times; the times from a vector called t or time, or else the rate from a number called fs or dt.
    Only arrays of numbers and text are looked at: nothing in the file is run.

    Args:
        path: the file.
        sample_rate_hz: the rate, where the file has neither times nor rate; where it has, they must agree.
        variable: the matrix, where there are several.
        time_variable: the times, where they are called otherwise.

    Raises:
        DataFileError: the file is none, is damaged, or does not say which of its variables hold the series.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    content = _content(path)
    arrays = {name: value for name, value in content.items() if _is_numeric(value)}
    if variable is None and time_variable is None and {"values", "names", "quantities", "units"} <= content.keys():
        return _own(path, content, sample_rate_hz)
    times = _times(path, arrays, time_variable)
    stated = _rate(arrays)
    values, names = _matrix(path, arrays, variable, times[1] if times else None, times[0] if times else None)
    sampling = settle(path, times[1] if times else None, stated_hz=stated, asked_hz=sample_rate_hz)
    return built(path, values, sampling, [(plain(name), "signal", "") for name in names])


def write_series_mat(path: str | Path, series: TimeSeries) -> None:
    """Write a MATLAB file of version 5; every number comes back bit for bit.

    It holds t (samples, 1), values (samples, channels), the cells names, quantities and units, the numbers
    sample_rate_hz and start_s, and notes as JSON text.

    Args:
        path: the file; an existing one is replaced, once all is written.
        series: what to write.

    Raises:
        DataFileError: the file cannot be written.
    """
    from scipy.io import savemat

    def cells(texts: list[str]) -> Any:
        return np.array([*texts, None], dtype=object)[:-1]  # of text, also where all have one length

    file = io.BytesIO()
    content = {
        "t": series.time_s,
        "values": series.values,
        "names": cells([channel.name for channel in series.channels]),
        "quantities": cells([channel.quantity for channel in series.channels]),
        "units": cells([channel.unit for channel in series.channels]),
        "sample_rate_hz": series.sample_rate_hz,
        "start_s": series.start_s,
        "notes": json.dumps(dict(series.notes)),
    }
    savemat(file, content, oned_as="column", do_compression=True)  # type: ignore[arg-type]  # stubs know no files
    write_whole(path, file.getvalue())


def _content(path: str | Path) -> dict[str, Value]:
    data = read_bytes(path)
    if not data:
        raise DataFileError(str(path), found="an empty file", expected=_EXPECTED)
    if data[:8] == b"\x89HDF\r\n\x1a\n" or data[:19] == b"MATLAB 7.3 MAT-file":
        hint = "In MATLAB, save it again with save(name, ..., '-v7')."
        raise DataFileError(str(path), found="a file of version 7.3 (HDF5)", expected=_EXPECTED, hint=hint)
    try:
        return parse(data)
    except DamageError as error:
        raise DataFileError(str(path), found=f"another file, or a damaged one ({error})", expected=_EXPECTED) from error


def _own(path: str | Path, content: dict[str, Value], asked: float | None) -> TimeSeries:
    try:
        names, quantities, units = (_texts(content[key]) for key in ("names", "quantities", "units"))
        channels = list(zip(names, quantities, units, strict=True))
        values, times, stated, start = (
            _checked_array(content[key]) for key in ("values", "t", "sample_rate_hz", "start_s")
        )
        times, start_s = times.ravel(), float(start.item())
        (noted,) = _texts(Cells((content["notes"],)))
        notes = {str(name): str(text) for name, text in json.loads(noted).items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        expected = "t, values, names, quantities, units, sample_rate_hz, start_s and notes, as write_series makes them"
        raise DataFileError(str(path), found=f"another layout ({error!r:.80})", expected=expected) from error
    if times.size != values.shape[0]:
        found = f"{times.size} times in t and {values.shape[0]} samples in values"
        raise DataFileError(str(path), found=found, expected="as many")
    _, rate = settle(path, times, stated_hz=float(stated.item()), asked_hz=asked, own_start_s=start_s)
    return built(path, values, (start_s, rate), channels, notes)


def _texts(value: Value) -> list[str]:
    """The text of each cell; TypeError where there is something else."""
    if not isinstance(value, Cells):
        raise TypeError("no cells")
    texts = []
    for item in value.items:
        if isinstance(item, np.ndarray) and item.size == 0:  # so MATLAB may write empty text
            texts.append("")
        elif isinstance(item, Text) and len(item.rows) == 1:
            texts.append(item.rows[0])
        else:
            raise TypeError("cells of something else than text")
    return texts


def _checked_array(value: Value) -> Array:
    if not _is_numeric(value):
        raise TypeError("no numbers")
    return np.array(value, dtype=np.float64)


def _is_numeric(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.ndim == 2 and value.size > 0


def _listing(arrays: dict[str, Any]) -> str:
    return ", ".join(f"{name} {'x'.join(map(str, a.shape))}" for name, a in arrays.items()) or "no array of numbers"


def _times(path: str | Path, arrays: dict[str, Any], wanted: str | None) -> tuple[str, Array] | None:
    """Name and values of the vector of times, if there is one."""
    if wanted is None:
        found = [name for name, a in arrays.items() if name.lower() in _TIMES and min(a.shape) == 1 and a.size > 1]
        return (found[0], arrays[found[0]].astype(np.float64).ravel()) if found else None
    if wanted not in arrays or min(arrays[wanted].shape) > 1:
        found_text = f"no vector {wanted} ({_listing(arrays)})"
        raise DataFileError(str(path), found=found_text, expected="the vector of times that time_variable= names")
    return wanted, arrays[wanted].astype(np.float64).ravel()


def _rate(arrays: dict[str, Any]) -> float | None:
    scalars = {name.lower(): float(a.item()) for name, a in arrays.items() if a.size == 1}
    for name in _RATES:
        if name in scalars:
            return scalars[name]
    steps = [scalars[name] for name in _STEPS if scalars.get(name, 0.0) > 0]
    return 1 / steps[0] if steps else None


def _matrix(
    path: str | Path, arrays: dict[str, Any], wanted: str | None, times: Array | None, times_name: str | None
) -> tuple[Array, list[str]]:
    """The samples, (samples, channels), and a name for each column."""
    if wanted is not None:
        if wanted not in arrays:
            found = f"no array {wanted} ({_listing(arrays)})"
            raise DataFileError(str(path), found=found, expected="the matrix that variable= names")
        chosen = [wanted]
    else:
        chosen = [name for name, a in arrays.items() if a.size > 1 and name != times_name]
        if times is not None:
            chosen = [name for name in chosen if times.size in arrays[name].shape]
        vectors = len(chosen) > 1 and all(min(arrays[name].shape) == 1 for name in chosen)
        if vectors and len({arrays[name].size for name in chosen}) == 1:
            return np.column_stack([arrays[name].astype(np.float64).ravel() for name in chosen]), chosen
    if len(chosen) != 1:
        hint = "Name the matrix with variable=, and the times with time_variable=."
        raise DataFileError(str(path), found=_listing(arrays), expected="one matrix of samples", hint=hint)
    array = arrays[chosen[0]].astype(np.float64)
    samples = times.size if times is not None else max(array.shape)
    if samples not in array.shape:
        found = f"{chosen[0]} {'x'.join(map(str, array.shape))} and {samples} times"
        raise DataFileError(str(path), found=found, expected="as many samples as times")
    if array.shape[0] != samples:
        array = array.T
    one = array.shape[1] == 1
    return array, [chosen[0] if one else f"{chosen[0]}_{k}" for k in range(1, array.shape[1] + 1)]
