"""Surveys hold every pole of every posture, once, under one number: tables, long paths, robots of every kind."""

from __future__ import annotations

import json

import numpy as np
import pytest

import armonic as am
from armonic.surveying import running
from models import random_driven_robot, random_robot, robot_of, slides, spring
from surveyed import deviation, poles_of, smooth, worst

# LAPACK is backward stable at the size of the fastest pole; the slowest is some 1e-3 of it.
AGREE = 1e-9


@pytest.mark.parametrize("tool_kg", [0.0, 4.0])
def test_every_pole_of_the_50_postures_is_lapacks(tool_kg: float) -> None:
    robot = am.load("scompi").with_values({"tool.mass": tool_kg})
    survey = am.survey(robot, "table")
    assert worst(robot, robot.paths["table"], survey) < AGREE
    assert (survey.method.values == 0).all()
    assert (survey.residual.values <= 1).all()
    assert (survey.stability.values == 1).all()


def test_a_path_of_100_000_postures_agrees_with_lapack_and_never_jumps() -> None:
    robot = am.load("scompi")
    q = smooth(robot, 100_000, seed=3)
    survey = am.survey(robot, q, participation=False)
    assert (survey.residual.values <= 1).all()
    assert survey.mac.values.min() > 0.99
    pole = survey.pole.values
    assert (np.abs(np.diff(pole, axis=0)) < 0.02 * np.abs(pole[1:])).all()  # steps of 1e-4 of a turn
    chosen = np.arange(0, 100_000, 20)
    # Poles of Eq. 14 from the rigid body matrices and the drives, batched.
    n, d, c = 6, robot.drives, robot.control
    mass, stiffness = robot.mechanism.at_rest(q[chosen])
    M, K, C = (np.zeros((len(chosen), 2 * n, 2 * n)) for _ in range(3))
    i, m, wk = np.arange(n), n + np.arange(n), d.scale * d.shaft_stiffness
    M[:, :n, :n], M[:, m, m] = mass, d.inertia
    K[:, :n, :n] = stiffness
    K[:, i, i] += d.scale * wk
    K[:, i, m] = K[:, m, i] = -wk
    K[:, m, m] = d.shaft_stiffness + c.kp
    C[:, i, i], C[:, m, m] = d.joint_damping, d.motor_damping + c.kd
    A = np.zeros((len(chosen), 4 * n, 4 * n))
    A[:, : 2 * n, 2 * n :] = np.eye(2 * n)
    A[:, 2 * n :, : 2 * n], A[:, 2 * n :, 2 * n :] = -np.linalg.solve(M, K), -np.linalg.solve(M, C)
    expected = np.linalg.eigvals(A)
    found = poles_of(survey)[chosen]
    nearest = np.abs(found[:, :, None] - expected[:, None]) / np.abs(expected[:, None])
    partner = nearest.argmin(axis=2)
    assert (np.sort(partner, axis=1) == np.arange(4 * n)).all()  # each of LAPACK's once
    assert nearest.min(axis=2).max() < AGREE


@pytest.mark.parametrize("name", ["kuka_kr90", "huynh_3r"])
def test_robots_without_drives_are_surveyed_too(name: str) -> None:
    robot = am.load(name)
    q = smooth(robot, 60, seed=1, size=0.5)
    assert worst(robot, q, am.survey(robot, q)) < AGREE


@pytest.mark.parametrize("n", [2, 5, 9])
@pytest.mark.parametrize("seed", range(4))
def test_random_robots_with_drives_springs_and_every_gain(seed: int, n: int) -> None:
    robot = random_driven_robot(seed, n)
    q = smooth(robot, 40, seed=seed, size=0.4)
    # Random gains make badly scaled, partly unstable loops: LAPACK itself is good to a few 1e-10 there.
    assert worst(robot, q, am.survey(robot, q)) < 1e-8


def test_what_is_not_symmetric_goes_through_the_dense_solver() -> None:
    scompi = am.load("scompi")
    q = scompi.paths["table"][:12]
    moment = {"wrench": [0, 0, 0, 5, 20, -10], "frame": "tool"}
    turning = {"wrench": [50, 20, 0, 0, 0, 0], "frame": "tool", "wrench_axes": "frame"}
    for load in (moment, turning):
        survey = am.survey(scompi, q, **load)
        assert (survey.method.values == 1).all()
        assert worst(scompi, q, survey, **load) < AGREE
    feedback = random_driven_robot(1, 4, feedback=True)  # three drives that listen to each other
    p = smooth(feedback, 15, size=0.3)
    survey = am.survey(feedback, p)
    assert (survey.method.values == 1).all()
    assert worst(feedback, p, survey) < 1e-8


