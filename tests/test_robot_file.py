"""What a robot file means: its numbers, names and order, and that saving keeps what a person wrote."""

from __future__ import annotations

import copy
import math
import os
import pickle
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armonic import catalog
from armonic.checks import Finding, check
from armonic.document import Document
from armonic.errors import DataFileError, PostureError, RobotFileError, UpdateError
from armonic.reading import read_description
from armonic.robot import Robot, load
from armonic.tree import Tree, compile_tree
from armonic.units import UNITS, quantity
from published import HUYNH_3R, KUKA_KR90

START = Path(catalog.__file__).parent.parent / "examples" / "kuka_start.yaml"

# A robot with everything a file can hold: a child before its parent, a free vector as axis, slides, bushings.
ZOO = """\
armonic: 1
name: Zoo   # a comment
postures:
  home: [30 deg, 0.5, 250 mm]
links:
  - name: slide   # its parent stands below
    parent: turret
    placement: [{x: 100 mm, y: 2 cm}, {rz: 90 deg}]
    joint: {type: prismatic, axis: y}
    elasticity:
      tx: {stiffness: 2 kN/mm, damping: 3 N s/mm}
      ty: {stiffness: 4.0e6}   # from the data sheet
      x:
        stiffness: 7 kN m/rad   # guessed
        damping: 12
    mass: 500 g
    com: [1 mm, 0, 0]
    inertia: {xx: 2000 kg mm^2, yy: 1, zz: 1}
  - name: turret
    parent: base
    joint: {type: revolute, axis: [0, 3, 4]}
    elasticity: {joint: {stiffness: 1.0e5, stiffness_bounds: [1.0e4, 1 MN m/rad]}, tz: free}
    mass: 1 t
    inertia: {xx: 10, yy: 10, zz: 10}
  - {name: lift, parent: slide, joint: {type: prismatic, axis: [1, 0, 0]}, mass: 2}
  - {name: plate, parent: lift, joint: {type: fixed}, mass: 1, placement: [{z: 1}]}
frames:
  - {name: tip, link: plate, placement: [{rx: 90 deg}, {z: 2}]}
  - {name: floor, link: base, placement: [{x: -1}]}
bushings:
  - {name: cable, between: [floor, tip], stiffness: [1, 2, 3, 4, 5, 0], rest: home}
  - name: mount
    between: [base, turret]
    stiffness:
      - [1.0e3, 0, 0, 0, 10, 0]
      - [0, 1 N/mm, 0, 0, 0, 0]
      - [0, 0, 1.0e3, 0, 0, 0]
      - [0, 0, 0, 5, 0, 0]
      - [10 N, 0, 0, 0, 6, 0]
      - [0, 0, 0, 0, 0, 7]
    damping: [1, 1, 1, 2, 2, 2]
"""


def zoo() -> Robot:
    return Robot.from_yaml(ZOO)


def tree_of(text: str) -> Tree:
    return compile_tree(read_description(Document(text, "test")))


# --- the catalog against the paper ----------------------------------------------------------------


def test_the_catalog_lists_the_robots_of_the_paper() -> None:
    assert {"huynh_3r", "kuka_kr90"} <= set(catalog.names())


@pytest.mark.parametrize(("name", "published"), [("huynh_3r", HUYNH_3R), ("kuka_kr90", KUKA_KR90)])
def test_catalog_bodies_are_the_printed_ones_with_products_turned_into_tensor_entries(
    name, published
) -> None:
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


