"""Any number of a robot file: found by path, changed, and saved with the rest of the file as it was."""

from __future__ import annotations

import difflib
import json
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armonic as am
from armonic import catalog
from armonic.description.units import UNITS
from armonic.errors import RobotFileError, UpdateError
from armonic.robot import Robot, load
from robot_files import DRIVEN as GOOD
from robot_files import MINIMAL, ZOO

SOURCES = {
    "zoo": ZOO,
    "driven": GOOD,
    "scompi": catalog.read("scompi").replace("mass: 0}", "mass: 4}"),
    "kuka": catalog.read("kuka_kr90"),
}


def other(path: str, value: float) -> float:
    """Another value that the number may have in these files."""
    return value * 1.0625 if value else 0.125


# --- finding -------------------------------------------------------------------------------------------


def test_every_number_of_a_file_has_a_path() -> None:
    numbers = Robot.from_yaml(GOOD).numbers()
    body = ("mass", "com.x", "com.y", "com.z", *(f"inertia.{key}" for key in ("xx", "yy", "zz", "xy", "xz", "yz")))
    drive = ("gear_ratio", "rotor_inertia", "shaft_stiffness", "motor_damping", "joint_damping")
    gains = ("ki", "kd", "link_kp", "link_ki", "link_kd")
    expected = [
        *(f"links.rail.dh.{key}" for key in ("theta", "d", "a", "alpha")),
        *(f"links.rail.drive.{key}" for key in (*drive, "radius")),
        *(f"links.rail.{key}" for key in body),
        *(f"links.arm.elasticity.x.{key}" for key in ("stiffness", "damping")),
        *(f"links.arm.drive.{key}" for key in drive),
        *(f"links.arm.{key}" for key in body),
        *(f"links.hand.{key}" for key in body),
        *(f"frames.tip.placement.0.{key}" for key in "xyz"),
        *(f"tool.{key}" for key in body),
        *(f"control.kp.{link}" for link in ("rail", "arm")),
        *(f"control.{key}" for key in gains),
        *(
            f"control.state_feedback.position.{row}.{column}"
            for row in ("rail", "arm")
            for column in ("rail.tz", "arm.y", "rail.motor", "arm.motor")
        ),
        *(f"gravity.{axis}" for axis in "xyz"),
    ]
    assert list(numbers) == expected
    assert numbers["links.rail.dh.theta"] == math.pi / 2
    assert numbers["links.rail.drive.radius"] == 0.057
    assert numbers["links.hand.com.x"] == numbers["control.ki"] == 0
    assert numbers["control.state_feedback.position.arm.rail.motor"] == 7
    assert numbers["gravity.z"] == -9.81


def test_a_placement_has_the_turns_it_gives_and_all_three_shifts() -> None:
    assert Robot.from_yaml(ZOO).numbers("links.slide.placement.*") == {
        "links.slide.placement.0.x": 0.1,
        "links.slide.placement.0.y": 0.02,
        "links.slide.placement.0.z": 0.0,
        "links.slide.placement.1.rz": math.pi / 2,
    }


def test_patterns_and_groups_select_numbers() -> None:
    robot = load("scompi")
    assert list(robot.numbers("links.*.mass, tool.mass")) == [
        *(f"links.link_{i}.mass" for i in range(1, 7)),
        "tool.mass",
    ]
    assert robot.numbers(["control.kp", "control.kd"]) == {"control.kp": 15000.0, "control.kd": 52.0}
    # The groups are those of a fit: no shaft, no motor.
    zoo = Robot.from_yaml(ZOO)
    assert zoo.numbers("stiffness") == zoo.parameters("stiffness")
    with pytest.raises(UpdateError, match="'damping'"):
        robot.numbers("damping")


