"""Contacts of a hammer in a record of force: where each begins and ends, how hard it is, and what follows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

LOUD = 8.0
"""Nothing below so many standard deviations of the noise is a hit: a long record of noise alone reaches five."""
REBOUND_S = 0.5
"""A further contact within this time of the first is a rebound; nobody hits twice on purpose so fast."""
EDGE = 0.02
"""A contact reaches out to where the force is this share of its peak."""
_BLOCK_S = 0.2
"""The rest of a force is its median over such times, which no contact fills to a half."""
_RINGING = 8
"""Samples over which the swings of a filter's ringing are compared."""


@dataclass(frozen=True)
class Contact:
    """One contact, rebounds within `REBOUND_S` included.

    Attributes:
        first: sample at which it begins.
        last: its last sample.
        peak: sample of the greatest force.
        force: that force in the unit of the record, with its sign, without the offset.
    """

    first: int
    last: int
    peak: int
    force: float

    @property
    def samples(self) -> int:
        """How many samples it lasts."""
        return self.last - self.first + 1


def at_rest(force: Array, sample_rate_hz: float) -> tuple[Array, float]:
    """A force without its offset and slow drift, and the standard deviation of its noise.

    Rest is the median over blocks of 0.2 s, joined by straight lines, so that neither contacts nor a single wild
    sample move it. Values that are not finite count as rest.

    Args:
        force: (samples,).
        sample_rate_hz: samples per second.

    Returns:
        (samples,) force without rest; the standard deviation, from the median of its size.
    """
    finite = np.isfinite(force)
    if not finite.any():
        return np.zeros(force.shape), 0.0
    filled = np.where(finite, force, np.median(force[finite]))
    length = max(int(_BLOCK_S * sample_rate_hz), 15)
    blocks = max(len(filled) // length, 1)
    parts = np.array_split(filled, blocks)
    middles = np.cumsum([0, *map(len, parts[:-1])]) + np.array([(len(part) - 1) / 2 for part in parts])
    rest = np.interp(np.arange(len(filled)), middles, [np.median(part) for part in parts])
    free = np.where(finite, filled - rest, 0.0)
    return free, 1.4826 * float(np.median(np.abs(free)))


def contacts(free: Array, noise: float, sample_rate_hz: float, trigger: float) -> list[Contact]:
    """The contacts of a record, in order of time.

    Args:
        free: (samples,) force at rest around zero, see `at_rest`.
        noise: its standard deviation.
        sample_rate_hz: samples per second.
        trigger: share of the largest force of the record that a contact exceeds.
    """
    size = np.abs(free)
    largest = float(size.max(initial=0.0))
    if largest == 0 or largest < LOUD * noise:
        return []
    found: list[Contact] = []
    over = np.flatnonzero(size >= max(trigger * largest, LOUD * noise))
    while over.size:
        group = over[over <= over[0] + REBOUND_S * sample_rate_hz]
        over = over[len(group) :]
        peak = int(group[np.argmax(size[group])])
        first, last = _extent(np.sign(free[peak]) * free, peak, max(EDGE * size[peak], 3 * noise))
        found.append(Contact(first, last, peak, float(free[peak])))
        over = over[over > last]
    return found


def second_pulses(free: Array, contact: Contact, start: int, stop: int, level: float) -> list[tuple[int, int, float]]:
    """Further pulses of the same sign beside a contact: rebounds, or a touch before it.

    The ringing of an anti-alias filter swings to either side, and each swing is smaller than the one of the other sign
    before it (seen from the contact); a pulse that is larger than what swings the other way beside it is a contact.

    Args:
        free: (samples,) force at rest around zero.
        contact: the contact.
        start: first sample that is looked at.
        stop: first one after those.
        level: force that a pulse exceeds.

    Returns:
        First and last sample and greatest force of each.
    """
    toward = np.sign(contact.force) * free
    start, stop = max(start, 0), min(stop, len(free))
    over = start + np.flatnonzero(toward[start:stop] >= level)
    over = over[(over < contact.first) | (over > contact.last)]
    if not over.size:
        return []
    reach = max(contact.samples, _RINGING)
    found = []
    for run in np.split(over, np.flatnonzero(np.diff(over) > 1) + 1):
        one, end = int(run[0]), int(run[-1])
        if one > contact.last:
            beside = toward[max(contact.last + 1, one - reach) : one]
        else:
            beside = toward[end + 1 : min(contact.first, end + 1 + reach)]
        height = float(toward[one : end + 1].max())
        if height > -float(beside.min(initial=0.0)):
            found.append((*_extent(toward, one + int(np.argmax(toward[one : end + 1])), EDGE * height), height))
    return found


def _extent(toward: Array, peak: int, level: float) -> tuple[int, int]:
    """First and last sample of the pulse around a peak: as far as the force stays above a level."""
    below = toward <= level
    before, after = below[:peak][::-1], below[peak + 1 :]
    first = peak - (int(np.argmax(before)) if before.any() else len(before))
    last = peak + (int(np.argmax(after)) if after.any() else len(after))
    return first, last
