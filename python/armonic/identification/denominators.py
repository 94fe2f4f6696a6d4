"""Poles of matrix denominators of every order, from the one quadratic form that all of them minimize."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import FrfError
from armonic.identification.autoregressive import poles_of
from armonic.identification.poles import LEAST_DISCRETE_POLE, ModelPoles, in_band, unit_shapes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]


def references_last(frfs: FrfSet) -> Complex:
    """Mobilities with the smaller side last, (L, rows, references): the poles of both ways are the same.

    Of a set that lacks pairs every measured one is a row of its own with one reference, so that all of them share a
    common denominator. Mobility holds resonances of all frequencies at like heights.
    """
    H = frfs.to("mobility").values
    if not frfs.complete:
        return np.ascontiguousarray(H[:, frfs.measured][:, :, None])
    return np.ascontiguousarray(H.swapaxes(1, 2) if len(frfs.inputs) > len(frfs.outputs) else H)


def denominator_poles(
    form: Callable[[int], Array],
    references: int,
    orders: Sequence[int],
    step_s: float,
    *,
    shift: float,
    band_hz: tuple[float, float] | None,
) -> list[ModelPoles]:
    """Poles λ and participations w of the denominators Σ_j A_j z^j, z = e^(λ step), with wᵀ A(z) = 0.

    Each order minimizes a quadratic form of its coefficients. A_0 is held at unity: the poles that only serve the noise
    then come out growing, and are told from those of a structure (Cauberghe et al. 2005).

    Args:
        form: the form of an order p, ((p + 1) m, (p + 1) m), over A_0, A_1 … A_p one above the other.
        references: m.
        orders: p, ascending.
        step_s: time from one power of z to the next.
        shift: what an exponential window adds to every decay rate, 1/s; it is taken off.
        band_hz: natural frequencies for which participations are computed.

    Raises:
        FrfError: the responses do not determine an order.
    """
    m = references
    coefficients = []
    for order in orders:
        M = form(order)
        try:
            below = np.linalg.solve(M[m:, m:], -M[m:, :m]).reshape(order, m, m)
        except np.linalg.LinAlgError:
            told = f"responses that do not determine order {order}"
            raise FrfError("orders", found=told, expected="lower orders, or more lines") from None
        # With powers of μ = 1/z the first coefficient is the unity: μ^p I + Σ_j A_j μ^(p−j).
        coefficients.append(np.ascontiguousarray(-below))
    found = []
    for order, matrices, inverse in zip(orders, coefficients, poles_of(coefficients), strict=True):
        keep = np.isfinite(inverse) & (inverse.imag >= 0) & (np.abs(inverse) > LEAST_DISCRETE_POLE)
        mu = inverse[keep]
        # The conjugate of 1/μ lies in the upper half again; a negative real one stays at +π.
        poles: Complex = np.asarray(-np.log(mu.astype(np.complex128) + 0.0).conj() / step_s + shift, np.complex128)
        inside = in_band(poles, band_hz)
        shapes = np.full((len(poles), m), np.nan, np.complex128)
        left = np.ascontiguousarray(matrices.transpose(0, 2, 1))
        shapes[inside] = unit_shapes(_core.polynomial_shapes(left, mu[inside]).conj())
        place = np.lexsort((poles.imag, np.abs(poles)))
        found.append(ModelPoles(order, poles[place], shapes[place]))
    return found
