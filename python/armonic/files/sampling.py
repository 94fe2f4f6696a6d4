"""What the formats of time series share: the sampling settled, quantities guessed, refusals that name the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError, SignalError
from armonic.series import UNEVEN, Channel, Quantity, TimeSeries, even_sampling

Array = NDArray[np.float64]

AGREE = 1e-4
"""A rate that is stated and one that follows from times may differ by this share."""

_BY_UNIT: dict[str, Quantity] = {"m": "displacement", "m/s": "velocity", "m/s²": "acceleration", "N": "force"}
_NO_RATE = "Say it with sample_rate_hz=."


def settle(
    path: str | Path,
    times_s: Array | None,
    *,
    stated_hz: float | None = None,
    asked_hz: float | None = None,
    own_start_s: float | None = None,
    place: Callable[[int], str] | None = None,
) -> tuple[float, float]:
    """The time of the first sample in s and the sampling rate in Hz, from all that is known of them.

    A rate that a file or a user states is taken as it is; it has to agree with the times, if there are any.

    Args:
        path: the file, for errors.
        times_s: (samples,) as the file has them.
        stated_hz: the rate as the file has it.
        asked_hz: the rate as the user has it.
        own_start_s: the start as a file of ours states it. Its times may then be as coarse as numbers of their size
            are, even several alike, as long as each is that of its sample.
        place: where in the file the sample of an index stands.

    Raises:
        DataFileError: nothing tells the rate, the times are no even times, or two rates differ.
        SignalError: `asked_hz` is not a positive number.
    """
    if asked_hz is not None and not (np.isfinite(asked_hz) and asked_hz > 0):
        raise SignalError("sample_rate_hz", found=repr(asked_hz), expected="a positive number of Hz")
    if stated_hz is not None and not (np.isfinite(stated_hz) and stated_hz > 0):
        raise DataFileError(str(path), found=f"a sampling rate of {stated_hz:g} Hz", expected="a positive number of Hz")
    rate = stated_hz if stated_hz is not None else asked_hz
    if rate is not None and asked_hz is not None and abs(rate - asked_hz) > AGREE * rate:
        raise DataFileError(
            str(path), found=f"a sampling rate of {rate:.9g} Hz", expected=f"{asked_hz:.9g} Hz, as sample_rate_hz says"
        )
    if times_s is None or (times_s.size == 1 and rate is not None):
        if rate is None:
            raise DataFileError(str(path), found="no times and no sampling rate", expected="either", hint=_NO_RATE)
        return (0.0 if times_s is None else float(times_s[0])), rate
    if own_start_s is not None and rate is not None and _are_of(times_s, own_start_s, rate):
        return own_start_s, rate
    try:
        start_s, from_times = even_sampling(times_s)
    except SignalError as error:
        where = str(path) if place is None else place(_faulty(times_s))
        raise DataFileError(where, found=error.found, expected=error.expected, hint=error.hint) from error
    if rate is None:
        return start_s, from_times
    if abs(rate - from_times) > (AGREE + 2 * UNEVEN / (times_s.size - 1)) * rate:
        found = f"times that say {from_times:.9g} Hz and a sampling rate of {rate:.9g} Hz"
        raise DataFileError(str(path), found=found, expected="one sampling rate")
    return start_s, rate


def built(
    path: str | Path,
    values: Array,
    sampling: tuple[float, float],
    channels: Sequence[tuple[str, str, str]],
    notes: Mapping[str, str] | None = None,
) -> TimeSeries:
    """A series of what stood in a file.

    Args:
        path: the file, for errors.
        values: (samples, channels).
        sampling: start in s and rate in Hz.
        channels: name, quantity and unit of each.
        notes: free text.

    Raises:
        DataFileError: what stood there makes no series.
    """
    try:
        made = tuple(Channel(name, quantity, unit) for name, quantity, unit in channels)  # type: ignore[arg-type]
        return TimeSeries(values, sampling[1], made, sampling[0], notes or {})
    except SignalError as error:
        where = f"{path}: {error.where}"
        raise DataFileError(where, found=error.found, expected=error.expected, hint=error.hint) from error


def plain(text: str) -> str:
    """A name or unit of another program as a channel may have it: in one line, its superscripts in one way."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line.replace("^2", "²").replace("**2", "²")


def guessed(unit: str) -> Quantity:
    """The quantity that has such a unit, where only one does."""
    return _BY_UNIT.get(unit, "signal")


def _are_of(times_s: Array, start_s: float, rate: float) -> bool:
    """Whether times are those of the samples, up to the rounding of numbers of that size."""
    with np.errstate(all="ignore"):  # what overflows is not finite, and so no such time
        off = np.abs(times_s - (start_s + np.arange(times_s.size) / rate))
        # The sum rounds by half a unit in the last place of the largest, and so may that of another program.
        return bool((off <= 2 * np.spacing(np.abs(times_s).max())).all())


def _faulty(times_s: Array) -> int:
    """The index of the sample whose time is at fault."""
    finite = np.isfinite(times_s)
    if not finite.all():
        return int(np.argmin(finite))
    steps = np.diff(times_s)
    if not (steps > 0).all():
        return int(np.argmin(steps > 0)) + 1
    return int(np.argmax(np.abs(steps - np.median(steps)))) + 1 if steps.size else 0
