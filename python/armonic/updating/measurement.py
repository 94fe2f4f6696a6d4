"""What was measured, at which posture and frame, and how much each line counts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from scipy.signal import find_peaks

from armonic.errors import UpdateError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.response import Frf

    Array: TypeAlias = NDArray[np.float64]

Loss = Literal["squares", "huber", "cauchy"]

BEST_COHERENCE = 0.9999
"""A coherence above this is taken for this: no value is known without error."""
PEAK_GAIN = 80.0
"""Weight of a line at a peak, and of its neighbours (Huynh et al. 2021, section 5)."""
BASE_GAIN = 0.5
"""Weight of every other line."""
PEAK_HALF_WIDTH = 2
"""Neighbours on either side that share a peak's weight."""
PEAK_PROMINENCE_DB = 3.0
"""A maximum that stands out less from what surrounds it is taken for noise."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measured frequency response matrix and where it was taken.

    Args:
        frf: the measured responses; any subset of the nine of a sensor frame. Where it names an `input_frame`, the
            force acted there.
        posture: name of the robot's posture, or joint coordinates (rad, m).
        frame: the sensor's frame on the robot; that of the FRF if it knows one.
        weights: "peaks" for the paper's automatic weights, "uniform" for one everywhere, or numbers of zero or more per
            line (L,), per response (1, outputs, inputs) or per value (L, outputs, inputs). A line of weight zero is
            left out.
        label: a name for tables and figures.
        coherence: γ² of every value, (L,) or (L, outputs, inputs), from 0 to 1. Relative errors go by (1 − γ²)/γ²
            (Bendat and Piersol), so weights are divided by that; values of coherence zero are left out.
        mask: which values to use, of booleans, (L,) or (L, outputs, inputs).
        band: (low, high) in Hz; other lines are left out, but stay in figures.
        raw: where `frf` was synthesized from identified modes, the responses as they were measured, of the same kind
            and axes, on lines of their own; figures show them beside (Huynh et al. 2021, Fig. 10).

    Raises:
        UpdateError: no frame, weights, coherence, mask or raw responses that do not fit, or a zero where a logarithm is
            taken.
    """

    frf: Frf
    posture: Posture
    frame: str = ""
    weights: ArrayLike | Literal["peaks", "uniform"] = field(default="peaks", repr=False)
    label: str = ""
    coherence: ArrayLike | None = field(default=None, repr=False)
    mask: ArrayLike | None = field(default=None, repr=False)
    band: Sequence[float] | None = None
    raw: Frf | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        frame = self.frame or self.frf.frame or ""
        label = self.label or f"{self.posture if isinstance(self.posture, str) else 'posture'}, {frame}"
        if not frame:
            raise UpdateError("Measurement.frame", found="nothing", expected="the robot frame the sensor sits on")
        object.__setattr__(self, "frame", frame)
        object.__setattr__(self, "label", label)
        H, raw = self.frf, self.raw
        if raw is not None and (raw.kind, raw.outputs, raw.inputs) != (H.kind, H.outputs, H.inputs):
            raise UpdateError(f"{label}: raw", found=repr(raw), expected=f"kind and axes of {H!r}")
        self.line_weights()

    def line_weights(self) -> Array:
        """The weight of every value, (L, outputs, inputs).

        A line at 0 Hz gets none where the response vanishes there (mobility, accelerance): it says nothing.
        """
        H = self.frf
        if isinstance(self.weights, str):
            if self.weights not in ("peaks", "uniform"):
                raise UpdateError(
                    f"{self.label}: weights", found=repr(self.weights), expected='"peaks", "uniform" or numbers'
                )
            weights = peak_weights(H) if self.weights == "peaks" else np.ones(H.values.shape)
        else:
            weights = self._given_weights()
        if H.freq_hz[0] == 0 and H.kind != "receptance":
            weights[0] = 0.0
        weights *= self.precision()
        zero = (H.values == 0) & (weights > 0)
        if zero.any():
            line, a, b = (int(i[0]) for i in np.nonzero(zero))
            raise UpdateError(
                f"{self.label}: H_{H.outputs[a]}{H.inputs[b]} at {H.freq_hz[line]:g} Hz",
                found="a response of exactly zero",
                expected="values other than zero, since their logarithms are fitted",
                hint="Give that line the weight zero, or leave that response out with frf.select(...).",
            )
        if not (weights > 0).any():
            raise UpdateError(
                f"{self.label}: weights", found="zero everywhere", expected="at least one positive weight"
            )
        return weights

    def precision(self) -> Array:
        """Relative inverse variance of every value, (L, outputs, inputs): one at the median coherence, zero if unused.

        Without coherence, one wherever mask and band let values pass.
        """
        shape = self.frf.values.shape
        used = np.ones(shape)
        if self.mask is not None:
            used *= self._per_value("mask", self.mask, boolean=True)
            self._refuse_empty("mask", used, "false everywhere", "true for at least one value")
        if self.band is not None:
            try:
                low, high = (float(edge) for edge in self.band)
            except (TypeError, ValueError):
                low, high = np.nan, np.nan
            if not low < high:
                raise UpdateError(f"{self.label}: band", found=repr(self.band), expected="(low, high) in Hz")
            f = self.frf.freq_hz
            used *= ((f >= low) & (f <= high))[:, None, None]
            self._refuse_empty("band", used, f"no value from {low:g} to {high:g} Hz", "at least one")
        if self.coherence is not None:
            coherence = self._per_value("coherence", self.coherence)
            if not ((coherence >= 0) & (coherence <= 1)).all():
                raise UpdateError(f"{self.label}: coherence", found="a value out of range", expected="γ² from 0 to 1")
            coherence = np.minimum(coherence, BEST_COHERENCE)
            precision = coherence / (1 - coherence)
            self._refuse_empty("coherence", used * precision, "zero everywhere", "at least one above zero")
            used *= precision / np.median(precision[used * precision > 0])
        return used

    def _refuse_empty(self, name: str, used: Array, found: str, expected: str) -> None:
        if not used.any():
            raise UpdateError(f"{self.label}: {name}", found=found, expected=expected)

    def _per_value(self, name: str, given: ArrayLike, *, boolean: bool = False) -> Array:
        """Numbers per line or per value as one array, (L, outputs, inputs)."""
        shape = self.frf.values.shape
        try:
            array = np.asarray(given)
            fits = array.dtype == bool if boolean else np.isrealobj(array)
            values = array.astype(np.float64) if fits else np.zeros(0)
        except (TypeError, ValueError):
            fits, values = False, np.zeros(0)
        if not fits:
            wanted = "booleans, true for values to use" if boolean else "numbers"
            raise UpdateError(
                f"{self.label}: {name}", found=f"a {type(given).__name__} of something else", expected=wanted
            )
        if values.shape == shape[:1]:
            values = values[:, None, None]
        if values.ndim != 3 or any(n not in (1, wanted) for n, wanted in zip(values.shape, shape, strict=True)):
            raise UpdateError(
                f"{self.label}: {name}", found=f"shape {values.shape}", expected=f"shape {shape[:1]} or {shape}"
            )
        return np.array(np.broadcast_to(values, shape))

    def _given_weights(self) -> Array:
        shape = self.frf.values.shape
        try:
            weights = np.array(self.weights, dtype=np.float64) if np.isrealobj(self.weights) else None
        except (TypeError, ValueError):
            weights = None
        if weights is None:
            raise UpdateError(
                f"{self.label}: weights",
                found=f"a {type(self.weights).__name__} of something else",
                expected='"peaks", "uniform" or numbers',
            )
        if weights.shape == shape[:1]:
            weights = np.broadcast_to(weights[:, None, None], shape)
        elif weights.shape == (1, *shape[1:]):
            weights = np.broadcast_to(weights, shape)
        if weights.shape != shape:
            raise UpdateError(
                f"{self.label}: weights", found=f"shape {weights.shape}", expected=f"shape {shape[:1]} or {shape}"
            )
        if not (np.isfinite(weights).all() and (weights >= 0).all()):
            raise UpdateError(
                f"{self.label}: weights", found="a negative or non-finite number", expected="numbers of zero or more"
            )
        return weights.copy()


