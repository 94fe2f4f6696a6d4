"""Residues and residuals of frequency responses at known poles, by least squares (LSFD)."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.identification.modal_model import ModalModel, checked_poles
from armonic.identification.projection import Projected, Samples, Terms, project

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]


def fit_residues(
    frfs: FrfSet,
    poles: ArrayLike,
    *,
    background: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    lower: bool = True,
    upper: bool = True,
    real: bool = False,
) -> ModalModel:
    """Residues of all responses at known poles: the least-squares frequency-domain method (Heylen et al. 1998).

    Linear, since the receptance is so in residues and residuals once the poles are known. It is fitted in the kind that
    was measured, at s = iω or beside the imaginary axis where the responses have an exponential window.

    Args:
        frfs: measured responses; a line at 0 Hz is left out, where lower residual or kind leave it without meaning.
        poles: λ of the modes, (m,), rad/s, Im λ > 0.
        background: poles outside the band, (b,), whose tails are fitted as well.
        weights: one over the standard deviation of every value, (L, outputs, inputs) or what broadcasts to it, of any
            scale; 0 leaves a value out. All lines of a response alike by default.
        lower: with the residual of modes far below, lower / s².
        upper: with that of modes far above, a constant receptance.
        real: residues of real modes, R = φφᵀ / (2i Im λ), as proportional damping has them.

    Returns:
        The model.

    Raises:
        SignalError: poles without oscillation, or one twice.
        FrfError: weights that do not fit, or lines that do not determine the residues.
    """
    modes = checked_poles("poles", poles)
    outside = checked_poles("background", np.zeros(0) if background is None else background)
    every = checked_poles("poles and background", np.concatenate([modes, outside]))
    terms = Terms(lower, upper, real)
    return model_of_projection(frfs, every, len(modes), project(Samples.of(frfs, terms, weights), every, terms))


def model_of_projection(frfs: FrfSet, poles: Complex, modes: int, found: Projected) -> ModalModel:
    """The modal model of fitted pairs; the first poles are modes, the others background."""
    pairs = frfs.measured.shape

    def laid(values: NDArray[np.generic]) -> NDArray[np.generic]:
        full = np.zeros((*values.shape[:-1], *pairs), values.dtype)
        full[..., frfs.measured] = values
        return full

    residues = np.asarray(laid(found.residues), np.complex128)
    return ModalModel(
        poles[:modes],
        residues[:modes],
        frfs.outputs,
        frfs.inputs,
        lower=np.asarray(laid(found.lower), np.float64),
        upper=np.asarray(laid(found.upper), np.float64),
        background_poles=poles[modes:],
        background_residues=residues[modes:],
        measured=frfs.measured,
    )
