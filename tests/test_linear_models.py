"""Linear models: static equilibrium, signs of wrenches, bushings, what drops out, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import armonic as am
from armonic.errors import ArmonicError, ModelError, PostureError
from models import G, dynamic_stiffness, pendulum, random_robot, robot_of, rows_of, slides, spring
from trees import Array

# A pendulum, upright at zero: 2 kg on a rod of 0.8 m.
MASS, LENGTH = 2.0, 0.8
WEIGHT = MASS * G * LENGTH


def kuka() -> am.Robot:
    return am.load("kuka_kr90")


def unbalanced(model: am.LinearModel, reference: Array, **load: Any) -> Array:
    """Joint forces that gravity, wrench and springs leave, from the mechanism and the file's own numbers."""
    robot, none = model.robot, np.zeros(len(model.q))
    rigid = robot.mechanism.inverse_dynamics(model.q, none, none, **load)
    return (rigid + robot.stiffness * (model.q - reference))[robot.flexible]


# --- Static equilibrium -------------------------------------------------------------------------------------


@pytest.mark.parametrize("stiffness", [1.2, 2.0, 10.0, 1e3])
@pytest.mark.parametrize("angle", [0.05, 0.6, 1.5, -0.9, 3.0])
def test_a_pendulum_settles_where_spring_and_gravity_balance(stiffness, angle):
    # k (q - angle) = m g l sin q; with k > m g l there is one solution, on the side to which the rod leans.
    k = stiffness * WEIGHT
    settled = brentq(
        lambda q: k * (q - angle) - WEIGHT * np.sin(q), angle - 1 / stiffness, angle + 1 / stiffness, xtol=1e-15
    )
    model = am.linearize(pendulum(k, mass=MASS, length=LENGTH), [angle], equilibrium="static")
    assert model.q[0] == pytest.approx(settled, rel=1e-12)
    assert model.stiffness[0, 0] == pytest.approx(k - WEIGHT * np.cos(settled), rel=1e-11)
    assert model.free_stiffness[0, 0] == pytest.approx(-WEIGHT * np.cos(settled), rel=1e-11)
    # Where the paper linearizes, gravity already acts but has not yet bent anything.
    reference = am.linearize(pendulum(k, mass=MASS, length=LENGTH), [angle])
    assert reference.q[0] == angle
    assert reference.stiffness[0, 0] == pytest.approx(k - WEIGHT * np.cos(angle), rel=1e-13)


@pytest.mark.parametrize("force", [0.0, 2000.0])
def test_at_the_static_equilibrium_of_a_robot_all_forces_balance(force):
    robot = kuka()
    load = {"wrench": [force, -force / 2, -force, 100.0, 50.0, -80.0], "frame": "sensor"} if force else {}
    model = am.linearize(robot, "milling", equilibrium="static", **load)
    wrenches = [(robot.frame_index("sensor"), load["wrench"])] if force else []
    left = unbalanced(model, robot.postures["milling"], wrenches=wrenches)
    held = unbalanced(am.linearize(robot, "milling"), robot.postures["milling"], wrenches=wrenches)
    assert np.abs(left).max() < 1e-9 * np.abs(held).max()  # springs of 1e7 N m/rad round at 1e-9 N m
    # It sags by what the static compliance says, to first order: gravity torque over stiffness.
    first = -np.linalg.solve(am.linearize(robot, "milling", **load).stiffness, held)
    np.testing.assert_allclose(model.q - robot.postures["milling"], first, rtol=0, atol=0.01 * np.abs(first).max())


def test_gravity_pulls_a_settled_robot_down():
    robot = kuka()
    sensor = robot.frame_index("sensor")
    before, after = (am.linearize(robot, "milling", equilibrium=how).q for how in ("reference", "static"))
    assert robot.mechanism.pose(after, sensor)[2, 3] < robot.mechanism.pose(before, sensor)[2, 3] - 1e-4


def test_without_load_a_robot_settles_where_it_is():
    robot = am.Robot.from_yaml(kuka().to_yaml().replace("[0, 0, -9.81]", "[0, 0, 0]"))
    model = am.linearize(robot, "milling", equilibrium="static")
    np.testing.assert_array_equal(model.q, robot.postures["milling"])


