"""What is said of the uncertainty of values, frequencies and damping ratios, against what many draws scatter by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armonic.frf_set import FrfSet
from armonic.identification.line_deviations import line_deviations
from armonic.identification.refinement import pole_spread, refine
from measured_systems import BAND, KUKA, LINES_HZ, OUT_OF_BAND

DRAWS = 200
SCATTER = 0.16  # a standard deviation of 200 draws is known to 5 %; the worst of eight stays within three times that
LINES, COARSE = LINES_HZ[::2], LINES_HZ[::4]


def estimated(H, forces, noise, rng):
    """H1 and its coherence of responses to given forces, (hits,), with white noise on each response."""
    shape = (len(forces), *H.shape)
    Y = forces.reshape(-1, *[1] * H.ndim) * H
    Y = Y + noise * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    F = forces.reshape(-1, *[1] * H.ndim)
    cross, power = (F * Y).mean(axis=0), (F**2).mean()
    return cross / power, np.abs(cross) ** 2 / (power * (np.abs(Y) ** 2).mean(axis=0))


def tap_test(system, hits, noise, seed, lines=LINES):
    """Accelerances of a system from a few hits of different strength."""
    rng = np.random.default_rng(seed)
    clean = system.frfs(lines)
    H, coherence = estimated(clean.values, rng.uniform(0.7, 1.3, hits), noise, rng)
    averages = np.full(H.shape[1:], hits)
    return replace(clean, values=H, coherence=np.clip(coherence, 0, 1), averages=averages)


def figures(fit):
    return (
        np.concatenate([fit.model.natural_freq_hz, fit.model.damping_ratio]),
        np.concatenate([fit.freq_std_hz, fit.damping_std]),
    )


def drawn(make, poles, draws=DRAWS, **options):
    """Frequencies and damping ratios of many draws, and their stated standard deviations, (draws, 2m) each."""
    return (np.array(x) for x in zip(*(figures(refine(make(k), poles, **options)) for k in range(draws)), strict=True))


def truth(system):
    size = np.abs(system.seen_poles)
    return np.concatenate([size / (2 * np.pi), -system.seen_poles.real / size])


def agree(values, stated, expected):
    typical = np.sqrt((stated**2).mean(axis=0))
    np.testing.assert_allclose(values.std(axis=0), typical, rtol=SCATTER)
    # No bias beyond what so many draws show: their mean scatters by 1/√draws, here four times that.
    assert (np.abs(values.mean(axis=0) - expected) < 4 * typical / np.sqrt(len(values))).all()
    covered = (np.abs(values - expected) < 1.96 * stated).mean()
    # 1600 intervals, some of them correlated: 95 % to within 2.
    assert covered == pytest.approx(0.95, abs=0.02)


# --- Modes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("deviations", ["coherence", None])
def test_modes_of_the_kuka_scatter_as_stated(deviations):
    values, stated = drawn(
        lambda seed: KUKA.frfs(COARSE, noise=0.01, seed=seed), KUKA.poles * 1.001, deviations=deviations
    )
    agree(values, stated, truth(KUKA))


def test_modes_under_an_exponential_window_scatter_as_stated():
    values, stated = drawn(lambda seed: KUKA.frfs(COARSE, noise=0.01, seed=seed, decay_rate=2.0), KUKA.poles * 1.001)
    agree(values, stated, truth(KUKA))


def test_modes_beside_others_outside_the_band_scatter_as_stated():
    values, stated = drawn(
        lambda seed: OUT_OF_BAND.frfs(COARSE, noise=0.01, seed=seed).band(*BAND),
        OUT_OF_BAND.seen_poles,
        deviations=None,
        draws=100,
    )
    typical = np.sqrt((stated**2).mean(axis=0))
    # Seven percent each, of 100 draws; three times that.
    np.testing.assert_allclose(values.std(axis=0), typical, rtol=0.22)


def test_five_hits_on_a_point_state_what_their_modes_scatter_by():
    values, stated = drawn(lambda seed: tap_test(KUKA, 5, 0.1, seed, COARSE), KUKA.poles * 1.001)
    agree(values, stated, truth(KUKA))


def test_noise_below_what_a_coherence_resolves_is_stated_larger_and_never_smaller():
    # At the peaks 1 − γ² lies below 1e-7, which takes its place there.
    values, stated = drawn(lambda seed: tap_test(KUKA, 5, 0.003, seed, COARSE), KUKA.poles * 1.001, draws=60)
    # Nine percent each, of 60 draws; three times that.
    assert (values.std(axis=0) < 1.27 * np.sqrt((stated**2).mean(axis=0))).all()
    assert (np.abs(values - truth(KUKA)) < 1.96 * stated).mean() > 0.95


def test_noise_that_differs_from_line_to_line_is_weighed_by_its_coherence():
    # Force and so precision fall by thirty from the first line to the last, as the spectrum of a soft hammer does.
    sigma = (0.002 * 30 ** (COARSE / COARSE[-1]))[:, None, None]
    clean = KUKA.frfs(COARSE)

    def make(seed):
        rng = np.random.default_rng(seed)
        shape = clean.values.shape
        noise = sigma * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
        coherence = 1 / (1 + 99 * sigma**2 / np.abs(clean.values + noise) ** 2)
        return replace(clean, values=clean.values + noise, coherence=coherence, averages=np.full(shape[1:], 100))

    values, stated = drawn(make, KUKA.poles, draws=100)
    np.testing.assert_allclose(values.std(axis=0), np.sqrt((stated**2).mean(axis=0)), rtol=0.22)
    blind, told = drawn(make, KUKA.poles, draws=100, deviations=None)
    # Least squares with the right weights is best (Gauss, Markov), up to what 100 draws, the same for both, leave open.
    assert (values.std(axis=0) < 1.1 * blind.std(axis=0)).all()
    # The lowest modes lie where the noise is least: of 300 draws their frequencies scatter by 0.60 and 0.69 of it.
    assert (values.std(axis=0)[:2] < 0.85 * blind.std(axis=0)[:2]).all()
    # And where noise is taken to be alike at all lines, it is stated too large where there is little.
    assert (told.mean(axis=0)[:2] > 1.5 * blind.std(axis=0)[:2]).all()


def test_deviations_that_are_too_small_for_the_misfit_are_made_larger():
    frfs = KUKA.frfs(LINES, noise=0.01, seed=1)
    true = line_deviations(frfs)
    right, wrong = (refine(frfs, KUKA.poles, deviations=true * factor) for factor in (1, 0.1))
    assert wrong.residual == pytest.approx(10 * right.residual)
    # The misfit takes the place of what is stated; it was one to a percent before.
    np.testing.assert_allclose(wrong.freq_std_hz, right.freq_std_hz, rtol=0.03)
    larger = refine(frfs, KUKA.poles, deviations=true * 10)
    np.testing.assert_allclose(larger.freq_std_hz, 10 * right.freq_std_hz, rtol=0.03)


def test_the_spread_of_frequency_and_damping_is_that_of_drawn_poles():
    poles = np.array([-2 + 60j, -0.3 + 150j])
    root = np.random.default_rng(0).normal(size=(4, 4)) * 1e-3
    covariance = root @ root.T
    draws = np.random.default_rng(1).multivariate_normal(np.r_[poles.real, poles.imag], covariance, size=100_000)
    moved = draws[:, :2] + 1j * draws[:, 2:]
    freq, damping = pole_spread(poles, covariance)
    # 100 000 draws: a quarter of a percent.
    np.testing.assert_allclose(freq, np.abs(moved).std(axis=0) / (2 * np.pi), rtol=0.01)
    np.testing.assert_allclose(damping, (-moved.real / np.abs(moved)).std(axis=0), rtol=0.01)


# --- Lines --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("hits", [2, 3, 5, 10, 100])
def test_a_value_scatters_by_what_its_coherence_says_however_few_the_hits(hits, smooth):
    clean = KUKA.frfs(LINES[::5])
    rng = np.random.default_rng(hits)
    draws, found, stated = 150, [], []
    forces = rng.uniform(0.7, 1.3, hits)
    for _ in range(draws):
        H, coherence = estimated(clean.values, forces, 0.05, rng)
        frfs = replace(clean, values=H, coherence=np.clip(coherence, 0, 1), averages=np.full((3, 3), hits))
        found.append(np.abs(H - clean.values) ** 2)
        stated.append(line_deviations(frfs, smooth=smooth) ** 2)
    # The variance of the mean of n hits of known force; stated of 150 draws times 1800 values, one percent at most.
    exact = 0.05**2 / (forces**2).sum()
    assert np.mean(found) == pytest.approx(exact, rel=0.01)
    assert np.mean(stated) == pytest.approx(exact, rel=0.015)


def test_smoothing_makes_the_variances_of_few_hits_steady():
    frfs = tap_test(KUKA, 3, 0.05, 0)
    rough, smooth = (line_deviations(frfs, smooth=s) ** 2 for s in (False, True))
    # Two complex degrees of freedom are χ² of four: it scatters by 1/√2 of its mean, nine lines together by a third of
    # that.
    assert (rough.std(axis=0) / rough.mean(axis=0)).mean() == pytest.approx(2**-0.5, rel=0.1)
    assert (smooth.std(axis=0) / smooth.mean(axis=0)).mean() == pytest.approx(2**-0.5 / 3, rel=0.15)


def test_many_hits_and_noise_far_below_give_the_books_formula():
    values, coherence = np.full((4, 1, 1), 2 + 1j), np.full((4, 1, 1), 0.98)
    frfs = FrfSet(np.arange(1.0, 5), values, "mobility", ("a.x",), ("b.x",), coherence=coherence, averages=[[10_001]])
    found = line_deviations(frfs)
    # Bendat and Piersol: standard deviation of |H| is |H| √((1 − γ²) / (2 n γ²)), a √2 below that of both parts.
    book = np.sqrt(5 * 0.02 / (2 * 10_000 * 0.98))
    np.testing.assert_allclose(found / np.sqrt(2), book, rtol=1e-12)


def test_several_forces_at_once_share_the_noise_of_their_response():
    rng = np.random.default_rng(5)
    H, hits, draws = np.array([[[2 + 1j, 0.3 - 0.5j]]]), 60, 2000
    F = rng.standard_normal((draws, hits, 2)) + 1j * rng.standard_normal((draws, hits, 2))
    noise = 0.4 * (rng.standard_normal((draws, hits)) + 1j * rng.standard_normal((draws, hits)))
    Y = F @ H[0, 0] + noise
    power = np.einsum("dhi,dhj->dij", F.conj(), F)
    found = np.linalg.solve(power, np.einsum("dhi,dh->di", F.conj(), Y)[:, :, None])[:, :, 0]
    left = (np.abs(Y - np.einsum("dhi,di->dh", F, found)) ** 2).sum(axis=1)
    multiple = 1 - left / (np.abs(Y) ** 2).sum(axis=1)
    stated = []
    for h, gamma in zip(found, multiple, strict=True):
        frfs = FrfSet(
            [1.0], h[None, None], "mobility", ("a.x",), ("b.x", "b.y"),
            coherence=np.full((1, 1, 2), gamma), averages=[[hits, hits]],
        )  # fmt: skip
        stated.append(line_deviations(frfs)[0, 0] ** 2)
    # The forces of one draw are not quite alike: (FᴴF)⁻¹ exceeds 1/n by 2/n; 2000 draws know a variance to 2 %.
    np.testing.assert_allclose(np.mean(stated, axis=0), (np.abs(found - H[0, 0]) ** 2).mean(axis=0), rtol=0.1)


def test_nothing_is_known_without_coherence_or_averages_or_of_a_single_hit():
    frfs = tap_test(KUKA, 3, 0.05, 0)
    assert line_deviations(replace(frfs, coherence=None)) is None
    assert line_deviations(replace(frfs, averages=None)) is None
    one = np.full((3, 3), 3)
    one[2, 1] = 1
    assert line_deviations(replace(frfs, averages=one)) is None
    assert not refine(replace(frfs, averages=one), KUKA.poles).noise_known
    # A pair that was not measured needs no hits.
    measured = one > 1
    assert np.isinf(line_deviations(replace(frfs, averages=one, measured=measured))[:, 2, 1]).all()


def test_values_without_coherence_count_for_nothing_and_perfect_ones_have_a_floor():
    frfs = tap_test(KUKA, 100, 0.05, 0)
    coherence = frfs.coherence.copy()
    coherence[10, 0, 0], coherence[11, 0, 0] = 0.0, 1.0
    sigma = line_deviations(replace(frfs, coherence=coherence))
    assert np.isinf(sigma[10, 0, 0])
    # Single precision resolves 1 − γ² to 1e-7.
    assert sigma[11, 0, 0] == pytest.approx(np.sqrt(1e-7 / 99) * abs(frfs.values[11, 0, 0]))
