"""Bad drives, gains, Denavit-Hartenberg lines, tools and paths: one clear error with line and dotted path."""
# ruff: noqa: E501  (tables, one case per line)

from __future__ import annotations

from pathlib import Path

import pytest

from armonic.errors import RobotFileError
from armonic.robot import Robot
from robot_files import DRIVEN as GOOD

NO_DRIVES = (
    GOOD[: GOOD.index("    drive: {gear")]
    + GOOD[GOOD.index("    mass: 10") : GOOD.index("    drive:\n")]
    + GOOD[GOOD.index("    mass: 5") :]
)

# old text -> new text, then line, dotted path, part of found, part of expected, part of the hint
FAULTS = {
    "ratio zero": ("gear_ratio: 50", "gear_ratio: 0", 8, "links.rail.drive.gear_ratio", "0", "positive", ""),
    "ratio negative": ("gear_ratio: 50", "gear_ratio: -5", 8, "links.rail.drive.gear_ratio", "-5", "positive", ""),
    "ratio with unit": ("gear_ratio: 50", "gear_ratio: 5 m", 8, "links.rail.drive.gear_ratio", "'5 m'", "a number", ""),
    "ratio missing": ("gear_ratio: 50, ", "", 8, "links.rail.drive", "no gear_ratio", "key gear_ratio", ""),
    "ratio vanishing": ("gear_ratio: 50", "gear_ratio: 1.0e-200", 8, "links.rail.drive.gear_ratio", "1e-200", "1e-30", ""),
    "inertia zero": ("inertia: 2.0e-4", "inertia: 0", 16, "links.arm.drive.rotor_inertia", "0", "positive", ""),
    "inertia negative": ("inertia: 2.0e-4", "inertia: -1", 16, "links.arm.drive.rotor_inertia", "-1", "positive", ""),
    "inertia unit": ("inertia: 2.0e-4", "inertia: 5 kg", 16, "links.arm.drive.rotor_inertia", "'5 kg'", "kg cm^2", "mass"),
    "shaft zero": ("stiffness: 3.0e4", "stiffness: 0", 17, "links.arm.drive.shaft_stiffness", "0", "positive", ""),
    "shaft negative": ("stiffness: 3.0e4", "stiffness: -1 N m/rad", 17, "links.arm.drive.shaft_stiffness", "-1", "positive", ""),
    "shaft of a slide": ("2.0e4,", "2 N/m,", 8, "links.rail.drive.shaft_stiffness", "'2 N/m'", "N m/rad", "translational"),
    "damping negative": ("3 N s/m", "-3 N s/m", 8, "links.rail.drive.joint_damping", "-3", "0 or larger", ""),
    "damping of a slide": ("3 N s/m", "3 N m s/rad", 8, "links.rail.drive.joint_damping", "'3 N m s/rad'", "N s/m", "rotational"),
    "motor damping": ("shaft_stiffness: 3.0e4", "shaft_stiffness: 1\n      motor_damping: -1", 18, "links.arm.drive.motor_damping", "-1", "0 or larger", ""),
    "no radius": (", radius: 57 mm", "", 8, "links.rail.drive", "no radius", "key radius", ""),
    "radius zero": ("57 mm", "0", 8, "links.rail.drive.radius", "0", "positive", ""),
    "radius empty": ("57 mm", "", 8, "links.rail.drive.radius", "nothing", "a number in m", ""),
    "radius of a turn": ("shaft_stiffness: 3.0e4", "radius: 1\n      shaft_stiffness: 1", 17, "links.arm.drive.radius", "revolute joint", "no radius", "same angle"),
    "drive of a fixed joint": ("type: fixed}", "type: fixed}, drive: {gear_ratio: 5}", 20, "links.hand.drive", "fixed joint", "joint that moves", ""),
    "drive key": ("rotor_inertia: 2.0e-4", "rotor_inertai: 1", 16, "links.arm.drive.rotor_inertai", "unknown key", "rotor_inertia", "rotor_inertia?"),
    "drive empty": ("    drive:\n      gear_ratio: 100\n      rotor_inertia: 2.0e-4\n      shaft_stiffness: 3.0e4\n", "    drive:\n", 14, "links.arm.drive", "nothing", "gear_ratio", ""),
    "drive a number": ("    drive:\n      gear_ratio: 100\n      rotor_inertia: 2.0e-4\n      shaft_stiffness: 3.0e4\n", "    drive: 5\n", 14, "links.arm.drive", "5", "gear_ratio", ""),
    "spring and drive": ("{x: {stiffness: 1.0e6}}", "{y: {stiffness: 1.0e6}}", 13, "links.arm.elasticity.y", "driven coordinate", "no such key", "shaft"),
    "free and driven": ("{x: {stiffness: 1.0e6}}", "{y: free}", 13, "links.arm.elasticity.y", "driven coordinate", "no such key", "shaft"),
    "dh key": ("d: 0.1", "dd: 0.1", 6, "links.rail.dh.dd", "unknown key 'dd'", "theta, d, a, alpha", "Did you mean d?"),
    "dh empty": ("{theta: 90 deg, d: 0.1}", "", 6, "links.rail.dh", "nothing", "theta, d, a, alpha", ""),
    "dh list": ("{theta: 90 deg, d: 0.1}", "[1, 2, 3, 4]", 6, "links.rail.dh", "a list of 4", "theta, d, a, alpha", ""),
    "dh unit": ("d: 0.1", "d: 5 deg", 6, "links.rail.dh.d", "'5 deg'", "mm", "angle"),
    "dh and placement": ("    dh:", "    placement: []\n    dh:", 6, "links.rail.placement", "beside dh", "one of them", ""),
    "dh axis": ("{type: prismatic}", "{type: prismatic, axis: x}", 7, "links.rail.joint.axis", "'x'", "axis z", ""),
    "no axis without dh": ("{type: revolute, axis: y}", "{type: revolute}", 12, "links.arm.joint", "no axis", "axis of the revolute", ""),
    "tool frame": ("tool: {frame: tip", "tool: {frame: tap", 24, "tool.frame", "'tap'", "frame or link", "tip?"),
    "tool on the floor": ("tool: {frame: tip", "tool: {frame: floor", 24, "tool.frame", "'floor', which does not move", "on a link", ""),
    "tool on the base": ("tool: {frame: tip", "tool: {frame: base", 24, "tool.frame", "'base', which does not move", "on a link", ""),
    "tool without frame": ("{frame: tip, mass: 2", "{mass: 2", 24, "tool", "no frame", "key frame", ""),
    "tool mass": ("tip, mass: 2", "tip, mass: -2", 24, "tool.mass", "-2", "0 or larger", ""),
    "tool without mass": ("tip, mass: 2", "tip, mass: 0", 24, "tool.inertia", "without a mass", "positive mass", ""),
    "tool key": ("com: [0, 0, 0.1]", "cog: [0, 0, 0.1]", 24, "tool.cog", "unknown key 'cog'", "com", "com?"),
    "tool empty": (GOOD[GOOD.index("{frame: tip") : GOOD.index("control:")], "\n", 24, "tool", "nothing", "frame and mass", ""),
    "gains short": ("kp: [100, 200]", "kp: [100]", 26, "control.kp", "a list of 1", "a list of 2: rail.motor, arm.motor", ""),
    "gains long": ("kd: 3", "kd: [1, 2, 3]", 27, "control.kd", "a list of 3", "a list of 2: rail.motor, arm.motor", ""),
    "gain negative": ("kd: 3", "kd: -3", 27, "control.kd", "-3", "0 or larger", ""),
    "one gain negative": ("[100, 200]", "[100, -200]", 26, "control.kp[1]", "-200", "0 or larger", ""),
    "gain infinite": ("kd: 3", "kd: .inf", 27, "control.kd", "inf", "finite", ""),
    "gain unit": ("kd: 3", "kd: 3 N m/rad", 27, "control.kd", "'3 N m/rad'", "N m s/rad", "rotational stiffness"),
    "gain key": ("kd: 3", "kv: 3", 27, "control.kv", "unknown key 'kv'", "kp, ki, kd, link_kp", ""),
    "feedforward": ("kd: 3", "feedforward: 1", 27, "control.feedforward", "1", "true or false", ""),
    "control empty": (GOOD[GOOD.index("  kp: [") : GOOD.index("postures")], "", 25, "control", "nothing", "kp, ki, kd", ""),
    "feedback rows": ("[[1, 2, 3, 4], [5, 6, 7, 8]]", "[[1, 2, 3, 4]]", 29, "control.state_feedback.position", "a list of 1", "2 rows: rail.motor, arm.motor", ""),
    "feedback no rows": ("[[1, 2, 3, 4], [5, 6, 7, 8]]", "[]", 29, "control.state_feedback.position", "a list of 0", "2 rows", ""),
    "feedback columns": ("[5, 6, 7, 8]", "[5, 6]", 29, "control.state_feedback.position[1]", "a list of 2", "4: rail.tz, arm.y, rail.motor, arm.motor", ""),
    "feedback flat": ("[5, 6, 7, 8]", "5", 29, "control.state_feedback.position[1]", "5", "a row", ""),
    "feedback number": ("[5, 6, 7, 8]", "[5, 6, much, 8]", 29, "control.state_feedback.position[1][2]", "'much'", "N m/rad", ""),
    "feedback key": ("    position:", "    positions:", 29, "control.state_feedback.positions", "unknown key", "position, velocity", "position?"),
    "path of one": ("[home, [0, 0]]", "[home]", 33, "paths.way.through", "a list of 1", "two waypoints", ""),
    "path posture": ("[home, [0, 0]]", "[hone, [0, 0]]", 33, "paths.way.through[0]", "'hone'", "a posture", "home?"),
    "path waypoint short": ("[home, [0, 0]]", "[home, [0]]", 33, "paths.way.through[1]", "a list of 1", "2: rail.tz, arm.y", ""),
    "path waypoint unit": ("[home, [0, 0]]", "[home, [0, 1 mm]]", 33, "paths.way.through[1][1]", "'1 mm'", "deg", "length"),
    "path waypoint number": ("[home, [0, 0]]", "[home, 5]", 33, "paths.way.through[1]", "5", "name of a posture", ""),
    "path no list": ("[home, [0, 0]]", "home", 33, "paths.way.through", "'home'", "a list", ""),
    "points one": ("points: 5", "points: 1", 33, "paths.way.points", "1", "from 2 to 1000000", ""),
    "points many": ("points: 5", "points: 1000001", 33, "paths.way.points", "1000001", "from 2 to 1000000", ""),
    "points half": ("points: 5", "points: 2.5", 33, "paths.way.points", "2.5", "whole number", ""),
    "path key": ("points: 5", "steps: 5", 33, "paths.way.steps", "unknown key 'steps'", "through, points", ""),
    "path name": ("  way:", "  my way:", 33, "paths.my way", "'my way'", "a letter", ""),
    "top key": ("control:", "controls:", 25, "controls", "unknown key 'controls'", "control", "control?"),
}  # fmt: skip


