"""What speaks against trusting a fit: signs in the residual that its intervals do not know of."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.signal import find_peaks

from armonic.updating.uncertainty import WEAK_FACTOR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.response import Frf
    from armonic.updating.measurement import Measurement
    from armonic.updating.uncertainty import FittedParameter

    Array: TypeAlias = NDArray[np.float64]

MISFIT = 0.25
"""A model that differs by this share from the strongest third of the measured values does not explain them."""
FLOOR_RATIO = 5.0
"""The weakest third of the values deviates so many times more than the strongest: that is a noise floor."""
FEWEST = 10
"""Fewer values than this in a third say nothing about the noise."""
RESONANCE_DB = 6.0
"""A response whose highest maximum stands out less than this from what surrounds it has no resonance in the band."""
SYSTEMATIC = 5.0
"""A residual so many times the data's own scatter is systematic."""
NOISELESS = 1e-6
"""Below this there is nothing but rounding."""


def _rms(deviations: Array) -> float:
    """Of one real part."""
    return float(np.sqrt(np.mean(deviations**2) / 2))


def doubts(
    measurements: Sequence[Measurement],
    models: Sequence[Frf],
    weights: Sequence[Array],
    noise: float,
    factors: Sequence[Array] | None = None,
) -> tuple[tuple[str, ...], bool]:
    """What to doubt, in full sentences, and whether the model explains the data at all.

    There is nothing to doubt where the residual looks as the intervals assume.

    Args:
        measurements: what was fitted.
        models: the fitted model's responses, one per measurement.
        weights: weight of every value; those of zero are left out.
        noise: standard deviation of one real part of the log residual.
        factors: of a robust loss, by which the squares of values that are far off count less; likewise.
    """
    size, deviation, known = [], [], []
    trusts = factors or [np.ones_like(weight) for weight in weights]
    for m, model, weight, trust in zip(measurements, models, weights, trusts, strict=True):
        used = (weight > 0) & (model.values != 0)
        ratio = m.frf.values[used] / model.values[used]
        size.append(np.abs(m.frf.values[used]))
        known.append(np.sqrt(m.precision()[used]) if m.coherence is not None else np.ones(int(used.sum())))
        deviation.append(np.sqrt(trust[used]) * np.abs(np.log(np.abs(ratio)) + 1j * np.angle(ratio)))
    order = np.argsort(np.concatenate(size))
    spread = np.concatenate(deviation)[order]
    third = max(len(spread) // 3, 1)
    strong = _rms(spread[-third:])
    if strong > MISFIT:
        return (
            f"The model does not explain these data: where they are strong they differ by about {100 * strong:.0f} %, "
            "and verdicts and intervals mean little. Check posture, frame, axes, kind and units of the measurement, "
            "and the start.",
        ), False
    # Of values whose coherence is known deviations count in units of what it lets expect.
    spread = spread * np.concatenate(known)[order]
    weak, strong = _rms(spread[:third]), _rms(spread[-third:])
    if third < FEWEST or noise < NOISELESS or weak <= FLOOR_RATIO * strong:
        return (), True
    return (
        f"Weak responses deviate {weak / strong:.0f} times more than strong ones, as under a constant noise floor. "
        "The intervals assume noise in proportion and are too narrow here: leave out what the floor hides, by weights "
        "or by a band.",
    ), True


def without_resonance(measurements: Sequence[Measurement], weights: Sequence[Array]) -> tuple[str, ...]:
    """A doubt for each measurement whose band holds no resonance: it then speaks of stiffness and mass together only.

    Args:
        measurements: what was fitted.
        weights: weight of every value; those of zero are left out.
    """
    said = []
    for m, weight in zip(measurements, weights, strict=True):
        used = (weight > 0).any(axis=(1, 2))
        level = 20 * np.log10(np.maximum(np.abs(m.frf.values[used]), np.finfo(float).tiny))
        level = level.reshape(len(level), -1)
        if len(level) < FEWEST or any(find_peaks(column, prominence=RESONANCE_DB)[0].size for column in level.T):
            continue
        f = m.frf.freq_hz[used]
        said.append(
            f"No response of {m.label} has a resonance between {f[0]:g} and {f[-1]:g} Hz: dampings and most "
            "stiffnesses leave no trace there. Use a band that holds resonances."
        )
    return tuple(said)


def nothing_identified(parameters: Sequence[FittedParameter], noise: float, freedom: int) -> tuple[str, ...]:
    """A doubt where no parameter is known to better than a factor, be it at a bound or not.

    Args:
        parameters: what was fitted.
        noise: standard deviation of one real part of the log residual.
        freedom: degrees of freedom behind it.
    """
    if any(p.verdict in ("identified", "weak") for p in parameters):
        return ()
    if freedom < 1:
        return (
            "Nothing is identified: there are as many parameters as numbers, and no residual is left to tell the noise "
            "from. Use more lines, hold some parameters, or give priors.",
        )
    if any(p.deviation < np.log(WEAK_FACTOR) / 2 for p in parameters):
        return ()
    return (
        f"Nothing is identified: with a noise of {100 * noise:.2g} % these data narrow no parameter down. Use more or "
        "cleaner lines, hold some parameters, or give priors.",
    )


def scatter(measurements: Sequence[Measurement], weights: Sequence[Array]) -> float:
    """Relative noise that the data show by themselves, without any model: how far lines lie beside their neighbours.

    ln H_(k−1) − 2 ln H_k + ln H_(k+1) has √6 times the deviation of one part; the median passes over the peaks, where
    the response itself bends. On coarse lines what bends everywhere adds to it.

    Args:
        measurements: what was fitted.
        weights: weight of every value; those of zero are left out.
    """
    found = []
    for m, weight in zip(measurements, weights, strict=True):
        H = np.where((weight > 0) & (m.frf.values != 0), m.frf.values, np.nan)
        if len(H) < 3:
            continue
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            bend = np.log(H[:-2] / H[1:-1] * (H[2:] / H[1:-1]))
        found += [part[np.isfinite(part)] for part in (bend.real, bend.imag)]
    sizes = np.abs(np.concatenate(found)) if found else np.zeros(0)
    return float(np.median(sizes) / (0.6745 * np.sqrt(6))) if sizes.size else np.inf


def beyond_scatter(measurements: Sequence[Measurement], weights: Sequence[Array], noise: float) -> tuple[str, ...]:
    """A doubt where the residual is many times what the data scatter by themselves: then it is no noise."""
    own = scatter(measurements, weights)
    if not noise > SYSTEMATIC * own:
        return ()
    return (
        f"Model and measurement differ by {100 * noise:.2g} %, {noise / own:.0f} times what lines scatter beside their "
        "neighbours: that is no noise but a model too simple, a local minimum, or responses that no linear reciprocal "
        "robot has. The intervals do not know of it. Try more starts, laws, other parameters or symmetrized responses.",
    )
