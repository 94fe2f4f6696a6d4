"""MATLAB files of measured data: frequency responses or a time record, of every version from 5 on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic.errors import DataFileError
from armonic.files.cells import read_bytes
from armonic.files.frf_arrays import found_frfs, holds_frfs
from armonic.files.mapped import measured
from armonic.files.mat_reader import Cells, DamageError, Text, Value, parse
from armonic.files.measured_file import MeasuredFile
from armonic.files.named_arrays import Stored
from armonic.files.series_mat import read_series_mat

if TYPE_CHECKING:
    from armonic.files.channel_map import ChannelMap

_EXPECTED = "a MATLAB file"


def read_measured_mat(
    path: str | Path,
    *,
    channels: ChannelMap | None = None,
    sample_rate_hz: float | None = None,
    variable: str | None = None,
    time_variable: str | None = None,
    freq_variable: str | None = None,
    kind: str | None = None,
    outputs: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    progress: Callable[[float], object] | None = None,
) -> MeasuredFile:
    """Read frequency responses or a time record from a MATLAB file; nothing in it is run.

    A complex array (lines, outputs, inputs) or (outputs, inputs, lines) beside a vector freq_hz, freq or f are
    frequency responses; a real array of the same shape called coherence goes with them, and so do the texts kind,
    outputs and inputs. Anything else is read as `read_series_mat` does, version 7.3 as `read_measured_hdf5` does.

    Args:
        path: the file.
        channels: from channels to places; None takes their names.
        sample_rate_hz: the rate, where the file has neither times nor rate; where it has, they must agree.
        variable: the array, where there are several.
        time_variable: the times, where they are called otherwise.
        freq_variable: the frequencies in Hz, where they are called otherwise.
        kind: what the responses are: receptance, mobility or accelerance.
        outputs: their degrees of freedom, such as sensor.x.
        inputs: those of the forces.
        progress: called with the share that is read.

    Raises:
        DataFileError: the file is none, is damaged, or does not say which of its variables hold what.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    asked: dict[str, Any] = {
        "variable": variable, "freq_variable": freq_variable, "kind": kind, "outputs": outputs, "inputs": inputs,
    }  # fmt: skip
    head = _head(path)
    if head.startswith(b"MATLAB 7.3") or head.startswith(b"\x89HDF\r\n\x1a\n"):
        from armonic.files.measured_hdf5 import read_measured_hdf5

        return read_measured_hdf5(
            path, channels=channels, sample_rate_hz=sample_rate_hz, time_variable=time_variable, progress=progress,
            **asked,
        )  # fmt: skip
    try:
        content = parse(read_bytes(path))
    except DamageError as error:
        raise DataFileError(str(path), found=f"another file, or a damaged one ({error})", expected=_EXPECTED) from error
    arrays = {
        name: _stored(value)
        for name, value in content.items()
        if isinstance(value, np.ndarray) and value.size and value.dtype.kind in "fiuc"
    }
    if holds_frfs(arrays, variable):
        texts = {name: words for name, value in content.items() if (words := _words(value))}
        found = found_frfs(path, arrays, texts=texts, **asked)
        read = measured(path, channels=channels, frfs=found.frfs, skipped=found.skipped, remarks=found.remarks)
    else:
        series = read_series_mat(
            path, sample_rate_hz=sample_rate_hz, variable=variable, time_variable=time_variable
        )  # fmt: skip
        read = measured(path, channels=channels, records=(series,))
    if progress is not None:
        progress(1.0)
    return read


def _head(path: str | Path) -> bytes:
    try:
        with Path(path).open("rb") as file:
            head = file.read(128)
    except (OSError, ValueError) as error:
        found = getattr(error, "strerror", None) or str(error)
        raise DataFileError(str(path), found=found, expected="a readable file") from error
    if not head:
        raise DataFileError(str(path), found="an empty file", expected=_EXPECTED)
    return head


def _stored(value: Any) -> Stored:
    return Stored(value.shape, value.dtype.kind, lambda: value)


def _words(value: Value) -> tuple[str, ...]:
    """The words of a text or of a cell array of texts."""
    if isinstance(value, Text):
        return tuple(row.strip() for row in value.rows)
    if isinstance(value, Cells) and all(isinstance(item, Text) and len(item.rows) == 1 for item in value.items):
        return tuple(item.rows[0].strip() for item in value.items if isinstance(item, Text))
    return ()
