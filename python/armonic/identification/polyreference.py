"""Poles of frequency responses by the polyreference least-squares complex frequency-domain method (pLSCF)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.identification.denominators import denominator_poles, references_last
from armonic.identification.poles import ModelPoles
from armonic.identification.samples import blas_on_one_thread, checked_band, checked_orders

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]


def polyreference_lscf(
    frfs: FrfSet,
    *,
    orders: range | Sequence[int],
    band_hz: tuple[float, float] | None = None,
) -> list[ModelPoles]:
    """Poles and participations of right matrix fractions H(ω) = B(z) A(z)⁻¹, z = e^(iω Δt), of every order.

    Linear least squares of B − H A over all lines with real coefficients; the numerators of all outputs are eliminated,
    once for all orders, by an orthogonal basis of the powers of z (Peeters, Van der Auweraer, Guillaume and Leuridan
    2004, PolyMAX). Δt is half a period of the highest line.

    Args:
        frfs: responses of any kind; mobilities are fitted.
        orders: of A, ascending: a range, or the first and last. m references have m p poles.
        band_hz: natural frequencies for which participations are computed; all if not given.

    Returns:
        One set of poles for each order, those of an exponential window taken back to where they belong.

    Raises:
        FrfError: there are fewer lines than coefficients.
        SignalError: orders or band make no sense.
    """
    listed, band = checked_orders(orders), checked_band(band_hz)
    H = references_last(frfs)
    lines, rows, m = H.shape
    most = listed[-1]
    if 2 * lines <= (most + 1) * (m + 1):
        found = f"order {most} for {lines} lines"
        raise FrfError("orders", found=found, expected=f"at most {max(2 * lines // (m + 1) - 2, 0)}")
    step_s = 0.5 / frfs.freq_hz[-1]
    powers = np.exp(2j * np.pi * step_s * np.outer(frfs.freq_hz, np.arange(most + 1)))
    with blas_on_one_thread():
        basis, _ = np.linalg.qr(np.concatenate([powers.real, powers.imag]))
        total = np.zeros(((most + 1) * m,) * 2)
        projected = np.empty((rows, most + 1, (most + 1) * m))
        for row in range(rows):
            # Columns by power, then reference; of each response alike, whatever its unit.
            Y = (powers[:, :, None] * H[:, row, None, :]).reshape(lines, -1)
            Y /= np.linalg.norm(H[:, row])
            both = np.concatenate([Y.real, Y.imag])
            total += both.T @ both
            projected[row] = basis.T @ both

        def form(order: int) -> Array:
            size = (order + 1) * m
            fitted = projected[:, : order + 1, :size].reshape(-1, size)
            return np.asarray(total[:size, :size] - fitted.T @ fitted)

        return denominator_poles(form, m, listed, step_s, shift=frfs.decay_rate, band_hz=band)
