"""Bad URDFs, and robot files that do not fit theirs: one clear line each; nothing is fetched, expanded or opened."""
# ruff: noqa: E501  (tables, one case per line)

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armonic.cli import main
from armonic.description.plain_xml import MAX_BYTES
from armonic.errors import RobotFileError
from armonic.robot import Robot, load
from urdf_files import FILE, GOOD

DATA = Path(__file__).parent / "data"
XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
XINCLUDE = 'xmlns:xi="http://www.w3.org/2001/XInclude"'
FORE = GOOD[GOOD.index('  <link name="fore">') : GOOD.index('  <link name="tip"/>')]
ELBOW = GOOD[GOOD.index('  <joint name="elbow"') : GOOD.index('  <joint name="flange"')]


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place for a bad URDF."""
    monkeypatch.chdir(tmp_path)
    return Path("bad.urdf")


@pytest.fixture
def port() -> Iterator[int]:
    """A port of this machine where nobody may call."""
    with socket.create_server(("localhost", 0)) as server:
        yield server.getsockname()[1]
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()


def refusal(path: Path, content: str | bytes) -> RobotFileError:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(RobotFileError) as caught:
        load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("bad.urdf")
    assert len(message) < 700
    return caught.value


# --- what a URDF may not say: old text -> new text, then line and element, part of found, expected, hint ---------

FAULTS = {
    "no robot": ("robot", "sdf", "line 1", "<sdf>", "<robot>", ""),
    "unnamed robot": ('<robot name="arm">', "<robot>", "line 1", "no name", "attribute name", ""),
    "unnamed link": ('<link name="upper">', "<link>", "line 3", "no name in <link>", "attribute name", ""),
    "blank link": ('<link name="tip"/>', '<link name=" "/>', "line 17", "the name ' '", "attribute name", ""),
    "unnamed joint": ('joint name="elbow"', "joint", "line 24", "no name in <joint>", "attribute name", ""),
    "link twice": ('link name="tip"', 'link name="upper"', "line 17, link upper", "the link 'upper' again", "first on line 3", ""),
    "joint twice": ('joint name="flange"', 'joint name="elbow"', "line 30, joint elbow", "again", "first on line 24", ""),
    "no type": (' type="fixed"', "", "line 30, joint flange", "no type", "attribute type", ""),
    "type misspelt": ('"fixed"', '"fixd"', "line 30, joint flange", "'fixd'", "continuous", "fixed?"),
    "floating": ('"fixed"', '"floating"', "line 30, joint flange", "of type 'floating'", "revolute", "fixed joint with elasticity"),
    "planar": ('"fixed"', '"planar"', "line 30, joint flange", "of type 'planar'", "revolute", "fixed joint with elasticity"),
    "mimic": ('<dynamics damping="0.5"/>', '<mimic joint="shoulder"/>', "line 24, joint elbow", "mimics 'shoulder'", "by itself", "<mimic>"),
    "no parent": ('    <parent link="fore"/>\n', "", "line 30, joint flange", "no <parent>", "<parent>", ""),
    "no child": ('    <child link="tip"/>\n', "", "line 30, joint flange", "no <child>", "<child>", ""),
    "parent without a link": ('<parent link="fore"/>', "<parent/>", "line 31, joint flange", "no link in <parent>", "attribute link", ""),
    "two parents": ('<parent link="fore"/>', '<parent link="fore"/><parent link="base"/>', "line 31, joint flange", "<parent> again", "once", ""),
    "unknown parent": ('<parent link="fore"/>', '<parent link="for"/>', "line 30, joint flange", "parent 'for'", "name of a link", "Did you mean fore?"),
    "unknown child": ('<child link="tip"/>', '<child link="tap"/>', "line 30, joint flange", "child 'tap'", "name of a link", "tip?"),
    "loop": ('<child link="tip"/>', '<child link="upper"/>', "line 30, joint flange", "second joint that carries the link 'upper' (the first is shoulder)", "a tree", "loops"),
    "several roots": ('<link name="tip"/>', '<link name="tip"/><link name="box"/>', "line 17, link box", "base, box", "one link", ""),
    "cycle": ('<parent link="base"/>', '<parent link="tip"/>', "line 18, joint shoulder", "upper -> tip -> fore -> upper", "one root", ""),
    "own parent": ('<parent link="base"/>', '<parent link="upper"/>', "line 18, joint shoulder", "upper -> upper", "one root", ""),
    "axis zero": ('xyz="0 1 0"', 'xyz="0 0 -0"', "line 27, joint elbow", "zeros", "not zero", ""),
    "axis short": ('xyz="0 1 0"', 'xyz="0 1"', "line 27, joint elbow", "xyz='0 1' in <axis>", "3 numbers", ""),
    "axis long": ('xyz="0 1 0"', 'xyz="0 1 0 0"', "line 27, joint elbow", "'0 1 0 0'", "3 numbers", ""),
    "axis nan": ('xyz="0 1 0"', 'xyz="0 nan 0"', "line 27, joint elbow", "'0 nan 0'", "finite", ""),
    "axis infinite": ('xyz="0 1 0"', 'xyz="0 1e999 0"', "line 27, joint elbow", "'0 1e999 0'", "finite", ""),
    "axis misspelt": ('axis xyz="0 1 0"', 'axis xzy="0 1 0"', "line 27, joint elbow", "attribute 'xzy'", "xyz", ""),
    "origin nan": ('xyz="0 0 1" rpy', 'xyz="0 0 -nan" rpy', "line 21, joint shoulder", "'0 0 -nan'", "finite", ""),
    "origin with commas": ('xyz="0 0 1" rpy', 'xyz="0,0,1" rpy', "line 21, joint shoulder", "'0,0,1'", "3 numbers", ""),
    "origin by quaternion": ('"0 0 1" rpy="0 0 0"', '"0 0 1" quat_xyzw="0 0 0 1"', "line 21, joint shoulder", "'quat_xyzw'", "xyz, rpy", ""),
    "origin twice": ('<axis xyz="0 0 1"/>', "<origin/>", "line 22, joint shoulder", "<origin> again", "first on line 21", ""),
    "origin misspelt": ('<origin xyz="0 0 1" rpy="0 0 0"/>', '<orgin xyz="0 0 1"/>', "line 21, joint shoulder", "<orgin>", "origin", "<origin>?"),
    "inertial misspelt": ("inertial", "Inertal", "line 4, link upper", "<Inertal>", "inertial", "<inertial>?"),
    "link misspelt": ('<link name="tip"/>', '<lnk name="tip"/>', "line 17", "<lnk>", "link", "<link>?"),
    "no mass": ('      <mass value="2"/>\n', "", "line 4, link upper", "no <mass>", "<mass>", ""),
    "mass zero": ('<mass value="2"/>', '<mass value="0"/>', "line 4, link upper", "mass 0", "positive mass in kg", "no <inertial>"),
    "mass negative": ('<mass value="2"/>', '<mass value="-2"/>', "line 4, link upper", "mass -2", "positive mass in kg", ""),
    "mass infinite": ('<mass value="2"/>', '<mass value="inf"/>', "line 6, link upper", "'inf'", "finite", ""),
    "mass too large": ('<mass value="2"/>', '<mass value="1e31"/>', "line 6, link upper", "'1e31'", "at most 1e+30", ""),
    "mass with a unit": ('<mass value="2"/>', '<mass value="2 kg"/>', "line 6, link upper", "'2 kg'", "a number", ""),
    "mass of Python's": ('<mass value="2"/>', '<mass value="1_0"/>', "line 6, link upper", "'1_0'", "a number", ""),
    "no inertia": ('      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>\n', "", "line 4, link upper", "no <inertia>", "<inertia>", ""),
    "entry missing": (' iyz="0"', "", "line 7, link upper", "no iyz in <inertia>", "iyz", ""),
    "entry nan": ('iyz="0"', 'iyz="NaN"', "line 7, link upper", "iyz='NaN'", "finite", ""),
    "damping nan": ('damping="0.5"', 'damping="nan"', "line 28, joint elbow", "damping='nan'", "a damping", ""),
    "no inertial": (FORE, '  <link name="fore"/>\n', "line 11, link fore", "no <inertial>, though the joint elbow moves", "fixed to it", ""),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS.values(), ids=FAULTS)
def test_a_fault_is_told_with_its_line_and_element(case, path: Path) -> None:
    old, new, place, found, expected, hint = case
    assert old in GOOD
    text = GOOD.replace(old, new, -1 if old.isalpha() else 1)
    error = refusal(path, text)
    assert error.where == f"bad.urdf, {place}"
    assert found in error.found
    assert expected in error.expected
    assert hint in (error.hint or "")


def test_the_good_one_is_good_and_its_inertia_may_come_from_a_fixed_link(path: Path) -> None:
    path.write_text(GOOD)
    assert load(path).coordinates == ("upper.z", "fore.y")
    moved = GOOD.replace(FORE, '  <link name="fore"/>\n').replace('<link name="tip"/>', FORE.replace("fore", "tip"))
    path.write_text(moved)
    assert load(path).coordinates == ("upper.z", "fore.y")


def test_names_that_would_become_one_are_refused(path: Path) -> None:
    error = refusal(path, GOOD.replace('"fore"', '"fo re"').replace('"tip"', '"fo/re"'))
    assert error.where == "bad.urdf, line 17, link fo/re"
    assert error.found == "the link names 'fo re' and 'fo/re', which are both fo_re in a robot file"


def test_a_robot_without_joints_is_refused(path: Path) -> None:
    assert "no joint" in refusal(path, '<robot name="rock"><link name="rock"/></robot>').found


def test_the_first_error_brings_all_of_them_in_the_order_of_the_file(path: Path) -> None:
    text = GOOD.replace('"fixed"', '"planar"').replace('<mass value="1"/>', '<mass value="0"/>')
    error = refusal(path, text.replace('"0 0 1"', '"0 0 z"'))
    assert [one.where for one in error.errors] == [
        "bad.urdf, line 12, link fore",
        "bad.urdf, line 21, joint shoulder",
        "bad.urdf, line 30, joint flange",
    ]
    assert error.hint == "A link without a mass has no <inertial>. There are 2 more errors."


def test_a_link_after_the_last_that_moves_needs_no_inertia(path: Path) -> None:
    text = GOOD.replace('type="fixed"', 'type="prismatic"')
    assert "the joint flange moves" in refusal(path, text).found


# --- XML that reaches out, or blows up: text, line, part of found, part of the hint ---------------------------------

LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 10))
ROBOT = '<robot name="{}"/>'
XML = {
    "billion laughs": (f'<?xml version="1.0"?>\n<!DOCTYPE robot [<!ENTITY l0 "ha">{LAUGHS}]>\n{ROBOT.format("&l9;")}', 2, "DOCTYPE", "entities"),
    "quadratic blowup": (f'<!DOCTYPE r [<!ENTITY a "{"a" * 9999}">]><robot name="{"&a;" * 9999}"/>', 1, "DOCTYPE", "entities"),
    "external entity": ('<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n' + ROBOT.format("&x;"), 1, "DOCTYPE", "entities"),
    "parameter entity": ('<!-- a -->\n\n<!DOCTYPE r [<!ENTITY % x SYSTEM "http://localhost:1/x.dtd"> %x;]>\n' + GOOD, 3, "DOCTYPE", ""),
    "external subset": ('<!DOCTYPE robot SYSTEM "http://localhost:1/robot.dtd">' + GOOD, 1, "DOCTYPE", ""),
    "empty doctype": ("<!DOCTYPE robot>" + GOOD, 1, "DOCTYPE", ""),
    "small doctype": ("<!doctype robot>" + GOOD, 1, "DOCTYPE", ""),
    "late doctype": (GOOD + "<!DOCTYPE robot>", 35, "syntax error", ""),
    "hidden behind a declaration": ('<?xml version="1.0" <!DOCTYPE r [<!ENTITY x "y">]> ?>' + ROBOT.format("&x;"), 1, "processing instruction", ""),
    "hidden behind a comment": ("<!-->\n<!DOCTYPE robot>-->" + ROBOT.format("&x;"), 2, "syntax error", ""),
    "hidden in UTF-7": ('<?xml version="1.0" encoding="UTF-7"?>+ADwAIQ-DOCTYPE robot+AD4-' + GOOD, 1, "syntax error", ""),
    "undeclared entity": (GOOD.replace("arm", "&arm;", 1), 1, "'arm' not defined", ""),
    "XInclude": (GOOD.replace('<link name="tip"/>', f'<xi:include {XINCLUDE} href="/etc/passwd" parse="text"/>'), 17, "XInclude", ""),
    "XInclude by attribute": (GOOD.replace('<link name="tip"/>', f'<link {XINCLUDE} xi:href="x"/>'), 17, "XInclude", ""),
    "stylesheet": ('<?xml version="1.0"?>\n<?xml-stylesheet href="http://localhost:1/x.xsl"?>' + GOOD, 2, "processing instruction", "Remove"),
    "instruction inside": (GOOD.replace('<link name="tip"/>', '<?php system("id") ?><link name="tip"/>'), 17, "processing instruction", ""),
    "instruction at the end": (GOOD + "<?end?>", 35, "processing instruction", ""),
    "mesh in the net": (GOOD.replace("package://arm", "http://localhost:1"), 9, "address 'http://localhost:1/upper.stl'", "fetches nothing"),
    "mesh in the safe net": (GOOD.replace("package://arm", " HTTPS://localhost:1"), 9, "address 'HTTPS://", "fetches nothing"),
    "mesh by another protocol": (GOOD.replace("package://arm", "smb://host"), 9, "address 'smb://", "fetches nothing"),
    "address in an extension": (GOOD.replace("</robot>", "<gazebo><uri>https://localhost:1/x</uri></gazebo></robot>"), 34, "address 'https://", ""),
    "schema location": (GOOD.replace("<robot", '<robot xmlns:s="s" s:schemaLocation="http://localhost:1/x.xsd"', 1), 1, "address", ""),
    "xacro element": (GOOD.replace('<link name="tip"/>', f'<xacro:property {XACRO} name="a" value="1"/>'), 17, "xacro element or attribute property", "Run xacro first"),
    "xacro undeclared": (GOOD.replace('<link name="tip"/>', '<xacro:property name="a" value="1"/>'), 17, "prefix xacro", "Run xacro first"),
    "xacro expression": (GOOD.replace('value="2"', 'value="${m}"'), 6, "'${m}'", "Run xacro first"),
    "xacro substitution": (GOOD.replace("package://arm", "$(find arm)"), 9, "'$(find arm)/upper.stl'", "Run xacro first"),
    "another namespace": (GOOD.replace("<robot", '<robot xmlns="urn:x"', 1), 1, "{urn:x}robot", ""),
    "no XML": ("armonic: 1\nname: arm\n", 1, "syntax error", ""),
    "nothing": ("", 1, "syntax error", ""),
    "half": (GOOD[:900], 32, "syntax error", ""),
    "unclosed comment": ("<!-- " + GOOD, 35, "syntax error", ""),
    "attribute twice": (GOOD.replace('name="tip"', 'name="tip" name="top"'), 17, "syntax error", ""),
    "undeclared prefix": (GOOD.replace('<link name="tip"/>', '<a:b/><link name="tip"/>'), 17, "syntax error", ""),
    "attributes by the thousand": ("<robot " + " ".join(f"a{i}=''" for i in range(99999)) + "/>", 1, "99999 attributes", ""),
    "deep nesting": ("<robot>" + "<a>" * 9999, 1, "syntax error", ""),
    "control character": (GOOD.replace("tip", "t\x01p"), 17, "syntax error", ""),
}  # fmt: skip


@pytest.mark.parametrize("case", XML.values(), ids=XML)
def test_xml_that_is_more_than_elements_is_refused_with_its_line(case, path: Path, port: int) -> None:
    text, line, found, hint = case
    error = refusal(path, text.replace("localhost:1", f"localhost:{port}"))
    assert error.where.startswith(f"bad.urdf, line {line}")
    assert found in error.found.replace(f"localhost:{port}", "localhost:1")
    assert hint in (error.hint or "")
    assert "root:" not in str(error)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1"])
def test_another_encoding_is_refused_so_that_nothing_hides_in_it(encoding: str, path: Path) -> None:
    text = '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="é&x;"/>'
    error = refusal(path, text.encode(encoding))
    assert error.found.startswith("the byte 0x")
    assert (error.expected, error.hint) == ("text in UTF-8", "Save it in UTF-8.")


def test_a_file_over_four_mebibytes_is_refused(path: Path) -> None:
    assert MAX_BYTES == 4 << 20
    assert "more than 4 MiB" in refusal(path, b"<" + b" " * MAX_BYTES).found


def test_comments_may_say_anything(path: Path) -> None:
    comment = "<!-- <!DOCTYPE robot> ${x} http://localhost:1 <xi:include/> -->\n"
    path.write_text(comment + GOOD.replace('<link name="tip"/>', f'{comment}<link name="tip"/>') + comment)
    assert load(path).coordinates == ("upper.z", "fore.y")


def test_meshes_that_are_not_there_are_not_missed(path: Path) -> None:
    for name in ("package://arm/upper.stl", "file:///nowhere/upper.stl", "../upper.stl", "/dev/random"):
        path.write_text(GOOD.replace("package://arm/upper.stl", name))
        assert load(path).coordinates == ("upper.z", "fore.y")


def test_the_command_line_says_it_in_one_line(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path.write_text(GOOD.replace("package://arm", "http://localhost:1"))
    assert main(["check", str(path)]) == 2
    assert main(["modes", str(path)]) == 2
    for line in capsys.readouterr().err.splitlines():
        assert line.startswith("error: bad.urdf, line 9, link upper: found the address 'http://localhost:1/upper.stl'")


# --- robot files that do not fit their URDF: old text -> new text, then place, part of found, expected, hint --------

FILE_FAULTS = {
    "no such urdf": ("urdf: arm", "urdf: amr", "line 3, urdf", "no file 'amr.urdf'", "path of a URDF", ""),
    "urdf no text": ("urdf: arm.urdf", "urdf: 5", "line 3, urdf", "5", "path of a URDF", ""),
    "urdf empty": ("urdf: arm.urdf", "urdf:", "line 3, urdf", "nothing", "path of a URDF", ""),
    "urdf in the net": ("urdf: arm", "urdf: http://localhost:1/arm", "line 3, urdf", "the address 'http://", "path", "download it"),
    "urdf a folder": ("urdf: arm.urdf", "urdf: ..", "line 3, urdf", "no file '..'", "path of a URDF", ""),
    "links too": ("frames:", "links: []\nframes:", "line 12, links", "links beside a urdf", "one of the two", ""),
    "joints no mapping": (FILE[FILE.index("joints:") : FILE.index("postures:")], "joints: 5\n", "line 4, joints", "5", "a mapping", ""),
    "joint misspelt": ("  elbow:", "  ellbow:", "line 7, joints.ellbow", "unknown joint 'ellbow'", "arm.urdf", "elbow?"),
    "joint by its link": ("  elbow:", "  fore:", "line 7, joints.fore", "unknown joint 'fore'", "arm.urdf", "its joint is 'elbow'"),
    "joint empty": ("postures:", "  flange:\npostures:", "line 10, joints.flange", "nothing", "elasticity or drive", ""),
    "joint key": ("    elasticity: {z", "    elastcity: {z", "line 6, joints.shoulder.elastcity", "'elastcity'", "drive", "elasticity?"),
    "mass of a joint": ("  elbow:\n", "  elbow:\n    mass: 3\n", "line 8, joints.elbow.mass", "unknown key 'mass'", "elasticity", "in the URDF"),
    "spring": ("stiffness: 5.0e4", "stiffness: -5", "line 9, joints.elbow.elasticity.y.stiffness", "-5", "positive", ""),
    "spring key": ("damping: 4", "dampin: 4", "line 9, joints.elbow.elasticity.y.dampin", "'dampin'", "damping", "damping?"),
    "axis key": ("y: {stiff", "joint: {stiff", "line 9, joints.elbow.elasticity.joint", "'joint'", "tz", "called y"),
    "bounds": ("[1.0e3, 1.0e6]", "[1, 2]", "line 9, joints.elbow.elasticity.y.stiffness_bounds", "[1, 2]", "contain", ""),
    "no stiffness": ("stiffness: 5.0e4, ", "", "line 9, joints.elbow.elasticity.y", "no stiffness", "stiffness", ""),
    "drive on a fixed joint": ("postures:", "  flange: {drive: {gear_ratio: 1, rotor_inertia: 1, shaft_stiffness: 1}}\npostures:", "line 10, joints.flange.drive", "fixed joint", "moves", ""),
    "drive and spring": ("  elbow:\n", "  elbow:\n    drive: {gear_ratio: 1, rotor_inertia: 1, shaft_stiffness: 1}\n", "line 10, joints.elbow.elasticity.y", "driven coordinate", "", ""),
    "posture too short": ("[30 deg, 40 deg]", "[30 deg]", "line 11, postures.bent", "a list of 1", "upper.z, fore.y", ""),
    "posture entry": ("[30 deg, 40 deg]", "{elbow: 3 mm}", "line 11, postures.bent", "'3 mm'", "rad", "length"),
    "posture joint": ("[30 deg, 40 deg]", "{ellbow: 3}", "line 11, postures.bent", "unknown joint 'ellbow'", "that moves", "elbow?"),
    "posture of a fixed joint": ("[30 deg, 40 deg]", "{flange: 3}", "line 11, postures.bent", "'flange'", "that moves", "It is fixed."),
    "frame on no link": ("link: tip", "link: tup", "line 13, frames.probe.link", "'tup'", "a link", "tip?"),
    "frame called as a link": ("name: probe", "name: tip", "line 13, frames.tip.name", "'tip' again", "no other", ""),
    "joints without a urdf": ("urdf: arm.urdf\n", "", "line 3, joints", "without a urdf", "the key urdf", "1 more error"),
}  # fmt: skip


@pytest.mark.parametrize("case", FILE_FAULTS.values(), ids=FILE_FAULTS)
def test_a_robot_file_that_does_not_fit_is_told_with_its_own_line(case, path: Path) -> None:
    old, new, place, found, expected, hint = case
    assert old in FILE
    Path("arm.urdf").write_text(GOOD)
    Path("arm.yaml").write_text(FILE.replace(old, new, 1))
    with pytest.raises(RobotFileError) as caught:
        load("arm.yaml")
    error = caught.value
    assert error.where.startswith(f"arm.yaml, {place}")
    assert found in error.found
    assert expected in error.expected
    assert hint in (error.hint or "")
    assert "\n" not in str(error)


def test_errors_in_the_urdf_are_told_with_its_line(path: Path) -> None:
    Path("arm.urdf").write_text(GOOD.replace('"0 1 0"', '"0 0 0"'))
    Path("arm.yaml").write_text(FILE)
    with pytest.raises(RobotFileError, match=r"^arm\.urdf, line 27, joint elbow: found an axis of zeros"):
        load("arm.yaml")


def test_inertias_that_a_turn_makes_too_large_are_told_as_the_links(path: Path) -> None:
    text = GOOD.replace('ixx="1" iyy="1" izz="1" ixy="0"', 'ixx="1e30" iyy="1e30" izz="1e30" ixy="1e30"')
    assert refusal(path, text.replace('rpy="0 0 0"', 'rpy="0 0 0.8"', 1)).where == "bad.urdf, line 3, link upper"


def test_errors_of_a_robot_file_and_of_its_joints_come_in_the_order_of_the_file(path: Path) -> None:
    Path("arm.urdf").write_text(GOOD)
    Path("arm.yaml").write_text(FILE.replace("2.0e5", "0").replace("5.0e4", "0").replace("z: 200 mm", "z: 2 kg"))
    with pytest.raises(RobotFileError) as caught:
        load("arm.yaml")
    assert [error.where.split(", ")[1] for error in caught.value.errors] == ["line 6", "line 9", "line 13"]


# --- anything at all ---------------------------------------------------------------------------------------------

TEXTS = (GOOD, (DATA / "ur5.urdf").read_text("utf-8"), (DATA / "gantry.urdf").read_text("utf-8"))
SIGNS = "<>/=\"'&;![]-?: \n0e.x${}"
FILLING = st.one_of(
    st.just(""),
    st.text(max_size=5),
    st.text(SIGNS, max_size=6),
    st.sampled_from(["base", "1e400", "-1", "nan", "0", "fixed", "floating", "<origin/>", "<link name='a'/>", "&#10;", "&lt;"]),
)  # fmt: skip


def survives(path: Path, content: bytes) -> None:
    """Either a robot whose every number is finite, or a RobotFileError of one line."""
    path.write_bytes(content)
    try:
        robot = load(path)
    except RobotFileError as refused:
        message = str(refused)
    else:
        message = ""
    assert "\n" not in message
    if message:
        return
    tree = robot.tree
    for array in (tree.placements, tree.axes, tree.masses, tree.coms, tree.inertias, tree.frame_placements):
        assert np.isfinite(array).all()
    assert robot.mechanism.n == len(robot.coordinates)
    assert Robot.from_yaml(robot.to_yaml(), path=path).coordinates == robot.coordinates


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_to_a_urdf_yields_anything_but_a_robot_or_an_error(data: st.DataObject, tmp_path: Path) -> None:
    text = data.draw(st.sampled_from(TEXTS))
    for _ in range(data.draw(st.integers(1, 3))):
        position = st.integers(0, len(text))
        start, end = sorted((data.draw(position), data.draw(position)))
        if data.draw(st.booleans()):
            end = min(end, start + 3)
        text = text[:start] + data.draw(FILLING) + text[end:]
    survives(tmp_path / "robot.urdf", text.encode())


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    text=st.text() | st.text(SIGNS, max_size=80), head=st.sampled_from(["", "<robot name='a'>", "<?xml ", "<!--", "<!"])
)
def test_no_text_yields_anything_but_a_robot_or_an_error(text: str, head: str, tmp_path: Path) -> None:
    survives(tmp_path / "robot.urdf", (head + text).encode())


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200), head=st.sampled_from([b"", b"<", GOOD[:300].encode(), b"\xff\xfe<\0"]))
def test_no_bytes_yield_anything_but_a_robot_or_an_error(content: bytes, head: bytes, tmp_path: Path) -> None:
    survives(tmp_path / "robot.urdf", head + content)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_to_the_robot_file_yields_anything_but_a_robot_or_an_error(
    data: st.DataObject, tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(GOOD)
    position = st.integers(0, len(FILE))
    start, end = sorted((data.draw(position), data.draw(position)))
    if data.draw(st.booleans()):
        end = min(end, start + 3)
    text = FILE[:start] + data.draw(FILLING | st.text("{}[]:,-#\n", max_size=4)) + FILE[end:]
    try:
        robot = Robot.from_yaml(text, path=tmp_path / "arm.yaml")
    except RobotFileError as refused:
        robot, message = None, str(refused)
        assert len(message.splitlines()) == 1
    if robot is not None:
        assert robot.to_yaml() == text
        changed = robot.with_values({path: 2 * value for path, value in robot.parameters().items() if not robot.bounds(path)}) if robot.flexible.any() else robot  # fmt: skip
        assert changed.coordinates == robot.coordinates
