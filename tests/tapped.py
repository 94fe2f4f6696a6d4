"""Records of known systems hit by half-sine pulses, in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armonic.series import Channel, TimeSeries
from measured_systems import KUKA, KnownSystem

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s²"}
PULSE_S = 0.008


def tap(
    axis: str = "x",
    *,
    system: KnownSystem = KUKA,
    starts_s: Sequence[float] = (0.2,),
    peaks_n: Sequence[float] = (200.0,),
    pulse_s: float = PULSE_S,
    duration_s: float = 4.0,
    rate_hz: float = 2048.0,
    quantity: str = "displacement",
    outputs: str = "xyz",
) -> TimeSeries:
    """Pulses F sin(π(t − t₀)/T) on one axis: a mode's coordinate of ż = λz + f(t) has a closed form."""
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    poles, w = system.poles[:, None], np.pi / pulse_s
    power = list(UNITS).index(quantity)
    force, z = np.zeros(len(time_s)), np.zeros((len(poles), len(time_s)), complex)
    for start, peak in zip(starts_s, peaks_n, strict=True):
        t = time_s - start
        inside, after = (t >= 0) & (t <= pulse_s), t > pulse_s
        force += np.where(inside, peak * np.sin(w * np.clip(t, 0, pulse_s)), 0)

        def driven(u, w=w):
            return (w * np.exp(poles * u) - w * np.cos(w * u) - poles * np.sin(w * u)) / (poles**2 + w**2)

        z += peak * np.where(inside, driven(np.clip(t, 0, pulse_s)), 0)
        z += peak * np.where(after, driven(pulse_s) * np.exp(poles * np.maximum(t - pulse_s, 0)), 0)
    column = "xyz".index(axis)
    # Derivatives: each one brings a factor λ and what the force adds at once; the sums of those over all modes of a
    # system in motion vanish for displacement and velocity.
    if power == 2:
        raise ValueError("accelerations follow the force at once: take displacements")
    rows = ["xyz".index(a) for a in outputs]
    R = system.residues[:, rows, column]
    if power:
        R = R * system.poles[:, None]
    values = 2 * np.real(np.einsum("mo,mt->to", R, z))
    if power:  # ẋ = Σ 2 Re R (λ z + f), and Σ Re R = 0 for real shapes of unit modal mass
        values += 2 * np.real(system.residues[:, rows, column]).sum(axis=0) * force[:, None]
    channels = [Channel(f"tip.{axis}", "force", "N")]
    channels += [Channel(f"tip.{a}", quantity, UNITS[quantity]) for a in outputs]  # type: ignore[arg-type]
    return TimeSeries(np.column_stack([force, values]), rate_hz, tuple(channels))
