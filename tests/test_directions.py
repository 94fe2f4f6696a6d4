"""Stiff and sloppy directions on robots whose trades are known, and how alike responses are."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from armonic.updating.directions import sloppy
from armonic.updating.parameters import Parameter
from models import robot_of, spring

FREQ_HZ = np.linspace(5.0, 60.0, 56)
PARALLEL = ["links.cart.elasticity.tx.stiffness", "bushings.mount.stiffness.x"]
NAN = np.nan


def cart(joint: float = 1e6, mount: float = 1e6) -> am.Robot:
    """10 kg on a slide along x, held by the joint's spring and by a bushing beside it: only their sum has effects."""
    link = {"name": "cart", "parent": "base", "joint": {"type": "prismatic", "axis": "x"}, "mass": 10.0}
    bushing = {
        "name": "mount",
        "between": ["base", "cart"],
        "stiffness": [mount, 0, 0, 0, 0, 0],
        "damping": [30.0, 0, 0, 0, 0, 0],
    }
    links = [link | {"elasticity": {"tx": spring(joint, 200.0)}}]
    return robot_of(links, frames=[{"name": "tip", "link": "cart"}], bushings=[bushing], postures={"home": [0.0]})


def noisy(H: am.Frf, noise: float, seed: int = 0) -> am.Frf:
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * np.exp(noise * (real + 1j * imaginary)))


def fit_to_sum(joint: float, mount: float, noise: float) -> am.Fit:
    robot = cart(joint, mount)
    H = am.frf(robot, "home", FREQ_HZ, frame="tip", outputs="x", inputs="x")
    data = am.Measurement(noisy(H, noise), "home")
    return am.update(
        robot, data, parameters=PARALLEL, method="least_squares"
    )  # which leaves alone what it does not see


@pytest.mark.parametrize("noise", [1e-2, 1e-12])
def test_springs_side_by_side_trade_without_end_at_any_noise_and_their_product_is_known(noise: float) -> None:
    fit = fit_to_sum(1e6, 1e6, noise)
    stiff, blind = am.directions(fit)
    # ln(k1 + k2) moves by k1/(k1 + k2) ∂x1 + k2/(k1 + k2) ∂x2.
    shares = np.array([p.value for p in fit.parameters])
    np.testing.assert_allclose(stiff.weights, shares / np.linalg.norm(shares), rtol=1e-6)
    assert np.isinf(blind.deviation)
    assert np.abs(blind.weights @ stiff.weights) < 1e-12
    assert " trades against " in blind.words
    assert "the data do not see it; " in blind.words
    assert {"cart.tx", "mount.x"} <= set(blind.words.split())


def test_equal_springs_have_a_product_that_is_known() -> None:
    stiff, blind = am.directions(fit_to_sum(1e6, 1e6, 1e-12))
    known = stiff.words.removeprefix("the product of cart.tx stiffness and mount.x stiffness is known to ")
    # ln k1 + ln k2 is √2 along the unit direction.
    assert float(known.split()[0]) == pytest.approx(100 * 1.96 * 2**0.5 * stiff.deviation, rel=0.05)
    assert blind.words.endswith(f"; their product is known to {known}")


def test_the_known_combination_of_unequal_springs_has_their_shares_as_exponents() -> None:
    fit = fit_to_sum(3e6, 1e6, 0.01)
    _, blind = am.directions(fit)
    joint, mount = (p.value for p in fit.parameters)
    words = blind.words.split("; ")[1]
    first, second = words.split(" is known")[0].split(" × ")
    assert {first, second.split("^")[0]} == {"cart.tx stiffness", "mount.x stiffness"}
    power = joint / mount if first.startswith("mount") else mount / joint
    assert float(second.split("^")[1]) == pytest.approx(power, rel=0.05)  # two digits


def test_what_no_response_depends_on_is_a_direction_of_its_own() -> None:
    information = np.diag([1e8, 0.0, 1e4])
    *_, blind = am.directions(of(information, "stiffness", "stiffness", "stiffness"))
    np.testing.assert_array_equal(np.abs(blind.weights), [0, 1, 0])
    assert np.isinf(blind.deviation)
    assert len(am.directions(of(np.zeros((2, 2)), "stiffness", "damping"))) == 2


