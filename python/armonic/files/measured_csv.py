"""Comma-separated text of measured data: a matrix of frequency responses, or a time record."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from armonic.errors import DataFileError, FrfError
from armonic.files.cells import AXES
from armonic.files.coherence import read_coherence
from armonic.files.mapped import measured
from armonic.files.measured_file import MeasuredFile
from armonic.files.series_csv import read_series_csv
from armonic.files.table import read_csv, write_csv
from armonic.frf_set import FrfSet
from armonic.response import Frf, Kind

if TYPE_CHECKING:
    from armonic.files.channel_map import ChannelMap


def read_measured_csv(
    path: str | Path,
    *,
    channels: ChannelMap | None = None,
    sample_rate_hz: float | None = None,
    kind: Kind | None = None,
    frame: str | None = None,
    coherence: str | Path | None = None,
    progress: Callable[[float], object] | None = None,
) -> MeasuredFile:
    """Read frequency responses or a time record from comma-separated text.

    A header that begins with freq_hz makes it responses, as `read_csv` reads them, at one frame ("x/y re") or at
    several places ("sensor.x/elbow.y re"); anything else a record, as `read_series_csv` reads it.

    Args:
        path: the file.
        channels: from channels to places; None takes their names.
        sample_rate_hz: the rate, where the file has no times; where it has, they must agree.
        kind: what the responses are, where the file does not say.
        frame: the place of responses that name axes alone; default: that of the file, or "tip".
        coherence: a file with that of every response, of the same layout (see `read_coherence`).
        progress: called with the share that is read.

    Raises:
        DataFileError: the file is no such table, or is damaged.
        FrfError: `kind` is unknown.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    if _begins(path).lower().startswith("freq_hz"):
        frf = read_csv(path, frame=frame, kind=kind)
        gamma2 = None if coherence is None else read_coherence(coherence).on(frf)
        try:
            frfs = _by_labels(frf, gamma2) or FrfSet.from_frf(frf, coherence=gamma2)
        except FrfError as error:
            where = f"{path}: {error.where}"
            raise DataFileError(where, found=error.found, expected=error.expected, hint=error.hint) from error
        remarks = [f"{path} has no coherence."] if gamma2 is None else []
        read = measured(path, channels=channels, frfs=frfs, remarks=remarks)
    else:
        if coherence is not None:
            raise DataFileError(str(path), found="a time record and coherence=", expected="frequency responses with it")
        read = measured(path, channels=channels, records=(read_series_csv(path, sample_rate_hz=sample_rate_hz),))
    if progress is not None:
        progress(1.0)
    return read


def write_measured_csv(path: str | Path, frfs: FrfSet) -> None:
    """Write frequency responses as `read_measured_csv` reads them; values come back bit for bit.

    Coherence, averages and notes have no place in such a table.

    Args:
        path: the file; an existing one is replaced, once all is written.
        frfs: what to write, every pair measured and without an exponential window.

    Raises:
        DataFileError: a pair is missing, an exponential window is left in, or the file cannot be written.
        FrfError: a label holds a blank, comma, slash or quote.
    """
    if frfs.decay_rate or not frfs.complete:
        found = "an exponential window" if frfs.decay_rate else "pairs that were not measured"
        hint = "Write .h5 or .uff, which have a place for them."
        raise DataFileError(str(path), found=found, expected="a whole matrix without a window", hint=hint)
    if frfs.outputs == frfs.inputs and len(frfs.places) == 1:
        write_csv(path, frfs.matrix()[0])
        return
    write_csv(path, Frf(frfs.freq_hz, frfs.values, frfs.kind, frfs.outputs, frfs.inputs))


def _begins(path: str | Path) -> str:
    """The first line that is no comment; empty where there is none."""
    try:
        with Path(path).open(encoding="utf-8-sig", errors="replace") as file:
            return next((line.strip() for line in file if line.strip() and not line.startswith("#")), "")
    except (OSError, ValueError) as error:
        found = getattr(error, "strerror", None) or str(error)
        raise DataFileError(str(path), found=found, expected="a readable file") from error


def _by_labels(frf: Frf, gamma2: object) -> FrfSet | None:
    """The set of a table whose columns name places as well as axes."""
    labels = (*frf.outputs, *frf.inputs)
    if not all(label.rpartition(".")[0] and label.rpartition(".")[2] in AXES for label in labels):
        return None
    return FrfSet(frf.freq_hz, frf.values, frf.kind, frf.outputs, frf.inputs, coherence=gamma2)  # type: ignore[arg-type]
