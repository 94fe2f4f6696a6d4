"""A run moves as Pinocchio and SciPy say, rests where it should, and can be stopped."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

import armonic as am
from closed_loops import driven_hinge
from models import G, slides, spring
from published import SCOMPI
from simulated import HIT, Peer, scompi, states_of
from trees import Array

STILL = np.zeros(3)
PUSH = np.array([0.0, HIT.force, 0.0])


def moved(run: am.Run) -> float:
    """The most that anything moves, rad, m, or per second."""
    states = states_of(run)
    return float(np.abs(states - states[0]).max())


@pytest.mark.parametrize("case", [0, 1])
def test_scompi_under_a_hit_moves_as_an_independent_integration_says(case: int) -> None:
    run = am.simulate(scompi(case), "c8", HIT, duration_s=2.0)
    peer = Peer(scompi(case), "c8")
    expected = peer.run(run.series.time_s, [(0.0, 0.2, STILL), (0.2, 0.206, PUSH), (0.206, 2.0, STILL)])
    off = np.abs(states_of(run) - expected)
    # The peer integrates coordinates of up to 2 rad to 1e-11, and the fastest pole is at 5350 rad/s; the motion has
    # 0.3 mrad and 0.06 rad/s. Asked for was 1e-6.
    assert off[:, :12].max() < 5e-11
    assert off[:, 12:].max() < 2e-8
    assert np.abs(expected[:, :12] - expected[0, :12]).max() > 3e-4


def test_every_torque_and_acceleration_of_a_run_is_that_of_its_state() -> None:
    run = am.simulate(scompi(), "c8", HIT, duration_s=0.4)
    peer, d, series = Peer(scompi(), "c8"), scompi().drives, run.series
    q, q_m, _, v_m = np.split(states_of(run), 4, axis=1)
    acting = np.outer((series.time_s > 0.2 - 1e-9) & (series.time_s < 0.206 - 1e-9), PUSH)
    np.testing.assert_array_equal(run["force"], acting[:, 1])
    expected = np.array([peer.rates(y, force) for y, force in zip(states_of(run), acting, strict=True)])
    # Torques of 100 N m that cancel to 1e-14 of them act on the inertia of 1e-3 kg m² of link 6.
    acceleration = series.select("joint_acceleration").values
    np.testing.assert_allclose(acceleration, expected[:, 12:18], rtol=1e-9, atol=1e-8)
    shaft, motor = series.select("shaft_torque").values, series.select("motor_torque").values
    twist = d.shaft_stiffness * (d.scale * q - q_m)  # rounding of 2 rad, times 1.2e5 N m/rad
    np.testing.assert_allclose(shaft, twist, rtol=0, atol=1e-9)
    law = peer.feedforward + 15_000 * (peer.motors - q_m) - 52 * v_m
    np.testing.assert_allclose(motor, law, rtol=0, atol=1e-9)


def test_motion_of_a_frame_is_that_of_pinocchio() -> None:
    run = am.simulate(scompi(), "c8", HIT, duration_s=0.5)
    q, _, v, _ = np.split(states_of(run), 4, axis=1)
    velocity, acceleration = Peer(scompi(), "c8").frame_motion(q, v, run.series.select("joint_acceleration").values)
    # Do et al. 2022, Eq. A.4; sums of a few terms in double precision.
    np.testing.assert_allclose(run.series.select("velocity").values, velocity, rtol=0, atol=1e-15)
    np.testing.assert_allclose(run.series.select("acceleration").values, acceleration, rtol=0, atol=1e-12)


def test_velocity_and_acceleration_of_a_frame_are_derivatives_of_its_displacement() -> None:
    rate = 20_000.0
    hit = am.HammerPulse(axis="y0", force=50.0, duration_s=0.006, start_s=0.0)
    series = am.simulate(scompi(), "c8", hit, duration_s=0.1, sample_rate_hz=rate).series.window(0.01)
    x, v, a = (series.select(kind).values for kind in ("displacement", "velocity", "acceleration"))
    # Central differences of order six: what is left, h⁶ f⁽⁷⁾/140, is 1e-7 of the fastest mode's share; rounding of
    # displacements of 1e-17 m, times the squared rate, is 1e-8 m/s².
    first = np.array([-1, 9, -45, 0, 45, -9, 1]) * rate / 60
    second = np.array([2, -27, 270, -490, 270, -27, 2]) * rate**2 / 180
    for values, weights, expected in ((x, first, v), (v, first, a), (x, second, a)):
        found = sum(w * values[i : len(values) - 6 + i] for i, w in enumerate(weights))
        assert np.abs(found - expected[3:-3]).max() < 1e-5 * np.abs(expected).max()


def test_motors_start_where_the_paper_prints_them() -> None:
    # Eq. 22 is that of case 2: without its 4 kg, the fifth would print as -1.9448.
    run = am.simulate(scompi(1), "c8", duration_s=0.01)
    start = run.series.select("motor_position").values[0]
    half_a_digit = np.array([0.5, 5.0, 0.5, 0.5, 0.5, 0.5]) * 1e-4  # the second is printed as -0.374
    assert (np.abs(start - SCOMPI.printed_motor_position) <= half_a_digit).all()


@pytest.mark.parametrize("case", [0, 1])
def test_a_robot_at_rest_stays_at_rest(case: int) -> None:
    assert moved(am.simulate(scompi(case), "c8", duration_s=2.0)) < 1e-12


@pytest.mark.parametrize("axes", ["world", "frame"])
def test_a_constant_wrench_that_the_feed_forward_knows_moves_nothing(axes: am.linear.WrenchAxes) -> None:
    wrench = [100.0, 50.0, -300.0, 1.0, 2.0, 3.0]
    run = am.simulate(scompi(), "c8", duration_s=1.0, wrench=wrench, frame="tool", wrench_axes=axes)
    assert moved(run) < 1e-12  # torques cancel to 1e-13 N m, on 1e-3 kg m²
    kuka = am.load("kuka_kr90")
    run = am.simulate(kuka, "milling", duration_s=0.2, wrench=wrench, frame="sensor", wrench_axes=axes)
    assert moved(run) < 1e-12


def test_springs_start_at_their_static_equilibrium_if_asked() -> None:
    run = am.simulate(am.load("kuka_kr90"), "milling", duration_s=0.5, equilibrium="static")
    assert moved(run) < 1e-13
    hangs = slides([2.0], [spring(1e4, 5.0)], axis="z", gravity=[0, 0, -G])
    run = am.simulate(hangs, [0.0], duration_s=0.1, equilibrium="static")
    np.testing.assert_allclose(run["joint_position"], -2 * G / 1e4, rtol=1e-12)


def hinge(**control: float | bool) -> am.Robot:
    """20 kg at 0.4 m, 0.7 rad from upright, under a weak control."""
    gains = {"kp": 8000.0, "kd": 300.0} | control
    return driven_hinge(inertia=1.0, mass=20.0, com=0.4, control=gains, joint_damping=5, motor_damping=1)


def sagged(turn: float) -> float:
    """Torque of gravity about the hinge, N m."""
    return 20 * G * 0.4 * np.sin(turn)


def test_a_drive_without_feed_forward_sags_to_its_static_equilibrium() -> None:
    robot = hinge(feedforward=False)
    run = am.simulate(robot, [0.7], duration_s=4.0, sample_rate_hz=200.0)
    q, q_m = states_of(run)[-1, :2]
    # Shaft and control in series carry gravity (Do et al. 2022, Eqs. 2 and 4 at rest).
    assert 3e4 * (q - q_m) == pytest.approx(sagged(q), rel=1e-9)
    assert 8000 * (q_m - 0.7) == pytest.approx(sagged(q), rel=1e-9)
    rest = am.simulate(robot, [0.7], duration_s=0.5, equilibrium="static")
    assert moved(rest) < 1e-11
    np.testing.assert_allclose(states_of(rest)[0, :2], [q, q_m], rtol=0, atol=1e-11)


def test_integral_gains_bring_the_motor_back() -> None:
    robot = hinge(feedforward=False, ki=16_000.0)
    slowest = -am.modes(robot, [0.7]).poles.real.max()
    run = am.simulate(robot, [0.7], duration_s=25 / slowest, sample_rate_hz=20.0)
    q, q_m, v, v_m = states_of(run)[-1]
    assert np.abs(states_of(run)[:, 1] - 0.7).max() > 1e-3
    assert q_m == pytest.approx(0.7, abs=1e-10)  # exp(-25) of the first sag
    assert 3e4 * (q - q_m) == pytest.approx(sagged(q), rel=1e-6)
    assert max(abs(v), abs(v_m)) < 1e-10
    assert moved(am.simulate(robot, [0.7], duration_s=0.5, equilibrium="static")) < 1e-11


def test_samples_between_steps_are_as_good_as_steps() -> None:
    mass, stiffness = 2.0, 5e4
    speed = np.sqrt(stiffness / mass)
    for tolerance in (1e-6, 1e-8, 1e-10):
        run = am.simulate(
            slides([mass], [spring(stiffness)]),
            [0.0],
            displacement={"mass_0.tx": 1e-3},
            duration_s=0.5,
            sample_rate_hz=3000.0,
            tolerance=tolerance,
        )
        assert run.steps < len(run.series) / 3  # steps last several samples
        off = run["joint_position"] - 1e-3 * np.cos(speed * run.series.time_s)
        # A hundred steps or more, each good to a tenth of the tolerance, may add up.
        assert np.abs(off).max() < 3 * tolerance * 1e-3


@pytest.mark.parametrize("rate", [90.0, 750.0, 4000.0])
def test_samples_do_not_depend_on_their_rate(rate: float) -> None:
    fine = am.simulate(scompi(), "c8", HIT, duration_s=0.4, sample_rate_hz=36_000.0)
    run = am.simulate(scompi(), "c8", HIT, duration_s=0.4, sample_rate_hz=rate)
    off = np.abs(states_of(run) - states_of(fine)[:: round(36_000 / rate)])
    assert off[:, :12].max() < 1e-12  # 4e-4 rad, to ten times the tolerance of 1e-10, and rounding of 2 rad
    assert off[:, 12:].max() < 1e-9


class CtrlC:
    """Sends the signal of Ctrl-C a moment after a run has begun."""

    def __init__(self) -> None:
        self.thread: threading.Thread | None = None

    def __call__(self, time_s: float) -> None:
        if self.thread is None:
            self.thread = threading.Thread(target=self.send, daemon=True)
            self.thread.start()

    def send(self) -> None:
        time.sleep(0.1)
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_ctrl_c_ends_a_run_with_what_was_computed(method: am.simulation.running.Method) -> None:
    run = am.simulate(scompi(), "c8", HIT, duration_s=3000.0, sample_rate_hz=100.0, method=method, progress=CtrlC())
    assert run.status == "interrupted"
    assert 1 <= len(run.series) < 300_001
    whole = am.simulate(scompi(), "c8", HIT, duration_s=0.5, sample_rate_hz=100.0)
    both = min(len(whole.series), len(run.series))
    np.testing.assert_allclose(states_of(run)[:both], states_of(whole)[:both], rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_progress_hears_the_time_and_what_it_raises_ends_the_run(method: am.simulation.running.Method) -> None:
    heard: list[float] = []

    def stop(time_s: float) -> None:
        heard.append(time_s)
        if len(heard) == 3:
            raise KeyboardInterrupt

    run = am.simulate(scompi(), "c8", HIT, duration_s=1000.0, sample_rate_hz=100.0, method=method, progress=stop)
    assert run.status == "interrupted"
    assert heard == sorted(heard)
    assert abs(run.series.time_s[-1] - heard[-1]) < 0.02

    def refuse(time_s: float) -> None:
        raise LookupError

    with pytest.raises(LookupError):
        am.simulate(scompi(), "c8", HIT, duration_s=1000.0, sample_rate_hz=100.0, method=method, progress=refuse)


def test_a_run_says_what_it_was_and_knows_its_channels() -> None:
    run = am.simulate(scompi(), "c8", HIT, duration_s=0.3)
    assert "Scompi, posture c8: 301 samples at 1000 Hz" in repr(run)
    assert run.steps > run.rejected >= 0
    assert run.evaluations > 12 * run.steps
    assert run.seconds > 0
    time_s: Array = run.series.time_s
    assert time_s[-1] == pytest.approx(0.3, abs=1e-15)
    units = {channel.quantity: channel.unit for channel in run.series.select("*.tz", "*motor", "tool.x0").channels}
    assert units["joint_position"] == "m"
    assert units["motor_torque"] == "N m"
    assert units["acceleration"] == "m/s²"
