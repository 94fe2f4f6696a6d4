"""What the data determine: principal directions in words, bands of responses and modes, profile likelihood."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from armonic.updating.bands import predictive_covariance
from armonic.updating.parameters import Parameter
from robot_files import START

Array = NDArray[np.float64]

FREQ_HZ = np.arange(1, 61) / 2
THREE_R = am.load("huynh_3r")
KUKA = am.load("kuka_kr90")
ELSEWHERE = [0.4, 0.9, -1.2]


def measured(robot: am.Robot, noise: float, seed: int = 1) -> am.Measurement:
    H = am.frf(robot, "milling", FREQ_HZ, frame="sensor")
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return am.Measurement(
        replace(H, values=H.values * (1 + noise * (real + 1j * imaginary))), "milling", weights="uniform"
    )


@pytest.fixture(scope="module")
def three() -> am.Fit:
    return am.update(THREE_R, measured(THREE_R, 0.03))


@pytest.fixture(scope="module")
def kuka() -> am.Fit:
    return am.update(am.load(START), measured(KUKA, 0.01))


def named(*links: str) -> tuple[Parameter, ...]:
    paths = [f"links.{link}.elasticity.z.stiffness" for link in links]
    return tuple(Parameter(path, (path,), "N m/rad", 1.0, 1e-3, 1e3, indices=(i,)) for i, path in enumerate(paths))


def of_information(information: Array, *links: str) -> Any:
    return SimpleNamespace(information=information, coordinates=named(*links))


def test_directions_are_the_eigenvectors_of_the_information_and_their_words_say_product_or_ratio() -> None:
    # The product of a and b is known to 1 %, their ratio to a factor; of c nothing is known.
    rise, trade = np.array([1, 1, 0]) / np.sqrt(2), np.array([1, -1, 0]) / np.sqrt(2)
    information = np.outer(rise, rise) / 0.01**2 + np.outer(trade, trade) / 0.5**2
    stiff, sloppy, blind = am.directions(of_information(information, "a", "b", "c"))
    assert (stiff.deviation, sloppy.deviation, blind.deviation) == pytest.approx((0.01, 0.5, np.inf))
    np.testing.assert_allclose([abs(stiff.weights @ rise), abs(sloppy.weights @ trade)], 1, rtol=1e-9)
    # exp(1.96 · 0.5/√2) = 2.0
    # The product moves with both: 1.96 · 0.01 · √2 = 2.81 %.
    assert stiff.words.startswith("the product of ")
    assert stiff.words.endswith(" is known to 2.8 %")
    assert " trades against " in sloppy.words
    assert sloppy.words.endswith(", by a factor of 2.0 either way; their product is known to 2.8 %")
    for told in (stiff.words, sloppy.words):
        assert {"a.z", "b.z"} <= set(told.split())
    assert blind.words == "c.z stiffness is open: the data say nothing"


def test_one_parameter_alone_is_called_known_or_open() -> None:
    stiff, sloppy = am.directions(of_information(np.diag([1 / 0.02**2, 1 / 0.8**2]), "a", "b"))
    assert stiff.words == "a.z stiffness is known to 4.0 %"  # exp(1.96 · 0.02) = 1.040
    assert sloppy.words == "b.z stiffness is open by a factor of 4.8 either way"  # exp(1.96 · 0.8) = 4.80


def test_correlations_are_those_of_the_covariance_and_no_number_where_a_variance_is_infinite() -> None:
    covariance = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.inf]])
    nan = np.nan
    np.testing.assert_array_equal(am.correlation(covariance), [[1, 0.5, nan], [0.5, 1, nan], [nan, nan, 1]])


def test_the_kuka_says_which_dampings_the_milling_posture_leaves_open(kuka: am.Fit) -> None:
    sloppiest = am.directions(kuka)[-3:]
    text = " ".join(direction.words for direction in sloppiest)
    assert all(direction.deviation > 1 for direction in sloppiest)
    assert "link_arm.x damping" in text
    assert "carousel.z damping" in text
    assert "stiffness" not in text


@pytest.mark.parametrize("posture", ["milling", ELSEWHERE])
def test_bands_are_the_percentiles_of_responses_and_modes_of_robots_drawn_from_the_covariance(
    three: am.Fit, posture: Any
) -> None:
    rng, draws = np.random.default_rng(5), 800
    C = predictive_covariance(three)
    x0 = np.array([p.coordinate(f.value) for p, f in zip(three.coordinates, three.parameters, strict=True)])
    sizes, angles, natural, damping = [], [], [], []
    model = am.linearize(three.robot, posture)
    for x in rng.multivariate_normal(x0, C, draws):
        values = {p.path: p.value(v) for p, v in zip(three.coordinates, x, strict=True)}
        spring, damper = (
            np.array([values[f"{name}.{quantity}"] for name in model.impedances])
            for quantity in ("stiffness", "damping")
        )
        drawn = model.with_impedances(spring, damper)
        H = am.frf(drawn, None, FREQ_HZ[::7], frame="sensor").values
        sizes.append(np.abs(H))
        angles.append(np.angle(H))
        modes = am.modes(drawn)
        natural.append(modes.natural_freq_hz)
        damping.append(modes.damping_ratio)
    bands = am.frf_bands(three, posture, FREQ_HZ[::7])
    inside = (np.array(sizes) >= bands.low) & (np.array(sizes) <= bands.high)
    # 800 draws of 95 % scatter by 0.8 %; all values of one response are the same draws, so no averaging helps.
    np.testing.assert_allclose(inside.mean(axis=0), 0.95, atol=0.03)
    turn = np.angle(np.exp(1j * (np.array(angles) - np.angle(bands.frf.values))))
    np.testing.assert_allclose((np.abs(turn) <= bands.phase_deviation).mean(axis=0), 0.95, atol=0.03)
    intervals = am.modal_intervals(three, posture)
    for drawn_values, interval in ((natural, intervals.natural_freq_hz), (damping, intervals.damping_ratio)):
        held = (np.array(drawn_values) >= interval[:, 0]) & (np.array(drawn_values) <= interval[:, 1])
        np.testing.assert_allclose(held.mean(axis=0), 0.95, atol=0.03)


def test_in_the_measured_band_the_kuka_is_known_though_dampings_are_open_and_beyond_it_is_not(kuka: am.Fit) -> None:
    inside, beyond = (am.frf_bands(kuka, "milling", freq_hz) for freq_hz in (FREQ_HZ, np.arange(60, 76, 0.5)))
    assert np.median(inside.high / inside.low) < 1.02
    assert np.max(inside.high / inside.low) < 1.25
    assert np.max(beyond.high / beyond.low) > 2
    intervals = am.modal_intervals(kuka, "milling")
    width = intervals.natural_freq_hz[:, 1] / intervals.natural_freq_hz[:, 0]
    assert (width[:4] < 1.001).all()  # the four modes in the band
    assert width[4:].max() > 1.02
    ratio = intervals.damping_ratio[:, 1] / intervals.damping_ratio[:, 0]
    assert (ratio[:4] < 1.05).all()
    assert ratio[4:].max() > 1.5


def test_where_the_residual_is_nearly_linear_the_profile_ends_where_the_interval_does(three: am.Fit) -> None:
    for parameter in three.parameters:
        found = am.profile(three, parameter.path)
        # Student's t for some thousand degrees of freedom, squared: 1.962² in every table.
        assert found.threshold == pytest.approx(3.849, abs=0.01)
        low, high = (np.log(end / parameter.value) for end in parameter.interval)
        np.testing.assert_allclose(np.log(np.array(found.interval) / parameter.value), [low, high], rtol=0.05)
        assert found.rise.min() == 0
        assert (np.diff(found.values) > 0).all()


def test_the_profile_of_what_the_data_do_not_see_is_flat_to_its_bounds(kuka: am.Fit) -> None:
    path = "links.link_arm.elasticity.x.damping"
    found = am.profile(kuka, path)
    parameter = next(p for p in kuka.parameters if p.path == path)
    assert parameter.verdict in ("not identifiable", "at bound")
    below = found.rise[found.values <= parameter.value]
    assert below.max() < 0.2 * found.threshold
    assert found.interval[0] in (0.0, parameter.lower)


def test_a_profile_needs_a_fitted_parameter_and_noise(three: am.Fit) -> None:
    with pytest.raises(am.UpdateError, match=r"profile: found 'arm.z', expected a fitted parameter"):
        am.profile(three, "arm.z")