@pytest.mark.parametrize("stiffness", [1e3, 1e9, 1e12])
def test_a_bushing_that_pulls_towards_another_posture_is_balanced(stiffness):
    # In parallel with the slide's own spring, and unloaded 20 mm further on.
    pad = {"name": "pad", "between": ["base", "mass_0"], "stiffness": [stiffness, 0, 0, 0, 0, 0], "rest": [0.02]}
    robot = slides([2.0], [spring(1e4)], bushings=[pad])
    model = am.linearize(robot, [0.0], equilibrium="static")
    assert model.q[0] == pytest.approx(0.02 * stiffness / (stiffness + 1e4), rel=1e-12)


@pytest.mark.parametrize("gravity", [-G, 0.0])
def test_a_stiff_rope_to_the_ground_does_not_hinder_the_search(gravity):
    # Its forces round at 1e-6 N, far above what balances exactly.
    rope = {
        "name": "rope",
        "between": ["base", "sensor"],
        "stiffness": [1e10] * 3 + [1e3] * 3,
        "rest": [0, 1.21, -1.75],
    }
    text = kuka().to_yaml().replace("-9.81]", f"{gravity}]")
    robot = am.Robot.from_yaml(text + f"\nbushings: [{rope}]\n".replace("'", ""))
    model = am.linearize(robot, "milling", equilibrium="static")
    end, rest = (robot.mechanism.pose(robot.posture(q), robot.frame_index("sensor")) for q in (model.q, rope["rest"]))
    # The joints, of some 1e6 N m/rad, give way to a rope of 1e10 N/m.
    assert np.abs(end[:3, 3] - rest[:3, 3]).max() < 1e-4


def test_a_free_turntable_stays_where_it_is_while_the_rest_settles():
    robot = am.Robot.from_yaml(kuka().to_yaml().replace("z: {stiffness: 5.0e6, damping: 20}", "z: free"))
    model = am.linearize(robot, [0.3, 1.2, -1.7], equilibrium="static")
    assert model.q[0] == pytest.approx(0.3, abs=1e-12)
    assert np.abs(unbalanced(model, robot.posture([0.3, 1.2, -1.7]))).max() < 1e-5


WEAK: dict[str, tuple[am.Robot, list[float]]] = {
    # 100 kg on 1 N/m would sag by a kilometre.
    "a lift": (slides([100.0], [spring(1.0)], axis="z"), [0.0]),
    # It leans to the right; balanced it would be leaning to the left, where it cannot come to rest.
    "a leaning pendulum": (pendulum(0.5 * WEIGHT, mass=MASS, length=LENGTH), [0.1]),
    "a pendulum that is upright": (pendulum(0.5 * WEIGHT, mass=MASS, length=LENGTH), [0.0]),
    "a free lift": (slides([2.0], ["free"], axis="z"), [0.0]),
}


@pytest.mark.parametrize("name", WEAK)
def test_a_spring_too_weak_to_carry_the_load_is_refused(name):
    robot, posture = WEAK[name]
    with pytest.raises(ModelError, match="no stable static equilibrium"):
        am.linearize(robot, posture, equilibrium="static")
    assert am.linearize(robot, posture).q.tolist() == posture  # at the reference posture there is a model


# --- Wrenches -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_force_pulls_a_slide_along_with_it(axis):
    robot = slides([2.0], [spring(1e4)], axis=axis, gravity=[0, 0, 0])
    force = 30.0 * np.eye(6)["xyz".index(axis)]
    model = am.linearize(robot, [0.1], wrench=force, frame="mass_0", equilibrium="static")
    assert model.q[0] == pytest.approx(0.1 + 30.0 / 1e4, rel=1e-13)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_moment_turns_a_hinge_along_with_it(axis):
    link = {
        "name": "disc",
        "parent": "base",
        "joint": {"type": "revolute", "axis": axis},
        "elasticity": {axis: spring(1e4)},
        "mass": 1.0,
        "inertia": {"xx": 1, "yy": 1, "zz": 1},
    }
    moment = 30.0 * np.eye(6)[3 + "xyz".index(axis)]
    model = am.linearize(robot_of([link]), [0.1], wrench=moment, frame="disc", equilibrium="static")
    assert model.q[0] == pytest.approx(0.1 + 30.0 / 1e4, rel=1e-13)


