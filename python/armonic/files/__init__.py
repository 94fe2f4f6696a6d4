"""Measurement files: universal files (data set 58) and CSV, from and to `Frf`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from armonic.errors import DataFileError
from armonic.files.table import read_csv, write_csv
from armonic.files.universal import read_uff, write_uff
from armonic.response import Frf

__all__ = ["read_csv", "read_frf", "read_uff", "write_csv", "write_frf", "write_uff"]

_SUFFIXES = {".uff": "uff", ".unv": "uff", ".uf58": "uff", ".csv": "csv"}
_READERS: dict[str, Callable[..., Frf]] = {"uff": read_uff, "csv": read_csv}
_WRITERS: dict[str, Callable[..., None]] = {"uff": write_uff, "csv": write_csv}


def read_frf(path: str | Path, **options: Any) -> Frf:
    """Read a measured FRF matrix, by the ending of the name: .uff, .unv, .uf58 or .csv.

    Args:
        path: the file.
        options: those of `read_uff` or `read_csv`.

    Raises:
        DataFileError: the ending is unknown, or the file does not hold one whole FRF matrix.
        FrfError: an option does not make sense.
    """
    return _READERS[_format(path)](path, **options)


def write_frf(path: str | Path, frf: Frf, **options: Any) -> None:
    """Write an FRF matrix, by the ending of the name: .uff, .unv, .uf58 or .csv.

    Args:
        path: the file; an existing one is replaced, once all is written.
        frf: what to write.
        options: those of `write_uff`; CSV has none.

    Raises:
        DataFileError: the ending is unknown, or the file cannot be written.
        FrfError: the labels have no place in the format.
    """
    _WRITERS[_format(path)](path, frf, **options)


def _format(path: str | Path) -> str:
    suffix = Path(path).suffix
    if suffix.lower() not in _SUFFIXES:
        raise DataFileError(
            str(path),
            found=f"the ending {suffix!r}" if suffix else "no ending",
            expected=f"one of {', '.join(_SUFFIXES)}",
            hint="For another ending, use read_uff, read_csv, write_uff or write_csv.",
        )
    return _SUFFIXES[suffix.lower()]
