"""Poles by nonlinear least squares, residues made the best at every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.identification.projection import Projected, Samples, Terms, project

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

FIRST_DAMPING, MOST_DAMPING = 1e-3, 1e12
"""Marquardt's parameter at the start, and where the search gives up."""
SMALLER, LARGER = 0.1, 8.0
"""Its factors after a step that helped, and one that did not."""
LEAST_GAIN = 1e-10
"""A step that promises less than this share of the cost is a small part of any standard deviation."""
LEAST_STEP = 1e-13
"""A step below this share of every pole is rounding."""
AT_REST = 1e-8
"""Where no step helps any more, poles that would move by less than this share have arrived."""
ROUNDING = 1e-14
"""A misfit of this share of the values is none."""
FARTHEST, NEAREST, MOST_DAMPED = 10.0, 0.1, 0.7
"""Highest and lowest frequency of a pole outside the band, as shares of the band's ends, and its largest
−Re λ / Im λ: beyond them a pole says no more than lower and upper residual."""
LEAST_DAMPED = 1e-6
"""Least −Re λ / Im λ of any pole: what was measured has settled."""
AT_LIMIT = 1e-6
"""What moves by less than this share of its step is at a limit."""
DECAY_STEP, FREQ_STEP = 10.0, 0.1
"""Factor by which −Re λ, and share by which Im λ may change in one step."""


@dataclass(frozen=True, eq=False)
class Found:
    """Where a search ended.

    Attributes:
        poles: (n,), rad/s.
        projected: residues, misfit and Jacobian there.
        pair_scales: what makes the misfit of each pair one of unit variance, (K,).
        objective: −2 log likelihood but for a constant, N log(cost): of all, or summed over the pairs.
        iterations: Jacobians computed.
        converged: whether no step helps any more.
    """

    poles: Complex
    projected: Projected
    pair_scales: Array
    objective: float
    iterations: int
    converged: bool


def pole_search(
    samples: Samples,
    poles: Complex,
    terms: Terms,
    *,
    known: bool,
    free: int | None = None,
    most: int = 60,
) -> Found:
    """The poles of maximum likelihood near given ones, by Levenberg and Marquardt's method.

    Args:
        samples: values and weights.
        poles: to start from, (n,), rad/s.
        terms: of the model.
        known: the weights are one over the standard deviations but for a common factor, which is estimated with the
            poles. If not, there is such a factor for each response.
        free: how many of the poles may move anywhere; those after them, outside the band, not so far that nothing is
            left to tell them from the residuals. All by default.
        most: iterations.

    Raises:
        FrfError: the lines do not determine the residues at the start.
    """
    least = (ROUNDING * samples.pair_weights) ** 2 * np.sum(samples.values**2, axis=0) + np.finfo(float).tiny
    total, n = int(samples.counts.sum()), len(poles)

    def judged(found: Projected) -> tuple[float, Array]:
        costs = found.costs + least
        if known:
            return total * float(np.log(costs.sum())), np.full(len(costs), np.sqrt(total / costs.sum()))
        return float(samples.counts @ np.log(costs)), np.sqrt(samples.counts / costs)

    limits = _limits(samples, n, n if free is None else free)
    poles = _within(poles, limits)
    now = project(samples, poles, terms, tangent=True)
    objective, scales = judged(now)
    damping, steepest, count, converged = FIRST_DAMPING, np.zeros(2 * n), 0, n == 0
    while count < most and not converged:
        count += 1
        # The projected misfit is linear in the poles nearby: Gauss and Newton's step, damped column by column.
        J = (now.tangent * scales[:, None, None]).reshape(-1, 2 * n)
        z = (now.misfit * scales[:, None]).ravel()
        slopes = np.linalg.norm(J, axis=0)
        steepest = np.maximum(0.5 * steepest, np.where(slopes > 0, slopes, 1.0))
        Q, R = np.linalg.qr(J)
        h = Q.T @ z
        arrived = None
        while True:
            trial, step = _step(R, h, np.sqrt(damping) * steepest, poles, limits)
            promise = float(h @ h - np.sum((h - R @ step) ** 2)) / total
            size = float((np.abs(trial - poles) / np.abs(poles)).max())
            if arrived is None:  # later steps are small for being damped
                arrived = promise < LEAST_GAIN or size < AT_REST
            better = _tried(samples, trial, terms)
            if better is not None and judged(better)[0] < objective:
                poles, now = trial, better
                objective, scales = judged(now)
                damping *= SMALLER
                converged = promise < LEAST_GAIN or size < LEAST_STEP
                break
            damping *= LARGER
            if promise < LEAST_GAIN or size < LEAST_STEP or damping > MOST_DAMPING:
                return Found(poles, now, scales, objective, count, arrived)
    return Found(poles, now, scales, objective, count, converged)


def _limits(samples: Samples, n: int, free: int) -> Array:
    """Lowest and highest Im λ, and largest −Re λ / Im λ of every pole, (3, n)."""
    lines = samples.s.imag
    limits = np.tile([[np.finfo(float).tiny], [np.inf], [np.inf]], n)
    limits[:, free:] = np.array(
        [[max(NEAREST * lines.min(), np.ptp(lines) / len(lines))], [FARTHEST * lines.max()], [MOST_DAMPED]]
    )
    return limits


def _within(poles: Complex, limits: Array) -> Complex:
    rate = np.clip(poles.imag, limits[0], limits[1])
    return np.asarray(-np.clip(-poles.real, LEAST_DAMPED * rate, limits[2] * rate) + 1j * rate)


def _step(R: Array, h: Array, stiff: Array, poles: Complex, limits: Array) -> tuple[Complex, Array]:
    """The poles after a step that is damped by `stiff`, and the step as it would be but for its reach."""
    n = len(poles)
    held = np.zeros(2 * n, bool)
    for _ in range(3):
        system = np.where(held, 0, np.vstack([R, np.diag(stiff)]))
        step = np.linalg.lstsq(system, np.append(h, 0 * stiff))[0]
        reach = FREQ_STEP * poles.imag
        decay = np.clip(-(poles.real + step[:n]), -poles.real / DECAY_STEP, -poles.real * DECAY_STEP)
        trial = _within(-decay + 1j * (poles.imag + np.clip(step[n:], -reach, reach)), limits)
        moved = trial - poles
        taken = np.concatenate([moved.real, moved.imag])
        stopped = ~held & (np.abs(taken) < AT_LIMIT * np.abs(step))
        if not stopped.any():
            break
        held |= stopped
    return trial, step


def _tried(samples: Samples, poles: Complex, terms: Terms) -> Projected | None:
    try:
        return project(samples, poles, terms, tangent=True)
    except FrfError:  # two poles came together
        return None
