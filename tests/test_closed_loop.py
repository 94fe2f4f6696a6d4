"""Where closed loops come to rest, whether they stay there, and how far their gains are from not doing so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import armonic as am
from closed_loops import Law, driven_hinge, driven_slide, with_control
from models import G, random_driven_robot, robot_of
from trees import Array

TURN = 2 * np.pi
SEEDS = range(10)


# --- Static equilibrium -------------------------------------------------------------------------------------


def balance(model: am.LinearModel, law: Law) -> tuple[Array, float]:
    """What does not balance where nothing integrates, and the largest torque or force that shafts carry."""
    z, none = np.concatenate([model.q[law.keep], model.motor_position]), np.zeros(len(model.coordinates))
    left = law.residual(z, none, none)
    left[law.n + model.loop.integrating] = 0.0
    d = model.drives
    twist = d.shaft_stiffness * (model.motor_position - d.scale * model.q[d.coordinates])
    # A motor at rest puts out what its shaft takes.
    np.testing.assert_allclose(model.motor_torque, twist, rtol=1e-12, atol=1e-9 * np.abs(twist).max())
    return left, float(np.abs(np.concatenate([twist, law.rigid(model.q)])).max())


LOADS: dict[str, dict[str, Any]] = {
    "gravity alone": {},
    "a wrench": {"wrench": [200.0, -80.0, 120.0, 10.0, 20.0, -30.0], "frame": "tip"},
    "a wrench that follows": {
        "wrench": [200.0, -80.0, 120.0, 10.0, 20.0, -30.0], "frame": "tip", "wrench_axes": "frame",
    },
}  # fmt: skip


@pytest.mark.parametrize("feedforward", [True, False])
@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("seed", SEEDS)
def test_at_the_static_equilibrium_the_closed_loop_balances(seed, load, feedforward):
    robot = with_control(random_driven_robot(seed, 1 + seed % 6, feedback=seed % 2 == 0), feedforward=feedforward)
    model = am.linearize(robot, "bent", equilibrium="static", **LOADS[load])
    how = LOADS[load]
    law = Law(robot, robot.postures["bent"], how.get("frame"), how.get("wrench"), follows="wrench_axes" in how)
    left, size = balance(model, law)
    assert np.abs(left).max() < 1e-9 * size
    # An integrator at rest has nothing to integrate.
    c, d = robot.control, robot.drives
    e, e_m = d.scale * (law.q_d - model.q)[d.coordinates], law.q_md - model.motor_position
    wound = np.abs(model.motor_position).max() + np.abs(d.scale * model.q[d.coordinates]).max()
    assert (np.abs(c.ki * e_m + c.link_ki * e) <= 1e-9 * (c.ki + c.link_ki) * wound).all()
    # The model is that of the place where it rests.
    again = am.linearize(robot, model.q, **how)
    np.testing.assert_allclose(model.stiffness, again.stiffness, rtol=1e-12, atol=1e-9 * np.abs(model.stiffness).max())


@pytest.mark.parametrize("load", LOADS)
def test_with_feedforward_the_posture_is_the_equilibrium(load):
    robot = am.load("scompi").with_values({"tool.mass": 4.0})
    how = LOADS[load] | ({"frame": "tool"} if load != "gravity alone" else {})
    reference, static = (am.linearize(robot, "c8", equilibrium=e, **how) for e in ("reference", "static"))
    np.testing.assert_allclose(static.q, robot.postures["c8"], rtol=0, atol=1e-14)
    np.testing.assert_allclose(static.motor_position, reference.motor_position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(static.motor_torque, reference.motor_torque, rtol=0, atol=1e-8)


MASS, RADIUS, SHAFT = 30.0, 0.2, 3e4
WEIGHT = MASS * G * RADIUS

# Control without feed-forward, and by how much a load on a vertical slide sinks, over weight times radius.
SAGS: dict[str, tuple[dict[str, float], float]] = {
    "position gain": ({"kp": 5e3}, 1 / SHAFT + 1 / 5e3),
    "integral gain": ({"kp": 5e3, "ki": 800.0}, 1 / SHAFT),
    "integral gain alone": ({"ki": 0.01}, 1 / SHAFT),
    "link-side gain": ({"link_kp": 2e3}, 1 / 2e3),
    "link-side integral": ({"kp": 5e3, "link_ki": 300.0}, 0.0),
}


@pytest.mark.parametrize("name", SAGS)
def test_without_feedforward_a_load_sinks_by_what_shaft_and_gains_give_way(name):
    gains, share = SAGS[name]
    robot = driven_slide(
        mass=MASS, axis="z", radius=RADIUS, shaft_stiffness=SHAFT, control=gains | {"feedforward": False}
    )
    model = am.linearize(robot, [0.1], equilibrium="static")
    assert model.q[0] == pytest.approx(0.1 - RADIUS * WEIGHT * share, rel=1e-12)
    assert model.motor_torque[0] == pytest.approx(WEIGHT, rel=1e-9)
    # Linearized where it is told to be, nothing has given way yet.
    reference = am.linearize(robot, [0.1])
    assert (reference.q[0], reference.motor_position[0], reference.motor_torque[0]) == (0.1, pytest.approx(0.5), 0.0)


def test_a_load_that_nothing_holds_has_no_equilibrium():
    robot = driven_slide(mass=MASS, axis="z", control={"kd": 10, "feedforward": False})
    with pytest.raises(am.ModelError, match="no static equilibrium near it"):
        am.linearize(robot, [0.0], equilibrium="static")


# --- The verdict --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("control", "verdict"),
    [
        ({"kp": 5e3, "kd": 50}, "asymptotically stable"),
        ({"kp": 5e3}, "marginal"),  # nothing damps it
        ({"kd": 50}, "marginal"),  # nothing holds it
        ({"kp": 5e3, "ki": 5e4, "kd": 1}, "unstable"),
        ({"link_kp": 5e3, "link_kd": 50}, "unstable"),
    ],
)
def test_an_unstable_loop_is_reported_and_no_error(control, verdict):
    robot = driven_hinge(inertia=4.0, control=control)
    modes = am.modes(robot, [0.3])
    assert modes.stability == verdict
    assert len(am.frf(robot, [0.3], [5.0, 6.0], frame="rod").values) == 2
    assert am.modes(robot, [0.3], equilibrium="static").stability == verdict


def test_a_joint_that_nothing_holds_has_a_pole_at_zero_beside_integrators():
    # One joint under PID control, the other braked only.
    link = {"joint": {"type": "revolute", "axis": "z"}, "mass": 1.0, "inertia": {"xx": 1, "yy": 1, "zz": 1}}
    drive = {"gear_ratio": 100, "rotor_inertia": 1e-4, "shaft_stiffness": 3e4}
    links = [link | {"name": name, "parent": parent, "drive": drive} for name, parent in (("a", "base"), ("b", "a"))]
    robot = robot_of(links, control={"kp": [4e3, 0], "ki": [1e3, 0], "kd": [90, 90]})
    modes = am.modes(robot, [0.0, 0.0])
    assert np.count_nonzero(modes.poles == 0) == 1
    assert modes.stability == "marginal"


# --- Gain margins -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("posture", ["c1", "c8", "c50"])
def test_control_of_a_motor_by_its_own_position_and_rate_is_never_too_much(posture):
    # Passivity: whatever the factor, the motor's control only stores and dissipates.
    margins = am.gain_margins(am.load("scompi"), posture)
    assert [margin.motor for margin in margins] == list(am.load("scompi").motors)
    assert all(margin.upper == np.inf for margin in margins)
    # Gravity lies across the track and along joint 1; where it pulls a joint away, too little control lets it fall.
    assert margins[0].lower == 0.0
    assert all(margin.freq_hz == 0.0 for margin in margins if margin.lower > 0)


@pytest.mark.parametrize("seed", SEEDS)
def test_passive_control_of_random_robots_has_no_upper_margin(seed):
    nm = len(random_driven_robot(seed, 1 + seed % 6).drives.names)
    control = {"kp": [2e4] * nm, "kd": [100.0] * nm}
    robot = random_driven_robot(seed, 1 + seed % 6, control=control, gravity=[0, 0, 0])
    for margin in am.gain_margins(robot, "bent"):
        assert (margin.upper, margin.lower) == (np.inf, 0.0)
        assert np.isnan(margin.freq_hz)


@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_motor_without_gains_has_nothing_to_multiply(damping):
    # It drifts, a double pole at zero that LAPACK finds somewhere around it; that is no instability.
    (margin,) = am.gain_margins(driven_hinge(inertia=6.0, motor_damping=damping), [0.0])
    assert (margin.upper, margin.lower) == (np.inf, 0.0)
    assert np.isnan(margin.freq_hz)


def test_a_rod_that_stands_upright_falls_where_its_gain_gets_too_small():
    k, kp, weight = 3e4, 5e3, 12.0 * G * 0.7
    robot = driven_hinge(inertia=1.0, mass=12.0, com=0.7, shaft_stiffness=k, control={"kp": kp, "kd": 60})
    (margin,) = am.gain_margins(robot, [0.0])
    # Shaft and control in series carry as much as m g l: k kp / (k + kp) = m g l.
    assert margin.lower == pytest.approx(k * weight / (k - weight) / kp, rel=1e-9)
    assert (margin.upper, margin.freq_hz) == (np.inf, 0.0)


@pytest.mark.parametrize(("ki", "joint_damping"), [(1e4, 5.0), (4e4, 0.0), (3e3, 2.0)])
def test_integral_control_of_a_mass_on_a_stiff_shaft_has_the_margin_of_routh_and_hurwitz(ki, joint_damping):
    # J s³ + (D + f kd) s² + f kp s + f ki is stable while (D + f kd) kp > J ki.
    J, kp, kd, Dm = 8.0 + 2.0, 1e3, 500.0, 1.0
    robot = driven_hinge(
        inertia=8.0,
        shaft_stiffness=1e9,
        motor_damping=Dm,
        joint_damping=joint_damping,
        control={"kp": kp, "ki": ki, "kd": kd},
    )
    (margin,) = am.gain_margins(robot, [0.0])
    # The shaft gives way by a share of 1e-6.
    expected = (J * ki / kp - joint_damping - Dm) / kd
    assert margin.lower == pytest.approx(expected, rel=1e-5)
    assert margin.upper == np.inf
    assert margin.freq_hz == pytest.approx(np.sqrt(expected * kp / J) / TURN, rel=1e-4)


@pytest.mark.parametrize("kd", [0.0, 2.0, 30.0])
@pytest.mark.parametrize("kp", [50.0, 400.0])
def test_link_side_control_through_a_flexible_shaft_has_the_margin_of_routh_and_hurwitz(kp, kd):
    M, B, k, D, Dm = 6.0, 2.0, 3e4, 8.0, 3.0
    robot = driven_hinge(
        inertia=M, shaft_stiffness=k, motor_damping=Dm, joint_damping=D, control={"link_kp": kp, "link_kd": kd}
    )
    # (M s² + D s + k)(B s² + Dm s + k) - k (k - f (kp + kd s)), coefficients a4 to a0.
    a4, a3, a2 = M * B, M * Dm + D * B, (M + B) * k + D * Dm
    p, q, r = (D + Dm) * k, k * kd, k * kp
    # a3 (a2 a1 - a3 a0) > a4 a1² with a1 = p + f q, a0 = f r.
    roots = np.roots([-a4 * q**2, a3 * a2 * q - a3**2 * r - 2 * a4 * p * q, a3 * a2 * p - a4 * p**2])
    (upper,) = roots[roots > 0].real
    (margin,) = am.gain_margins(robot, [0.0])
    if upper > 1:
        assert margin.upper == pytest.approx(upper, rel=1e-9)
        assert margin.lower == 0.0
        assert margin.freq_hz == pytest.approx(np.sqrt((p + upper * q) / a3) / TURN, rel=1e-9)
    else:
        assert np.isnan([margin.upper, margin.lower, margin.freq_hz]).all()
        assert am.modes(robot, [0.0]).stability == "unstable"


def hurwitz(coefficients: Array) -> float:
    """The determinant that is zero where a pair of roots lies on the imaginary axis; highest power first."""
    a, n = coefficients, len(coefficients) - 1
    rows = [[a[2 * j - i + 1] if 0 <= 2 * j - i + 1 <= n else 0.0 for j in range(n - 1)] for i in range(n - 1)]
    return float(np.linalg.det(np.array(rows)))


@pytest.mark.parametrize(("ki", "link_kp"), [(1e4, 0.0), (2e4, 0.0), (5e3, 4e3), (1e4, 2e3)])
def test_integral_control_through_a_flexible_shaft_has_the_margins_of_the_fifth_order_polynomial(ki, link_kp):
    M, B, k, D, Dm, kp, kd = 6.0, 2.0, 3e4, 8.0, 3.0, 2e3, 90.0
    control = {"kp": kp, "ki": ki, "kd": kd, "link_kp": link_kp}
    robot = driven_hinge(inertia=M, shaft_stiffness=k, motor_damping=Dm, joint_damping=D, control=control)

    def determinant(logarithm: float) -> float:
        f = np.exp(logarithm)
        # s times (M s² + D s + k) Delta(s) - k (k - f link_kp), Delta of the motor.
        whole = np.polymul([M, D, k], [B, Dm + f * kd, k + f * kp, f * ki])
        return hurwitz(np.polyadd(whole, [k * (f * link_kp - k), 0.0]))

    def first(direction: float) -> float | None:
        steps = direction * np.linspace(0.0, np.log(1e6), 2000)
        signs = np.sign([determinant(step) for step in steps])
        change = np.flatnonzero(signs[1:] != signs[:-1])
        return (
            float(np.exp(brentq(determinant, *steps[change[0] : change[0] + 2], xtol=1e-14))) if change.size else None
        )

    (margin,) = am.gain_margins(robot, [0.0])
    lower, upper = first(-1.0), first(1.0)
    assert margin.lower == (0.0 if lower is None else pytest.approx(lower, rel=1e-8))
    assert margin.upper == (np.inf if upper is None else pytest.approx(upper, rel=1e-8))
    assert (upper is not None) == (link_kp > 0)


@pytest.mark.parametrize("seed", range(14))
def test_at_its_margin_a_random_loop_is_about_to_grow(seed):
    robot = random_driven_robot(seed, 2 + seed % 5)
    if am.modes(robot, "bent").stability == "unstable":
        assert all(
            np.isnan(m.upper) and np.isnan(m.lower) and np.isnan(m.freq_hz) for m in am.gain_margins(robot, "bent")
        )
        return
    names = ("kp", "ki", "kd", "link_kp", "link_ki", "link_kd")
    for i, margin in enumerate(am.gain_margins(robot, "bent")):
        for factor in (margin.upper, margin.lower):
            if not 0 < factor < np.inf:
                continue
            scaled = {name: getattr(robot.control, name).copy() for name in names}
            for gains in scaled.values():
                gains[i] *= factor
            poles = am.modes(with_control(robot, **{k: v.tolist() for k, v in scaled.items()}), "bent").poles
            critical = poles[np.argmax(poles.real)]
            assert abs(critical.real) < 1e-8 * np.abs(poles).max()
            if factor == margin.upper or margin.upper == np.inf:
                assert margin.freq_hz == pytest.approx(critical.imag / TURN, rel=1e-6)
