"""Which of the named arrays of a file are the times and samples of a record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.sampling import built, guessed, plain, settle
from armonic.series import QUANTITIES, TimeSeries

TIMES = ("t", "time", "time_s", "tid", "zeit", "tout")
"""What the times of samples are called, in small letters."""
RATES = ("sample_rate_hz", "fs", "samplerate", "sample_rate", "sampling_rate", "samplingrate", "srate")
"""What a sampling rate is called."""
STEPS = ("dt", "ts")
"""What a sampling interval is called."""


class Stored(NamedTuple):
    """An array of a file, perhaps not read yet.

    Attributes:
        shape: of it.
        kind: the letter of its NumPy kind: f i u c.
        read: gets it.
    """

    shape: tuple[int, ...]
    kind: str
    read: Callable[[], NDArray[Any]]

    @property
    def size(self) -> int:
        """How many numbers."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def longest(self) -> bool:
        """Whether it is a vector of two numbers or more."""
        return self.size > 1 and self.size == max(self.shape)

    def numbers(self) -> NDArray[np.float64]:
        """Its real numbers."""
        return np.asarray(self.read(), np.float64)


def found_record(
    path: str | Path,
    arrays: Mapping[str, Stored],
    *,
    sample_rate_hz: float | None = None,
    variable: str | None = None,
    time_variable: str | None = None,
    names: Sequence[str] = (),
    units: Sequence[str] = (),
) -> TimeSeries:
    """The time record among some arrays: the one matrix, or the vectors that are as long as the times.

    Args:
        path: the file, for errors.
        arrays: by name.
        sample_rate_hz: the rate, where the file has neither times nor rate; where it has, they must agree.
        variable: the matrix, where there are several.
        time_variable: the times, where they are called otherwise.
        names: of the channels, if known.
        units: of the channels, if known.

    Raises:
        DataFileError: the arrays do not say which of them hold the record.
        SignalError: `sample_rate_hz` is not a positive number.
    """
    real = {name: a for name, a in arrays.items() if a.kind in "fiu" and a.size and len(a.shape) <= 2}
    times_name = vector(path, real, time_variable, TIMES, "time_variable")
    times = real[times_name].numbers().ravel() if times_name else None
    values, columns = _samples(path, real, variable, times_name, None if times is None else times.size)
    sampling = settle(path, times, stated_hz=_rate(real), asked_hz=sample_rate_hz)
    width = values.shape[1]
    labels = [plain(str(name)) for name in (names if len(names) == width else columns)]
    in_units = [plain(str(unit)) for unit in units] if len(units) == width else [""] * width
    channels = []
    for label, unit in zip(labels, in_units, strict=True):
        quantity, colon, name = label.partition(":")
        if colon and quantity in QUANTITIES and name:
            channels.append((name, quantity, unit))
        else:
            channels.append((label, guessed(unit), unit))
    return built(path, values, sampling, channels)


def listing(arrays: Mapping[str, Stored]) -> str:
    """Names and shapes in a row."""
    shown = [f"{name} {'x'.join(map(str, a.shape)) or '1'}" for name, a in list(arrays.items())[:12]]
    return ", ".join([*shown, "..."] if len(arrays) > 12 else shown) or "no array of numbers"


def vector(
    path: str | Path, arrays: Mapping[str, Stored], wanted: str | None, usual: tuple[str, ...], option: str
) -> str | None:
    """The name of the vector that is asked for, or that has a usual name; None if there is none.

    Args:
        path: the file, for errors.
        arrays: by name.
        wanted: what is asked for, or None.
        usual: names in small letters.
        option: how it is asked for.

    Raises:
        DataFileError: there is no such vector.
    """
    if wanted is None:
        return next((name for name, a in arrays.items() if name.lower() in usual and a.longest), None)
    if wanted not in arrays or not arrays[wanted].longest:
        found = f"no vector {wanted} ({listing(arrays)})"
        raise DataFileError(str(path), found=found, expected=f"the vector that {option}= names")
    return wanted


def _rate(arrays: Mapping[str, Stored]) -> float | None:
    single = {name.lower(): float(a.numbers().item()) for name, a in arrays.items() if a.size == 1}
    for name in RATES:
        if name in single:
            return single[name]
    steps = (single[name] for name in STEPS if single.get(name, 0.0) > 0)
    return next((1 / step for step in steps), None)


def _samples(
    path: str | Path, arrays: Mapping[str, Stored], wanted: str | None, times: str | None, samples: int | None
) -> tuple[NDArray[np.float64], list[str]]:
    """The samples, (samples, channels), and a name for each column."""
    if wanted is not None and wanted not in arrays:
        found = f"no array {wanted} ({listing(arrays)})"
        raise DataFileError(str(path), found=found, expected="the matrix that variable= names")
    chosen = [wanted] if wanted is not None else [n for n, a in arrays.items() if a.size > 1 and n != times]
    if samples is not None and wanted is None:
        chosen = [name for name in chosen if samples in arrays[name].shape]
    if len(chosen) > 1 and all(arrays[n].longest for n in chosen) and len({arrays[n].size for n in chosen}) == 1:
        return np.column_stack([arrays[name].numbers().ravel() for name in chosen]), chosen
    if len(chosen) != 1:
        hint = "Name the matrix with variable=, and the times with time_variable=."
        raise DataFileError(str(path), found=listing(arrays), expected="one matrix of samples", hint=hint)
    array = np.atleast_2d(arrays[chosen[0]].numbers())
    count = max(array.shape) if samples is None else samples
    if count not in array.shape:
        found = f"{chosen[0]} {'x'.join(map(str, array.shape))} and {count} times"
        raise DataFileError(str(path), found=found, expected="as many samples as times")
    array = array if array.shape[0] == count else array.T
    if array.shape[1] == 1:
        return array, chosen
    return array, [f"{chosen[0]}_{k}" for k in range(1, array.shape[1] + 1)]
