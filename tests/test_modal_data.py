"""Fits to measured modes: what their residual is, that it comes home from far off, and what it refuses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import armonic as am
from armonic.updating.modal_data import BLURS, ModalMeasurement, ModalResidual
from armonic.updating.parameters import Parameter, choose
from models import Complex, oscillator, random_driven_robot, random_robot, robot_of, slides, spring
from trees import Array

KUKA_FRAMES = ("sensor", "link_arm", "carousel")


def chosen_of(robot: am.Robot, *patterns: str, **options: Any) -> tuple[Parameter, ...]:
    return choose(robot, am.linearize(robot, next(iter(robot.postures), {})).impedances, patterns, **options)


def start_of(parameters: Sequence[Parameter]) -> Array:
    return np.array([p.coordinate(p.start) for p in parameters])


def seen(robot: am.Robot, posture: Any, frames: Sequence[str], axes: str = "xyz") -> tuple[am.Modes, Complex]:
    """The oscillatory modes' shapes at sensors, (m, frames · axes), and all modes."""
    model = am.linearize(robot, posture)
    found = am.modes(model)
    J = np.concatenate([model.jacobian(name)[["xyz".index(axis) for axis in axes]] for name in frames])
    return found, (J @ found.shapes[:, found.oscillatory]).T


def measured(
    robot: am.Robot, posture: Any, frames: Sequence[str] = (), *, only: Any = slice(None), **options: Any
) -> ModalMeasurement:
    """What a perfect modal analysis finds: frequencies, damping, and shapes where there are sensors."""
    found, shapes = seen(robot, posture, frames or ["base"])
    which = found.oscillatory
    options = {"damping_ratio": found.damping_ratio[which][only]} | options
    if frames:
        options |= {"shapes": shapes[only], "frame": frames}
    return ModalMeasurement(posture, found.natural_freq_hz[which][only], **options)


def fit(
    robot: am.Robot,
    measurements: ModalMeasurement | Sequence[ModalMeasurement],
    parameters: Sequence[Parameter],
    x: Array,
) -> Array:
    """Plain least squares of one blur after the other, within a factor of 100 of the start."""
    lower, upper = x - np.log(100), x + np.log(100)
    for blur in BLURS:
        residual = ModalResidual(robot, measurements, parameters, blur=blur)
        x = least_squares(
            lambda x, r=residual: r.triangle(x)[:, -1],
            x,
            jac=lambda x, r=residual: r.triangle(x)[:, :-1],
            bounds=(lower, upper),
            xtol=1e-12,
            ftol=1e-3 if blur else 1e-14,
            gtol=1e-12,
        ).x
    return np.asarray(x)


def mac_of(a: Complex, b: Complex) -> float:
    return float(np.abs(np.vdot(a, b)) ** 2 / (np.vdot(a, a) * np.vdot(b, b)).real)


def test_the_residual_is_that_of_frequencies_damping_and_shapes_over_their_deviations() -> None:
    truth = random_robot(1, 4, damping=5e-3)
    m = measured(truth, "bent", ["tip", "mid"], freq_deviation=0.01, damping_deviation=0.2, shape_deviation=0.03)
    chosen = chosen_of(truth, "elasticity")
    x = start_of(chosen) + np.random.default_rng(0).uniform(-0.1, 0.1, len(chosen))
    there = truth.with_values({p.path: p.value(v) for p, v in zip(chosen, x, strict=True)})
    residual = ModalResidual(truth, m, chosen)
    found, shapes = seen(there, "bent", ["tip", "mid"])
    cost = 0.0
    for k, j in enumerate(residual.pairs(x)[0]):
        cost += (np.log(found.natural_freq_hz[j] / m.natural_freq_hz[k]) / 0.01) ** 2
        cost += (np.log(found.damping_ratio[j] / m.damping_ratio[k]) / 0.2) ** 2
        cost += 6 * (1 - mac_of(m.shapes[k], shapes[j])) / 0.03**2
    J, r = residual.rows(x)
    assert J.shape == (4 + 4 + 2 * 4 * 6, 8)
    assert np.sum(r**2) == pytest.approx(cost, rel=1e-9)
    assert residual.costs(x[None])[0] == pytest.approx(cost, rel=1e-9)
    R, rows = residual.triangle(x), np.column_stack([J, r])
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-12 * np.abs(rows.T @ rows).max())


