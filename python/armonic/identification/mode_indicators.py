"""Mode indicator functions: where frequency responses have modes, before any is identified."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]


def complex_mode_indicator(frfs: FrfSet) -> Array:
    """CMIF: singular values of the matrix of responses at each line, (L, min(outputs, inputs)), largest first.

    A peak is a mode; two that are close peak in two of the values (Shih, Tsuei, Allemang and Brown 1988).

    Args:
        frfs: responses; pairs that were not measured count as zero.
    """
    return np.asarray(np.linalg.svd(frfs.values, compute_uv=False))


def multivariate_mode_indicator(frfs: FrfSet) -> Array:
    """MMIF: least shares of the response that are in phase with the forces, (L, inputs), the smallest first.

    The eigenvalues of (HrᵀHr) f = λ (HrᵀHr + HiᵀHi) f, with the real and imaginary parts of a receptance: near one away
    from modes, a dip to zero at a mode, in the second value for the second of two (Williams, Crowley and Vold 1985).

    Args:
        frfs: responses of any kind.
    """
    H = frfs.to("receptance").values
    H = H / np.maximum(np.abs(H).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    A = np.einsum("loi,loj->lij", H.real, H.real)
    B = A + np.einsum("loi,loj->lij", H.imag, H.imag)
    # Whitened by B, whose small directions are those in which nothing was measured.
    sizes, vectors = np.linalg.eigh(B)
    floor = 1e-12 * sizes[:, -1:]
    scale = 1 / np.sqrt(np.maximum(sizes, floor))
    white = vectors * scale[:, None, :]
    return np.asarray(np.clip(np.linalg.eigvalsh(white.swapaxes(1, 2) @ A @ white), 0.0, 1.0))


def normal_mode_indicator(frfs: FrfSet) -> Array:
    """MIF: the share of real parts in all responses, (L,); it dips where a real mode is excited alone (Breitbach 1973).

    Args:
        frfs: responses of any kind.
    """
    H = frfs.to("receptance").values
    size = np.abs(H)
    whole = (size**2).sum(axis=(1, 2))
    part = (np.abs(H.real) * size).sum(axis=(1, 2))
    return np.asarray(np.divide(part, whole, out=np.ones(len(whole)), where=whole > 0))