# --- units ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("350 mm", "length", 0.35),
        ("-2.5cm", "length", -0.025),
        ("12 µm", "length", 12e-6),
        ("180 deg", "angle", math.pi),
        ("90°", "angle", math.pi / 2),
        ("60 arcmin", "angle", math.pi / 180),
        ("5 mrad", "angle", 0.005),
        (".5 t", "mass", 500.0),
        ("250 g", "mass", 0.25),
        ("3 kg mm^2", "inertia", 3e-6),
        ("3 kg·mm²", "inertia", 3e-6),
        ("2e4 kg*cm**2", "inertia", 2.0),
        ("9810 mm/s²", "acceleration", 9.81),
        ("2.8 MN m/rad", "rotational stiffness", 2.8e6),
        ("2.8 MN·m / rad", "rotational stiffness", 2.8e6),
        ("2.8 MNm/rad", "rotational stiffness", 2.8e6),
        ("1 N m/arcmin", "rotational stiffness", 60 * 180 / math.pi),
        ("2 N m/mrad", "rotational stiffness", 2000.0),
        ("1.5 kN/mm", "translational stiffness", 1.5e6),
        ("3 N/um", "translational stiffness", 3e6),
        ("0.4 kN m s/rad", "rotational damping", 400.0),
        ("7 Nms/rad", "rotational damping", 7.0),
        ("7 N s/mm", "translational damping", 7000.0),
        ("+1E1 N", "coupling stiffness", 10.0),
    ],
)
def test_quantities_have_the_value_worked_out_by_hand(text, dimension, value) -> None:
    assert quantity(text, dimension) == pytest.approx(value, rel=1e-15)  # one rounded product


@given(st.sampled_from([(d, u) for d, table in UNITS.items() for u in table]), st.floats(-1e6, 1e6))
def test_every_unit_scales_its_number(entry, figure) -> None:
    dimension, unit = entry
    assert quantity(f"{figure!r} {unit}", dimension) == figure * UNITS[dimension][unit]


@pytest.mark.parametrize(
    ("text", "dimension", "hint"),
    [
        ("5 kg", "length", "'kg' measures mass"),
        ("5 rad", "length", "'rad' measures an angle"),
        ("5 N/m", "rotational stiffness", "measures translational stiffness"),
        ("5 furlong", "length", "'furlong' is not known"),
        ("5 mN m/rad", "rotational stiffness", "not known"),
        ("5 m m", "length", "not known"),
        ("1,5 m", "length", "decimal point"),
        ("5", "length", "without quotes if it is in m"),
        ("five m", "length", None),
        ("", "length", None),
        ("1e999 m", "length", None),
        ("nan m", "length", None),
    ],
)
def test_bad_quantities_say_what_is_accepted(text, dimension, hint) -> None:
    with pytest.raises(RobotFileError) as caught:
        quantity(text, dimension)
    assert caught.value.found == repr(text)
    if "999" not in text:
        assert all(unit in caught.value.expected for unit in UNITS[dimension])
    assert caught.value.hint is None if hint is None else hint in caught.value.hint


# --- the file's meaning ---------------------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("key", "turned"), [("rx", [[0, 1], [1, 2]]), ("ry", [[2, 0], [1, 1]]), ("rz", [[0, 1]])]
)
def test_rotations_are_right_handed(key, turned) -> None:
    # A quarter turn about x takes y to z, about y takes z to x, about z takes x to y.
    T = tree_of(
        f"{MINIMAL}\nframes: [{{name: f, link: a, placement: [{{{key}: 90 deg}}]}}]"
    ).frame_placements[-1]
    start, end = {"rx": (1, 2), "ry": (2, 0), "rz": (0, 1)}[key]
    np.testing.assert_allclose(T[:3, start], np.eye(3)[end], atol=1e-16)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


MINIMAL = """\
armonic: 1
name: minimal
links: [{name: a, parent: base, joint: {type: revolute, axis: z}}]"""


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


# --- parameters, changed values, saving -----------------------------------------------------------


def test_parameters_are_listed_in_file_order_with_si_values() -> None:
    robot = zoo()
    assert list(robot.parameters("links.*")) == [
        "links.slide.elasticity.tx.stiffness",
        "links.slide.elasticity.tx.damping",
        "links.slide.elasticity.ty.stiffness",
        "links.slide.elasticity.ty.damping",
        "links.slide.elasticity.x.stiffness",
        "links.slide.elasticity.x.damping",
        "links.turret.elasticity.joint.stiffness",
        "links.turret.elasticity.joint.damping",
    ]
    assert robot.parameters("links.slide.elasticity.tx.*") == {
        "links.slide.elasticity.tx.stiffness": 2e6,
        "links.slide.elasticity.tx.damping": 3e3,
    }
    assert robot.bounds("links.turret.elasticity.joint.stiffness") == (1e4, 1e6)
    assert robot.unit("links.slide.elasticity.tx.stiffness") == "N/m"
    assert robot.unit("links.turret.elasticity.joint.damping") == "N m s/rad"
    assert robot.unit("bushings.mount.damping.x") == "N s/m"


