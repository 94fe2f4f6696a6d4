"""A bad robot file is one clear error: file, line, dotted path, what was found, what is expected, what to do."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armonic import catalog
from armonic.document import MAX_BYTES, MAX_DEPTH, Document
from armonic.errors import ArmonicError, RobotFileError
from armonic.robot import Robot, load
from armonic.units import LARGEST

GOOD = """\
armonic: 1
name: Test arm
source: a test
gravity: [0, 0, -9.81]
links:
  - name: first
    parent: base
    placement: [{z: 1}]
    joint: {type: revolute, axis: z}
    elasticity:
      z: {stiffness: 1.0e6, damping: 10}
      x: free
    mass: 10
    com: [0, 0, 0.1]
    inertia: {xx: 1, yy: 1, zz: 1}
  - name: second
    parent: first
    joint: {type: prismatic, axis: [0, 1, 1]}
    elasticity:
      joint: {stiffness: 1.0e6, stiffness_bounds: [1, 1.0e9]}
    mass: 5
  - {name: third, parent: second, joint: {type: fixed}, mass: 1}
frames:
  - {name: tip, link: third, placement: [{x: 1}, {rx: 90 deg}]}
postures:
  home: [30 deg, 20 mm]
bushings:
  - {name: pad, between: [base, tip], stiffness: [1, 1, 1, 1, 1, 1], damping: [1, 0, 0, 0, 0, 0], rest: home}