@pytest.mark.parametrize("blur", [0.0, 0.3])
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("driven", [False, True])
def test_the_jacobian_is_the_slope_of_the_residual(driven: bool, damped: bool, blur: float) -> None:
    robot = random_driven_robot(13, 3) if driven else random_robot(2, 4, damping=5e-3)
    patterns = ["links.link_1.mass", "links.link_2.com.*", "links.link_2.placement.3.x", "frames.tip.placement.0.rx"]
    chosen = chosen_of(robot, *patterns, "control.kp.*" if driven else "elasticity")
    # The slow modes of integrators that are all but overdamped are left out: their damping is at its edge.
    found = am.modes(robot, "bent")
    clear = [i for i, ratio in enumerate(found.damping_ratio[found.oscillatory]) if ratio < 0.7]
    m = measured(robot, "bent", ["tip", "mid"], only=clear, damped=damped)
    residual = ModalResidual(robot, [m, m], chosen, blur=blur)
    x = start_of(chosen) + 0.03 * np.random.default_rng(1).uniform(-1, 1, len(chosen))

    def value(x: Array) -> Array:
        there = robot.with_values({p.path: p.value(v) for p, v in zip(chosen, x, strict=True)})
        return ModalResidual(there, [m, m], chosen[:1], blur=blur).rows(x[:1])[1]

    def slopes(h: float) -> Array:
        return np.column_stack([(value(x + h * e) - value(x - h * e)) / (2 * h) for e in np.eye(len(x))])

    expected = (4 * slopes(1e-4) - slopes(2e-4)) / 3
    np.testing.assert_allclose(residual.rows(x)[0], expected, atol=1e-7 * np.abs(expected).max())


def test_scale_and_phase_of_shapes_and_the_order_of_modes_do_not_count() -> None:
    robot = random_robot(3, 5)
    m = measured(robot, "bent", ["tip", "mid"])
    rng = np.random.default_rng(2)
    order = rng.permutation(5)
    scale = (10.0 ** rng.uniform(-3, 3, 5) * np.exp(2j * np.pi * rng.random(5)))[:, None]
    shuffled = ModalMeasurement(
        "bent", m.natural_freq_hz[order], m.damping_ratio[order], scale * m.shapes[order], m.frame
    )
    chosen = chosen_of(robot, "elasticity")
    residual = ModalResidual(robot, shuffled, chosen)
    assert np.abs(residual.rows(start_of(chosen))[1]).max() < 1e-9
    np.testing.assert_array_equal(residual.pairs(start_of(chosen))[0], order)
    x = start_of(chosen) + 0.05
    for size in (1e200, 1e-200):
        extreme = ModalMeasurement("bent", m.natural_freq_hz, m.damping_ratio, size * m.shapes, m.frame)
        assert np.abs(ModalResidual(robot, extreme, chosen).rows(start_of(chosen))[1]).max() < 1e-9
    assert residual.costs(x[None])[0] == pytest.approx(ModalResidual(robot, m, chosen).costs(x[None])[0], rel=1e-9)


def test_noise_of_the_stated_deviations_costs_one_per_row_that_can_differ() -> None:
    # Of the 2 K real numbers of a shape two are its scale and phase. 400 draws know the mean to about 0.2 of 4 · 12.
    robot = random_robot(4, 4)
    found, shapes = seen(robot, "bent", ["tip", "mid"])
    chosen = chosen_of(robot, "stiffness")
    deviations = {"freq_deviation": 1e-3, "damping_deviation": 2e-2, "shape_deviation": 1e-2}
    rng = np.random.default_rng(3)
    size = np.sqrt(np.mean(np.abs(shapes) ** 2, axis=1, keepdims=True))
    costs = []
    for _ in range(400):
        noise = size * 1e-2 * (rng.normal(size=shapes.shape) + 1j * rng.normal(size=shapes.shape))
        freq = found.natural_freq_hz * np.exp(1e-3 * rng.normal(size=4))
        ratio = found.damping_ratio * np.exp(2e-2 * rng.normal(size=4))
        m = ModalMeasurement("bent", freq, ratio, shapes + noise, ("tip", "mid"), **deviations)
        costs.append(ModalResidual(robot, m, chosen).costs(start_of(chosen)[None])[0])
    expected = 4 + 4 + 4 * (2 * 6 - 2)
    assert np.mean(costs) == pytest.approx(expected, abs=4 * np.sqrt(2 * expected / 400))


@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_the_springs_of_huynhs_robot_are_found_back_from_frequencies_alone(factor: float) -> None:
    truth = am.load("huynh_3r")
    chosen = chosen_of(truth, "stiffness")
    m = measured(truth, "milling", damping_ratio=None)
    found = fit(truth, m, chosen, start_of(chosen) + np.log(factor))
    np.testing.assert_allclose(found, start_of(chosen), atol=1e-9)


def test_stiffness_and_damping_of_the_kuka_are_found_back_from_modes_alone() -> None:
    # Starts a factor of up to 3 off in each of 18 numbers; three sensors, one posture.
    truth = am.load("kuka_kr90")
    chosen = chosen_of(truth, "elasticity")
    home = start_of(chosen)
    m = measured(truth, "milling", KUKA_FRAMES)
    rng = np.random.default_rng(4)
    for _ in range(4):
        x = fit(truth, m, chosen, home + np.log(3) * rng.uniform(-1, 1, len(home)))
        np.testing.assert_allclose(x, home, atol=1e-7)


