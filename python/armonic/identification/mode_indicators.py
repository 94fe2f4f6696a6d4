"""Mode-indicator functions: what frequency responses show of how many modes there are, and where, before any fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

ROUNDING = 1e-12
"""Singular values below this share of the largest of their line are none."""


def complex_mode_indicator(frfs: FrfSet) -> Array:
    """Complex mode indicator function (CMIF): singular values of the FRF matrix (Shih et al. 1988).

    A peak of the first is a mode; of two that lie close together each has a peak, in the first and in the second.

    Args:
        frfs: the responses; pairs that were not measured count as zero.

    Returns:
        (L, k) with k the smaller number of outputs and inputs, falling; in the unit of the responses.
    """
    return np.asarray(np.linalg.svd(frfs.values, compute_uv=False), np.float64)


def multivariate_mode_indicator(frfs: FrfSet) -> Array:
    """Multivariate mode indicator function (MMIF) (Williams, Crowley and Vold 1985).

    The least share of the energy of a response that is in phase with the forces, over all real combinations of the
    forces: the eigenvalues α of H_rᵀH_r p = α (H_rᵀH_r + H_iᵀH_i) p, H_r and H_i real and imaginary part. It dips to
    zero where some forces make the structure move as one real mode, and a second one where two modes lie together. Of
    mobilities the parts change roles. Where there are more inputs than outputs, outputs stand for the forces, as
    reciprocity allows.

    With as many forces as outputs it can dip between modes too: the in-phase part then is a square matrix, which may
    have a zero there.

    Args:
        frfs: the responses; pairs that were not measured count as zero.

    Returns:
        (L, k) with k the smaller number of outputs and inputs, 0 to 1, rising; 1 where nothing responds.
    """
    values = _in_phase_real(frfs)
    if values.shape[2] > values.shape[1]:
        values = values.transpose(0, 2, 1)
    rows = values.shape[1]
    basis, size, _ = np.linalg.svd(np.concatenate([values.real, values.imag], axis=1), full_matrices=False)
    known = size > ROUNDING * size[:, :1]
    # One less what is out of phase: forces without a response then count as no mode, and dips are exact to rounding.
    quadrature = np.linalg.svd(np.where(known[:, None, :], basis[:, rows:], 0.0), compute_uv=False)
    return np.clip(1.0 - quadrature**2, 0.0, 1.0)


def normal_mode_indicator(frfs: FrfSet) -> Array:
    """Normal mode indicator function of every input: Σ |Re H| |H| / Σ |H|² over the outputs (Breitbach 1973).

    It dips to zero where all outputs move in quadrature to the force, as in a real mode far from others.

    Args:
        frfs: the responses; pairs that were not measured count as zero.

    Returns:
        (L, inputs), 0 to 1; 1 where nothing responds.
    """
    values = _in_phase_real(frfs)
    peak = np.abs(values).max(axis=1, keepdims=True)
    scaled = np.divide(values, peak, out=np.zeros_like(values), where=peak > 0)
    size = np.abs(scaled)
    energy = (size**2).sum(axis=1)
    in_phase = (np.abs(scaled.real) * size).sum(axis=1)
    return np.asarray(np.divide(in_phase, energy, out=np.ones_like(energy), where=energy > 0), np.float64)


def _in_phase_real(frfs: FrfSet) -> Complex:
    """The responses, turned if they are mobilities, so that a mode at its resonance is imaginary."""
    return frfs.values * 1j if frfs.kind == "mobility" else frfs.values
