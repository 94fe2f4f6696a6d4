"""What every identification method asks of samples, model orders and the band, checked in one place."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array: TypeAlias = NDArray[np.float64]


MOST = 10_000
"""No record is long enough for models of a higher order."""


def checked_samples(values: ArrayLike, sample_rate_hz: float) -> Array:
    """Samples as float64 (N, m), all finite, of channels that change.

    Raises:
        SignalError: not a real matrix, no sampling rate, or a channel with a value that is not finite or that never
            changes.
    """
    expected = "real numbers in an array (samples, channels)"
    try:
        samples = np.asarray(values)
        if np.iscomplexobj(samples):
            raise SignalError("values", found="complex numbers", expected=expected)
        samples = np.ascontiguousarray(samples, np.float64)
    except (TypeError, ValueError) as error:
        if isinstance(error, SignalError):
            raise
        raise SignalError("values", found=f"a {type(values).__name__} that is no array", expected=expected) from error
    if samples.ndim != 2 or not samples.size:
        raise SignalError("values", found=f"an array of shape {samples.shape}", expected=expected)
    if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0):
        raise SignalError("sample_rate_hz", found=repr(sample_rate_hz), expected="a positive number, Hz")
    bad = np.argwhere(~np.isfinite(samples))
    if len(bad):
        row, channel = (int(i) for i in bad[0])
        raise SignalError(
            f"values, channel {channel}, sample {row}",
            found=f"{samples[row, channel]:g} ({len(bad)} such values in all)",
            expected="finite numbers",
            hint="Cut the window so that it holds none, or fill the gap before.",
        )
    constant = np.flatnonzero(np.ptp(samples, axis=0) == 0)
    if len(constant):
        channel = int(constant[0])
        raise SignalError(
            f"values, channel {channel}",
            found=f"the same value, {samples[0, channel]:g}, in every sample",
            expected="a signal",
            hint="Leave the channel out.",
        )
    return samples


def checked_orders(orders: range | Sequence[int], *, step: int = 1) -> list[int]:
    """Model orders, positive and ascending.

    Args:
        orders: a range as it stands, or the first and last order, both included.
        step: between two orders where only the first and last are given.

    Raises:
        SignalError: no order, or they are no positive integers that ascend.
    """
    expected = "ascending positive integers: a range, or the first and last order"
    given = list(orders[:100_000]) if isinstance(orders, (range, Sequence)) else None
    if not given or not all(isinstance(p, (int, np.integer)) and not isinstance(p, bool) for p in given):
        raise SignalError("orders", found=repr(orders), expected=expected)
    listed = [int(p) for p in given]
    if max(listed) > MOST:
        raise SignalError("orders", found=f"order {max(listed)}", expected=f"orders up to {MOST}")
    if not isinstance(orders, range):
        if len(listed) != 2:
            raise SignalError("orders", found=repr(orders), expected=expected)
        listed = list(range(listed[0], listed[1] + 1, step))
    if not listed or listed[0] < 1 or any(b <= a for a, b in pairwise(listed)):
        raise SignalError("orders", found=repr(orders), expected=expected)
    return listed


def checked_band(band_hz: tuple[float, float] | None) -> tuple[float, float] | None:
    """A band of frequencies, low before high.

    Raises:
        SignalError: not two numbers, 0 ≤ low < high.
    """
    if band_hz is None:
        return None
    try:
        low, high = (float(edge) for edge in band_hz)
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not 0 <= low < high:
        raise SignalError("band_hz", found=repr(band_hz), expected="(low, high) in Hz with 0 <= low < high")
    return low, high


def blas_on_one_thread() -> AbstractContextManager[object]:
    """NumPy and SciPy on one thread while it lasts.

    The factorizations here are many and narrow: on busy cores the threads of a BLAS spend tens of times the work itself
    in waiting for each other, and on idle ones they gain little.
    """
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(limits=1, user_api="blas")
    return limits
