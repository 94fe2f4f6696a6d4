"""Systems whose poles and residues are known exactly, and their frequency responses in closed form, with noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armonic.frf_set import FrfSet


@dataclass(frozen=True, eq=False)
class KnownSystem:
    """H(s) = Σ_r R_r/(s − λ_r) + conj(R_r)/(s − conj λ_r), R_r = q_r ψ_r ψ_rᵀ: poles (m,), shapes (m, n), scales (m,).

    `seen` are the modes in the band of the measurement; the others disturb from outside.
    """

    freq_hz: tuple[float, ...]
    damping_ratio: tuple[float, ...]
    shapes: np.ndarray
    seen: tuple[int, ...]
    outputs: tuple[str, ...] = ("tip.x", "tip.y", "tip.z")
    inputs: tuple[str, ...] = ("tip.x", "tip.y", "tip.z")

    @property
    def poles(self) -> np.ndarray:
        w, z = 2 * np.pi * np.array(self.freq_hz), np.array(self.damping_ratio)
        return w * (-z + 1j * np.sqrt(1 - z**2))

    @property
    def seen_poles(self) -> np.ndarray:
        return self.poles[list(self.seen)]

    @property
    def residues(self) -> np.ndarray:
        """(m, n, n) of the receptance; a mode of unit modal mass and real shape φ has φφᵀ / (2i Im λ)."""
        scale = 1 / (2j * self.poles.imag)
        return scale[:, None, None] * self.shapes[:, :, None] * self.shapes[:, None, :]

    def frfs(self, freq_hz, *, noise: float = 0.0, seed: int = 0, kind: str = "accelerance", decay_rate: float = 0.0):
        """As a set; noise is complex white, its standard deviation a share of the RMS of each response, and then the
        coherence of 100 averages that had such noise goes with it."""
        s = 2j * np.pi * np.asarray(freq_hz) + decay_rate
        power = ("receptance", "mobility", "accelerance").index(kind)
        H = np.zeros((len(s), len(self.outputs), len(self.inputs)), complex)
        for pole, residue in zip(self.poles, self.residues, strict=True):
            H += residue / (s - pole)[:, None, None] + residue.conj() / (s - pole.conj())[:, None, None]
        H *= (s**power)[:, None, None]
        if not noise:
            return FrfSet(freq_hz, H, kind, self.outputs, self.inputs, decay_rate=decay_rate)
        sigma = noise * np.sqrt((np.abs(H) ** 2).mean(axis=0))
        rng = np.random.default_rng(seed)
        H = H + sigma * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) / np.sqrt(2)
        # var H = (1 − γ²) |H|² / (averages γ²) of both parts together (Bendat and Piersol)
        ratio = 100 * sigma**2 / np.maximum(np.abs(H) ** 2, 1e-300)
        averages = np.full(H.shape[1:], 100)
        return FrfSet(
            freq_hz, H, kind, self.outputs, self.inputs, coherence=1 / (1 + ratio), averages=averages,
            decay_rate=decay_rate,
        )  # fmt: skip


def _real_shapes(m: int, n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (m, n)) + 0.3


def _complex_shapes(m: int, n: int, seed: int) -> np.ndarray:
    phase = np.random.default_rng(seed + 1).uniform(-0.6, 0.6, (m, n))
    return _real_shapes(m, n, seed) * np.exp(1j * phase)


KUKA = KnownSystem((10.0, 11.0, 19.2, 23.7), (0.014, 0.010, 0.005, 0.008), _real_shapes(4, 3, 1), (0, 1, 2, 3))
"""The modes of the KUKA KR90 (Huynh et al. 2021, Table 6): two of them close together."""
LADDER = KnownSystem(
    (4.0, 9.0, 14.0, 19.0, 25.0), (0.002, 0.005, 0.01, 0.02, 0.05), _real_shapes(5, 3, 2), (0, 1, 2, 3, 4)
)
"""Damping from 0.2 to 5 %."""
COMPLEX = KnownSystem((10.0, 11.0, 19.2, 23.7), (0.014, 0.010, 0.005, 0.008), _complex_shapes(4, 3, 3), (0, 1, 2, 3))
"""Shapes that are not real, as of a robot under control."""
OUT_OF_BAND = KnownSystem(
    (1.5, 10.0, 11.0, 19.2, 23.7, 41.0, 66.0), (0.02, 0.014, 0.010, 0.005, 0.008, 0.01, 0.02), _real_shapes(7, 3, 4),
    (1, 2, 3, 4),
)  # fmt: skip
"""Modes below and above a band of 5 to 30 Hz."""
BATTERY = {"kuka": KUKA, "ladder": LADDER, "complex": COMPLEX, "out_of_band": OUT_OF_BAND}
LINES_HZ = np.arange(1, 2001) * 0.015
"""2000 lines up to 30 Hz."""
BAND = (5.0, 30.0)
"""What is measured of OUT_OF_BAND."""
