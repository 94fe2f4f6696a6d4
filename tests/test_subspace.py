"""Covariance-driven subspace identification against systems with known poles and shapes, and an independent route."""

from __future__ import annotations

import numpy as np
import pytest

from armonic.errors import SignalError
from armonic.identification.poles import damping_ratio, natural_freq_hz
from armonic.identification.subspace import covariance_ssi
from known_systems import Array, Complex, KnownSystem, chain, close_pair, likeness, nearest, twisted

SYSTEMS = {"a chain of masses": chain(), "two modes 1 % apart": close_pair(), "damped, complex shapes": twisted()}


@pytest.fixture(params=SYSTEMS)
def known(request: pytest.FixtureRequest) -> KnownSystem:
    return SYSTEMS[request.param]


def test_poles_and_shapes_of_a_noise_free_decay_are_exact_at_every_number_of_states_that_holds_them(known):
    states = 2 * len(known.poles)
    for found in covariance_ssi(known.decay(800), known.sample_rate_hz, orders=(states, 30), block_rows=20):
        at = nearest(found.poles, known.poles)
        # Products of samples carry rounding of 1e-16 over the square of the weakest trace, some 1e-4.
        np.testing.assert_allclose(found.poles[at], known.poles, rtol=1e-6)
        np.testing.assert_allclose(natural_freq_hz(found.poles)[at], known.natural_freq_hz, rtol=1e-6)
        np.testing.assert_allclose(damping_ratio(found.poles)[at], known.damping_ratio, atol=1e-6)
        np.testing.assert_allclose(likeness(found.shapes[at], known.shapes), 1, atol=1e-9)


def test_a_decay_that_has_not_ended_is_identified_as_exactly_as_one_that_has():
    known = close_pair()  # at 10 Hz and 0.5 %, 1.2 s take no more than 30 % of the amplitude
    (found,) = covariance_ssi(known.decay(120), 100.0, orders=(6, 6), block_rows=15)
    np.testing.assert_allclose(found.poles[nearest(found.poles, known.poles)], known.poles, rtol=1e-6)


def reference(values: Array, states: int, block_rows: int) -> Complex:
    """Poles μ by the balanced realization of one order, from a Hankel matrix of covariances and a pseudo-inverse."""
    length, m = len(values) - 2 * block_rows + 1, values.shape[1]
    lag = [values[tau : tau + length].T @ values[:length] / length for tau in range(2 * block_rows)]
    hankel = np.block([[lag[1 + r + c] for c in range(block_rows)] for r in range(block_rows)])
    left, size, _ = np.linalg.svd(hankel)
    observed = left[:, :states] * np.sqrt(size[:states])
    return np.linalg.eigvals(np.linalg.pinv(observed[:-m]) @ observed[m:])


