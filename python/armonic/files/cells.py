"""What the file formats share: cells put together, axes remapped, bytes read and written whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError, FrfError
from armonic.response import KINDS, Frf, Kind

AXES = ("x", "y", "z", "rx", "ry", "rz")
"""The axes of a sensor frame, in the order of the direction codes 1 to 6 of universal files."""


class Cell(NamedTuple):
    """One entry of an FRF matrix as found in a file, in SI units and along axes of the sensor frame."""

    place: str
    output: str
    input: str
    freq_hz: NDArray[np.float64]
    values: NDArray[np.complex128]


def matrix(
    path: str | Path,
    cells: list[Cell],
    kind: Kind,
    frame: str | None,
    outputs: str | Sequence[str] | None,
    inputs: str | Sequence[str] | None,
) -> Frf:
    """Cells put together into a whole matrix.

    Args:
        path: the file, for errors.
        cells: in any order; axes come out in the order of their first cell.
        kind: of all cells.
        frame: the sensor frame, if known.
        outputs: the axes to take, in this order; None takes all.
        inputs: likewise.

    Raises:
        DataFileError: a cell is missing, there twice or on other frequencies, or the numbers make no FRF.
        FrfError: `kind` is unknown, or `outputs` or `inputs` names no axis or one twice.
    """
    if kind not in KINDS:
        raise FrfError("kind", found=repr(kind), expected=f"one of {', '.join(KINDS)}")
    rows = _wanted("outputs", outputs, (cell.output for cell in cells))
    columns = _wanted("inputs", inputs, (cell.input for cell in cells))
    found: dict[tuple[str, str], Cell] = {}
    for cell in cells:
        if cell.output not in rows or cell.input not in columns:
            continue
        key, place, name = (cell.output, cell.input), cell.place, f"{cell.output}/{cell.input}"
        if key in found:
            raise DataFileError(place, found=f"{name} again", expected=f"one function, as at {found[key].place}")
        found[key] = cell
        first = next(iter(found.values()))
        if not _same(cell.freq_hz, first.freq_hz):
            raise DataFileError(
                place,
                found=f"{name} on {_span(cell.freq_hz)}",
                expected=f"{_span(first.freq_hz)}, as {first.output}/{first.input} at {first.place}",
            )
    missing = [f"{row}/{column}" for row in rows for column in columns if (row, column) not in found]
    if missing:
        raise DataFileError(
            str(path),
            found=f"no response {', '.join(missing)}",
            expected=f"a whole matrix of {' '.join(rows)} per force along {' '.join(columns)}",
            hint="Read a part that is whole by passing outputs= and inputs=.",
        )
    values = np.stack([np.stack([found[row, column].values for column in columns], -1) for row in rows], 1)
    try:
        return Frf(first.freq_hz, values, kind, rows, columns, frame)
    except FrfError as error:
        where = f"{path}: {error.where}"
        raise DataFileError(where, found=error.found, expected=error.expected, hint=error.hint) from error


def remapping(axes: Mapping[str, str] | None) -> dict[str, tuple[str, float]]:
    """For every axis of a file, the axis of the sensor frame along which it lies, and its sign.

    Raises:
        FrfError: an axis is unknown, two axes fall on one, or a rotation is mixed with a translation.
    """
    signed: dict[str, tuple[str, float]] = {axis: (axis, 1.0) for axis in AXES}
    for source, target in (axes or {}).items():
        bare = target.removeprefix("-").removeprefix("+") if isinstance(target, str) else ""
        if source not in AXES or bare not in AXES or len(bare) != len(source):
            raise FrfError(
                "axes",
                found=f"{source!r}: {target!r}",
                expected="pairs such as 'x': '-z' of x, y, z, or of rx, ry, rz",
            )
        signed[source] = (bare, -1.0 if target.startswith("-") else 1.0)
    if len({axis for axis, _ in signed.values()}) < len(AXES):
        listed = ", ".join(f"{source} on {target}" for source, (target, _) in signed.items() if source != target)
        raise FrfError("axes", found=f"two axes that fall on one ({listed})", expected="a permutation")
    return signed


def read_bytes(path: str | Path) -> bytes:
    """The whole file, or a DataFileError."""
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        found = getattr(error, "strerror", None) or str(error)
        raise DataFileError(str(path), found=found, expected="a readable file") from error


def _wanted(where: str, labels: str | Sequence[str] | None, found: Iterable[str]) -> tuple[str, ...]:
    if labels is None:
        return tuple(dict.fromkeys(found))
    wanted = (labels,) if isinstance(labels, str) else tuple(labels)
    if not wanted or len(set(wanted)) < len(wanted):
        raise FrfError(where, found=repr(labels), expected="one axis or several different ones")
    return wanted


def _same(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    return a.shape == b.shape and bool((np.abs(a - b) <= 1e-9 * np.abs(b).max()).all())


def _span(f: NDArray[np.float64]) -> str:
    step = f", first step {f[1] - f[0]:.7g} Hz" if f.size > 1 else ""
    return f"{f.size} lines from {f[0]:.7g} to {f[-1]:.7g} Hz{step}"
