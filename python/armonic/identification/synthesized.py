"""What a fit takes from identified modes: the matrix of one sensor, reciprocal and clean, and how far it is known."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.ema import EmaResult
    from armonic.identification.modal_model import Side
    from armonic.response import Frf

    Array: TypeAlias = NDArray[np.float64]

DIRECTION_RAD = 0.02
"""How well the directions of a hammer in a hand and of a sensor are known."""


class Synthesized(NamedTuple):
    """Responses made of modes, as `armonic.Measurement` takes them.

    Attributes:
        frf: the matrix, reciprocal, without noise and window.
        coherence: what it deserves, (L, outputs, inputs).
        raw: the matrix as it was measured.
    """

    frf: Frf
    coherence: Array
    raw: Frf


def synthesized_matrix(
    result: EmaResult, place: str | None = None, *, symmetric: Side = "average", direction_rad: float = DIRECTION_RAD
) -> Synthesized:
    """The matrix of one sensor made of the modes of an analysis (Huynh et al. 2021, section 5.3).

    A synthesized value is no better known than the measured one. Beside the noise that the measured coherence tells,
    three things count: how far two cross responses differ that reciprocity makes equal; what a hammer a little askew
    adds of the responses to the other axes; and likewise the sensor. They are systematic, so that no averaging shows
    them, and they rule weak responses beside strong ones. All of it is given as one coherence, γ² = |H|² / (|H|² + σ²).

    Args:
        result: what `armonic.ema` returned.
        place: of the sensor, driven there as well; by default the only one.
        symmetric: "average" of two cross responses, or the "upper" or "lower" triangle mirrored.
        direction_rad: standard deviation of the directions of hammer and sensor.

    Raises:
        FrfError: no such place, or a response of it was not measured.
    """
    frf, _ = result.synthesized(symmetric=symmetric).matrix(place)
    crossed, _ = result.synthesized().matrix(place)
    raw, coherence = result.frfs.matrix(place, as_measured=True)
    size = np.abs(frf.values) ** 2
    variance = direction_rad**2 * (size.sum(axis=2, keepdims=True) + size.sum(axis=1, keepdims=True) - 2 * size)
    if coherence is not None:
        variance = variance + size * (1 - coherence) / np.maximum(coherence, np.finfo(float).tiny)
    for a, output in enumerate(frf.outputs):
        for b, force in enumerate(frf.inputs):
            if output in frf.inputs and force in frf.outputs:
                mirror = crossed.values[:, frf.outputs.index(force), frf.inputs.index(output)]
                variance[:, a, b] += np.abs(crossed.values[:, a, b] - mirror) ** 2 / 4
    return Synthesized(frf, size / np.maximum(size + variance, np.finfo(float).tiny), raw)
