"""A virtual tap test: records hold the robot's responses, hits scatter as told, and what goes wrong is there."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import special, stats

import armonic as am
from armonic.frf_set import FrfSet
from armonic.simulation.hammer import SCATTER_MOST, Hammer, draw_blows
from armonic.simulation.tap_test import TapTest, tap_test
from models import Complex, slides, spring
from simulated import scompi
from trees import Array

CLEAN: dict[str, Any] = {"noise": 0.0, "force_noise_n": 0.0, "bits": None, "tilt_rad": 0.0, "offset_m": 0.0}
"""Nothing that blurs a response."""
SMALL = {**CLEAN, "force_n": 0.2, "hits": 1, "record_s": 24.0}
"""Hits so weak that the robot is as good as linear, and records in which the slowest mode decays to e⁻¹⁶."""
FOLDED = 1e-4
"""Of the largest response: the filter lets 3e-5 of a pulse of 10 ms fold down into the lowest 60 Hz."""
MASS, STIFFNESS, DAMPING = 20.0, 8e4, 25.0


@cache
def kuka() -> am.Robot:
    return am.load("kuka_kr90")


@cache
def small_taps() -> TapTest:
    return tap_test(kuka(), "milling", **SMALL)


def ratios(test: TapTest, up_to_hz: float) -> tuple[Array, Complex]:
    """Spectra of the responses over those of the force, the simplest FRFs: lines and values (L, sensors, points)."""
    record = test.records[0]
    freq_hz = np.fft.rfftfreq(len(record), 1 / record.sample_rate_hz)
    kept = (freq_hz > 0) & (freq_hz <= up_to_hz)
    spectra = [np.fft.rfft(record.values, axis=0)[kept] for record in test.records]
    return freq_hz[kept], np.stack([s[:, 1:] / s[:, :1] for s in spectra], axis=2)


def coherence_and_h1(test: TapTest, up_to_hz: float) -> tuple[Array, Array, Complex]:
    """Lines, coherence and H1 of all hits on each point (Bendat and Piersol 2010, Eqs. 6.30 and 6.33)."""
    record = test.records[0]
    freq_hz = np.fft.rfftfreq(len(record), 1 / record.sample_rate_hz)
    kept = (freq_hz > 0) & (freq_hz <= up_to_hz)
    columns = []
    for point in test.points:
        spectra = np.array([np.fft.rfft(r.values, axis=0)[kept] for r in test.records if r.channels[0].name == point])
        force, motion = spectra[..., :1], spectra[..., 1:]
        cross, auto = (force.conj() * motion).sum(axis=0), (np.abs(force) ** 2).sum(axis=0)
        columns.append((np.abs(cross) ** 2 / auto / (np.abs(motion) ** 2).sum(axis=0), cross / auto))
    coherence, h1 = (np.stack(part, axis=2) for part in zip(*columns, strict=True))
    return freq_hz[kept], np.asarray(coherence.real), h1


def cart(damping: float = DAMPING) -> am.Robot:
    """One mass on a slide and a spring, at 10.07 Hz."""
    return slides([MASS], [spring(STIFFNESS, damping)])


def test_records_of_a_linear_robot_hold_its_responses() -> None:
    freq_hz, found = ratios(small_taps(), 60.0)
    expected = am.frf(kuka(), "milling", freq_hz, frame="sensor").values
    peak = np.abs(expected).max(axis=0)
    assert (np.abs(found - expected).max(axis=0) < FOLDED * peak).all()


def test_records_of_one_mass_on_a_spring_hold_the_textbook_accelerance() -> None:
    cart_taps = tap_test(cart(40.0), [0.0], points="mass_0.x", sensors="mass_0.x", **SMALL)
    freq_hz, found = ratios(cart_taps, 60.0)
    s = 2j * np.pi * freq_hz
    expected = s**2 / (MASS * s**2 + 40.0 * s + STIFFNESS)
    assert np.abs(found[:, 0, 0] - expected).max() < FOLDED * np.abs(expected).max()
    truth = cart_taps.frf(freq_hz)
    np.testing.assert_allclose(truth.values[:, 0, 0], expected, rtol=1e-10)
    assert (truth.outputs, truth.inputs, truth.kind) == (("mass_0.x",), ("mass_0.x",), "accelerance")


def test_what_is_hit_here_and_watched_there_is_the_same_the_other_way_round() -> None:
    places = ["sensor.z", "link_arm.y"], ["arm.x", "sensor.x", "link_arm.z"]
    there, back = (
        tap_test(kuka(), "milling", points=hit, sensors=seen, **SMALL) for hit, seen in (places, places[::-1])
    )
    freq_hz, found = ratios(there, 40.0)
    reverse = ratios(back, 40.0)[1].transpose(0, 2, 1)
    peak = np.abs(found).max(axis=0)
    assert (np.abs(found - reverse).max(axis=0) < FOLDED * peak).all()
    truth = there.frf(freq_hz)
    assert (truth.outputs, truth.inputs) == (("arm.x", "sensor.x", "link_arm.z"), ("sensor.z", "link_arm.y"))
    assert (np.abs(found - truth.values).max(axis=0) < FOLDED * peak).all()


def test_the_true_responses_are_those_of_the_model_in_any_order_and_kind() -> None:
    mixed = tap_test(
        kuka(), "milling", points=["sensor.z", "arm.y", "sensor.x"], sensors=["arm.z", "sensor.y"], hits=1, record_s=0.5
    )
    freq_hz = np.array([5.0, 11.0, 19.0])
    found = mixed.frf(freq_hz, "receptance")
    assert isinstance(found, FrfSet)
    for i, output in enumerate(mixed.sensors):
        for j, into in enumerate(mixed.points):
            (seen, axis), (hit, along) = (label.split(".") for label in (output, into))
            one = am.frf(
                kuka(), "milling", freq_hz, frame=seen, outputs=axis, inputs=along, input_frame=hit, kind="receptance"
            )
            np.testing.assert_allclose(found.values[:, i, j], one.values[:, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(mixed.modes.poles, am.modes(kuka(), "milling").poles, rtol=1e-12)
    assert mixed.geometry.names == ("sensor", "arm")
    # The arm lies in the plane of the base's x and z, 1.35 m up a link that leans by 70 deg from 0.35 m out.
    arm = [0.35 + 1.35 * math.cos(math.radians(70)), 0.0, 1.35 * math.sin(math.radians(70))]
    np.testing.assert_allclose(mixed.geometry.positions[1], arm, atol=1e-12)


def test_several_hits_in_one_record_are_as_good_as_one() -> None:
    together = tap_test(
        cart(40.0), [0.0], points="mass_0.x", sensors="mass_0.x", **{**SMALL, "hits": 3}, one_record_per_hit=False
    )
    (record,), (blows,) = together.records, together.blows
    assert len(record) == 3 * 24 * 512
    starts = [blow.start_s for blow in blows]
    assert np.diff(starts).min() > 0.95 * 24
    freq_hz, found = ratios(together, 60.0)
    s = 2j * np.pi * freq_hz
    expected = s**2 / (MASS * s**2 + 40.0 * s + STIFFNESS)
    # Between teeth of the comb of three pulses little force is left to divide by.
    strong = np.abs(np.fft.rfft(record["force:mass_0.x"]))[1 : len(freq_hz) + 1]
    strong_enough = strong > 0.5 * strong.max()
    assert np.abs(found[:, 0, 0] - expected)[strong_enough].max() < 2 * FOLDED * np.abs(expected).max()


def test_the_force_that_is_recorded_has_the_impulse_of_every_contact() -> None:
    taps = tap_test(
        kuka(), "milling", points=["sensor.x"], hits=4, double_hits=2, record_s=2.0, **{**CLEAN, "bits": 24}
    )
    assert sorted(blow.sort for (blow,) in taps.blows) == ["double", "double", "single", "single"]
    for record, (blow,) in zip(taps.records, taps.blows, strict=True):
        impulse = 2 / np.pi * blow.pulse_s * (blow.peak_n + blow.rebound_n)  # of half sines
        found = record["force"].sum() / record.sample_rate_hz
        # The sum of samples is off by what folds down to 0 Hz; steps of the converter are 5e-5 N.
        assert found == pytest.approx(impulse, rel=FOLDED)
        after = record.window(blow.start_s + 2.5 * blow.pulse_s)["force"].max()
        assert (after > 0.1 * blow.peak_n) == (blow.sort == "double")


def test_hits_scatter_as_asked() -> None:
    count = 4000
    hammer = Hammer(300.0, 0.2, 0.006, 0.1, 0.03, 0.004)
    blows = draw_blows("sensor.y", ["single"] * count, hammer, np.zeros(count), 600.0, 5)
    # A normal variable whose tails are laid on ±c has this variance.
    c = SCATTER_MOST
    inside = stats.norm.cdf(c) - stats.norm.cdf(-c)
    kept = math.sqrt(inside - 2 * c * stats.norm.pdf(c) + c**2 * (1 - inside))
    angles = np.arctan([(b.direction[0] / b.direction[1], b.direction[2] / b.direction[1]) for b in blows])
    offsets = np.array([b.offset_m for b in blows])
    assert not offsets[:, 1].any()
    np.testing.assert_allclose(np.linalg.norm([b.direction for b in blows], axis=1), 1.0, rtol=1e-14)
    for values, centre, spread in (
        (np.log([b.peak_n for b in blows]), math.log(300.0), 0.2),
        (np.log([b.pulse_s for b in blows]), math.log(0.006), 0.1),
        (angles[:, 0], 0.0, 0.03),
        (angles[:, 1], 0.0, 0.03),
        (offsets[:, 0], 0.0, 0.004),
        (offsets[:, 2], 0.0, 0.004),
    ):
        # Four standard deviations of a mean and of a standard deviation of so many.
        assert abs(values.mean() - centre) < 4 * spread / math.sqrt(count)
        assert values.std() == pytest.approx(kept * spread, rel=4 / math.sqrt(2 * count))


def test_a_tilted_hammer_beside_its_place_gives_what_its_parts_and_moments_give() -> None:
    taps = tap_test(
        kuka(), "milling", points="sensor.y", sensors=["sensor.x", "sensor.z"],
        **{**SMALL, "tilt_rad": 0.1, "offset_m": 0.05},
    )  # fmt: skip
    ((blow,),) = taps.blows
    freq_hz, found = ratios(taps, 40.0)
    axes = ("x", "y", "z", "rx", "ry", "rz")
    every = am.frf(kuka(), "milling", freq_hz, frame="sensor", outputs=("x", "z"), inputs=axes).values
    (dx, dy, dz), (x, y, z) = blow.direction, blow.offset_m
    wrench = np.array([dx, dy, dz, y * dz - z * dy, z * dx - x * dz, x * dy - y * dx])
    expected = every @ wrench
    assert min(abs(dx), abs(dz), abs(x), abs(z)) > 1e-3
    assert (np.abs(found[:, :, 0] - expected).max(axis=0) < FOLDED * np.abs(expected).max(axis=0)).all()


def test_the_same_seed_gives_the_same_records_whatever_else_is_hit() -> None:
    few: dict[str, Any] = {"record_s": 0.5, "sensors": "sensor.x"}
    one = tap_test(kuka(), "milling", points=["sensor.z"], hits=2, seed=3, **few)
    same = tap_test(kuka(), "milling", points=["sensor.z"], hits=2, seed=3, **few)
    beside = tap_test(kuka(), "milling", points=["sensor.x", "sensor.z"], hits=2, seed=3, **few)
    other = tap_test(kuka(), "milling", points=["sensor.z"], hits=2, seed=4, **few)
    for a, b in zip(one.records, same.records, strict=True):
        assert (a.values == b.values).all()
    assert one.blows == beside.blows[2:]
    assert one.blows[0] != one.blows[1]
    assert one.blows[0] != other.blows[0]
    assert not (one.records[0].values == other.records[0].values).all()


def test_noise_is_as_large_as_asked_on_every_channel() -> None:
    taps = tap_test(
        kuka(), "milling", points="sensor.z", hits=2, record_s=8.0, pretrigger_s=4.0, noise=0.002, force_noise_n=0.3
    )
    for record in taps.records:
        before = record.window(stop_s=3.9)
        # Of 1997 samples a standard deviation is known to 1.6 %.
        assert before["force"].std() == pytest.approx(0.3, rel=0.065)
        np.testing.assert_allclose(before.select("acceleration").values.std(axis=0), 0.002, rtol=0.065)
    first, second = (record.window(stop_s=3.9)["force"] for record in taps.records)
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.1  # four deviations of independent noise


def test_a_hit_too_hard_stops_at_the_end_of_the_range_and_is_told() -> None:
    taps = tap_test(kuka(), "milling", hits=2, overloads=1, record_s=1.0, seed=1)
    hard = [(record, blow) for record, (blow,) in zip(taps.records, taps.blows, strict=True) if blow.sort == "overload"]
    ((record, blow),) = hard
    assert blow.peak_n > taps.force_range_n == 400.0
    assert blow.overloaded
    assert "overload" in record.notes["hit"] or "overload" in str(blow)
    step = 2 * taps.force_range_n / 2**24
    assert record["force"].max() == taps.force_range_n - step
    assert (record["force"] == record["force"].max()).sum() >= 3  # as a clipped signal looks
    assert sum(b.overloaded for (b,) in taps.blows) == 1


def test_an_accelerometer_too_sensitive_is_told_too() -> None:
    taps = tap_test(kuka(), "milling", hits=1, acceleration_range=0.3, record_s=1.0)
    for record, (blow,) in zip(taps.records, taps.blows, strict=True):
        assert np.abs(record.select("acceleration").values).max() <= 0.3
        assert blow.overloaded


def duffing_hz(stiffness: float, cubic: float, mass: float, energy: float) -> float:
    """Frequency of m ẍ + k x + c x³ = 0 by its energy (Nayfeh and Mook 1979; elliptic integral of the first kind)."""
    square = (-stiffness + math.sqrt(stiffness**2 + 4 * cubic * energy)) / cubic
    rate = math.sqrt((stiffness + cubic * square) / mass)
    quarter = special.ellipk(cubic * square / (2 * (stiffness + cubic * square))) / rate
    return float(1 / (4 * quarter))


def test_softening_lowers_the_frequency_by_half_of_its_share_at_the_amplitude_of_a_mean_hit() -> None:
    taps = tap_test(
        cart(0.0), [0.0], points="mass_0.x", sensors="mass_0.x", hits=1, spread=0.0, softening=0.02, record_s=4.0,
        pulse_spread=0.0, **CLEAN,
    )  # fmt: skip
    (record,), ((blow,),) = taps.records, taps.blows
    values, time = record["acceleration"], record.time_s
    free = time > blow.start_s + 0.05
    values, time = values[free], time[free]
    up = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    crossings = time[up] - values[up] / (values[up + 1] - values[up]) / record.sample_rate_hz
    found = (len(crossings) - 1) / (crossings[-1] - crossings[0])
    slow = math.sqrt(STIFFNESS / MASS) / (2 * math.pi)
    # To second order in the share; a crossing is found to 1e-4 of a period, over 39 periods.
    assert found / slow == pytest.approx(1 - 0.02 / 2, abs=0.02**2)
    (law,) = taps.joints
    assert isinstance(law, am.Hardening)
    # Velocity after half a sine on a free oscillator, at its frequency (Harris 2002, shock response of a half sine).
    rate, width = math.sqrt(STIFFNESS / MASS), np.pi / blow.pulse_s
    size = blow.peak_n / MASS * 2 * width * math.cos(rate * blow.pulse_s / 2) / (width**2 - rate**2)
    # The spring is softer than that during the 10 ms of the contact only by 1e-4 of the energy.
    assert found == pytest.approx(duffing_hz(STIFFNESS, law.cubic, MASS, MASS * size**2 / 2), rel=2e-5)


def test_softening_joints_spoil_coherence_and_symmetry_and_lower_resonances() -> None:
    options: dict[str, Any] = {
        "hits": 3,
        "seed": 2,
        "noise": 0.0,
        "force_noise_n": 0.0,
        "tilt_rad": 0.0,
        "offset_m": 0.0,
    }
    linear, soft = (tap_test(kuka(), "milling", softening=share, **options) for share in (0.0, 0.02))
    natural = linear.modes.natural_freq_hz[:4]
    worst, odd, slow = [], [], []
    for taps in (linear, soft):
        freq_hz, coherence, h1 = coherence_and_h1(taps, 30.0)
        near = (np.abs(freq_hz[:, None] - natural) < 0.02 * natural).any(axis=1)
        worst.append(coherence[near].min())
        odd.append(
            max(np.abs(h1[:, i, j] - h1[:, j, i]).max() / np.abs(h1[:, i, j]).max() for i, j in ((0, 1), (0, 2)))
        )
        first = (freq_hz > 9.3) & (freq_hz < 10.5)
        # The centre of the first resonance, which a force along y drives best.
        power = np.abs(h1[first, 1, 1]) ** 2
        slow.append(float((freq_hz[first] * power).sum() / power.sum()))
    assert worst[0] > 0.999 > 0.97 > worst[1]
    assert odd[0] < 0.01 < 0.1 < odd[1]
    assert -0.02 * natural[0] / 2 < slow[1] - slow[0] < 0.0


def test_records_survive_a_file_and_name_their_robot(tmp_path: Path) -> None:
    record = tap_test(kuka(), "milling", hits=1, points="sensor.z", record_s=1.0).records[0]
    am.write_series(tmp_path / "tap.zarr", record)
    again = am.read_series(tmp_path / "tap.zarr")
    assert (again.values == record.values).all()
    assert again.labels == ("force:sensor.z", *(f"acceleration:sensor.{axis}" for axis in "xyz"))
    assert [channel.unit for channel in again.channels] == ["N", "m/s²", "m/s²", "m/s²"]
    assert again.notes["hit"].startswith("hit at sensor.z: ")
    robot = am.Robot.from_yaml(again.notes["robot_yaml"])
    assert again.notes["posture"] == "milling"
    np.testing.assert_array_equal(am.modes(robot, "milling").poles, am.modes(kuka(), "milling").poles)


def test_a_robot_on_drives_is_tapped_in_closed_loop() -> None:
    taps = tap_test(
        scompi(1), "c8", points="tool.y", sensors="tool.y", **{**SMALL, "record_s": 8.0, "sample_rate_hz": 1024.0}
    )
    freq_hz, found = ratios(taps, 60.0)
    expected = taps.frf(freq_hz).values[:, 0, 0]
    np.testing.assert_allclose(
        expected, am.frf(scompi(1), "c8", freq_hz, frame="tool", outputs="y", inputs="y").values[:, 0, 0], rtol=1e-12
    )
    assert np.abs(found[:, 0, 0] - expected).max() < FOLDED * np.abs(expected).max()


def test_progress_counts_records_and_ctrl_c_keeps_those_that_are_complete() -> None:
    seen: list[tuple[int, int]] = []

    def watch(done: int, total: int) -> None:
        seen.append((done, total))
        if done == 2:
            raise KeyboardInterrupt

    taps = tap_test(kuka(), "milling", hits=2, record_s=0.5, progress=watch)
    assert seen == [(1, 6), (2, 6)]
    assert (taps.status, len(taps.records), len(taps.blows)) == ("interrupted", 2, 2)
    whole = tap_test(kuka(), "milling", hits=2, record_s=0.5)
    assert (whole.status, len(whole.records)) == ("complete", 6)
    assert (whole.records[1].values == taps.records[1].values).all()


BAD = [
    ({"points": "sensor"}, "points: found 'sensor', expected PLACE.AXIS"),
    ({"points": "senso.x"}, "Did you mean sensor?"),
    ({"points": "sensor.rx"}, "points: found 'sensor.rx'"),
    ({"points": []}, "points: found none"),
    ({"points": ["sensor.x", "sensor.x"]}, "points: found sensor.x twice"),
    ({"sensors": "tool.x"}, "sensors: found 'tool.x'"),
    ({"hits": 0}, "hits: found 0"),
    ({"hits": 1.5}, "hits: found 1.5"),
    ({"force_n": -1.0}, "force_n: found -1.0, expected a finite number above 0"),
    ({"force_n": "200 N"}, "force_n: found '200 N'"),
    ({"spread": math.nan}, "spread: found nan"),
    ({"pulse_s": 0.0}, "pulse_s: found 0.0"),
    ({"tilt_rad": -0.1}, "tilt_rad: found -0.1"),
    ({"softening": 0.5}, "softening: found 0.5, expected a finite number of at least 0 and at most 0.03"),
    ({"double_hits": 9, "overloads": 8}, "9 double hits and 8 overloads, expected no more than the 15 hits"),
    ({"overloads": 1, "bits": None}, "overloads: found a converter without bits"),
    ({"sample_rate_hz": 0.0}, "sample_rate_hz: found 0.0"),
    ({"record_s": math.inf}, "record_s: found inf"),
    ({"record_s": 1e6}, "samples"),
    ({"pretrigger_s": 5.0}, "pretrigger_s: found 5.0, expected a finite number of at least 0 and at most 4"),
    ({"noise": -1.0}, "noise: found -1.0"),
    ({"force_range_n": 0.0}, "force_range_n: found 0.0"),
    ({"bits": 99}, "bits: found 99"),
    ({"seed": -1}, "seed: found -1"),
    ({"joints": am.Hardening(joint="nose", cubic=1.0)}, "Hardening.joint: found 'nose'"),
]


@pytest.mark.parametrize(("options", "says"), BAD, ids=[says[:40] for _, says in BAD])
def test_odd_tap_tests_are_refused_before_the_first_hit(options: dict[str, Any], says: str) -> None:
    with pytest.raises((am.SimulationError, am.SignalError)) as error:
        tap_test(kuka(), "milling", **options, progress=lambda *_: pytest.fail("a hit was done"))
    assert says in str(error.value)


def test_springs_that_cannot_soften_and_hits_too_hard_for_them_are_refused() -> None:
    with pytest.raises(am.SimulationError, match="no spring stands beside the drives"):
        tap_test(scompi(), "c8", softening=0.01, record_s=0.5)
    weak = am.Hardening(joint="mass_0.tx", cubic=-4e12)
    with pytest.raises(am.SimulationError, match=r"hit at mass_0\.x: 200 N .* Hit less hard"):
        tap_test(cart(), [0.0], points="mass_0.x", sensors="mass_0.x", hits=1, joints=weak, spread=0.0)