def test_a_force_keeps_the_system_symmetric_and_is_followed() -> None:
    scompi = am.load("scompi")
    q, load = scompi.paths["table"], {"wrench": [80, -50, 120, 0, 0, 0], "frame": "tool"}
    survey = am.survey(scompi, q, **load)
    assert (survey.method.values == 0).all()
    assert worst(scompi, q, survey, **load) < AGREE


def test_locked_joints_take_their_place_and_bushings_their_part() -> None:
    data = json.loads(random_robot(4, 5).to_yaml())
    del data["links"][2]["elasticity"]
    data["bushings"] = [
        {
            "name": "hose",
            "between": ["base", "tip"],
            "stiffness": [3e4] * 3 + [200] * 3,
            "damping": [5] * 6,
            "rest": "bent",
        }
    ]
    robot = am.Robot.from_yaml(json.dumps(data))
    q = smooth(robot, 20, size=0.2)
    survey = am.survey(robot, q)
    assert survey.sizes["mode"] == 4
    assert worst(robot, q, survey) < 1e-8


def test_equal_joints_side_by_side_have_equal_poles_which_are_both_found() -> None:
    twins = [
        {"name": f"mass_{i}", "parent": "base", "joint": {"type": "prismatic", "axis": "x"},
         "elasticity": {"tx": spring(4e4, 3)}, "mass": 2.0}
        for i in range(3)
    ]  # fmt: skip
    robot = robot_of(twins)
    survey = am.survey(robot, np.linspace(0, 0.1, 30)[:, None] * np.ones(3))
    exact = -3 / 4 + 1j * np.sqrt(4e4 / 2 - (3 / 4) ** 2)
    np.testing.assert_allclose(survey.pole.values, exact, rtol=1e-12)


def test_an_unstable_loop_is_reported_posture_by_posture() -> None:
    scompi = am.load("scompi")
    wild = am.Robot.from_yaml(scompi.to_yaml().replace("kp: 15000,", "kp: 15000, link_kd: 4000,"))
    q = scompi.paths["table"][:10]
    survey = am.survey(wild, q)
    assert (survey.stability.values == -1).all()
    assert worst(wild, q, survey) < AGREE


def test_an_integrator_more_makes_slots_of_real_poles() -> None:
    pid = am.load("scompi")
    pid = am.Robot.from_yaml(pid.to_yaml().replace("kp: 15000,", "kp: 15000, ki: [9e4, 0, 0, 2e4, 0, 0],"))
    q = pid.paths["table"][::7]
    survey = am.survey(pid, q)
    assert survey.sizes["mode"] == 13  # 24 + 2 poles
    assert worst(pid, q, survey) < AGREE


def test_threads_and_repetition_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = am.load("scompi")
    q = smooth(robot, 3000, seed=5)
    one, two = (am.survey(robot, q, threads=threads, shapes=True) for threads in (1, 3))
    for name in one.data_vars:
        np.testing.assert_array_equal(one[name].values, two[name].values)
    monkeypatch.setattr(running, "POSTURES_PER_BLOCK", 64)
    small = am.survey(robot, q, shapes=True)
    np.testing.assert_allclose(small.pole.values, one.pole.values, rtol=1e-11)
    np.testing.assert_array_equal(small.event.values, one.event.values)


def test_a_finer_path_gives_modes_the_same_numbers() -> None:
    robot = am.load("scompi")
    coarse = am.path(robot, ["c1", "c8", [0, 0.4, 1.3, 0.9, -1.2, 0.6], "c50"], 25)
    first = am.survey(robot, coarse).pole.values
    for times in (2, 8):
        knots = np.arange(0, 24 * times + 1) / times
        fine = np.stack([np.interp(knots, np.arange(25), column) for column in coarse.T], axis=1)
        np.testing.assert_allclose(am.survey(robot, fine).pole.values[::times], first, rtol=1e-9)


def test_one_posture_without_any_axis_is_a_survey_of_one() -> None:
    robot = slides([1.0, 2.0], [spring(100.0, 1.0), spring(300.0, 1.0)])
    survey = am.survey(robot, [0.0, 0.0])
    assert survey.natural_freq_hz.shape == (1, 2)
    assert deviation(poles_of(survey)[0], np.linalg.eigvals(am.linearize(robot, [0, 0]).state_matrix())) < 1e-12
