"""Grids, samples and lists: every point is that posture's, whatever walk, blocks and threads lead there."""

from __future__ import annotations

import itertools
import json
from functools import cache

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import armonic as am
from armonic.surveying import running
from armonic.surveying.walk import reflected
from models import random_driven_robot
from surveyed import by_lapack, deviation, poles_of, smooth


@cache
def driven() -> am.Robot:
    """Four coordinates, of which some are driven."""
    return random_driven_robot(3, 4)


def assert_same(one: xr.Dataset, other: xr.Dataset) -> None:
    assert set(one.data_vars) == set(other.data_vars)
    for name in one.data_vars:
        np.testing.assert_array_equal(one[name].values, other[name].values)


axes = st.lists(st.integers(1, 5), min_size=1, max_size=3)


@settings(deadline=None, max_examples=25)
@given(axes, st.permutations(range(4)), st.integers(1, 30), st.integers(0, 10**6))
def test_every_point_of_a_grid_has_the_poles_of_lapack_and_blocks_change_nothing(shape, chosen, per_block, seed):
    robot, rng = driven(), np.random.default_rng(seed)
    values = {robot.coordinates[i]: rng.uniform(-1, 1, size) for i, size in zip(chosen, shape, strict=False)}
    base = rng.uniform(-1, 1, 4)
    found = am.survey(robot, am.Grid(values, base=base))
    assert found.pole.dims == (*values, "mode")
    for at, poles in zip(itertools.product(*map(range, shape)), poles_of(found), strict=True):
        q = base.copy()
        for (name, row), i in zip(values.items(), at, strict=True):
            q[robot.coordinates.index(name)] = row[i]
        assert deviation(poles, by_lapack(robot, q)) < 1e-9
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "POSTURES_PER_BLOCK", 16)
        patch.setattr(running, "FEWEST_PER_BLOCK", per_block)
        parts = am.survey(robot, am.Grid(values, base=base), threads=3)
    # What follows from another start ends in other last digits.
    np.testing.assert_allclose(parts.pole, found.pole, rtol=1e-9)
    np.testing.assert_array_equal(parts.event, found.event)
    np.testing.assert_array_equal(parts.stability, found.stability)


def test_modes_go_on_along_the_walk_through_a_grid():
    robot = am.load("scompi")
    values = {f"link_{i}.z": np.linspace(low, low + 0.4, 9 + i) for i, low in ((2, -0.2), (3, 1.2), (4, 0.0))}
    found = am.survey(robot, am.Grid(values, base="c8"), shapes=True)
    shape = tuple(len(row) for row in values.values())
    order = reflected(shape, np.arange(np.prod(shape)))
    poles = found.pole.values.reshape(len(order), -1)[order]
    # Steps are of some 0.04 rad, in which no pole of Scompi moves by more than a few per cent.
    assert (np.abs(np.diff(poles, axis=0)) < 0.05 * np.abs(poles[1:])).all()
    assert found.mac.min() >= 0.9
    assert (found.method == 0).all()


def test_a_sweep_goes_with_a_grid_and_with_a_list():
    robot = am.load("scompi")
    mass, com = np.array([0.0, 1.0, 4.0]), np.array([0.0, 0.01, 0.05])
    sweep = {"tool.mass": mass, "tool.com.z": com}
    table = robot.paths["table"][::10]
    grid = am.Grid({"link_2.z": table[:, 1], "link_5.z": [-2.0, -1.0]}, base="c8")
    in_grid, in_list = am.survey(robot, grid, sweep=sweep), am.survey(robot, table, sweep=sweep)
    assert in_grid.pole.dims == ("tool.mass", "link_2.z", "link_5.z", "mode")
    assert in_list.pole.dims == ("tool.mass", "posture", "mode")
    np.testing.assert_array_equal(in_grid["tool.com.z"], com)
    assert in_grid["tool.com.z"].attrs["units"] == "m"
    q = robot.posture("c8")
    for row in range(3):
        loaded = robot.with_values({path: values[row] for path, values in sweep.items()})
        q[[1, 4]] = table[3, 1], -1.0
        found = poles_of(in_grid.isel({"tool.mass": [row], "link_2.z": [3], "link_5.z": [1]}))[0]
        assert deviation(found, by_lapack(loaded, q)) < 1e-9
        found = poles_of(in_list.isel({"tool.mass": [row], "posture": [2]}))[0]
        assert deviation(found, by_lapack(loaded, table[2])) < 1e-9


def test_feedback_that_enters_with_a_sweep_sends_it_to_the_dense_solver():
    # In the file the feedback is zero, and every motor listens to its own joint only.
    robot = random_driven_robot(1, 4)
    motors, data = len(robot.motors), json.loads(robot.to_yaml())
    data["control"]["state_feedback"] = {"position": np.zeros((motors, 2 * motors)).tolist()}
    robot = am.Robot.from_yaml(json.dumps(data))
    path = list(robot.numbers("control.state_feedback.position.*"))[1]
    gains = np.array([0.0, 500.0, 2000.0])
    found = am.survey(robot, "bent", sweep={path: gains})
    for poles, gain in zip(poles_of(found), gains, strict=True):
        assert deviation(poles, by_lapack(robot.with_values({path: gain}), "bent")) < 1e-9
    assert (found.method == 1).all()