def test_units_are_those_of_the_quantity() -> None:
    robot = Robot.from_yaml(GOOD)
    units = {
        "links.rail.drive.gear_ratio": "",
        "links.rail.drive.shaft_stiffness": "N m/rad",
        "links.rail.drive.joint_damping": "N s/m",
        "links.arm.drive.joint_damping": "N m s/rad",
        "links.rail.dh.alpha": "rad",
        "links.rail.mass": "kg",
        "tool.inertia.xy": "kg m^2",
        "control.kp": "N m/rad",
        "control.ki": "N m/(rad s)",
        "control.state_feedback.position.rail.rail.tz": "N/rad",  # a torque for a displacement, a force for a turn
        "control.state_feedback.position.rail.rail.motor": "N m/rad",
        "gravity.x": "m/s^2",
    }
    assert {path: robot.unit(path) for path in units} == units
    assert robot.bounds("links.rail.mass") is None
    assert "N" in UNITS["coupling stiffness"]


# --- changing ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("source", SOURCES)
def test_each_number_can_be_changed_and_nothing_else_changes(source) -> None:
    text = SOURCES[source]
    robot = Robot.from_yaml(text)
    before = robot.numbers()
    for path, value in before.items():
        new = other(path, value)
        changed = robot.with_values({path: new})
        assert changed.numbers() == before | {path: new}
        lines = list(difflib.unified_diff(text.splitlines(), changed.to_yaml().splitlines(), n=0, lineterm=""))[2:]
        # One line is another, or one is new: comments and all else are kept.
        assert sum(line.startswith("+") for line in lines) == 1
        assert sum(line.startswith("-") for line in lines) <= 1
        again = changed.with_values({path: value})
        assert again.numbers() == before


@pytest.mark.parametrize("source", SOURCES)
def test_the_text_of_a_changed_robot_is_the_changed_robot(source) -> None:
    robot = Robot.from_yaml(SOURCES[source])
    changed = robot.with_values({path: other(path, value) for path, value in robot.numbers().items()})
    again = Robot.from_yaml(changed.to_yaml())
    assert again.numbers() == changed.numbers()
    for name in ("placements", "masses", "coms", "inertias", "frame_placements", "stiffness", "damping"):
        assert np.array_equal(getattr(again.tree, name), getattr(changed.tree, name))
    for one, two in ((again.drives, changed.drives), (again.control, changed.control)):
        assert all(np.array_equal(value, getattr(two, name)) for name, value in vars(one).items())
    twin = pickle.loads(pickle.dumps(changed))
    assert twin.numbers() == changed.numbers()


@pytest.mark.parametrize("indent", [None, 1])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_numbers_change_in_files_written_as_json(indent, line_end) -> None:
    robot = Robot.from_yaml(GOOD)
    data = json.loads(json.dumps(robot.description.model_dump(exclude_unset=True)))
    text = json.dumps(data, indent=indent).replace("\n", line_end)
    robot = Robot.from_yaml(text)
    values = {"tool.mass": 3.0, "control.kd": 7.5, "links.hand.com.y": 0.5, "links.rail.dh.a": 0.25, "gravity.x": 1.0}
    changed = Robot.from_yaml(robot.with_values(values).to_yaml())
    assert changed.numbers() == robot.numbers() | values


def test_what_the_file_leaves_out_is_added_where_it_belongs() -> None:
    robot = Robot.from_yaml(GOOD.replace("    dh: {theta: 90 deg, d: 0.1}", "    dh: {}   # none"))
    changed = robot.with_values(
        {
            "gravity.x": 1,
            "links.rail.dh.a": 0.25,
            "links.rail.dh.d": 0.5,
            "links.rail.com.z": -0.125,
            "links.arm.drive.joint_damping": "2 N m s/rad",
            "links.hand.inertia.xx": 1,
            "links.hand.inertia.xy": 0.5,
            "control.ki": 9,
            "tool.inertia.xz": 0.25,
            "frames.tip.placement.0.z": "5 mm",
        }
    )
    added = {
        "name: Driven arm\n": "name: Driven arm\ngravity: [1, 0, -9.81]\n",
        "{theta: 90 deg, d: 0.1}": "{a: 0.25, d: 0.5}   # none",
        "    mass: 10\n": "    mass: 10\n    com: [0, 0, -0.125]\n",
        "      shaft_stiffness: 3.0e4\n": "      shaft_stiffness: 3.0e4\n      joint_damping: 2\n",
        "{type: fixed}, mass: 1}": "{type: fixed}, mass: 1, inertia: {xx: 1, xy: 0.5}}",
        "  kd: 3\n": "  kd: 3\n  ki: 9\n",
        "zz: 1}}": "zz: 1, xz: 0.25}}",
        "{x: 1}": "{x: 1, z: 0.005}",
    }
    expected = GOOD
    for old, new in added.items():
        assert old in GOOD
        expected = expected.replace(old, new, 1)
    assert changed.to_yaml() == expected