def of(information: NDArray[np.float64], *quantities: str) -> am.Fit:
    paths = [f"links.{chr(97 + i)}.elasticity.z.{quantity}" for i, quantity in enumerate(quantities)]
    parameters = tuple(Parameter(path, (path,), "", 1.0, 1e-3, 1e3) for path in paths)
    return SimpleNamespace(information=information, coordinates=parameters)  # type: ignore[return-value]


def test_directions_are_orthonormal_ordered_and_give_the_information_back() -> None:
    rng = np.random.default_rng(4)
    J = rng.standard_normal((40, 6)) * 10.0 ** np.arange(6)
    found = am.directions(of(J.T @ J, *["damping"] * 6))
    weights = np.array([d.weights for d in found])
    deviations = np.array([d.deviation for d in found])
    np.testing.assert_allclose(weights @ weights.T, np.eye(6), atol=1e-12)
    assert (np.diff(deviations) > 0).all()
    np.testing.assert_allclose(1 / deviations, np.linalg.svd(J, compute_uv=False), rtol=1e-6)
    assert [d.deviation for d in sloppy(found)] == [d for d in deviations[::-1] if d * 1.96 > 0.3]


def test_a_number_that_may_be_zero_is_known_in_its_unit() -> None:
    path = "links.arm.com.x"
    coordinate = Parameter(path, (path,), "m", 0.1, -0.1, 0.3, "linear", 0.02)
    fit = SimpleNamespace(information=np.array([[1 / 0.5**2]]), coordinates=(coordinate,))
    (direction,) = am.directions(fit)  # type: ignore[arg-type]
    assert direction.words == "arm.com.x is known to ± 0.020 m"  # 1.96 · 0.5 · 0.02


def test_open_parameters_have_no_correlation_with_others() -> None:
    covariance = np.array([[np.inf, 0.0, 0.0], [0.0, 4.0, -3.0], [0.0, -3.0, 9.0]])
    np.testing.assert_array_equal(am.correlation(covariance), [[1, NAN, NAN], [NAN, 1, -0.5], [NAN, -0.5, 1]])
    np.testing.assert_array_equal(am.correlation(np.zeros((2, 2))), [[1, NAN], [NAN, 1]])


def test_frac_is_one_for_multiples_zero_for_responses_apart_and_that_of_the_closed_form() -> None:
    f = np.linspace(1.0, 2.0, 5)

    def response(*columns: object) -> am.Frf:
        return am.Frf(f, np.array(columns, complex).T[:, :, None], "mobility", ("x", "y"), ("x",))

    here, there = [1, 1j, 0, 0, 0], [0, 0, 2, 1, 0]
    np.testing.assert_allclose(am.frac(response(here, here), response(3j * np.array(here), there)), [[1], [0]])
    # (1, 1) against (1, 0): half of it is shared.
    mixed = response([1, 1, 0, 0, 0], here), response([1, 0, 0, 0, 0], here)
    np.testing.assert_allclose(am.frac(*mixed), [[0.5], [1]])
    np.testing.assert_allclose(am.frac(*mixed, used=[True, False, True, True, True]), [[1], [1]])
    assert np.isnan(am.frac(*mixed, used=np.zeros(5, bool))).all()
    tiny = replace(mixed[0], values=1e-200 * mixed[0].values)
    np.testing.assert_allclose(am.frac(tiny, mixed[1]), [[0.5], [1]])


def test_frac_refuses_what_cannot_be_compared() -> None:
    H = am.frf(cart(), "home", FREQ_HZ, frame="tip", outputs="x", inputs="x")
    for other in (
        H.to("mobility"),
        H.band(10, 20),
        am.frf(cart(), "home", FREQ_HZ + 1, frame="tip").select(outputs="x", inputs="x"),
    ):
        with pytest.raises(am.FrfError):
            am.frac(H, other)
    with pytest.raises(am.FrfError, match="used"):
        am.frac(H, H, used=[True, False])
