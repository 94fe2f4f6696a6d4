"""How long a step of Dormand and Prince's method of order 8 may be before fast, damped motion blows up."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Complex: TypeAlias = NDArray[np.complex128]

GROWTH = (
    *(1 / factorial(k) for k in range(9)),
    2.6916922001690827e-06,
    2.3413451082097813e-07,
    1.494736485459155e-08,
    3.613324578128244e-10,
)
"""Coefficients of R(z): what a step h makes of exp(hλ), lowest power first (Hairer, Nørsett and Wanner 1993, II.5)."""

SLACK = 1.01
"""A growth per step that the control of errors sees and mends; without it no step would suit an undamped motion."""
MARGIN = 0.9
"""Share of the limit that is tried: the motion of a robot shifts its poles."""


def growth(z: Complex) -> Complex:
    """R(z), of any shape."""
    return np.asarray(np.polyval(GROWTH[::-1], z), np.complex128)


def longest_stable_step(poles: Complex) -> float:
    """The longest step, s, for which no decaying motion with these poles (rad/s) grows; infinite if there is none."""
    decaying = poles[poles.real < 0]
    if not decaying.size or np.abs(decaying).max() == 0:
        return float("inf")
    scaled = decaying / np.abs(decaying).max()
    lengths = np.linspace(0.05, 8.0, 400)
    stable = (np.abs(growth(np.outer(lengths, scaled))) <= SLACK).all(axis=1)
    last = len(lengths) if stable.all() else int(np.argmin(stable))
    return float(MARGIN * lengths[max(last - 1, 0)] / np.abs(decaying).max())