def test_a_wrench_is_in_world_axes_whatever_the_frame_points_at():
    # The link is turned about z by 90 degrees, so that its x is the world's y.
    link = {
        "name": "block",
        "parent": "base",
        "placement": [{"rz": "90 deg"}],
        "joint": {"type": "prismatic", "axis": "x"},
        "elasticity": {"tx": spring(1e4)},
        "mass": 1.0,
    }
    robot = robot_of([link])
    for force, expected in (([30.0, 0, 0], 0.0), ([0, 30.0, 0], 30.0 / 1e4)):
        model = am.linearize(robot, [0.0], wrench=[*force, 0, 0, 0], frame="block", equilibrium="static")
        assert model.q[0] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("angle", [0.0, 0.5, 2.0])
def test_pulling_at_the_tip_stiffens_a_hinge_and_pushing_softens_it(angle):
    # A force F upwards at the tip of the upright pendulum adds F l cos q to k - m g l cos q.
    robot = pendulum(50.0, mass=MASS, length=LENGTH)
    for force in (200.0, -200.0):
        model = am.linearize(robot, [angle], wrench=[0, 0, force, 0, 0, 0], frame="tip")
        expected = 50.0 + (force * LENGTH - WEIGHT) * np.cos(angle)
        assert model.stiffness[0, 0] == pytest.approx(expected, rel=1e-13)


# --- Motion -------------------------------------------------------------------------------------------------


def test_a_slide_on_a_turning_table_feels_coriolis_and_centrifugal_forces():
    # f_r = m r'' - m r w², f_w = m r² w' + 2 m r r' w: what these change by with r, r' and w at constant speed w.
    mass, r, w, k = 3.0, 0.7, 5.0, 2e3
    table = {
        "name": "table",
        "parent": "base",
        "joint": {"type": "revolute", "axis": "z"},
        "elasticity": {"z": spring(k, 7.0)},
        "mass": 1.0,
        "inertia": {"xx": 1, "yy": 1, "zz": 2.0},
    }
    block = {
        "name": "block",
        "parent": "table",
        "joint": {"type": "prismatic", "axis": "x"},
        "elasticity": {"tx": spring(k, 9.0)},
        "mass": mass,
    }
    model = am.linearize(robot_of([table, block]), [0.2, r], velocity=[w, 0.0])
    np.testing.assert_allclose(model.mass, np.diag([2.0 + mass * r**2, mass]), rtol=1e-13, atol=1e-13)
    coriolis = np.array([[0, 2 * mass * r * w], [-2 * mass * r * w, 0]])
    np.testing.assert_allclose(model.free_damping, coriolis, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(model.damping, coriolis + np.diag([7.0, 9.0]), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(model.stiffness, np.diag([k, k - mass * w**2]), rtol=1e-13, atol=1e-11)
    # Speeding up the table at a, the slide changes the moment by 2 m r a.
    faster = am.linearize(robot_of([table, block]), [0.2, r], acceleration=[4.0, 0.0])
    assert faster.stiffness[0, 1] == pytest.approx(2 * mass * r * 4.0, rel=1e-13)


def test_rates_may_be_given_for_the_joints_or_for_all_coordinates():
    robot = kuka()
    by_joint = am.linearize(robot, "milling", velocity=[1.0, 2.0, 3.0], acceleration=[4.0, 5.0, 6.0])
    spread = [[a, 0, 0, b, 0, 0, c, 0, 0] for a, b, c in ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))]
    by_coordinate = am.linearize(robot, "milling", velocity=spread[0], acceleration=spread[1])
    np.testing.assert_array_equal(by_joint.damping, by_coordinate.damping)
    np.testing.assert_array_equal(by_joint.stiffness, by_coordinate.stiffness)
    assert np.abs(by_joint.damping - am.linearize(robot, "milling").damping).max() > 1.0


# --- Bushings, and the split into impedances and the rest ---------------------------------------------------


def roped(**change: Any) -> am.Robot:
    """A random robot of five joints with a bushing from the ground to its tip."""
    rope = {"name": "rope", "between": ["base", "tip"], "stiffness": [3e5] * 3 + [2e4] * 3, "damping": [50.0] * 6}
    return random_robot(7, 5, bushings=[rope | change])