@pytest.mark.parametrize("seed", [1, 4, 6])
def test_random_robots_are_found_back_from_modes_alone(seed: int) -> None:
    truth = random_robot(seed, 5)
    chosen = chosen_of(truth, "elasticity")
    home = start_of(chosen)
    m = measured(truth, "bent", ["tip", "mid"])
    off = np.log(3) * np.random.default_rng(seed).uniform(-1, 1, len(home))
    np.testing.assert_allclose(fit(truth, m, chosen, home + off), home, atol=1e-6)


def test_masses_are_found_back_from_modes_in_two_postures() -> None:
    truth = random_robot(25, 3, damping=5e-3)
    ms = [measured(truth, posture, ["tip"]) for posture in ("bent", [0.2, -1.0, 0.7])]
    chosen = chosen_of(truth, "links.link_1.mass", "links.link_2.com.x", "stiffness")
    home = start_of(chosen)
    x = fit(truth, ms, chosen, home + 0.3)
    np.testing.assert_allclose(x, home, atol=1e-7)


@pytest.mark.parametrize("count", [3, 4])
def test_shapes_tell_which_modes_were_measured_where_frequencies_mislead(count: int) -> None:
    # All springs at a third of their value: every frequency is √3 too low, so that the second mode is nearest to what
    # was measured of the first. Only the lowest modes were measured.
    truth = am.load("kuka_kr90")
    chosen = chosen_of(truth, "stiffness")
    low = start_of(chosen) - np.log(3)
    m = measured(truth, "milling", KUKA_FRAMES, only=slice(count), damping_ratio=None)
    assert ModalResidual(truth, m, chosen).pairs(low)[0].tolist() != list(range(count))
    residual = ModalResidual(truth, m, chosen, blur=BLURS[0])
    assert residual.pairs(low)[0].tolist() == list(range(count))
    # Rows do not cancel as 1 − MAC does, whose rounding alone costs K/deviation² = 3600 times 2e-16 for each shape.
    assert np.sum(ModalResidual(truth, m, chosen).rows(fit(truth, m, chosen, low))[1] ** 2) < 1e-16


def test_modes_that_cross_keep_their_pairs_by_their_shapes() -> None:
    # Two slides side by side: the first was measured as the slower one, and starts as the faster one.
    def pair(first: float, second: float) -> am.Robot:
        ends = [
            {
                "name": name,
                "parent": "base",
                "joint": {"type": "prismatic", "axis": axis},
                "elasticity": {f"t{axis}": spring(k, 5.0)},
                "mass": 1.0,
            }
            for name, axis, k in (("left", "x", first), ("right", "y", second))
        ]
        return robot_of(ends)

    truth, start = pair(1e4, 1.2e4), pair(1.3e4, 1e4)
    m = measured(truth, {}, ["left", "right"], damping_ratio=None)
    chosen = chosen_of(start, "stiffness")
    residual = ModalResidual(start, m, chosen)
    assert residual.pairs(start_of(chosen))[0].tolist() == [1, 0]
    np.testing.assert_allclose(np.exp(fit(start, m, chosen, start_of(chosen))), [1e4, 1.2e4], rtol=1e-9)
    blind = ModalResidual(start, ModalMeasurement({}, m.natural_freq_hz), chosen)
    assert blind.pairs(start_of(chosen))[0].tolist() == [0, 1]


def test_poles_that_do_not_oscillate_are_paired_only_where_no_others_are_left() -> None:
    robot = slides([1.0, 1.0], [spring(1e4, 5.0), spring(1e4, 900.0)])
    found = am.modes(robot)
    assert np.count_nonzero(found.oscillatory) == 1
    chosen = chosen_of(robot, "elasticity")
    wave = int(np.flatnonzero(found.oscillatory)[0])
    one = ModalMeasurement({}, [found.natural_freq_hz[0]])
    assert ModalResidual(robot, one, chosen).pairs(start_of(chosen))[0].tolist() == [wave]
    two = ModalMeasurement({}, [found.natural_freq_hz[wave], found.natural_freq_hz[0]], [0.01, 0.5])
    assert ModalResidual(robot, two, chosen).pairs(start_of(chosen))[0].tolist() == [wave, 0]
    assert np.isfinite(ModalResidual(robot, two, chosen).costs(start_of(chosen)[None])).all()
    with pytest.raises(am.UpdateError, match="at most the model's 1"):
        ModalResidual(robot, ModalMeasurement({}, [10.0, 20.0], damped=True), chosen)


