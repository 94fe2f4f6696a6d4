"""What a fit says about itself: verdicts, status, history, the updated file, modes and responses before and after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from armonic.updating import Fit, Measurement
from armonic.updating.parameters import Parameter
from armonic.updating.residuals import Descent, JointResidual
from armonic.updating.stages import Stage, Walker
from armonic.updating.uncertainty import FittedParameter, covariance_of, judge
from models import robot_of, spring
from robot_files import START

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FREQ_HZ = np.arange(1, 151) / 5
THREE_R = am.load("huynh_3r")
KUKA = am.load("kuka_kr90")


def noisy(H: am.Frf, seed: int, noise: float) -> am.Frf:
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * (1 + noise * (real + 1j * imaginary)))


def kuka_data(noise: float = 0.01) -> Measurement:
    return Measurement(noisy(am.frf(KUKA, "milling", FREQ_HZ, frame="sensor"), 3, noise), "milling")


@pytest.fixture(scope="module")
def progress() -> list[am.Progress]:
    return []


@pytest.fixture(scope="module")
def fit(progress: list[am.Progress]) -> Fit:
    """The KUKA at two postures, the first of them measured twice."""
    elsewhere = [0.4, 0.9, -1.2]
    data = [
        kuka_data(),
        Measurement(noisy(am.frf(KUKA, elsewhere, FREQ_HZ[::3], frame="sensor", kind="mobility"), 4, 0.01), elsewhere),
        Measurement(noisy(am.frf(KUKA, "milling", FREQ_HZ, frame="arm", outputs="x", inputs="z"), 5, 0.01), "milling"),
    ]
    return am.update(am.load(START), data, progress=progress.append)


def test_the_cost_is_equation_22_of_the_responses_after(fit: Fit) -> None:
    for responses, cost in ((fit.frf_before, fit.start_cost), (fit.frf_after, fit.cost)):
        total = 0.0
        for m, modelled in zip(fit.measurements, responses, strict=True):
            size = np.log(np.abs(modelled.values)) - np.log(np.abs(m.frf.values))
            turn = np.angle(modelled.values * m.frf.values.conj())
            total += np.sum(m.line_weights() * (size**2 + turn**2))
        # Differences of some 1e-2 between logarithms of some 10 keep 1e-13 of their size, 1e-11 of their squares.
        assert cost == pytest.approx(total, rel=1e-10)


def test_history_evaluations_and_progress_tell_the_same_story(fit: Fit, progress: list[am.Progress]) -> None:
    assert fit.status == "converged"
    assert fit.evaluations == len(fit.cost_history) == sum(len(stage.history) for stage in fit.stages)
    assert [now.evaluations for now in progress] == list(range(fit.evaluations))  # each before the next
    done = [now.done for now in progress]
    assert done == sorted(done)
    assert 0 <= done[0] < 0.1 < 0.8 < done[-1] < 1
    assert all(np.isfinite(now.left_s) for now in progress if now.done > 0)
    assert all((np.diff(stage.history) <= 0).all() for stage in fit.stages)
    assert fit.cost_history[-1] == pytest.approx(fit.cost, rel=1e-12)  # summed in another order
    assert fit.cost < fit.start_cost


def test_the_ladder_goes_down_to_the_axis_and_ends_with_the_cost_that_was_asked_for(fit: Fit) -> None:
    sigmas = [stage.sigma for stage in fit.stages]
    assert sigmas == sorted(sigmas, reverse=True)
    assert [stage.name for stage in fit.stages][-2:] == ["levelled", "cost"]
    assert sum(sigma > 0 for sigma in sigmas) >= 3
    assert sigmas[-2:] == [0.0, 0.0]


def test_the_duration_is_the_time_from_call_to_return() -> None:
    begin = perf_counter()
    fit = am.update(am.load(START), kuka_data())
    outside = perf_counter() - begin
    assert 0.5 * outside < fit.duration_s < outside  # loading the file is in it too


def test_modes_and_responses_are_those_of_the_robots_before_and_after(fit: Fit) -> None:
    assert fit.postures[0] == "milling"
    assert len(fit.postures) == len(fit.before) == len(fit.after) == len(fit.mac) == 2
    for posture, before, after, mac in zip(("milling", [0.4, 0.9, -1.2]), fit.before, fit.after, fit.mac, strict=True):
        for modes, robot in ((before, fit.start), (after, fit.robot)):
            expected = am.modes(robot, posture)
            np.testing.assert_array_equal(modes.poles, expected.poles)
            np.testing.assert_array_equal(modes.shapes, expected.shapes)
        # |aᴴ M b|² / (aᴴ M a · bᴴ M b), written out; a few hundred roundings at most.
        M = before.mass
        for i, a in enumerate(before.shapes.T):
            for j, b in enumerate(after.shapes.T):
                expected_mac = abs(np.vdot(a, M @ b)) ** 2 / (np.vdot(a, M @ a).real * np.vdot(b, M @ b).real)
                assert mac[i, j] == pytest.approx(expected_mac, rel=1e-12, abs=1e-14)
    for responses, robot in ((fit.frf_before, fit.start), (fit.frf_after, fit.robot)):
        for m, H in zip(fit.measurements, responses, strict=True):
            again = am.frf(
                robot,
                m.posture,
                m.frf.freq_hz,
                frame=m.frame,
                kind=m.frf.kind,
                outputs=m.frf.outputs,
                inputs=m.frf.inputs,
            )
            np.testing.assert_array_equal(H.values, again.values)


def test_the_updated_file_keeps_its_comments_and_loads_to_the_fitted_values(fit: Fit, tmp_path: Path) -> None:
    values = {p.path: p.value for p in fit.parameters}
    fit.robot.save(tmp_path / "new.yaml")
    again = am.load(tmp_path / "new.yaml")
    assert again.parameters() == fit.robot.parameters() == values
    assert all(again.bounds(path) == fit.start.bounds(path) for path in values)
    comments = [line for line in START.read_text("utf-8").splitlines() if line.lstrip().startswith("#")]
    assert len(comments) > 5
    assert [line for line in fit.robot.to_yaml().splitlines() if line.lstrip().startswith("#")] == comments
    assert fit.start.to_yaml() == START.read_text("utf-8")


def test_parameters_stand_in_the_order_of_the_file_with_start_bounds_and_unit(fit: Fit) -> None:
    assert [p.path for p in fit.parameters] == list(fit.start.parameters())
    assert {p.path: p.start for p in fit.parameters} == fit.start.parameters()
    assert all((p.lower, p.upper) == fit.start.bounds(p.path) for p in fit.parameters)
    units = {"stiffness": "N m/rad", "damping": "N m s/rad"}
    assert all(p.unit == units[p.path.split(".")[-1]] for p in fit.parameters)
    assert all(p.lower <= p.value <= p.upper for p in fit.parameters)


def test_without_bounds_a_parameter_may_move_by_a_factor_of_a_thousand() -> None:
    fit = am.update(THREE_R, Measurement(am.frf(THREE_R, "milling", FREQ_HZ, frame="sensor"), "milling"))
    np.testing.assert_allclose([p.upper / p.start for p in fit.parameters], 1e3)
    np.testing.assert_allclose([p.lower / p.start for p in fit.parameters], 1e-3)


@pytest.mark.parametrize("after", [1, 2, 15, 50])
def test_an_interrupted_fit_keeps_the_best_so_far(after: int) -> None:
    def stop(now: am.Progress) -> None:
        if now.evaluations == after:
            raise KeyboardInterrupt

    data, start = kuka_data(), am.load(START)
    whole, fit = am.update(start, data), am.update(start, data, progress=stop)
    assert (fit.status, fit.evaluations) == ("interrupted", after)
    np.testing.assert_array_equal(fit.cost_history, whole.cost_history[:after])
    # What was kept is what the cost says.
    assert am.update(fit.robot, data, max_evaluations=1).cost == pytest.approx(fit.cost, rel=1e-9)


@pytest.mark.parametrize("limit", [1, 2, 3, 30, 60])
def test_the_limit_on_evaluations_is_kept_over_both_passes(limit: int) -> None:
    data, start = kuka_data(), am.load(START)
    whole, fit = am.update(start, data), am.update(start, data, max_evaluations=limit)
    assert (fit.status, fit.evaluations) == ("limit", limit)
    np.testing.assert_array_equal(fit.cost_history, whole.cost_history[:limit])
    assert str(limit) in fit.message


def test_one_evaluation_leaves_the_robot_as_it_was() -> None:
    fit = am.update(KUKA, kuka_data(), max_evaluations=1)
    assert fit.robot.to_yaml() == KUKA.to_yaml()
    assert fit.cost == fit.start_cost


class Valleys:
    """Zero at x = 0, and a minimum of 0.8 at x = 2.97."""

    def triangle(self, x: Array) -> Array:
        rows = np.array([[2 * x[0] - 3, x[0] * (x[0] - 3)], [0.3, 0.3 * x[0]]])
        return np.linalg.qr(rows, mode="r")

    def costs(self, X: Array) -> Array:
        return (X * (X - 3))[:, 0] ** 2 + (0.3 * X[:, 0]) ** 2


class Astray:
    """A stage that ends in the worse valley, and began near the better one."""

    def descend(self, start: Array, *_: object, **__: object) -> Descent:
        price = float(Valleys().costs(start[None])[0])
        return Descent(np.array([2.97]), 0.0, start, price, np.array([price]), "converged")


def test_if_a_stage_leads_away_from_a_better_start_the_fit_goes_on_from_there() -> None:
    astray: Any = Astray()
    stages = [
        Stage("astray", 0.0, lambda: astray, 1e-5, 100),
        Stage("cost", 0.0, lambda: JointResidual([Valleys()]), 1e-10, 100),
    ]
    run = Walker(stages, np.array([-9.0]), np.array([9.0]), 100).run(np.array([0.05]))
    assert run.status == "converged"
    assert run.stages[0].history[0] == pytest.approx(0.0220, abs=1e-4)  # (0.05 · 2.95)² + 0.015²
    assert run.cost < 1e-15
    assert run.x[0] == pytest.approx(0.0, abs=1e-7)
    assert run.evaluations == sum(len(stage.history) for stage in run.stages)


def two_arms() -> am.Robot:
    """A turntable whose arm moves up and down: in this posture, one moves the tip along y only, the other along z."""
    links: list[dict[str, Any]] = [
        {
            "name": name,
            "parent": parent,
            "joint": {"type": "revolute", "axis": axis},
            "elasticity": {axis: spring(k, d)},
        }
        | {"mass": 20, "com": [0.5, 0, 0], "inertia": {"xx": 0.2, "yy": 2, "zz": 2}}
        for name, parent, axis, k, d in (("table", "base", "z", 4e5, 40.0), ("boom", "table", "y", 1e5, 20.0))
    ]
    return robot_of(
        links, frames=[{"name": "tip", "link": "boom", "placement": [{"x": 1.0}]}], postures={"flat": [0, 0]}
    )


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(("axis", "seen", "unseen"), [("y", "table", "boom"), ("z", "boom", "table")])
def test_what_the_sensor_cannot_see_is_not_identifiable_and_its_interval_open(
    axis: str, seen: str, unseen: str, noise: float
) -> None:
    truth = two_arms()
    H = noisy(am.frf(truth, "flat", np.arange(1, 100) / 2, frame="tip", outputs=axis, inputs=axis), 1, noise)
    start = truth.with_values({path: 1.2 * value for path, value in truth.parameters().items()})
    for robot in (start, truth):
        fit = am.update(robot, Measurement(H, "flat"))
        by_link = {link: [p for p in fit.parameters if f".{link}." in p.path] for link in (seen, unseen)}
        assert [p.verdict for p in by_link[unseen]] == ["not identifiable"] * 2
        assert [p.interval for p in by_link[unseen]] == [(0.0, np.inf)] * 2
        assert [p.value for p in by_link[unseen]] == [p.start for p in by_link[unseen]]
        assert [p.verdict for p in by_link[seen]] == ["identified"] * 2


def test_two_springs_in_parallel_are_not_identifiable_one_by_one() -> None:
    # A joint's own spring and a bushing about the same axis between the same bodies: only their sum shows.
    link = {
        "name": "rod",
        "parent": "base",
        "joint": {"type": "revolute", "axis": "z"},
        "elasticity": {"z": spring(3e4, 5.0)},
        "mass": 10,
        "com": [0.5, 0, 0],
        "inertia": {"xx": 1, "yy": 1, "zz": 1},
    }
    robot = robot_of(
        [link],
        frames=[{"name": "tip", "link": "rod", "placement": [{"x": 1.0}]}],
        bushings=[{"name": "cable", "between": ["base", "rod"], "stiffness": [0, 0, 0, 0, 0, 1e4]}],
    )
    H = noisy(am.frf(robot, [0.0], np.arange(1, 100) / 2, frame="tip", outputs="y", inputs="y"), 1, 0.01)
    fit = am.update(robot, Measurement(H, [0.0]), parameters="stiffness")
    assert [(p.verdict, p.interval) for p in fit.parameters] == [("not identifiable", (0.0, np.inf))] * 2
    assert sum(p.value for p in fit.parameters) == pytest.approx(4e4, rel=0.01)


def test_a_parameter_that_its_bound_holds_back_is_at_its_bound_and_one_that_lies_there_by_chance_is_too() -> None:
    path = "links.arm.elasticity.z.stiffness"  # 1.55e6
    H = am.frf(THREE_R, "milling", FREQ_HZ, frame="sensor")
    cases = [(1.2e6, (1e6, 1.4e6), True), (1.2e6, (1e6, 1.55e6), True), (1.2e6, (1e6, 1.6e6), False)]
    cases += [(1.9e6, (1.7e6, 2e6), True), (1.9e6, (1.55e6, 2e6), True), (1.9e6, (1.5e6, 2e6), False)]
    for value, bounds, held in cases:
        start = THREE_R.with_values({path: value})
        fit = am.update(start, Measurement(H, "milling", weights="uniform"), bounds={path: bounds})
        verdicts = {p.path: p.verdict for p in fit.parameters}
        assert verdicts[path] == ("at bound" if held else "identified")
        assert [v for p, v in verdicts.items() if p != path].count("at bound") == 0


def parameter(name: str) -> Parameter:
    return Parameter(name, (name,), "N m/rad", 1.0, 1e-6, 1e6, indices=(0,))


def verdicts_of(names: str, values: Array, J: Array, S: Array, freedom: int) -> tuple[FittedParameter, ...]:
    """What is said of parameters with A = JᵀJ and B = SᵀS at a minimum."""
    parameters = [parameter(name) for name in names]
    return judge(parameters, values, np.zeros(len(values)), covariance_of(J, S), freedom)


@pytest.mark.parametrize("weight", [1.0, 80.0])
def test_intervals_of_independent_parameters_are_the_textbook_ones_whatever_the_weight(weight: float) -> None:
    # Column i has length a_i, so the logarithm's standard deviation is σ / a_i. Student's t for ten degrees of freedom
    # and 95 % is 2.228 in every table. Half-widths: 0.11, 0.89, 2.2 and 22 against ln 1.25 = 0.22, ln 3 = 1.10 and
    # ln 1e6 = 13.8.
    lengths, noise, t = np.array([2.0, 0.25, 0.1, 0.01]), 0.1, 2.228
    J = np.diag(lengths)
    values = np.array([3.0, 4.0, 5.0, 6.0])
    judged = verdicts_of("abcd", values, np.sqrt(weight) * J, weight * noise * J, 10)
    assert [p.verdict for p in judged] == ["identified", "weak", "not identifiable", "not identifiable"]
    half = t * noise / lengths[:3]
    expected = np.stack([values[:3] * np.exp(-half), values[:3] * np.exp(half)], axis=1)
    np.testing.assert_allclose([p.interval for p in judged[:3]], expected, rtol=5e-4)  # the table's four digits
    assert judged[3].interval == (0.0, np.inf)


def test_correlated_parameters_have_the_intervals_of_ordinary_least_squares() -> None:
    rng = np.random.default_rng(1)
    J = rng.normal(size=(40, 3)) @ np.array([[1.0, 0.9, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 1.0]])
    noise, t = 0.05, 2.0262  # Student's t for 37 degrees of freedom
    deviation = noise * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    judged = verdicts_of("abc", np.ones(3), J, noise * J, 37)
    np.testing.assert_allclose([np.log(p.interval[1]) for p in judged], t * deviation, rtol=5e-5)


@pytest.mark.parametrize("noise", [0.0, 1e-16, 0.01])
@pytest.mark.parametrize("length", [0.0, 1e-14])
def test_what_rounding_leaves_of_a_column_of_zeros_identifies_nothing(length: float, noise: float) -> None:
    J = np.diag([1.0, length])
    judged = verdicts_of("ab", np.ones(2), J, noise * J, 50)
    assert [p.verdict for p in judged] == ["identified", "not identifiable"]
    assert judged[1].interval == (0.0, np.inf)


# --- What speaks against a fit --------------------------------------------------------------------------------


def synthesized(
    robot: am.Robot, posture: list[float], noise: Callable[[np.random.Generator, Complex], Complex]
) -> am.Frf:
    H = am.frf(robot, posture, np.arange(1, 151) / 5, frame="sensor")
    return replace(H, values=noise(np.random.default_rng(5), H.values))


def gauss(rng: np.random.Generator, shape: tuple[int, ...]) -> Complex:
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


@pytest.mark.parametrize(
    ("noise", "doubt"),
    [
        (lambda rng, H: H * (1 + 0.01 * gauss(rng, H.shape)), None),  # what the intervals assume
        (lambda rng, H: H, None),
        (lambda rng, H: H + 1e-4 * np.abs(H).max() * gauss(rng, H.shape), "constant noise floor"),
    ],
)
def test_a_fit_doubts_itself_under_a_noise_floor_and_not_under_proportional_noise(
    noise: Any, doubt: str | None
) -> None:
    truth = am.load("huynh_3r")
    posture = [0.0, 1.2, -1.7]
    fit = am.update(truth, am.Measurement(synthesized(truth, posture, noise), posture, weights="uniform"))
    assert (fit.doubts == ()) if doubt is None else (doubt in fit.doubts[0])


def test_a_fit_to_another_posture_says_that_the_model_does_not_explain_the_data() -> None:
    truth = am.load("huynh_3r")
    H = synthesized(truth, [0.0, 0.3, -0.4], lambda rng, H: H)
    fit = am.update(truth, am.Measurement(H, [0.0, 1.2, -1.7]))
    assert "does not explain these data" in fit.doubts[0]
    assert "identified" not in {p.verdict for p in fit.parameters}


def test_what_the_data_do_not_see_at_all_stays_where_it_was() -> None:
    # A slide along x on a slide along z: the force and the sensor along x know nothing of the second spring.
    text = """
