"""Slow modes told apart by a second look: autoregressions whose lags reach farther back."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armonic.identification.clustering import select_modes
from armonic.identification.stabilization import stabilize

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.identification.poles import ModelPoles
    from armonic.identification.selection import SelectedMode

SAME = 0.02
"""A pole of the second set within this share of |λ| is that of the mode: the sets see the same samples."""
CLEAR_OF_FOLD = 0.5
"""Share of half the rate of the lags up to which modes are looked at: faster ones come back there, aliased."""


def sharpened(
    modes: Sequence[SelectedMode], slow: Sequence[ModelPoles], sample_rate_hz: float, spacing: int
) -> tuple[tuple[SelectedMode, ...], tuple[int, ...]]:
    """Modes with pole and shape from the second set wherever they scatter less there.

    Poles of a decay that lie close together, a mode beside combinations of others for example, are told apart only by a
    model that looks back for long. Lags a few samples apart reach as far back with a few coefficients. No mode is added
    and none is dropped; members and orders stay those of the first set.

    Args:
        modes: found with lags of one sample.
        slow: poles of all orders with lags `spacing` samples apart.
        sample_rate_hz: samples per second.
        spacing: samples from one lag to the next.

    Returns:
        The modes, and from lags how far apart each of them comes.
    """
    limit = CLEAR_OF_FOLD * sample_rate_hz / (2 * spacing)
    others = select_modes(stabilize(slow), combinations=False).modes
    found, spacings = [], []
    for mode in modes:
        better = _same(mode, others) if mode.natural_freq_hz < limit else None
        if better is None:
            found.append(mode)
        else:
            found.append(replace(better, members=mode.members, orders=mode.orders, first_order=mode.first_order))
        spacings.append(1 if better is None else spacing)
    return tuple(found), tuple(spacings)


def _same(mode: SelectedMode, others: Sequence[SelectedMode]) -> SelectedMode | None:
    """The other mode at the same place, if there is one that scatters less."""
    if not others:
        return None
    apart = [abs(other.pole / mode.pole - 1) for other in others]
    nearest = int(np.argmin(apart))
    scatter = [np.hypot(m.freq_std_hz / m.natural_freq_hz, m.damping_std) for m in (others[nearest], mode)]
    return others[nearest] if apart[nearest] <= SAME and scatter[0] < scatter[1] else None
