"""Vector autoregression against least squares by LAPACK, systems with known poles and shapes, and closed forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.errors import SignalError
from armonic.identification import autoregressive, regression
from armonic.identification.autoregressive import companion_poles, poles_of, vector_autoregression
from armonic.identification.poles import ModelPoles, damping_ratio, natural_freq_hz
from armonic.identification.regression import Regression
from known_systems import Array, Complex, KnownSystem, chain, close_pair, likeness, nearest, pole, system, twisted

SYSTEMS = {"a chain of masses": chain(), "two modes 1 % apart": close_pair(), "damped, complex shapes": twisted()}


@pytest.fixture(params=SYSTEMS)
def known(request: pytest.FixtureRequest) -> KnownSystem:
    return SYSTEMS[request.param]


def lagged(values: Array, order: int) -> Array:
    """[lag 1 | … | lag p] over the rows k = p … N−1."""
    return np.hstack([values[order - j : len(values) - j] for j in range(1, order + 1)])


def least_squares(values: Array, order: int) -> tuple[Array, Array]:
    """Coefficients (p, m, m) and residuals by numpy's least squares, of channels scaled to like size."""
    m, unit = values.shape[1], values.std(axis=0)
    rows, ends = lagged(values / unit, order), values[order:] / unit
    stacked = np.linalg.lstsq(rows, ends, rcond=None)[0]
    coefficients = stacked.reshape(order, m, m).transpose(0, 2, 1)
    return unit[:, None] * coefficients / unit, unit * (ends - rows @ stacked)


def physical(fit: regression.Autoregression) -> Array:
    """The coefficients of the samples as they were given."""
    return fit.scale[:, None] * fit.coefficients / fit.scale


# --- The fit ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [regression.ROWS, 20])  # in one piece and in several
@pytest.mark.parametrize("channels", [1, 3])
def test_every_order_is_the_least_squares_fit_of_all_rows_it_can_use(channels, rows, monkeypatch):
    monkeypatch.setattr(regression, "ROWS", rows)
    values = chain(channels).response(400, 1, noise=0.3) * np.geomspace(1e-6, 1e3, channels)
    factorized = Regression(values, 15)
    for order in range(1, 16):
        fit = factorized.fit(order)
        coefficients, residuals = least_squares(values, order)
        likes = values.std(axis=0) / values.std(axis=0)[:, None]
        # Rounding of channels of like size, times the condition of the lags, some 1e2.
        np.testing.assert_allclose(physical(fit) * likes, coefficients * likes, rtol=0, atol=1e-12)
        left = residuals.T @ residuals / (400 - order - channels * order)
        np.testing.assert_allclose(fit.residual_covariance * np.outer(fit.scale, fit.scale), left, rtol=1e-10)
        gram = lagged(values / fit.scale, order)
        np.testing.assert_allclose(fit.triangle.T @ fit.triangle, gram.T @ gram, atol=1e-14)  # of unit norm
        assert fit.rows == 400 - order


def test_the_largest_order_has_as_many_equations_as_unknowns_and_fits_them_exactly():
    values = np.random.default_rng(3).normal(size=(40, 3))
    fit = Regression(values, 10).fit(10)
    residuals = values[10:] - lagged(values, 10) @ physical(fit).transpose(0, 2, 1).reshape(30, 3)
    assert np.abs(residuals).max() < 1e-10  # 30 random equations have a condition of some 1e3
    (found,) = vector_autoregression(values, 1.0, orders=(10, 10), deviations=True)
    assert np.isfinite(found.poles).all()
    assert np.isnan(found.freq_std_hz).all()  # nothing is left to judge them by


# --- Poles and shapes ---------------------------------------------------------------------------------------


def test_poles_and_shapes_of_a_noise_free_decay_are_found_at_every_order_that_holds_them(known):
    values = known.decay(600)
    for found in vector_autoregression(values, known.sample_rate_hz, orders=range(4, 31)):
        at = nearest(found.poles, known.poles)
        # Rounding of the samples, 1e-16, over the share of a mode's smallest trace in them.
        np.testing.assert_allclose(found.poles[at], known.poles, rtol=1e-7)
        np.testing.assert_allclose(natural_freq_hz(found.poles)[at], known.natural_freq_hz, rtol=1e-7)
        np.testing.assert_allclose(damping_ratio(found.poles)[at], known.damping_ratio, atol=1e-7)
        np.testing.assert_allclose(likeness(found.shapes[at], known.shapes), 1, atol=1e-10)


