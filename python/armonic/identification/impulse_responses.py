"""Impulse responses of a band: the inverse Fourier transform of frequency responses at evenly spaced lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.identification.matrix_fraction import LOWER_GAP, Circle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.references import Referenced

    Array: TypeAlias = NDArray[np.float64]

UNEVEN = 0.01
"""Lines may lie off an even grid by this share of their spacing, as those of a file with few digits do."""
SKIPPED = 2
"""Samples that are no free motion: the force itself, and one to which the taper spreads it."""


@dataclass(frozen=True, eq=False)
class ImpulseResponses:
    """Sampled responses to an impulse, sums of the motions of all modes in the band.

    Attributes:
        samples: (N, rows, m), the first half of the period, without the first `SKIPPED`.
        circle: which z in Σ c z^k belongs to a pole.
    """

    samples: Array
    circle: Circle


def impulse_responses(laid: Referenced) -> ImpulseResponses:
    """Impulse responses, sampled at twice the highest frequency.

    The lines are tapered by cos²(θ/2) over their angles θ from 0 to π, which is the mean [¼ ½ ¼] of neighbouring
    samples and leaves exponentials what they are, but takes the step at the highest line away. What else is cut off
    below and above the band rings about t = 0, before it at the end of the period: the second half is not used. The
    period itself does no harm, since an exponential added to its own tails is one.

    Missing lines below the band are zero. If the band begins farther up, only so many are put there as `LOWER_GAP` asks
    for, and the circle tells by how much frequencies are shifted.

    Args:
        laid: the responses.

    Raises:
        FrfError: the lines are not evenly spaced.
    """
    f = laid.freq_hz
    lines, count = f - f[0], len(f)
    spacing = float(lines[-1] / (count - 1))
    if np.abs(lines - spacing * np.arange(count)).max() > UNEVEN * spacing:
        steps = np.diff(f)
        raise FrfError(
            "FrfSet.freq_hz",
            found=f"lines {steps.min():g} to {steps.max():g} Hz apart",
            expected="evenly spaced lines, for impulse responses",
            hint="Take a band where they are, or pLSCF, which asks for no spacing.",
        )
    below = min(round(float(f[0]) / spacing), int(np.ceil(count * LOWER_GAP / (1 - LOWER_GAP))))
    last = below + count - 1
    spectrum = np.zeros((last + 1, *laid.values.shape[1:]), np.complex128)
    taper = np.cos(np.pi / 2 * np.arange(below, last + 1) / last) ** 2
    np.multiply(laid.values, taper[:, None, None], out=spectrum[below:])
    samples = np.fft.irfft(spectrum, axis=0)[SKIPPED:last]
    slope = 1 / (2 * last * spacing)
    return ImpulseResponses(samples, Circle(np.pi * below / last - slope * 2 * np.pi * float(f[0]), slope))
