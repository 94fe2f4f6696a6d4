"""Harmonics of a running spindle told from modes: by its speed, or by how the response is distributed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armonic.errors import SignalError
from armonic.series import TimeSeries

Array = NDArray[np.float64]

SINE, GAUSSIAN = 1.5, 3.0
"""Kurtosis of a sine, and of a mode that noise drives."""
LIMIT = (SINE + GAUSSIAN) / 2
"""Below it a response counts as a sine."""
CYCLES = 100.0
"""Width of the band times length of the record: so many independent amplitudes make the kurtosis certain enough."""
WIDTH = 0.05
"""Width of the band about a frequency, as a share of it."""
ORDERS = 20
DAMPED = 0.005


@dataclass(frozen=True)
class Flag:
    """What one frequency is taken for.

    Attributes:
        freq_hz: the frequency.
        is_harmonic: whether it is a harmonic of a machine that turns, rather than a mode.
        reason: why, in words.
        kurtosis: of the response in a band about it: 1.5 for a sine, 3 for a mode that noise drives; NaN where the
            record is too short for that.
        order: its multiple of the spindle's speed, where it was told by that; else None.
    """

    freq_hz: float
    is_harmonic: bool
    reason: str
    kurtosis: float
    order: int | None = None


def flags(
    series: TimeSeries,
    freq_hz: ArrayLike,
    spindle_hz: float | None = None,
    *,
    damping_ratio: ArrayLike | None = None,
    tolerance: float = 0.01,
    width_hz: float | None = None,
) -> tuple[Flag, ...]:
    """Which of some frequencies are harmonics of a machine that turns while the response is measured.

    With the spindle's speed known, those near one of its first 20 multiples are, unless their damping is known and
    over 0.5 %: a sine has none. Without it, the response is band-passed about each frequency: one whose values are
    distributed like those of a sine (kurtosis 1.5) rather than normally (3) is a harmonic, after N.-J. Jacobsen,
    P. Andersen and R. Brincker, "Eliminating the influence of harmonic components in operational modal analysis",
    IMAC XXV, 2007. That needs a response to lasting random excitation, of which the sine makes at least 70 % of the
    energy in the band, and a record of length T with π ζ f T well over 60 where a mode of damping ζ is to pass.

    Args:
        series: the response, with finite values; of each frequency the channel counts that shows it best.
        freq_hz: (k,) frequencies in question, in Hz.
        spindle_hz: turns per second.
        damping_ratio: (k,) fractions, if known.
        tolerance: the share by which a frequency may miss a multiple.
        width_hz: of the band; by default 5 % of the frequency, and at least 100 divided by the record's length.

    Returns:
        One flag per frequency, in their order.

    Raises:
        SignalError: a frequency is not between zero and the Nyquist frequency, or another argument does not fit.
    """
    asked = np.atleast_1d(np.asarray(freq_hz, np.float64))
    nyquist = series.sample_rate_hz / 2
    if asked.ndim != 1 or not ((asked > 0) & (asked < nyquist)).all():
        wrong = asked[~((asked > 0) & (asked < nyquist))].ravel()
        found = f"{wrong[0]:g} Hz" if wrong.size else f"shape {asked.shape}"
        raise SignalError("freq_hz", found=found, expected=f"frequencies between 0 and {nyquist:g} Hz")
    for where, value in (("spindle_hz", spindle_hz), ("tolerance", tolerance), ("width_hz", width_hz)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise SignalError(where, found=repr(value), expected="a positive number")
    damping = None if damping_ratio is None else np.atleast_1d(np.asarray(damping_ratio, np.float64))
    if damping is not None and damping.shape != asked.shape:
        found = f"shape {damping.shape}"
        raise SignalError("damping_ratio", found=found, expected=f"shape {asked.shape}, one per frequency")
    spectrum = np.fft.rfft(series.finite() - series.values.mean(axis=0), axis=0)
    found_flags = []
    for k, f in enumerate(asked):
        kurtosis = _kurtosis(series, spectrum, float(f), width_hz)
        if spindle_hz is None:
            found_flags.append(_by_distribution(float(f), kurtosis))
        else:
            known = None if damping is None else float(damping[k])
            found_flags.append(_by_speed(float(f), kurtosis, spindle_hz, known, tolerance))
    return tuple(found_flags)


def _by_speed(f: float, kurtosis: float, spindle_hz: float, damping: float | None, tolerance: float) -> Flag:
    order = round(f / spindle_hz)
    off = abs(f - order * spindle_hz)
    if not 1 <= order <= ORDERS or off > tolerance * f:
        return Flag(f, False, f"no multiple of {spindle_hz:g} Hz up to {ORDERS} is near", kurtosis)
    near = f"{off:.2g} Hz from {order} x {spindle_hz:g} Hz"
    if damping is not None and abs(damping) > DAMPED:
        return Flag(f, False, f"{near}, but damped by {100 * damping:.2g} %", kurtosis, order)
    return Flag(f, True, near, kurtosis, order)


def _by_distribution(f: float, kurtosis: float) -> Flag:
    if np.isnan(kurtosis):
        return Flag(f, False, "the record is too short to tell", kurtosis)
    if kurtosis < LIMIT:
        return Flag(f, True, f"distributed like a sine: kurtosis {kurtosis:.2f}, of a sine {SINE}", kurtosis)
    return Flag(f, False, f"distributed like noise: kurtosis {kurtosis:.2f}, of noise {GAUSSIAN:g}", kurtosis)


def _kurtosis(series: TimeSeries, spectrum: NDArray[np.complex128], f: float, width_hz: float | None) -> float:
    """Kurtosis of the channel that shows a frequency best, in a band about it; NaN if the record is too short."""
    length_s = len(series) / series.sample_rate_hz
    width = max(WIDTH * f, CYCLES / length_s) if width_hz is None else width_hz
    # A band as wide as the frequency itself would hold its neighbours too.
    if width * length_s < CYCLES * (1 - 1e-9) or width > f:
        return float("nan")
    lines = np.fft.rfftfreq(len(series), 1 / series.sample_rate_hz)
    inside = np.abs(lines - f) <= width / 2
    energy = (np.abs(spectrum) ** 2).sum(axis=0)
    share = (np.abs(spectrum[inside]) ** 2).sum(axis=0) / np.where(energy > 0, energy, 1.0)
    best = int(np.argmax(share))
    part = np.fft.irfft(np.where(inside, spectrum[:, best], 0), len(series))
    ends = int(2 / width * series.sample_rate_hz)  # a band without slopes rings for so long after either end
    part = part[ends:-ends]
    part = part - part.mean()
    variance = float((part**2).mean())
    return float((part**4).mean()) / variance**2 if variance > 0 else float("nan")