def test_a_bushing_has_parameters_where_it_acts() -> None:
    cable = zoo().parameters("bushings.cable.*")
    assert [path.removeprefix("bushings.cable.") for path in cable] == [
        f"{what}.{direction}"
        for what in ("stiffness", "damping")
        for direction in ("x", "y", "z", "rx", "ry")
    ]
    assert zoo().parameters("bushings.mount.stiffness.ry") == {"bushings.mount.stiffness.ry": 6.0}


def test_groups_and_unions_select_parameters() -> None:
    robot = load("kuka_kr90")
    assert len(robot.parameters()) == len(robot.parameters("elasticity")) == 18
    assert len(robot.parameters("stiffness")) == len(robot.parameters("damping")) == 9
    both = robot.parameters("links.arm.elasticity.?.stiffness, links.carousel.elasticity.z.damping")
    assert next(iter(both)) == "links.carousel.elasticity.z.damping"
    assert len(both) == 4
    assert robot.parameters(["damping", "stiffness", "damping"]) == robot.parameters()


@pytest.mark.parametrize(
    "call",
    [
        lambda robot, path: robot.parameters(path),
        lambda robot, path: robot.parameters(["stiffness", path]),
        lambda robot, path: robot.bounds(path),
        lambda robot, path: robot.unit(path),
        lambda robot, path: robot.with_values({path: 1.0}),
    ],
)
def test_a_path_that_matches_nothing_names_the_nearest(call) -> None:
    nearest = "Did you mean links.arm.elasticity.z.stiffness"
    with pytest.raises(UpdateError, match=nearest):
        call(load("kuka_kr90"), "links.arm.elasticity.z.stifness")


def test_a_robot_without_elasticity_says_so_when_asked_for_parameters() -> None:
    with pytest.raises(UpdateError, match="no elasticity"):
        Robot.from_yaml(MINIMAL).parameters()
    with pytest.raises(UpdateError, match="at least one"):
        load("kuka_kr90").parameters([])


@pytest.mark.parametrize("source", ["huynh_3r", "kuka_kr90", START])
def test_an_unchanged_robot_writes_its_file_byte_for_byte(source, tmp_path) -> None:
    text = START.read_bytes() if source is START else catalog.read(source).encode()
    robot = load(source)
    assert robot.to_yaml().encode() == text
    robot.save(tmp_path / "copy.yaml")
    assert (tmp_path / "copy.yaml").read_bytes() == text


def test_changed_values_leave_every_other_character_of_the_file_alone(tmp_path) -> None:
    changed = zoo().with_values(
        {
            "links.slide.elasticity.tx.stiffness": 2.5e6,
            "links.slide.elasticity.x.stiffness": 8123.4,
            "links.turret.elasticity.joint.stiffness": 123456.78901234,
            "bushings.cable.stiffness.ry": 0.25,
            "bushings.mount.stiffness.y": "2 N/mm",
            "bushings.mount.damping.z": 1e-7,
        }
    )
    expected = (
        ZOO.replace("{stiffness: 2 kN/mm,", "{stiffness: 2.5e6,")
        .replace("stiffness: 7 kN m/rad", "stiffness: 8123.4")
        .replace("stiffness: 1.0e5", "stiffness: 1.2345678901234e5")
        .replace("[1, 2, 3, 4, 5, 0]", "[1, 2, 3, 4, 0.25, 0]")
        .replace("1 N/mm", "2000")
        .replace("damping: [1, 1, 1,", "damping: [1, 1, 1.0e-7,")
    )
    assert changed.to_yaml() == expected
    changed.save(tmp_path / "new.yaml")
    again = load(tmp_path / "new.yaml")
    assert again.parameters() == changed.parameters()
    assert again.stiffness[0] == 123456.78901234
    assert zoo().to_yaml() == ZOO


