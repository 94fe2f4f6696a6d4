"""An identification with a known outcome: twelve modes over 99 orders, scattered poles, and the run they came from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import armonic as am
from armonic.identification.harmonics import Flag
from armonic.identification.poles import ModelPoles
from armonic.identification.selection import RejectedMode, SelectedMode
from armonic.identification.stabilization import Criteria, stabilize
from armonic.series import Channel, TimeSeries

Array = NDArray[np.float64]

MOTORS = tuple(f"link_{k}.motor" for k in range(1, 7))


def pole_of(freq_hz: float, damping: float) -> complex:
    """λ in rad/s."""
    return complex(2 * np.pi * freq_hz * (-damping + 1j * np.sqrt(1 - damping**2)))


def flag(reason: str = "") -> Flag:
    """A harmonic if there is a reason to take it for one."""
    return Flag(0.0, bool(reason), reason, 3.0)


def rejected(freq_hz: float, damping: float, orders: int, reason: str) -> RejectedMode:
    shape = np.ones(6, complex) / np.sqrt(6)
    spread = (1e-3 * freq_hz, 1e-3)
    return RejectedMode(
        freq_hz, damping, pole_of(freq_hz, damping), shape, *spread, orders, 10, np.zeros(0, np.intp), reason
    )


def scompi_modes() -> am.Modes:
    return am.modes(am.load("scompi"), "c8")


def identification(reference: am.Modes, *, seed: int = 0, false_per_order: int = 120, found: int = 11) -> Any:
    """The first `found` modes of the reference as an identification would find them, with what it did not take."""
    rng = np.random.default_rng(seed)
    truth = reference.poles[reference.oscillatory][:found]
    columns = [reference.coordinates.index(name) for name in MOTORS]
    shapes = reference.shapes[columns][:, reference.oscillatory][:, :found].T
    shapes = shapes / np.linalg.norm(shapes, axis=1)[:, None]
    models, owner, order = [], [], []
    for p in range(2, 101):
        held = [i for i in range(len(truth)) if p >= 4 + 2 * i and rng.random() < 0.95]
        near = truth[held] * (1 + 3e-4 * (rng.normal(size=len(held)) + 1j * rng.normal(size=len(held))))
        count = min(3 * p, false_per_order)
        wild = 1000 * np.pi * rng.random(count) * np.exp(1j * np.arccos(-(rng.random(count) ** 2)))
        any_shape = rng.normal(size=(count, 6)) + 1j * rng.normal(size=(count, 6))
        models.append(ModelPoles(p, np.concatenate([near, wild]), np.concatenate([shapes[held], any_shape])))
        owner += [*held, *[-1] * count]
        order += [p] * (len(held) + count)
    own, orders = np.array(owner), np.array(order)
    stabilization = stabilize(models, Criteria(mac=0.9, omac=None))
    pole = stabilization.pole
    modes = []
    for i in range(len(truth)):
        members = np.flatnonzero(own == i)
        mean = complex(np.mean(pole[members]))
        f, z = stabilization.natural_freq_hz[members], stabilization.damping_ratio[members]
        modes.append(
            SelectedMode(
                natural_freq_hz=abs(mean) / (2 * np.pi),
                damping_ratio=-mean.real / abs(mean),
                pole=mean,
                shape=shapes[i],
                freq_std_hz=float(f.std()),
                damping_std=float(z.std()),
                orders=len(members),
                members=members,
                first_order=int(orders[members].min()),
            )
        )
    return SimpleNamespace(
        method="var",
        series=decay(reference).select("motor_position"),
        orders=(2, 100),
        stabilization=stabilization,
        modes=tuple(modes),
        rejected=(
            rejected(12.74, 0.0125, 31, "twice the pole of mode 1 (nonlinearity)"),
            rejected(333.0, 0.2, 9, "held in 9 of 99 orders only"),
        ),
        channels=MOTORS,
        harmonics=tuple(flag() for _ in modes),
        seconds=1.25,
    )


def decay(reference: am.Modes, *, samples: int = 2795, rate_hz: float = 1000.0) -> TimeSeries:
    """Motor positions of a free decay about a posture, and their torques."""
    t = np.arange(samples) / rate_hz
    columns = [reference.coordinates.index(name) for name in MOTORS]
    shapes, poles = reference.shapes[columns][:, :11], reference.poles[:11]
    q = 1e-4 * np.real(np.exp(np.outer(t, poles)) @ shapes.T) + np.linspace(-1, 1, 6)
    v = 1e-4 * np.real((np.exp(np.outer(t, poles)) * poles) @ shapes.T)
    channels = [Channel(name, "motor_position", "rad") for name in MOTORS]
    channels += [Channel(name, "motor_torque", "N m") for name in MOTORS]
    notes = {"robot": "Scompi", "posture": "c8", "excitation": "impulse of 50 N over 6 ms"}
    return TimeSeries(np.hstack([q, -20 * v]), rate_hz, tuple(channels), 0.206, notes)
