"""The residual in any numbers of the description: Huynh et al. 2021, Eq. 22, written out, and fits that come home."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import armonic as am
from armonic import _core
from armonic.synthesis import system
from armonic.updating import dense
from armonic.updating.dense import DenseResidual, measured_receptances, triangle_of
from armonic.updating.parameters import Parameter, choose
from models import dynamic_stiffness, oscillator, random_robot
from trees import Array

LINES = np.linspace(1.0, 90.0, 40)


def chosen_of(robot: am.Robot, posture: Any, *patterns: str, **options: Any) -> tuple[Parameter, ...]:
    return choose(robot, am.linearize(robot, posture).impedances, patterns, **options)


def start_of(parameters: tuple[Parameter, ...]) -> Array:
    return np.array([p.coordinate(p.start) for p in parameters])


def measured(robot: am.Robot, posture: Any, frame: str, freq_hz: Array = LINES, **options: Any) -> am.Measurement:
    options = {"weights": "uniform"} | options
    return am.Measurement(am.frf(robot, posture, freq_hz, frame=frame), posture, **options)


def residual_of(
    robot: am.Robot, measurements: list[am.Measurement], parameters: tuple[Parameter, ...], **options: Any
) -> DenseResidual:
    weights = options.pop("weights", [m.line_weights() for m in measurements])
    return DenseResidual(robot, measurements, parameters, weights=weights, **options)


def moved(robot: am.Robot, parameters: tuple[Parameter, ...], x: Array) -> am.Robot:
    return robot.with_values({path: p.value(v) for p, v in zip(parameters, x, strict=True) for path in p.paths})


def slopes_by_differences(of: Callable[[Array], Array], x: Array) -> Array:
    """Central differences extrapolated once, of order four."""

    def slopes(h: float) -> Array:
        return np.column_stack([(of(x + h * e) - of(x - h * e)) / (2 * h) for e in np.eye(len(x))])

    return np.asarray((4 * slopes(1e-4) - slopes(2e-4)) / 3)


@pytest.mark.parametrize("relative", [False, True])
def test_the_triangle_is_the_cores_where_parameters_are_impedances(relative: bool) -> None:
    robot = random_robot(3, 4, damping=5e-3)
    model, m = am.linearize(robot, "bent"), measured(robot, "bent", "tip", weights="peaks")
    chosen = chosen_of(robot, "bent", "elasticity")
    x = start_of(chosen) + np.random.default_rng(0).uniform(-0.5, 0.5, len(chosen))
    theta = np.concatenate([model.spring, model.damper])
    for p, value in zip(chosen, np.exp(x), strict=True):
        theta[list(p.indices)] = value
    target = system(model, "tip"), 2j * np.pi * LINES, measured_receptances(m), m.line_weights()
    problem, theta = _core.Problem([target], relative=relative), theta.reshape(2, 1, -1)
    R = problem.reduce(*theta, [p.indices[0] for p in chosen])
    residual = residual_of(robot, [m], chosen, relative=relative)
    S = residual.triangle(x)
    assert np.array_equal(S, np.triu(S))
    np.testing.assert_allclose(S.T @ S, R.T @ R, atol=1e-11 * np.abs(R.T @ R).max())
    cost = residual.costs(x[None])[0]
    assert cost == pytest.approx(problem.costs(*theta)[0], rel=1e-12)
    assert cost == pytest.approx(np.sum(S[:, -1] ** 2), rel=1e-12)


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_the_cost_is_the_double_sum_of_equation_22(kind: str) -> None:
    robot = random_robot(44, 3, damping=5e-3)
    other = robot.with_values({"links.link_1.mass": 3.0 * robot.numbers()["links.link_1.mass"]})
    H = am.frf(other, "bent", LINES, frame="tip").to(kind)
    m = am.Measurement(H, "bent")
    chosen = chosen_of(robot, "bent", "links.*.mass")
    x = start_of(chosen) + 0.2
    model = am.frf(moved(robot, chosen, x), "bent", LINES, frame="tip", kind=kind).values
    difference = np.log(np.abs(model / H.values)) + 1j * np.angle(model / H.values)
    assert np.abs(np.angle(model) - np.angle(H.values)).max() > 5  # the wrong branch would show
    cost = np.sum(m.line_weights() * np.abs(difference) ** 2)
    residual = residual_of(robot, [m], chosen)
    assert residual.costs(x[None])[0] == pytest.approx(cost, rel=1e-10)
    assert np.sum(residual.rows(x)[1] ** 2) == pytest.approx(cost, rel=1e-10)
    relative = residual_of(robot, [m], chosen, relative=True)
    cost = np.sum(m.line_weights() * np.abs(model / H.values - 1) ** 2)
    assert relative.costs(x[None])[0] == pytest.approx(cost, rel=1e-10)
    assert np.sum(relative.rows(x)[1] ** 2) == pytest.approx(cost, rel=1e-10)


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize(
    ("name", "patterns"),
    [
        ("random", ["links.link_1.mass", "links.link_2.com.*", "links.*.inertia.xx", "links.link_1.elasticity.*"]),
        ("random", ["links.link_2.placement.*", "frames.tip.placement.*"]),
        ("scompi", ["control.kp", "control.kd", "links.link_2.mass", "links.link_3.com.x", "links.link_2.drive.*"]),
        ("scompi", ["links.link_2.dh.a", "links.link_3.dh.alpha", "links.link_1.drive.radius"]),
    ],
)
def test_the_jacobian_is_the_slope_of_the_residual(name: str, patterns: list[str], relative: bool) -> None:
    scompi = name == "scompi"
    robot = am.load("scompi") if scompi else random_robot(5, 3, damping=2e-2)
    ms = [measured(robot, place, "tool") for place in ("c1", "c50")] if scompi else [measured(robot, "bent", "tip")]
    chosen = chosen_of(robot, ms[0].posture, *patterns)
    residual = residual_of(robot, ms, chosen, relative=relative)
    x = start_of(chosen) + 0.02 * np.random.default_rng(1).uniform(-1, 1, len(chosen))
    J, r = residual.rows(x)
    assert J.shape == (2 * 9 * 40 * len(ms), len(chosen))

    def written_out(x: Array) -> Array:
        there = moved(robot, chosen, x)
        models = [am.frf(there, m.posture, LINES, frame=m.frf.frame).values for m in ms]
        ratio = np.concatenate([(H / m.frf.values).ravel() for m, H in zip(ms, models, strict=True)])
        apart = ratio - 1 if relative else np.log(ratio)
        return np.concatenate([apart.real, apart.imag])

    np.testing.assert_allclose(r, written_out(x), atol=1e-9)
    np.testing.assert_allclose(J, slopes_by_differences(written_out, x), atol=1e-6 * np.abs(J).max())
    R = residual.triangle(x)
    rows = np.column_stack([J, r])
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-12 * np.abs(rows.T @ rows).max())


def test_rows_hold_off_the_imaginary_axis() -> None:
    robot = random_robot(6, 3, damping=5e-3)
    m = measured(robot, "bent", "mid", LINES[:7])
    chosen = chosen_of(robot, "bent", "links.*.mass", "stiffness")
    points = 2j * np.pi * LINES[:5] + 30.0
    model = am.linearize(robot, "bent")
    rows = model.jacobian("mid")[:3]
    H = rows @ np.linalg.solve(dynamic_stiffness(points, model.mass, model.damping, model.stiffness), rows.T)
    residual = residual_of(robot, [m], chosen, weights=[np.ones(H.shape)], points=[points], measured=[H])
    start = start_of(chosen)
    assert residual.costs(start[None])[0] < 1e-20
    x = start + 0.1
    np.testing.assert_allclose(residual.rows(x)[0], slopes_by_differences(lambda x: residual.rows(x)[1], x), atol=1e-8)


def test_a_value_without_weight_is_left_out_whatever_it_holds() -> None:
    robot = random_robot(7, 3, damping=5e-3)
    m = measured(robot, "bent", "tip")
    chosen = chosen_of(robot, "bent", "links.*.mass")
    weights, H = m.line_weights(), measured_receptances(m)
    weights[:5], weights[20, 1, 2], weights[30] = 0.0, 0.0, 3.0
    H[:5], H[20, 1, 2] = np.nan, 0.0
    residual = residual_of(robot, [m], chosen, weights=[weights], measured=[H])
    J, r = residual.rows(start_of(chosen) + 0.1)
    assert len(r) == 2 * (9 * 35 - 1)
    whole = residual_of(robot, [m], chosen).rows(start_of(chosen) + 0.1)
    kept = np.ones((40, 3, 3), bool)
    kept[:5], kept[20, 1, 2] = False, False
    scale = np.sqrt(weights[kept])
    for got, all_of in zip((J.T, r), (whole[0].T, whole[1]), strict=True):
        halves = all_of.reshape(*all_of.shape[:-1], 2, 40, 3, 3)[..., kept] * scale
        np.testing.assert_allclose(got, halves.reshape(*all_of.shape[:-1], -1), rtol=1e-9, atol=1e-12)


def test_standstill_counts_for_receptances_and_not_for_accelerances() -> None:
    robot = random_robot(8, 2, damping=5e-3)
    lines = np.linspace(0.0, 50.0, 6)
    chosen = chosen_of(robot, "bent", "links.*.mass", "stiffness")
    counts = []
    for kind in ("receptance", "accelerance"):
        m = am.Measurement(am.frf(robot, "bent", lines, frame="tip", kind=kind), "bent", weights="uniform")
        J, r = residual_of(robot, [m], chosen).rows(start_of(chosen))
        assert np.abs(r).max() < 1e-10
        assert np.isfinite(J).all()
        counts.append(len(r))
    assert counts == [2 * 9 * 6, 2 * 9 * 5]


@pytest.mark.parametrize("relative", [False, True])
def test_a_mass_and_its_centre_are_found_back_from_exact_responses(relative: bool) -> None:
    truth = random_robot(25, 3, damping=2e-2)
    ms = [measured(truth, "bent", "tip"), measured(truth, [0.3, -0.8, 0.5], "mid")]
    chosen = chosen_of(truth, "bent", "links.link_1.mass", "links.link_2.com.x", "links.link_0.elasticity.*")
    home = start_of(chosen)
    residual = residual_of(truth, ms, chosen, relative=relative)
    off = np.array([0.3, -0.2, 0.2, -0.5])[: len(home)]
    found = least_squares(
        lambda x: residual.triangle(x)[:, -1], home + off, jac=lambda x: residual.triangle(x)[:, :-1], xtol=1e-14
    )
    np.testing.assert_allclose(found.x, home, atol=1e-8)


@pytest.mark.parametrize("cost", ["logarithmic", "relative"])
@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_an_update_finds_a_mass_back_from_exact_responses(factor: float, cost: Any) -> None:
    truth = am.load("huynh_3r")
    mass = truth.numbers()["links.arm.mass"]
    m = am.Measurement(am.frf(truth, "milling", np.arange(1, 151) / 5, frame="sensor"), "milling")
    start = truth.with_values({"links.arm.mass": factor * mass})
    fit = am.update(start, m, parameters="links.arm.mass", cost=cost)
    (p,) = fit.parameters
    assert (fit.status, p.path, p.verdict) == ("converged", "links.arm.mass", "identified")
    assert p.value == pytest.approx(mass, rel=1e-9)
    assert fit.robot.numbers()["links.arm.mass"] == p.value


def test_an_update_finds_an_oscillators_mass_from_its_formula() -> None:
    lines = np.arange(1, 61) / 4
    H = 1 / (8e3 - (2 * np.pi * lines) ** 2 * 2.0 + 2j * np.pi * lines * 30.0)
    frf = am.Frf(lines, H[:, None, None], "receptance", ("x",), ("x",), "mass_0")
    fit = am.update(oscillator(3.0, 8e3, 30.0), am.Measurement(frf, {}), parameters="links.mass_0.mass")
    assert fit.parameters[0].value == pytest.approx(2.0, rel=1e-10)


def test_gains_and_shafts_of_scompi_are_found_back_from_exact_responses() -> None:
    truth = am.load("scompi")
    m = measured(truth, "c8", "tool", np.linspace(2, 60, 30))
    chosen = chosen_of(
        truth, "c8", "control.k[pd]", "links.*.drive.shaft_stiffness", ties=["links.link_[56].drive.sh*"]
    )
    assert len(chosen) == 7
    home = start_of(chosen)
    residual = residual_of(truth, [m], chosen)
    off = 0.3 * np.random.default_rng(2).uniform(-1, 1, len(home))
    found = least_squares(
        lambda x: residual.triangle(x)[:, -1], home + off, jac=lambda x: residual.triangle(x)[:, :-1], xtol=1e-14
    )
    np.testing.assert_allclose(found.x, home, atol=1e-7)


def test_costs_of_many_points_are_those_of_one_at_a_time() -> None:
    robot = random_robot(10, 3, damping=5e-3)
    chosen = chosen_of(robot, "bent", "links.*.mass", "damping")
    residual = residual_of(robot, [measured(robot, "bent", "tip")], chosen)
    X = start_of(chosen) + np.random.default_rng(3).uniform(-0.3, 0.3, (5, len(chosen)))
    np.testing.assert_allclose(residual.costs(X), [np.sum(residual.rows(x)[1] ** 2) for x in X], rtol=1e-10)


def test_where_the_model_has_no_answer_the_cost_is_infinite_and_rows_say_so() -> None:
    # A number beyond all bounds, a resonance exactly on a line, and a response that is zero.
    truth = oscillator(2.0, 5.0, 0.5)
    lines = np.array([1.0, 2.0]) / (2 * np.pi)
    H = am.frf(truth, {}, lines, frame="mass_0", inputs="x", outputs="x")
    robot = oscillator(1.0, 5.0)
    chosen = chosen_of(robot, {}, "links.*.mass", "stiffness")
    residual = residual_of(robot, [am.Measurement(H, {}, weights="uniform")], chosen)
    beyond, on = np.array([np.log(5.0), 800.0]), np.log([4.0, 1.0])
    order = [[p.path.endswith("mass") for p in chosen].index(True)]
    if order == [0]:
        beyond, on = beyond[::-1], on[::-1]
    fine = start_of(chosen)
    assert residual.costs(np.array([beyond, on, fine]))[:2].tolist() == [np.inf, np.inf]
    assert np.isfinite(residual.costs(fine[None])).all()
    for x in (beyond, on):
        with pytest.raises(ArithmeticError):
            residual.rows(x)
        with pytest.raises(ArithmeticError):
            residual.triangle(x)
    across = am.Frf(lines, np.ones((2, 1, 1), complex), "receptance", ("y",), ("y",), "mass_0")
    nothing = residual_of(truth, [am.Measurement(across, {}, weights="uniform")], chosen)
    assert nothing.costs(fine[None])[0] == np.inf
    with pytest.raises(ArithmeticError):
        nothing.rows(fine)


@pytest.mark.parametrize(
    ("patterns", "robots", "models"),
    [(["elasticity"], 0, 0), (["elasticity", "links.link_0.mass"], 3, 3), (["links.*.mass"], 7, 7)],
)
def test_an_evaluation_builds_one_robot_and_two_for_each_number_that_is_no_impedance(
    patterns: list[str], robots: int, models: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = random_robot(11, 3, damping=5e-3)
    chosen = chosen_of(robot, "bent", *patterns)
    residual = residual_of(robot, [measured(robot, "bent", "tip"), measured(robot, "bent", "mid")], chosen)
    counts = {"robots": 0, "models": 0}
    from armonic.updating import tangent

    built, linearized = am.Robot.with_values, tangent.linearize

    def with_values(self: am.Robot, values: Any) -> am.Robot:
        counts["robots"] += 1
        return built(self, values)

    def linearize(robot: am.Robot, posture: Any) -> am.LinearModel:
        counts["models"] += 1
        return linearized(robot, posture)

    monkeypatch.setattr(am.Robot, "with_values", with_values)
    monkeypatch.setattr(tangent, "linearize", linearize)
    residual.triangle(start_of(chosen) + 0.01)
    assert counts == {"robots": robots, "models": models}


def test_fewer_rows_than_columns_still_make_a_whole_triangle() -> None:
    J, r = np.arange(6.0).reshape(2, 3), np.array([1.0, -2.0])
    R = triangle_of(J, r)
    rows = np.column_stack([J, r])
    assert R.shape == (4, 4)
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-13)


def test_arrays_that_do_not_fit_are_refused() -> None:
    robot = random_robot(1, 2, damping=5e-3)
    m = measured(robot, "bent", "tip")
    chosen = chosen_of(robot, "bent", "links.*.mass")
    good = m.line_weights()
    bad: list[tuple[dict[str, Any], str]] = [
        ({"weights": []}, "1 measurements, 0 weights"),
        ({"weights": [good[:3]]}, r"weights \(3, 3, 3\)"),
        ({"weights": [-good]}, "negative"),
        ({"weights": [np.nan * good]}, "non-finite"),
        ({"weights": [good], "points": [np.ones((2, 2), complex)]}, r"points \(2, 2\)"),
        ({"weights": [good], "measured": [measured_receptances(m)[:, :2]]}, r"responses \(40, 2, 3\)"),
        ({"weights": [good], "measured": [np.full(good.shape, np.nan)]}, "zero or not finite"),
        ({"weights": [good], "measured": [np.zeros(good.shape)]}, "zero or not finite"),
    ]
    for options, message in bad:
        with pytest.raises(am.UpdateError, match=message):
            dense.DenseResidual(robot, [m], chosen, **options)
