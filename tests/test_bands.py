"""Bands and modal intervals: coverage over draws of noise, closed forms, finite differences under a law."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import t

import armonic as am
from armonic.updating.bands import intervals_after, predictive_covariance
from models import robot_of, spring

DRAWS, NOISE = 150, 0.01
FREQ_HZ = np.arange(1, 61) / 2
UNMEASURED = [0.4, 0.9, -1.2]
SEEN = FREQ_HZ[5::6]
LAW = "links.arm.elasticity.z.stiffness"


def noisy(H: am.Frf, noise: float, seed: int) -> am.Frf:
    real, imaginary = np.random.default_rng([seed, 3]).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * np.exp(noise * (real + 1j * imaginary)))


@cache
def drawn() -> tuple[am.Fit, ...]:
    """Fits to draws of noise in one posture, under the paper's weights."""
    robot = am.load("huynh_3r")
    H = am.frf(robot, "milling", FREQ_HZ, frame="sensor")
    data = [am.Measurement(noisy(H, NOISE, seed), "milling") for seed in range(DRAWS)]
    return tuple(am.update(robot, m, method="least_squares") for m in data)


def test_bands_in_a_posture_never_measured_hold_the_true_response_as_often_as_they_claim() -> None:
    true = am.frf(am.load("huynh_3r"), UNMEASURED, SEEN, frame="sensor").values
    inside, turned = [], []
    for fit in drawn():
        bands = am.frf_bands(fit, UNMEASURED, SEEN)
        size, turn = np.abs(true), np.abs(np.angle(bands.frf.values / true))
        inside.append((bands.low <= size) & (size <= bands.high))
        turned.append(turn <= bands.phase_deviation)
        assert not bands.open.any()
    # The parameters have six degrees of freedom per draw: the mean over all values scatters by less than one draw's.
    assert 0.92 <= np.mean(inside) <= 0.98
    assert 0.92 <= np.mean(turned) <= 0.98
    # Of a single value 150 draws scatter by 1.8 %.
    assert np.mean(inside, axis=0).min() > 0.95 - 5 * 0.018


def test_modal_intervals_hold_the_true_modes_as_often_as_they_claim() -> None:
    true = am.modes(am.load("huynh_3r"), UNMEASURED)
    held = []
    for fit in drawn():
        found = am.modal_intervals(fit, UNMEASURED)
        for name in ("natural_freq_hz", "damped_freq_hz", "damping_ratio"):
            low, high = getattr(found, name).T
            held.append((low <= getattr(true, name)) & (getattr(true, name) <= high))
    assert 0.92 <= np.mean(held) <= 0.98


def hinge() -> am.Robot:
    """A hinge about z with a slide along x on it, straight out: along x only the slide moves, along y the hinge."""
    links = [
        {
            "name": "column",
            "parent": "base",
            "joint": {"type": "revolute", "axis": "z"},
            "elasticity": {"z": spring(2e6, 300.0)},
            "mass": 100.0,
            "inertia": {"xx": 10, "yy": 10, "zz": 10},
        },
        {
            "name": "boom",
            "parent": "column",
            "placement": [{"x": 2.0}],
            "joint": {"type": "prismatic", "axis": "x"},
            "elasticity": {"tx": spring(5e6, 900.0)},
            "mass": 80.0,
            "inertia": {"xx": 1, "yy": 1, "zz": 1},
        },
    ]
    return robot_of(links, frames=[{"name": "tip", "link": "boom"}], postures={"home": [0.0, 0.0]})


@cache
def blind() -> am.Fit:
    """A fit to what the slide alone answers."""
    robot = hinge()
    H = am.frf(robot, "home", FREQ_HZ * 2, frame="tip", outputs="x", inputs="x")
    path = "links.column.elasticity.z.stiffness"
    return am.update(robot, am.Measurement(noisy(H, NOISE, 0), "home"), bounds={path: (2e5, 2e7)})


def test_a_band_is_closed_where_the_response_does_not_depend_on_what_is_open_and_the_bounds_where_it_does() -> None:
    fit = blind()
    assert [p.verdict for p in fit.parameters] == ["not identifiable"] * 2 + ["identified"] * 2
    along = am.frf_bands(fit, "home", FREQ_HZ, outputs="x", inputs="x")
    assert not along.open.any()
    assert (along.high / along.low).max() < 1.05
    across = am.frf_bands(fit, "home", [0.0], kind="receptance", outputs="y", inputs="y")
    assert across.open.all()
    # At rest H_yy = L²/k, and all that is known of k is that it lies within a factor of ten.
    assert across.frf.values.item() == pytest.approx(2.0**2 / 2e6)
    assert (across.low.item(), across.high.item()) == pytest.approx((2e-7, 2e-5), rel=1e-6)


def test_modes_of_what_is_open_are_said_to_be_held_by_bounds() -> None:
    found = am.modal_intervals(blind(), "home")
    swinging = int(np.argmin(found.modes.natural_freq_hz))  # the hinge carries 80 kg at 2 m
    assert found.open[swinging].all()
    assert not found.open[1 - swinging].any()
    low, high = found.natural_freq_hz[swinging] / found.modes.natural_freq_hz[swinging]
    assert (low, high) == pytest.approx((10**-0.5, 10**0.5), rel=0.02)  # f ∝ √k; damping bends it a little


