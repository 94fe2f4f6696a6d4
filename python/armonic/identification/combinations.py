"""Combinations: poles λ_i + λ_j that a robot's nonlinearity adds to its decays, and that are no modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armonic.identification.selection import RejectedMode, SelectedMode, Selection, pole_scatter, rejected_for

if TYPE_CHECKING:
    from collections.abc import Sequence

SCATTERS = 5.0
"""A combination lies within so many standard deviations of its place, its own and its parents' scatter together."""
LEAST_TOLERANCE = 5e-4
"""Where the scatter is smaller, within this share of |λ|: scatter over the orders says nothing of a common error."""
MOST_TOLERANCE = 1.2e-2
"""And never farther than this: a mode that happens to lie near a combination must not pass for it."""


def without_combinations(found: Sequence[SelectedMode]) -> Selection:
    """Takes out of the modes found what is the sum or difference of two stronger ones.

    To second order in the amplitude, a decaying nonlinear system answers at λ_i + λ_j and λ_i + λ̄_j (the first terms
    of its Volterra series; Nayfeh & Mook 1979, *Nonlinear Oscillations*): twice a frequency at the same damping ratio,
    and sums and differences of frequencies whose decay rates add up. Noise-free data show dozens of them, each as
    steady over the orders as a mode. A group is one if its pole, frequency and damping alike, lies at such a place, and
    no more orders hold it than hold either parent. Parents are modes that have passed this test themselves.
    Combinations of three are not looked for, nor those that are aliased.

    A mode that lies within the tolerance of a combination by chance is taken out with it; the reason names the parents,
    so that it can be judged. The some 200 sums and differences of 12 modes cover 0.02 % of the plane at the least
    tolerance and 8 % at the largest.

    Args:
        found: modes.

    Returns:
        What is left and what is rejected, each by natural frequency.
    """
    accepted: list[SelectedMode] = []
    rejected: list[RejectedMode] = []
    for mode in sorted(found, key=lambda mode: (-mode.orders, mode.first_order, pole_scatter(mode))):
        parents = _parents(mode, accepted)
        if parents is None:
            accepted.append(mode)
        else:
            rejected.append(rejected_for(mode, parents))
    return Selection(
        tuple(sorted(accepted, key=lambda mode: mode.natural_freq_hz)),
        tuple(sorted(rejected, key=lambda mode: mode.natural_freq_hz)),
    )


def _parents(mode: SelectedMode, accepted: Sequence[SelectedMode]) -> str | None:
    """The reason to reject a mode: the two modes whose combination lies nearest, if it is near enough."""
    stronger = [a for a in accepted if a.orders >= mode.orders]
    if not stronger:
        return None
    poles = np.array([a.pole for a in stronger])
    scatter = np.array([pole_scatter(a) for a in stronger])
    size = abs(mode.pole)
    spread = SCATTERS * np.sqrt(np.add.outer(scatter**2, scatter**2) + pole_scatter(mode) ** 2)
    reach = np.clip(spread, LEAST_TOLERANCE * size, MOST_TOLERANCE * size)
    best, reason = 1.0, None
    for sign, other in (("+", poles), ("−", poles.conj())):
        share = np.abs(np.add.outer(poles, other) - mode.pole) / reach
        i, j = (int(k) for k in np.unravel_index(np.argmin(share), share.shape))
        if share[i, j] <= best:
            best = float(share[i, j])
            reason = _sentence(stronger[i], stronger[j], sign)
    return reason


def _sentence(a: SelectedMode, b: SelectedMode, sign: str) -> str:
    if a is b and sign == "+":
        return f"twice the pole of the mode at {a.natural_freq_hz:.4g} Hz: quadratic nonlinearity"
    word = "sum" if sign == "+" else "difference"
    return f"{word} of the modes at {a.natural_freq_hz:.4g} and {b.natural_freq_hz:.4g} Hz: quadratic nonlinearity"
