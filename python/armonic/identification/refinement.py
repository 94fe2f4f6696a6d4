"""Poles and residues of frequency responses refined together, with the uncertainty that the noise leaves them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import FrfError, SignalError
from armonic.identification.background import missing_mode, with_background
from armonic.identification.line_deviations import line_deviations
from armonic.identification.modal_model import ModalModel, checked_poles
from armonic.identification.pole_search import LEAST_DAMPED, Found, pole_search
from armonic.identification.poles import damping_ratio, natural_freq_hz
from armonic.identification.projection import Samples, Terms, model_columns
from armonic.identification.residues import model_of_projection

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

UNSTABLE_START = 1e-3
"""Damping ratio at the start of a pole that was found to grow: what was measured did not."""
FAR = 0.03
"""A natural frequency that moved by more than this share is remarked upon."""
WEAK = 10.0
"""A mode whose significance is less is remarked upon. Of 150 poles put into noise all came out below 2.7 with nine
responses; of those with one response 95 % were below 8, a few far above."""
TOGETHER = 0.1
"""Two poles closer than this share of their decay rates are hardly two."""


@dataclass(frozen=True, eq=False, repr=False)
class Refinement:
    """Poles and residues that fit the frequency responses best.

    Attributes:
        model: the modal model; its modes in the order of the start.
        start: poles it began from, (m,), rad/s.
        covariance: of Re λ of all modes, then Im λ, (2m, 2m), (rad/s)².
        freq_std_hz: standard deviation of each natural frequency, (m,), Hz.
        damping_std: that of each damping ratio, (m,), a fraction.
        residual: RMS of what the model leaves: over the standard deviations if the noise is known, where it should be
            one, else over the RMS of each response.
        noise_known: whether standard deviations came from coherence, or were given; else from what the model leaves.
        significance: growth of χ² without the mode over the number of its residues, (m,): near 1 for a pole in noise.
        energy_share: weighted energy of the mode alone over that of the responses, (m,).
        iterations: of the last search.
        converged: whether no step would have helped.
        remarks: what a user should look at.
    """

    model: ModalModel
    start: Complex
    covariance: Array
    freq_std_hz: Array
    damping_std: Array
    residual: float
    noise_known: bool
    significance: Array
    energy_share: Array
    iterations: int
    converged: bool
    remarks: tuple[str, ...]

    def __repr__(self) -> str:
        """Modes and misfit in one line."""
        unit = "standard deviations" if self.noise_known else "of the responses"
        return f"Refinement({len(self.model)} modes, residual {self.residual:.3g} {unit})"

    @property
    def message(self) -> str:
        """How it ended, in one line."""
        end = "no step helps any more" if self.converged else f"stopped after {self.iterations} iterations"
        return "; ".join((end, *self.remarks))


def refine(
    frfs: FrfSet,
    poles: ArrayLike,
    *,
    deviations: ArrayLike | Literal["coherence"] | None = "coherence",
    weights: ArrayLike | None = None,
    background: ArrayLike | Literal["auto"] | None = "auto",
    lower: bool = True,
    upper: bool = True,
    real: bool = False,
    most: int = 60,
) -> Refinement:
    """Poles and residues of maximum likelihood, from poles nearby: the rational-fraction fit of all responses at once.

    The responses are modelled as in `ModalModel`. Residues are eliminated, so that only the poles are searched for
    (variable projection, Golub and Pereyra 1973); the misfit is in the kind that was measured, at s = iω or beside the
    axis where the responses have an exponential window.

    The covariance of the poles is the inverse of the information that is left to them beside all residues and poles
    outside the band, the bound of Cramér and Rao, and is carried on to frequency and damping to first order (Pintelon,
    Guillaume and Schoukens 2007). Noise counts as independent from line to line and response to response. If the
    misfit is larger than known standard deviations explain, the covariance grows by its χ² per degree of freedom.

    Args:
        frfs: measured responses.
        poles: of the modes, (m,), rad/s, within about 1 % of frequency and a factor of three of damping.
        deviations: σ of every value, (L, outputs, inputs), E|ΔH|² = σ², infinite to leave one out; "coherence": from
            coherence and averages, where known; None: of every response alike at all lines, from the misfit. Where
            noise varies along the lines and nothing tells, standard deviations may be wrong by a factor of three.
        weights: where the noise is not known, one over its relative standard deviation, (L, outputs, inputs).
        background: poles outside the band, to start from; "auto" seeks as many as the misfit asks for; None for none.
        lower: with the residual of modes far below.
        upper: with that of modes far above.
        real: residues of real modes.
        most: iterations of a search.

    Returns:
        Model, uncertainty, and how far to trust them.

    Raises:
        SignalError: no poles, poles without oscillation, or one twice.
        FrfError: deviations or weights that do not fit, or lines that do not determine the residues.
    """
    start = checked_poles("poles", poles)
    if not len(start):
        raise SignalError("poles", found="none", expected="one at least")
    given = np.zeros(0) if background is None or isinstance(background, str) else background
    if isinstance(background, str) and background != "auto":
        raise SignalError("background", found=repr(background), expected='"auto", poles or None')
    every = checked_poles("poles and background", np.concatenate([start, checked_poles("background", given)]))
    every = np.where(every.real < 0, every, np.abs(every) * -UNSTABLE_START + 1j * every.imag)
    sigma = _deviations(frfs, deviations)
    known, terms, m = sigma is not None, Terms(lower, upper, real), len(start)
    if sigma is not None:
        weights = np.divide(np.sqrt(2), sigma, out=np.zeros_like(sigma), where=sigma > 0)
    elif weights is not None:
        weights = np.asarray(weights, np.float64) * np.ones(frfs.values.shape)
    samples = Samples.of(frfs, terms, weights)
    found = pole_search(samples, every, terms, known=known, free=m, most=most)
    if isinstance(background, str):
        found = with_background(samples, found, m, terms, known=known)
    scales, freedoms = _scales(samples, found, terms, known)
    covariance = _covariance(found, scales, m)
    model = model_of_projection(frfs, found.poles, m, found.projected)
    freq_std_hz, damping_std = pole_spread(model.poles, covariance)
    per_pole = (1 if real else 2) * np.count_nonzero(samples.pair_weights)
    significance = found.projected.strength[:m] @ scales**2 / per_pole
    return Refinement(
        model=model,
        start=start,
        covariance=covariance,
        freq_std_hz=freq_std_hz,
        damping_std=damping_std,
        residual=_residual(samples, found, known, freedoms),
        noise_known=known,
        significance=significance,
        energy_share=_energy_share(samples, found, terms, m),
        iterations=found.iterations,
        converged=found.converged,
        remarks=_remarks(model, start, significance, missing_mode(samples, found, terms)),
    )


def pole_spread(poles: Complex, covariance: Array) -> tuple[Array, Array]:
    """Standard deviations of natural frequencies, Hz, and damping ratios of poles, to first order.

    Args:
        poles: λ, (m,), rad/s.
        covariance: of Re λ, then Im λ, (2m, 2m).
    """
    m, size = len(poles), np.abs(poles)
    x, y = poles.real, poles.imag
    k = np.arange(m)
    xx, xy, yy = covariance[k, k], covariance[k, m + k], covariance[m + k, m + k]

    def spread(of_x: Array, of_y: Array) -> Array:
        return np.sqrt(np.maximum(of_x**2 * xx + 2 * of_x * of_y * xy + of_y**2 * yy, 0))

    return spread(x / size, y / size) / (2 * np.pi), spread(-(y**2) / size**3, x * y / size**3)


def _deviations(frfs: FrfSet, given: ArrayLike | Literal["coherence"] | None) -> Array | None:
    if given is None:
        return None
    if isinstance(given, str):
        if given != "coherence":
            raise FrfError("deviations", found=repr(given), expected='"coherence", numbers or None')
        return line_deviations(frfs)
    expected = f"standard deviations above zero, shape {frfs.values.shape}"
    try:
        sigma = np.array(np.broadcast_to(np.asarray(given, np.float64), frfs.values.shape))
    except (TypeError, ValueError) as error:
        raise FrfError("deviations", found=str(error), expected=expected) from None
    if not (sigma[:, frfs.measured] > 0).all():
        raise FrfError("deviations", found="a number that is none, or not above zero", expected=expected)
    return sigma


def _scales(samples: Samples, found: Found, terms: Terms, known: bool) -> tuple[Array, float]:
    """What makes the misfit of each pair one of unit variance, (K,), and the degrees of freedom of all."""
    n, costs = len(found.poles), found.projected.costs
    pairs = max(int(np.count_nonzero(samples.pair_weights)), 1)
    each = np.maximum(samples.counts - terms.count(n) - 2 * n / pairs, 1.0)
    freedoms = float(each[samples.counts > 0].sum())
    if known:
        return np.full(len(costs), max(1.0, float(costs.sum()) / freedoms) ** -0.5), freedoms
    # An exact fit has no noise; its share of rounding keeps the quotient finite.
    size = np.sum(samples.values**2, axis=0) * samples.pair_weights**2
    least = np.finfo(float).eps ** 2 * size + np.finfo(float).tiny
    return np.sqrt(each / (costs + least)) * (samples.counts > 0), freedoms


def _covariance(found: Found, scales: Array, modes: int) -> Array:
    """(JᵀJ)⁻¹ of the modes' poles, by singular values of the Jacobian with columns of unit length."""
    n = len(found.poles)
    J = (found.projected.tangent * scales[:, None, None]).reshape(-1, 2 * n)
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    _, singular, Vh = np.linalg.svd(J / size, full_matrices=False)
    spread = (Vh.T / np.maximum(singular, np.finfo(float).eps)) / size[:, None]
    own = spread[np.r_[:modes, n : n + modes]]
    return np.asarray(own @ own.T)


