"""Frequency responses from averaged spectra: H1, H2 and Hv, and coherence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import SignalError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

Estimator = Literal["H1", "H2", "Hv"]
ALIKE = 1e-8
"""Forces whose spectra have a smaller reciprocal condition are one force."""


def frf_estimate(forces: Complex, responses: Complex, estimator: Estimator = "H1") -> tuple[Complex, Array]:
    """Frequency responses and coherence of spectra of several averages (Bendat and Piersol 2010; Rocklin et al. 1985).

    H1 = G_yf G_ff⁻¹ is free of bias from noise on the responses, H2 = G_yy / G_fy from noise on the force, and Hv, of
    total least squares, is so if the noise is the same share of both; for one force |H1| ≤ |Hv| ≤ |H2|.

    Args:
        forces: spectra, (averages, L, inputs).
        responses: spectra, (averages, L, outputs).
        estimator: "H1", "H2" or "Hv"; H2 is for one force only.

    Returns:
        H, (L, outputs, inputs); coherence γ², (L, outputs): ordinary of one force, multiple of several.

    Raises:
        SignalError: an unknown estimator, H2 with several forces, or forces that are one and the same.
    """
    if estimator not in ("H1", "H2", "Hv"):
        raise SignalError("estimator", found=repr(estimator), expected="one of H1, H2, Hv")
    count, lines, inputs = forces.shape
    if count < inputs:
        raise SignalError("records", found=f"{count} averages", expected=f"at least {inputs}, as there are forces")
    # Of whatever unit, so that no power overflows or vanishes.
    unit_f, unit_y = (np.abs(side).max(axis=(0, 1)) for side in (forces, responses))
    unit_f, unit_y = (np.where(unit > 0, unit, 1.0) for unit in (unit_f, unit_y))
    F, Y = (forces / unit_f).transpose(1, 2, 0), (responses / unit_y).transpose(1, 2, 0)
    scale = unit_y[:, None] / unit_f
    Gff = F @ F.conj().swapaxes(1, 2) / count
    Gyf = Y @ F.conj().swapaxes(1, 2) / count
    Gyy = (Y.real**2 + Y.imag**2).mean(axis=2)
    power = np.maximum(np.einsum("lii->li", Gff).real, np.finfo(float).tiny)
    if inputs > 1:
        scaled = Gff / np.sqrt(power[:, :, None] * power[:, None, :])
        if np.median(np.linalg.cond(scaled)) > 1 / ALIKE:
            raise SignalError(
                "records", found="forces that are one and the same", expected="forces that are not fully correlated"
            )
    still = np.einsum("lii->li", Gff).real.min(axis=1) <= 0
    Gff[still] += np.eye(inputs)  # a line without force has no response to it: zero
    H1 = np.linalg.solve(Gff.swapaxes(1, 2), Gyf.swapaxes(1, 2)).swapaxes(1, 2)
    explained = np.einsum("loi,loi->lo", H1, Gyf.conj()).real
    coherence = np.clip(np.divide(explained, Gyy, out=np.zeros_like(Gyy), where=Gyy > 0), 0.0, 1.0)
    if estimator == "H1":
        return np.asarray(H1 * scale), coherence
    if estimator == "H2":
        if inputs > 1:
            raise SignalError("estimator", found="H2 with several forces", expected="H1 or Hv")
        below = Gyf[:, :, 0].conj()
        H2 = np.divide(Gyy, below, out=np.zeros_like(below), where=np.abs(below) > 0)
        return np.asarray(H2[:, :, None] * scale), coherence
    outputs = Y.shape[1]
    H = np.empty((lines, outputs, inputs), np.complex128)
    root_f = np.sqrt(power)
    for o in range(outputs):
        root_y = np.sqrt(np.maximum(Gyy[:, o], np.finfo(float).tiny))
        G = np.empty((lines, inputs + 1, inputs + 1), np.complex128)
        G[:, :inputs, :inputs] = Gff / (root_f[:, :, None] * root_f[:, None, :])
        G[:, inputs, :inputs] = Gyf[:, o] / (root_y[:, None] * root_f)
        G[:, :inputs, inputs] = G[:, inputs, :inputs].conj()
        G[:, inputs, inputs] = 1.0
        _, vectors = np.linalg.eigh(G)
        v = vectors[:, :, 0].conj()  # vᴴ z = 0 with z of forces and response, the smallest direction
        last = np.where(np.abs(v[:, inputs]) > 0, v[:, inputs], np.finfo(float).tiny)
        H[:, o] = -v[:, :inputs] / last[:, None] * root_y[:, None] / root_f
        H[still | (Gyy[:, o] <= 0), o] = 0.0
    return H * scale, coherence
