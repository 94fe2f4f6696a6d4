"""What a robot file means: its numbers, names and order, its postures, and which file is loaded."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armonic import catalog
from armonic.checks import check
from armonic.description.document import Document
from armonic.description.reading import read_description
from armonic.description.tree import Tree, compile_tree
from armonic.errors import PostureError
from armonic.robot import Robot, load
from published import HUYNH_3R, KUKA_KR90
from robot_files import MINIMAL, START, ZOO


def zoo() -> Robot:
    return Robot.from_yaml(ZOO)


def tree_of(text: str) -> Tree:
    return compile_tree(read_description(Document(text, "test")))


def test_the_catalog_lists_the_robots_of_the_paper() -> None:
    assert {"huynh_3r", "kuka_kr90"} <= set(catalog.names())


@pytest.mark.parametrize(("name", "published"), [("huynh_3r", HUYNH_3R), ("kuka_kr90", KUKA_KR90)])
def test_catalog_bodies_are_the_printed_ones_with_products_turned_into_tensor_entries(name, published) -> None:
    robot = load(name)
    assert robot.gravity.tolist() == list(published.gravity)
    links = {link.name: link for link in robot.description.links}
    assert tuple(links) == published.links
    for link, body in zip(links.values(), published.bodies, strict=True):
        assert link.mass == body.mass
        assert link.com == body.com
        assert link.inertia.matrix() == body.tensor


def test_huynh_3r_springs_are_table_1() -> None:
    robot = load("huynh_3r")
    assert robot.coordinates == robot.joint_coordinates == ("carousel.z", "link_arm.z", "arm.z")
    assert tuple(robot.stiffness) == HUYNH_3R.stiffness
    assert tuple(robot.damping) == HUYNH_3R.damping


def test_kuka_springs_are_the_column_from_34_of_table_5() -> None:
    robot = load("kuka_kr90")
    assert robot.coordinates == tuple(f"{link}.{key}" for link in KUKA_KR90.links for key in KUKA_KR90.keys)
    assert robot.joint_coordinates == ("carousel.z", "link_arm.z", "arm.z")
    # The table prints 1e6 and 1e3 multiples: 0.02 * 1e3 rounds in the last bit.
    np.testing.assert_allclose(robot.stiffness, KUKA_KR90.earlier_work.stiffness, rtol=1e-15)
    np.testing.assert_allclose(robot.damping, KUKA_KR90.earlier_work.damping, rtol=1e-15)
    assert robot.flexible.all()


def test_kuka_start_has_the_initial_values_and_bounds_of_table_4() -> None:
    robot = load(START)
    np.testing.assert_allclose(robot.stiffness, KUKA_KR90.start.stiffness, rtol=1e-15)
    np.testing.assert_allclose(robot.damping, KUKA_KR90.start.damping, rtol=1e-15)
    lowest, highest = KUKA_KR90.stiffness_bounds
    for path, low, high in zip(robot.parameters("stiffness"), lowest, highest, strict=True):
        assert robot.bounds(path) == (low, high)
    assert {robot.bounds(path) for path in robot.parameters("damping")} == {KUKA_KR90.damping_bounds}
    assert all(load("kuka_kr90").bounds(path) is None for path in robot.parameters())


@pytest.mark.parametrize("name", ["huynh_3r", "kuka_kr90"])
def test_the_milling_posture_is_the_papers(name) -> None:
    robot = load(name)
    q = robot.posture("milling")
    given = [q[robot.coordinates.index(joint)] for joint in robot.joint_coordinates]
    np.testing.assert_allclose(np.degrees(given), HUYNH_3R.posture_deg, rtol=1e-15)
    assert np.count_nonzero(q) == 2


@pytest.mark.parametrize("name", ["huynh_3r", "kuka_kr90"])
def test_the_sensor_stands_where_equations_29_to_32_put_it(name) -> None:
    # In the posture all zero: x is a1 + a2 + 1.566; after Rx(90 deg) the offsets y and z become z and -y.
    robot = load(name)
    T = robot.mechanism.pose(robot.posture([0, 0, 0]), robot.frame_index("sensor"))
    dx, dy, dz = HUYNH_3R.sensor_offset
    # Sums of numbers near 1, with cos(90 deg) = 6e-17.
    np.testing.assert_allclose(T[:3, 3], [HUYNH_3R.a1 + HUYNH_3R.a2 + dx, -dz, dy], atol=1e-15)
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-15)


def test_huynh_mass_matrix_matches_the_recomputed_equation_33() -> None:
    robot = load("huynh_3r")
    M = robot.mechanism.mass_matrix(robot.posture("milling"))
    np.testing.assert_allclose(M, HUYNH_3R.mass_matrix, atol=0.005)  # printed to two decimals


def test_catalog_and_examples_pass_their_own_check() -> None:
    for source in (*catalog.names(), START):
        assert not [finding for finding in check(load(source)) if finding.level == "error"]
    assert check(load("kuka_kr90")) == ()


def test_coordinates_follow_the_tree_with_the_joints_own_first() -> None:
    robot = zoo()
    assert robot.coordinates == ("turret.joint", "turret.tz", "slide.ty", "slide.x", "slide.tx", "lift.joint")
    assert robot.joint_coordinates == ("turret.joint", "slide.ty", "lift.joint")
    assert robot.flexible.tolist() == [True, True, True, True, True, False]
    assert robot.stiffness.tolist() == [1e5, 0, 4e6, 7e3, 2e6, 0]
    assert robot.damping.tolist() == [0, 0, 0, 12, 3000, 0]
    assert robot.frames == ("base", "turret", "slide", "lift", "plate", "tip", "floor")


def test_a_description_compiles_into_a_chain_of_nodes_with_the_body_on_the_last() -> None:
    tree = tree_of(ZOO)
    assert tree.parents == (-1, 0, 1, 2, 3, 4, 5)
    assert tree.kinds == ("revolute", "prismatic", "prismatic", "revolute", "prismatic", "prismatic", "fixed")
    np.testing.assert_allclose(tree.axes[0], [0, 0.6, 0.8], rtol=1e-15)
    assert tree.axes[1:].tolist() == [[0, 0, 1], [0, 1, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 0, 0]]
    assert tree.masses.tolist() == [0, 1000, 0, 0, 0.5, 2, 1]
    assert tree.coms[4].tolist() == [0.001, 0, 0]
    assert np.diag(tree.inertias[4]).tolist() == pytest.approx([0.002, 1, 1])
    assert tree.frame_nodes == (-1, 1, 4, 5, 6, 6, -1)


def test_placements_are_applied_left_to_right_and_sit_on_the_first_node() -> None:
    tree = tree_of(ZOO)
    slide = [[0, -1, 0, 0.1], [1, 0, 0, 0.02], [0, 0, 1, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(tree.placements[2], slide, atol=1e-16)  # cos(90 deg) is 6e-17
    for node in (0, 1, 3, 4, 5):
        assert np.array_equal(tree.placements[node], np.eye(4))
    # First the turn about x, then 2 m along the turned z axis, which is -y.
    tip = [[1, 0, 0, 0], [0, 0, -1, -2], [0, 1, 0, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(tree.frame_placements[5], tip, atol=2e-16)


@pytest.mark.parametrize(("key", "turned"), [("rx", [[0, 1], [1, 2]]), ("ry", [[2, 0], [1, 1]]), ("rz", [[0, 1]])])
def test_rotations_are_right_handed(key, turned) -> None:
    # A quarter turn about x takes y to z, about y takes z to x, about z takes x to y.
    T = tree_of(f"{MINIMAL}\nframes: [{{name: f, link: a, placement: [{{{key}: 90 deg}}]}}]").frame_placements[-1]
    start, end = {"rx": (1, 2), "ry": (2, 0), "rz": (0, 1)}[key]
    np.testing.assert_allclose(T[:3, start], np.eye(3)[end], atol=1e-16)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_a_minimal_file_gets_the_documented_defaults() -> None:
    robot = Robot.from_yaml(MINIMAL)
    assert robot.gravity.tolist() == [0, 0, -9.81]
    assert robot.source is None
    assert robot.path is None
    assert robot.coordinates == ("a.z",)
    assert not robot.flexible.any()
    assert dict(robot.postures) == {}
    assert robot.bushings == ()
    assert robot.frames == ("base", "a")


def test_bushings_are_full_matrices_between_two_frames() -> None:
    cable, mount = zoo().bushings
    assert (cable.frame_a, cable.frame_b) == ("floor", "tip")
    assert np.array_equal(cable.stiffness, np.diag([1, 2, 3, 4, 5, 0]))
    assert not cable.damping.any()
    assert cable.rest is not None
    np.testing.assert_allclose(cable.rest, [math.pi / 6, 0, 0.5, 0, 0, 0.25], rtol=1e-15)
    assert np.array_equal(np.diag(mount.stiffness), [1000, 1000, 1000, 5, 6, 7])
    assert mount.stiffness[0, 4] == mount.stiffness[4, 0] == 10
    assert np.array_equal(mount.damping, np.diag([1, 1, 1, 2, 2, 2]))
    assert mount.rest is None


def test_the_base_is_a_frame_that_stays_where_it_is() -> None:
    robot = load("huynh_3r")
    T = robot.mechanism.pose(robot.posture("milling"), robot.frame_index("base"))
    assert np.array_equal(T, np.eye(4))


@pytest.mark.parametrize(
    "posture",
    [
        "milling",
        [0, math.radians(70), math.radians(-100)],
        (0.0, "70 deg", "-100 deg"),
        np.radians([0, 70, -100]),
        [np.float64(0), np.float32(0), np.int64(0)],
        {"link_arm.z": "70 deg", "arm.z": math.radians(-100)},
        [0, 0, 0, math.radians(70), 0, 0, math.radians(-100), 0, 0],
    ],
    ids=["name", "joints", "units", "array", "numpy scalars", "mapping", "all"],
)
def test_postures_may_be_named_listed_or_mapped(posture) -> None:
    robot = load("kuka_kr90")
    zero = isinstance(posture, list) and isinstance(posture[0], np.float64)
    expected = np.zeros(9)
    expected[[3, 6]] = 0.0 if zero else np.radians([70, -100])
    np.testing.assert_allclose(robot.posture(posture), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("posture", "parts"),
    [
        ("miling", ["'miling'", "Did you mean milling?"]),
        ([1, 2], ["2 values", "3 values: carousel.z, link_arm.z, arm.z", "all 9"]),
        ([0, math.nan, 0], ["link_arm.z", "nan", "finite"]),
        ([0, "70 mm", 0], ["link_arm.z", "'mm' measures a length"]),
        ([0, True, 0], ["link_arm.z", "true"]),
        ({"arm": 1}, ["'arm'", "Did you mean arm.z?"]),
        (np.zeros((3, 3)), ["posture"]),
        (7, ["found 7"]),
        (None, ["found nothing"]),
    ],
)
def test_bad_postures_say_what_would_fit(posture, parts) -> None:
    with pytest.raises(PostureError) as caught:
        load("kuka_kr90").posture(posture)
    assert all(part in str(caught.value) for part in parts)


def test_an_unknown_frame_names_the_nearest() -> None:
    with pytest.raises(PostureError, match=r"Did you mean sensor\?"):
        load("kuka_kr90").frame_index("sensr")


def test_a_posture_given_out_is_the_callers_own() -> None:
    robot = load("kuka_kr90")
    robot.posture("milling")[:] = 7.0
    assert robot.posture("milling").max() < 2.0
    for array in (robot.stiffness, robot.gravity, robot.postures["milling"], robot.flexible):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_a_robot_cannot_be_changed() -> None:
    robot = load("kuka_kr90")
    with pytest.raises(AttributeError):
        robot.name = "other"  # type: ignore[misc]


def test_a_file_wins_over_a_catalog_name_but_a_folder_does_not(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("kuka_kr90").mkdir()
    assert load("kuka_kr90").name == "KUKA KR90 R3100 HA, first three axes"
    Path("huynh_3r").write_text(MINIMAL)
    assert load("huynh_3r").name == "minimal"
    assert load("huynh_3r").path == Path("huynh_3r")


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path) -> None:
    (tmp_path / "bom.yaml").write_bytes(b"\xef\xbb\xbf" + MINIMAL.encode())
    assert load(tmp_path / "bom.yaml").to_yaml() == MINIMAL