def test_a_shape_that_sensors_do_not_see_costs_all_that_a_shape_can() -> None:
    robot = slides([1.0], [spring(1e4, 5.0)])
    f = am.modes(robot).natural_freq_hz
    m = ModalMeasurement({}, f, shapes=[[1.0, 1.0]], frame="mass_0", outputs=("y", "z"), shape_deviation=0.1)
    chosen = chosen_of(robot, "stiffness")
    residual = ModalResidual(robot, m, chosen)
    J, r = residual.rows(start_of(chosen))
    assert np.sum(r**2) == pytest.approx(2 / 0.1**2, rel=1e-12)
    assert residual.costs(start_of(chosen)[None])[0] == pytest.approx(2 / 0.1**2, rel=1e-12)
    assert not J[1:].any()


def test_where_the_model_has_no_answer_the_cost_is_infinite_and_rows_say_so() -> None:
    undamped = oscillator(1.0, 1e4)
    chosen = chosen_of(undamped, "stiffness")
    x = start_of(chosen)
    residual = ModalResidual(undamped, ModalMeasurement({}, [10.0], [0.01]), chosen)
    assert residual.costs(np.array([x, x + 800])).tolist() == [np.inf, np.inf]
    for point in (x, x + 800):
        with pytest.raises(ArithmeticError):
            residual.rows(point)
    without = ModalResidual(undamped, ModalMeasurement({}, [10.0]), chosen)
    assert np.isfinite(without.rows(x)[0]).all()


def within_a_factor_of_two(robot: am.Robot, rng: np.random.Generator) -> am.Robot:
    return robot.with_values({path: v * 2 ** rng.uniform(-1, 1) for path, v in robot.parameters("elasticity").items()})


def worst(fit: am.Fit, truth: am.Robot) -> float:
    """Largest relative error of a fitted number."""
    true = truth.numbers()
    return max(abs(p.value / true[p.path] - 1) for p in fit.parameters)


def test_an_update_finds_stiffness_and_damping_of_huynhs_robot_from_modes_alone() -> None:
    # With shapes at the sensor: six numbers of three modes alone have more than one answer, exact to the last digit.
    truth = am.load("huynh_3r")
    m, rng = measured(truth, "milling", ["sensor"]), np.random.default_rng(5)
    for _ in range(6):
        fit = am.update(within_a_factor_of_two(truth, rng), m, parameters="elasticity")
        assert (fit.status, len(fit.parameters)) == ("converged", 6)
        assert worst(fit, truth) < 1e-8
        assert fit.robot.numbers("links.*.elasticity.*") == {p.path: p.value for p in fit.parameters}


def test_an_update_finds_what_modes_and_a_response_beside_them_were_made_of() -> None:
    # The response ends below the highest mode; damping of that mode was measured.
    truth = am.load("huynh_3r")
    m, rng = measured(truth, "milling", ["sensor"]), np.random.default_rng(6)
    H = am.frf(truth, "milling", np.arange(10, 81) / 5, frame="sensor")
    assert H.freq_hz[-1] < m.natural_freq_hz[-1]
    for _ in range(3):
        fit = am.update(within_a_factor_of_two(truth, rng), [am.Measurement(H, "milling"), m], parameters="elasticity")
        assert fit.status == "converged"
        assert worst(fit, truth) < 1e-6


@pytest.mark.parametrize("damped", [False, True])
def test_an_update_reads_damped_frequencies_as_such(damped: bool) -> None:
    # m ẍ + d ẋ + k x = 0: ω² = k/m, ζ = d/(2 √(k m)) = 0.5, and the damped frequency is ω √(1 − ζ²), 13 % lower.
    m, k, d = 2.0, 8e3, 126.49110640673517
    ratio = d / (2 * np.sqrt(k * m))
    assert ratio == pytest.approx(0.5, rel=1e-12)
    freq = np.sqrt(k / m) * (np.sqrt(1 - ratio**2) if damped else 1) / (2 * np.pi)
    modal = ModalMeasurement({}, [freq], [ratio], damped=damped)
    fit = am.update(oscillator(m, 1.7 * k, 0.6 * d), modal, parameters="elasticity")
    assert [p.value for p in fit.parameters] == pytest.approx([k, d], rel=1e-8)
    read = ModalMeasurement({}, [freq], [ratio], damped=not damped)
    other = am.update(oscillator(m, 1.7 * k, 0.6 * d), read, parameters="elasticity").parameters[0].value
    assert other == pytest.approx(k * (0.75 if damped else 4 / 3), rel=1e-8)


def test_a_mass_is_found_from_one_frequency_through_an_update() -> None:
    modal = ModalMeasurement({}, [np.sqrt(8e3 / 2.0) / (2 * np.pi)])
    fit = am.update(oscillator(3.5, 8e3, 20.0), modal, parameters="links.mass_0.mass")
    assert [p.value for p in fit.parameters] == pytest.approx([2.0], rel=1e-8)