def test_poles_are_sorted_and_shapes_have_unit_length_and_a_positive_largest_entry(known):
    values = known.response(800, 5)
    for found in vector_autoregression(values, known.sample_rate_hz, orders=(2, 8)):
        assert (np.diff(natural_freq_hz(found.poles)) >= 0).all()
        assert (found.poles.imag >= 0).all()
        np.testing.assert_allclose(np.linalg.norm(found.shapes, axis=1), 1, rtol=1e-12)
        largest = np.take_along_axis(found.shapes, np.abs(found.shapes).argmax(axis=1)[:, None], axis=1)
        np.testing.assert_allclose(largest.imag, 0, atol=1e-15)
        assert (largest.real > 0).all()


def test_every_order_has_all_its_eigenvalues_once_and_shapes_that_solve_the_polynomial(known):
    values = known.response(800, 6, noise=0.01)
    m = values.shape[1]
    for found in vector_autoregression(values, known.sample_rate_hz, orders=(1, 8)):
        coefficients, _ = least_squares(values, found.order)
        companion = np.eye(m * found.order, k=-m)
        companion[:m] = np.hstack(list(coefficients))
        mu = np.exp(found.poles / known.sample_rate_hz)
        eigenvalues = np.linalg.eigvals(companion)
        eigenvalues = eigenvalues[eigenvalues.imag >= 0]
        assert len(mu) == len(eigenvalues)
        np.testing.assert_allclose(mu[nearest(mu, eigenvalues)], eigenvalues, rtol=1e-7)
        for z, shape in zip(mu, found.shapes, strict=True):
            powers = z ** np.arange(found.order - 1, -1, -1)
            terms = z**found.order * np.eye(m) - np.einsum("j,jab->ab", powers, coefficients)
            assert np.linalg.norm(terms @ shape) < 1e-9 * np.linalg.norm(terms)


@pytest.mark.parametrize("order", [1, 2, 7])
def test_a_single_channel_has_the_roots_of_its_polynomial(order):
    values = chain(1).response(300, 2, noise=0.1)
    coefficients, _ = least_squares(values, order)
    roots = np.roots(np.r_[1, -coefficients[:, 0, 0]])
    (found,) = vector_autoregression(values, 100.0, orders=(order, order))
    mu = np.exp(found.poles / 100.0)
    kept = roots[roots.imag >= 0]
    assert len(mu) == len(kept)
    np.testing.assert_allclose(mu[nearest(mu, kept)], kept, rtol=1e-9)


def test_the_poles_of_a_random_response_come_within_one_percent_of_the_truth():
    known = chain()
    # Sampled forces leave a moving average, which takes more lags than the four modes would.
    for found in vector_autoregression(known.response(20_000, 7), known.sample_rate_hz, orders=range(16, 25, 4)):
        at = nearest(found.poles, known.poles)
        # At best, 200 s of 6 to 19 Hz at 1 to 4 % give √(ζ / (4π f T)) = 0.1 % of f and √(ζ / (2π f T)) = 0.14 % of
        # damping as standard deviation; of this many coefficients twice that, of which four are allowed.
        np.testing.assert_allclose(natural_freq_hz(found.poles)[at], known.natural_freq_hz, rtol=0.008)
        np.testing.assert_allclose(damping_ratio(found.poles)[at], known.damping_ratio, atol=0.011)
        assert (likeness(found.shapes[at], known.shapes) > 0.98).all()


def test_an_order_gives_the_same_poles_alone_as_in_a_range_however_the_range_is_given():
    values = close_pair().response(500, 8)
    together = vector_autoregression(values, 100.0, orders=range(2, 12))
    assert [one.order for one in together] == list(range(2, 12))
    for alone, same in zip(vector_autoregression(values, 100.0, orders=range(3, 12, 4)), together[1::4], strict=True):
        np.testing.assert_allclose(alone.poles, same.poles, rtol=1e-6)  # condition of a pole times that of the lags
    for pair, same in zip(vector_autoregression(values, 100.0, orders=(2, 11)), together, strict=True):
        np.testing.assert_allclose(pair.poles, same.poles, rtol=1e-12)


