"""Stiffness that depends on the posture or on its load is fitted as a law, over all postures at once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from armonic.updating import Law
from models import G, pendulum

Array = NDArray[np.float64]

FREQ_HZ = np.arange(1, 61) / 2
ROBOT = am.load("huynh_3r")
NUMBERS = ROBOT.parameters()
K, D = "links.arm.elasticity.z.stiffness", "links.arm.elasticity.z.damping"  # 1.55e6, 340
SHOULDER = "links.link_arm.elasticity.z.stiffness"
POSTURES = ([0.0, 1.22, -1.75], [0.4, 0.9, -1.2], [-0.5, 1.6, -2.0])
RECOVERED = 1e-6


def coordinate(q: Any, name: str = "arm.z") -> float:
    return float(ROBOT.posture(q)[ROBOT.coordinates.index(name)])


def torque(q: Any, name: str = "arm.z") -> float:
    """Gravity's torque on a joint: the slope of the potential energy along its coordinate, by differences of the mass
    centres' heights. It is linear in the masses, and the poses of links are checked elsewhere."""
    at, h = ROBOT.posture(q), 1e-6

    def energy(q: Array) -> float:
        total = 0.0
        numbers = ROBOT.numbers()
        for link in ("carousel", "link_arm", "arm"):
            pose = ROBOT.mechanism.pose(q, ROBOT.frame_index(link))
            com = np.array([numbers[f"links.{link}.com.{axis}"] for axis in "xyz"])
            total += numbers[f"links.{link}.mass"] * 9.81 * float((pose[:3, :3] @ com + pose[:3, 3])[2])
        return total

    step = h * np.eye(3)[ROBOT.coordinates.index(name)]
    return abs(energy(at + step) - energy(at - step)) / (2 * h)


def data(k0: float, k1: float, xi: Any, postures: Any = POSTURES, path: str = K) -> list[am.Measurement]:
    """Exact responses of a robot whose number is k0 + k1 ξ in every posture."""
    found = []
    for q in postures:
        there = ROBOT.with_values({path: k0 + k1 * xi(q)})
        found.append(am.Measurement(am.frf(there, q, FREQ_HZ, frame="sensor"), q))
    return found


def off(seed: int, factor: float = 1.4) -> am.Robot:
    rng = np.random.default_rng(seed)
    return ROBOT.with_values({p: v * factor ** rng.uniform(-1, 1) for p, v in NUMBERS.items()})


def values(fit: am.Fit) -> dict[str, float]:
    return {p.path: p.value for p in fit.parameters}


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("slope", [3e5, -2e5, 0.0])
def test_a_stiffness_over_a_coordinate_is_recovered_from_a_few_postures(count: int, slope: float) -> None:
    fit = am.update(off(count), data(1.6e6, slope, coordinate, POSTURES[:count]), laws={K: Law("arm.z")})
    found = values(fit)
    assert found[K] == pytest.approx(1.6e6, rel=RECOVERED)
    assert found[f"{K} per arm.z"] == pytest.approx(slope, abs=RECOVERED * 1e6)
    assert all(found[p] == pytest.approx(v, rel=RECOVERED) for p, v in NUMBERS.items() if p != K)
    assert [p.path for p in fit.parameters] == [*NUMBERS, f"{K} per arm.z"]
    assert fit.parameters[-1].unit == "N m/rad per rad"
    assert {p.verdict for p in fit.parameters} == {"identified"}


@pytest.mark.parametrize("count", [2, 3])
def test_a_joint_that_hardens_under_its_torque_is_recovered(count: int) -> None:
    fit = am.update(off(10 + count), data(1.5e6, 450.0, torque, POSTURES[:count]), laws={K: Law("torque")})
    found = values(fit)
    assert found[K] == pytest.approx(1.5e6, rel=RECOVERED)
    assert found[f"{K} per torque"] == pytest.approx(450.0, rel=1e-5)  # the torques above are good to 1e-9 of some kN m
    assert fit.parameters[-1].unit == "N m/rad per N m"


def test_one_set_of_parameters_does_not_fit_what_a_law_does() -> None:
    measurements = data(1.6e6, 3e5, coordinate)
    constant, lawful = (am.update(ROBOT, measurements, laws=laws) for laws in ({}, {K: Law("arm.z")}))
    assert constant.cost > 1e3
    assert lawful.cost < 1e-10


