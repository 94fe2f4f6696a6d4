"""Driven robots: the explicit closed loop against its law, and the impedance form against the explicit one."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import armonic as am
from armonic.linear import LinearModel
from closed_loops import Law, driven_slide, impedance_form, impedances
from models import AXES, difference, pendulum, random_driven_robot, random_robot, robot_of, spring
from trees import Array

TURN = 2 * np.pi
SEEDS = range(12)
FREQ_HZ = np.linspace(0.0, 60.0, 61)


@cache
def robot(seed: int, feedback: bool = False) -> am.Robot:
    return random_driven_robot(seed, 1 + seed % 8, feedback=feedback)


@cache
def scompi() -> LinearModel:
    return am.linearize(am.load("scompi"), "c8")


def whole(model: LinearModel, s: complex) -> Array:
    """Z(s) of links and motors."""
    return s**2 * model.mass + s * model.damping + model.stiffness + model.integral / s


# --- The explicit form --------------------------------------------------------------------------------------


def test_the_matrices_of_scompi_are_those_of_eqs_9_to_12():
    model, q = scompi(), am.load("scompi").postures["c8"]
    mechanism = model.robot.mechanism
    # Tables 1 and 4, section 4.2.
    B = np.diag(np.array([51, 160, 160, 160, 160, 160]) ** 2 * np.array([1.71, 2.65, 2.42, 1.26, 0.91, 0.86]) * 1e-4)
    K = np.diag([25e3, 120e3, 120e3, 57e3, 29e3, 29e3])
    W = np.diag([1 / 0.057, 1, 1, 1, 1, 1])
    D = np.diag([2.73, 24.74, 5.76, 9.37, 8.74, 8.74])
    Dm = np.diag([9.46e-4] * 4 + [5.90e-4] * 2)
    KP, KD, none = 15e3 * np.eye(6), 52 * np.eye(6), np.zeros((6, 6))
    h = 1e-6
    KG = np.array([mechanism.gravity_torque(q + h * e) - mechanism.gravity_torque(q - h * e) for e in np.eye(6)]).T
    KG /= 2 * h
    np.testing.assert_allclose(model.mass, np.block([[mechanism.mass_matrix(q), none], [none, B]]), rtol=1e-13)
    np.testing.assert_allclose(model.damping, np.block([[D, none], [none, Dm + KD]]), rtol=1e-13, atol=1e-12)
    expected = np.block([[KG + K @ W**2, -K @ W], [-K @ W, K + KP]])
    np.testing.assert_allclose(model.stiffness, expected, rtol=1e-13, atol=1e-7)  # differences of KG
    np.testing.assert_allclose(model.stiffness, model.stiffness.T, rtol=0, atol=1e-13)
    assert not model.integral.any()
    names = [f"link_{i}" for i in range(1, 7)]
    assert model.coordinates[6:] == model.drives.names == tuple(f"{name}.motor" for name in names)
    assert (model.links, model.local, model.impedances, model.directions.shape) == (6, True, (), (0, 12))


@pytest.mark.parametrize("feedback", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_matrices_are_the_derivatives_of_the_law(seed, feedback):
    model = am.linearize(robot(seed, feedback), "bent")
    law = Law(model.robot, model.robot.postures["bent"])
    N = len(model.coordinates)
    z, none = np.concatenate([model.q[law.keep], model.motor_position]), np.zeros(N)
    h = 1e-5
    for i, matrix in enumerate((model.stiffness, model.damping, model.integral)):
        found = np.zeros((N, N))
        for j in range(N):
            ends = []
            for step in (h, -h):
                at = [z.copy(), none.copy(), none.copy()]
                at[i][j] += step
                ends.append(law.residual(*at))
            found[:, j] = (ends[0] - ends[1]) / (2 * h)
        # The law is linear but for gravity, whose third derivative is of the size of itself; torques round at 1e-10.
        np.testing.assert_allclose(matrix, found, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_motors_hold_what_the_joints_carry(seed):
    model = am.linearize(robot(seed), "bent")
    d = model.drives
    carried = model.robot.mechanism.gravity_torque(model.q)[d.coordinates]
    # Do et al. 2022, Eqs. 2 and 3.
    np.testing.assert_allclose(model.motor_torque, carried / d.scale, rtol=1e-13, atol=1e-13)
    wound = d.shaft_stiffness * (model.motor_position - d.scale * model.q[d.coordinates])
    np.testing.assert_allclose(wound, model.motor_torque, rtol=1e-9, atol=1e-9)


def test_the_jacobian_does_not_know_of_motors():
    for model in (scompi(), am.linearize(robot(4), "bent")):
        J = model.jacobian(model.robot.frames[-1])
        assert J.shape == (6, len(model.coordinates))
        assert not J[:, model.links :].any()
        assert J[:, : model.links].any()


def test_springs_and_bushings_stay_beside_drives():
    pad = {"name": "pad", "between": ["base", "tip"], "stiffness": [3e5] * 6, "damping": [50.0] * 6}
    sprung = random_driven_robot(5, 6, bushings=[pad])
    model, bare = am.linearize(sprung, "bent"), am.linearize(random_driven_robot(5, 6), "bent")
    springs = int((sprung.stiffness > 0).sum())
    assert 0 < springs < 6
    assert model.directions.shape == (springs + 6, len(model.coordinates))
    assert not model.directions[:, 6:].any()
    E = np.pad(sprung.mechanism.jacobian(model.q, sprung.frame_index("tip")), ((0, 0), (0, len(model.loop))))
    expected = bare.stiffness + 3e5 * E.T @ E
    np.testing.assert_allclose(model.stiffness, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    np.testing.assert_allclose(
        am.modes(model).participation.sum(axis=0) + am.modes(model).bushing_participation.sum(axis=0), 1.0
    )
    doubled = model.with_impedances(2 * model.spring, model.damper)
    again = sprung.with_values({p: 2 * v for p, v in sprung.parameters("stiffness").items()})
    np.testing.assert_allclose(doubled.stiffness, am.linearize(again, "bent").stiffness, rtol=1e-12, atol=1e-6)


# --- Modes --------------------------------------------------------------------------------------------------


def test_a_motor_a_shaft_and_a_mass_have_the_two_textbook_frequencies():
    mass, k, kp, B, r = 40.0, 3e4, 5e3, 2.0, 0.1
    modes = am.modes(driven_slide(mass=mass, radius=r, shaft_stiffness=k, control={"kp": kp}), [0.0])
    # In the motor's angle the mass is m r²; its squared frequencies solve a quadratic.
    m = mass * r**2
    half = (k / m + (k + kp) / B) / 2
    squared = half + np.array([-1, 1]) * np.sqrt(half**2 - k * kp / (m * B))
    np.testing.assert_allclose(modes.natural_freq_hz, np.sqrt(squared) / TURN, rtol=1e-12)
    assert modes.stability == "marginal"  # nothing damps it
    # All elastic energy is that of the one driven joint; the motor's row is empty.
    np.testing.assert_allclose(modes.participation, [[1, 1], [0, 0]], rtol=1e-12)
    assert modes.movers(0) == (("mass.tx", pytest.approx(1.0)),)
    u = modes.shapes
    np.testing.assert_allclose(np.abs(mass * u[0] ** 2 + B * u[1] ** 2), 1.0, rtol=1e-12)
    np.testing.assert_allclose(u[1] / u[0], (1 - squared * m / k) / r, rtol=1e-9)


def test_shares_of_a_driven_joint_and_a_sprung_one_are_those_of_their_springs():
    link = {"parent": "base", "joint": {"type": "prismatic", "axis": "x"}, "mass": 5.0}
    drive = {"gear_ratio": 100, "rotor_inertia": 1e-4, "shaft_stiffness": 2e4, "radius": 0.5}
    links = [
        link | {"name": "a", "drive": drive},
        link | {"name": "b", "parent": "a", "elasticity": {"tx": spring(3e4)}},
    ]
    modes = am.modes(robot_of(links, control={"kp": 7e3}), [0.0, 0.0])
    a, b, motor = modes.shapes
    energy = np.array([2e4 * np.abs(2 * a - motor) ** 2 + 7e3 * np.abs(motor) ** 2, 3e4 * np.abs(b) ** 2])
    np.testing.assert_allclose(modes.participation[:2], energy / energy.sum(axis=0), rtol=1e-12)
    assert not modes.participation[2].any()


def test_a_motor_that_is_held_fast_leaves_its_shaft_as_a_spring():
    held = random_driven_robot(8, 4, control={"kp": 1e12, "kd": 1e7})
    model, d = am.linearize(held, "bent"), held.drives
    n, c, none = model.links, model.loop.driven, np.zeros(len(model.q))
    springs, dampers = np.diag(held.stiffness), np.diag(held.damping)
    springs[c, c], dampers[c, c] = d.scale**2 * d.shaft_stiffness, d.joint_damping
    mass, _, stiffness = held.mechanism.linearize(model.q, none, none)
    lower = -np.linalg.solve(mass, np.hstack([stiffness + springs, dampers]))
    expected = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower]))
    found = am.modes(model).poles
    # The motor gives way by a share of 1e-7, and its own poles lie at -kp / kd = -1e5 and beyond.
    gaps = np.abs(found[:, None] - expected[expected.imag > 0]).min(axis=0)
    assert (gaps < 1e-6 * np.abs(expected[expected.imag > 0])).all()
    assert (np.abs(found) < 1e4).sum() == (expected.imag >= 0).sum()


@pytest.mark.parametrize("feedback", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_shapes_and_poles_solve_the_quadratic_problem_with_integrals(seed, feedback):
    model = am.linearize(robot(seed, feedback), "bent")
    modes = am.modes(model)
    N, p = len(model.coordinates), len(model.loop.integrating)
    assert len(modes) + int(modes.oscillatory.sum()) == 2 * N + p == len(model.state_matrix())
    for pole, u in zip(modes.poles, modes.shapes.T, strict=True):
        terms = [pole**2 * model.mass, pole * model.damping, model.stiffness, model.integral / pole]
        size = sum(np.abs(term) @ np.abs(u) for term in terms)
        assert (np.abs(sum(term @ u for term in terms)) < 1e-9 * size.max()).all()
    by_mass = np.einsum("im,ij,jm->m", modes.shapes.conj(), model.mass, modes.shapes)
    np.testing.assert_allclose(by_mass, 1.0, rtol=1e-10)
    np.testing.assert_allclose(modes.participation.sum(axis=0), 1.0, rtol=1e-10)
    assert not modes.participation[model.links :].any()


@pytest.mark.parametrize("make", [scompi, lambda: am.linearize(robot(7), "bent")])
def test_poles_are_as_good_as_those_of_lapack_on_the_balanced_state_matrix(make):
    # Mode 12 of Scompi, 850 Hz damped by 80 %, stands beside modes of 6 Hz.
    model = make()
    modes, expected = am.modes(model), scipy.linalg.eigvals(model.state_matrix())
    found = np.concatenate([modes.poles, modes.poles[modes.oscillatory].conj()])
    gaps = np.abs(found[:, None] - expected)
    assert sorted(np.argmin(gaps, axis=1)) == list(range(len(expected)))
    assert (gaps.min(axis=1) < 1e-11 * np.abs(found)).all()


# --- The impedance form -------------------------------------------------------------------------------------


def refined(model: LinearModel, s: complex) -> complex:
    """The zero of det Z(s) near by, by Newton's method on the impedance form: s - 1 / tr(Z⁻¹ Z')."""
    for _ in range(6):
        h = 1e-5 * abs(s)
        slope = (impedance_form(model, s + h) - impedance_form(model, s - h)) / (2 * h)
        Z = impedance_form(model, s)
        if np.linalg.det(Z) == 0:
            break
        s = s - 1 / np.trace(np.linalg.solve(Z, slope))
    return s


@pytest.mark.parametrize("seed", range(40))
def test_poles_of_the_explicit_form_are_zeros_of_the_impedance_form(seed):
    # Revolute and prismatic joints, driven and sprung, with integral and link-side gains.
    model = am.linearize(robot(seed), "bent")
    assert model.local
    poles = am.modes(model).poles
    zeros = np.array([refined(model, s * (1 + 1e-9)) for s in poles])
    np.testing.assert_allclose(poles, zeros, rtol=1e-9)
    # None is found twice, and together they are as many as the degree of the polynomial det Z(s) * Delta(s).
    gaps = np.abs(zeros[:, None] - zeros) + np.diag(np.full(len(zeros), np.inf))
    assert (gaps > 1e-6 * np.abs(zeros)).all()


def test_the_random_robots_are_what_the_tests_say():
    robots = [robot(seed) for seed in range(40)]
    kinds = {kind for r in robots for kind in np.array(r.tree.kinds)[r.drives.coordinates]}
    assert kinds == {"revolute", "prismatic"}
    assert any((r.stiffness > 0).any() and r.control.ki.any() and r.control.link_kd.any() for r in robots)
    assert {am.modes(r, "bent").stability for r in robots} == {"asymptotically stable", "unstable"}


@pytest.mark.parametrize("seed", SEEDS)
def test_both_forms_respond_alike(seed):
    model = am.linearize(robot(seed), "bent")
    J = model.jacobian("tip")
    n = model.links
    for s in (3j, 80j, -4 + 30j, 500 + 0j):
        explicit = J @ np.linalg.solve(whole(model, s), J.T)
        impedance = J[:, :n] @ np.linalg.solve(impedance_form(model, s), J[:, :n].T)
        np.testing.assert_allclose(impedance, explicit, rtol=0, atol=1e-10 * np.abs(explicit).max())


def test_the_numbers_for_the_core_make_up_the_impedance():
    model = am.linearize(robot(7), "bent")
    w, k, B, damping, stiffness, ki, link_kp, link_kd, link_ki = model.loop.impedances().T
    s = -3.0 + 40.0j
    turn = (w * k - link_kp - link_kd * s - link_ki / s) / (B * s**2 + damping * s + stiffness + ki / s)
    at, z = impedances(model.robot, s)
    assert model.loop.driven.tolist() == at.tolist()
    np.testing.assert_allclose(w**2 * k - w * k * turn + s * model.drives.joint_damping, z, rtol=1e-12)


# --- Frequency responses ------------------------------------------------------------------------------------


def dense(model: LinearModel, frame: str, freq_hz: Array) -> Any:
    J = model.jacobian(frame)
    return np.array([J @ np.linalg.solve(whole(model, 2j * np.pi * f), J.T) for f in freq_hz])


@pytest.mark.parametrize("seed", SEEDS)
def test_responses_are_those_of_the_explicit_form_written_out(seed):
    model = am.linearize(robot(seed), "bent")
    found = am.frf(model, None, FREQ_HZ, frame="tip", kind="receptance", outputs=AXES, inputs=AXES)
    assert difference(found.values[1:], dense(model, "tip", FREQ_HZ[1:])) < 1e-9
    assert np.isfinite(found.values[0]).all()
    np.testing.assert_allclose(
        found.values, found.values.swapaxes(1, 2), rtol=0, atol=1e-12 * np.abs(found.values).max()
    )


@pytest.mark.parametrize("integral", [False, True])
@pytest.mark.parametrize("seed", [3, 5, 7])
def test_state_feedback_from_joint_to_joint_is_answered_from_the_explicit_form(seed, integral):
    fed = robot(seed, feedback=True)
    if not integral:
        none = [0.0] * len(fed.drives.names)
        text = fed.to_yaml()
        data = json.loads(text)
        data["control"] |= {"ki": none, "link_ki": none}
        fed = am.Robot.from_yaml(json.dumps(data))
    model = am.linearize(fed, "bent")
    assert not model.local
    assert bool(model.loop.integrating.size) == integral
    found = am.frf(model, None, FREQ_HZ, frame="tip", kind="receptance", outputs=AXES, inputs=AXES)
    expected = dense(model, "tip", FREQ_HZ[1:])
    assert difference(found.values[1:], expected) < 1e-9
    assert difference(found.values[1:], expected.swapaxes(1, 2)) > 1e-6  # not reciprocal
    assert np.isfinite(found.values[0]).all()


def test_feedback_to_the_own_joint_alone_is_a_gain_like_any_other():
    control = {"kp": 3e3, "kd": 40, "link_kp": 200, "link_kd": 3}
    plain = random_driven_robot(6, 5, control=control)
    nm, w = len(plain.drives.names), plain.drives.scale
    assert nm > 1
    feedback = {
        "position": np.hstack([np.diag(200 * w), 3e3 * np.eye(nm)]).tolist(),
        "velocity": np.hstack([np.diag(3 * w), 40 * np.eye(nm)]).tolist(),
    }
    fed = random_driven_robot(6, 5, control={"state_feedback": feedback})
    a, b = (am.linearize(r, "bent") for r in (plain, fed))
    assert b.local
    np.testing.assert_allclose(a.stiffness, b.stiffness, rtol=1e-14)
    np.testing.assert_allclose(a.damping, b.damping, rtol=1e-14)
    np.testing.assert_allclose(a.loop.impedances(), b.loop.impedances(), rtol=1e-14)
    responses = [am.frf(m, None, FREQ_HZ, frame="tip").values for m in (a, b)]
    np.testing.assert_allclose(*responses, rtol=1e-10)


@pytest.mark.parametrize(
    ("gains", "given_way"),
    [
        ({"kp": 5e3}, (1 / 3e4 + 1 / 5e3)),
        ({"kp": 5e3, "ki": 9e3}, 1 / 3e4),
        ({"kp": 5e3, "ki": 9e3, "link_ki": 2e3}, None),
    ],
)
def test_a_static_force_is_carried_by_shaft_and_control(gains, given_way):
    r = 0.2
    H = am.frf(
        driven_slide(mass=5.0, radius=r, control=gains | {"kd": 30}), [0.0], [0.0, 1.0], frame="mass", kind="receptance"
    )
    if given_way is None:
        # ki q_m + link_ki q / r = 0 and k (q/r - q_m) = r F.
        given_way = 1 / (3e4 * (1 + 2e3 / 9e3))
    # An integrator holds the motor where it is; q = r q_m + r² F / k.
    assert H.values[0, 0, 0] == pytest.approx(r**2 * given_way, rel=1e-12)


def test_many_models_and_springs_are_answered_together():
    a, b = am.linearize(robot(5), "bent"), am.linearize(robot(5), np.zeros(6))
    one = np.array([am.frf(m, None, FREQ_HZ, frame="tip", kind="receptance").values for m in (a, b)])
    np.testing.assert_array_equal(am.responses([a, b], FREQ_HZ, frame="tip"), one)
    fed = [am.linearize(robot(5, feedback=True), q) for q in ("bent", np.zeros(6))]
    springs = np.array([fed[0].spring, 1.5 * fed[0].spring])
    both = am.responses(fed[:1], FREQ_HZ, frame="tip", spring=springs)
    stiffer = fed[0].with_impedances(springs[1], fed[0].damper)
    np.testing.assert_allclose(both[1], am.responses([stiffer], FREQ_HZ, frame="tip")[0], rtol=1e-12)
    assert am.responses(fed, FREQ_HZ, frame="tip").shape == (2, len(FREQ_HZ), 3, 3)
    three = {"spring": np.tile(fed[0].spring, (3, 1)), "damper": np.tile(fed[0].damper, (3, 1))}
    with pytest.raises(am.FrfError, match="3 sets of springs for 2 models"):
        am.responses(fed, FREQ_HZ, frame="tip", **three)


# --- Wrenches -----------------------------------------------------------------------------------------------

WRENCHES = {
    "a force": [300.0, -200.0, 100.0, 0, 0, 0],
    "a moment": [0, 0, 0, 40.0, -90.0, 60.0],
    "both": [300.0, -200.0, 100.0, 40.0, -90.0, 60.0],
}


@pytest.mark.parametrize("axes", ["world", "frame"])
@pytest.mark.parametrize("name", WRENCHES)
@pytest.mark.parametrize("make", [lambda: random_robot(4, 6), lambda: robot(5)])
def test_the_stiffness_of_a_wrench_is_the_derivative_of_its_exact_torque(make, name, axes):
    some, h = make(), 1e-4
    load = {"wrench": WRENCHES[name], "frame": "tip", "wrench_axes": axes}
    model, bare = am.linearize(some, "bent", **load), am.linearize(some, "bent")
    law = Law(some, model.q, "tip", WRENCHES[name], follows=axes == "frame")
    n = model.links
    found = np.zeros((n, n))
    for j in range(n):
        # Fourth order in h: with h = 1e-4 an error of 1e-16, below the rounding of 1e-13 over h.
        torque = [
            law.rigid(model.q + k * h * np.eye(n)[j]) - Law(some, model.q).rigid(model.q + k * h * np.eye(n)[j])
            for k in (-2, -1, 1, 2)
        ]
        found[:, j] = np.array([1, -8, 8, -1]) @ torque / (12 * h)
    stiffness = (model.stiffness - bare.stiffness)[:n, :n]
    np.testing.assert_allclose(stiffness, found, rtol=0, atol=1e-7 * np.abs(found).max())
    assert np.abs(stiffness).max() > 1.0


def test_a_force_that_turns_with_its_hinge_adds_no_stiffness():
    # Across the rod, following it: the moment about the hinge stays what it is.
    rod = pendulum(50.0, mass=1.0, length=0.7, gravity=[0, 0, 0])
    follower, dead = (
        am.linearize(rod, [0.4], wrench=[9, 0, 0, 0, 0, 0], frame="tip", wrench_axes=axes)
        for axes in ("frame", "world")
    )
    assert follower.stiffness[0, 0] == pytest.approx(50.0, rel=1e-14)
    assert dead.stiffness[0, 0] == pytest.approx(50.0 + 9 * 0.7 * np.sin(0.4), rel=1e-13)
    settled = am.linearize(
        rod, [0.4], wrench=[9, 0, 0, 0, 0, 0], frame="tip", wrench_axes="frame", equilibrium="static"
    )
    assert settled.q[0] == pytest.approx(0.4 + 9 * 0.7 / 50.0, rel=1e-12)
