"""Standard deviations of measured frequency responses, line by line, from their coherence."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]

LEAST_NOISE = 1e-7
"""Least 1 − γ², for files hold coherences in single precision, which resolves no less. Noise below it is stated too
large."""
ENOUGH = 16
"""Degrees of freedom of a variance below which neighbouring lines are averaged: its scatter is then a quarter."""


def line_deviations(frfs: FrfSet, *, smooth: bool = True) -> Array | None:
    """Standard deviation σ of every value, σ² = E|ΔH|² of real and imaginary part together.

    For H1 and forces that are known, the variance of H given the forces is S_ee / (n S_ff), of n averages, and the
    noise S_ee = (1 − γ²) S_yy is estimated with n − 1 degrees of freedom (Bendat and Piersol 2010), so
    that

        σ² = (1 − γ²) / ((n − 1) γ²) · |H|²

    is without bias for any n from 2 on. Each part has half of it, and so has |H|: the book's
    var|H| / |H|² = (1 − γ²) / (2 n γ²) is that of the magnitude alone, for many averages.

    Where all forces of a row have the same coherence it is taken for a multiple one: |H|² is then the sum over the
    forces, as for forces alike and independent, and n − 1 is n less the number of forces.

    A variance of few averages scatters; where it has fewer than 16 degrees of freedom, those of neighbouring lines are
    averaged with it. Noise has no resonance.

    Args:
        frfs: the responses, with coherence and averages.
        smooth: whether neighbouring lines are averaged.

    Returns:
        (L, outputs, inputs) in the unit of the responses, infinite where nothing is known of a value; None if
        coherence or averages are not known, or of some response only one average was taken.
    """
    if frfs.coherence is None or frfs.averages is None or (frfs.averages[frfs.measured] < 2).any():
        return None
    coherence, size = frfs.coherence, np.abs(frfs.values) ** 2
    forces = frfs.measured.sum(axis=1)
    alike = (np.ptp(np.where(frfs.measured, coherence, coherence.max(axis=2, keepdims=True)), axis=2) == 0).all(axis=0)
    joint = alike & (forces > 1)
    # A coherence of one everywhere says nothing of how many forces acted at once.
    joint &= ~(coherence >= 1 - LEAST_NOISE).any(axis=2).all(axis=0)
    size = np.where(joint[:, None], size.sum(axis=2, keepdims=True), size)
    freedoms = np.maximum(frfs.averages - np.where(joint, forces, 1)[:, None], 1)
    noise = np.maximum(1 - coherence, LEAST_NOISE) / freedoms
    known = (coherence > 0) & frfs.measured & (size > 0)
    variance = np.divide(noise * size, coherence, out=np.zeros(size.shape), where=known)
    if smooth:
        variance = _smoothed(variance, known, freedoms)
    return np.sqrt(np.where(known, variance, np.inf))


def _smoothed(variance: Array, known: NDArray[np.bool_], freedoms: NDArray[np.int64]) -> Array:
    """Variances averaged over as many lines to either side as their degrees of freedom ask for."""
    lines = len(variance)
    each = np.clip(np.ceil((ENOUGH / freedoms - 1) / 2).astype(np.intp), 0, lines - 1)
    if not each.any():
        return variance
    sums = np.concatenate([np.zeros((1, *each.shape)), np.cumsum(variance, axis=0)])
    counts = np.concatenate([np.zeros((1, *each.shape)), np.cumsum(known, axis=0)])
    at = np.arange(lines)[:, None, None]
    below, above = np.maximum(at - each, 0), np.minimum(at + each + 1, lines)

    def within(running: Array) -> Array:
        return np.asarray(np.take_along_axis(running, above, 0) - np.take_along_axis(running, below, 0))

    # A difference of running sums may be below zero by rounding; no average is less than its share of the own value.
    mean = within(sums) / np.maximum(within(counts), 1)
    return np.maximum(mean, variance / (2 * each + 1))
