"""Refined poles of known systems: exact without noise, within bounds with it, and what is said of doubtful ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from armonic.errors import FrfError, SignalError
from armonic.identification.refinement import refine
from measured_systems import BAND, BATTERY, COMPLEX, KUKA, LINES_HZ, OUT_OF_BAND, KnownSystem

EXACT = 1e-8  # noise-free, as the issue asks
FREQ, DAMPING = 5e-4, 0.03  # with 1 % noise, as the issue asks
KINDS = ("receptance", "mobility", "accelerance")


def disturbed(poles, seed, freq=0.003, damping=1.5):
    """Poles off by up to so much of frequency, and up to such a factor of damping."""
    rng = np.random.default_rng(seed)
    w, z = np.abs(poles), -poles.real / np.abs(poles)
    w = w * (1 + freq * rng.uniform(-1, 1, len(w)))
    z = z * damping ** rng.uniform(-1, 1, len(w))
    return w * (-z + 1j * np.sqrt(1 - z**2))


def measured(system, **more):
    frfs = system.frfs(LINES_HZ, **more)
    return frfs.band(*BAND) if len(system.seen) < len(system.poles) else frfs


def errors(found, system):
    """Largest relative errors of frequency and damping ratio."""
    size = np.abs(found), np.abs(system.seen_poles)
    ratio = [-p.real / w for p, w in zip((found, system.seen_poles), size, strict=True)]
    return np.abs(size[0] / size[1] - 1).max(), np.abs(ratio[0] / ratio[1] - 1).max()


# --- Without noise ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("decay_rate", [0.0, 2.0])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", BATTERY)
def test_poles_and_residues_of_every_known_system_are_exact_without_noise(name, kind, decay_rate):
    system = BATTERY[name]
    fit = refine(measured(system, kind=kind, decay_rate=decay_rate), disturbed(system.seen_poles, 1))
    assert fit.converged
    assert np.abs(fit.model.poles / system.seen_poles - 1).max() < EXACT
    residues = system.residues[list(system.seen)]
    assert np.abs(fit.model.residues - residues).max() < EXACT * np.abs(residues).max()
    assert fit.remarks == ()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", BATTERY)
def test_a_start_one_percent_off_in_frequency_and_a_factor_in_damping_leads_to_the_same_poles(name, seed):
    system = BATTERY[name]
    fit = refine(measured(system), disturbed(system.seen_poles, seed, freq=0.01, damping=2.5))
    assert np.abs(fit.model.poles / system.seen_poles - 1).max() < EXACT


def test_modes_outside_the_band_are_found_where_they_are():
    fit = refine(measured(OUT_OF_BAND), disturbed(OUT_OF_BAND.seen_poles, 2))
    found = np.sort(np.abs(fit.model.background_poles)) / (2 * np.pi)
    np.testing.assert_allclose(found, [1.5, 41.0, 66.0], rtol=1e-6)  # only their tails are in the band


def test_a_system_without_modes_outside_gets_none():
    for seed in range(3):
        fit = refine(measured(KUKA, noise=0.01, seed=seed), KUKA.poles)
        assert len(fit.model.background_poles) == 0


def test_given_background_poles_are_refined_as_well_and_without_any_the_tails_disturb():
    outside = np.delete(OUT_OF_BAND.poles, OUT_OF_BAND.seen)
    frfs = measured(OUT_OF_BAND)
    given = refine(frfs, OUT_OF_BAND.seen_poles, background=disturbed(outside, 3))
    assert np.abs(given.model.background_poles / outside - 1).max() < 1e-6
    none = refine(frfs, OUT_OF_BAND.seen_poles, background=None)
    assert len(none.model.background_poles) == 0
    assert none.residual > 1e3 * given.residual


def test_poles_that_grow_at_the_start_become_stable():
    fit = refine(KUKA.frfs(LINES_HZ), -KUKA.poles.conj())
    assert np.abs(fit.model.poles / KUKA.poles - 1).max() < EXACT


def test_few_steps_are_enough():
    assert refine(KUKA.frfs(LINES_HZ), disturbed(KUKA.poles, 1)).iterations <= 8
    assert refine(KUKA.frfs(LINES_HZ, noise=0.01), disturbed(KUKA.poles, 1)).iterations <= 8


# --- With noise ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("deviations", ["coherence", None])
@pytest.mark.parametrize("name", BATTERY)
def test_one_percent_of_noise_leaves_frequency_and_damping_within_what_is_asked(name, deviations):
    system = BATTERY[name]
    for seed in range(6):
        fit = refine(measured(system, noise=0.01, seed=seed), disturbed(system.seen_poles, seed), deviations=deviations)
        freq, damping = errors(fit.model.poles, system)
        assert fit.converged
        assert freq < FREQ
        assert damping < DAMPING


def test_the_close_modes_of_the_kuka_are_told_apart_in_a_hundred_of_a_hundred_draws():
    lines, found = LINES_HZ[::4], 0
    for seed in range(100):
        fit = refine(KUKA.frfs(lines, noise=0.01, seed=seed), disturbed(KUKA.poles, seed))
        freq, damping = errors(fit.model.poles, KUKA)
        found += freq < FREQ and damping < DAMPING
    assert found == 100


def test_refined_poles_are_those_of_a_joint_fit_by_scipy():
    frfs = COMPLEX.frfs(LINES_HZ[200:1700:10], noise=0.02, seed=5).select(outputs="tip.x", inputs=["tip.x", "tip.y"])
    sigma = np.random.default_rng(0).uniform(0.5, 2, frfs.values.shape) * 0.02 * np.abs(frfs.values).mean()
    fit = refine(frfs, COMPLEX.poles, deviations=sigma, background=None)
    s, scale = frfs.s[:, None], np.abs(COMPLEX.residues).max()

    def misfit(x):
        poles = x[:4] * np.abs(COMPLEX.poles) + 1j * x[4:8] * np.abs(COMPLEX.poles)
        H = []
        for pair in x[8:].reshape(2, 10):
            R = (pair[:4] + 1j * pair[4:8]) * scale
            rest = pair[8] * scale * 10 / s[:, 0] ** 2 + pair[9] * scale * 1e-2
            H.append((R / (s - poles) + R.conj() / (s - poles.conj())).sum(axis=1) + rest)
        left = (np.array(H).T * s**2 - frfs.values[:, 0]) / sigma[:, 0] * np.sqrt(2)
        return np.concatenate([left.real.ravel(), left.imag.ravel()])

    model, w = fit.model, np.abs(COMPLEX.poles)
    start = [model.poles.real / w, model.poles.imag / w]
    for i in range(2):
        R = model.residues[:, 0, i] / scale
        start += [R.real, R.imag, [model.lower[0, i] / scale / 10, model.upper[0, i] / scale / 1e-2]]
    best = least_squares(misfit, np.concatenate(start) * 1.0001, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    found = best.x[:4] * w + 1j * best.x[4:8] * w
    # Both stop where a step is a small part of a standard deviation, which is 1e-4 of a pole.
    np.testing.assert_allclose(model.poles, found, rtol=1e-7)
    covariance = np.linalg.inv(best.jac.T @ best.jac)[:8, :8] * np.outer(np.tile(w, 2), np.tile(w, 2))
    inflation = max(1.0, fit.residual**2)
    # The search drops what vanishes with the misfit from the Jacobian, not from the optimum; scipy differences.
    np.testing.assert_allclose(fit.covariance, covariance * inflation, atol=1e-4 * np.abs(covariance).max())


# --- What is said of doubtful modes -------------------------------------------------------------------------


def test_a_pole_in_noise_is_reported_and_not_dropped():
    extra = np.append(KUKA.poles, 2 * np.pi * 15 * (-0.01 + 1j))
    fit = refine(KUKA.frfs(LINES_HZ, noise=0.01, seed=1), extra)
    assert len(fit.model) == 5
    assert fit.significance[4] < 10 < 1e4 < fit.significance[:4].min()
    assert any("hardly stands out" in remark for remark in fit.remarks)
    assert errors(fit.model.poles[:4], KUKA)[0] < FREQ
    assert fit.energy_share[4] < 1e-4
    # Shares of modes apart add up but for what they have in common.
    assert 0.9 < fit.energy_share[:4].sum() < 1.1


def test_a_mode_that_is_missing_in_the_band_is_named():
    fit = refine(KUKA.frfs(LINES_HZ, noise=0.01), KUKA.poles[[0, 1, 3]])
    assert any("one more" in remark and "19" in remark for remark in fit.remarks)
    assert fit.residual > 10
    assert len(fit.model.background_poles) == 0


def test_two_poles_at_one_mode_are_reported():
    frfs = KUKA.frfs(LINES_HZ, noise=0.01, seed=2)
    fit = refine(frfs, np.append(KUKA.poles, KUKA.poles[0] * 1.01))
    assert any("hardly stands out" in remark or "came together" in remark for remark in fit.remarks)


def test_the_residual_is_one_standard_deviation_or_the_share_of_noise():
    frfs = KUKA.frfs(LINES_HZ, noise=0.01)
    known, unknown = refine(frfs, KUKA.poles), refine(frfs, KUKA.poles, deviations=None)
    assert known.noise_known
    assert not unknown.noise_known
    # 36 000 real values: half a percent; the coherence of 100 averages is read with 99 degrees of freedom.
    assert known.residual == pytest.approx(1.0, abs=0.02)
    assert unknown.residual == pytest.approx(0.01, rel=0.02)


# --- Sets with gaps -----------------------------------------------------------------------------------------


def test_gaps_lines_left_out_and_a_silent_pair_do_no_harm():
    frfs = KUKA.frfs(LINES_HZ)
    measured_pairs = np.array([[1, 0, 1], [1, 1, 1], [0, 1, 1]], bool)
    values = frfs.values.copy()
    values[:, 1, 1] = 0
    sigma = np.ones(values.shape)
    sigma[300:320, 0, 0] = np.inf
    values[300:320, 0, 0] = 50.0
    spoiled = replace(frfs, values=values, measured=measured_pairs)
    fit = refine(spoiled, disturbed(KUKA.poles, 3), deviations=sigma)
    assert np.abs(fit.model.poles / KUKA.poles - 1).max() < EXACT


def test_lines_half_a_hertz_apart_are_enough_under_an_exponential_window():
    # Half-power bandwidths are 0.19 to 0.38 Hz: no line need fall on a peak.
    frfs = KUKA.frfs(np.arange(0, 60.5, 0.5), decay_rate=2.0)
    assert np.abs(refine(frfs, disturbed(KUKA.poles, 4)).model.poles / KUKA.poles - 1).max() < EXACT
    noisy = KUKA.frfs(np.arange(0, 60.5, 0.5), noise=0.01, decay_rate=2.0)
    assert errors(refine(noisy, disturbed(KUKA.poles, 4)).model.poles, KUKA)[0] < FREQ


def test_real_modes_are_refined_with_half_the_residues():
    fit = refine(KUKA.frfs(LINES_HZ), disturbed(KUKA.poles, 5), real=True)
    assert np.abs(fit.model.poles / KUKA.poles - 1).max() < EXACT
    assert np.abs(fit.model.residues.real).max() == 0


def test_one_lightly_and_one_heavily_damped_mode_are_found_together():
    pair = KnownSystem((12.0, 13.0), (0.002, 0.05), np.array([[1.0, 0.4, -0.2], [0.3, 1.0, 0.5]]), (0, 1))
    fit = refine(pair.frfs(LINES_HZ), disturbed(pair.poles, 6, freq=0.01, damping=2.0))
    assert np.abs(fit.model.poles / pair.poles - 1).max() < EXACT


# --- Bad input ----------------------------------------------------------------------------------------------


def test_what_cannot_be_refined_is_refused_with_a_reason():
    frfs = KUKA.frfs(LINES_HZ)
    for poles, words in (([], "none"), ([1.0], "Im λ > 0"), ([-1 + 60j] * 2, "twice")):
        with pytest.raises(SignalError, match=words):
            refine(frfs, poles)
    with pytest.raises(SignalError, match="background"):
        refine(frfs, KUKA.poles, background="some")
    for deviations in ("noise", np.ones(5), np.zeros(frfs.values.shape), np.full(frfs.values.shape, np.nan)):
        with pytest.raises(FrfError, match="deviations"):
            refine(frfs, KUKA.poles, deviations=deviations)
    with pytest.raises(FrfError, match="more lines"):
        refine(frfs.lines([10, 500]), KUKA.poles)