def test_units_of_the_channels_change_shapes_and_nothing_else():
    known = twisted()
    units = np.array([1e9, 1e-12, 3.0])
    values = known.response(600, 9)
    plain = vector_autoregression(values, 200.0, orders=(3, 9))
    scaled = vector_autoregression(values * units, 200.0, orders=(3, 9))
    for a, b in zip(plain, scaled, strict=True):
        # Rounding of 1e-16 times the conditions of lags and of a pole.
        np.testing.assert_allclose(b.poles, a.poles, rtol=1e-7)
        np.testing.assert_allclose(likeness(b.shapes / units, a.shapes), 1, atol=1e-9)


# --- What poles can be --------------------------------------------------------------------------------------


def test_a_mode_that_dies_within_four_samples_is_found_at_every_order_up_to_forty():
    # 80.6 % of damping near half the sampling rate: |μ| = 0.0134, as the last mode of the Scompi robot at 1 kHz.
    shapes = np.random.default_rng(1).normal(size=(4, 4))
    known = system([(6, 0.02), (9, 0.05), (40, 0.03), (850.8, 0.806)], shapes, sample_rate_hz=1000.0)
    fast = np.log(known.discrete[3]) * 1000.0
    if fast.imag < 0:
        fast = fast.conjugate()
    for found in vector_autoregression(known.decay(800), 1000.0, orders=(2, 40)):
        at = nearest(found.poles, np.array([fast]))
        # Its last trace above rounding, |μ|⁷, is the seventh sample: each pole rests on differences that small.
        np.testing.assert_allclose(found.poles[at], [fast], rtol=1e-4)
        np.testing.assert_allclose(likeness(found.shapes[at], known.shapes[3:]), 1, atol=1e-4)


@pytest.mark.parametrize("tool", [{}, {"tool.mass": 4.0}])
def test_all_twelve_modes_of_the_scompi_robot_are_in_a_decay_of_its_motors_at_1_khz(tool):
    modes = am.modes(am.load("scompi").with_values(tool), "c8")
    motors = [i for i, name in enumerate(modes.coordinates) if name.endswith(".motor")]
    known = KnownSystem(modes.poles, modes.shapes[motors].T, 1000.0)
    folded = np.log(known.discrete) * 1000.0
    folded = folded.real + 1j * np.abs(folded.imag)
    for found in vector_autoregression(known.decay(2800), 1000.0, orders=range(4, 41, 4)):
        at = nearest(found.poles, folded)
        # To rounding times the condition of a pole; the last one lives in seven samples, |μ|⁷ = 1e-13.
        np.testing.assert_allclose(found.poles[at[:-1]], folded[:-1], rtol=1e-8)
        np.testing.assert_allclose(found.poles[at[-1]], folded[-1], rtol=5e-3)
        assert (likeness(found.shapes[at], known.shapes) > 1 - 1e-6).all()


def test_a_mode_above_half_the_sampling_rate_stands_at_the_frequency_it_is_aliased_to():
    known = system([(8, 0.01), (70, 0.01)], [[1, 0.5], [-0.5, 1]], sample_rate_hz=100.0)
    (found,) = vector_autoregression(known.decay(300), 100.0, orders=(2, 2))
    true = pole(70, 0.01)
    np.testing.assert_allclose(found.poles[1], true.real + 1j * (2 * np.pi * 100 - true.imag), rtol=1e-8)


def test_an_offset_is_carried_by_a_pole_at_zero_frequency_and_moves_no_mode():
    known = close_pair()
    values = known.decay(500) + np.array([3.0, -1.0, 0.5])
    for found in vector_autoregression(values, known.sample_rate_hz, orders=(4, 12)):
        at = nearest(found.poles, np.r_[known.poles, 0])
        np.testing.assert_allclose(found.poles[at], np.r_[known.poles, 0], rtol=1e-6, atol=1e-6)
        assert np.isfinite(damping_ratio(found.poles)).all()


