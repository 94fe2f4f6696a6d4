"""Windows of an impact test: one that rids the force of noise, one that lets a response end within its record."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

ENDED = 0.01
"""A response that is down to this share of its start has ended: what is cut off then is 80 dB of power down."""
LEAST_HOLD = 10
"""The force is kept for so many samples after a contact: an anti-alias filter still rings there."""


def force_window(samples: int, first: int, last: int, hold: int | None = None) -> Array:
    """One up to the end of a contact and a little longer, then a cosine taper, then zero.

    Between hits a hammer measures nothing but noise. What the anti-alias filter makes of the contact after its end is
    no noise, and is kept: the window stays at one for as long as the contact lasted, 10 samples at least, and falls to
    zero in the same time.

    Args:
        samples: length of the window.
        first: sample at which the contact begins.
        last: its last sample.
        hold: samples to stay at one after the contact, and samples of the taper; the rule above if not given.

    Returns:
        (samples,).

    Raises:
        SignalError: the contact is not within the window.
    """
    if not 0 <= first <= last < samples:
        found = f"a contact of samples {first} to {last}"
        raise SignalError("force_window", found=found, expected=f"samples within 0 to {samples - 1}")
    hold = max(last - first + 1, LEAST_HOLD) if hold is None else hold
    after = np.arange(samples) - (last + hold)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip(after / max(hold, 1), 0.0, 1.0)))


def exponential_window(samples: int, sample_rate_hz: float, decay_rate: float) -> Array:
    """e^(−a t) from the first sample on.

    On force and response alike, from one origin, it moves the lines from s = iω to s = iω + a and changes nothing else:
    the transform of y e^(−at) is Y(s + a), so that the ratio is H(iω + a) exactly, where every pole seems damped by a
    more (Fladung and Rost 1997).

    Args:
        samples: length of the window.
        sample_rate_hz: samples per second.
        decay_rate: a in 1/s.

    Returns:
        (samples,).
    """
    return np.asarray(np.exp(-decay_rate / sample_rate_hz * np.arange(samples)))


def needed_decay_rate(end_ratio: float, window_s: float) -> float:
    """The a in 1/s of an exponential window under which a response ends within its record: 0 if it does by itself.

    Args:
        end_ratio: RMS over the last 5 % of the window as a share of that over the first.
        window_s: length of the window.
    """
    if not end_ratio > ENDED:
        return 0.0
    return math.log(end_ratio / ENDED) / (0.95 * window_s)  # from the middle of one stretch to that of the other