def test_a_law_over_the_coordinate_of_another_joint_is_recovered() -> None:
    def other(q: Any) -> float:
        return coordinate(q, "link_arm.z")

    fit = am.update(off(20), data(1.2e6, 2e5, other), laws={K: Law("link_arm.z", slope=1e5)})
    found = values(fit)
    assert (found[K], found[f"{K} per link_arm.z"]) == pytest.approx((1.2e6, 2e5), rel=RECOVERED)
    assert fit.parameters[-1].start == 1e5


def test_damping_may_follow_a_law_and_several_numbers_their_own() -> None:
    measurements = []
    for q in POSTURES:
        there = ROBOT.with_values({D: 400 + 50 * coordinate(q), SHOULDER: 3e6 + 4e5 * coordinate(q, "link_arm.z")})
        measurements.append(am.Measurement(am.frf(there, q, FREQ_HZ, frame="sensor"), q))
    fit = am.update(off(21), measurements, laws={D: Law("arm.z"), SHOULDER: Law("link_arm.z")})
    found = values(fit)
    expected = {D: 400, f"{D} per arm.z": 50, SHOULDER: 3e6, f"{SHOULDER} per link_arm.z": 4e5}
    assert {path: found[path] for path in expected} == pytest.approx(expected, rel=RECOVERED)


def test_numbers_that_are_tied_follow_one_law_over_a_coordinate() -> None:
    measurements = []
    for q in POSTURES:
        there = ROBOT.with_values(dict.fromkeys((K, SHOULDER), 2e6 + 3e5 * coordinate(q)))
        measurements.append(am.Measurement(am.frf(there, q, FREQ_HZ, frame="sensor"), q))
    fit = am.update(off(22), measurements, ties=[[K, SHOULDER]], laws={K: Law("arm.z")})
    found = values(fit)
    assert len(found) == 6
    assert (found[SHOULDER], found[f"{SHOULDER} per arm.z"]) == pytest.approx((2e6, 3e5), rel=RECOVERED)


def test_the_robot_of_a_posture_has_the_numbers_of_its_law_there() -> None:
    fit = am.update(off(23), data(1.6e6, 3e5, coordinate), laws={K: Law("arm.z")})
    for q in (*POSTURES, [0.0, 0.0, 0.5], "milling"):
        there = fit.robot_in(q).parameters()
        assert there[K] == pytest.approx(1.6e6 + 3e5 * coordinate(q), rel=RECOVERED)
        assert {p: v for p, v in there.items() if p != K} == {p: v for p, v in fit.robot.parameters().items() if p != K}
    assert fit.robot.parameters()[K] == pytest.approx(1.6e6, rel=RECOVERED)  # at ξ = 0
    with pytest.raises(am.ModelError, match=rf"robot_in: found {K} is -\d.* expected a posture where its law holds"):
        fit.robot_in([0.0, 0.0, -6.0])
    without = am.update(ROBOT, am.Measurement(am.frf(ROBOT, "milling", FREQ_HZ, frame="sensor"), "milling"))
    assert without.robot_in(POSTURES[1]).parameters() == without.robot.parameters()


def test_what_the_fit_shows_after_it_is_the_law() -> None:
    measurements = data(1.6e6, 3e5, coordinate)
    fit = am.update(off(24), measurements, laws={K: Law("arm.z")})
    for m, after, modes in zip(measurements, fit.frf_after, fit.after, strict=True):
        np.testing.assert_allclose(after.values, m.frf.values, rtol=1e-5)
        there = ROBOT.with_values({K: 1.6e6 + 3e5 * coordinate(m.posture)})
        expected = am.modes(there, m.posture).natural_freq_hz
        np.testing.assert_allclose(modes.natural_freq_hz, expected, rtol=RECOVERED)


def test_one_posture_tells_the_sum_and_says_that_it_does_not_tell_the_parts() -> None:
    fit = am.update(off(25), data(1.6e6, 3e5, coordinate, POSTURES[:1]), laws={K: Law("arm.z")})
    by_path = {p.path: p for p in fit.parameters}
    base, slope = by_path[K], by_path[f"{K} per arm.z"]
    assert (base.verdict, slope.verdict) == ("not identifiable", "not identifiable")
    assert base.value + slope.value * coordinate(POSTURES[0]) == pytest.approx(1.6e6 - 1.75 * 3e5, rel=RECOVERED)
    assert {p.verdict for path, p in by_path.items() if p not in (base, slope)} == {"identified"}
    assert (fit.status, fit.evaluations < 100) == ("converged", True)


