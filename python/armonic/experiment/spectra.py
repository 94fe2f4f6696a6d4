"""Spectra of one hit or block, of forces and of responses as accelerations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.experiment.signals import Roles
    from armonic.series import TimeSeries

    Complex: TypeAlias = NDArray[np.complex128]

LEAST_SAMPLES = 16
"""Of a window or block."""


@dataclass(frozen=True, eq=False)
class Usable:
    """A record with what in it can be used.

    Attributes:
        record: the samples.
        number: its place among those that were given.
        roles: its forces and responses.
    """

    record: TimeSeries
    number: int
    roles: Roles


@dataclass(frozen=True, eq=False)
class Block:
    """Spectra of one hit or block.

    Attributes:
        inputs: degrees of freedom of the forces.
        outputs: of the responses.
        forces: (L, inputs), N s.
        responses: (L, outputs), as accelerations, m/s.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    forces: Complex
    responses: Complex


def accelerations(spectra: Complex, powers: Sequence[int], freq_hz: ArrayLike, decay_rate: float = 0.0) -> Complex:
    """Spectra of responses (L, outputs) as accelerations, by s^(2 − power) at s = iω + a.

    Args:
        spectra: of displacements, velocities or accelerations.
        powers: 0, 1 or 2 of each.
        freq_hz: (L,).
        decay_rate: a of an exponential window on them, 1/s.
    """
    s = 2j * np.pi * np.asarray(freq_hz) + decay_rate
    return np.asarray(spectra * np.stack([s ** (2 - power) for power in powers], axis=1))