def test_a_damping_the_file_lacks_is_written_beside_its_stiffness() -> None:
    text = ZOO.replace(
        "      x:\n        stiffness: 7 kN m/rad   # guessed\n        damping: 12\n", ""
    ).replace("    mass: 500 g", "      y:\n        stiffness: 7 kN m/rad   # guessed\n    mass: 500 g")
    changed = Robot.from_yaml(text).with_values(
        {
            "links.slide.elasticity.ty.damping": 5,
            "links.slide.elasticity.y.damping": 6,
            "links.turret.elasticity.joint.damping": 7,
            "bushings.cable.damping.x": 8,
            "bushings.cable.damping.rx": 9,
        }
    )
    assert changed.to_yaml() == text.replace(
        "ty: {stiffness: 4.0e6}   # from", "ty: {stiffness: 4.0e6, damping: 5}   # from"
    ).replace(
        "        stiffness: 7 kN m/rad   # guessed\n",
        "        stiffness: 7 kN m/rad   # guessed\n        damping: 6\n",
    ).replace("{stiffness: 1.0e5,", "{stiffness: 1.0e5, damping: 7,").replace(
        "[1, 2, 3, 4, 5, 0],", "[1, 2, 3, 4, 5, 0], damping: [8, 0, 0, 9, 0, 0],"
    )


def test_a_damping_goes_before_a_stiffness_matrix_written_in_rows() -> None:
    text = ZOO.replace("    damping: [1, 1, 1, 2, 2, 2]\n", "")
    changed = Robot.from_yaml(text).with_values({"bushings.mount.damping.y": 3})
    assert changed.to_yaml() == text.replace(
        "    stiffness:\n      - [", "    damping: [0, 3, 0, 0, 0, 0]\n    stiffness:\n      - ["
    )


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_line_ends_stay_as_they_are(tmp_path, line_end) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(catalog.read("kuka_kr90").replace("\n", line_end).encode())
    load(path).with_values({"links.arm.elasticity.z.damping": 250}).save(path)
    assert (
        path.read_bytes()
        == catalog.read("kuka_kr90")
        .replace("damping: 200}", "damping: 250}")
        .replace("\n", line_end)
        .encode()
    )


@given(st.floats(1e-29, 1e29), st.floats(0, 1e29))
def test_any_value_comes_back_exactly_as_it_was_given(stiffness, damping) -> None:
    robot = Robot.from_yaml(ZOO)
    values = {
        "links.slide.elasticity.ty.stiffness": stiffness,
        "links.slide.elasticity.ty.damping": damping,
        "bushings.cable.damping.z": damping,
    }
    changed = robot.with_values(values)
    assert {path: changed.parameters(path)[path] for path in values} == values
    assert Robot.from_yaml(changed.to_yaml()).parameters() == changed.parameters()


def test_numbers_are_written_with_the_digits_they_need() -> None:
    def text(value: float) -> str:
        changed = zoo().with_values({"links.slide.elasticity.ty.stiffness": value}).to_yaml()
        return changed.split("ty: {stiffness: ")[1].split("}")[0]

    assert [text(v) for v in (20.0, 0.35, 6.1e6, 12345678.9, 1 / 3, 1e-9)] == [
        "20",
        "0.35",
        "6.1e6",
        "1.23456789e7",
        "0.3333333333333333",
        "1.0e-9",
    ]


@pytest.mark.parametrize("value", [math.nan, math.inf, True, "5 kg", None, 1e31])
def test_a_changed_value_must_be_a_finite_number(value) -> None:
    with pytest.raises(UpdateError, match=r"links\.arm\.elasticity\.z\.stiffness"):
        load("kuka_kr90").with_values({"links.arm.elasticity.z.stiffness": value})


def test_a_changed_value_must_stay_possible_and_within_its_bounds() -> None:
    with pytest.raises(RobotFileError, match="positive"):
        load("kuka_kr90").with_values({"links.arm.elasticity.z.stiffness": -1.0})
    with pytest.raises(RobotFileError, match="bounds that contain the value 5e"):
        load(START).with_values({"links.arm.elasticity.z.stiffness": 5e7})


