"""What identification methods find of measured systems: poles of all orders, the modes of them, and how far off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armonic.frf_set import FrfSet
from armonic.identification.clustering import select_modes
from armonic.identification.stabilization import stabilize
from measured_systems import BAND, BATTERY, LINES_HZ, OUT_OF_BAND, KnownSystem

COARSE_HZ = np.arange(1, 121) / 2
"""Lines of a record of two seconds."""
WINDOW = 2.0
"""1/s, of an exponential window on it."""
KINDS = ("receptance", "mobility", "accelerance")
CLOSE_MODES = tuple(name for name in BATTERY if name != "ladder")
"""Those with modes at 10.0 and 11.0 Hz."""


def measured(system: KnownSystem, lines_hz=LINES_HZ, **more) -> FrfSet:
    frfs = system.frfs(lines_hz, **more)
    return frfs.band(*BAND) if system is OUT_OF_BAND else frfs


def modes_of(models):
    return select_modes(stabilize(models)).modes


@dataclass(frozen=True)
class Starts:
    """Modes beside the truth: relative errors of frequency and damping of those within 1 % and a factor of two."""

    found: int
    expected: int
    false: int
    freq_error: float
    damping_error: float

    @property
    def complete(self) -> bool:
        return self.found == self.expected


def starts(modes, system: KnownSystem) -> Starts:
    """Which modes in the band have a mode of their own; others are false unless they are ones outside the band."""
    left, errors = list(modes), []
    for index, pole in enumerate(system.poles):
        size, ratio = abs(pole), -pole.real / abs(pole)
        near = sorted(left, key=lambda mode, at=pole: abs(mode.pole - at))[:1]
        for mode in near:
            freq, damping = abs(abs(mode.pole) / size - 1), mode.damping_ratio / ratio
            if freq < 0.01 and 0.5 < damping < 2:
                left.remove(mode)
                if index in system.seen:
                    errors.append((freq, abs(damping - 1)))
    worst = np.max(errors, axis=0) if errors else (np.inf, np.inf)
    return Starts(len(errors), len(system.seen), len(left), float(worst[0]), float(worst[1]))


def nearest(poles, pole):
    """The one of the poles that lies nearest to a pole."""
    return poles[np.argmin(np.abs(poles - pole))]


def same_poles(found, expected, rtol) -> None:
    """Two lists of models have the same poles at every order."""
    assert [model.order for model in found] == [model.order for model in expected]
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_allclose(a.poles, b.poles, rtol=rtol)