def levelled(weights: Array) -> Array:
    """Weights without emphasis, (L, outputs, inputs): no value counts more than the lower quartile of those that count.

    Peak weights become equal ones; lines that were given a low weight, because they are known to be bad, keep it.
    """
    return np.minimum(weights, np.quantile(weights[weights > 0], 0.25, method="lower"))


def peak_weights(
    frf: Frf,
    *,
    peak_gain: float = PEAK_GAIN,
    base_gain: float = BASE_GAIN,
    half_width: int = PEAK_HALF_WIDTH,
    prominence_db: float = PEAK_PROMINENCE_DB,
) -> Array:
    """The paper's automatic weights: high at the peaks of each response and ±2 lines around, low elsewhere.

    Huynh et al. 2021, section 4 (gain 50) and section 5 (gain 80), Fig. 4. Peaks are sought in the accelerance, where
    the higher ones show.

    Args:
        frf: the measured responses, any kind.
        peak_gain: weight at and around peaks.
        base_gain: weight elsewhere.
        half_width: lines on either side of a peak.
        prominence_db: how far a peak stands out, dB; less is noise.

    Returns:
        W, (L, outputs, inputs).
    """
    size = np.abs(frf.values) * frf.freq_hz[:, None, None] ** ({"receptance": 2, "mobility": 1}.get(frf.kind, 0))
    weights = np.full(size.shape, base_gain)
    level = 20 * np.log10(np.maximum(size, np.finfo(float).tiny))
    for a in range(size.shape[1]):
        for b in range(size.shape[2]):
            for peak in find_peaks(level[:, a, b], prominence=prominence_db)[0]:
                weights[max(0, peak - half_width) : peak + half_width + 1, a, b] = peak_gain
    return weights