def full_matrix(scale: float) -> list[list[float]]:
    root = np.random.default_rng(3).normal(size=(6, 6))
    matrix = scale * (root @ root.T + np.eye(6))
    return ((matrix + matrix.T) / 2).tolist()


BUSHINGS: dict[str, dict[str, Any]] = {
    "six springs": {},
    "full matrices": {"stiffness": full_matrix(1e5), "damping": full_matrix(10.0)},
    "very stiff": {"stiffness": [1e10] * 6},
}


@pytest.mark.parametrize("name", BUSHINGS)
def test_an_unloaded_bushing_adds_its_stiffness_and_damping_where_its_ends_move(name):
    robot, bare = roped(**BUSHINGS[name]), random_robot(7, 5)
    found, without = am.linearize(robot, "bent"), am.linearize(bare, "bent")
    # What the tip does, in the axes of the ground.
    E = robot.mechanism.jacobian(found.q, robot.frame_index("tip"))
    (bushing,) = robot.bushings
    for got, before, matrix in (
        (found.stiffness, without.stiffness, bushing.stiffness),
        (found.damping, without.damping, bushing.damping),
    ):
        expected = before + E.T @ matrix @ E
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    np.testing.assert_array_equal(found.mass, without.mass)


@pytest.mark.parametrize("name", BUSHINGS)
def test_impedances_are_named_by_their_path_and_carry_the_files_numbers(name):
    robot = roped(**BUSHINGS[name])
    model = am.linearize(robot, "bent")
    joints = tuple(f"links.link_{i}.elasticity.joint" for i in range(5))
    axes = ("x", "y", "z", "rx", "ry", "rz")
    assert model.impedances == joints + tuple(f"bushings.rope.{axis}" for axis in axes)
    values = robot.parameters()
    paths = [(f"{joint}.stiffness", f"{joint}.damping") for joint in joints]
    paths += [(f"bushings.rope.stiffness.{axis}", f"bushings.rope.damping.{axis}") for axis in axes]
    assert model.spring.tolist() == [values[k] for k, _ in paths]
    assert model.damper.tolist() == [values[d] for _, d in paths]
    np.testing.assert_array_equal(model.directions[:5], np.eye(5))


@pytest.mark.parametrize("load", [{}, {"wrench": [100.0, -50.0, 80.0, 9.0, 5.0, -3.0], "frame": "tip"}])
@pytest.mark.parametrize("name", BUSHINGS)
def test_the_free_parts_and_the_impedances_make_up_the_whole(name, load):
    model = am.linearize(roped(**BUSHINGS[name]), "bent", **load)
    for free, values, whole in (
        (model.free_stiffness, model.spring, model.stiffness),
        (model.free_damping, model.damper, model.damping),
    ):
        made = free + np.einsum("r,ri,rj->ij", values, model.directions, model.directions)
        np.testing.assert_allclose(made, whole, rtol=0, atol=1e-13 * np.abs(whole).max())


def test_the_free_part_of_six_springs_is_the_robot_without_them():
    for name in ("six springs", "very stiff"):
        found, bare = am.linearize(roped(**BUSHINGS[name]), "bent"), am.linearize(random_robot(7, 5), "bent")
        # Springs that are added and taken out again leave their rounding.
        size = 1e-14 * max(np.abs(found.stiffness).max(), 1.0)
        np.testing.assert_allclose(found.free_stiffness, bare.free_stiffness, rtol=0, atol=size)
        # At rest the model is symmetric to the last bit: the kernel then solves it the fast way.
        np.testing.assert_array_equal(found.free_stiffness, found.free_stiffness.T)


def test_a_loaded_bushing_pulls_as_a_taut_string_does():
    # A spring along z, unloaded while the rod lies flat, holds the tip of the upright rod down as a weight would.
    k = 1e4
    pull = {"name": "pull", "between": ["base", "tip"], "stiffness": [0, 0, k, 0, 0, 0], "rest": [np.pi / 2]}
    model = am.linearize(pendulum(1e3, mass=MASS, length=LENGTH, bushings=[pull], gravity=[0, 0, 0]), [0.0])
    # Its energy is k (l cos q)² / 2, whose second derivative at q = 0 is -k l²; no spring of the list has a part in it.
    assert model.stiffness[0, 0] == pytest.approx(1e3 - k * LENGTH**2, rel=1e-12)
    assert model.free_stiffness[0, 0] == pytest.approx(-k * LENGTH**2, rel=1e-12)


