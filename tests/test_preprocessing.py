"""Offsets come off, bands and decimation keep what they should, and the free decay is found."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import signal

from armonic.errors import SignalError
from armonic.identification.preprocessing import band, decimate, detrend, free_decay
from armonic.series import Channel, TimeSeries

ANGLE = Channel("link_1.z", "motor_position", "rad")
FORCE = Channel("tool.x", "force", "N")
RATE = 1000.0


def of(*columns: Any, rate: float = RATE, start_s: float = 0.0) -> TimeSeries:
    channels = tuple(Channel(f"c{k}", "signal") for k in range(len(columns)))
    return TimeSeries(np.column_stack(columns), rate, channels, start_s)


def sine(freq_hz: float, samples: int = 4000, rate: float = RATE) -> Any:
    return np.sin(2 * np.pi * freq_hz * np.arange(samples) / rate)


@pytest.mark.parametrize("how", ["mean", "linear"])
def test_offsets_and_trends_come_off_as_scipy_takes_them(how: Any) -> None:
    walk = np.random.default_rng(0).normal(size=(501, 3)).cumsum(axis=0)
    values = walk + np.array([5, -9, 1e3])
    found = detrend(of(*values.T), how).values
    expected = signal.detrend(values, axis=0, type="constant" if how == "mean" else "linear")
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_the_rest_of_a_decay_comes_off_without_bending_it_and_the_mean_does_not() -> None:
    time = np.arange(3000) / RATE
    decay = np.exp(-5 * time) * np.cos(40 * time)
    found = detrend(of(0.7 + decay), "rest").values[:, 0]
    # By 2.85 s the decay is down to exp(-14) = 7e-7, and its mean over the last 5 % to less.
    np.testing.assert_allclose(found, decay, atol=7e-7)
    assert np.abs(detrend(of(0.7 + decay), "mean").values[:, 0] - decay).max() > 1e-3


def test_a_series_of_one_sample_has_no_trend() -> None:
    assert detrend(of([3.0]), "linear").values.tolist() == [[0.0]]


@pytest.mark.parametrize("factor", [2, 5, 8])
def test_decimation_keeps_what_the_new_rate_can_hold_and_removes_what_it_cannot(factor: int) -> None:
    nyquist = RATE / factor / 2
    for share in (0.05, 0.5, 0.8):
        kept = decimate(of(sine(share * nyquist)), factor)
        assert (kept.sample_rate_hz, len(kept)) == (RATE / factor, 4000 / factor)
        inner = slice(26, -26)  # half the filter is 25 new samples and a little
        # 80 dB are 1e-4, in amplitude and (it has none) in phase.
        expected = sine(share * nyquist)[::factor]
        np.testing.assert_allclose(kept.values[inner, 0], expected[inner], atol=1.05e-4)
    for share in (1.0, 1.2, 1.7):
        gone = decimate(of(sine(share * nyquist + 0.01)), factor)
        assert np.abs(gone.values[26:-26]).max() < 1.05e-4


def test_decimation_keeps_constants_and_ramps_to_the_very_ends() -> None:
    ramp = 5.0 + np.arange(1000) / 100
    kept = decimate(of(ramp), 4)
    np.testing.assert_allclose(kept.values[:, 0], ramp[::4], atol=1e-9)
    assert decimate(of(ramp), 1).values.tolist() == ramp[:, None].tolist()


def test_a_band_pass_acts_twice_without_phase() -> None:
    low, high, order = 50.0, 120.0, 3
    w1, w2 = (math.tan(math.pi * f / RATE) for f in (low, high))
    for freq_hz in (20.0, 50.0, 80.0, 120.0, 300.0):
        found = band(of(sine(freq_hz, 8000)), low, high, order=order).values[:, 0]
        w = math.tan(math.pi * freq_hz / RATE)
        once = 1 / (1 + ((w * w - w1 * w2) / (w * (w2 - w1))) ** (2 * order))  # |H|², lowpass to bandpass
        inner = slice(2000, 6000)
        np.testing.assert_allclose(found[inner], once * sine(freq_hz, 8000)[inner], atol=1e-8)


def test_open_bands_are_a_low_pass_and_a_high_pass_and_none_at_all() -> None:
    both = of(3 + sine(5, 8000) + sine(200, 8000))
    inner = slice(2000, 6000)
    np.testing.assert_allclose(band(both, None, 40).values[inner, 0], 3 + sine(5, 8000)[inner], atol=1e-4)
    np.testing.assert_allclose(band(both, 40, None).values[inner, 0], sine(200, 8000)[inner], atol=1e-4)
    assert band(both, 0, None) is both


def test_the_free_decay_starts_with_the_sample_after_the_last_force() -> None:
    force = np.zeros(3000)
    force[200:206] = 50
    series = TimeSeries(np.column_stack([np.arange(3000.0), force]), RATE, (ANGLE, FORCE))
    found = free_decay(series)
    assert (found.start_s, found["motor_position"][0], len(found)) == (0.206, 206, 2794)
    assert not found["force"].any()


def test_of_a_measured_force_what_is_small_against_its_peak_is_none() -> None:
    force = 0.01 * np.random.default_rng(0).normal(size=3000)
    force[200:206] += 50
    series = TimeSeries(np.column_stack([np.arange(3000.0), force]), RATE, (ANGLE, FORCE))
    assert free_decay(series, quiet=0.02).start_s == 0.206
    with pytest.raises(SignalError, match=r"acts to the last sample.*quiet="):
        free_decay(series)


@pytest.mark.parametrize("silent_force", [False, True])
def test_without_a_force_the_decay_starts_at_the_largest_response(silent_force: bool) -> None:
    time = np.arange(3000) / RATE
    pluck = np.where(time >= 0.5, np.exp(-4 * (time - 0.5)) * np.cos(60 * (time - 0.5)), 0)
    columns = [2 + pluck, 1e-3 * pluck - 7] + ([np.zeros(3000)] if silent_force else [])
    channels = (ANGLE, Channel("b", "acceleration", "m/s²"), FORCE)[: len(columns)]
    found = free_decay(TimeSeries(np.column_stack(columns), RATE, channels, 10.0))
    assert (found.start_s, len(found)) == (10.5, 2500)


def test_the_time_of_the_decay_may_be_given() -> None:
    assert free_decay(of(np.arange(10.0)), 0.004).values[:, 0].tolist() == [4, 5, 6, 7, 8, 9]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: detrend(s, "median"), "mean, linear or rest"),
        (lambda s: detrend(s, "rest", tail=0), "tail"),
        (lambda s: decimate(s, 0), "factor: found 0"),
        (lambda s: decimate(s, 40), "found 50 samples, expected more than"),
        (lambda s: band(s, 100, 50), "Nyquist"),
        (lambda s: band(s, 100, 500), "Nyquist"),
        (lambda s: band(s, 100, 200, order=0), "order"),
        (lambda s: band(s, 100, 200, order=10), "expected more than 63"),
        (lambda s: free_decay(s, "later"), "auto, or a time in s"),
        (lambda s: free_decay(s, 1.0), "no sample from 1 s"),
        (lambda s: free_decay(s, quiet=1), "quiet"),
        (lambda s: detrend(s.with_values([[np.nan]])), "found nan"),
        (lambda s: free_decay(s.with_values([[np.inf]])), "found inf"),
    ],
)
def test_what_cannot_be_prepared_is_refused(call: Any, message: str) -> None:
    with pytest.raises(SignalError, match=message):
        call(of(np.arange(50.0)))