def refusal(text: str) -> RobotFileError:
    with pytest.raises(RobotFileError) as caught:
        Robot.from_yaml(text, path=Path("robots/test.yaml"))
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 800
    return caught.value


def test_the_good_file_is_good() -> None:
    robot = Robot.from_yaml(GOOD)
    assert robot.motors == ("rail.motor", "arm.motor")
    assert robot.tree.masses.sum() == 18


@pytest.mark.parametrize("case", FAULTS.values(), ids=FAULTS)
def test_a_wrong_entry_is_named_with_its_line_and_what_belongs_there(case) -> None:
    old, new, line, path, found, expected, hint = case
    assert old in GOOD
    error = refusal(GOOD.replace(old, new, 1))
    assert error.where == f"robots/test.yaml, line {line}, {path}"
    assert found in error.found
    assert expected in error.expected
    assert hint in (error.hint or "")


def test_control_without_drives_is_refused() -> None:
    error = refusal(NO_DRIVES)
    assert error.where == "robots/test.yaml, line 20, control"
    assert error.found == "control without drives"
    assert "drive" in (error.hint or "")


def test_a_misspelt_posture_in_a_file_without_postures_says_so() -> None:
    error = refusal(GOOD.replace("postures:\n  home: [0.1, 30 deg]\n", ""))
    assert "no posture in this file" in (error.hint or "")
