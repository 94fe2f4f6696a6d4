"""Control by a computer: a discrete loop written out with matrix exponentials says what it does, late and in steps."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from scipy.linalg import expm

import armonic as am
from closed_loops import driven_hinge, driven_slide
from models import G, oscillator
from simulated import HIT, scompi, states_of
from trees import Array

QUARTERS = 4  # samples per period of the control
GEAR = 100.0


def slide(**control: float) -> am.Robot:
    """A mass behind a rack, a shaft and a motor; nothing pulls at it."""
    gains = {"kp": 15_000.0, "kd": 60.0} | control
    return driven_slide(mass=20.0, radius=0.1, joint_damping=30.0, motor_damping=0.5, control=gains)


START = {"mass.tx": 2e-3, "mass.motor": 0.01}


class Loop:
    """The slide and its computer: ẋ = A x + b τ with x = [q, q_m, q̇, q̇_m], and a queue of torques."""

    def __init__(self, robot: am.Robot, rate_hz: float) -> None:
        d, self.control, self.period = robot.drives, robot.control, 1 / rate_hz
        mass, w, k = 20.0, 10.0, 3e4
        inertia = GEAR**2 * 2e-4  # behind the gear
        A = np.zeros((5, 5))
        A[:2, 2:4] = np.eye(2)
        A[2, :4] = np.array([-w * w * k, w * k, -30.0, 0.0]) / mass
        A[3, :4] = np.array([w * k, -k, 0.0, -0.5]) / inertia
        A[3, 4] = 1 / inertia
        self.stride = expm(A * self.period / QUARTERS)
        assert d.inertia[0] == pytest.approx(inertia, rel=1e-15)

    def run(self, samples: int, late: int, *, difference: bool, step: float) -> tuple[Array, Array]:
        """Deviations (samples, 4) and torques (samples,) every quarter of a period; torques act late by quarters."""
        c, x = self.control, np.array([2e-3, 0.01, 0.0, 0.0])
        states, torques = [], []
        waiting: list[tuple[int, float]] = []
        held = total = 0.0
        seen: Array | None = None
        for quarter in range(samples):
            if quarter % QUARTERS == 0:
                z = x[:2].copy()
                if step:
                    z[1] = round(z[1] / step) * step
                v = x[2:] if not difference else np.zeros(2) if seen is None else (z - seen) / self.period
                total += self.period * (c.ki[0] * z[1] + 10.0 * c.link_ki[0] * z[0])
                torque = -c.kp[0] * z[1] - c.kd[0] * v[1] - 10.0 * (c.link_kp[0] * z[0] + c.link_kd[0] * v[0]) - total
                waiting.append((quarter + late, torque))
                seen = z
            while waiting and waiting[0][0] <= quarter:
                held = waiting.pop(0)[1]
            states.append(x)
            torques.append(held)
            x = (self.stride @ np.append(x, held))[:4]
        return np.array(states), np.array(torques)


GAINS = [{}, {"ki": 60_000.0}, {"link_kp": 800.0, "link_kd": 5.0, "link_ki": 3000.0}]


@pytest.mark.parametrize("late", [0, 1, 4, 7])
@pytest.mark.parametrize("gains", GAINS, ids=["pd", "pid", "link"])
@pytest.mark.parametrize("velocity", ["difference", "measured"])
def test_a_late_computer_does_what_a_discrete_loop_does(
    late: int, gains: dict[str, float], velocity: Literal["difference", "measured"]
) -> None:
    rate, robot = 1000.0, slide(**gains)
    control = am.SampledControl(rate_hz=rate, delay_s=late / (QUARTERS * rate), velocity=velocity)
    run = am.simulate(robot, [0.0], control=control, displacement=START, duration_s=0.3, sample_rate_hz=QUARTERS * rate)
    states, torques = Loop(robot, rate).run(len(run.series), late, difference=velocity == "difference", step=0.0)
    # 300 pieces, each integrated to a relative 1e-11.
    np.testing.assert_allclose(states_of(run)[:, :2], states[:, :2], rtol=0, atol=1e-11)
    np.testing.assert_allclose(run["motor_torque"][:-1], torques[:-1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("velocity", ["difference", "measured"])
def test_encoders_see_steps(velocity: Literal["difference", "measured"]) -> None:
    rate, bits, robot = 1000.0, 10, slide()
    control = am.SampledControl(rate_hz=rate, velocity=velocity, encoder_bits=bits)
    assert control.encoder_step == 2 * math.pi / 2**bits
    step = control.encoder_step / GEAR  # the encoder sits on the rotor
    run = am.simulate(robot, [0.0], control=control, displacement=START, duration_s=0.1, sample_rate_hz=QUARTERS * rate)
    states, torques = Loop(robot, rate).run(len(run.series), 0, difference=velocity == "difference", step=step)
    np.testing.assert_allclose(states_of(run)[:, :2], states[:, :2], rtol=0, atol=1e-10)
    if velocity == "difference":
        # Position and its differences in steps: torques are whole multiples of what these are worth.
        worth = math.gcd(15_000, 60 * 1000) * step
        counts = run["motor_torque"] / worth
        np.testing.assert_allclose(counts, np.rint(counts), rtol=0, atol=1e-6)
        assert np.abs(torques).max() > 100 * worth


def test_steps_of_an_encoder_lie_where_the_motor_turns_and_not_about_the_posture() -> None:
    # Held between two steps, the motor is told to move by up to half of one.
    step = 2 * math.pi / 2**4 / GEAR
    robot = driven_hinge(inertia=1.0, control={"kp": 8000.0, "kd": 300.0})
    control = am.SampledControl(rate_hz=1000.0, encoder_bits=4)
    run = am.simulate(robot, [10.3 * step], control=control, duration_s=0.01)
    assert run["motor_torque"][0] == pytest.approx(8000 * 0.3 * step, rel=1e-9)


def test_a_faster_computer_tends_to_continuous_control_in_proportion_to_its_period() -> None:
    exact = states_of(am.simulate(scompi(), "c8", HIT, duration_s=0.5))
    rates = [2000.0, 4000.0, 8000.0]
    off = []
    for rate in rates:
        run = am.simulate(scompi(), "c8", HIT, duration_s=0.5, control=am.SampledControl(rate_hz=rate), tolerance=1e-8)
        off.append(np.abs(states_of(run)[:, :12] - exact[:, :12]).max() / np.ptp(exact[:, :12], axis=0).max())
    slope = np.polyfit(np.log(rates), np.log(off), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.1)
    assert off[-1] < 0.02


def test_a_robot_at_rest_stays_at_rest_under_a_computer() -> None:
    run = am.simulate(scompi(), "c8", duration_s=0.2, control=am.SampledControl(rate_hz=1000.0, delay_s=0.002))
    assert np.abs(states_of(run) - states_of(run)[0]).max() < 1e-12


def test_energy_balance_closes_under_a_computer() -> None:
    run = am.simulate(scompi(), "c8", HIT, duration_s=0.5, control=am.SampledControl(rate_hz=2000.0), tolerance=1e-8)
    assert np.abs(run.energy_error()).max() < 1e-8 * run["energy:work of forces"][-1]


def test_samples_that_miss_the_instants_of_control_see_the_torque_held() -> None:
    control = am.SampledControl(rate_hz=300.0)
    options = {"displacement": START, "duration_s": 0.1, "control": control}
    fine = am.simulate(slide(), [0.0], sample_rate_hz=21_000.0, **options)
    odd = am.simulate(slide(), [0.0], sample_rate_hz=700.0, **options)
    np.testing.assert_allclose(odd["motor_torque"], fine["motor_torque"][::30], rtol=0, atol=1e-6)
    np.testing.assert_allclose(states_of(odd)[:, :2], states_of(fine)[::30, :2], rtol=0, atol=1e-12)


def test_a_long_delay_makes_the_loop_unstable_and_the_error_keeps_the_run() -> None:
    robot = slide()
    control = am.SampledControl(rate_hz=1000.0, delay_s=0.02)
    states, _ = Loop(robot, 1000.0).run(4 * 1000, 80, difference=True, step=0.0)
    first = np.flatnonzero(np.abs(states[:, :2]).max(axis=1) > 1e3)[0] / 4000
    with pytest.raises(am.SimulationError, match=r"mass\.(tx|motor) beyond all bounds at [\d.]+ s.*unstable") as caught:
        am.simulate(robot, [0.0], control=control, displacement=START, duration_s=30.0)
    run = caught.value.run
    assert run is not None
    assert run.series.time_s[-1] == pytest.approx(first, abs=0.002)
    assert run.series.finite().any()
    np.testing.assert_allclose(states_of(run)[:300, :2], states[:1200:4, :2], rtol=1e-7, atol=1e-11)


def test_a_computer_needs_motors_and_explicit_steps() -> None:
    control = am.SampledControl(rate_hz=1000.0)
    with pytest.raises(am.SimulationError, match="control: found a robot without motors"):
        am.simulate(oscillator(1.0, 100.0), [0.0], control=control, duration_s=0.1)
    with pytest.raises(am.SimulationError, match='method: found "implicit" with sampled control'):
        am.simulate(slide(), [0.0], control=control, duration_s=0.1, method="implicit")
    with pytest.raises(am.SimulationError, match=r"SampledControl\.rate_hz: found 1e\+09 Hz for 0\.1 s"):
        am.simulate(slide(), [0.0], control=am.SampledControl(rate_hz=1e9), duration_s=0.1)
    with pytest.raises(am.SimulationError, match="control: found 1000"):
        am.simulate(slide(), [0.0], control=1000, duration_s=0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"rate_hz": 0.0}, "rate_hz: found 0.0"),
        ({"rate_hz": math.nan}, "rate_hz: found nan"),
        ({"rate_hz": "fast"}, "rate_hz: found 'fast'"),
        ({"rate_hz": 1e3, "delay_s": -1e-3}, "delay_s: found -0.001"),
        ({"rate_hz": 1e3, "velocity": "guessed"}, "velocity: found 'guessed'"),
        ({"rate_hz": 1e3, "encoder_bits": 0}, "encoder_bits: found 0"),
        ({"rate_hz": 1e3, "encoder_bits": 12.5}, "encoder_bits: found 12.5"),
    ],
)
def test_odd_computers_are_refused(options: dict[str, float], found: str) -> None:
    with pytest.raises(am.SimulationError, match=f"SampledControl.{found}"):
        am.SampledControl(**options)  # type: ignore[arg-type]


def test_gravity_is_held_by_feed_forward_until_the_first_torque_acts() -> None:
    robot = driven_hinge(inertia=1.0, mass=20.0, com=0.4, control={"kp": 8000.0, "kd": 300.0})
    run = am.simulate(robot, [0.7], duration_s=0.1, control=am.SampledControl(rate_hz=500.0, delay_s=0.05))
    np.testing.assert_allclose(run["motor_torque"], -20 * G * 0.4 * math.sin(0.7), rtol=1e-9)


SAGGING = "control: {kp: 15000, kd: 52, ki: 3000, feedforward: false}"


def test_a_static_start_is_at_rest_under_a_computer_too() -> None:
    late = am.SampledControl(rate_hz=1000, delay_s=0.002, velocity="measured")
    text = am.load("scompi").to_yaml().replace("control: {kp: 15000, kd: 52}", SAGGING)
    sagging = am.Robot.from_yaml(text)
    run = am.simulate(sagging, "c8", duration_s=0.1, equilibrium="static", control=late)
    assert np.ptp(run.series.select("joint_position").values, axis=0).max() < 1e-9
