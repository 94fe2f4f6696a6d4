"""The linear response is that of closed forms and of the full simulation at small forces, without an error of steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import expm

import armonic as am
from closed_loops import driven_hinge
from models import oscillator, random_driven_robot
from simulated import scompi
from trees import Array

MASS, STIFFNESS, DAMPING = 2.0, 5e4, 60.0
NATURAL, RATIO = np.sqrt(STIFFNESS / MASS), DAMPING / (2 * np.sqrt(STIFFNESS * MASS))
DAMPED = NATURAL * np.sqrt(1 - RATIO**2)
AT = {"axis": "x", "frame": "mass_0"}


def step_response(time_s: Array) -> Array:
    """Displacement under a unit force from zero on, m."""
    t = np.maximum(time_s, 0.0)
    turn = np.cos(DAMPED * t) + RATIO * NATURAL / DAMPED * np.sin(DAMPED * t)
    return np.asarray((1 - np.exp(-RATIO * NATURAL * t) * turn) / STIFFNESS)


def sine_response(time_s: Array, speed: float) -> Array:
    """Under sin(speed t) from zero on: the steady motion, and a free decay that starts both at rest."""
    t = np.maximum(time_s, 0.0)
    pole = -RATIO * NATURAL + 1j * DAMPED
    steady = 1 / (STIFFNESS - MASS * speed**2 + 1j * speed * DAMPING)
    x0, v0 = steady.imag, speed * steady.real
    # Re(c e^{λt}) with Re c = -x0 and Re(λ c) = -v0.
    c = -x0 + 1j * (v0 + RATIO * NATURAL * x0) / DAMPED
    return np.asarray((steady * np.exp(1j * speed * t)).imag + (c * np.exp(pole * t)).real)


def closed_forms() -> list[tuple[am.Excitation, object]]:
    hammer = np.pi / 0.0123
    return [
        (am.Step(force=9.0, start_s=0.1, **AT), lambda t: 9 * step_response(t - 0.1)),
        (
            am.Impulse(force=50.0, duration_s=0.0063, start_s=0.1, **AT),
            lambda t: 50 * (step_response(t - 0.1) - step_response(t - 0.1063)),
        ),
        (
            am.HammerPulse(force=80.0, duration_s=0.0123, start_s=0.1, **AT),
            # A second sine from the end on cancels the first.
            lambda t: 80 * (sine_response(t - 0.1, hammer) + sine_response(t - 0.1123, hammer)),
        ),
        (am.Sine(force=5.0, freq_hz=21.3, start_s=0.1, **AT), lambda t: 5 * sine_response(t - 0.1, 2 * np.pi * 21.3)),
    ]


@pytest.mark.parametrize(("push", "expected"), closed_forms(), ids=lambda part: getattr(part, "name", ""))
def test_one_mass_responds_in_closed_form(push: am.Excitation, expected) -> None:
    robot = oscillator(MASS, STIFFNESS, DAMPING)
    linear = am.linear_response(robot, [0.0], push, duration_s=0.6)
    full = am.simulate(robot, [0.0], push, duration_s=0.6)
    x = expected(linear.time_s)
    size = np.abs(x).max()
    assert size > 0
    np.testing.assert_allclose(linear["joint_position"], x, rtol=0, atol=1e-12 * size)  # rounding of 600 products
    np.testing.assert_allclose(full["joint_position"], x, rtol=0, atol=1e-9 * size)  # ten times the tolerance


def test_a_free_decay_has_the_natural_frequency_and_damping_of_its_mode() -> None:
    robot = oscillator(MASS, STIFFNESS, DAMPING)
    start = {"displacement": {"mass_0.tx": 1e-3}, "velocity": {"mass_0.tx": 0.2}}
    pole = -RATIO * NATURAL + 1j * DAMPED
    for series, allowed in (
        (am.linear_response(robot, [0.0], duration_s=0.5, **start), 1e-12),
        (am.simulate(robot, [0.0], duration_s=0.5, **start).series, 1e-9),
    ):
        t = series.time_s
        c = 1e-3 - 1j * (0.2 + RATIO * NATURAL * 1e-3) / DAMPED
        np.testing.assert_allclose(series["joint_position"], (c * np.exp(pole * t)).real, rtol=0, atol=allowed * 2e-3)
        np.testing.assert_allclose(series["joint_velocity"], (pole * c * np.exp(pole * t)).real, rtol=0, atol=allowed)
        found = (pole**2 * c * np.exp(pole * t)).real
        np.testing.assert_allclose(series["joint_acceleration"], found, rtol=0, atol=allowed * 300)


PUSHES = [
    am.Impulse(axis="y0", force=1e-3, duration_s=0.0063),
    am.HammerPulse(axis="z", force=1e-3, duration_s=0.003),
    am.Step(axis="x", force=1e-3),
    am.Sine(axis="rx0", force=1e-3, freq_hz=13.3, start_s=0.1, stop_s=0.5),
    am.Sweep(axis="y", force=1e-3, from_hz=2.0, to_hz=60.0),
    am.Sweep(axis="y", force=1e-3, from_hz=60.0, to_hz=2.0, logarithmic=True),
    am.BandNoise(axis="y", rms=1e-3, low_hz=5.0, high_hz=80.0),
]


def strongest(series: am.TimeSeries, quantity: str) -> Array:
    values = series.select(quantity).values
    return np.asarray(values - values[0])


@pytest.mark.parametrize("push", PUSHES, ids=lambda push: push.name)
def test_small_forces_move_scompi_as_its_linear_model_says(push: am.Excitation) -> None:
    full, linear = (run(scompi(), "c8", push, duration_s=0.7) for run in (am.simulate, am.linear_response))
    quantities = ("joint_position", "motor_position", "joint_velocity", "displacement", "velocity", "acceleration")
    # Motion of 1e-8 rad bends what is linear by as much; positions of 2 rad are rounded to 2e-16 rad. A sweep is taken
    # as straight lines, off by 5e-4 of it at the most.
    allowed = 5e-4 if isinstance(push, am.Sweep) else 2e-6
    for quantity in quantities:
        expected = strongest(full.series, quantity)
        off = np.abs(strongest(linear, quantity) - expected).max()
        assert off < allowed * np.abs(expected).max(), quantity


def test_a_hit_and_what_follows_it_is_a_product_of_matrix_exponentials() -> None:
    model = am.linearize(scompi(), "c8")
    linear = am.linear_response(scompi(), "c8", am.Impulse(axis="y0", force=50.0, duration_s=0.006), duration_s=1.0)
    row = scompi().mechanism.jacobian(model.q, scompi().frame_index("tool"))[1]
    inverse, z = np.linalg.inv(model.mass), np.zeros((12, 12))
    A = np.block([[z, np.eye(12)], [-inverse @ model.stiffness, -inverse @ model.damping]])
    b = np.concatenate([np.zeros(12), inverse @ np.concatenate([50.0 * row, np.zeros(6)])])
    after = np.linalg.solve(A, (expm(A * 0.006) - np.eye(24)) @ b)
    for sample in (206, 250, 600, 1000):
        x = expm(A * (sample - 206) * 1e-3) @ after
        for quantity, part in (("joint_position", x[:6]), ("motor_position", x[6:12])):
            found = strongest(linear, quantity)[sample]
            np.testing.assert_allclose(found, part, rtol=0, atol=1e-15 + 1e-9 * np.abs(part).max())


def test_noise_through_scompi_is_what_scipy_makes_of_it() -> None:
    noise = am.BandNoise(axis="y0", rms=1.0, low_hz=5.0, high_hz=50.0)  # a value every millisecond
    linear = am.linear_response(scompi(), "c8", noise, duration_s=1.0)
    system = am.linearize(scompi(), "c8").state_space(frame="tool", inputs=("y",), motors=True)
    model = am.linearize(scompi(), "c8")
    row = scompi().mechanism.jacobian(model.q, scompi().frame_index("tool"))[1]
    B = np.concatenate([np.zeros(12), np.linalg.solve(model.mass, np.concatenate([row, np.zeros(6)]))])[:, None]
    C = np.eye(24)[6:12]
    values = np.array(noise.waveform(1.0)[2])[:1001]
    _, expected, _ = signal.lsim((np.array(system.A), B, C, np.zeros((6, 1))), values, linear.time_s)
    found = strongest(linear, "motor_position")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 + 1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("seed", [1, 3])
def test_every_kind_of_gain_and_a_wrench_are_in_the_linear_response(seed: int) -> None:
    robot = random_driven_robot(seed, 4)
    start = dict.fromkeys(robot.coordinates, 1e-07)
    options = {
        "displacement": start,
        "velocity": {robot.coordinates[0]: 1e-6},
        "wrench": [20.0, -30.0, 10.0, 1.0, 2.0, -1.0],
        "frame": "tip",
        "wrench_axes": "frame",
        "duration_s": 0.2,
    }
    full, linear = (run(robot, "bent", **options) for run in (am.simulate, am.linear_response))
    for quantity in ("joint_position", "motor_position", "joint_velocity"):
        expected = strongest(full.series, quantity)
        assert np.abs(strongest(linear, quantity) - expected).max() < 1e-5 * np.abs(expected).max()


def test_about_a_static_equilibrium_both_start_in_the_same_place() -> None:
    hinge = driven_hinge(
        inertia=1.0, mass=20.0, com=0.4, control={"kp": 8000.0, "kd": 300.0, "feedforward": False}, joint_damping=5.0
    )
    options = {"velocity": {"rod.y": 1e-6}, "duration_s": 0.3, "equilibrium": "static"}
    full, linear = (run(hinge, [0.7], **options) for run in (am.simulate, am.linear_response))
    for quantity in ("joint_position", "motor_position"):
        assert linear[quantity][0] == pytest.approx(full[quantity][0], rel=1e-12)
        expected = strongest(full.series, quantity)
        assert np.abs(strongest(linear, quantity) - expected).max() < 1e-5 * np.abs(expected).max()


def test_noise_of_many_pieces_gives_the_variance_of_random_vibration() -> None:
    noise = am.BandNoise(axis="x", frame="mass_0", rms=1.0, low_hz=5.0, high_hz=50.0)
    linear = am.linear_response(oscillator(MASS, STIFFNESS, DAMPING), [0.0], noise, duration_s=20.0)
    # ∫ S |H|² df = π S f / (4 ζ k²) of a lightly damped mode, S the one-sided power density of the force.
    power = 1.0 / 45.0  # N²/Hz
    expected = np.pi * power * NATURAL / (2 * np.pi) / (4 * RATIO * STIFFNESS**2)
    # A width of 7.5 Hz in 20 s: 150 lines, whose mean power deviates by 8 %. Three of that.
    assert np.var(linear["joint_position"]) == pytest.approx(expected, rel=0.25)
    assert linear.notes["model"] == "linear"