def test_a_mapping_of_block_collections_takes_a_new_key_before_the_first() -> None:
    start = GOOD.index("  kp: [100, 200]")
    end = GOOD.index("postures:")
    text = GOOD[:start] + "  kp:   # per motor\n    - 100\n    - 200\n" + GOOD[end:]
    changed = Robot.from_yaml(text).with_values({"control.kd": 3, "control.ki": 4})
    assert changed.to_yaml() == text.replace("  kp:   #", "  kd: 3\n  ki: 4\n  kp:   #")
    assert changed.control.kp.tolist() == [100, 200]


def test_the_gain_of_all_motors_sets_each_one_of_a_list() -> None:
    robot = Robot.from_yaml(GOOD)
    assert robot.with_values({"control.kp": 500}).to_yaml() == GOOD.replace("[100, 200]", "[500, 500]")
    one = robot.with_values({"control.kp.arm": "1 kN m/rad"})
    assert one.to_yaml() == GOOD.replace("[100, 200]", "[100, 1000]")
    assert one.control.kp.tolist() == [100, 1000]
    # The later word counts, also where it is the old number.
    assert robot.with_values({"control.kp": 500, "control.kp.arm": 200}).control.kp.tolist() == [500, 200]
    assert robot.with_values({"control.kp.arm": 7, "control.kp": 500}).control.kp.tolist() == [500, 500]


def test_a_number_that_stays_equal_keeps_its_text() -> None:
    robot = Robot.from_yaml(GOOD)
    same = robot.with_values(robot.numbers() | {"control.kd": 3, "links.rail.drive.radius": "57 mm"})
    assert same.to_yaml() == GOOD


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-29, 1e29), st.floats(-1e29, 1e29))
def test_any_value_comes_back_exactly_as_it_was_given(size, shift) -> None:
    values = {"tool.mass": size, "links.link_3.drive.rotor_inertia": size, "links.link_1.com.x": shift,
              "frames.base_mark.placement.0.y": shift, "control.ki": size}  # fmt: skip
    text = catalog.read("scompi").replace(
        "frames:\n", "frames:\n  - {name: base_mark, link: base, placement: [{x: 1}]}\n"
    )
    changed = Robot.from_yaml(text).with_values(values)
    for robot in (changed, Robot.from_yaml(changed.to_yaml())):
        assert {path: robot.numbers(path)[path] for path in values} == values


def test_a_changed_robot_moves_otherwise() -> None:
    robot = load("scompi")
    q = robot.posture("c8")
    heavier = robot.with_values({"tool.mass": 4})
    assert heavier.mechanism.mass_matrix(q)[0, 0] == pytest.approx(robot.mechanism.mass_matrix(q)[0, 0] + 4)
    assert robot.with_values({"control.kp": 2000}).control.kp.tolist() == [2000] * 6
    longer = robot.with_values({"links.link_3.dh.a": 0.5})
    tip = robot.frame_index("link_3")
    distances = [
        np.linalg.norm(r.mechanism.pose(q, tip)[:3, 3] - r.mechanism.pose(q, tip - 1)[:3, 3]) for r in (robot, longer)
    ]
    assert distances == pytest.approx([0.42, 0.5])
    assert robot.numbers("links.link_3.dh.a") == {"links.link_3.dh.a": 0.42}