"""

BLOCK = "between: [base, tip], stiffness: [1, 1, 1, 1, 1, 1]"


def refusal(text: str) -> RobotFileError:
    with pytest.raises(RobotFileError) as caught:
        Robot.from_yaml(text, path=Path("robots/test.yaml"))
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("robots/test.yaml")
    assert len(message) < 800
    return caught.value


def test_the_good_file_is_good() -> None:
    assert Robot.from_yaml(GOOD).coordinates == ("first.z", "first.x", "second.joint")


# old text -> new text, then line, dotted path, part of found, part of expected, part of the hint
SCHEMA_FAULTS = {
    "no version": ("armonic: 1\n", "", 1, "", "no armonic", "key armonic", ""),
    "other version": ("armonic: 1", "armonic: 2", 1, "armonic", "2", "1", "format 1"),
    "version as text": ("armonic: 1", "armonic: '1'", 1, "armonic", "'1'", "1", ""),
    "version true": ("armonic: 1", "armonic: true", 1, "armonic", "true", "1", ""),
    "number as name": ("Test arm", "7", 2, "name", "7", "a text", "quotes"),
    "blank name": ("Test arm", "' '", 2, "name", "' '", "not empty", ""),
    "unknown top key": ("source:", "sauce:", 3, "sauce", "unknown key 'sauce'", "source", "source?"),
    "gravity too short": ("[0, 0, -9.81]", "[0, -9.81]", 4, "gravity", "a list of 2", "three numbers", ""),
    "gravity in kg": ("-9.81]", "9.81 kg]", 4, "gravity[2]", "'9.81 kg'", "m/s^2", "measures mass"),
    "no links": (GOOD[GOOD.index("links:") : GOOD.index("frames:")], "links: []\n", 5, "links", "empty", "one", ""),
    "links no list": ("links:\n", "links: 5\nlonks:\n", 5, "links", "5", "a list", "1 more error"),
    "link no mapping": ("  - name: first\n", "  - 5\n  - name: first\n", 6, "links[0]", "5", "a link", ""),
    "link unnamed": ("  - name: first\n    parent", "  - parent", 6, "links[0]", "no name", "key name", ""),
    "bad name": ("name: first", "name: 1st axis", 6, "links.1st axis.name", "'1st axis'", "a letter", ""),
    "link called base": ("name: first", "name: base", 6, "links.base.name", "'base'", "another", "ground"),
    "name twice": ("name: second", "name: first", 16, "links.first.name", "'first' again", "no other", ""),
    "unknown parent": ("parent: first", "parent: fist", 17, "links.second.parent", "'fist'", "link", "first?"),
    "own parent": ("parent: first", "parent: second", 17, "links.second.parent", "second -> second", "base", ""),
    "cycle": ("parent: base", "parent: third", 7, "links.first.parent", "first -> third -> second -> first", "", ""),
    "placement no list": ("[{z: 1}]", "{z: 1}", 8, "links.first.placement", "a mapping", "a list", ""),
    "motion no mapping": ("[{z: 1}]", "[1]", 8, "links.first.placement[0]", "1", "{x: 350 mm}", ""),
    "motion empty": ("[{z: 1}]", "[{}]", 8, "links.first.placement[0]", "no key", "one of rx", "left to right"),
    "two turns": ("{z: 1}", "{rx: 1, ry: 1}", 8, "links.first.placement[0]", "rx, ry", "one of rx", "own entry"),
    "turn and move": ("{z: 1}", "{z: 1, ry: 1}", 8, "links.first.placement[0]", "z, ry", "one of rx", ""),
    "motion misspelt": ("{z: 1}", "{rot: 1}", 8, "links.first.placement[0].rot", "'rot'", "rx", "rx"),
    "length as angle": ("{z: 1}", "{z: 5 deg}", 8, "links.first.placement[0].z", "'5 deg'", "m, cm, mm", "angle"),
    "angle as length": ("rx: 90 deg", "rx: 9 mm", 24, "frames.tip.placement[1].rx", "'9 mm'", "deg", "length"),
    "no joint": ("    joint: {type: revolute, axis: z}\n", "", 6, "links.first", "no joint", "key joint", ""),
    "joint type": ("revolute", "revolut", 9, "links.first.joint.type", "'revolut'", "prismatic", "revolute?"),
    "joint no axis": (", axis: z", "", 9, "links.first.joint", "no axis", "revolute", ""),
    "fixed with axis": ("fixed}", "fixed, axis: x}", 22, "links.third.joint.axis", "fixed joint", "no axis", ""),
    "axis letter": ("axis: z", "axis: w", 9, "links.first.joint.axis", "'w'", "x, y, z", ""),
    "axis short": ("[0, 1, 1]", "[0, 1]", 18, "links.second.joint.axis", "a list of 2", "three", ""),
    "axis zero": ("[0, 1, 1]", "[0, 0, 0]", 18, "links.second.joint.axis", "zero vector", "not zero", ""),
    "axis unit": ("[0, 1, 1]", "[0, 1 m, 1]", 18, "links.second.joint.axis[1]", "'1 m'", "a number", ""),
    "elasticity no mapping": (
        "elasticity:\n      joint: {stiffness: 1.0e6, stiffness_bounds: [1, 1.0e9]}",
        "elasticity: 3",
        19,
        "links.second.elasticity",
        "3",
        "a mapping",
        "",
    ),
    "axis key": ("x: free", "rx: free", 12, "links.first.elasticity.rx", "'rx'", "one of x, y, z, tx", ""),
    "joint key": ("x: free", "joint: free", 12, "links.first.elasticity.joint", "'joint'", "tz", "called z"),
    "spring word": ("x: free", "x: fre", 12, "links.first.elasticity.x", "'fre'", "the word free", ""),
    "spring empty": ("x: free", "x:", 12, "links.first.elasticity.x", "nothing", "stiffness", ""),
    "spring key": ("damping: 10", "dampin: 10", 11, "links.first.elasticity.z.dampin", "'dampin'", "damping", "damping?"),
    "no stiffness": ("stiffness: 1.0e6, d", "d", 11, "links.first.elasticity.z", "no stiffness", "key stiffness", ""),
    "zero stiffness": ("1.0e6, d", "0, d", 11, "links.first.elasticity.z.stiffness", "0", "positive", ""),
    "negative damping": ("damping: 10", "damping: -1", 11, "links.first.elasticity.z.damping", "-1", "0 or larger", ""),
    "stiffness of a slide": ("1.0e6, d", "5 N/mm, d", 11, "links.first.elasticity.z.stiffness", "'5 N/mm'", "N m/rad", ""),
    "stiffness of a turn": ("1.0e6, s", "5 N m/rad, s", 20, "links.second.elasticity.joint.stiffness", "'5 N m/rad'", "N/mm", ""),
    "bounds short": ("[1, 1.0e9]", "[1]", 20, "links.second.elasticity.joint.stiffness_bounds", "a list of 1", "[lowest", ""),
    "bounds upside down": ("[1, 1.0e9]", "[9, 1]", 20, "links.second.elasticity.joint.stiffness_bounds", "[9, 1]", "smaller", ""),
    "bounds from zero": ("[1, 1.0e9]", "[0, 1.0e9]", 20, "links.second.elasticity.joint.stiffness_bounds", "[0,", "positive", ""),
    "value out of bounds": ("[1, 1.0e9]", "[1, 9]", 20, "links.second.elasticity.joint.stiffness_bounds", "[1, 9]", "1e+06", ""),
    "bound no number": ("[1, 1.0e9]", "[1, much]", 20, "links.second.elasticity.joint.stiffness_bounds[1]", "'much'", "N/m", ""),
    "negative mass": ("mass: 10", "mass: -10", 13, "links.first.mass", "-10", "0 or larger", ""),
    "mass true": ("mass: 10", "mass: true", 13, "links.first.mass", "true", "a number in kg", ""),
    "mass missing value": ("mass: 10", "mass:", 13, "links.first.mass", "nothing", "kg", ""),
    "mass infinite": ("mass: 10", "mass: .inf", 13, "links.first.mass", "inf", "finite", ""),
    "mass nan": ("mass: 10", "mass: .nan", 13, "links.first.mass", "nan", "finite", ""),
    "mass overflow": ("mass: 10", "mass: 1.0e999", 13, "links.first.mass", "inf", "finite", ""),
    "mass of many digits": ("mass: 10", f"mass: {'9' * 5000}", 13, "links.first.mass", "inf", "finite", ""),
    "mass with comma": ("mass: 10", "mass: 10,5 kg", 13, "links.first.mass", "'10,5 kg'", "kg, g, t", "decimal point"),
    "mass unknown unit": ("mass: 10", "mass: 10 lbs", 13, "links.first.mass", "'10 lbs'", "kg, g, t", "not known"),
    "mass hexadecimal": ("mass: 10", "mass: 0x1F", 13, "links.first.mass", "'0x1F'", "kg", ""),
    "com no list": ("[0, 0, 0.1]", "0.1", 14, "links.first.com", "0.1", "three numbers", ""),
    "com entry": ("[0, 0, 0.1]", "[0, here, 0.1]", 14, "links.first.com[1]", "'here'", "mm", ""),
    "inertia key": ("zz: 1}", "zx: 1}", 15, "links.first.inertia.zx", "'zx'", "xx, yy, zz, xy, xz, yz", "Did you mean"),
    "inertia list": ("{xx: 1, yy: 1, zz: 1}", "[1, 1, 1]", 15, "links.first.inertia", "a list of 3", "xx, yy", ""),
    "inertia without mass": ("mass: 10\n", "mass: 0\n", 15, "links.first.inertia", "without a mass", "positive mass", ""),
    "frame link": ("link: third", "link: thrid", 24, "frames.tip.link", "'thrid'", "a link", "third?"),
    "frame taken": ("name: tip", "name: third", 24, "frames.third.name", "'third' again", "frame or link", ""),
    "frame called base": ("name: tip", "name: base", 24, "frames.base.name", "'base' again", "frame or link", ""),
    "frame without link": ("link: third, ", "", 24, "frames.tip", "no link", "key link", ""),
    "postures no mapping": ("\n  home: [30 deg, 20 mm]", " [1]", 25, "postures", "a list of 1", "a mapping", ""),
    "posture no list": ("[30 deg, 20 mm]", "30", 26, "postures.home", "30", "a list", ""),
    "posture length": ("[30 deg, 20 mm]", "[1, 2, 3]", 26, "postures.home", "3 values", "a list of 2: first.z, second.joint", ""),
    "posture unit": ("30 deg, 20 mm", "30 deg, 20 deg", 26, "postures.home[1]", "'20 deg'", "m, cm", "an angle"),
    "posture nested": ("30 deg, 20 mm", "[1], 2", 26, "postures.home[0]", "a list of 1", "rad", ""),
    "posture name": ("home: [", "my home: [", 26, "postures.my home", "'my home'", "a letter", ""),
    "between short": ("[base, tip]", "[tip]", 28, "bushings.pad.between", "a list of 1", "two frames", ""),
    "between same": ("[base, tip]", "[tip, tip]", 28, "bushings.pad.between", "'tip' twice", "different", ""),
    "between unknown": ("[base, tip]", "[base, tap]", 28, "bushings.pad.between[1]", "'tap'", "frame or link", "tip?"),
    "bushing soft": ("[1, 1, 1, 1, 1, 1]", "[0, 0, 0, 0, 0, 0]", 28, "bushings.pad.stiffness", "six zeros", "one", ""),
    "bushing short": ("[1, 1, 1, 1, 1, 1]", "[1, 1, 1]", 28, "bushings.pad.stiffness", "a list of 3", "six numbers", ""),
    "bushing negative": ("[1, 1, 1, 1, 1, 1]", "[1, 1, -1, 1, 1, 1]", 28, "bushings.pad.stiffness[2]", "-1", "0 or", ""),
    "bushing unit": ("[1, 1, 1, 1, 1, 1]", "[1, 1, 1, 1, 1, 1 N/m]", 28, "bushings.pad.stiffness[5]", "'1 N/m'", "N m/rad", ""),
    "bushing rest": ("rest: home", "rest: hime", 28, "bushings.pad.rest", "'hime'", "a posture", "home?"),
    "bushing rest length": ("rest: home", "rest: [1]", 28, "bushings.pad.rest", "1 values", "a list of 2", ""),
    "bushing rest unit": ("rest: home", "rest: [1, 1 kg]", 28, "bushings.pad.rest[1]", "'1 kg'", "mm", "mass"),
    "bushing rest number": ("rest: home", "rest: 5", 28, "bushings.pad.rest", "5", "a posture", ""),
    "bushing again": (
        "bushings:\n",
        "bushings:\n  - {name: pad, between: [base, third], stiffness: [1, 1, 1, 1, 1, 1]}\n",
        29,
        "bushings.pad.name",
        "'pad' again",
        "bushing",
        "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SCHEMA_FAULTS.values(), ids=SCHEMA_FAULTS)
def test_a_wrong_entry_is_named_with_its_line_and_what_belongs_there(case) -> None:
    old, new, line, path, found, expected, hint = case
    assert old in GOOD
    error = refusal(GOOD.replace(old, new, 1))
    assert error.where == f"robots/test.yaml, line {line}" + (f", {path}" if path else "")
    assert found in error.found
    assert expected in error.expected
    assert hint in (error.hint or "")


def matrix(**entries: float) -> str:
    rows = np.eye(6)
    for key, value in entries.items():
        rows[int(key[1]), int(key[2])] = value
    return json.dumps(rows.tolist())


@pytest.mark.parametrize(
    ("stiffness", "path", "found", "expected"),
    [
        (matrix(k01=0.5), "stiffness[1][0]", "0.0", "0.5 as in row 1: symmetric"),
        (matrix(k01=2, k10=2), "stiffness[1][0]", "2.0", "at most 1"),
        (matrix(k22=-1), "stiffness[2][2]", "-1.0", "0 or larger"),
        (
            matrix(k01=-0.9, k10=-0.9, k02=-0.9, k20=-0.9, k12=-0.9, k21=-0.9),
            "stiffness",
            "negative eigenvalue",
            "semidefinite",
        ),
        ("[[1], 2, 3, 4, 5, 6]", "stiffness[0]", "a list of 1", "six numbers"),
        (matrix().replace("1.0, 0.0", "1.0, 5 N/m", 1), "stiffness[0][1]", "'0.0 5 N/m'", "N"),
    ],
)
def test_a_spring_matrix_must_be_symmetric_and_able_to_hold(stiffness, path, found, expected) -> None:
    if "5 N/m" in stiffness:
        stiffness, found = stiffness.replace("1.0, 5 N/m", "1.0, 5 mm", 1), "'5 mm'"
    error = refusal(GOOD.replace("[1, 1, 1, 1, 1, 1]", stiffness))
    assert error.where == f"robots/test.yaml, line 28, bushings.pad.{path}"
    assert found in error.found
    assert expected in error.expected


def test_the_first_error_in_the_file_is_told_and_the_others_counted() -> None:
    text = (
        GOOD.replace("mass: 5", "mass: heavy").replace("mass: 10", "mas: 10").replace("deg, 20", "deg, , 20")
    )
    text = text.replace("deg, , 20", "deg, 20").replace("home: [", "7home: [")
    error = refusal(text)
    assert error.where == "robots/test.yaml, line 13, links.first.mas"
    assert error.hint == "Did you mean mass? There are 2 more errors."


# --- YAML that a robot file may not use ---------------------------------------------------------------

YAML_FAULTS = {
    "empty": ("", 1, "an empty file", "armonic: 1"),
    "comment only": ("# nothing\n", 1, "an empty file", "armonic: 1"),
    "null": ("~", 1, "nothing", "armonic: 1"),
    "a list": ("- armonic: 1\n", 1, "a list of 1", "armonic: 1"),
    "a text": ("hello", 1, "'hello'", "armonic: 1"),
    "anchor": (GOOD.replace("[{z: 1}]", "&here [{z: 1}]"), 8, "anchor (`&here`)", "plain values"),
    "alias": (GOOD.replace("[{z: 1}]", "*there"), 8, "alias (`*there`)", "plain values"),
    "tag": (GOOD.replace("mass: 10", "mass: !!float 10"), 13, "tag", "plain values"),
    "python tag": (
        GOOD.replace("Test arm", "!!python/object/apply:os.system ['true']"),
        2,
        "python/object/apply:os.system",
        "plain values",
    ),
    "tagged mapping": ("!robot\n" + GOOD, 1, "!robot", "plain values"),
    "duplicate key": (
        GOOD.replace("mass: 10", "mass: 10\n    mass: 11"),
        14,
        "the key 'mass' again",
        "line 13",
    ),
    "duplicate link key": (GOOD + "name: again\n", 29, "the key 'name' again", "line 2"),
    "two documents": (GOOD + "---\n" + GOOD, 29, "second document", "one document"),
    "version directive": ("%YAML 1.1\n---\n" + GOOD, 2, "directive", "none"),
    "tag directive": ("%TAG ! tag:example.com:\n---\n" + GOOD, 2, "directive", "none"),
    "number as key": (GOOD.replace("home:", "7:"), 26, "7 as a key", "a text"),
    "list as key": (GOOD.replace("home:", "? [a]\n  :"), 26, "a collection as a key", "a text"),
    "merge": (GOOD.replace("name: tip", "<<: {name: tip}"), 24, "unknown key '<<'", "name"),
    "tab": (GOOD.replace("    parent: base", "\tparent: base"), 7, "", "well-formed YAML"),
    "unclosed": (GOOD.replace("[0, 0, -9.81]", "[0, 0"), 5, "", "well-formed YAML"),
    "unclosed quote": (GOOD.replace("Test arm", "'Test arm"), 28, "", "well-formed YAML"),
    "bad indent": (GOOD.replace("    mass: 10", "   mass: 10"), 13, "", "well-formed YAML"),
    "control character": (GOOD.replace("a test", "a\x07test"), 3, "character", "printable"),
    "escaped control": (GOOD.replace("a test", '"\\e[31m"'), 3, "control character", "printable"),
    "lone surrogate": (GOOD.replace("a test", '"\\ud800"'), 3, "control character", "printable"),
    "impossible escape": (GOOD.replace("a test", '"\\UFFFFFFFF"'), 1, "parser", "well-formed YAML"),
    "too deep": (GOOD.replace("a test", "[" * 50 + "]" * 50), 3, f"deeper than {MAX_DEPTH}", "levels"),
    "absurdly deep": ("[" * 100_000, 1, f"deeper than {MAX_DEPTH}", "levels"),
    "deep blocks": ("- " * 100_000, 1, f"deeper than {MAX_DEPTH}", "levels"),
    "deep keys": ("? " * 100_000, 1, "", ""),
}


@pytest.mark.parametrize("case", YAML_FAULTS.values(), ids=YAML_FAULTS)
def test_yaml_beyond_plain_values_is_refused_with_its_line(case) -> None:
    text, line, found, expected = case
    error = refusal(text)
    assert re.match(rf"robots/test\.yaml, line {line}(,|$)", error.where), error.where
    assert found in error.found
    assert expected in error.expected


def test_loading_executes_nothing(tmp_path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("alive")
    for tag in (
        "!!python/object/apply:os.remove",
        "!!python/object/new:os.remove",
        "!!python/name:os.remove",
    ):
        refusal(GOOD.replace("Test arm", f"{tag} ['{victim}']"))
    assert victim.read_text() == "alive"


def test_yaml_1_1_words_are_texts() -> None:
    robot = Robot.from_yaml(
        GOOD.replace("Test arm", "no").replace("a test", "2021-02-30").replace("home", "on")
    )
    assert (robot.name, robot.source, *robot.postures) == ("no", "2021-02-30", "on")


# --- files that cannot be read -----------------------------------------------------------------------


def test_a_file_over_one_mebibyte_is_refused_unread(tmp_path) -> None:
    path = tmp_path / "big.yaml"
    path.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(RobotFileError, match="more than 1 MiB"):
        load(path)
    with pytest.raises(RobotFileError, match="more than 1 MiB"):
        Document("#" * (MAX_BYTES + 1), "text")


@pytest.mark.parametrize("content", [b"armonic: 1\nname: caf\xe9\n", "armonic: 1\nname: x".encode("utf-16")])
def test_a_file_in_another_encoding_is_refused(tmp_path, content) -> None:
    path = tmp_path / "latin.yaml"
    path.write_bytes(content)
    with pytest.raises(
        RobotFileError, match=r"latin\.yaml, line \d: found the byte 0x.., expected text in UTF-8"
    ):
        load(path)


def test_a_missing_robot_lists_the_catalog_and_names_the_nearest() -> None:
    with pytest.raises(RobotFileError, match=r"huynh_3r, kuka_kr90.*Did you mean kuka_kr90\?"):
        load("kuka_kr9")


@pytest.mark.parametrize("source", ["", "no/such/file.yaml", "x" * 5000, "nul\0byte", "."])
def test_an_impossible_path_is_one_clear_error(source) -> None:
    with pytest.raises(RobotFileError, match="expected a robot file"):
        load(source)


def test_a_folder_is_called_one(tmp_path) -> None:
    with pytest.raises(RobotFileError, match="found a directory"):
        load(tmp_path)


# --- anything at all ---------------------------------------------------------------------------------

TEXTS = (GOOD, catalog.read("kuka_kr90"))
ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(min_value=10**300, max_value=10**320),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(
        [
            "free",
            "base",
            "x",
            "joint",
            "5 mm",
            "-1 deg",
            "1e30 m",
            "home",
            "1e999",
            "first",
            "1e-320",
            ".5e-9 kg",
        ]
    ),
    st.lists(st.floats(allow_nan=False), max_size=6),
    st.dictionaries(st.sampled_from(["x", "z", "name", "stiffness", "type"]), st.floats(), max_size=3),
)


def survives(text: str) -> None:
    """Either a robot whose every number is finite, and whose text reads back the same, or an Armonic error."""
    try:
        robot = Robot.from_yaml(text)
    except ArmonicError as error:
        assert "\n" not in str(error)
        return
    tree = robot.tree
    arrays = [tree.placements, tree.axes, tree.masses, tree.coms, tree.inertias, tree.frame_placements]
    arrays += [robot.gravity, robot.stiffness, robot.damping, *robot.postures.values()]
    arrays += [matrix for bushing in robot.bushings for matrix in (bushing.stiffness, bushing.damping)]
    assert all(np.isfinite(array).all() for array in arrays)
    # A path of k motions, each of at most LARGEST, stays far from overflow.
    assert all(abs(array).max(initial=0.0) < 1e5 * LARGEST for array in arrays)
    assert robot.mechanism.n == len(robot.coordinates)
    assert (
        Robot.from_yaml(robot.to_yaml()).parameters("*") == robot.parameters("*")
        if has_springs(robot)
        else True
    )


def has_springs(robot: Robot) -> bool:
    return bool(robot.bushings) or any(
        spring is not None for link in robot.description.links for spring in link.elasticity.values()
    )


def places(data: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in nested lists and mappings."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [place for key, value in items for place in ((*at, key), *places(value, (*at, key)))]


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_no_mutation_of_the_entries_yields_anything_but_a_robot_or_an_error(data) -> None:
    content = copy.deepcopy(Document(data.draw(st.sampled_from(TEXTS)), "good").data)
    for _ in range(data.draw(st.integers(1, 3))):
        *parents, last = data.draw(st.sampled_from(places(content)))
        node = content
        for key in parents:
            node = node[key]
        match data.draw(st.sampled_from(["delete", "replace", "repeat", "rename"])):
            case "delete":
                del node[last]
            case "replace":
                node[last] = data.draw(ODD)
            case "repeat" if isinstance(node, list):
                node.append(copy.deepcopy(node[last]))
            case _ if isinstance(node, dict):
                node[data.draw(st.text(max_size=6) | st.sampled_from(["x", "y", "mass", "joint"]))] = (
                    node.pop(last)
                )
        if not places(content):
            break
    survives(json.dumps(content, ensure_ascii=data.draw(st.booleans())))


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(TEXTS), st.data())
def test_no_damage_to_the_text_yields_anything_but_a_robot_or_an_error(text, data) -> None:
    position = st.integers(0, len(text))
    start, end = sorted((data.draw(position), data.draw(position)))
    if data.draw(st.booleans()):
        end = min(end, start + 3)
    filling = data.draw(
        st.one_of(st.just(""), st.text(max_size=5), st.text("{}[]:,-?&*!|>%@`'\"#\n \t0e.", max_size=5))
    )
    survives(text[:start] + filling + text[end:])


@settings(max_examples=200, deadline=None)
@given(st.one_of(st.text(), st.text("{}[]:,-?&*!|>%@`'\"#\n \t0ea.\\x", max_size=60)))
def test_no_text_yields_anything_but_a_robot_or_an_error(text) -> None:
    survives(text)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200))
def test_no_bytes_yield_anything_but_a_robot_or_an_error(tmp_path, content) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(content)
    with pytest.raises(RobotFileError):
        load(path)
