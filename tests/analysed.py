"""An experimental modal analysis with a known outcome: responses of the KUKA's model at its sensor, with noise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

import armonic as am
from armonic.frf_set import FrfSet
from armonic.identification.ema import EmaResult
from armonic.identification.modal_scaling import modal_scaling
from armonic.identification.poles import ModelPoles
from armonic.identification.refinement import refine
from armonic.identification.selection import RejectedMode, SelectedMode
from armonic.identification.stabilization import stabilize

SEEN = 4
"""Modes of the model below 30 Hz."""
LINES_HZ = np.arange(80, 481) / 16
"""401 lines from 5 to 30 Hz."""
AVERAGES = 5


def kuka() -> tuple[am.Robot, am.LinearModel, am.Modes]:
    robot = am.load("kuka_kr90")
    model = am.linearize(robot, "milling")
    return robot, model, am.modes(model)


def measured(model: am.LinearModel, *, noise: float = 0.01, seed: int = 0, lines_hz: Any = LINES_HZ) -> FrfSet:
    """The nine responses at the sensor with white noise, a share of the RMS of each, and the coherence of that."""
    exact = am.frf(model, None, lines_hz, frame="sensor")
    rng = np.random.default_rng(seed)
    sigma = noise * np.sqrt((np.abs(exact.values) ** 2).mean(axis=0))
    H = exact.values + sigma * (rng.normal(size=exact.values.shape) + 1j * rng.normal(size=exact.values.shape)) / 2**0.5
    coherence = 1 / (1 + AVERAGES * sigma**2 / np.abs(H) ** 2)
    labels = tuple(f"sensor.{axis}" for axis in "xyz")
    averages = np.full((3, 3), AVERAGES)
    return FrfSet(lines_hz, H, "accelerance", labels, labels, coherence, averages, notes={"file": "taps.uff"})


def analysis(frfs: FrfSet, poles: Any, *, seed: int = 0, orders: int = 30) -> EmaResult:
    """As `armonic.ema` would find these poles: in nearly every order with a little scatter, between false ones."""
    rng = np.random.default_rng(seed)
    refinement = refine(frfs, poles)
    scaling = modal_scaling(refinement.model)
    models, owner = [], []
    for order in range(2, 2 + orders):
        held = [i for i in range(len(poles)) if order >= 4 + 2 * i and rng.random() < 0.95]
        near = refinement.model.poles[held] * (
            1 + 3e-4 * (rng.normal(size=len(held)) + 1j * rng.normal(size=len(held)))
        )
        wild = 200 * rng.random(5) * np.exp(1j * np.arccos(-(rng.random(5) ** 2)))
        shapes = rng.normal(size=(5, scaling.shapes.shape[1])) + 0j
        models.append(ModelPoles(order, np.concatenate([near, wild]), np.concatenate([scaling.shapes[held], shapes])))
        owner += [*held, *[-1] * 5]
    stabilization, own = stabilize(models), np.array(owner)
    modes = []
    for i, pole in enumerate(refinement.model.poles):
        at = np.flatnonzero(own == i)
        size, spread = abs(pole), (float(refinement.freq_std_hz[i]), float(refinement.damping_std[i]))
        mode = SelectedMode(
            natural_freq_hz=size / (2 * np.pi),
            damping_ratio=-pole.real / size,
            pole=complex(pole),
            shape=scaling.shapes[i],
            freq_std_hz=spread[0],
            damping_std=spread[1],
            orders=len(at),
            first_order=int(stabilization.order[at].min()),
            members=at,
        )
        modes.append(mode)
    model = refinement.model
    return EmaResult(
        method="plscf",
        measured=frfs,
        frfs=frfs,
        orders=(2, 1 + orders),
        stabilization=stabilization,
        modes=tuple(modes),
        rejected=(rejected(14.2, 0.02, 9, "held in 9 of 30 orders only"),),
        channels=scaling.dofs,
        model=model,
        refinement=refinement,
        scaling=scaling,
        frac=am.frac(frfs, FrfSet(frfs.freq_hz, at_lines(model, frfs), frfs.kind, frfs.outputs, frfs.inputs)),
        remarks=refinement.remarks,
        seconds=1.25,
    )


def at_lines(model: Any, frfs: FrfSet) -> Any:
    """The modal model where the lines of an accelerance lie."""
    return model.receptance(frfs.s) * (frfs.s**2)[:, None, None]


def rejected(freq_hz: float, damping: float, orders: int, reason: str) -> RejectedMode:
    pole = 2 * np.pi * freq_hz * (-damping + 1j)
    shape = np.ones(3, complex) / np.sqrt(3)
    return RejectedMode(freq_hz, damping, pole, shape, 0.01, 1e-3, orders, 10, np.zeros(0, np.intp), reason)


def hit(number: int, force: str, peak_n: float, reason: str = "") -> Any:
    return SimpleNamespace(
        record=number,
        start_s=0.1 + number,
        peak_n=peak_n,
        duration_s=0.006,
        force=force,
        used=not reason,
        reason=reason,
    )


def estimated(frfs: FrfSet) -> Any:
    """How the responses came from hits, one of them double."""
    hits = [hit(k, f"sensor.{'xyz'[k // 5]}", -200.0 - k) for k in range(15)]
    hits[3] = hit(3, "sensor.x", -212.0, "a second hit 43 ms after the first, 18 % as hard")
    remarks = ("Lines above 80 Hz were left out: there the force is too weak.",)
    return SimpleNamespace(frfs=frfs, hits=tuple(hits), remarks=remarks)