# --- refusing ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "path", "hint"),
    [
        ("scompi", "tool.mas", "Did you mean tool.mass?"),
        ("scompi", "control.kq", "Did you mean control.kp?"),
        ("scompi", "control.kp.link_1", "control.kp is one number for all motors"),
        ("driven", "control.kp.rial", "Did you mean control.kp.rail?"),
        ("scompi", "link_3.mass", "Did you mean links.link_3.mass?"),
        ("kuka", "tool.mass", "The file has no tool"),
        ("kuka", "control.kp", "The file has no control"),
        ("kuka", "links.arm.drive.gear_ratio", "The file has no links.arm.drive"),
        ("kuka", "links.arm.dh.a", "The file has no links.arm.dh"),
        ("kuka", "links.arms.mass", "Did you mean links.arm.mass?"),
    ],
)
def test_an_unknown_path_says_what_would_do(source, path, hint) -> None:
    robot = Robot.from_yaml(SOURCES[source])
    for call in (robot.numbers, robot.unit, robot.bounds, lambda p: robot.with_values({p: 1.0})):
        with pytest.raises(UpdateError) as caught:
            call(path)
        assert repr(path) in str(caught.value)
        assert hint in (caught.value.hint or "")


def test_all_gains_together_have_no_one_value_where_the_file_lists_them() -> None:
    with pytest.raises(UpdateError, match=r"control\.kp\.rail, control\.kp\.arm"):
        Robot.from_yaml(GOOD).numbers("control.kp")


@pytest.mark.parametrize("path", ["control.kp", "links.*.mass", "links.link_2.drive.shaft_stiffness", "tool.com.x"])
def test_a_fit_refuses_numbers_that_are_no_elasticity(path) -> None:
    for robot in (load("scompi"), Robot.from_yaml(SOURCES["scompi"].replace("    mass: 19", SPRING))):
        with pytest.raises(UpdateError, match="a fit does not change it"):
            robot.parameters(path)
    with pytest.raises(UpdateError, match="a fit does not change it"):
        robot.parameters(["stiffness", path])


SPRING = "    elasticity: {x: {stiffness: 1.0e6}}\n    mass: 19"


@pytest.mark.parametrize(
    ("path", "value", "where", "expected"),
    [
        ("tool.mass", -1, "line 105, tool.mass", "0 or larger"),
        ("control.kp", -1.0, "line 108, control.kp", "0 or larger"),
        ("links.link_1.drive.radius", 0, "line 26, links.link_1.drive.radius", "positive"),
        ("links.link_2.drive.gear_ratio", -3, "line 36, links.link_2.drive.gear_ratio", "positive"),
        ("tool.inertia.xx", 1, "line 105, tool.inertia", "positive mass"),
    ],
)
def test_an_impossible_value_is_placed_in_the_changed_text(path, value, where, expected) -> None:
    with pytest.raises(RobotFileError) as caught:
        load("scompi").with_values({path: value})
    assert caught.value.where == f"scompi.yaml, {where}"
    assert expected in caught.value.expected


@pytest.mark.parametrize("value", [math.nan, math.inf, True, "5 N", None, [1], 1e31])
def test_a_value_must_be_a_finite_number_of_its_kind(value) -> None:
    for path in ("tool.mass", "control.kp", "links.link_2.drive.gear_ratio"):
        with pytest.raises(UpdateError, match=path):
            load("scompi").with_values({path: value})


def test_a_layout_that_leaves_no_place_for_a_key_is_refused() -> None:
    text = MINIMAL.replace("links: [{name: a,", "links:\n- ? name\n  : a\n  ? parent\n  : base\n  ?").replace(
        "parent: base, joint: {type: revolute, axis: z}}]", " joint\n  : {type: revolute, axis: z}\n"
    )
    robot = Robot.from_yaml(text)
    with pytest.raises(RobotFileError, match="unusual layout"):
        robot.with_values({"links.a.mass": 1})


def test_a_survey_of_values_does_not_read_the_text_again(monkeypatch) -> None:
    robot = load("scompi")
    robot.with_values({"control.kp": 1.0, "control.ki": 1.0})

    def read(_: object) -> None:
        raise AssertionError("read again")

    monkeypatch.setattr("armonic.description.document._Reader.read", read)
    changed = robot.with_values({"control.kp": 2.0, "control.ki": 3.0})
    assert changed.control.kp[0] == 2
    assert "kp: 2, kd: 52, ki: 3" in changed.to_yaml()
    assert am.check(changed)
