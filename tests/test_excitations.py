"""Excitations have the course of their formulas, act along what they name, and last as long as they must."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import armonic as am
from models import oscillator, rows_of
from simulated import scompi
from trees import Array

T = np.arange(1001) / 1000.0


def force(push: am.Excitation, *, duration_s: float = 1.0, sample_rate_hz: float = 1000.0) -> Array:
    """What a run says of the force, N, (samples,)."""
    mass = oscillator(50.0, 1e5, 500.0)
    found: Array = am.simulate(mass, [0.0], push, duration_s=duration_s, sample_rate_hz=sample_rate_hz)["force"]
    linear = am.linear_response(mass, [0.0], push, duration_s=duration_s, sample_rate_hz=sample_rate_hz)["force"]
    if not isinstance(push, am.Sweep):  # which the linear response takes as straight lines
        np.testing.assert_allclose(linear, found, rtol=0, atol=1e-9 * np.abs(found).max())
    return found


AT = {"axis": "x", "frame": "mass_0"}


def between(start: float, end: float) -> Array:
    """One where a force acts: a sample sees what holds right after it."""
    return ((start - 1e-9 < T) & (end - 1e-9 > T)).astype(float)


@pytest.mark.parametrize(
    ("push", "expected"),
    [
        (am.Impulse(force=50.0, duration_s=0.006, **AT), 50.0 * between(0.2, 0.206)),
        (am.Impulse(force=-3.0, duration_s=0.0107, start_s=0.0, **AT), -3.0 * between(0.0, 0.0107)),
        (
            am.HammerPulse(force=80.0, duration_s=0.0125, start_s=0.1, **AT),
            80.0 * between(0.1, 0.1125) * np.sin(np.pi * (T - 0.1) / 0.0125),
        ),
        (am.Step(force=7.0, **AT), 7.0 * between(0.2, np.inf)),
        (am.Sine(force=5.0, freq_hz=13.3, **AT), 5.0 * np.sin(2 * np.pi * 13.3 * T)),
        (
            am.Sine(force=5.0, freq_hz=13.3, phase_rad=0.7, start_s=0.1, stop_s=0.6, **AT),
            5.0 * between(0.1, 0.6) * np.sin(2 * np.pi * 13.3 * (T - 0.1) + 0.7),
        ),
        (am.Sine(force=5.0, freq_hz=0.0, phase_rad=np.pi / 2, **AT), np.full(1001, 5.0)),
        (
            am.Sweep(force=2.0, from_hz=3.0, to_hz=40.0, **AT),
            2.0 * signal.chirp(T, 3.0, 1.0, 40.0, phi=-90),
        ),
        (
            am.Sweep(force=2.0, from_hz=40.0, to_hz=3.0, logarithmic=True, **AT),
            2.0 * signal.chirp(T, 40.0, 1.0, 3.0, method="logarithmic", phi=-90),
        ),
        (
            am.Sweep(force=2.0, from_hz=3.0, to_hz=40.0, start_s=0.25, stop_s=0.75, **AT),
            2.0 * between(0.25, 0.75) * signal.chirp(T - 0.25, 3.0, 0.5, 40.0, phi=-90),
        ),
    ],
    ids=lambda push: getattr(push, "name", None),
)
def test_a_force_has_the_course_of_its_formula(push: am.Excitation, expected: Array) -> None:
    # The last sample sees the force as it is just before. Phases of 250 rad at most are known to 1e-13.
    np.testing.assert_allclose(force(push)[:-1], expected[:-1], rtol=0, atol=1e-11)
    assert push.unit == "N"


@pytest.mark.parametrize("logarithmic", [False, True])
def test_the_frequency_of_a_sweep_runs_from_one_end_to_the_other(logarithmic: bool) -> None:
    sweep = am.Sweep(force=1.0, from_hz=20.0, to_hz=80.0, logarithmic=logarithmic, **AT)
    values = force(sweep, duration_s=2.0, sample_rate_hz=20_000.0)
    phase = np.unwrap(np.angle(signal.hilbert(values)))
    freq_hz = np.gradient(phase) * 20_000 / (2 * np.pi)
    time_s = np.arange(len(values)) / 20_000
    expected = 20 * 4 ** (time_s / 2) if logarithmic else 20 + 30 * time_s
    middle = slice(8000, -8000)  # a Hilbert transform knows the ends badly
    np.testing.assert_allclose(freq_hz[middle], expected[middle], rtol=0.01)


def test_noise_has_its_power_in_its_band_and_nowhere_else() -> None:
    noise = am.BandNoise(rms=3.0, low_hz=10.0, high_hz=40.0, **AT)
    kind, (start, step), values = noise.waveform(30.0)
    assert (kind, start) == ("samples", 0.0)
    assert start + (len(values) - 1) * step >= 30.0
    assert np.sqrt(np.mean(np.square(values))) == pytest.approx(3.0, rel=1e-12)
    lines, power = signal.periodogram(values, 1 / step, detrend=False)
    inside = (lines >= 10.0) & (lines <= 40.0)
    assert power[~inside].max() < 1e-25 * power.max()
    # Gaussian, so that the power of a line is exponential: mean and deviation are alike, over 900 lines.
    assert power[inside].std() / power[inside].mean() == pytest.approx(1.0, abs=0.15)
    low, high = power[inside & (lines < 25)].mean(), power[inside & (lines > 25)].mean()
    assert low / high == pytest.approx(1.0, abs=0.3)  # four deviations of a mean of 450 lines, twice
    # Straight lines lose sinc²(f step) of it at most, 0.8 %, and sampling nothing.
    assert np.sqrt(np.mean(force(noise, duration_s=30.0, sample_rate_hz=200.0) ** 2)) == pytest.approx(3.0, rel=0.01)


def test_the_same_seed_is_the_same_noise_and_another_is_another() -> None:
    first, again, other = (
        np.array(am.BandNoise(rms=1.0, low_hz=5.0, high_hz=50.0, seed=seed, **AT).waveform(4.0)[2])
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.25  # of 180 lines


def test_noise_that_starts_late_is_silent_before() -> None:
    found = force(am.BandNoise(rms=1.0, low_hz=5.0, high_hz=50.0, start_s=0.5, **AT))
    assert not found[:500].any()
    assert found[501:].all()
    assert not force(am.BandNoise(rms=1.0, low_hz=5.0, high_hz=50.0, start_s=2.0, **AT)).any()
    assert not force(am.Sweep(force=1.0, from_hz=5.0, to_hz=50.0, start_s=2.0, **AT)).any()


def test_a_measured_force_is_joined_by_straight_lines() -> None:
    values = np.random.default_rng(3).normal(size=101)
    measured = am.MeasuredForce(values=values, sample_rate_hz=100.0, **AT)
    np.testing.assert_allclose(force(measured)[:-1], np.interp(T, np.arange(101) / 100, values)[:-1], atol=1e-12)
    late = am.MeasuredForce(values=values[:51], sample_rate_hz=100.0, start_s=0.3, ends_early=True, **AT)
    expected = np.interp(T - 0.3, np.arange(51) / 100, values[:51]) * between(0.3, 0.8)
    np.testing.assert_allclose(force(late), expected, rtol=0, atol=1e-12)


def test_a_force_that_ends_too_early_is_refused_unless_it_may() -> None:
    short = am.MeasuredForce(values=np.ones(50), sample_rate_hz=100.0, **AT)
    with pytest.raises(am.SimulationError, match=r"MeasuredForce: found a force that ends at 0\.49 s, .* run of 1 s"):
        force(short)
    assert force(am.MeasuredForce(values=np.ones(50), sample_rate_hz=100.0, ends_early=True, **AT)).sum() == 490


def test_the_force_of_one_run_excites_the_next() -> None:
    push = am.HammerPulse(axis="z", force=30.0, duration_s=0.02)
    run = am.simulate(scompi(), "c8", push, duration_s=0.5, sample_rate_hz=20_000.0)
    measured = am.MeasuredForce.of(run.series.select("force"), axis="z", frame="tool")
    again = am.simulate(scompi(), "c8", measured, duration_s=0.5)
    off = again.series.select("motor_position").values - run.series.select("motor_position").values[::20]
    size = np.ptp(run.series.select("motor_position").values, axis=0).max()
    assert np.abs(off).max() < 1e-5 * size  # straight lines of a 400th of the pulse: (π/400)²/8 of its peak


@pytest.mark.parametrize("axis", ["x", "y", "z", "rx", "ry", "rz"])
@pytest.mark.parametrize("world", [False, True])
def test_a_force_pushes_along_the_axis_it_names(axis: str, world: bool) -> None:
    push = am.Impulse(axis=axis + "0" * world, frame="tool", force=2.0, duration_s=0.001, start_s=0.0)
    run = am.simulate(scompi(), "c8", push, duration_s=0.001)
    model = am.linearize(scompi(), "c8")
    rows = model.robot.mechanism.jacobian(model.q, model.robot.frame_index("tool"))[
        ["x", "y", "z", "rx", "ry", "rz"].index(axis)
    ]
    expected = np.linalg.solve(model.mass[:6, :6], 2.0 * (rows if world else rows_of(model, "tool", (axis,))[0]))
    found = run.series.select("joint_acceleration").values[0]  # at rest all but the push cancels, to 1e-14 of 100 N m
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-8)
    assert push.unit == ("N m" if axis.startswith("r") else "N")


def test_several_forces_add_up_and_keep_their_names() -> None:
    hit = am.Impulse(axis="y0", force=1.0, duration_s=0.01, start_s=0.0)
    both = am.simulate(scompi(), "c8", [hit, hit, am.Step(axis="x", frame="link_4", force=3.0)], duration_s=0.3)
    assert [c.name for c in both.series.select("force").channels] == ["tool.y0", "tool.y0 2", "link_4.x"]
    twice = am.Impulse(axis="y0", force=2.0, duration_s=0.01, start_s=0.0)
    one = am.simulate(scompi(), "c8", [twice, am.Step(axis="x", frame="link_4", force=3.0)], duration_s=0.3)
    found, expected = (run.series.select("motor_position").values for run in (both, one))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


def test_a_measured_force_is_taken_in_its_unit() -> None:
    channels = (am.Channel("tool.z", "force", "kN"), am.Channel("tool.z", "displacement", "mm"))
    series = am.TimeSeries(np.ones((50, 2)), 100.0, channels)
    force = am.MeasuredForce.of(series, "force", axis="z")
    assert force.samples == pytest.approx(np.full(50, 1000.0))
    for axis, channel in (("rx", "force"), ("z", "displacement")):
        with pytest.raises(am.SimulationError, match="or a multiple of it"):
            am.MeasuredForce.of(series, channel, axis=axis)
