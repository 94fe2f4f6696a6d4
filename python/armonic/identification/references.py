"""Frequency responses laid out for a method with references: responses by rows, references by columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import FrfError, SignalError
from armonic.identification.samples import checked_band

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

References: TypeAlias = Literal["inputs", "outputs", "none"]
LEAST_LINES = 4
"""Fewer lines hold no mode and nothing to tell it from noise."""


@dataclass(frozen=True, eq=False)
class Referenced:
    """Responses of one band, by rows, to references, by columns.

    Attributes:
        freq_hz: lines, (L,).
        values: (L, rows, m), every row of unit RMS over lines and references.
        scale: what each row was divided by, (rows,).
        weights: of each row at each line, (L, rows), at most one; None where all count alike.
        decay_rate: of the exponential window, 1/s.
        band_hz: where shapes are asked for.
    """

    freq_hz: Array
    values: Complex
    scale: Array
    weights: Array | None
    decay_rate: float
    band_hz: tuple[float, float]


def referenced(
    frfs: FrfSet,
    references: References | None,
    band_hz: tuple[float, float] | None,
    weights: ArrayLike | None = None,
) -> Referenced:
    """A set laid out by references; poles are the same whichever side they are.

    Args:
        frfs: the responses.
        references: "inputs" or "outputs"; "none" for every measured pair as a row of its own, which have one
            denominator in common. The smaller side if not given, or "none" where not every pair was measured.
        band_hz: lines that are used, ends included; all if not given.
        weights: of the values, (L, outputs, inputs) of the whole set or what broadcasts to it, of any scale. All
            references of a row and line share one, their RMS. Without weights the rows count alike.

    Raises:
        SignalError: a side or band that is none.
        FrfError: too few lines, a pair missing that a side asks for, weights that do not fit, or responses that are
            zero throughout.
    """
    band = checked_band(band_hz)
    part = frfs if band is None else frfs.band(*band)
    if len(part.freq_hz) < LEAST_LINES:
        found = f"{len(part.freq_hz)} lines from {part.freq_hz[0]:g} to {part.freq_hz[-1]:g} Hz"
        raise FrfError("FrfSet.freq_hz", found=found, expected=f"at least {LEAST_LINES} lines in the band")
    side = _side(frfs, references)
    values, weight = part.values, _checked_weights(frfs, part, weights)
    if side == "none":
        values = values[:, frfs.measured][:, :, None]
        weight = None if weight is None else weight[:, frfs.measured][:, :, None]
    elif side == "outputs":
        values = values.transpose(0, 2, 1)
        weight = None if weight is None else weight.transpose(0, 2, 1)
    values = values[:, :, np.abs(values).max(axis=(0, 1)) > 0]
    if not values.size:
        raise FrfError("FrfSet.values", found="zero at all lines in the band", expected="responses")
    # By the largest first, so that no square overflows.
    scale = np.abs(values).max(axis=(0, 2))
    scale[scale == 0] = 1.0
    values = values / scale[:, None]
    size = np.sqrt((values.real**2 + values.imag**2).mean(axis=(0, 2)))
    size[size == 0] = 1.0
    if weight is not None:
        weight = np.sqrt((weight**2).mean(axis=2)) * scale * size
        weight = weight / weight.max()
    return Referenced(
        freq_hz=part.freq_hz,
        values=np.ascontiguousarray(values / size[:, None]),
        scale=scale * size,
        weights=weight,
        decay_rate=frfs.decay_rate,
        band_hz=band or (float(part.freq_hz[0]), float(part.freq_hz[-1])),
    )


def _side(frfs: FrfSet, references: References | None) -> References:
    if references not in ("inputs", "outputs", "none", None):
        expected = '"inputs", "outputs", "none", or None for the smaller side'
        raise SignalError("references", found=repr(references), expected=expected)
    if references is None:
        if not frfs.complete:
            return "none"
        return "inputs" if len(frfs.inputs) <= len(frfs.outputs) else "outputs"
    if references != "none" and not frfs.complete:
        i, j = (int(k) for k in np.argwhere(~frfs.measured)[0])
        raise FrfError(
            "FrfSet.measured",
            found=f"no response {frfs.outputs[i]} to {frfs.inputs[j]}",
            expected="every pair, for references",
            hint='Take references "none", or select degrees of freedom with all pairs.',
        )
    return references


def _checked_weights(frfs: FrfSet, part: FrfSet, weights: ArrayLike | None) -> Array | None:
    if weights is None:
        return None
    expected = f"real numbers of at least 0, one above, for responses of shape {frfs.values.shape}"
    try:
        given = np.broadcast_to(np.asarray(weights, np.float64), frfs.values.shape)
    except (TypeError, ValueError):
        raise FrfError("weights", found=f"shape {np.shape(weights)}", expected=expected) from None
    kept = np.where(frfs.measured, given, 0.0)[np.isin(frfs.freq_hz, part.freq_hz)]
    if not (np.isfinite(kept).all() and (kept >= 0).all() and kept.any()):
        raise FrfError("weights", found="negative, all zero or not finite in the band", expected=expected)
    return np.asarray(kept / kept.max(), np.float64)
