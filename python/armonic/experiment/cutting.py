"""The stretch of a record that belongs to a hit, its offsets taken off, and how far the response is at its ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

STRETCH = 0.05
"""Share of the window over which levels and offsets are averaged."""
_FEW = 4
"""No mean of fewer samples is taken for an offset."""
_NEAR = 64
"""Samples to either side of a contact from which the offset of the force is taken, at least."""


@dataclass(frozen=True)
class Cut:
    """Where a hit lies in its record, in samples.

    Attributes:
        quiet: first sample after whatever was before: the end of the hit before this one, or the start of the record.
        start: first sample of the window.
        first: first sample of the contact.
        last: last sample of the contact, rebounds included.
        stop: first sample after the window.
    """

    quiet: int
    start: int
    first: int
    last: int
    stop: int

    @property
    def stretch(self) -> int:
        """Samples over which levels are averaged."""
        return max(int(STRETCH * (self.stop - self.start)), _FEW)

    @property
    def before(self) -> slice:
        """Quiet samples before the contact, as many as a stretch or the pretrigger has."""
        return slice(max(self.quiet, min(self.start, self.first - self.stretch)), self.first)


def force_of(force: Array, cut: Cut) -> Array:
    """The force of a hit, (window,), without its offset: the mean close before and after the contact."""
    length = cut.last - cut.first + 1
    near = max(20 * length, _NEAR)
    after = cut.last + 1 + max(length, 10)
    beside = np.concatenate(
        [force[max(cut.quiet, cut.first - near) : cut.first], force[after : min(after + near, cut.stop)]]
    )
    beside = beside[np.isfinite(beside)]
    return np.asarray(force[cut.start : cut.stop] - (beside.mean() if len(beside) >= _FEW else 0.0))


def responses_of(responses: Array, cut: Cut) -> Array:
    """The responses of a hit, (window, channels), without their offsets: the mean before the hit.

    The mean over the decay would take a part of the decay itself. Where nothing was recorded before the hit, it is the
    mean of the last stretch of the window.
    """
    return np.asarray(responses[cut.start : cut.stop] - _offset(responses, cut))


def quiet_level(responses: Array, cut: Cut) -> Array:
    """RMS of each response about its mean before the hit, (channels,); NaN where too little was recorded there."""
    before = responses[cut.before]
    before = before[np.isfinite(before).all(axis=1)]
    if len(before) < 2 * _FEW:
        return np.full(responses.shape[1], np.nan)
    return np.asarray(before.std(axis=0))


def end_levels(responses: Array, cut: Cut) -> tuple[Array, Array]:
    """RMS of each response over the first stretch from the contact on, and over the last of the window."""
    offset = _offset(responses, cut)

    def rms(part: Array) -> Array:
        return np.asarray(np.sqrt(((part - offset) ** 2).mean(axis=0)))

    first = responses[cut.first : min(cut.first + cut.stretch, cut.stop)]
    return rms(first), rms(responses[max(cut.stop - cut.stretch, cut.start) : cut.stop])


def above_noise(level: Array, noise: Array, averaged: tuple[int, int]) -> Array:
    """What of a level is not noise, zero where the two differ by no more than chance (three deviations of a variance).

    Args:
        level: RMS, (channels,).
        noise: RMS of the noise; NaN where it is not known, which counts as none.
        averaged: samples over which each of them is an average.
    """
    noise = np.nan_to_num(noise)
    chance = 1 + 3 * np.sqrt(2 / max(averaged[0], 1) + 2 / max(averaged[1], 1))
    power = np.where(level**2 > chance * noise**2, level**2 - noise**2, 0.0)
    return np.asarray(np.sqrt(power))


def _offset(responses: Array, cut: Cut) -> Array:
    before = responses[cut.before]
    before = before[np.isfinite(before).all(axis=1)]
    if len(before) < _FEW:
        before = responses[cut.stop - cut.stretch : cut.stop]
    return np.asarray(before.mean(axis=0))
