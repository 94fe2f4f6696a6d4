"""Profile likelihood against separate fits with the parameter held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armonic as am

FREQ_HZ = np.arange(1, 61) / 2
PATH = "links.arm.elasticity.z.damping"


@pytest.fixture(scope="module")
def fit() -> am.Fit:
    """Under the paper's weights, which a profile leaves aside."""
    robot = am.load("huynh_3r")
    H = am.frf(robot, "milling", FREQ_HZ, frame="sensor")
    real, imaginary = np.random.default_rng(2).standard_normal((2, *H.values.shape))
    return am.update(
        robot, am.Measurement(replace(H, values=H.values * np.exp(0.02 * (real + 1j * imaginary))), "milling")
    )


def test_a_profile_is_the_cost_of_fits_with_the_parameter_held_over_the_noise(fit: am.Fit) -> None:
    found = am.profile(fit, PATH)
    data = [replace(m, weights="uniform") for m in fit.measurements]
    least = am.update(fit.robot, data).cost
    for value, rise in list(zip(found.values, found.rise, strict=True))[::4]:
        held = am.update(fit.robot, data, hold={PATH: float(value)}, method="least_squares")
        # Costs of some thousand squares, each settled to 1e-9, leave 1e-5 of a rise of order one.
        assert rise == pytest.approx((held.cost - least) / fit.noise**2, abs=1e-3)
    assert found.unit == "N m s/rad"


def test_the_ends_of_a_profile_s_interval_lie_on_the_threshold(fit: am.Fit) -> None:
    found = am.profile(fit, PATH)
    data = [replace(m, weights="uniform") for m in fit.measurements]
    least = am.update(fit.robot, data).cost
    for end in found.interval:
        held = am.update(fit.robot, data, hold={PATH: end}, method="least_squares")
        # √rise is interpolated between steps of a quarter of the half width.
        assert (held.cost - least) / fit.noise**2 == pytest.approx(found.threshold, rel=0.02)


def test_a_profile_of_a_fit_to_modes_rises_by_its_stated_deviations() -> None:
    robot = am.load("huynh_3r")
    modes = am.modes(robot, "milling")
    measured = am.ModalMeasurement("milling", 1.001 * modes.natural_freq_hz, modes.damping_ratio, freq_deviation=0.01)
    fit = am.update(robot, measured, parameters="stiffness")
    found = am.profile(fit, "links.arm.elasticity.z.stiffness")
    parameter = next(p for p in fit.parameters if p.path == found.path)
    low, high = (np.log(end / parameter.value) for end in found.interval)
    # Three frequencies and three stiffnesses, nearly linear within a few percent; the deviations are known, so normal.
    np.testing.assert_allclose([low, high], [-1.96 * parameter.deviation, 1.96 * parameter.deviation], rtol=0.1)
