"""A URDF, and a robot file that starts from one: the robot that Pinocchio reads, with the springs of the file."""

from __future__ import annotations

import os
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.cli import main
from armonic.errors import DataFileError, RobotFileError, UpdateError
from armonic.robot import Robot, load
from trees import Array, random_state, relative_difference
from urdf_files import FILE, GOOD, Oracle, random_urdf

DATA = Path(__file__).parent / "data"
UR5, GANTRY = DATA / "ur5.urdf", DATA / "gantry.urdf"
# Rounding in double precision, through a chain of some ten turns.
TOLERANCE = 1e-12


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a URDF and a robot file that starts from it."""
    (tmp_path / "arm.urdf").write_text(GOOD, "utf-8")
    (tmp_path / "arm.yaml").write_text(FILE, "utf-8")
    return tmp_path


def saved(folder: Path, text: str) -> Robot:
    (folder / "robot.urdf").write_text(text, "utf-8")
    return load(folder / "robot.urdf")


def matches(robot: Robot, text: str, q: Array, links: dict[str, str]) -> None:
    oracle, mechanism = Oracle.of(text, robot), robot.mechanism
    for ours, theirs in links.items():
        pose = mechanism.pose(q, robot.frame_index(ours))
        assert relative_difference(pose, oracle.pose(q, theirs)) < TOLERANCE
    assert relative_difference(mechanism.mass_matrix(q), oracle.mass_matrix(q)) < TOLERANCE
    assert relative_difference(mechanism.gravity_torque(q), oracle.gravity_torque(q)) < TOLERANCE


# --- the URDF by itself ---------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_the_ur5_is_the_robot_that_was_rewritten_by_hand(seed: int) -> None:
    robot, by_hand = load(UR5), load(DATA / "ur5.yaml")
    (q,) = random_state(seed, 6, count=1)
    assert robot.coordinates == tuple(
        f"{link}{'_link' if 'wrist' in link else ''}.{key}" for link, key in (c.split(".") for c in by_hand.coordinates)
    )
    for frame, same in (("ee_link", "ee_link"), ("spindle", "spindle"), ("wrist_3_link", "wrist_3")):
        ours = robot.mechanism.pose(q, robot.frame_index(frame))
        assert relative_difference(ours, by_hand.mechanism.pose(q, by_hand.frame_index(same))) < TOLERANCE
    for quantity in ("mass_matrix", "gravity_torque"):
        ours, expected = (getattr(one.mechanism, quantity)(q) for one in (robot, by_hand))
        assert relative_difference(ours, expected) < TOLERANCE


@pytest.mark.parametrize("seed", range(5))
def test_the_ur5_moves_as_pinocchio_reads_it(seed: int) -> None:
    robot = load(UR5)
    (q,) = random_state(seed, 6, count=1)
    matches(robot, UR5.read_text("utf-8"), q, {name: name for name in robot.frames if name != "base"})


@pytest.mark.parametrize("seed", range(20))
def test_random_urdfs_move_as_pinocchio_reads_them(seed: int, tmp_path: Path) -> None:
    text = random_urdf(seed)
    robot = saved(tmp_path, text)
    (q,) = random_state(seed, len(robot.coordinates), count=1)
    matches(robot, text, q, {name: name for name in robot.frames if name != "base"})


def test_what_urdfs_bring_along_does_not_matter() -> None:
    robot = load(GANTRY)
    (q,) = random_state(0, 3, count=1)
    links = {"_2nd_slide": "2nd slide", "head_1": "head/1", "tool0": "tool0", "urdf_base": "base"}
    matches(robot, GANTRY.read_text("utf-8"), q, links)


def test_names_become_names_of_a_robot_file() -> None:
    robot = load(GANTRY)
    assert robot.name == "Gantry & head"
    # The ground, the root, then the joints in the order of the file, but parents first.
    ordered = ("base", "base_link", "carriage", "_2nd_slide", "weight", "head_1", "urdf_base", "tool0")
    assert robot.frames == ordered
    assert robot.coordinates == ("carriage.tx", "_2nd_slide.joint", "head_1.joint")


@pytest.mark.parametrize("root", ["base", "world"])
def test_a_root_called_base_or_world_is_the_base(root: str, tmp_path: Path) -> None:
    robot = saved(tmp_path, GOOD.replace('"base"', f'"{root}"'))
    assert robot.frames == ("base", "upper", "fore", "tip")


def test_a_link_is_named_by_another_root_too(tmp_path: Path) -> None:
    robot = saved(tmp_path, GOOD.replace('"base"', '"stand"'))
    assert robot.frames == ("base", "stand", "upper", "fore", "tip")
    q = np.zeros(2)
    assert np.array_equal(robot.mechanism.pose(q, robot.frame_index("stand")), np.eye(4))


def test_an_axis_is_a_letter_where_it_is_one_and_x_where_it_is_missing(tmp_path: Path) -> None:
    assert saved(tmp_path, GOOD.replace('"0 1 0"', '"0 7 0"')).coordinates == ("upper.z", "fore.y")
    assert saved(tmp_path, GOOD.replace('<axis xyz="0 1 0"/>', "")).coordinates == ("upper.z", "fore.x")
    robot = saved(tmp_path, GOOD.replace('"0 1 0"', '"0 0 -3"'))
    assert robot.coordinates == ("upper.z", "fore.joint")
    assert robot.tree.axes[1].tolist() == [0, 0, -1]


def test_roll_pitch_and_yaw_turn_about_fixed_axes(tmp_path: Path) -> None:
    # Roll a quarter about x, then yaw a quarter about the first z: x to y, y to z, z to x.
    quarter = np.pi / 2
    robot = saved(tmp_path, GOOD.replace('"0 0 1" rpy="0 0 0"', f'"0 0 1" rpy="{quarter!r} 0 {quarter!r}"'))
    turned = robot.mechanism.pose(np.zeros(2), robot.frame_index("upper"))[:3, :3]
    np.testing.assert_allclose(turned, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)


def test_the_axes_of_an_inertial_may_be_turned(tmp_path: Path) -> None:
    # A quarter turn about z: the inertial's x is the link's y, its y the link's -x.
    tensor = '<inertia ixx="3" iyy="2" izz="1" ixy="0.1" ixz="0.2" iyz="0.3"/>'
    text = GOOD.replace('xyz="0 0 0.1" rpy="0 0 0"', f'xyz="1 2 3" rpy="0 0 {np.pi / 2!r}"')
    text = text.replace('<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>', tensor, 1)
    (link, *_) = saved(tmp_path, text).description.links
    assert link.com == (1, 2, 3)
    np.testing.assert_allclose(link.inertia.matrix(), [[2, -0.1, -0.3], [-0.1, 3, 0.2], [-0.3, 0.2, 1]], atol=1e-15)


def test_a_urdf_is_known_by_its_suffix_or_its_first_sign(tmp_path: Path) -> None:
    (tmp_path / "arm.txt").write_text("\ufeff\n" + GOOD, "utf-8")
    assert load(tmp_path / "arm.txt").coordinates == ("upper.z", "fore.y")
    (tmp_path / "ARM.URDF").write_text("name: arm", "utf-8")
    with pytest.raises(RobotFileError, match=r"ARM\.URDF, line 1: found a syntax error"):
        load(tmp_path / "ARM.URDF")


def test_any_declared_encoding_is_read_as_utf_8(tmp_path: Path) -> None:
    for encoding in ("UTF-7", "ISO-8859-1", "utf-8"):
        robot = saved(tmp_path, f'<?xml version="1.0" encoding="{encoding}"?>\n' + GOOD.replace('"arm"', '"Ärm"'))
        assert robot.name == "Ärm"


def test_a_urdf_becomes_a_robot_file_by_saving_it(folder: Path) -> None:
    robot = load(folder / "arm.urdf")
    assert robot.path == folder / "arm.urdf"
    assert robot.to_yaml() == 'armonic: 1\nname: "arm"\nurdf: "arm.urdf"\n'
    robot.save(folder / "new.yaml")
    assert load(folder / "new.yaml").coordinates == robot.coordinates
    with pytest.raises(DataFileError, match="the URDF that the robot starts from"):
        robot.save(folder / "arm.urdf")
    assert (folder / "arm.urdf").read_text("utf-8") == GOOD


# --- with a robot file -----------------------------------------------------------------------------


def test_the_file_gives_springs_frames_and_postures(folder: Path) -> None:
    robot = load(folder / "arm.yaml")
    assert robot.name == "Arm on a URDF"
    assert robot.coordinates == ("upper.z", "upper.x", "fore.y")
    assert robot.stiffness.tolist() == [1e5, 2e5, 5e4]
    assert robot.damping.tolist() == [10, 0, 4]
    assert robot.frames == ("base", "upper", "fore", "tip", "probe")
    np.testing.assert_allclose(robot.postures["bent"], np.radians([30, 0, 40]), rtol=1e-15)
    assert [finding.where for finding in am.check(robot)] == ["joint elbow"]
    assert len(am.modes(robot, "bent")) == 3


def test_the_example_of_the_docs_is_right() -> None:
    page = (DATA.parents[1] / "docs" / "robot_file.md").read_text("utf-8")
    (example,) = re.findall(r"```yaml\n([^`]*urdf: .*?)```", page, flags=re.DOTALL)
    robot = Robot.from_yaml(example, path=DATA / "example.yaml")
    assert robot.coordinates[2] == "forearm.y"
    assert robot.motors == ("wrist_1_link.motor",)
    np.testing.assert_allclose(robot.postures["reach"], np.radians([0, -90, 90, 0, 0, 0]), rtol=1e-15)


def test_postures_may_name_the_joints(folder: Path) -> None:
    by_name = Robot.from_yaml(FILE.replace("[30 deg, 40 deg]", "{elbow: 40 deg}"), path=folder / "arm.yaml")
    np.testing.assert_allclose(by_name.postures["bent"], np.radians([0, 0, 40]), rtol=1e-15)


def test_a_fixed_joint_may_have_springs(folder: Path) -> None:
    text = FILE.replace("  elbow:\n", "  flange: {elasticity: {tx: {stiffness: 1.0e6}}}\n  elbow:\n")
    robot = Robot.from_yaml(text, path=folder / "arm.yaml")
    assert robot.coordinates == ("upper.z", "upper.x", "fore.y", "tip.tx")


def test_a_robot_with_a_urdf_has_the_modes_of_the_same_robot_in_links(folder: Path) -> None:
    links = """
