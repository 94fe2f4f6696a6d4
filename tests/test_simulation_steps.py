"""Steps of the integration: they keep their tolerance, converge with it, and are implicit where that pays."""

from __future__ import annotations

import numpy as np
import pytest

import armonic as am
from closed_loops import driven_hinge
from models import slides, spring
from simulated import HIT, reference, scompi, states_of

MASS, STIFFNESS = 2.0, 5e4
SPEED = np.sqrt(STIFFNESS / MASS)


def free_vibration(tolerance: float) -> tuple[am.Run, float]:
    """Twenty periods of one mass on a spring, and how far it is off in the end, over its amplitude."""
    run = am.simulate(
        slides([MASS], [spring(STIFFNESS)]),
        [0.0],
        displacement={"mass_0.tx": 1e-3},
        duration_s=40 * np.pi / SPEED,
        sample_rate_hz=20.0,
        tolerance=tolerance,
    )
    off = run["joint_position"] - 1e-3 * np.cos(SPEED * run.series.time_s)
    return run, float(np.abs(off).max() / 1e-3)


def test_the_error_falls_with_the_tolerance() -> None:
    tolerances = [10.0**-k for k in range(4, 12)]
    errors = [free_vibration(tolerance)[1] for tolerance in tolerances]
    # Proportional to it, as the estimate of the steps' error is controlled.
    for tolerance, error in zip(tolerances, errors, strict=True):
        assert error < 3 * tolerance
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.8 < slope < 1.3


def test_steps_are_of_order_eight() -> None:
    tolerances = [1e-5, 1e-7, 1e-9, 1e-11]
    runs = [free_vibration(tolerance) for tolerance in tolerances]
    work, errors = np.log([run.steps for run, _ in runs]), np.log([error for _, error in runs])
    order = -np.polyfit(work, errors, 1)[0]
    assert 7 < order < 9.5


def test_scompi_converges_with_the_tolerance() -> None:
    def states(tolerance: float) -> np.ndarray:
        return states_of(am.simulate(scompi(), "c8", HIT, duration_s=1.0, tolerance=tolerance))

    best = states(1e-12)
    amplitude = np.repeat(np.abs(best - best[0]).reshape(len(best), 4, 6).max(axis=(0, 2)), 6)  # by kind
    off = [float((np.abs(states(tolerance) - best) / amplitude).max()) for tolerance in (1e-4, 1e-6, 1e-8)]
    # A damped mode at 851 Hz limits steps that could be longer: a slack tolerance is kept by far. It is also why the
    # errors fall by a factor of 13 only for one of 100.
    assert off[0] < 2e-6
    assert off[1] < 2e-7
    assert off[2] < 2e-8
    assert off[0] > 5 * off[1] > 25 * off[2]


@pytest.mark.parametrize("push", [HIT, am.Sine(axis="z", force=20.0, freq_hz=31.0, start_s=0.05)], ids=["hit", "sine"])
def test_implicit_and_explicit_steps_agree(push: am.Excitation) -> None:
    explicit, implicit = (
        am.simulate(scompi(), "c8", push, duration_s=0.25, method=method, tolerance=tolerance)
        for method, tolerance in (("explicit", 1e-11), ("implicit", 1e-8))
    )
    assert (explicit.method, implicit.method) == ("explicit", "implicit")
    assert implicit.series.labels == explicit.series.labels
    off = np.abs(implicit.series.values - explicit.series.values)
    size = np.abs(explicit.series.values - explicit.series.values[0]).max(axis=0)
    quantities = [channel.quantity for channel in explicit.series.channels]
    for quantity in ("joint_position", "motor_position", "joint_velocity", "shaft_torque", "force"):
        columns = [i for i, name in enumerate(quantities) if name == quantity]
        assert off[:, columns].max() <= 3e-7 * size[columns].max(), quantity  # 1e-8 a step, for some hundred steps


def stiff_hinge(rotor_inertia: float, motor_damping: float) -> am.Robot:
    control = {"kp": 8000.0, "kd": 300.0}
    motor = {"rotor_inertia": rotor_inertia, "motor_damping": motor_damping}
    return driven_hinge(inertia=1.0, mass=20.0, com=0.4, control=control, joint_damping=5.0, **motor)


def test_implicit_steps_are_taken_where_a_motor_has_next_to_no_inertia() -> None:
    # The slow motion of a motor without inertia: its torques balance at every instant.
    robot = stiff_hinge(1e-10, 100.0)
    fastest = np.abs(am.modes(robot, [0.7]).poles).max()
    assert fastest > 1e8
    run = am.simulate(robot, [0.7], velocity={"rod.y": 0.1}, duration_s=0.3, sample_rate_hz=100.0, tolerance=1e-8)
    assert run.method == "implicit"
    # An explicit step lasts six times as long as the fastest motion at best, of twelve evaluations.
    assert run.evaluations < 1e-3 * 12 * 0.3 * fastest / 6
    gravity, inertia = 20 * 9.81 * 0.4, 1.0 + 20 * 0.4**2
    held = gravity * np.sin(0.7)

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        turn, motor, speed = y  # deviations from the posture
        twist = 3e4 * (turn - motor) + held
        acceleration = (gravity * np.sin(0.7 + turn) - twist - 5.0 * speed) / inertia
        return np.array([speed, (twist - held - 8000 * motor) / 400.0, acceleration])

    expected = reference(rates, np.array([0.0, 0.0, 0.1]), run.series.time_s)
    q, q_m = run["joint_position"] - 0.7, run["motor_position"] - run["motor_position"][0]
    # Neglecting the inertia changes the slow motion by B/(D_m² / k), 1e-7 of it or so.
    np.testing.assert_allclose(q, expected[:, 0], rtol=0, atol=1e-6 * np.abs(expected[:, 0]).max())
    np.testing.assert_allclose(q_m, expected[:, 1], rtol=0, atol=1e-6 * np.abs(expected[:, 1]).max())


@pytest.mark.parametrize("robot", ["scompi", "kuka_kr90", "huynh_3r"])
def test_robots_of_the_catalog_take_explicit_steps(robot: str) -> None:
    posture = "c8" if robot == "scompi" else "milling"
    assert am.simulate(am.load(robot), posture, duration_s=0.01).method == "explicit"