def test_bands_of_trading_parameters_are_no_wider_than_what_is_known_of_their_product() -> None:
    robot = robot_of(
        [
            {
                "name": "cart",
                "parent": "base",
                "joint": {"type": "prismatic", "axis": "x"},
                "elasticity": {"tx": spring(1e6, 200.0)},
                "mass": 10.0,
            }
        ],
        frames=[{"name": "tip", "link": "cart"}],
        bushings=[
            {
                "name": "mount",
                "between": ["base", "cart"],
                "stiffness": [1e6, 0, 0, 0, 0, 0],
                "damping": [9.0] + [0] * 5,
            }
        ],
        postures={"home": [0.0]},
    )
    H = am.frf(robot, "home", FREQ_HZ * 3, frame="tip", outputs="x", inputs="x")
    patterns = ["links.cart.elasticity.tx.stiffness", "bushings.mount.stiffness.x"]
    data = am.Measurement(noisy(H, NOISE, 0), "home", weights="uniform")
    fit = am.update(robot, data, parameters=patterns)
    assert all(np.isinf(p.deviation) for p in fit.parameters)
    bands = am.frf_bands(fit, "home", [0.0, 10.0], kind="receptance", outputs="x", inputs="x")
    assert not bands.open.any()
    # The same with the one spring there is: H(0) = 1/k.
    alone = am.update(robot, fit.measurements, parameters=patterns[:1])
    sole = am.frf_bands(alone, "home", [0.0, 10.0], kind="receptance", outputs="x", inputs="x")
    np.testing.assert_allclose(np.log(bands.high / bands.low), np.log(sole.high / sole.low), rtol=0.02)


def test_bands_under_a_law_follow_it_to_other_postures() -> None:
    robot = am.load("huynh_3r")
    postures = ["milling", [0.2, 0.8, -2.0]]
    data = []
    for k, q in enumerate(postures):
        base = robot.parameters()[LAW]
        bent = robot.with_values({LAW: base * (1 + 0.1 * robot.posture(q)[-1])})
        data.append(am.Measurement(noisy(am.frf(bent, q, FREQ_HZ, frame="sensor"), NOISE, k), q, weights="uniform"))
    fit = am.update(robot, data, laws={LAW: am.Law(over="arm.z")})
    x = np.array([p.coordinate(f.value) for p, f in zip(fit.coordinates, fit.parameters, strict=True)])

    def response(x: np.ndarray) -> np.ndarray:
        moved = [
            replace(f, value=p.value(float(v))) for p, f, v in zip(fit.coordinates, fit.parameters, x, strict=True)
        ]
        there = replace(fit, parameters=tuple(moved)).robot_in(UNMEASURED)
        return np.log(am.frf(there, UNMEASURED, SEEN, frame="sensor").values)

    step = 1e-5
    slopes = np.stack([(response(x + d) - response(x - d)) / (2 * step) for d in step * np.eye(len(x))], axis=-1)
    C = predictive_covariance(fit)
    bands = am.frf_bands(fit, UNMEASURED, SEEN)
    for part, half in ((slopes.real, np.log(bands.high / bands.low) / 2), (slopes.imag, bands.phase_deviation)):
        # Differences of a step of 1e-5 keep 1e-9 of slopes of order 1, next to antiresonances some more.
        expected = t.ppf(0.975, 2 * 2 * 9 * len(FREQ_HZ) - len(x)) * np.sqrt(np.einsum("...i,ij,...j", part, C, part))
        np.testing.assert_allclose(half, expected, rtol=1e-4)


def test_a_law_that_does_not_hold_in_a_posture_is_said_to_be_the_reason() -> None:
    robot = am.load("huynh_3r")
    H = am.frf(robot, "milling", FREQ_HZ, frame="sensor")
    there = [0.2, 0.8, -1.0]
    data = [am.Measurement(H, "milling"), am.Measurement(am.frf(robot, there, FREQ_HZ, frame="sensor"), there)]
    fit = am.update(robot, data, laws={LAW: am.Law(over="arm.z")})
    steep = tuple(
        replace(f, value=f.value if p.paths else 1e7) for p, f in zip(fit.coordinates, fit.parameters, strict=True)
    )
    with pytest.raises(am.ModelError, match="law"):
        am.frf_bands(replace(fit, parameters=steep), [0.2, 0.8, -3.0], FREQ_HZ)


def test_without_a_frame_the_first_measurement_s_is_taken_and_without_any_it_is_asked_for() -> None:
    fit = drawn()[0]
    np.testing.assert_array_equal(
        am.frf_bands(fit, "milling", SEEN).low, am.frf_bands(fit, "milling", SEEN, frame="sensor").low
    )
    with pytest.raises(am.UpdateError, match="frame"):
        am.frf_bands(replace(fit, measurements=()), "milling", SEEN)


def test_intervals_of_the_modes_after_are_those_of_their_posture() -> None:
    fit = drawn()[0]
    found = intervals_after(fit, 0)
    assert found is not None
    np.testing.assert_array_equal(found.modes.poles, am.modal_intervals(fit, "milling").modes.poles)
    assert intervals_after(replace(fit, postures=("elsewhere",)), 0) is None
