"""Drives, control, Denavit-Hartenberg lines, tool and paths of a robot file: what they mean."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.robot import Robot, load
from models import robot_of
from trees import Array, random_body, relative_difference

# Rounding in double precision, through a chain of some ten turns.
TOLERANCE = 1e-12

# Do, Vu, Liu 2022: Tables 1 (joint and motor damping, shafts), 4 (gears, rotors), 2 (d, a, alpha) and section 4.1 (r).
RADIUS = (0.057, 1, 1, 1, 1, 1)
JOINT_DAMPING = (2.73, 24.74, 5.76, 9.37, 8.74, 8.74)
MOTOR_DAMPING = (9.46e-4, 9.46e-4, 9.46e-4, 9.46e-4, 5.90e-4, 5.90e-4)
SHAFT_STIFFNESS = (25e3, 120e3, 120e3, 57e3, 29e3, 29e3)
GEAR_RATIO = (51, 160, 160, 160, 160, 160)
ROTOR_INERTIA = (1.71e-4, 2.65e-4, 2.42e-4, 1.26e-4, 0.91e-4, 0.86e-4)
D = (0, 0, 0, 0, 0.380, 0.088)
A = (0, 0.192, 0.420, 0, 0, 0)
ALPHA_DEG = (0, 90, 0, 90, 90, -90)
# Table 3: mass, centre of mass, Ixx Ixy Ixz Iyy Iyz Izz (its rows "I_yz" and "I_zy" are Iyy and Iyz).
BODIES = (
    (19.0, (0.021, 0.031, -0.226), (0, 0, 0, 0, 0, 0)),
    (5.723, (-0.054, 0.003, 0.014), (0.010, 0.003, -0.003, 0.044, 0, 0.043)),
    (5.166, (-0.138, 0, -0.019), (0.008, 0, -0.010, 0.160, 0, 0.160)),
    (4.425, (0.011, 0.012, 0.161), (0.044, 0, 0.002, 0.044, 0.007, 0.008)),
    (3.302, (0, -0.026, -0.022), (0.012, 0, 0, 0.006, -0.001, 0.008)),
    (1.022, (-0.004, 0.039, 0), (0.001, 0, 0, 0.001, 0, 0.012)),
)


def turn(axis: str, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    rows = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
    T = np.eye(4)
    T[:3, :3] = rows.get(axis, [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return T


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def pose(robot: Robot, q: Array, frame: str) -> Array:
    return np.asarray(robot.mechanism.pose(q, robot.frame_index(frame)))


def jacobian(robot: Robot, q: Array, frame: str) -> Array:
    return np.asarray(robot.mechanism.jacobian(q, robot.frame_index(frame)))


# --- the robot of the paper ----------------------------------------------------------------------------


def test_scompi_has_the_printed_drives_and_gains() -> None:
    robot = load("scompi")
    drives, control = robot.drives, robot.control
    assert robot.motors == drives.names == tuple(f"link_{i}.motor" for i in range(1, 7))
    assert robot.coordinates == ("link_1.tz", *(f"link_{i}.z" for i in range(2, 7)))
    assert drives.coordinates.tolist() == list(range(6))
    np.testing.assert_allclose(drives.scale * RADIUS, 1, rtol=1e-15)  # Eq. A.14
    assert drives.shaft_stiffness.tolist() == list(SHAFT_STIFFNESS)
    # Eq. A.12
    np.testing.assert_allclose(drives.inertia, [n**2 * i for n, i in zip(GEAR_RATIO, ROTOR_INERTIA, strict=True)])
    assert drives.motor_damping.tolist() == list(MOTOR_DAMPING)
    assert drives.joint_damping.tolist() == list(JOINT_DAMPING)
    assert control.kp.tolist() == [15000] * 6  # Eq. 19
    assert control.kd.tolist() == [52] * 6  # Eq. 20
    for zero in (control.ki, control.link_kp, control.link_ki, control.link_kd, control.position, control.velocity):
        assert not zero.any()
    assert control.position.shape == control.velocity.shape == (6, 12)
    assert control.feedforward
    assert robot.flexible.all()
    assert not robot.stiffness.any()
    assert not robot.damping.any()


def test_scompi_has_the_printed_bodies() -> None:
    robot = load("scompi")
    assert robot.gravity.tolist() == [-9.81, 0, 0]
    for link, (mass, com, (xx, xy, xz, yy, yz, zz)) in zip(robot.description.links, BODIES, strict=True):
        assert (link.mass, link.com) == (mass, com)
        assert link.inertia.matrix() == ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))


def test_the_frames_of_scompi_are_the_products_of_table_2() -> None:
    robot = load("scompi")
    q = np.random.default_rng(0).uniform(-2, 2, 6)
    T = np.eye(4)
    for i in range(6):
        # The first joint slides along z0 and is turned by pi/2; the others turn by q.
        theta, d = (math.pi / 2, q[0]) if i == 0 else (q[i], D[i])
        T = T @ turn("z", theta) @ shift(z=d) @ shift(x=A[i]) @ turn("x", math.radians(ALPHA_DEG[i]))
        np.testing.assert_allclose(pose(robot, q, f"link_{i + 1}"), T, atol=TOLERANCE)
    assert np.array_equal(pose(robot, q, "tool"), pose(robot, q, "link_6"))


def test_the_path_of_scompi_is_the_papers_and_its_eighth_point_is_equation_21() -> None:
    robot = load("scompi")
    path = robot.paths["table"]
    assert path.shape == (50, 6)
    pi = math.pi
    ends = ((0, 0), (-pi / 6, pi / 6), (2 * pi / 3, pi / 3), (-pi / 18, pi / 3), (-2 * pi / 3, -pi / 3), (0, 0))
    np.testing.assert_allclose(path, np.transpose([np.linspace(*end, 50) for end in ends]), atol=1e-15)
    # Eq. 21 prints three or four decimals.
    np.testing.assert_allclose(path[7], [0.0, -0.374, 1.9448, 0.0, -1.9448, 0.0], atol=5e-5)
    for name, i in (("c1", 0), ("c8", 7), ("c50", 49)):
        np.testing.assert_allclose(robot.posture(name), path[i], atol=1e-15)


def test_check_warns_of_link_6_of_scompi_and_goes_on() -> None:
    (finding,) = am.check(load("scompi"))
    assert (finding.level, finding.where) == ("warning", "links.link_6.inertia")
    assert "triangle inequality" in finding.message


# --- Denavit-Hartenberg lines --------------------------------------------------------------------------


def dh_robots(seed: int) -> tuple[Robot, Robot]:
    """A branching robot of Denavit-Hartenberg links, and the same where fixed links stand for Tx(a) Rx(alpha)."""
    rng = np.random.default_rng(seed)
    short: list[dict[str, Any]] = []
    long: list[dict[str, Any]] = []
    for i, kind in enumerate(("revolute", "prismatic", "revolute", "fixed", "revolute", "prismatic")):
        parent = "base" if i == 0 else f"link_{rng.integers(max(0, i - 2), i)}"
        theta, d, a, alpha = rng.uniform(-1, 1, 4).tolist()
        mass, com, tensor = random_body(rng)
        pairs = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
        body = {"mass": mass, "com": com.tolist(), "inertia": {key: float(tensor[at]) for key, at in pairs.items()}}
        joint, axis = {"type": kind}, {} if kind == "fixed" else {"axis": "z"}
        springs = {"elasticity": {"x": {"stiffness": 1e5}, "ty": {"stiffness": 1e6}}} if i % 2 else {}
        name = f"link_{i}"
        short.append({"name": name, "parent": parent, "dh": {"theta": theta, "d": d, "a": a, "alpha": alpha}, **springs,
                      "joint": joint, **body})  # fmt: skip
        before, after = [{"rz": theta}, {"z": d}], [{"x": a}, {"rx": alpha}]
        long.append({"name": f"joint_{i}", "parent": parent, "placement": before, "joint": joint | axis, **springs})
        long.append({"name": name, "parent": f"joint_{i}", "placement": after, "joint": {"type": "fixed"}, **body})
    frames = [{"name": "tip", "link": "link_5", "placement": [{"ry": 0.3}, {"x": 0.1, "z": -0.2}]}]
    tool = {"frame": "tip", "mass": 3, "com": [0.1, 0, 0.2], "inertia": {"xx": 0.1, "yy": 0.2, "zz": 0.2, "xy": 0.05}}
    return robot_of(short, frames=frames, tool=tool), robot_of(long, frames=frames, tool=tool)


@pytest.mark.parametrize("seed", range(3))
def test_a_dh_link_moves_as_its_motions_written_out(seed) -> None:
    short, long = dh_robots(seed)
    assert len(short.coordinates) == len(long.coordinates) == 11
    assert len(short.tree.parents) == 11  # no node for Tx(a) Rx(alpha)
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-1, 1, (3, 11))
    for frame in short.frames:
        np.testing.assert_allclose(pose(short, q, frame), pose(long, q, frame), atol=TOLERANCE)
        np.testing.assert_allclose(jacobian(short, q, frame), jacobian(long, q, frame), atol=TOLERANCE)
    torques = (np.asarray(robot.mechanism.inverse_dynamics(q, qd, qdd)) for robot in (short, long))
    assert relative_difference(*torques) < TOLERANCE


def test_virtual_coordinates_of_a_dh_link_act_in_the_joints_frame() -> None:
    link = {"name": "a", "parent": "base", "dh": {"theta": 0.2, "d": 0.3, "a": 0.5, "alpha": 0.7}}
    springs = {"elasticity": {"x": {"stiffness": 1.0}, "ty": {"stiffness": 1.0}}}
    robot = robot_of([{**link, "joint": {"type": "revolute", "axis": "z"}, **springs}])
    assert robot.coordinates == ("a.z", "a.x", "a.ty")
    joint = turn("z", 0.2) @ shift(z=0.3) @ turn("z", 0.4) @ turn("x", 0.1) @ shift(y=0.05)
    expected = joint @ shift(x=0.5) @ turn("x", 0.7)
    np.testing.assert_allclose(pose(robot, np.array([0.4, 0.1, 0.05]), "a"), expected, atol=1e-15)


def test_all_of_a_dh_line_is_zero_unless_given() -> None:
    robot = robot_of([{"name": "a", "parent": "base", "dh": {}, "joint": {"type": "prismatic"}}])
    assert robot.coordinates == ("a.tz",)
    assert np.array_equal(pose(robot, np.zeros(1), "a"), np.eye(4))


# --- drives and control --------------------------------------------------------------------------------

BODY = {"mass": 1, "inertia": {"xx": 1, "yy": 1, "zz": 1}}
DRIVE = {"gear_ratio": 100, "rotor_inertia": "2 kg cm^2", "shaft_stiffness": "30 kN m/rad"}


def driven(**control: Any) -> Robot:
    """A slide on a turning column that stands below it in the file, an undriven link between; two motors."""
    rail = DRIVE | {"radius": "20 mm", "joint_damping": "2 N s/mm", "motor_damping": 0.5}
    links = [
        {"name": "slide", "parent": "arm", "joint": {"type": "prismatic", "axis": "x"}, "drive": rail, **BODY,
         "elasticity": {"y": {"stiffness": 7e3, "damping": 3}}},
        {"name": "arm", "parent": "column", "joint": {"type": "revolute", "axis": "y"}, **BODY},
        {"name": "column", "parent": "base", "joint": {"type": "revolute", "axis": [0, 0, 2]}, "drive": DRIVE, **BODY},
    ]  # fmt: skip
    return robot_of(links, **({"control": control} if control else {}))


def test_motors_come_in_tree_order_and_drive_the_joints_own_coordinates() -> None:
    robot = driven()
    assert robot.coordinates == ("column.joint", "arm.y", "slide.tx", "slide.y")
    assert robot.motors == ("column.motor", "slide.motor")
    assert robot.drives.coordinates.tolist() == [0, 2]
    assert robot.flexible.tolist() == [True, False, True, True]
    assert robot.stiffness.tolist() == [0, 0, 0, 7e3]
    assert robot.damping.tolist() == [0, 0, 0, 3]
    np.testing.assert_allclose(robot.drives.scale, [1, 50], rtol=1e-15)
    np.testing.assert_allclose(robot.drives.inertia, 2.0, rtol=1e-15)  # 100² times 2 kg cm²
    assert robot.drives.shaft_stiffness.tolist() == [3e4, 3e4]
    assert robot.drives.motor_damping.tolist() == [0, 0.5]
    assert robot.drives.joint_damping.tolist() == [0, 2000]


def test_a_gain_is_one_number_for_all_motors_or_a_list() -> None:
    control = driven(kp="2 kN m/rad", kd=[1, "2 N m s/rad"], ki="3 N m/(rad s)", feedforward=False).control
    assert control.kp.tolist() == [2000, 2000]
    assert control.kd.tolist() == [1, 2]
    assert control.ki.tolist() == [3, 3]
    assert not control.feedforward
    assert control.link_kp.tolist() == control.link_ki.tolist() == control.link_kd.tolist() == [0, 0]


def test_state_feedback_measures_a_slide_in_metres_and_its_motor_in_radians() -> None:
    rows = [[1, "2 kN", 3, 4], ["5 N m/rad", -6, "7 kN m/rad", 8]]
    control = driven(state_feedback={"position": rows}).control
    assert control.position.tolist() == [[1, 2000, 3, 4], [5, -6, 7000, 8]]
    assert control.velocity.tolist() == [[0] * 4] * 2


def test_a_robot_without_drives_has_none() -> None:
    robot = load("kuka_kr90")
    assert robot.motors == ()
    assert robot.drives.coordinates.shape == robot.drives.scale.shape == robot.control.kp.shape == (0,)
    assert robot.control.position.shape == (0, 0)
    assert dict(robot.paths) == {}


def test_drives_and_control_cannot_be_written_to() -> None:
    robot = load("scompi")
    arrays = [*vars(robot.drives).values(), *vars(robot.control).values(), robot.paths["table"]]
    for array in arrays:
        if isinstance(array, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1


# --- tool ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", ["link_6", "tool", "link_3"])
def test_a_point_mass_as_tool_adds_its_kinetic_energy_and_weight(frame) -> None:
    bare = load("scompi")
    text = bare.to_yaml().replace("tool: {frame: link_6, mass: 0}", f"tool: {{frame: {frame}, mass: 4}}")
    robot = Robot.from_yaml(text)
    q = np.random.default_rng(1).uniform(-1, 1, 6)
    J = jacobian(bare, q, frame)[:3]
    M = np.asarray(bare.mechanism.mass_matrix(q)) + 4 * J.T @ J
    assert relative_difference(np.asarray(robot.mechanism.mass_matrix(q)), M) < TOLERANCE
    torque = np.asarray(bare.mechanism.gravity_torque(q)) - 4 * J.T @ bare.gravity
    assert relative_difference(np.asarray(robot.mechanism.gravity_torque(q)), torque) < TOLERANCE


def test_a_tool_is_a_body_in_the_axes_of_its_frame() -> None:
    text = load("scompi").to_yaml()
    placement = "placement: [{ry: 0.4}, {x: 0.1, z: 0.2}, {rx: -0.3}]"
    text = text.replace("{name: tool, link: link_6}", f"{{name: tool, link: link_6, {placement}}}")
    com, tensor = np.array([0.1, -0.2, 0.3]), np.array([[0.3, 0.01, 0.02], [0.01, 0.4, -0.03], [0.02, -0.03, 0.5]])
    bare = Robot.from_yaml(text)
    robot = Robot.from_yaml(
        text.replace(
            "tool: {frame: link_6, mass: 0}",
            "tool: {frame: tool, mass: 2, com: [0.1, -0.2, 0.3], "
            "inertia: {xx: 0.3, yy: 0.4, zz: 0.5, xy: 0.01, xz: 0.02, yz: -0.03}}",
        )
    )
    q = np.random.default_rng(2).uniform(-1, 1, 6)
    R, J = pose(bare, q, "tool")[:3, :3], jacobian(bare, q, "tool")
    x, y, z = R @ com
    lever = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    at_com = J[:3] - lever @ J[3:]
    M = np.asarray(bare.mechanism.mass_matrix(q)) + 2 * at_com.T @ at_com + J[3:].T @ R @ tensor @ R.T @ J[3:]
    assert relative_difference(np.asarray(robot.mechanism.mass_matrix(q)), M) < TOLERANCE


def test_a_tool_without_mass_changes_no_bit() -> None:
    robot = load("scompi")
    bare = Robot.from_yaml(robot.to_yaml().replace("tool: {frame: link_6, mass: 0}\n", ""))
    for name in ("masses", "coms", "inertias"):
        assert np.array_equal(getattr(robot.tree, name), getattr(bare.tree, name))


# --- paths ---------------------------------------------------------------------------------------------


def test_a_path_meets_its_waypoints_where_the_points_divide_evenly() -> None:
    text = load("scompi").to_yaml() + "  bent: {through: [c1, [0.5, 0, 10 deg, 0, 0, 1], c50, c1], points: 10}\n"
    robot = Robot.from_yaml(text)
    assert list(robot.paths) == ["table", "bent"]
    path = robot.paths["bent"]
    middle = np.array([0.5, 0, math.radians(10), 0, 0, 1])
    np.testing.assert_allclose(path[[0, 6, 9]], [robot.posture(name) for name in ("c1", "c50", "c1")], atol=1e-15)
    np.testing.assert_allclose(path[3], middle, atol=1e-15)
    for start in (0, 3, 6):
        steps = np.diff(path[start : start + 4], axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to(steps[0], (3, 6)), atol=1e-15)


def test_a_path_leaves_virtual_coordinates_at_zero() -> None:
    links = [
        {"name": "a", "parent": "base", "joint": {"type": "revolute", "axis": "z"},
         "elasticity": {"z": {"stiffness": 1}, "x": {"stiffness": 1}}},
        {"name": "b", "parent": "a", "joint": {"type": "prismatic", "axis": "x"}},
    ]  # fmt: skip
    robot = robot_of(links, paths={"way": {"through": [[0, 0], [1, "30 mm"]], "points": 3}})
    assert robot.paths["way"].tolist() == [[0, 0, 0], [0.5, 0, 0.015], [1, 0, 0.03]]


# --- what check says about motors ----------------------------------------------------------------------


def findings(robot: Robot) -> dict[str, str]:
    return {finding.where: finding.message for finding in am.check(robot)}


def test_a_driven_joint_counts_as_elastic() -> None:
    found = findings(driven(kp=1))
    assert set(found) == {"links.arm.elasticity", "postures"}


def test_check_warns_of_motors_that_nothing_holds() -> None:
    assert "have no control" in findings(driven())["control"]
    assert "holds slide.motor" in findings(driven(kp=[1, 0], kd=5))["control.kp"]
    for gain in ("kp", "ki", "link_kp", "link_ki"):
        assert not {"control", "control.kp"} & set(findings(driven(**{gain: 1})))
    rows = [[0, 0, 0, 0], [0, 1, 0, 0]]
    message = findings(driven(state_feedback={"position": rows}))["control.kp"]
    assert "column.motor" in message
    assert "slide.motor" not in message
    assert "column.motor, slide.motor" in findings(driven(state_feedback={"velocity": rows}))["control.kp"]


def test_check_warns_where_the_rotor_turns_with_its_link_noticeably() -> None:
    robot = load("scompi").with_values({"links.link_2.drive.gear_ratio": 5})
    assert "gear ratio is 5" in findings(robot)["links.link_2.drive.gear_ratio"]


def test_check_looks_at_the_tool() -> None:
    def tool(text: str) -> Robot:
        return Robot.from_yaml(load("scompi").to_yaml().replace("mass: 0}", f"mass: 1, inertia: {text}}}"))

    assert "triangle" in findings(tool("{xx: 1, yy: 1, zz: 3}"))["tool.inertia"]
    assert "negative" in findings(tool("{xx: -1, yy: 1, zz: 1}"))["tool.inertia"]
    link = {"name": "a", "parent": "base", "joint": {"type": "prismatic", "axis": "z"}}
    assert "links.a.mass" in findings(robot_of([link]))
    assert "links.a.mass" not in findings(robot_of([link], tool={"frame": "a", "mass": 2}))