def test_copies_and_pickles_are_the_same_robot() -> None:
    robot = load(START)
    assert robot.mechanism.n == 9
    for twin in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)):
        assert twin.to_yaml() == robot.to_yaml()
        assert twin.path == START


def test_saving_replaces_the_file_whole_and_keeps_its_mode_and_links(tmp_path) -> None:
    real, link = tmp_path / "real.yaml", tmp_path / "link.yaml"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    load("huynh_3r").save(link)
    assert link.is_symlink()
    assert real.read_text() == catalog.read("huynh_3r")
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link.yaml", "real.yaml"]


def test_saving_to_an_impossible_place_is_one_clear_error(tmp_path, monkeypatch) -> None:
    robot = load("huynh_3r")
    with pytest.raises(DataFileError, match="a directory"):
        robot.save(tmp_path)
    with pytest.raises(DataFileError, match="cannot be written"):
        robot.save(tmp_path / "no" / "such" / "folder.yaml")
    kept = tmp_path / "kept.yaml"
    kept.write_text("kept")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DataFileError, match="No space left"):
        robot.save(kept)
    assert kept.read_text() == "kept"
    assert [p.name for p in tmp_path.iterdir()] == ["kept.yaml"]


# --- loading --------------------------------------------------------------------------------------


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


# --- check ----------------------------------------------------------------------------------------


def findings(text: str) -> dict[str, Finding]:
    return {finding.where: finding for finding in check(Robot.from_yaml(text))}


def test_check_reports_what_is_missing_from_a_minimal_robot() -> None:
    found = findings(MINIMAL)
    assert found["posture zero"].level == "error"
    assert "a.z moves no mass" in found["posture zero"].message
    assert {where: f.level for where, f in found.items()} == {
        "posture zero": "error",
        "links": "warning",
        "links.a.mass": "warning",
        "postures": "warning",
    }


def test_check_tells_an_impossible_inertia_from_an_inexact_one() -> None:
    impossible = catalog.read("huynh_3r").replace("xx: 5.014,", "xx: 0.2,")
    assert findings(impossible)["links.link_arm.inertia"].level == "error"
    # Link 6 of the Scompi robot as printed by Do et al. 2022, Table 3: (0.001, 0.001, 0.012).
    inexact = catalog.read("huynh_3r").replace(
        "{xx: 5.882, yy: 49.927, zz: 48.9, xy: 1.372, xz: -0.074, yz: 1.202}",
        "{xx: 0.001, yy: 0.001, zz: 0.012}",
    )
    finding = findings(inexact)["links.arm.inertia"]
    assert finding.level == "warning"
    assert "triangle" in finding.message


def test_check_takes_a_rod_and_a_point_for_possible_bodies() -> None:
    rod = catalog.read("huynh_3r").replace(
        "{xx: 5.882, yy: 49.927, zz: 48.9, xy: 1.372, xz: -0.074, yz: 1.202}", "{yy: 49.9, zz: 49.9}"
    )
    assert findings(rod) == {}
    point = catalog.read("huynh_3r").replace(
        "    inertia: {xx: 5.882, yy: 49.927, zz: 48.9, xy: 1.372, xz: -0.074, yz: 1.202}\n", ""
    )
    assert findings(point) == {}


def test_check_names_locked_joints_and_free_coordinates_without_a_bushing() -> None:
    text = catalog.read("huynh_3r").replace("z: {stiffness: 1.55e6, damping: 340}", "x: free")
    found = findings(text)
    assert "arm.z is locked" in found["links.arm.elasticity"].message
    assert "no bushing" in found["links.arm.elasticity.x"].message


def test_check_finds_coordinates_that_move_the_same_mass_at_a_named_posture() -> None:
    # Three turns about one point with parallel axes when the middle one is at rest.
    text = catalog.read("huynh_3r").replace("[{x: 1350 mm}]", "[]")
    text = text.replace("    mass: 249.53\n    com: [0.532, -0.007, 0.248]\n", "").replace(
        "    inertia: {xx: 5.014, yy: 57.621, zz: 56.853, xy: 1.058, xz: -5.498, yz: 0.069}\n", ""
    )
    finding = findings(text)["posture milling"]
    assert finding.level == "error"
    assert "not positive definite" in finding.message