def test_virtual_coordinates_can_be_gridded_and_units_are_named():
    robot = am.load("kuka_kr90")
    values = {"link_arm.x": [-0.01, 0.0, 0.01], "arm.z": [-1.0, -1.5]}
    found = am.survey(robot, am.Grid(values, base="milling"))
    q = robot.posture("milling")
    q[robot.coordinates.index("link_arm.x")], q[robot.coordinates.index("arm.z")] = 0.01, -1.5
    assert deviation(poles_of(found.isel({"link_arm.x": [2], "arm.z": [1]}))[0], by_lapack(robot, q)) < 1e-9
    assert found["arm.z"].attrs["units"] == "rad"
    assert am.survey(am.load("scompi"), "c8")["link_1.tz"].attrs["units"] == "m"


def test_postures_can_be_given_in_every_way_that_robots_know():
    robot = am.load("kuka_kr90")
    joints = np.array([[0.0, 70.0, -100.0], [10.0, 60.0, -90.0]]) * np.pi / 180
    whole = np.zeros((2, 9))
    whole[:, [robot.coordinates.index(name) for name in robot.joint_coordinates]] = joints
    names = dict(zip(robot.joint_coordinates, joints[1], strict=True))
    ways = [whole, joints, joints.tolist(), tuple(map(tuple, whole)), ["milling", names], iter(joints)]
    first = am.survey(robot, whole)
    for way in ways:
        np.testing.assert_allclose(am.survey(robot, way).pole, first.pole, rtol=1e-12)
    degrees = am.survey(robot, ["0 deg", "70 deg", "-100 deg"])
    for one in (am.survey(robot, "milling"), am.survey(robot, joints[0]), degrees):
        assert one.pole.shape == (1, 9)
        np.testing.assert_allclose(one.pole[0], first.pole[0], rtol=1e-12)


def test_neither_threads_nor_repetition_change_a_bit_and_progress_counts_up_to_all():
    robot = am.load("scompi")
    postures = smooth(robot, 5000, seed=1, size=0.3)
    told: list[tuple[int, int]] = []
    first = am.survey(robot, postures, threads=1, shapes=True, progress=lambda done, of: told.append((done, of)))
    for threads in (1, 2, 5, None):
        assert_same(first, am.survey(robot, postures, threads=threads, shapes=True))
    counts = [done for done, _ in told]
    assert counts == sorted(set(counts))
    assert counts[-1] == 5000
    assert {of for _, of in told} == {5000}


@pytest.mark.parametrize("count", [1, 2, 3, 100, 257])
@pytest.mark.parametrize("kind", ["sobol", "random"])
def test_samples_spread_over_their_ranges_alike_for_one_seed(kind, count):
    robot = am.load("scompi")
    ranges = {"link_3.z": (1.0, 2.0), "link_1.tz": (-0.5, 0.25), "link_5.z": (-1.0, -1.0)}
    one, two, other = (am.survey(robot, am.Sample(ranges, count, kind=kind, seed=seed)) for seed in (5, 5, 6))
    assert_same(one, two)
    for name, (low, high) in ranges.items():
        values = one[name].values
        assert values.shape == (count,)
        assert values.min() >= low
        assert values.max() <= high
        np.testing.assert_array_equal(values, two[name])
    assert not np.array_equal(one["link_3.z"], other["link_3.z"])
    assert (one["link_2.z"] == 0).all()
    if count >= 100:
        # Standard error of a mean of 100 uniform numbers is 0.03 of the range.
        assert abs(float(one["link_3.z"].mean()) - 1.5) < 0.12


def test_low_discrepancy_is_lower_than_that_of_random_numbers():
    robot = am.load("scompi")
    ranges = {"link_2.z": (0.0, 1.0), "link_3.z": (0.0, 1.0)}

    def fullest(kind):
        found = am.survey(robot, am.Sample(ranges, 256, kind=kind, seed=2))
        counts, _, _ = np.histogram2d(found["link_2.z"], found["link_3.z"], bins=16, range=[[0, 1], [0, 1]])
        return counts.max()

    # A scrambled Sobol sequence has one of 256 points in each of 16 x 16 cells.
    assert fullest("sobol") == 1
    assert fullest("random") > 1


def test_a_path_runs_through_its_corners_in_even_steps():
    robot = am.load("scompi")
    through = ["c1", [0, 0.1, 1.5, 0.3, -1.6, 0.2], "c50"]
    path = am.path(robot, through, 21)
    assert path.shape == (21, 6)
    for at, corner in zip((0, 10, 20), through, strict=True):
        np.testing.assert_allclose(path[at], robot.posture(corner), atol=1e-15)
    steps = np.diff(path, axis=0)
    np.testing.assert_allclose(steps[:10], np.broadcast_to(steps[0], (10, 6)), atol=1e-15)
    np.testing.assert_allclose(steps[10:], np.broadcast_to(steps[10], (10, 6)), atol=1e-15)
    np.testing.assert_array_equal(am.survey(robot, path)["link_3.z"], path[:, 2])
