"""What a selection hands over: a mode with its scatter over the model orders, and a group of poles that is no mode."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.identification.shape_criteria import mean_shape

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.stabilization import Stabilization

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Indices: TypeAlias = NDArray[np.intp]

CORE = 0.5
"""Share of the members, those nearest to one another, around which a mode is looked for."""
REACH = 1.5
"""Members as far from the core's mean as this times the median distance are averaged: of a normal scatter 79 %, of one
with many poles far off not many more than half."""
MOST_DAMPING = 0.999
"""Poles damped beyond this do not oscillate."""
LEAST_DAMPING = -5e-4
"""Of a sine that a machine adds, poles come out damped by a little less than zero as often as by a little more."""
MAD_TO_STD = 1.4826
"""Standard deviation of a normal distribution per median absolute deviation."""


@dataclass(frozen=True, eq=False, repr=False)
class SelectedMode:
    """A mode found over several model orders.

    Attributes:
        natural_freq_hz: |λ| / 2π of the pole, Hz.
        damping_ratio: −Re λ / |λ| of the pole, a fraction.
        pole: λ, rad/s, the mean of the members without those that lie far off.
        shape: (m,), the one most like those of the same members in the sense of the MAC; unit length, largest entry
            real,
            positive.
        freq_std_hz: scatter of the members' frequency over the orders, 1.4826 times the median absolute deviation.
        damping_std: that of the damping ratio. Neighbouring orders see the same noise: the error may be larger.
        orders: how many model orders hold the mode.
        first_order: the lowest order that does.
        members: their indices into the stabilization, (k,), by order.
    """

    natural_freq_hz: float
    damping_ratio: float
    pole: complex
    shape: Complex
    freq_std_hz: float
    damping_std: float
    orders: int
    first_order: int
    members: Indices

    def __repr__(self) -> str:
        """Frequency, damping and orders in one line."""
        return (
            f"SelectedMode({self.natural_freq_hz:.5g} Hz ± {self.freq_std_hz:.2g}, "
            f"{100 * self.damping_ratio:.4g} % ± {100 * self.damping_std:.2g}, {self.orders} orders)"
        )


@dataclass(frozen=True, eq=False, repr=False)
class RejectedMode(SelectedMode):
    """A group of poles that holds over the orders like a mode and is none.

    Attributes:
        reason: why, in one sentence.
    """

    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class Selection:
    """Modes and rejected groups, each by natural frequency."""

    modes: tuple[SelectedMode, ...]
    rejected: tuple[RejectedMode, ...] = ()


def mode_of(stabilization: Stabilization, members: Indices) -> SelectedMode:
    """One mode out of its members.

    Single orders can be far off, and always to the same side. So first the half is averaged that lies around the member
    whose median distance to the others is least, then all members that are not much farther from there than the median.

    Args:
        stabilization: the poles of all orders.
        members: indices, (k,), at least one, no two of one order.
    """
    members = members[np.argsort(stabilization.order[members], kind="stable")]
    poles, shapes = stabilization.pole[members], stabilization.shape[members]
    apart = np.abs(np.subtract.outer(poles, poles))
    center = int(np.argmin(np.median(apart, axis=1)))
    core = np.argsort(apart[center], kind="stable")[: max(int(np.ceil(CORE * len(members))), min(3, len(members)))]
    distance = np.abs(poles - poles[core].mean())
    used = distance <= REACH * np.median(distance)
    pole = complex(poles[used].mean())
    freq, damping = stabilization.natural_freq_hz[members], stabilization.damping_ratio[members]
    return SelectedMode(
        natural_freq_hz=abs(pole) / (2 * np.pi),
        damping_ratio=-pole.real / abs(pole),
        pole=pole,
        shape=mean_shape(shapes[used], np.ones(int(used.sum()))),
        freq_std_hz=_scatter(freq),
        damping_std=_scatter(damping),
        orders=len(members),
        first_order=int(stabilization.order[members[0]]),
        members=members,
    )


def pole_scatter(mode: SelectedMode) -> float:
    """Standard deviation of the pole over the orders in rad/s: along |λ|, and across it."""
    along = 2 * np.pi * mode.freq_std_hz
    across = abs(mode.pole) * mode.damping_std / np.sqrt(max(1.0 - mode.damping_ratio**2, 1e-6))
    return float(np.hypot(along, across))


def rejected_for(mode: SelectedMode, reason: str) -> RejectedMode:
    """A group of poles that is no mode, with the reason."""
    return RejectedMode(**{field.name: getattr(mode, field.name) for field in fields(mode)}, reason=reason)


def oscillating(stabilization: Stabilization) -> NDArray[np.bool_]:
    """Which poles can be modes at all, (P,): they oscillate, do not grow, and have a shape."""
    damping, known = stabilization.damping_ratio, np.isfinite(stabilization.shape).all(axis=1)
    return np.asarray(known & (stabilization.pole.imag > 0) & (damping > LEAST_DAMPING) & (damping < MOST_DAMPING))


def _scatter(values: Array) -> float:
    return float(MAD_TO_STD * np.median(np.abs(values - np.median(values))))
