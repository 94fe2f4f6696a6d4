"""A time series made ready for identification: offsets off, a band, fewer samples, the free decay alone."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from armonic.errors import SignalError
from armonic.series import TimeSeries

Array = NDArray[np.float64]

TAIL = 0.05
"""Share of the samples, the last ones, that count as rest after a decay."""
_PASSED = 0.8
"""Share of the new Nyquist frequency up to which decimation keeps amplitudes."""
_ATTENUATION_DB = 80.0


def detrend(series: TimeSeries, how: Literal["mean", "linear", "rest"] = "mean", *, tail: float = TAIL) -> TimeSeries:
    """The series without its offset, per channel.

    "mean" and "linear" suit a response to lasting excitation. Of a free decay they take a part of the decay itself
    for offset, which biases what is identified; "rest" takes off where the decay ends. A method that fits a constant,
    or an autoregression with a pole to spare at zero frequency, carries the offset by itself and needs none of them.

    Args:
        series: with finite values.
        how: what to take off: the mean, the straight line of least squares, or the mean of the last samples.
        tail: for "rest", the share of the samples that are the last ones, over 0 to 1.

    Raises:
        SignalError: `how` or `tail` is none of those, or a value is not finite.
    """
    values = series.finite()
    if how == "mean":
        return series.with_values(values - values.mean(axis=0))
    if how == "rest":
        return series.with_values(values - _rest(values, tail))
    if how != "linear":
        raise SignalError("how", found=repr(how), expected="mean, linear or rest")
    ramp = np.linspace(-1.0, 1.0, len(series)) if len(series) > 1 else np.zeros(1)
    slope = ramp @ values / max(float(ramp @ ramp), 1.0)  # the ramp has no mean, so that mean and slope separate
    return series.with_values(values - values.mean(axis=0) - np.outer(ramp, slope))


def decimate(series: TimeSeries, factor: int) -> TimeSeries:
    """Every so many samples one, after a low-pass filter without phase.

    The filter (a Kaiser window of 80 dB, 50 · factor taps) keeps amplitudes to 0.1 ‰ up to 0.8 of the new Nyquist
    frequency, and lets no more than that share from above it through. At either end it sees the series continued by
    point reflection, so that the first and last 25 samples that are kept are less true than the rest.

    Args:
        series: with finite values, of at least 25 · factor + 1 samples.
        factor: how many samples become one, from the first on.

    Raises:
        SignalError: the factor is no positive whole number, the series is too short, or a value is not finite.
    """
    from scipy import signal

    if not (isinstance(factor, int) and factor >= 1):
        raise SignalError("factor", found=repr(factor), expected="a whole number of at least 1")
    values = series.finite()
    if factor == 1:
        return series
    taps, beta = signal.kaiserord(_ATTENUATION_DB, (1 - _PASSED) / factor)
    half = taps // 2
    if len(series) <= half:
        found = f"{len(series)} samples"
        raise SignalError("series", found=found, expected=f"more than {half}, half the length of the filter")
    middle = (1 + _PASSED) / 2 / factor
    kernel: Any = signal.firwin(2 * half + 1, middle, window=("kaiser", beta))
    longer = np.pad(values, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    filtered = np.asarray(signal.upfirdn(kernel, longer, down=1, axis=0))[2 * half : 2 * half + len(series)]
    return series.with_values(filtered[::factor], sample_rate_hz=series.sample_rate_hz / factor)


def band(series: TimeSeries, low_hz: float | None, high_hz: float | None, *, order: int = 4) -> TimeSeries:
    """The part of the series between two frequencies, without phase.

    A Butterworth filter runs forwards and backwards, so that its amplitude acts twice: one half at `low_hz` and
    `high_hz`. It rings at both ends of the series, and shifts damping of modes near its edges.

    Args:
        series: with finite values.
        low_hz: lower edge; None or 0 keeps everything below.
        high_hz: upper edge, below the Nyquist frequency; None keeps everything above.
        order: of the filter per edge and run, 1 to 10.

    Raises:
        SignalError: the edges make no band below the Nyquist frequency, the series is too short, or a value is not
            finite.
    """
    from scipy import signal

    values, nyquist = series.finite(), series.sample_rate_hz / 2
    low, high = low_hz or 0.0, nyquist if high_hz is None else high_hz
    if not 0 <= low < high <= nyquist or (high_hz is not None and high == nyquist):
        expected = f"0 <= low < high < {nyquist:g} Hz, the Nyquist frequency"
        raise SignalError("band", found=f"{low_hz} to {high_hz} Hz", expected=expected)
    if not (isinstance(order, int) and 1 <= order <= 10):
        raise SignalError("order", found=repr(order), expected="a whole number from 1 to 10")
    if low == 0 and high_hz is None:
        return series
    edges, kind = ((low, high), "bandpass") if low and high_hz else (low, "highpass") if low else (high, "lowpass")
    sos: Any = signal.butter(order, edges, kind, fs=series.sample_rate_hz, output="sos")  # type: ignore[call-overload]
    padding = 3 * (2 * len(sos) + 1)
    if len(series) <= padding:
        raise SignalError("series", found=f"{len(series)} samples", expected=f"more than {padding} for this filter")
    return series.with_values(signal.sosfiltfilt(sos, values, axis=0))


def free_decay(
    series: TimeSeries, after: float | Literal["auto"] = "auto", *, quiet: float = 0.0, tail: float = TAIL
) -> TimeSeries:
    """The window in which the structure is left to itself.

    "auto" starts with the first sample after the last on which a force acts, where the series has a force that is
    not zero throughout. Without one it starts where the response is greatest: at the largest sum over the channels
    of (distance from rest)² / (its mean), where rest is the mean of the last samples; before that something drives it.

    Args:
        series: with finite values.
        after: the time in s from which it is free, or "auto".
        quiet: a force of at most this share of its peak counts as none; a measured force is never exactly zero.
        tail: the share of the samples, the last ones, that are rest.

    Raises:
        SignalError: the force lasts to the end, there is no sample after the time, or a value is not finite.
    """
    if not isinstance(after, str):
        return series.window(after)
    if after != "auto":
        raise SignalError("after", found=repr(after), expected="auto, or a time in s")
    if not 0 <= quiet < 1:
        raise SignalError("quiet", found=repr(quiet), expected="a share from 0 to below 1")
    values = series.finite()
    forces = [k for k, channel in enumerate(series.channels) if channel.quantity == "force"]
    peaks = np.abs(values[:, forces]).max(axis=0, initial=0.0)
    if peaks.any():
        acting = (np.abs(values[:, forces]) > quiet * peaks).any(axis=1)
        first = int(np.flatnonzero(acting)[-1]) + 1
        if first == len(series):
            raise SignalError(
                "series",
                found="a force that acts to the last sample",
                expected="a force that ends",
                hint="Say with quiet= how small a force is none, or with after= when it ends.",
            )
    else:
        away = (values - _rest(values, tail)) ** 2
        mean = away.mean(axis=0)
        first = int(np.argmax((away / np.where(mean > 0, mean, 1.0)).sum(axis=1)))
    return series.with_values(values[first:], start_s=series.start_s + first / series.sample_rate_hz)


def _rest(values: Array, tail: float) -> Array:
    if not 0 < tail <= 1:
        raise SignalError("tail", found=repr(tail), expected="a share over 0 to 1")
    return np.asarray(values[-math.ceil(tail * len(values)) :].mean(axis=0))
