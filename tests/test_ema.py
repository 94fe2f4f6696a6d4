"""Modes of known systems come back from their frequency responses, by either method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armonic.comparison import compare
from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet
from armonic.identification.ema import EmaResult, ema
from measured_systems import BAND, BATTERY, COMPLEX, KUKA, LINES_HZ, OUT_OF_BAND, KnownSystem

METHODS = ("plscf", "lsce")


def analysed(system: KnownSystem, *, noise: float = 0.0, seed: int = 0, **options) -> EmaResult:
    band = BAND if system is OUT_OF_BAND else None
    return ema(system.frfs(LINES_HZ, noise=noise, seed=seed), band_hz=band, **options)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", BATTERY)
def test_without_noise_every_mode_is_found_to_rounding_and_nothing_else(name: str, method: str) -> None:
    system = BATTERY[name]
    found = analysed(system, method=method)
    assert len(found.modes) == len(system.seen)
    np.testing.assert_allclose(found.poles, system.seen_poles, rtol=1e-8)
    np.testing.assert_allclose(found.model.residues, system.residues[list(system.seen)], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", BATTERY)
def test_one_percent_of_noise_costs_little(name: str, method: str) -> None:
    system = BATTERY[name]
    true = system.seen_poles
    for seed in range(3):
        found = analysed(system, noise=0.01, seed=seed, method=method)
        assert len(found.modes) == len(true)
        freq, damping = np.abs(true) / (2 * np.pi), -true.real / np.abs(true)
        np.testing.assert_allclose(found.natural_freq_hz, freq, rtol=5e-4)
        np.testing.assert_allclose(found.damping_ratio, damping, rtol=0.03)


@pytest.mark.parametrize("system", [KUKA, COMPLEX, OUT_OF_BAND], ids=["real", "complex", "out of band"])
def test_two_modes_a_hertz_apart_are_both_found(system: KnownSystem) -> None:
    draws = 8  # a hundred of them stand in the documentation
    for seed in range(draws):
        freq = analysed(system, noise=0.01, seed=100 + seed).natural_freq_hz
        assert np.abs(freq - 10.0).min() < 0.005
        assert np.abs(freq - 11.0).min() < 0.0055


def test_an_exponential_window_leaves_the_modes_as_they_are() -> None:
    for method in METHODS:
        found = ema(KUKA.frfs(LINES_HZ, decay_rate=1.0), method=method)
        np.testing.assert_allclose(found.poles, KUKA.poles, rtol=1e-8)
    assert found.synthesized().decay_rate == 0


def test_synthesized_responses_are_the_true_ones() -> None:
    noisy = KUKA.frfs(LINES_HZ, noise=0.01, seed=5)
    true = KUKA.frfs(LINES_HZ).values
    made = ema(noisy).synthesized(symmetric="average")
    assert made.kind == noisy.kind
    np.testing.assert_allclose(made.values, made.values.swapaxes(1, 2))
    # of 2000 lines some fifty parameters: the noise of 1 % falls far below
    assert np.linalg.norm(made.values - true) < 0.003 * np.linalg.norm(true)


def test_direct_responses_alone_give_the_poles_too() -> None:
    whole = KUKA.frfs(LINES_HZ)
    direct = FrfSet(
        whole.freq_hz, whole.values, whole.kind, whole.outputs, whole.inputs, measured=np.eye(3, dtype=bool)
    )
    np.testing.assert_allclose(ema(direct).poles, KUKA.poles, rtol=1e-8)


def test_the_result_compares_with_other_modes_over_its_channels() -> None:
    found = analysed(KUKA)
    table = compare(found, found.table())
    assert [pair.mac for pair in table.pairs] == pytest.approx([1.0] * 4)


def test_what_makes_no_analysis_is_refused() -> None:
    frfs = KUKA.frfs(LINES_HZ[:20])
    with pytest.raises(SignalError, match="one of plscf, lsce"):
        ema(frfs, method="fft")  # type: ignore[arg-type]
    with pytest.raises(SignalError, match="at most"):
        ema(frfs, orders=(2, 60))
    with pytest.raises(FrfError, match="at least 16"):
        ema(KUKA.frfs(LINES_HZ[:10]))
    with pytest.raises(FrfError, match="band"):
        ema(frfs, band_hz=(50, 60))
    with pytest.raises(FrfError, match="an FrfSet, an Frf or an FrfEstimate"):
        ema([1.0])  # type: ignore[arg-type]
    uneven = np.sort(np.random.default_rng(0).uniform(1, 30, 400))
    with pytest.raises(FrfError, match="even"):
        ema(KUKA.frfs(uneven), method="lsce")


def test_responses_without_noise_that_were_synthesized_are_identified_again() -> None:
    clean = ema(KUKA.frfs(LINES_HZ, noise=0.01)).synthesized(symmetric="average")
    np.testing.assert_allclose(ema(clean).natural_freq_hz, np.abs(KUKA.poles) / (2 * np.pi), rtol=1e-3)


def test_a_response_without_any_coherence_is_left_out_and_named() -> None:
    frfs = KUKA.frfs(LINES_HZ, noise=0.01)
    coherence = np.array(frfs.coherence)
    coherence[:, 0, 2] = 0.0
    found = ema(replace(frfs, coherence=coherence))
    assert not found.synthesized().measured[0, 2]
    assert any("tip.x to tip.z" in remark for remark in found.remarks)
    with pytest.raises(FrfError, match="zero everywhere"):
        ema(replace(frfs, coherence=0 * coherence))


def test_places_are_names_and_no_patterns() -> None:
    values = np.arange(1, 5).reshape(1, 2, 2) * np.ones((2, 1, 1), complex)
    odd = FrfSet([1.0, 2.0], values, "accelerance", ("1.x", "[1].x"), ("1.x", "[1].x"))
    assert odd.matrix("[1]")[0].values[0, 0, 0] == 4
    assert odd.matrix("1")[0].values[0, 0, 0] == 1
