"""Modes outside the band whose tails the lines show: how many, and where they lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.identification.pole_search import ROUNDING, Found, pole_search
from armonic.identification.projection import Samples, Terms, model_columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

MOST = 6
"""Poles outside the band that are tried."""
ABOVE, BELOW = (1.05, 1.2, 1.45, 1.8, 2.5, 4.0), (0.95, 0.83, 0.65, 0.45, 0.3, 0.15)
"""Where they are looked for, as shares of the edges of the band."""
DAMPING = 0.02
"""Their damping ratio at first."""
PLACES, NOTABLE = 60, 0.1
"""Places in the band where a missing mode is looked for, and the share of the misfit that it explains at least."""
TRIAL = 40
"""Iterations of a search with one more pole."""


def with_background(samples: Samples, found: Found, modes: int, terms: Terms, *, known: bool) -> Found:
    """The search again with one pole outside the band after another, as long as they pay.

    A pole is tried where the misfit, beside all that poles and residues found so far could make up for, has most in
    common with its tail. It stays if twice the gain in log likelihood exceeds log N for each of its unknowns, of N real
    values (Schwarz 1978, the Bayesian information criterion).

    Args:
        samples: values and weights.
        found: the search without them.
        modes: how many poles are modes.
        terms: of the model.
        known: as in `pole_search`.

    Returns:
        The search with those poles, after the modes.
    """
    edges = samples.s.imag.min(), samples.s.imag.max()
    spacing = float(np.ptp(samples.s.imag)) / len(samples.s)
    pairs = int(np.count_nonzero(samples.pair_weights))
    price = (2 + pairs * (1 if terms.real else 2)) * float(np.log(samples.counts.sum()))
    for _ in range(MOST):
        if _exact(samples, found):
            break
        sides = [edges[1] * np.array(ABOVE), edges[0] * np.array(BELOW)]
        sides[1] = sides[1][sides[1] > 2 * spacing]
        starts, gains = [], []
        for side in sides:
            if len(side):
                gain = _gains(samples, found, side * (1j - DAMPING), terms)
                starts.append(side[np.argmax(gain)] * (1j - DAMPING))
                gains.append(gain.max())
        better = None
        for k in np.argsort(gains)[::-1]:
            if gains[k] < price:
                break
            poles = np.append(found.poles, starts[k])
            try:
                trial = pole_search(samples, poles, terms, known=known, free=modes, most=TRIAL)
            except FrfError:  # too few lines for another pole
                continue
            if trial.objective > found.objective - price:
                continue
            new = trial.poles[modes:].imag
            if not ((new > edges[0]) & (new < edges[1])).any():  # within the band it would be a mode
                better = trial
                break
        if better is None:
            break
        found = better
    return found


def missing_mode(samples: Samples, found: Found, terms: Terms) -> float | None:
    """Where in the band, Hz, the misfit looks most like one more mode; None if that is a small part of it."""
    if _exact(samples, found):
        return None
    within = np.linspace(samples.s.imag.min(), samples.s.imag.max(), PLACES + 2)[1:-1]
    gains = _gains(samples, found, within * (1j - DAMPING), terms)
    most = int(np.argmax(gains))
    return float(within[most] / (2 * np.pi)) if gains[most] > NOTABLE * samples.counts.sum() else None


def _exact(samples: Samples, found: Found) -> bool:
    """Whether rounding is all that is left."""
    size = np.sum(samples.values**2, axis=0) * samples.pair_weights**2
    return bool((found.projected.costs <= (100 * ROUNDING) ** 2 * size).all())


def _gains(samples: Samples, found: Found, candidates: Complex, terms: Terms) -> Array:
    """What each pole would take off the objective, beside what poles and residues found so far make up for."""
    columns = model_columns(samples, candidates, Terms(False, False, terms.real))
    Q = found.projected.spanned
    left = found.projected.left * (samples.pair_weights * found.pair_scales)
    if samples.extra is not None:
        left = left * np.sqrt(np.mean(samples.extra, axis=0))
    columns = columns / np.linalg.norm(columns, axis=0)
    columns -= Q @ (Q.T @ columns)
    count = len(candidates)
    own = columns.T.reshape(-1, count, len(columns)).transpose(1, 2, 0)
    basis, triangle = np.linalg.qr(own)
    shared = np.matmul(basis.transpose(0, 2, 1), left)
    shared *= (np.abs(np.diagonal(triangle, axis1=1, axis2=2)) > ROUNDING)[:, :, None]
    return np.asarray(np.sum(shared**2, axis=(1, 2)))
