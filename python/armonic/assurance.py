"""How alike two sets of frequency responses are."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.response import Frf

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]


def frac(measured: Frf, model: Frf, *, used: ArrayLike | None = None) -> Array:
    """Frequency response assurance criterion of each response: 1 where one is a multiple of the other, 0 at worst.

    |Σ H_a H_b*|² / (Σ |H_a|² Σ |H_b|²) over the lines (Heylen, Lammens, *FRAC: a consistent way of comparing frequency
    response functions*, 1996). High values dominate: it judges resonances, their places first of all, and no scale.

    Args:
        measured: responses.
        model: others, on the same lines and of the same kind.
        used: which values to compare, of booleans, (L,) or (L, outputs, inputs).

    Returns:
        The criterion, (outputs, inputs); not a number where a response is zero throughout or no value is used.

    Raises:
        FrfError: lines, kind or shapes differ.
    """
    if measured.values.shape != model.values.shape or measured.kind != model.kind:
        raise FrfError("frac", found=repr(model), expected=f"lines, kind and axes of {measured!r}")
    if not np.array_equal(measured.freq_hz, model.freq_hz):
        raise FrfError("frac", found="different frequency lines", expected="the same lines on both sides")
    a, b = measured.values, model.values
    if used is not None:
        chosen = np.asarray(used, bool)
        if chosen.ndim == 1:
            chosen = chosen[:, None, None]
        try:
            chosen = np.broadcast_to(chosen, a.shape)
        except ValueError:
            raise FrfError("used", found=f"shape {chosen.shape}", expected=f"shape {a.shape}") from None
        a, b = np.where(chosen, a, 0.0), np.where(chosen, b, 0.0)
    return frac_of(a, b)


def frac_of(a: Complex, b: Complex) -> Array:
    """The criterion of responses as arrays, lines first: (L, ...) each gives (...); see `frac`."""
    a, b = (side / np.maximum(np.abs(side).max(axis=0), np.finfo(float).tiny) for side in (a, b))
    sizes = (np.abs(a) ** 2).sum(axis=0) * (np.abs(b) ** 2).sum(axis=0)
    shared = np.abs((a * b.conj()).sum(axis=0)) ** 2
    return np.asarray(np.divide(shared, sizes, out=np.full(sizes.shape, np.nan), where=sizes > 0))