def test_a_real_pole_is_kept_as_one_and_a_growing_one_too():
    rates = np.array([-4.0 + 0j, 1.5 + 0j, 2 * np.pi * (0.02 + 9j)])
    known = KnownSystem(rates, np.array([[1.0, 0.3, 0], [0.2, 1, 0.4], [0.1, 0.5j, 1]], complex), 100.0)
    (found,) = vector_autoregression(known.decay(200), 100.0, orders=(2, 2))
    at = nearest(found.poles, rates)
    np.testing.assert_allclose(found.poles[at], rates, rtol=1e-8)
    assert (found.poles.imag[at[:2]] == 0).all()
    assert (damping_ratio(found.poles)[at] < 0).tolist() == [False, True, True]


def test_a_sign_that_changes_at_every_sample_is_a_pole_at_half_the_sampling_rate():
    values = ((-0.8) ** np.arange(60))[:, None]
    (found,) = vector_autoregression(values, 50.0, orders=(1, 1))
    np.testing.assert_allclose(found.poles, [50 * np.log(0.8) + 50j * np.pi], rtol=1e-12)


def test_a_channel_that_repeats_another_leaves_the_poles_finite_and_right():
    known = close_pair()
    values = known.decay(400)
    doubled = np.column_stack([values, 2 * values[:, 0], values[:, 1] - values[:, 2]])
    for found in vector_autoregression(doubled, known.sample_rate_hz, orders=(2, 15)):
        at = nearest(found.poles, known.poles)
        np.testing.assert_allclose(found.poles[at], known.poles, rtol=1e-7)
        assert np.isfinite(found.shapes).all()
        # The copies are coefficients of the same shape.
        np.testing.assert_allclose(found.shapes[at, 3], 2 * found.shapes[at, 0], atol=1e-6)


def test_samples_that_end_in_exact_zeros_give_finite_poles():
    values = np.zeros((300, 2))
    values[:40] = chain(2).decay(40)
    for found in vector_autoregression(values, 100.0, orders=(1, 20)):
        assert np.isfinite(found.poles).all()
        assert np.isfinite(found.shapes).all()
    values[1:] = 0.0  # one sample that nothing follows: no motion at all
    for found in vector_autoregression(values, 100.0, orders=(1, 3)):
        assert np.isfinite(found.shapes).all()


# --- What is asked for --------------------------------------------------------------------------------------


def test_shapes_are_given_in_the_band_and_poles_everywhere():
    values = chain().response(600, 11)
    whole = vector_autoregression(values, 100.0, orders=(3, 6))
    for found, full in zip(vector_autoregression(values, 100.0, orders=(3, 6), band_hz=(5, 15)), whole, strict=True):
        np.testing.assert_allclose(found.poles, full.poles, rtol=1e-12)
        inside = (natural_freq_hz(found.poles) >= 5) & (natural_freq_hz(found.poles) <= 15)
        assert 0 < inside.sum() < len(inside)
        np.testing.assert_allclose(found.shapes[inside], full.shapes[inside], rtol=1e-9, atol=1e-12)
        assert np.isnan(found.shapes[~inside]).all()


def test_deviations_are_given_when_asked_for_in_the_band_and_none_otherwise():
    values = chain().response(600, 11)
    (plain,) = vector_autoregression(values, 100.0, orders=(4, 4))
    assert plain.freq_std_hz is None
    assert plain.damping_std is None
    (found,) = vector_autoregression(values, 100.0, orders=(4, 4), band_hz=(1, 15), deviations=True)
    inside = (natural_freq_hz(found.poles) >= 1) & (natural_freq_hz(found.poles) <= 15)
    assert found.freq_std_hz is not None
    assert found.damping_std is not None
    np.testing.assert_array_equal(np.isfinite(found.freq_std_hz), inside)
    np.testing.assert_array_equal(np.isfinite(found.damping_std), inside)


def twice(poles: Complex) -> Complex:
    """One pair of poles stands twice, another is missing."""
    complex_ones = np.flatnonzero(poles.imag > 0)
    first, second = poles[complex_ones[:2]]
    poles[(poles == second) | (poles == second.conj())] = [first, first.conj()]
    return poles


def flat(poles: Complex) -> Complex:
    """One pair of poles has lost its imaginary part, which leaves the sum as it was."""
    pair = poles[np.argmax(poles.imag)]
    poles[(poles == pair) | (poles == pair.conj())] = pair.real
    return poles


