"""Standard deviations of autoregressive poles against Monte Carlo, a closed form and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from armonic.identification.autoregressive import companion_poles, vector_autoregression
from armonic.identification.deviations import pole_deviations
from armonic.identification.poles import damping_ratio, natural_freq_hz
from armonic.identification.regression import Regression
from known_systems import Array, KnownSystem, chain, close_pair, nearest, system

DRAWS = 200
# Of 200 draws the empirical deviation scatters by 1/√400 = 5 % about the true one; three of those.
RATIO = 0.15

BENT = [[1.0, 0.6j, -0.3], [0.4, -1.0, 0.5 + 0.3j], [0.2j, 0.5, 1.0]]
EXACT = {
    "close modes": close_pair(),
    "complex shapes, up to 30 % of damping": system(
        [(6, 0.3), (11, 0.05), (31, 0.1)], BENT, sample_rate_hz=100.0
    ),
}  # fmt: skip


def draws(known: KnownSystem, records: list[Array], order: int) -> tuple[Array, Array]:
    """Estimates of (frequency, damping), (draws, 2, modes), and their predicted deviations."""
    estimates, predicted = [], []
    for values in records:
        (found,) = vector_autoregression(values, known.sample_rate_hz, orders=(order, order), deviations=True)
        at = nearest(found.poles, known.poles)
        assert len(set(at.tolist())) == len(at)
        estimates.append([natural_freq_hz(found.poles)[at], damping_ratio(found.poles)[at]])
        assert found.freq_std_hz is not None
        assert found.damping_std is not None
        predicted.append([found.freq_std_hz[at], found.damping_std[at]])
    return np.array(estimates), np.array(predicted)


@pytest.mark.parametrize("order", [2, 5])  # as many lags as the truth has, and more
@pytest.mark.parametrize("name", EXACT)
def test_predicted_deviations_are_those_of_two_hundred_records_of_an_autoregression(name, order):
    known = EXACT[name]
    covariance = np.array([[1.0, 0.3, 0.0], [0.3, 2.0, -0.5], [0.0, -0.5, 0.5]])
    records = known.autoregressive_responses(DRAWS, 6000, 17, covariance)  # 60 s, in which 0.1 Hz are told apart
    estimates, predicted = draws(known, list(records), order)
    np.testing.assert_allclose(predicted.mean(axis=0) / estimates.std(axis=0, ddof=1), 1, atol=RATIO)
    # No more than a small bias beside the scatter: 95 % of the intervals of two deviations hold the truth, within 5 %.
    truth = np.array([known.natural_freq_hz, known.damping_ratio])
    covered = (np.abs(estimates - truth) < 1.96 * predicted).mean(axis=0)
    assert (covered > 0.88).all()


def test_predicted_deviations_are_those_of_two_hundred_responses_of_a_structure_to_white_forces():
    known = chain(3)
    records = [known.response(3000, [DRAWS, seed]) for seed in range(DRAWS)]
    estimates, predicted = draws(known, records, 16)
    np.testing.assert_allclose(predicted.mean(axis=0) / estimates.std(axis=0, ddof=1), 1, atol=RATIO)


def test_one_channel_and_one_lag_have_the_deviation_of_the_textbook():
    # y_k = a y_(k−1) + e_k has var(a) = (1 − a²) / N (Hamilton 1994, section 5.2), and f = −log(a) · rate / 2π.
    a, rate, n = 0.9, 50.0, 100_000
    rng = np.random.default_rng(5)
    values = np.zeros((n, 1))
    for k in range(1, n):
        values[k] = a * values[k - 1] + rng.normal()
    (found,) = vector_autoregression(values, rate, orders=(1, 1), deviations=True)
    assert found.freq_std_hz is not None
    assert found.damping_std is not None
    # The estimate of a, and with it the right side, is off by 1/√N of itself.
    assert found.freq_std_hz[0] == pytest.approx(np.sqrt((1 - a**2) / n) / a * rate / (2 * np.pi), rel=0.02)
    assert found.damping_std[0] == pytest.approx(0, abs=1e-15)


def test_deviations_are_the_finite_differences_of_the_poles_through_the_coefficients():
    known = close_pair()
    fit = Regression(known.response(500, 3, noise=0.02), 4).fit(3)
    p, m = fit.order, 3
    mu = companion_poles(fit.coefficients)
    mu = mu[mu.imag > 0]

    def read(coefficients: Array) -> Array:
        poles = np.log(companion_poles(coefficients).astype(complex)) * 100.0
        poles = poles[nearest(poles, np.log(mu) * 100.0)]
        return np.array([natural_freq_hz(poles), damping_ratio(poles)])

    step = 1e-6
    slopes = np.empty((2, len(mu), p, m, m))
    for index in np.ndindex(p, m, m):
        change = np.zeros((p, m, m))
        change[index] = step
        slopes[(slice(None), slice(None), *index)] = (
            read(fit.coefficients + change) - read(fit.coefficients - change)
        ) / (2 * step)
    gram = np.linalg.inv(fit.triangle.T @ fit.triangle).reshape(p, m, p, m)
    # Cov(A_j[a, b], A_l[c, d]) = Σ_e[a, c] (XᵀX)⁻¹[(j, b), (l, d)].
    spread = np.einsum("skjab,ac,jbld,sklcd->sk", slopes, fit.residual_covariance, gram, slopes)
    freq_std, damping_std = pole_deviations(fit, mu, 100.0)
    # Second-order terms of the differences, and their rounding.
    np.testing.assert_allclose([freq_std, damping_std], np.sqrt(spread), rtol=1e-5)


def test_no_pole_has_no_deviation():
    fit = Regression(close_pair().response(100, 3), 2).fit(2)
    freq_std, damping_std = pole_deviations(fit, np.zeros(0, complex), 100.0)
    assert freq_std.shape == damping_std.shape == (0,)


def test_deviations_of_a_noise_free_decay_are_finite_and_next_to_nothing_for_its_modes():
    known = chain(3)
    for found in vector_autoregression(known.decay(300), 100.0, orders=(2, 20), deviations=True):
        assert found.freq_std_hz is not None
        assert found.damping_std is not None
        at = nearest(found.poles, known.poles)
        assert (found.freq_std_hz[at] < 1e-8 * known.natural_freq_hz).all()
        assert (found.damping_std[at] < 1e-8).all()


@pytest.mark.parametrize("order", [1, 60])
def test_poles_far_inside_and_outside_the_unit_circle_have_finite_deviations(order):
    # High powers of |μ| = 0.004 and of |μ| = 300 lie beyond the range of numbers.
    fit = Regression(chain(2).response(300, 1, noise=0.1), order).fit(order)
    freq_std, damping_std = pole_deviations(fit, np.array([0.004 + 0j, 300 + 0j, 0.002 + 0.003j]), 100.0)
    assert not np.isnan(freq_std).any()
    assert not np.isnan(damping_std).any()
