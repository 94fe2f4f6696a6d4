"""Measured modes as comma-separated text: frequencies, damping, and how sure they are."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.sheet import read_sheet
from armonic.files.uff_reader import shown

Array = NDArray[np.float64]

_COLUMNS = {
    "natural_freq_hz": ("freq_hz", 1.0),
    "damped_freq_hz": ("freq_hz", 1.0),
    "damping_ratio": ("damping_ratio", 1.0),
    "damping_percent": ("damping_ratio", 0.01),
    "freq_deviation": ("freq_deviation", 1.0),
    "freq_deviation_percent": ("freq_deviation", 0.01),
    "damping_deviation": ("damping_deviation", 1.0),
    "damping_deviation_percent": ("damping_deviation", 0.01),
}
"""What a column is called: which quantity it holds, and its factor to a frequency in Hz or a share."""
_HEADER = "a header such as natural_freq_hz,damping_ratio or damped_freq_hz,damping_percent"
_WHICH = "Say which: natural_freq_hz is |λ|/2π, damped_freq_hz is Im λ/2π."


class ModalTable(NamedTuple):
    """Measured modes, (m,) each; None where the file has no such column.

    Attributes:
        freq_hz: frequencies.
        damped: whether they are damped ones, Im λ/2π, or natural ones, |λ|/2π.
        damping_ratio: fractions.
        freq_deviation: relative standard deviations of the frequencies.
        damping_deviation: of the damping ratios.
    """

    freq_hz: Array
    damped: bool
    damping_ratio: Array | None
    freq_deviation: Array | None
    damping_deviation: Array | None


def read_modal_table(path: str | Path) -> ModalTable:
    """Read measured modes from comma-separated text, one line per mode.

    The header names `natural_freq_hz` or `damped_freq_hz`; if damping was measured `damping_ratio` or
    `damping_percent`; if they are known the relative standard deviations `freq_deviation` and `damping_deviation`, or
    in percent `freq_deviation_percent` and `damping_deviation_percent`. Lines that start with # are skipped.

    Args:
        path: the file.

    Raises:
        DataFileError: the file is not such a table.
    """
    sheet = read_sheet(path, _HEADER)
    names = [word.strip() for word in sheet.header]
    found: dict[str, int] = {}
    for position, name in enumerate(names):
        if name not in _COLUMNS:
            vague = name.lower() in ("freq_hz", "frequency_hz", "frequency", "freq", "f", "hz")
            hint = _WHICH if vague else f"Columns are {', '.join(_COLUMNS)}."
            raise DataFileError(sheet.place, found=f"column {shown(name)}", expected=_HEADER, hint=hint)
        quantity = _COLUMNS[name][0]
        if quantity in found:
            both = f"{names[found[quantity]]} and {name}"
            raise DataFileError(sheet.place, found=both, expected="one of them")
        found[quantity] = position
    for quantity, needed in (("freq_hz", None), ("damping_ratio", "damping_deviation")):
        if quantity not in found and (needed is None or needed in found):
            raise DataFileError(sheet.place, found=shown(",".join(names)), expected=_HEADER)
    if not sheet.rows:
        raise DataFileError(str(path), found="a header and no mode", expected="at least one line")
    table = sheet.numbers()
    columns = {quantity: table[:, k] * _COLUMNS[names[k]][1] for quantity, k in found.items()}
    return ModalTable(
        columns["freq_hz"],
        names[found["freq_hz"]] == "damped_freq_hz",
        *(columns.get(name) for name in ("damping_ratio", "freq_deviation", "damping_deviation")),
    )