# --- What drops out, and the state matrix -------------------------------------------------------------------


def test_locked_coordinates_drop_out():
    joint = {"type": "revolute", "axis": "y"}
    body = {"mass": 3.0, "com": [0.3, 0.1, 0.2], "inertia": {"xx": 1, "yy": 2, "zz": 2}}
    upper = {"name": "upper", "parent": "base", "joint": joint, "elasticity": {"y": spring(1e4, 5.0)}, **body}
    lower = {"name": "lower", "parent": "upper", "placement": [{"x": 1.0}], "joint": joint, **body}
    welded = lower | {"placement": [{"x": 1.0}, {"ry": 0.7}], "joint": {"type": "fixed"}}
    locked, rigid = am.linearize(robot_of([upper, lower]), [0.4, 0.7]), am.linearize(robot_of([upper, welded]), [0.4])
    assert locked.coordinates == rigid.coordinates == ("upper.y",)
    assert locked.q.tolist() == [0.4, 0.7]
    for name in ("mass", "damping", "stiffness", "free_stiffness", "spring", "damper", "directions"):
        np.testing.assert_allclose(getattr(locked, name), getattr(rigid, name), rtol=1e-13, atol=1e-15)
    for model in (locked, rigid):
        assert model.jacobian("lower").shape == (6, 1)
    # The locked joint does not give way under gravity either.
    assert am.linearize(robot_of([upper, lower]), [0.4, 0.7], equilibrium="static").q[1] == 0.7


def test_the_jacobian_is_that_of_the_frame_in_its_own_axes():
    model = am.linearize(kuka(), "milling")
    expected = rows_of(model, "sensor", ("x", "y", "z", "rx", "ry", "rz"))
    np.testing.assert_allclose(model.jacobian("sensor"), expected, atol=1e-14)


@pytest.mark.parametrize("velocity", [None, [3.0, -2.0, 1.5, 4.0, -1.0]])
def test_the_state_matrix_has_the_poles_of_the_modes(velocity):
    model = am.linearize(random_robot(1, 5), "bent", velocity=velocity)
    A, modes = model.state_matrix(), am.modes(model)
    found = np.linalg.eigvals(A)
    expected = np.concatenate([modes.poles, modes.poles[modes.oscillatory].conj()])
    gaps = np.abs(found[:, None] - expected)
    assert sorted(np.argmin(gaps, axis=1)) == list(range(10))
    assert gaps.min(axis=1).max() < 1e-10 * np.abs(expected).max()
    # (s - A)⁻¹ maps a force through M⁻¹ onto what Z⁻¹ makes of it.
    s = 1.0 + 20.0j
    Z = dynamic_stiffness(np.array([s]), model.mass, model.damping, model.stiffness)[0]
    whole = np.linalg.inv(s * np.eye(10) - A)[:5, 5:] @ np.linalg.inv(model.mass)
    np.testing.assert_allclose(whole, np.linalg.inv(Z), rtol=0, atol=1e-11 * np.abs(whole).max())


# --- What is refused ----------------------------------------------------------------------------------------