def test_a_law_over_what_stands_still_leaves_its_slope_open_and_where_it_was() -> None:
    # The carousel is at zero in every posture: no response depends on the slope.
    postures = [[0.0, *q[1:]] for q in POSTURES]
    fit = am.update(off(26), data(1.6e6, 0.0, coordinate, postures), laws={K: Law("carousel.z", slope=7.0)})
    slope = fit.parameters[-1]
    assert (slope.verdict, slope.value, slope.interval) == ("not identifiable", 7.0, (-np.inf, np.inf))
    assert values(fit)[K] == pytest.approx(1.6e6, rel=RECOVERED)


def test_the_interval_of_a_slope_holds_the_truth() -> None:
    rng, z = np.random.default_rng(5), []
    exact = data(1.6e6, 3e5, coordinate)
    for _ in range(30):
        measurements = []
        for m in exact:
            real, imaginary = rng.standard_normal((2, *m.frf.values.shape))
            spoilt = replace(m.frf, values=m.frf.values * (1 + 0.02 * (real + 1j * imaginary)))
            measurements.append(replace(m, frf=spoilt))
        fit = am.update(ROBOT, measurements, laws={K: Law("arm.z")}, method="least_squares")
        slope = fit.parameters[-1]
        half = (slope.interval[1] - slope.interval[0]) / 2
        z.append((slope.value - 3e5) / (half / 1.96))
    # 30 draws tell a deviation to 13 %: three times that, and a mean within three of its deviations.
    assert np.std(z) == pytest.approx(1.0, abs=0.4)
    assert abs(np.mean(z)) < 3 / np.sqrt(30)


def test_the_torque_of_a_law_is_that_of_gravity_on_the_joint_itself() -> None:
    # A mass m on a rod, at an angle φ from the vertical: m g l sin φ.
    robot = pendulum(1e5, mass=3.0, length=0.7)
    for angle in (0.0, 0.3, -0.8):
        found = Law("torque").variable(robot, np.array([angle]), "links.rod.elasticity.y.stiffness")
        assert found == pytest.approx(3.0 * G * 0.7 * abs(np.sin(angle)), rel=1e-12, abs=1e-12)
    q = POSTURES[1]
    assert Law("torque").variable(ROBOT, ROBOT.posture(q), K) == pytest.approx(torque(q), rel=1e-7)


MASS = "links.arm.mass"


@pytest.mark.parametrize(
    ("laws", "options", "message"),
    [
        ({K: "arm.z"}, {}, rf"law of {K}: found 'arm.z', expected a Law"),
        ({K: Law("elbow")}, {}, r'found \'elbow\', expected "torque" or one of carousel.z'),
        ({K: Law("arm.z", np.nan)}, {}, "found a slope of nan, expected a finite number"),
        ({K: Law("arm.z", "steep")}, {}, "found a slope of 'steep'"),  # type: ignore[arg-type]
        ({K: Law("arm.z", 1e30)}, {}, r"found a slope of 1e\+30, expected one within .* either way"),
        ({K: Law("arm.z", 1e7)}, {}, "found a response that is zero or infinite at the start"),
        ({MASS: Law("arm.z")}, {}, rf"law of {MASS}: found a number that is not fitted, or no elasticity"),
        ({MASS: Law("arm.z")}, {"parameters": MASS}, "or no elasticity"),
        ({K: Law("arm.z")}, {"hold": K}, "not fitted"),
        ({K: Law("arm.z"), "stiffness": Law("torque")}, {}, "found a second one, expected one law per number"),
        ({K: Law("torque")}, {"ties": [[K, SHOULDER]]}, "found a number that is tied, over a torque"),
        ({K: Law("arm.z")}, {"parameters": ["elasticity", MASS]}, "laws: found laws beside"),
        ({"links.elbow.*": Law("arm.z")}, {}, "laws: found 'links.elbow.*'"),
        ({5: Law("arm.z")}, {}, "laws: found 5"),
        ([K], {}, "laws: found .*, expected a mapping"),
    ],
)
def test_laws_that_cannot_be_are_refused_in_one_line(laws: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises((am.UpdateError, am.ModelError), match=message) as caught:
        am.update(ROBOT, data(1.55e6, 0.0, coordinate), laws=laws, **options)
    assert "\n" not in str(caught.value)


def test_laws_beside_measured_modes_are_refused() -> None:
    modes = am.modes(ROBOT, "milling")
    with pytest.raises(am.UpdateError, match="laws: found laws beside measured modes"):
        am.update(
            ROBOT, am.ModalMeasurement("milling", modes.natural_freq_hz, modes.damping_ratio), laws={K: Law("arm.z")}
        )
