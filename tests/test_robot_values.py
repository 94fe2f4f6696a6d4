"""Stiffness and damping of a robot: found by path, changed, and saved with the rest of the file as it was."""

from __future__ import annotations

import copy
import math
import os
import pickle
import stat

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armonic import catalog
from armonic.errors import DataFileError, RobotFileError, UpdateError
from armonic.robot import Robot, load
from robot_files import MINIMAL, START, ZOO


def zoo() -> Robot:
    return Robot.from_yaml(ZOO)


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
        f"{what}.{direction}" for what in ("stiffness", "damping") for direction in ("x", "y", "z", "rx", "ry")
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
    text = ZOO.replace("      x:\n        stiffness: 7 kN m/rad   # guessed\n        damping: 12\n", "").replace(
        "    mass: 500 g", "      y:\n        stiffness: 7 kN m/rad   # guessed\n    mass: 500 g"
    )
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
        == catalog.read("kuka_kr90").replace("damping: 200}", "damping: 250}").replace("\n", line_end).encode()
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
