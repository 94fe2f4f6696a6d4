"""Fits from anywhere within the bounds find the minimum: peaks melt off the imaginary axis, where the way is clear."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

import armonic as am
from armonic.updating.smoothing import ladder, smoothed
from robot_files import START

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FINE_HZ = np.arange(1, 601) / 20
LADDER = (40.0, 20.0, 10.0, 5.0, 2.0)
KUKA, THREE_R, TABLE_4 = am.load("kuka_kr90"), am.load("huynh_3r"), am.load(START)
LINES_HZ = np.arange(1, 151) / 5


def mobility(s: Complex, freq_hz: float = 8.0, ratio: float = 0.05) -> Complex:
    """Of 1 kg on a spring and a damper, as one response, (L, 1, 1)."""
    omega = 2 * np.pi * freq_hz
    return (s / (s**2 + 2 * ratio * omega * s + omega**2))[:, None, None]


def measured(robot: am.Robot, freq_hz: Array = LINES_HZ) -> am.Frf:
    return am.frf(robot, "milling", freq_hz, frame="sensor")


def noisy(H: am.Frf, seed: int, noise: float) -> am.Frf:
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * (1 + noise * (real + 1j * imaginary)))


@pytest.mark.parametrize("sigma", LADDER)
def test_a_smoothed_response_is_the_response_off_the_axis(sigma: float) -> None:
    # 16 lines across the peak's half width of 2 ζ f = 0.8 Hz, so that the sum over lines is good to some 1e-4; above
    # the band of 30 Hz the mobility is not 1/ω but (1 + (8/30)²)/ω, which is 7 % of a tail that holds at most a tenth.
    found = smoothed(FINE_HZ, mobility(2j * np.pi * FINE_HZ), sigma)
    expected = mobility(sigma + 2j * np.pi * FINE_HZ)
    error = np.abs(found / expected - 1)
    assert error.max() < 0.01
    assert np.median(error) < 0.001


@pytest.mark.parametrize("sigma", LADDER)
def test_two_modes_are_smoothed_as_their_sum(sigma: float) -> None:
    # As above; the second mode, at 17 of 30 Hz, makes the tail wrong by (17/30)² = a third.
    def both(s: Complex) -> Complex:
        return mobility(s) - 0.3 * mobility(s, 17.0, 0.03)

    found = smoothed(FINE_HZ, both(2j * np.pi * FINE_HZ), sigma)
    expected = both(sigma + 2j * np.pi * FINE_HZ)
    assert np.abs(found - expected).max() < 0.03 * np.abs(expected).max()


def test_finer_lines_smooth_better() -> None:
    errors = []
    for lines_per_hz in (1, 2, 4, 8):
        f = np.arange(1, 30 * lines_per_hz + 1) / lines_per_hz
        expected = mobility(10.0 + 2j * np.pi * f)
        errors.append(float(np.abs(smoothed(f, mobility(2j * np.pi * f), 10.0) - expected)[: len(f) // 2].max()))
    assert errors[0] > 10 * errors[2]
    assert all(coarse >= fine for coarse, fine in pairwise(errors))


@pytest.mark.parametrize("sigma", [100.0, *LADDER])
def test_a_constant_stays_what_it_is_but_for_its_fall_above_the_band(sigma: float) -> None:
    # There it falls as 1/ω, by assumption. Poisson's integral of that by quadrature; on both sides of zero alike.
    lines, end, scale = 2 * np.pi * FINE_HZ, 2 * np.pi * FINE_HZ[-1], 3.7
    found = smoothed(FINE_HZ, np.full((len(lines), 1, 1), scale + 0j), sigma)[:, 0, 0]

    def missing(t: float, omega: float) -> float:  # t = ω_e/ω', so that the tail ends at zero
        at = end / t
        bells = sum(sigma / np.pi / ((omega - side * at) ** 2 + sigma**2) for side in (1, -1))
        return float((1 - t) * bells * end / t**2)

    for i in range(0, len(lines), 37):
        near = 1 - sigma / end  # where the bell has its share of the integrand, to help the quadrature
        lost = sum(quad(missing, *ends, args=(lines[i],), epsabs=1e-10)[0] for ends in ((0, near), (near, 1)))
        assert found[i] == pytest.approx(scale * (1 - lost), abs=2e-4 * scale)  # steps of 0.05 Hz and 32 nodes


@pytest.mark.parametrize("sigma", [1e-3, 0.1, 1.0])
@pytest.mark.parametrize("freq_hz", [np.geomspace(0.5, 30, 37), np.linspace(20, 30, 51), np.array([3.0, 4.0, 5.0])])
def test_a_bell_too_narrow_for_the_lines_is_a_mean_still(freq_hz: Array, sigma: float) -> None:
    flat = np.full((len(freq_hz), 2, 1), 3.7 + 0j)
    # Of the tail it takes less than σ over the distance to the band's end.
    short = sigma / (2 * np.pi * (freq_hz[-1] - freq_hz[:-1]))
    assert (np.abs(smoothed(freq_hz, flat, sigma)[:-1] / 3.7 - 1) <= short[:, None, None] + 1e-12).all()


@pytest.mark.parametrize("garbage", [np.nan, np.inf, 0.0, 1e30j])
def test_masked_values_are_bridged_whatever_they_hold(garbage: complex) -> None:
    used = np.random.default_rng(1).random((len(FINE_HZ), 1, 1)) > 0.1
    used[290:296] = False  # six lines in a row, a third of a hertz
    H = mobility(2j * np.pi * FINE_HZ)
    found = smoothed(FINE_HZ, np.where(used, H, garbage), 10.0, used)
    assert np.array_equal(found, smoothed(FINE_HZ, np.where(used, H, 1.0), 10.0, used))
    # Gaps of a few lines in a peak 16 lines wide: the sum over lines gets wider steps there.
    expected = mobility(10.0 + 2j * np.pi * FINE_HZ)
    assert np.abs(found / expected - 1).max() < 0.02


def test_every_response_is_bridged_by_its_own_mask() -> None:
    H = np.concatenate([mobility(2j * np.pi * FINE_HZ), mobility(2j * np.pi * FINE_HZ, 12.0)], axis=2)
    used = np.random.default_rng(2).random(H.shape) > 0.3
    used[:, 0, 1] = True
    both = smoothed(FINE_HZ, H, 5.0, used)
    assert np.array_equal(both[:, :, 1:], smoothed(FINE_HZ, H[:, :, 1:], 5.0, used[:, :, 1:]))
    assert np.array_equal(both[:, :, :1], smoothed(FINE_HZ, H[:, :, :1], 5.0, used[:, :, :1]))


def test_a_response_with_one_value_left_has_the_size_of_that() -> None:
    H, used = mobility(2j * np.pi * FINE_HZ).real + 0j, np.zeros((len(FINE_HZ), 1, 1), bool)
    used[-1] = True
    alone = smoothed(FINE_HZ, np.where(used, H, 0.0), 10.0, used)
    assert np.array_equal(alone, smoothed(FINE_HZ, np.where(used, H, np.nan), 10.0, used))
    np.testing.assert_allclose(alone, H[-1, 0, 0].real, rtol=0.6)  # it falls above the band, and may not be one


@pytest.mark.parametrize(
    "freq_hz",
    [
        LINES_HZ,
        np.arange(1, 61) / 2,
        np.arange(0, 61) / 2,
        np.linspace(8, 25, 40),
        np.geomspace(0.5, 200, 100),
        np.array([5.0, 5.5, 6.0, 6.5]),
    ],
)
def test_the_ladder_falls_and_ends_no_finer_than_the_lines_resolve(freq_hz: Array) -> None:
    rungs = ladder(freq_hz)
    spacing = 2 * np.pi * float(np.median(np.diff(freq_hz)))
    assert len(rungs) >= 2
    assert all(wide > 1.2 * narrow for wide, narrow in pairwise(rungs))
    assert rungs[0] <= 2 * np.pi * freq_hz[-1] / 4
    assert rungs[-1] >= 0.5 * spacing  # a bell narrower than that falls between two lines


def test_the_ladder_of_the_kuka_is_about_the_one_of_the_prototype() -> None:
    # 40, 20, 10, 5, 2 rad/s were good for lines to 30 Hz.
    np.testing.assert_allclose(ladder(LINES_HZ), LADDER, rtol=0.25)


@pytest.mark.parametrize("freq_hz", [np.zeros(0), np.array([5.0]), np.array([1.0, 2.0, 3.0])])
def test_few_lines_have_no_ladder(freq_hz: Array) -> None:
    assert ladder(freq_hz) == ()


def at_random(robot: am.Robot, rng: np.random.Generator) -> am.Robot:
    """A start drawn evenly, in the logarithms, from within the bounds of the file."""
    bounds = {path: robot.bounds(path) for path in robot.parameters()}
    return robot.with_values({p: float(np.exp(rng.uniform(*np.log(pair)))) for p, pair in bounds.items() if pair})


def test_the_kuka_is_found_from_anywhere_within_the_bounds_of_table_4() -> None:
    rng = np.random.default_rng(4)
    starts = [at_random(TABLE_4, rng) for _ in range(12)]
    truth, data = KUKA.parameters(), am.Measurement(measured(KUKA, np.arange(1, 61) / 2), "milling")
    fits = [am.update(start, data) for start in starts]
    assert [len(fit.parameters) for fit in fits] == [18] * 12
    assert max(fit.cost for fit in fits) < 1e-6
    assert max(abs(p.value / truth[p.path] - 1) for fit in fits for p in fit.parameters) < 1e-4
    # One run each, nearly: what finds the minimum is the ladder, and not the tries from elsewhere that may follow.
    assert sum(len(fit.starts) > 1 for fit in fits) <= 2
    plain = [am.update(start, data, method="least_squares") for start in starts]
    assert sum(fit.cost > 1.0 for fit in plain) >= 4


def test_the_three_axis_robot_is_found_from_anywhere_within_a_decade() -> None:
    rng, truth, H = np.random.default_rng(3), THREE_R.parameters(), measured(THREE_R)
    data = am.Measurement(H, "milling", weights=am.peak_weights(H, peak_gain=50.0))
    starts = [THREE_R.with_values({p: v * 10 ** rng.uniform(-1, 1) for p, v in truth.items()}) for _ in range(20)]
    fits = [am.update(start, data) for start in starts]
    assert max(fit.cost for fit in fits) < 1e-6
    assert max(abs(p.value / truth[p.path] - 1) for fit in fits for p in fit.parameters) < 1e-6
    assert {len(fit.starts) for fit in fits} == {1}
    plain = [am.update(start, data, method="least_squares") for start in starts]
    assert sum(fit.cost > 1.0 for fit in plain) >= 2


def test_with_two_percent_noise_the_kuka_fit_ends_as_low_from_anywhere_as_from_the_truth() -> None:
    rng = np.random.default_rng(5)
    data = am.Measurement(noisy(measured(KUKA), 5, 0.02), "milling")
    bounds = {path: TABLE_4.bounds(path) for path in TABLE_4.parameters()}
    from_truth = am.update(KUKA, data, bounds={p: pair for p, pair in bounds.items() if pair})
    costs = [am.update(at_random(TABLE_4, rng), data).cost for _ in range(6)]
    assert max(costs) < 1.01 * from_truth.cost


def test_the_stages_go_down_the_ladder_to_the_cost_that_was_asked_for() -> None:
    start = at_random(TABLE_4, np.random.default_rng(6))
    data = am.Measurement(measured(KUKA), "milling")
    fit = am.update(start, data)
    sigmas = [stage.sigma for stage in fit.stages]
    assert tuple(sigmas[:-2]) == ladder(LINES_HZ)
    assert sigmas[-2:] == [0.0, 0.0]
    assert [stage.name for stage in fit.stages][-2:] == ["levelled", "cost"]
    for stage in fit.stages:
        assert (np.diff(stage.history) <= 0).all()
    assert fit.stages[-1].history[-1] == pytest.approx(fit.cost, rel=1e-12)  # two sums of the same
    assert fit.evaluations == len(fit.cost_history) == sum(len(stage.history) for stage in fit.stages)
    even = am.update(start, am.Measurement(data.frf, "milling", weights="uniform"))
    assert [stage.name for stage in even.stages].count("levelled") == 0  # which would be the same again
    plain = am.update(start, data, method="least_squares")
    assert [stage.name for stage in plain.stages] == ["cost"]


def test_the_cost_that_is_reported_is_that_of_the_robot_that_is_returned() -> None:
    data = am.Measurement(noisy(measured(KUKA), 1, 0.02), "milling")
    fit = am.update(at_random(TABLE_4, np.random.default_rng(7)), data)
    weights = data.line_weights()
    modelled = measured(fit.robot)
    ratio = modelled.values / data.frf.values
    by_hand = np.sum(weights * (np.log(np.abs(ratio)) ** 2 + np.angle(ratio) ** 2))
    # Values are rounded to twelve digits; the cost is at its minimum, so that it feels that by the square.
    assert fit.cost == pytest.approx(by_hand, rel=1e-9)
