"""Frequency responses of taps and shakers against closed forms and SciPy's Welch estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

import armonic as am
from armonic.errors import SignalError
from armonic.experiment.estimation import estimate_frf
from armonic.series import Channel, TimeSeries
from measured_systems import KUKA
from tapped import tap

ALIASING = 2e-3
"""A half sine of 8 ms sampled at 2048 Hz holds so much of what lies above half the rate, of its peak in the FRF."""


def relative(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.abs(found - true).max() / np.abs(true).max())


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_with_an_exponential_window_the_response_is_the_one_beside_the_axis(rate: float) -> None:
    records = [tap(axis, duration_s=8.0) for axis in "xyz"]
    found = estimate_frf(records, decay_rate=rate, max_hz=60).frfs
    assert found.decay_rate == rate
    assert relative(found.values, KUKA.frfs(found.freq_hz, decay_rate=rate).values) < ALIASING


def test_modes_come_out_without_the_window_of_a_record_that_is_too_short() -> None:
    estimate = estimate_frf([tap(axis, duration_s=3.0) for axis in "xyz"], max_hz=60)
    assert any("exponential window" in remark for remark in estimate.remarks)
    found = am.ema(estimate, band_hz=(4, 40))
    np.testing.assert_allclose(found.natural_freq_hz, np.abs(KUKA.poles) / (2 * np.pi), rtol=1e-4)
    # what is cut off at 1 % of a decay costs about that of its damping
    np.testing.assert_allclose(found.damping_ratio, KUKA.damping_ratio, rtol=0.02)


def test_displacements_and_velocities_give_the_same_accelerance() -> None:
    one, other = (estimate_frf(tap(quantity=q), decay_rate=2.0, max_hz=40).frfs for q in ("displacement", "velocity"))
    assert one.kind == other.kind == "accelerance"
    assert relative(other.values, one.values) < ALIASING


def test_offsets_of_responses_and_force_do_not_count() -> None:
    record = tap()
    moved = replace(record, values=record.values + np.array([0.7, 1e-3, -2e-3, 5e-4]))
    one, other = (estimate_frf(r, decay_rate=2.0, max_hz=40).frfs.values for r in (record, moved))
    assert relative(other, one) < 1e-9


def test_a_roving_hammer_fills_columns_and_a_roving_sensor_rows() -> None:
    whole = estimate_frf([tap(axis) for axis in "xyz"], decay_rate=2.0, max_hz=40).frfs
    assert whole.complete
    assert (whole.outputs, whole.inputs) == (("tip.x", "tip.y", "tip.z"), ("tip.x", "tip.y", "tip.z"))
    roving = estimate_frf([tap("x", outputs=axis) for axis in "xyz"], decay_rate=2.0, max_hz=40).frfs
    np.testing.assert_array_equal(roving.values[:, :, 0], whole.values[:, :, 0])
    part = estimate_frf([tap("x", outputs="x"), tap("y", outputs="y")], decay_rate=2.0, max_hz=40).frfs
    np.testing.assert_array_equal(part.measured, np.eye(2, dtype=bool))


def test_one_impact_has_no_coherence_and_several_have() -> None:
    alone = estimate_frf(tap(), decay_rate=2.0)
    assert alone.frfs.coherence is None
    assert any("One average only" in remark for remark in alone.remarks)
    several = estimate_frf([tap(peaks_n=[p]) for p in (100.0, 200.0, 300.0)], decay_rate=2.0).frfs
    assert several.coherence is not None
    np.testing.assert_allclose(several.coherence, 1.0, atol=1e-6)  # a linear system, without noise
    assert (several.averages == 3).all()


def shaken(seconds: float = 40.0, rate: float = 256.0, *, noise: float = 0.2, forces: int = 1) -> TimeSeries:
    """Random forces on a system of two coordinates in discrete time, and noise on its responses."""
    rng = np.random.default_rng(3)
    force = rng.standard_normal((round(seconds * rate), forces))
    responses = np.zeros((len(force), 2))
    for k in range(2):
        for j in range(forces):
            b, a = scipy.signal.iirpeak(20 + 15 * k + 8 * j, 12, fs=rate)
            responses[:, k] += (1 + j) * scipy.signal.lfilter(b, a, force[:, j])
    responses += noise * rng.standard_normal(responses.shape) * responses.std(axis=0)
    channels = [Channel(f"p{j}.x", "force", "N") for j in range(forces)]
    channels += [Channel(f"q{k}.z", "acceleration", "m/s²") for k in range(2)]
    return TimeSeries(np.hstack([force, responses]), rate, tuple(channels))


def test_a_shaker_is_seen_and_estimated_as_scipy_does() -> None:
    record = shaken()
    found = estimate_frf(record, resolution_hz=0.5, max_hz=100)
    assert found.excitation == "random"
    options = {"fs": 256.0, "nperseg": 512, "noverlap": 256, "window": "hann", "detrend": "constant"}
    force = record.values[:, 0]
    for k in range(2):
        response = record.values[:, 1 + k]
        f, cross = scipy.signal.csd(force, response, **options)
        _, power = scipy.signal.welch(force, **options)
        _, coherence = scipy.signal.coherence(force, response, **options)
        used = (f > 0) & (f <= 100)
        np.testing.assert_allclose(found.frfs.freq_hz, f[used])
        np.testing.assert_allclose(found.frfs.values[:, k, 0], (cross / power)[used], rtol=1e-9)
        np.testing.assert_allclose(found.frfs.coherence[:, k, 0], coherence[used], rtol=1e-9)


def test_two_shakers_at_once_are_told_apart() -> None:
    record = shaken(480.0, noise=0.0, forces=2)
    found = estimate_frf(record, resolution_hz=0.125, max_hz=100).frfs
    for k in range(2):
        for j in range(2):
            b, a = scipy.signal.iirpeak(20 + 15 * k + 8 * j, 12, fs=256.0)
            _, true = scipy.signal.freqz((1 + j) * b, a, worN=found.freq_hz, fs=256.0)
            # resonances as sharp as a few lines leak into them: 5 % of the peak
            assert relative(found.values[:, k, j], true) < 0.05


def test_damaged_samples_of_a_shaker_cost_their_blocks_only() -> None:
    record = shaken()
    values = record.values.copy()
    values[1000, 1] = np.nan
    found = estimate_frf(replace(record, values=values), resolution_hz=0.5, max_hz=100).frfs
    whole = estimate_frf(record, resolution_hz=0.5, max_hz=100).frfs
    assert found.averages[0, 0] == whole.averages[0, 0] - 2  # blocks overlap by half


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"excitation": "hum"}, "excitation: found 'hum'"),
        ({"resolution_hz": 0.5, "window_s": 2.0}, "resolution_hz"),
        ({"window_s": -1.0}, "window_s"),
        ({"window_s": 60.0}, "at most"),
        ({"window_s": 1e-3}, "at least"),
        ({"decay_rate": -1.0}, "decay_rate"),
        ({"pretrigger_s": -1.0}, "pretrigger_s"),
        ({"overlap": 1.0}, "overlap"),
        ({"max_hz": 1e-3}, "max_hz"),
        ({"keep": [4]}, "keep"),
        ({"estimator": "H3"}, "estimator"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict, said: str) -> None:
    with pytest.raises(SignalError, match=said):
        estimate_frf(tap(), **options)


def test_records_that_do_not_fit_are_refused() -> None:
    with pytest.raises(SignalError, match="different resolutions"):
        estimate_frf([tap(), tap(rate_hz=1024.0)])
    with pytest.raises(SignalError, match="no force among"):
        estimate_frf(tap().select("displacement"))
    with pytest.raises(SignalError, match="no response among"):
        estimate_frf(tap().select("force"))
    values = tap().values.copy()
    values[3000, 1] = np.nan
    bad = replace(tap(), values=values)
    with pytest.raises(SignalError, match="no usable hit"):
        estimate_frf(bad)
    with pytest.raises(SignalError, match="hits of numbers"):
        estimate_frf(bad, keep=[0])


def test_a_channel_that_never_changes_is_left_out_and_named() -> None:
    record = tap()
    values = record.values.copy()
    values[:, 2] = 1e-3
    found = estimate_frf(replace(record, values=values), decay_rate=2.0)
    assert found.frfs.outputs == ("tip.x", "tip.z")
    assert any("displacement:tip.y never changes" in remark for remark in found.remarks)
    silent = TimeSeries(
        np.hstack([0 * record.values[:, :1], record.values]), 2048.0, (Channel("tip.y", "force", "N"), *record.channels)
    )
    assert estimate_frf(silent, decay_rate=2.0).frfs.inputs == ("tip.x",)
    values[:, 0] = 0.0
    with pytest.raises(SignalError, match="the same value throughout"):
        estimate_frf(replace(record, values=values))


def test_a_window_shorter_than_the_pretrigger_still_holds_its_hit() -> None:
    found = estimate_frf(tap(), window_s=0.04, decay_rate=0.0)
    # the impulse of a half sine, 2 F T / π; at 25 Hz a little less
    assert found.force_spectrum[0, 0] == pytest.approx((2 * 200 * 0.008 / np.pi) ** 2, rel=0.15)


def test_a_hit_with_little_room_does_not_shorten_all_windows() -> None:
    late = tap(starts_s=[0.2, 23.5], peaks_n=[200.0, 200.0], duration_s=24.0)  # the swing of the first is over
    found = estimate_frf([late, tap(duration_s=24.0)])
    assert found.window_s > 20
    assert [hit.used for hit in found.hits] == [True, False, True]
    assert found.hits[1].reason.startswith("only 0.5 s until the next hit or the end")


def test_a_sine_is_no_excitation_of_a_band() -> None:
    record = shaken()
    values = record.values.copy()
    values[:, 0] = np.sin(2 * np.pi * 20 * record.time_s)
    with pytest.raises(SignalError, match="excites 20 Hz only"):
        estimate_frf(replace(record, values=values), excitation="random", resolution_hz=0.5)


@pytest.mark.parametrize("options", [{"decay_rate": 2.0}, {"keep": [0]}])
def test_what_belongs_to_hits_is_refused_beside_a_shaker(options: dict) -> None:
    with pytest.raises(SignalError, match="hits of a hammer"):
        estimate_frf(shaken(), excitation="random", **options)


@pytest.mark.parametrize("factor", [1e-160, 1e150])
def test_the_unit_of_a_force_does_not_matter(factor: float) -> None:
    record = tap()
    one = estimate_frf(record, decay_rate=2.0, max_hz=40).frfs.values
    other = estimate_frf(
        replace(record, values=record.values * [factor, 1, 1, 1]), decay_rate=2.0, max_hz=40
    ).frfs.values
    assert relative(other * factor, one) < 1e-9