links:
  - name: upper
    parent: base
    placement: [{z: 1}]
    joint: {type: revolute, axis: z}
    elasticity: {z: {stiffness: 1.0e5, damping: 10}, x: {stiffness: 2.0e5}}
    mass: 2
    com: [0, 0, 0.1]
    inertia: {xx: 1, yy: 1, zz: 1}
  - name: fore
    parent: upper
    joint: {type: revolute, axis: y}
    elasticity: {y: {stiffness: 5.0e4, damping: 4}}
    mass: 1
    inertia: {xx: 1, yy: 1, zz: 1}
postures:
  bent: [30 deg, 40 deg]
"""
    by_hand = Robot.from_yaml(f"armonic: 1\nname: by hand{links}")
    ours, expected = (am.modes(robot, "bent").poles for robot in (load(folder / "arm.yaml"), by_hand))
    np.testing.assert_allclose(ours, expected, rtol=1e-12)


def test_new_values_go_into_the_robot_file(folder: Path) -> None:
    robot = load(folder / "arm.yaml")
    assert robot.bounds("links.fore.elasticity.y.stiffness") == (1e3, 1e6)
    changed = robot.with_values({"links.fore.elasticity.y.stiffness": 6e4, "links.upper.elasticity.x.damping": 3.0})
    expected = FILE.replace("5.0e4, d", "60000, d").replace("{stiffness: 2.0e5}", "{stiffness: 2.0e5, damping: 3}")
    assert changed.to_yaml() == expected
    assert changed.damping.tolist() == [10, 3, 4]
    with pytest.raises(UpdateError):
        robot.with_values({"links.fore.elasticity.z.stiffness": 1.0})
    with pytest.raises(RobotFileError, match=r"line 9, joints\.elbow\.elasticity\.y\.stiffness_bounds"):
        robot.with_values({"links.fore.elasticity.y.stiffness": 1.0})


def test_an_absolute_reference_and_a_package_are_found(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = tmp_path_factory.mktemp("other")
    (other / "arm_description" / "urdf").mkdir(parents=True)
    shutil.copy(folder / "arm.urdf", other / "arm_description" / "urdf")
    package = "urdf: package://arm_description/urdf/arm.urdf"
    for text, at in (
        (f"urdf: {folder / 'arm.urdf'}", other),
        (package, other),
        (package, other / "arm_description"),
    ):
        (at / "robot.yaml").write_text(FILE.replace("urdf: arm.urdf", text), "utf-8")
        assert load(at / "robot.yaml").coordinates == ("upper.z", "upper.x", "fore.y")


def test_a_text_without_a_path_starts_from_the_working_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    robot = Robot.from_yaml(FILE)
    monkeypatch.chdir("/")
    robot.save(folder / "again.yaml")
    assert (folder / "again.yaml").read_text("utf-8") == FILE


# --- saved and sent elsewhere ------------------------------------------------------------------------


def test_saving_beside_the_urdf_keeps_the_text(folder: Path) -> None:
    load(folder / "arm.yaml").save(folder / "copy.yaml")
    assert (folder / "copy.yaml").read_text("utf-8") == FILE


@pytest.mark.parametrize("written", ["arm.urdf", "'arm.urdf'   # here", "package://arm.urdf"])
def test_a_robot_saved_elsewhere_refers_to_the_urdf_from_there(folder: Path, written: str) -> None:
    (folder / "arm.yaml").write_text(FILE.replace("arm.urdf", written), "utf-8")
    (folder / "deep" / "er").mkdir(parents=True)
    robot = load(folder / "arm.yaml").with_values({"links.fore.elasticity.y.damping": 5.0})
    robot.save(folder / "deep" / "er" / "new.yaml")
    again = load(folder / "deep" / "er" / "new.yaml")
    assert 'urdf: "../../arm.urdf"' in again.to_yaml()
    assert again.damping.tolist() == robot.damping.tolist()
    assert ("# here" in again.to_yaml()) == ("# here" in written)


def test_a_folder_behind_a_link_gets_a_path_that_leads_to_the_urdf(folder: Path, tmp_path_factory) -> None:
    real = tmp_path_factory.mktemp("real")
    (real / "deep").mkdir()
    (folder / "link").symlink_to(real / "deep")
    load(folder / "arm.yaml").save(folder / "link" / "new.yaml")
    assert load(folder / "link" / "new.yaml").coordinates == ("upper.z", "upper.x", "fore.y")


def test_a_pickled_robot_needs_no_file(folder: Path) -> None:
    for name in ("arm.yaml", "arm.urdf"):
        robot = load(folder / name)
        sent = pickle.dumps(robot)
        (folder / "arm.urdf").rename(folder / "gone")
        again = pickle.loads(sent)
        (folder / "gone").rename(folder / "arm.urdf")
        assert (again.to_yaml(), again.path, again.coordinates) == (robot.to_yaml(), robot.path, robot.coordinates)
        assert np.array_equal(again.mechanism.mass_matrix(np.ones(again.mechanism.n)),
                              robot.mechanism.mass_matrix(np.ones(robot.mechanism.n)))  # fmt: skip
        assert again.urdf.content == robot.urdf.content == GOOD.encode()


@pytest.mark.parametrize("fate", ["gone", "changed"])
def test_a_urdf_that_has_gone_or_changed_is_saved_along(folder: Path, tmp_path_factory, fate: str) -> None:
    robot, new = load(folder / "arm.yaml"), tmp_path_factory.mktemp("new")
    if fate == "gone":
        (folder / "arm.urdf").unlink()
    else:
        (folder / "arm.urdf").write_text(GOOD.replace('value="2"', 'value="20"'), "utf-8")
    for name in ("one.yaml", "two.yaml"):
        robot.save(new / name)
        assert (new / name).read_text("utf-8") == FILE
        assert load(new / name).description.links[0].mass == 2
    assert sorted(os.listdir(new)) == ["arm.urdf", "one.yaml", "two.yaml"]  # noqa: PTH208
    with pytest.raises(DataFileError, match="the URDF that the robot starts from"):
        robot.save(new / "arm.urdf")


def test_a_copy_of_the_urdf_replaces_no_other_file(folder: Path) -> None:
    robot, other = load(folder / "arm.yaml"), GOOD.replace('value="2"', 'value="20"')
    (folder / "arm.urdf").write_text(other, "utf-8")
    with pytest.raises(DataFileError, match=r"arm\.urdf: found a file that is not the URDF which was loaded"):
        robot.save(folder / "new.yaml")
    assert (folder / "arm.urdf").read_text("utf-8") == other
    assert not (folder / "new.yaml").exists()


def test_a_urdf_whose_path_no_text_can_hold_is_told(folder: Path) -> None:
    odd = folder / "line\nbreak"
    odd.mkdir()
    for name in ("arm.yaml", "arm.urdf"):
        shutil.move(folder / name, odd)
    with pytest.raises(DataFileError, match="expected a printable path"):
        load(odd / "arm.yaml").save(folder / "new.yaml")


# --- check -------------------------------------------------------------------------------------------


def test_check_takes_a_urdf(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["check", str(folder / "arm.urdf")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "arm.urdf: arm" in printed
    assert "No joint has elasticity" in printed
    assert main(["check", str(folder / "arm.urdf"), "--json"]) == 0
    (folder / "arm.urdf").write_text(GOOD.replace('type="revolute"', 'type="floating"'), "utf-8")
    capsys.readouterr()
    assert main(["check", str(folder / "arm.urdf")]) == 2
    printed = " ".join(capsys.readouterr().out.split())
    assert "line 18, joint shoulder" in printed
    assert "line 24, joint elbow" in printed


def test_check_says_that_the_damping_of_a_urdf_is_not_used(folder: Path) -> None:
    robot = load(folder / "arm.urdf")
    (finding,) = [one for one in am.check(robot) if "damping" in one.message]
    assert (finding.level, finding.where) == ("warning", "joint elbow")
    assert not robot.damping.any()


def test_check_takes_massless_links_at_the_ends_of_a_urdf_for_frames() -> None:
    assert not [finding for finding in am.check(load(GANTRY)) if "mass" in finding.where]
