"""Surveys give at every posture the poles that LAPACK gives, all of them and each once, however the robot is made."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest

import armonic as am
from lapack import TOLERANCE, all_poles, deviation, lapack_poles, scompi_states, smooth
from models import random_driven_robot, random_robot, robot_of, spring
from published import SCOMPI

CONTINUATION, DENSE = 0, 1


@cache
def scompi() -> am.Robot:
    return am.load("scompi")


@cache
def table() -> Any:
    """The 50 postures of Do et al. 2022 with both tools."""
    return am.survey(scompi(), "table", sweep={"tool.mass": SCOMPI.tool_mass}, shapes=True)


def changed(robot: am.Robot, change: Any) -> am.Robot:
    data = json.loads(robot.to_yaml())
    change(data)
    return am.Robot.from_yaml(json.dumps(data))


def test_all_poles_of_the_50_configurations_are_those_of_lapack_with_both_tools():
    assert dict(table().sizes) == {"tool.mass": 2, "posture": 50, "mode": 12, "coordinate": 12, "spring": 6}
    robots = [scompi().with_values({"tool.mass": mass}) for mass in SCOMPI.tool_mass]
    expected = np.concatenate([lapack_poles(robot, robot.paths["table"]) for robot in robots])
    assert deviation(all_poles(table()), expected) < TOLERANCE
    assert (table().method == CONTINUATION).all()
    assert (table().residual <= 1).all()
    assert (table().stability == 1).all()


def test_table_5_comes_out_of_a_survey():
    # The allowances of test_scompi_tables: the printed inertia is rounded.
    for case, (freq_allowed, damping_allowed) in enumerate([(0.0004, 0.001), (0.0025, 0.0025)]):
        printed, found = SCOMPI.printed_table_5[case], table().isel({"tool.mass": case, "posture": 7})
        order = np.argsort(found.natural_freq_hz.values)
        freq_hz, damping = found.natural_freq_hz.values[order], 100 * found.damping_ratio.values[order]
        np.testing.assert_allclose(freq_hz, printed.natural_freq_hz, rtol=freq_allowed)
        np.testing.assert_allclose(damping, printed.damping_percent, rtol=damping_allowed)


def test_the_ranges_of_section_4_2_come_out_of_a_survey():
    # Half of the last digit printed.
    assert float(table().natural_freq_hz.min()) == pytest.approx(SCOMPI.printed_lowest_hz, abs=0.005)
    assert float(table().natural_freq_hz.max()) == pytest.approx(SCOMPI.printed_highest_hz, abs=0.005)
    damping = 100 * table().damping_ratio.values
    np.testing.assert_allclose([damping.min(), damping.max()], SCOMPI.printed_damping_percent, rtol=0, atol=0.005)


def test_the_gain_sweep_of_fig_5_comes_out_and_both_gains_stand_on_its_axis():
    kp = np.linspace(*SCOMPI.printed_sweep_kp, 40)
    kd = 0.425 * np.sqrt(kp)
    found = am.survey(scompi(), "c1", sweep={"control.kp": kp, "control.kd": kd})
    assert found.pole.dims == ("control.kp", "mode")
    np.testing.assert_array_equal(found["control.kp"], kp)
    np.testing.assert_array_equal(found["control.kd"], kd)
    first = found.isel(mode=0)
    for end in (0, -1):
        assert float(first.natural_freq_hz[end]) == pytest.approx(SCOMPI.printed_sweep_freq_hz[end], abs=0.005)
        assert 100 * float(first.damping_ratio[end]) == pytest.approx(
            SCOMPI.printed_sweep_damping_percent[end], abs=0.01
        )
    robots = [scompi().with_values({"control.kp": p, "control.kd": d}) for p, d in zip(kp, kd, strict=True)]
    expected = np.concatenate([lapack_poles(robot, scompi().postures["c1"][None]) for robot in robots])
    assert deviation(all_poles(found), expected) < TOLERANCE


def test_a_path_of_100_000_postures_has_all_poles_and_passes_its_checks_everywhere():
    postures = smooth(scompi(), 100_000, seed=8)
    postures[:, 0] *= 0.1  # the track, in m
    found = am.survey(scompi(), postures, participation=False)
    assert (found.residual <= 1).all()
    assert (found.method == CONTINUATION).all()
    assert (found.stability == 1).all()
    # A step is taken in parts while a shape changes by more than that.
    assert float(found.mac.min()) >= 0.9
    # A name never jumps to another mode: poles move by no more than the postures do, which is 1e-4 of a turn.
    poles = found.pole.values
    assert np.max(np.abs(np.diff(poles, axis=0)) / np.abs(poles[1:])) < 1e-3
    some = np.random.default_rng(1).choice(len(postures), 5000, replace=False)
    states = scompi_states(scompi(), postures[some])
    np.testing.assert_allclose(
        states[0], am.linearize(scompi(), postures[some[0]]).state_matrix(), rtol=1e-9, atol=1e-9 * np.abs(states).max()
    )
    assert deviation(all_poles(found.isel(posture=some)), np.linalg.eigvals(states)) < TOLERANCE


@pytest.mark.parametrize("name", ["huynh_3r", "kuka_kr90"])
def test_robots_of_the_catalog_have_the_poles_of_lapack(name):
    robot = am.load(name)
    postures = smooth(robot, 150, seed=3)
    found = am.survey(robot, postures)
    assert deviation(all_poles(found), lapack_poles(robot, postures)) < TOLERANCE
    assert found.residual.max() <= 1
    assert (found.method == CONTINUATION).mean() > 0.9


@pytest.mark.parametrize("n", [1, 2, 4, 7, 12])
@pytest.mark.parametrize("seed", [0, 1])
def test_random_robots_have_the_poles_of_lapack_with_springs_drives_and_gains_of_every_kind(seed, n):
    for robot in (random_robot(seed, n), random_driven_robot(seed, n), random_driven_robot(seed, n, feedback=True)):
        postures = smooth(robot, 40, seed=seed)
        found = am.survey(robot, postures)
        assert deviation(all_poles(found), lapack_poles(robot, postures)) < TOLERANCE
        # Feedback across joints has no symmetric form, and its modes are the dense solver's.
        model = am.linearize(robot, postures[0])
        assert (found.method == (CONTINUATION if model.local else DENSE)).all()


@pytest.mark.parametrize("make", [random_robot, random_driven_robot])
@pytest.mark.parametrize(
    ("wrench", "axes", "method"),
    [
        ([800, -500, 300, 0, 0, 0], "world", CONTINUATION),
        ([800, -500, 300, 100, -50, 20], "world", DENSE),
        ([800, -500, 300, 0, 0, 0], "frame", DENSE),
    ],
)
def test_a_wrench_adds_its_stiffness_and_moments_go_to_the_dense_solver(make, wrench, axes, method):
    robot = make(5, 4)
    load = {"wrench": wrench, "frame": "tip", "wrench_axes": axes}
    postures = smooth(robot, 40, seed=2, amplitude=0.5)
    found = am.survey(robot, postures, **load)
    expected = lapack_poles(robot, postures, **load)
    assert deviation(all_poles(found), expected) < TOLERANCE
    assert (found.method == method).all()
    # It matters.
    assert deviation(all_poles(am.survey(robot, postures)), expected) > 1e-6


@pytest.mark.parametrize("rest", [{}, {"rest": "bent"}])
@pytest.mark.parametrize("make", [random_robot, random_driven_robot])
def test_bushings_count_also_where_they_are_loaded(make, rest):
    stiffness, damping = [1e5, 2e5, 3e5, 1e4, 1e4, 2e4], [10, 20, 30, 1, 1, 2]
    pad = {"name": "pad", "between": ["base", "tip"], "stiffness": stiffness, "damping": damping, **rest}
    robot = make(3, 4, bushings=[pad])
    postures = smooth(robot, 40, seed=4, amplitude=0.4)
    found = am.survey(robot, postures)
    assert deviation(all_poles(found), lapack_poles(robot, postures)) < TOLERANCE


def test_locked_coordinates_drop_out():
    def lock(data):
        del data["links"][1]["elasticity"]

    robot = changed(random_robot(2, 5), lock)
    postures = smooth(robot, 60, seed=5)
    found = am.survey(robot, postures)
    assert found.sizes["mode"] == 4
    assert list(found.spring.values) == [name for name in robot.coordinates if not name.startswith("link_1.")]
    assert deviation(all_poles(found), lapack_poles(robot, postures)) < TOLERANCE


@pytest.mark.parametrize("damped", [True, False])
def test_a_free_coordinate_gives_a_rigid_body_mode_and_the_verdict_marginal(damped):
    def free(data):
        data["gravity"] = [0, 0, 0]
        for i, link in enumerate(data["links"]):
            if i == 2:
                link["elasticity"]["joint"] = "free"
            elif not damped:
                link["elasticity"]["joint"]["damping"] = 0.0

    robot = changed(random_robot(4, 5), free)
    postures = smooth(robot, 40, seed=6)
    found = am.survey(robot, postures)
    assert (found.stability == 0).all()
    # Eigenvalues of a double zero are known to the square root of rounding.
    assert deviation(all_poles(found), lapack_poles(robot, postures), floor=1e-3) < 1e-6
    assert ((found.natural_freq_hz < 1e-5).sum("mode") == 1).all()


def test_undamped_robots_have_poles_on_the_imaginary_axis():
    def undamp(data):
        for link in data["links"]:
            link["elasticity"]["joint"]["damping"] = 0.0

    robot = changed(random_robot(6, 6), undamp)
    postures = smooth(robot, 60, seed=7)
    found = am.survey(robot, postures)
    assert deviation(all_poles(found), lapack_poles(robot, postures)) < TOLERANCE
    assert np.abs(found.damping_ratio).max() < 1e-12
    assert (found.stability == 0).all()


@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_joints_that_are_alike_have_equal_frequencies(damping):
    # Decoupled slides: f = sqrt(k/m) / 2 pi, three times, passed by that of another one.
    alike = [("a", "x"), ("b", "y"), ("c", "z")]
    links = [
        {"name": name, "joint": {"type": "prismatic", "axis": axis}, "mass": 2.0} for name, axis in [*alike, ("d", "x")]
    ]
    for link in links:
        link["elasticity"] = {"t" + link["joint"]["axis"]: spring(1e4 if link["name"] != "d" else 2e4, damping)}
        link["parent"] = "base"
    robot = robot_of(links, gravity=[0, 0, 0])
    k = np.linspace(1e4, 4e4, 40)
    found = am.survey(robot, [0, 0, 0, 0], sweep={f"links.{n}.elasticity.t{a}.stiffness": k for n, a in alike})
    np.testing.assert_allclose(found.natural_freq_hz.values[:, :3], np.sqrt(k / 2)[:, None] / (2 * np.pi) * np.ones(3))
    np.testing.assert_allclose(found.natural_freq_hz.values[:, 3], 100 / (2 * np.pi))
    # All three pass it between the same two places, and nothing else happens.
    passed = int(np.flatnonzero(k > 2e4)[0])
    assert (found.event.values[passed] == 1).all()
    assert not np.delete(found.event.values, passed, axis=0).any()


def test_an_unstable_loop_is_reported_not_refused():
    # Proportional feedback of the link side without damping of it.
    robot = random_driven_robot(0, 5)
    postures = smooth(robot, 30)
    found = am.survey(robot, postures)
    expected = lapack_poles(robot, postures)
    assert (expected.real.max(axis=1) > 0).all()
    assert (found.stability == -1).all()