def _residual(samples: Samples, found: Found, known: bool, freedoms: float) -> float:
    costs = found.projected.costs
    if known:
        return float(np.sqrt(costs.sum() / freedoms))
    extra = 1.0 if samples.extra is None else samples.extra
    size = np.sum(extra * samples.values**2, axis=0) * samples.pair_weights**2
    return float(np.sqrt(np.mean(costs[size > 0] / size[size > 0]))) if (size > 0).any() else 0.0


def _energy_share(samples: Samples, found: Found, terms: Terms, modes: int) -> Array:
    columns = model_columns(samples, found.poles[:modes], Terms(False, False, terms.real))
    residues = found.projected.residues[:modes]
    extra = 1.0 if samples.extra is None else samples.extra
    shares = np.zeros(modes)
    parts = (residues.imag,) if terms.real else (residues.real, residues.imag)
    for k in range(modes):
        alone = columns[:, k::modes] @ np.array([part[k] for part in parts])
        shares[k] = (np.sum(extra * alone**2, axis=0) * samples.pair_weights**2).sum()
    whole = (np.sum(extra * samples.values**2, axis=0) * samples.pair_weights**2).sum()
    return shares / whole if whole > 0 else shares


def _remarks(model: ModalModel, start: Complex, significance: Array, missing: float | None) -> tuple[str, ...]:
    freq, before, remarks = model.natural_freq_hz, natural_freq_hz(start), []
    for k in range(len(model)):
        name = f"mode at {freq[k]:.4g} Hz"
        if abs(freq[k] / before[k] - 1) > FAR:
            remarks.append(f"{name} began at {before[k]:.4g} Hz")
        if significance[k] < WEAK:
            remarks.append(f"{name} hardly stands out of the noise")
        if damping_ratio(model.poles[k]) < 2 * LEAST_DAMPED:
            remarks.append(f"{name} has no damping that the lines would show")
    if missing is not None:
        remarks.append(f"what the modes leave looks like one more, near {missing:.3g} Hz")
    decay = -model.poles.real
    near = np.abs(model.poles[:, None] - model.poles) < TOGETHER * np.minimum(decay[:, None], decay)
    for i, j in np.argwhere(np.triu(near, 1)):
        remarks.append(f"modes {i + 1} and {j + 1} came together at {freq[i]:.4g} Hz: they may be one")
    return tuple(remarks)