@pytest.mark.parametrize("states", [2, 6, 14])
def test_every_number_of_states_gives_the_poles_of_a_realization_made_for_it_alone(known, states):
    values = known.response(3000, 1, noise=0.01)
    values = values / np.linalg.norm(values, axis=0)
    mu = reference(values, states, 12)
    wanted = mu[(mu.imag >= 0) & (np.abs(mu) > 1e-12)]
    models = covariance_ssi(values, known.sample_rate_hz, orders=range(2, 17, 2), block_rows=12)
    found = np.exp(models[states // 2 - 1].poles / known.sample_rate_hz)
    assert len(found) == len(wanted)
    np.testing.assert_allclose(found[nearest(found, wanted)], wanted, atol=1e-8)


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_closely_spaced_modes_are_told_apart_in_a_random_response_also_under_noise(noise):
    known = close_pair()
    estimates = []
    for seed in range(8):
        values = known.response(30_000, [3, seed], noise=noise)
        (found,) = covariance_ssi(values, known.sample_rate_hz, orders=(16, 16), block_rows=60)
        at = nearest(found.poles, known.poles)
        assert len(set(at.tolist())) == 3
        # Shapes of a close pair mix in the ratio of a pole's error, 0.1 rad/s or so, to their distance, 0.66.
        assert (likeness(found.shapes[at], known.shapes) > 0.9).all()
        estimates.append([natural_freq_hz(found.poles)[at] / known.natural_freq_hz, damping_ratio(found.poles)[at]])
    values = np.array(estimates)
    # At best a mode of damping ζ gives √(ζ / (4π f T)) = 0.04 % of f and √(ζ / (2π f T)) = 0.05 % of damping in 300 s.
    # Lags of 1.2 s see a third of the decay; the method, which is not efficient, may take six times the best.
    scatter = values.std(axis=0, ddof=1)
    best = np.sqrt(known.damping_ratio / (4 * np.pi * known.natural_freq_hz * 300))
    assert (scatter[0] < 6 * best).all()
    assert (scatter[1] < 6 * np.sqrt(2) * best).all()
    # The mean of 8 lies within four of its own deviations of the truth.
    error = values.mean(axis=0) - [np.ones(3), known.damping_ratio]
    assert (np.abs(error) < 4 * scatter / np.sqrt(8)).all()


def test_units_of_the_channels_change_shapes_and_nothing_else():
    known = twisted()
    units = np.array([1e9, 1e-12, 3.0])
    values = known.response(2000, 9)
    plain = covariance_ssi(values, 200.0, orders=(8, 14), block_rows=10)
    scaled = covariance_ssi(values * units, 200.0, orders=(8, 14), block_rows=10)
    for a, b in zip(plain, scaled, strict=True):
        np.testing.assert_allclose(b.poles, a.poles, rtol=1e-7)  # rounding times conditions
        np.testing.assert_allclose(likeness(b.shapes / units, a.shapes), 1, atol=1e-9)


def test_two_numbers_of_states_stand_for_every_second_one_between():
    values = chain(2).response(500, 1)
    given = covariance_ssi(values, 100.0, orders=(4, 9), block_rows=8)
    assert [one.order for one in given] == [4, 6, 8]
    assert [one.order for one in covariance_ssi(values, 100.0, orders=range(3, 6), block_rows=8)] == [3, 4, 5]
    assert all(one.freq_std_hz is None and one.damping_std is None for one in given)


def test_shapes_are_given_in_the_band_and_poles_everywhere():
    values = chain().response(3000, 11)
    arguments = {"orders": (8, 12), "block_rows": 10}
    whole = covariance_ssi(values, 100.0, **arguments)
    for found, full in zip(covariance_ssi(values, 100.0, band_hz=(5, 15), **arguments), whole, strict=True):
        np.testing.assert_allclose(found.poles, full.poles, rtol=1e-12)
        inside = (natural_freq_hz(found.poles) >= 5) & (natural_freq_hz(found.poles) <= 15)
        assert 0 < inside.sum() < len(inside)
        np.testing.assert_allclose(found.shapes[inside], full.shapes[inside], rtol=1e-9, atol=1e-12)
        assert np.isnan(found.shapes[~inside]).all()


def test_a_record_without_independent_channels_gives_finite_poles_and_the_modes():
    known = close_pair()
    values = known.decay(400)
    doubled = np.column_stack([values, 2 * values[:, 0]])
    for found in covariance_ssi(doubled, 100.0, orders=(6, 40), block_rows=16):
        at = nearest(found.poles, known.poles)
        np.testing.assert_allclose(found.poles[at], known.poles, rtol=1e-6)
        assert np.isfinite(found.shapes).all()


GOOD = chain(2).response(60, 13)
NOT_FINITE = GOOD.copy()
NOT_FINITE[5, 0] = np.inf


@pytest.mark.parametrize(
    ("values", "changes", "where", "found", "expected"),
    [
        (GOOD, {"block_rows": 1}, "block_rows", "1", "an integer from 2 up"),
        (GOOD, {"block_rows": 4.0}, "block_rows", "4.0", "an integer from 2 up"),
        (GOOD, {"block_rows": 16}, "block_rows", "16 block rows for 60 samples of 2 channels", "at most 15"),
        (GOOD, {"orders": (2, 12)}, "orders", "12 states from 6 block rows of 2 channels", "at most 10 states"),
        (GOOD, {"orders": (0, 4)}, "orders", "(0, 4)", "ascending positive integers"),
        (GOOD, {"band_hz": (4.0, 4.0)}, "band_hz", "(4.0, 4.0)", "low < high"),
        (GOOD, {"sample_rate_hz": -1.0}, "sample_rate_hz", "-1.0", "a positive number, Hz"),
        (NOT_FINITE, {}, "values, channel 0, sample 5", "inf (1 such values in all)", "finite numbers"),
    ],
)
def test_a_request_that_makes_no_sense_is_refused_with_the_reason(values, changes, where, found, expected):
    with pytest.raises(SignalError) as caught:
        covariance_ssi(values, **{"sample_rate_hz": 100.0, "orders": (2, 4), "block_rows": 6, **changes})
    assert caught.value.where == where
    assert found in caught.value.found
    assert expected in caught.value.expected
