"""How long the window of every hit can be: the room each has up to the next hit or the end of its record."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armonic.errors import SignalError

if TYPE_CHECKING:
    from collections.abc import Sequence

SHORT = 0.5
"""A hit with less than this share of the usual room is left out, rather than shorten the window of all."""
LEAST = 16
"""Samples of a window at least."""


@dataclass(frozen=True)
class Room:
    """What a hit has: the samples from `start` to before `stop` of its record."""

    record: int
    start: int
    stop: int

    @property
    def samples(self) -> int:
        """How many they are."""
        return self.stop - self.start


def window_samples(
    rooms: Sequence[Room],
    fit: Sequence[bool],
    sample_rate_hz: float,
    window_s: float | None,
    resolution_hz: float | None,
) -> tuple[int, tuple[str, ...]]:
    """Samples of the window that all hits share, and remarks on how they came about.

    Args:
        rooms: of all hits.
        fit: which of them may be used as far as is known; of all if none is.
        sample_rate_hz: samples per second.
        window_s: the length, if it is asked for.
        resolution_hz: spacing of the lines, if it is asked for: no longer window is needed than 1 / resolution_hz.

    Raises:
        SignalError: a number is out of its range, or records differ in length by more than a factor of two where
            neither is asked for.
    """
    for name, value in (("window_s", window_s), ("resolution_hz", resolution_hz)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise SignalError(name, found=repr(value), expected="a positive number")
    most = None if resolution_hz is None else lines_samples(sample_rate_hz, resolution_hz)
    if window_s is not None:
        samples = round(window_s * sample_rate_hz)
        if samples < LEAST:
            expected = f"{LEAST / sample_rate_hz:g} s ({LEAST} samples) at least"
            raise SignalError("window_s", found=f"{window_s:g} s", expected=expected)
        if most is not None and samples > most:
            raise SignalError(
                "resolution_hz",
                found=f"{resolution_hz:g} Hz with a window of {window_s:g} s",
                expected=f"{sample_rate_hz / samples:g} Hz or less, the resolution of that window",
            )
        return samples, ()
    usable = [room for room, good in zip(rooms, fit, strict=True) if good] or list(rooms)
    lengths = np.array([room.samples if most is None else min(room.samples, most) for room in usable])
    if most is None:
        _refuse_different(usable, sample_rate_hz)
    enough = lengths >= SHORT * np.median(lengths)
    samples = int(lengths[enough].min())
    if samples < LEAST:
        room = usable[int(np.flatnonzero(enough & (lengths == samples))[0])]
        found = f"room for {samples} samples after the hit"
        raise SignalError(f"records[{room.record}]", found=found, expected=f"{LEAST} at least")
    if samples == lengths[enough].max():
        return samples, ()
    room = usable[int(np.flatnonzero(enough & (lengths == samples))[0])]
    longest = lengths.max() / sample_rate_hz
    return samples, (
        f"The window of every hit is {samples / sample_rate_hz:.4g} s, all that one in records[{room.record}] has room "
        f"for; others have up to {longest:.4g} s.",
    )


def lines_samples(sample_rate_hz: float, resolution_hz: float) -> int:
    """Samples, zeros included, whose transform has lines so far apart."""
    samples = round(sample_rate_hz / resolution_hz)
    if samples < LEAST:
        expected = f"{sample_rate_hz / LEAST:g} Hz or less at {sample_rate_hz:g} samples per second"
        raise SignalError("resolution_hz", found=f"{resolution_hz:g} Hz", expected=expected)
    return samples


def _refuse_different(rooms: Sequence[Room], rate: float) -> None:
    """Records of which one has less than half the room of another."""
    usual: dict[int, list[int]] = {}
    for room in rooms:
        usual.setdefault(room.record, []).append(room.samples)
    middle = {record: float(np.median(lengths)) for record, lengths in usual.items()}
    short, long = min(middle, key=lambda k: middle[k]), max(middle, key=lambda k: middle[k])
    if middle[short] < SHORT * middle[long]:
        raise SignalError(
            f"records[{short}]",
            found=f"different resolutions: {middle[short] / rate:.4g} s for a hit, {middle[long] / rate:.4g} s in "
            f"records[{long}]",
            expected="windows of one length",
            hint="Say window_s (or resolution_hz), or leave the record out.",
        )
