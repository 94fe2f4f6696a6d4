"""A bad robot file is one clear error: file, line, dotted path, what was found and what is expected."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armonic import catalog
from armonic.description.document import MAX_BYTES, Document
from armonic.description.units import LARGEST
from armonic.errors import ArmonicError, RobotFileError
from armonic.robot import Robot, load
from robot_files import DRIVEN, GOOD, SCHEMA_FAULTS, YAML_FAULTS


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
        (matrix().replace("1.0, 0.0", "1.0, 5 mm", 1), "stiffness[0][1]", "'5 mm'", "N/mm"),
    ],
)
def test_a_spring_matrix_must_be_symmetric_and_able_to_hold(stiffness, path, found, expected) -> None:
    error = refusal(GOOD.replace("[1, 1, 1, 1, 1, 1]", stiffness))
    assert error.where == f"robots/test.yaml, line 28, bushings.pad.{path}"
    assert found in error.found
    assert expected in error.expected


def test_the_first_error_in_the_file_is_told_and_the_others_counted() -> None:
    text = GOOD.replace("mass: 5", "mass: heavy").replace("mass: 10", "mas: 10").replace("home: [", "7home: [")
    error = refusal(text)
    assert error.where == "robots/test.yaml, line 13, links.first.mas"
    assert error.hint == "Did you mean mass? There are 2 more errors."


def test_the_first_error_brings_all_of_them_in_the_order_of_the_file() -> None:
    text = GOOD.replace("mass: 5", "mass: heavy").replace("mass: 10", "mas: 10").replace("home: [", "7home: [")
    errors = refusal(text).errors
    assert [error.where.rpartition(", ")[2] for error in errors] == [
        "links.first.mas",
        "links.second.mass",
        "postures.7home",
    ]
    assert (errors[0].hint, errors[1].found) == ("Did you mean mass?", "'heavy'")
    assert refusal(GOOD.replace("mass: 5", "mass: heavy")).errors == ()


def test_errors_that_only_names_reveal_are_brought_too() -> None:
    text = GOOD.replace("parent: base", "parent: bases").replace("parent: first", "parent: frist")
    assert [error.hint for error in refusal(text).errors] == ["Did you mean base?", "Did you mean first?"]


def test_errors_in_every_link_hide_none_of_them() -> None:
    error = refusal(GOOD.replace("mass: ", "mass: -"))
    assert error.where == "robots/test.yaml, line 13, links.first.mass"
    assert error.hint == "There are 2 more errors."


def test_springs_of_a_wrong_joint_are_no_errors_of_their_own() -> None:
    text = GOOD.replace("stiffness: 1.0e6, damping: 10", "stiffness: 1 MN m/rad").replace("revolute", "rotary")
    assert refusal(text).where == "robots/test.yaml, line 9, links.first.joint.type"


def test_a_misspelt_key_is_told_before_the_key_that_is_therefore_missing() -> None:
    error = refusal(GOOD.replace("  - name: first", "  - nam: first"))
    assert error.found == "the unknown key 'nam'"
    assert error.hint == "Did you mean name? There is 1 more error."


def test_an_unclosed_bracket_is_named_by_the_line_it_opens_on() -> None:
    assert "starts on line 4" in str(refusal(GOOD.replace("[0, 0, -9.81]", "[0, 0, -9.81")))


# --- YAML that a robot file may not use -----------------------------------------------------------


@pytest.mark.parametrize("case", YAML_FAULTS.values(), ids=YAML_FAULTS)
def test_yaml_beyond_plain_values_is_refused_with_its_line(case) -> None:
    text, place, found, expected = case
    error = refusal(text)
    assert error.where == f"robots/test.yaml, line {place}"
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
    robot = Robot.from_yaml(GOOD.replace("Test arm", "no").replace("a test", "2021-02-30").replace("home", "on"))
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
    with pytest.raises(RobotFileError, match=r"latin\.yaml, line \d: found the byte 0x.., expected text in UTF-8"):
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

TEXTS = (GOOD, DRIVEN, catalog.read("kuka_kr90"))
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
            "1e-30",
            "tip",
        ]
    ),
    st.lists(st.floats(allow_nan=False), max_size=6),
    st.dictionaries(st.sampled_from(["x", "z", "name", "stiffness", "type"]), st.floats(), max_size=3),
)


def survives(text: str) -> None:
    """Either a robot whose every number is finite, or an Armonic error of one line."""
    try:
        robot = Robot.from_yaml(text)
    except ArmonicError as refused:
        robot, message = None, str(refused)
    if robot is None:
        assert "\n" not in message
        return
    tree = robot.tree
    arrays = [tree.placements, tree.axes, tree.masses, tree.coms, tree.frame_placements, *robot.paths.values()]
    arrays += [robot.gravity, robot.stiffness, robot.damping, *robot.postures.values()]
    arrays += [matrix for bushing in robot.bushings for matrix in (bushing.stiffness, bushing.damping)]
    assert all(np.isfinite(array).all() for array in arrays)
    # A path of k motions, each of at most LARGEST, stays far from overflow.
    assert all(abs(array).max(initial=0.0) < 1e5 * LARGEST for array in arrays)
    products = [tree.inertias, *vars(robot.drives).values(), *vars(robot.control).values()]
    products = [product for product in products if isinstance(product, np.ndarray)]
    # Mass times squared distance; squared gear ratio times inertia.
    assert all(np.isfinite(product).all() and abs(product).max(initial=0.0) < 1e10 * LARGEST**3 for product in products)
    assert (robot.drives.inertia > 0).all()
    assert (robot.drives.scale > 0).all()
    assert robot.mechanism.n == len(robot.coordinates)
    assert robot.to_yaml() == text
    assert robot.with_values(robot.numbers()).to_yaml() == text


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
                node[data.draw(st.text(max_size=6) | st.sampled_from(["x", "y", "mass", "joint"]))] = node.pop(last)
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