@pytest.mark.parametrize("change", [twice, flat])
def test_where_the_iteration_reports_no_convergence_or_lacks_a_pole_lapack_answers(change, monkeypatch):
    fits = Regression(chain().response(400, 12), 4)
    coefficients = [fits.fit(order).coefficients for order in (2, 3, 4)]
    right = [companion_poles(matrices)[::-1] for matrices in coefficients]
    given = [np.full_like(right[0], 7.0), right[1], change(right[2].copy())]
    stub: Any = SimpleNamespace(polynomial_eigenvalues=lambda _: (given, [9, 9, 9], [False, True, True]))
    monkeypatch.setattr(autoregressive, "_core", stub)
    poles = poles_of(coefficients)
    np.testing.assert_array_equal(poles[1], right[1])
    np.testing.assert_array_equal(poles[2], companion_poles(coefficients[2]))
    # Characteristic polynomial, whose zeros they are.
    for mu in poles[0]:
        matrix = mu**2 * np.eye(4) - mu * coefficients[0][0] - coefficients[0][1]
        assert np.linalg.svd(matrix, compute_uv=False)[-1] < 1e-12


def test_a_set_of_poles_says_its_order_and_size():
    found = vector_autoregression(chain(2).response(100, 1), 100.0, orders=(2, 2))[0]
    assert isinstance(found, ModelPoles)
    assert repr(found) == f"ModelPoles(order 2, {len(found)} poles over 2 channels)"


GOOD = chain(2).response(50, 13)
NOT_FINITE, CONSTANT = GOOD.copy(), GOOD.copy()
NOT_FINITE[[7, 9], 1] = np.nan
CONSTANT[:, 0] = 2.5


@pytest.mark.parametrize(
    ("values", "changes", "where", "found", "expected"),
    [
        (GOOD, {"orders": (2, 17)}, "orders", "order 17 for 50 samples of 2 channels", "at most 16"),
        (GOOD[:2], {"orders": (1, 1)}, "orders", "order 1 for 2 samples", "at least 3 samples"),
        (GOOD, {"orders": (0, 4)}, "orders", "(0, 4)", "ascending positive integers"),
        (GOOD, {"orders": (5, 3)}, "orders", "(5, 3)", "ascending positive integers"),
        (GOOD, {"orders": range(9, 2, -1)}, "orders", "range(9, 2, -1)", "ascending positive integers"),
        (GOOD, {"orders": range(0)}, "orders", "range(0, 0)", "ascending positive integers"),
        (GOOD, {"orders": (1, 2, 3)}, "orders", "(1, 2, 3)", "the first and last order"),
        (GOOD, {"orders": (1.0, 2.0)}, "orders", "(1.0, 2.0)", "ascending positive integers"),
        (GOOD, {"orders": 5}, "orders", "5", "ascending positive integers"),
        (GOOD, {"band_hz": (9.0, 3.0)}, "band_hz", "(9.0, 3.0)", "low < high"),
        (GOOD, {"band_hz": 5.0}, "band_hz", "5.0", "(low, high) in Hz"),
        (GOOD, {"sample_rate_hz": 0.0}, "sample_rate_hz", "0.0", "a positive number, Hz"),
        (GOOD, {"sample_rate_hz": np.nan}, "sample_rate_hz", "nan", "a positive number, Hz"),
        (NOT_FINITE, {}, "values, channel 1, sample 7", "nan (2 such values in all)", "finite numbers"),
        (CONSTANT, {}, "values, channel 0", "the same value, 2.5, in every sample", "a signal"),
        (GOOD[:, 0], {}, "values", "an array of shape (50,)", "(samples, channels)"),
        (GOOD[:0], {}, "values", "an array of shape (0, 2)", "(samples, channels)"),
        (GOOD + 0j, {}, "values", "complex numbers", "real numbers"),
        ("abc", {}, "values", "a str", "real numbers"),
    ],
)
def test_a_request_that_makes_no_sense_is_refused_with_the_reason(values, changes, where, found, expected):
    with pytest.raises(SignalError) as caught:
        vector_autoregression(values, **{"sample_rate_hz": 100.0, "orders": (1, 4), **changes})
    assert caught.value.where == where
    assert found in caught.value.found
    assert expected in caught.value.expected
