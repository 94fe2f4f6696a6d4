"""Vibrating systems with poles and shapes known in closed form, and their free decays and random responses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
TURN = 2 * np.pi


@dataclass(frozen=True, eq=False)
class KnownSystem:
    """y(t) = Σ over modes of φ ξ(t) and its conjugate, with ξ' = λ ξ: poles (k,), Im λ ≥ 0, shapes by rows (k, m)."""

    poles: Complex
    shapes: Complex
    sample_rate_hz: float

    @property
    def natural_freq_hz(self) -> Array:
        return np.abs(self.poles) / TURN

    @property
    def damping_ratio(self) -> Array:
        return -self.poles.real / np.abs(self.poles)

    @property
    def discrete(self) -> Complex:
        return np.exp(self.poles / self.sample_rate_hz)

    def decay(self, samples: int, amplitudes: Sequence[complex] | None = None) -> Array:
        """The free response (samples, m) from ξ(0) = amplitudes, all one if not given; each value in closed form."""
        start = np.ones(len(self.poles)) if amplitudes is None else np.asarray(amplitudes)
        time_s = np.arange(samples) / self.sample_rate_hz
        weight = np.where(self.poles.imag > 0, 2.0, 1.0)  # a real pole has no conjugate
        return ((weight * start * np.exp(np.outer(time_s, self.poles))) @ self.shapes).real

    def response(self, samples: int, seed: int | Sequence[int], *, noise: float = 0.0) -> Array:
        """A stationary response (samples, m) to white forces, plus white noise of a share of each channel's deviation.

        Every mode takes the forces at the m channels through its own shape, scaled so that all modes vibrate alike.
        """
        rng = np.random.default_rng(seed)
        # All motion left from rest has decayed to 1e-6 of itself before the record begins.
        wait = int(np.ceil(np.log(1e-6) / np.log(np.abs(self.discrete).max())))
        forces = rng.normal(size=(wait + samples, self.shapes.shape[1]))
        values = np.zeros((wait + samples, self.shapes.shape[1]))
        for mu, shape in zip(self.discrete, self.shapes, strict=True):
            gain = np.sqrt(1 - abs(mu) ** 2) / np.linalg.norm(shape) ** 2
            values += 2 * np.outer(lfilter([gain], [1, -mu], forces @ shape), shape).real
        values = values[wait:]
        return values + noise * values.std(axis=0) * rng.normal(size=values.shape)

    def autoregression(self) -> Array:
        """A_1, A_2 of y_k = A_1 y_(k−1) + A_2 y_(k−2), (2, m, m), of a system with as many modes as channels.

        From (μ² I − A_1 μ − A_2) φ = 0 of all 2 m eigenpairs.
        """
        mu = np.concatenate([self.discrete, self.discrete.conj()])
        phi = np.concatenate([self.shapes, self.shapes.conj()]).T
        matrices = (phi * mu**2) @ np.linalg.inv(np.vstack([phi * mu, phi]))
        m = len(phi)
        return np.ascontiguousarray(np.stack([matrices[:, :m], matrices[:, m:]]).real)

    def autoregressive_responses(self, records: int, samples: int, seed: int, covariance: Array) -> Array:
        """Stationary responses (records, samples, m), autoregressions of order 2 to noise of that covariance."""
        rng = np.random.default_rng(seed)
        first, second = self.autoregression()
        wait = int(np.ceil(np.log(1e-6) / np.log(np.abs(self.discrete).max())))
        values = rng.normal(size=(wait + samples, records, len(first))) @ np.linalg.cholesky(covariance).T
        for k in range(2, len(values)):
            values[k] += values[k - 1] @ first.T + values[k - 2] @ second.T
        return values[wait:].swapaxes(0, 1)


def pole(freq_hz: float, damping_ratio: float) -> complex:
    """λ of a natural frequency and a damping ratio below one."""
    return TURN * freq_hz * (-damping_ratio + 1j * np.sqrt(1 - damping_ratio**2))


def system(modes: Sequence[tuple[float, float]], shapes: Any, *, sample_rate_hz: float) -> KnownSystem:
    """A system from natural frequencies in Hz with damping ratios, and shapes by rows."""
    poles = np.array([pole(*mode) for mode in modes])
    return KnownSystem(poles, np.asarray(shapes, np.complex128), sample_rate_hz)


def chain(masses: int = 4, *, sample_rate_hz: float = 100.0) -> KnownSystem:
    """Equal masses in a row between two walls, all springs alike, damping 1, 2, … %: f_j = 20 Hz sin(j π / 2(n+1))."""
    number = np.arange(1, masses + 1)
    freq_hz = 20.0 * np.sin(number * np.pi / (2 * (masses + 1)))
    shapes = np.sin(np.outer(number, number) * np.pi / (masses + 1))
    return system([(f, 0.01 * j) for j, f in zip(number, freq_hz, strict=True)], shapes, sample_rate_hz=sample_rate_hz)


def close_pair() -> KnownSystem:
    """Three channels with modes at 10 and 10.1 Hz, 1 % apart and of damping 0.5 and 0.8 %, and one at 23 Hz."""
    shapes = [[1.0, 0.6, -0.3], [0.4, -1.0, 0.5], [0.2, 0.5, 1.0]]
    return system([(10.0, 0.005), (10.1, 0.008), (23.0, 0.01)], shapes, sample_rate_hz=100.0)


def twisted(modes: int = 5, channels: int = 3, *, seed: int = 0) -> KnownSystem:
    """More modes than channels, of random complex shapes and 1 to 40 % of damping, below half of 200 Hz."""
    rng = np.random.default_rng([seed, modes, channels])
    freq_hz = np.linspace(6, 70, modes) + rng.uniform(-2, 2, modes)
    ratios = rng.permutation(np.geomspace(0.01, 0.4, modes))
    shapes = rng.normal(size=(modes, channels)) + 1j * rng.normal(size=(modes, channels))
    return system(list(zip(freq_hz, ratios, strict=True)), shapes, sample_rate_hz=200.0)


def nearest(poles: Complex, wanted: Complex) -> NDArray[np.intp]:
    """For every wanted pole the index of the nearest among the poles."""
    return np.argmin(np.abs(np.subtract.outer(wanted, poles)), axis=1)


def likeness(a: Complex, b: Complex) -> Array:
    """|aᴴ b|² / (aᴴ a · bᴴ b), row by row: one for shapes that differ by a factor."""
    norms = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.abs(np.sum(a.conj() * b, axis=1)) ** 2 / norms**2