REFUSED: dict[str, tuple[dict[str, Any], type[ArmonicError], str]] = {
    "unknown posture": ({"posture": "miling"}, PostureError, r"'miling'.*milling"),
    "posture too short": ({"posture": [0.0, 1.0]}, PostureError, r"2 values.*3 values"),
    "wrench without frame": ({"wrench": [0.0] * 6}, PostureError, r"frame: found nothing.*frame at which"),
    "frame without wrench": ({"frame": "sensor"}, PostureError, r"frame: .*'sensor' without a wrench"),
    "wrench of a force alone": ({"wrench": [1.0, 2, 3], "frame": "sensor"}, PostureError, r"wrench: .*six finite"),
    "wrench with NaN": ({"wrench": [np.nan] * 6, "frame": "sensor"}, PostureError, r"wrench: .*six finite"),
    "wrench in words": ({"wrench": "10 N down", "frame": "sensor"}, PostureError, r"wrench: .*'10 N down'.*six finite"),
    "wrench of ragged lists": ({"wrench": [[1, 2], [3]], "frame": "sensor"}, PostureError, r"wrench: .*six finite"),
    "unknown frame": ({"wrench": [0.0] * 6, "frame": "senser"}, PostureError, r"'senser'.*sensor"),
    "unknown equilibrium": ({"equilibrium": "dynamic"}, PostureError, r'equilibrium: .*"reference" or "static"'),
    "velocity too short": ({"velocity": [1.0]}, PostureError, r"velocity: .*3 finite numbers, one per joint, or 9"),
    "velocity infinite": ({"velocity": [1.0, np.inf, 0]}, PostureError, r"velocity: .*finite"),
    "velocity in words": ({"velocity": "fast"}, PostureError, r"velocity: .*'fast'"),
    "acceleration too long": ({"acceleration": [0.0] * 10}, PostureError, r"acceleration: .*9, one per coordinate"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_linearize_refuses(name):
    change, error, message = REFUSED[name]
    with pytest.raises(error, match=message):
        am.linearize(kuka(), **({"posture": "milling"} | change))


def test_a_robot_without_any_elasticity_has_no_linear_model():
    rigid = robot_of([{"name": "a", "parent": "base", "joint": {"type": "revolute", "axis": "z"}, "mass": 1.0}])
    for ask in (am.linearize, am.modes):
        with pytest.raises(ModelError, match=r"no coordinate with elasticity.*elasticity"):
            ask(rigid, [0.0])


def test_an_unknown_frame_of_a_model_is_refused_with_the_nearest_one():
    with pytest.raises(PostureError, match=r"'senser'.*sensor"):
        am.linearize(kuka(), "milling").jacobian("senser")


def test_a_massless_coordinate_has_no_state_matrix():
    model = am.linearize(slides([2.0, 0.0], [spring(1.0), spring(1.0)]), [0.0, 0.0])
    with pytest.raises(ModelError, match=r"mass matrix that is not positive definite.*armonic check"):
        model.state_matrix()


def test_springs_beside_a_loaded_bushing_are_neither_fitted_nor_varied():
    # Its load, and the stiffness that comes from it, would change with them.
    pad = {
        "name": "pad",
        "between": ["base", "mass_0"],
        "stiffness": [3e4, 0, 0, 0, 0, 0],
        "damping": [9, 0, 0, 0, 0, 0],
    }
    loaded = slides([2.0], [spring(1e4, 20.0)], bushings=[pad | {"rest": [0.02]}])
    at_rest = slides([2.0], [spring(1e4, 20.0)], bushings=[pad])
    assert am.linearize(loaded, [0.0]).loaded == ("pad",)
    assert am.linearize(at_rest, [0.0]).loaded == ()
    model = am.linearize(loaded, [0.0])
    with pytest.raises(am.FrfError, match=r"loaded bushings pad.*linearize it again"):
        am.responses([model], [1.0], frame="mass_0", spring=2 * model.spring)
    H = am.frf(at_rest, [0.0], [10.0, 20.0, 30.0], frame="mass_0", outputs="x", inputs="x")
    measured = am.Measurement(H, posture=[0.0], frame="mass_0", weights="uniform")
    with pytest.raises(am.UpdateError, match=r"bushings.pad.stiffness.x: found a bushing that carries load"):
        am.update(loaded, measured, parameters="bushings.pad.stiffness.x")
    assert am.update(at_rest, measured, parameters="bushings.pad.stiffness.x").cost < 1e-20


@pytest.mark.parametrize("load", [{"wrench": [1e308] * 6, "frame": "sensor"}, {"velocity": [1e200, 1e200, 0.0]}])
def test_loads_and_speeds_beyond_all_numbers_are_refused(load):
    with pytest.raises(ModelError, match="numbers too large"):
        am.linearize(kuka(), "milling", **load)


def test_inertia_that_no_body_has_is_refused_by_every_analysis():
    link = {"name": "a", "parent": "base", "joint": {"type": "revolute", "axis": "z"}, "mass": 1.0}
    robot = robot_of([link | {"inertia": {"zz": -500}, "elasticity": {"z": spring(1e4, 1.0)}}])
    for ask in (am.linearize, am.modes, lambda r, q: am.frf(r, q, [1.0], frame="a")):
        with pytest.raises(ModelError, match=r"negative direction.*armonic check"):
            ask(robot, [0.0])
