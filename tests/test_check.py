"""What `check` finds in robots that load."""

from __future__ import annotations

from armonic import catalog
from armonic.checks import Finding, check
from armonic.robot import Robot
from robot_files import MINIMAL


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
