"""Joints that are not linear move as closed forms say: hardening springs, free play and dry friction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

import armonic as am
from closed_loops import driven_hinge, driven_slide
from models import G, oscillator, slides, spring
from simulated import scompi, states_of

MASS, STIFFNESS = 2.0, 5e4
SPEED = np.sqrt(STIFFNESS / MASS)
X = "mass_0.tx"


@pytest.mark.parametrize("cubic", [2e10, 5e8, -1e10])
@pytest.mark.parametrize("amplitude", [1e-4, 1e-3, 2e-3])
def test_a_hardening_spring_swings_as_a_duffing_oscillator(cubic: float, amplitude: float) -> None:
    run = am.simulate(
        oscillator(MASS, STIFFNESS),
        [0.0],
        joints=am.Hardening(joint="mass_0", cubic=cubic),
        displacement={X: amplitude},
        duration_s=0.5,
    )
    # m ẍ + k x + c x³ = 0 from rest at A: x = A cn(Ω t | p), Ω² = (k + c A²)/m, p = c A² / 2(k + c A²).
    hard = cubic * amplitude**2
    rate, parameter = np.sqrt((STIFFNESS + hard) / MASS), hard / (2 * (STIFFNESS + hard))
    if parameter >= 0:
        expected = amplitude * ellipj(rate * run.series.time_s, parameter)[1]
    else:  # cn(u | p) = cd(u √(1-p) | -p/(1-p))
        _, cn, dn, _ = ellipj(rate * np.sqrt(1 - parameter) * run.series.time_s, -parameter / (1 - parameter))
        expected = amplitude * cn / dn
    period = 4 * ellipk(parameter) / rate
    assert (period < 2 * np.pi / SPEED) == (cubic > 0)
    np.testing.assert_allclose(run["joint_position"], expected, rtol=0, atol=1e-8 * amplitude)  # over 12 periods
    torque = STIFFNESS * expected + cubic * expected**3
    np.testing.assert_allclose(run["shaft_torque"], torque, rtol=0, atol=1e-7 * np.abs(torque).max())


def free_play(time_s: np.ndarray, gap: float, speed: float) -> np.ndarray:
    """From the middle of a gap at some speed: straight lines, and half periods on the stops."""
    crossing, half = gap / speed, np.pi / SPEED
    period = 2 * (crossing + half)
    phase = (time_s + crossing / 2) % period
    turned = phase >= crossing + half
    phase = np.where(turned, phase - crossing - half, phase)
    in_gap = phase < crossing
    x = np.where(in_gap, -gap / 2 + speed * phase, gap / 2 + speed / SPEED * np.sin(SPEED * (phase - crossing)))
    return np.where(turned, -x, x)


def test_a_joint_with_backlash_flies_freely_between_its_stops() -> None:
    gap, speed = 2e-3, 0.1
    run = am.simulate(
        oscillator(MASS, STIFFNESS),
        [0.0],
        joints=am.Backlash(joint="mass_0", gap=gap),
        velocity={X: speed},
        duration_s=0.5,
    )
    expected = free_play(run.series.time_s, gap, speed)
    x, torque = run["joint_position"], run["shaft_torque"]
    # Steps that cross a corner of the spring are found by their error, which a corner spoils.
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    inside = np.abs(x) <= gap / 2
    assert inside.mean() == pytest.approx(0.5, abs=0.01)  # 2 · 20 ms of 79.7 ms
    assert not torque[inside].any()
    np.testing.assert_allclose(torque, STIFFNESS * np.sign(x) * np.maximum(np.abs(x) - gap / 2, 0), atol=1e-8)


def test_a_shaft_with_backlash_rests_on_the_stop_that_carries_gravity() -> None:
    gap = 4e-3
    robot = driven_hinge(inertia=1.0, mass=20.0, com=0.4, control={"kp": 8000.0, "kd": 300.0}, joint_damping=5.0)
    plain, loose = (
        am.simulate(robot, [0.7], duration_s=0.5, joints=joints) for joints in ((), am.Backlash(joint="rod", gap=gap))
    )
    assert np.abs(states_of(loose) - states_of(loose)[0]).max() < 1e-12
    np.testing.assert_allclose(loose["shaft_torque"], 20 * G * 0.4 * np.sin(0.7), rtol=1e-9)
    # The link stays where it is told; the motor stands half the gap further.
    np.testing.assert_allclose(loose["motor_position"] - plain["motor_position"], -gap / 2, rtol=1e-9)


def test_a_spring_with_backlash_hangs_by_its_stop_at_the_static_equilibrium() -> None:
    hangs = slides([MASS], [spring(STIFFNESS, 20.0)], axis="z", gravity=[0, 0, -G])
    law = am.Backlash(joint="mass_0", gap=1e-3)
    run = am.simulate(hangs, [0.0], joints=law, duration_s=0.2, equilibrium="static")
    np.testing.assert_allclose(run["joint_position"], -MASS * G / STIFFNESS - 0.5e-3, rtol=1e-8)
    np.testing.assert_allclose(run["shaft_torque"], -MASS * G, rtol=1e-6)


def test_a_hardening_spring_and_shaft_carry_gravity_where_they_are_told() -> None:
    cubic = 3e11
    hangs = slides([MASS], [spring(STIFFNESS, 20.0)], axis="z", gravity=[0, 0, -G])
    law = am.Hardening(joint="mass_0", cubic=cubic)
    run = am.simulate(hangs, [0.0], joints=law, duration_s=0.1, equilibrium="static")
    sag = brentq(lambda x: STIFFNESS * x + cubic * x**3 - MASS * G, 0, 1e-3, xtol=1e-18)
    np.testing.assert_allclose(run["joint_position"], -sag, rtol=1e-9)
    shaft = am.simulate(
        driven_slide(mass=20.0, axis="z", radius=0.1, control={"kp": 1e4, "kd": 50.0}),
        [0.0],
        joints=am.Hardening(joint="mass", cubic=cubic),
        duration_s=0.1,
    )
    assert np.abs(states_of(shaft) - states_of(shaft)[0]).max() < 1e-12
    twist = 10.0 * shaft["joint_position"] - shaft["motor_position"]
    np.testing.assert_allclose(3e4 * twist + cubic * twist**3, -20 * G * 0.1, rtol=1e-9)  # N m behind a radius of 0.1 m
    hinge = driven_hinge(inertia=1.0, mass=20.0, com=0.4, control={"kp": 8000.0, "kd": 300.0})
    run = am.simulate(hinge, [0.7], joints=am.Hardening(joint="rod", cubic=cubic), duration_s=0.1)
    twist = run["joint_position"] - run["motor_position"]
    np.testing.assert_allclose(3e4 * twist + cubic * twist**3, 20 * G * 0.4 * np.sin(0.7), rtol=1e-9)
    assert np.abs(states_of(run) - states_of(run)[0]).max() < 1e-11  # rounding of 50 N m on 2 kg m²


def test_dry_friction_takes_the_same_amplitude_from_every_cycle() -> None:
    friction, start = 5.0, 5e-3
    run = am.simulate(
        oscillator(MASS, STIFFNESS),
        [0.0],
        joints=am.Coulomb(joint="mass_0", torque=friction, speed=1e-5),
        displacement={X: start},
        duration_s=0.3,
        sample_rate_hz=20_000.0,
        tolerance=1e-9,
    )
    x = run["joint_position"]
    tops = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] > x[2:])) + 1
    assert len(tops) == 7
    # The corner at v = 0 is rounded over 1e-5 m/s of 0.8 m/s; a peak of samples misses the top by 1e-5 of it.
    np.testing.assert_allclose(x[tops], start - 4 * friction / STIFFNESS * np.arange(1, 8), rtol=0, atol=1e-4 * start)
    np.testing.assert_allclose(np.diff(tops) / 20_000, 2 * np.pi / SPEED, rtol=0, atol=1e-4)


@pytest.mark.parametrize("share", [0.3, 0.95])
def test_dry_friction_holds_what_is_weaker_but_for_a_creep_that_is_bounded(share: float) -> None:
    friction, speed = 8.0, 1e-4
    run = am.simulate(
        oscillator(MASS, STIFFNESS),
        [0.0],
        am.Step(axis="x", frame="mass_0", force=share * friction, start_s=0.0),
        joints=am.Coulomb(joint="mass_0", torque=friction, speed=speed),
        duration_s=0.5,
    )
    # c tanh(v/v₀) = F - k x - m a: it never moves faster than where friction alone takes F.
    assert 0 < run["joint_velocity"].max() <= speed * np.arctanh(share)
    assert run["joint_position"][-1] < speed * np.arctanh(share) * 0.5


def test_dry_friction_acts_on_the_side_it_names() -> None:
    push = am.Sine(axis="y0", force=50.0, freq_hz=7.0)
    runs = {
        at: am.simulate(scompi(), "c8", push, joints=am.Coulomb(joint="link_1", torque=30.0, at=at), duration_s=0.5)
        for at in ("joint", "motor")
    }
    d = scompi().drives
    for at, run in runs.items():
        speeds = run["joint_velocity:link_1.tz" if at == "joint" else "motor_velocity:link_1.motor"]
        viscous = d.joint_damping @ run.series.select("joint_velocity").values.T ** 2
        viscous = viscous + d.motor_damping @ run.series.select("motor_velocity").values.T ** 2
        power = viscous + 30.0 * speeds * np.tanh(speeds / 1e-3)
        dissipated = np.gradient(run["energy:dissipated"], 1e-3)
        # Differences over 2 ms of a power that follows 50 Hz: (2π 50 · 1 ms)²/6 of it.
        assert np.abs(dissipated - power)[2:-2].max() < 0.03 * power.max()
        assert np.abs(run.energy_error()).max() < 1e-7 * np.abs(run["energy:work of forces"]).max()
    assert np.abs(states_of(runs["joint"]) - states_of(runs["motor"])).max() > 1e-6


def test_laws_of_different_kinds_share_a_joint_and_patterns_name_several() -> None:
    laws = [
        am.Backlash(joint="mass_*", gap=1e-3),
        am.Hardening(joint="*.tx", cubic=1e9),
        am.Coulomb(joint="mass_1", torque=1.0),
    ]
    row = slides([1.0, 1.0], [spring(1e4), spring(2e4)])
    run = am.simulate(row, [0.0, 0.0], joints=laws, velocity={"mass_1.tx": 1.0}, duration_s=0.2)
    for name, stiffness in (("mass_0.tx", 1e4), ("mass_1.tx", 2e4)):
        x = run[f"joint_position:{name}"]
        stretch = x - np.clip(x, -0.5e-3, 0.5e-3)
        np.testing.assert_allclose(run[f"shaft_torque:{name}"], stretch * (stiffness + 1e9 * stretch**2), rtol=1e-12)
    assert run["energy:dissipated"][-1] > 0


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (lambda: am.Backlash(joint="rod", gap=-1e-3), r"Backlash\.gap: found -0\.001, expected .* at least 0"),
        (lambda: am.Hardening(joint="rod", cubic=np.nan), r"Hardening\.cubic: found nan"),
        (lambda: am.Coulomb(joint="rod", torque=-1.0), r"Coulomb\.torque: found -1\.0"),
        (lambda: am.Coulomb(joint="rod", torque=1.0, speed=0.0), r"Coulomb\.speed: found 0\.0, expected .* above 0"),
        (lambda: am.Coulomb(joint="rod", torque=1.0, at="gear"), r"Coulomb\.at: found 'gear'"),
    ],
)
def test_odd_laws_are_refused(law, says: str) -> None:
    with pytest.raises(am.SimulationError, match=says):
        law()


@pytest.mark.parametrize(
    ("laws", "says"),
    [
        (am.Backlash(joint="mass_9", gap=1e-3), r"Backlash\.joint: found 'mass_9', expected one of mass_0\.tx"),
        (
            [am.Backlash(joint="mass_0", gap=1e-3), am.Backlash(joint="*", gap=1e-3)],
            r"Backlash \*: found mass_0\.tx twice",
        ),
        (am.Coulomb(joint="mass_0", torque=1.0, at="motor"), r"Coulomb: found mass_0\.tx, which no motor drives"),
        ("backlash", r"joints: found 'b', expected Hardening, Backlash or Coulomb"),
        (3, r"joints: found 3, expected Hardening, Backlash or Coulomb"),
    ],
)
def test_laws_that_do_not_fit_the_robot_are_refused(laws, says: str) -> None:
    with pytest.raises(am.SimulationError, match=says):
        am.simulate(oscillator(MASS, STIFFNESS), [0.0], joints=laws, duration_s=0.1)