armonic: 1
name: cross slide
links:
  - {name: bed, parent: base, joint: {type: prismatic, axis: z}, mass: 20,
     elasticity: {tz: {stiffness: 4.0e6, damping: 300}}}
  - {name: slide, parent: bed, joint: {type: prismatic, axis: x}, mass: 8,
     elasticity: {tx: {stiffness: 1.0e6, damping: 100}}}
"""
    robot = am.Robot.from_yaml(text)
    H = am.frf(robot, None, np.arange(20.0, 90.0), frame="slide", outputs="x", inputs="x")
    rng = np.random.default_rng(1)
    noisy = replace(H, values=H.values * (1 + 0.02 * gauss(rng, H.values.shape)))
    start = robot.with_values({"links.slide.elasticity.tx.stiffness": 1.3e6})
    fit = am.update(start, am.Measurement(noisy, [0.0, 0.0], weights="uniform"))
    found = {p.path.removeprefix("links."): p for p in fit.parameters}
    for quantity in ("stiffness", "damping"):
        unseen = found[f"bed.elasticity.tz.{quantity}"]
        assert (unseen.value, unseen.verdict, unseen.interval) == (unseen.start, "not identifiable", (0.0, np.inf))
    assert found["slide.elasticity.tx.stiffness"].value == pytest.approx(1.0e6, rel=0.01)  # 70 lines of 2 %


def test_as_many_parameters_as_data_determine_nothing() -> None:
    truth = am.load("kuka_kr90")
    H = am.frf(truth, "milling", [14.0], frame="sensor", outputs="x", inputs="x")
    off = replace(H, values=1.1 * H.values)
    fit = am.update(truth, am.Measurement(off, "milling", weights="uniform"), parameters="links.arm.elasticity.z.*")
    assert {p.interval for p in fit.parameters} == {(0.0, np.inf)}
    assert {p.verdict for p in fit.parameters} <= {"not identifiable", "at bound"}


def test_a_residual_far_above_the_scatter_of_the_lines_is_doubted_as_systematic() -> None:
    # Cross responses of one sign of the force differ by 30 %, as of a joint that is softer under one hammer blow.
    H = noisy(am.frf(THREE_R, "milling", FREQ_HZ, frame="sensor"), 2, 0.005)
    values = H.values.copy()
    values[:, 0, :] *= 1.3
    honest, skewed = (
        am.update(THREE_R, Measurement(data, "milling", weights="uniform")) for data in (H, replace(H, values=values))
    )
    assert honest.doubts == ()
    assert any("times what lines scatter" in doubt for doubt in skewed.doubts)
