"""Time series hold what they are given, name their channels, and refuse what is no series."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from armonic.errors import SignalError
from armonic.series import QUANTITIES, Channel, TimeSeries

CHANNELS = (
    Channel("link_1.z", "motor_position", "rad"),
    Channel("link_2.z", "motor_position", "rad"),
    Channel("link_2.z", "motor_velocity", "rad/s"),
    Channel("tool.x", "force", "N"),
)
VALUES = np.arange(40.0).reshape(10, 4)
SERIES = TimeSeries(VALUES, 1000.0, CHANNELS, 0.2, {"robot": "Scompi"})


def test_channels_are_found_by_quantity_name_label_and_pattern() -> None:
    assert SERIES.select("motor_position").labels == ("motor_position:link_1.z", "motor_position:link_2.z")
    assert SERIES.select("link_2.z").labels == ("motor_position:link_2.z", "motor_velocity:link_2.z")
    assert SERIES.select("force:tool.x").values.tolist() == VALUES[:, 3:].tolist()
    assert SERIES.select("*link_?.z", "force").labels == SERIES.labels


def test_a_selection_keeps_the_order_of_the_series_whatever_the_order_of_the_patterns() -> None:
    assert SERIES.select("force", "link_1.z").labels == ("motor_position:link_1.z", "force:tool.x")


def test_one_channel_is_a_column_by_its_name() -> None:
    assert SERIES["force"].tolist() == VALUES[:, 3].tolist()
    assert SERIES.index("motor_velocity:link_2.z") == 2


def test_a_window_holds_both_its_ends_and_keeps_its_time() -> None:
    part = SERIES.window(0.203, 0.206)
    assert part.values.tolist() == VALUES[3:7].tolist()
    # Two roundings of a time near 0.2 s.
    np.testing.assert_allclose(part.time_s, [0.203, 0.204, 0.205, 0.206], atol=1e-15)
    assert SERIES.window(stop_s=0.2).values.tolist() == VALUES[:1].tolist()
    assert len(SERIES.window()) == 10


def test_the_rate_follows_from_the_times() -> None:
    times = 3.0 + np.arange(2000) / 1024
    series = TimeSeries.from_samples(times, np.zeros((2000, 1)), CHANNELS[:1])
    assert (series.sample_rate_hz, series.start_s, len(series)) == (1024.0, 3.0, 2000)
    assert series.duration_s == 1999 / 1024


def test_times_that_a_file_rounded_or_kept_in_single_precision_are_even() -> None:
    exact = np.arange(500) / 1024
    for times in (np.round(exact, 5), (100 + exact).astype(np.float32)):
        series = TimeSeries.from_samples(times, np.zeros((500, 1)), CHANNELS[:1])
        # Each end is off by half a unit of 1e-5 s, or of 2^-17 s, of 0.49 s in all.
        assert series.sample_rate_hz == pytest.approx(1024, rel=3e-5)


def test_a_series_cannot_be_changed_and_survives_pickling() -> None:
    source = VALUES.copy()
    series = TimeSeries(source, 1000, list(CHANNELS), notes={"a": "b"})  # type: ignore[arg-type]
    source[0, 0] = 99
    assert series.values[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        series.values[0, 0] = 1
    with pytest.raises(TypeError):
        series.notes["a"] = "c"  # type: ignore[index]
    again = pickle.loads(pickle.dumps(SERIES))
    assert again.values.tolist() == VALUES.tolist()
    assert (again.labels, again.notes, again.start_s) == (SERIES.labels, {"robot": "Scompi"}, 0.2)


def test_other_values_keep_the_channels_and_may_change_the_rate() -> None:
    other = SERIES.with_values(VALUES[::2], sample_rate_hz=500)
    assert (len(other), other.sample_rate_hz, other.start_s, other.notes) == (5, 500, 0.2, {"robot": "Scompi"})


def test_a_series_says_what_it_is() -> None:
    assert repr(SERIES).startswith("TimeSeries(10 samples at 1000 Hz from 0.2 s, 4 channels: motor_position:link_1.z,")


def test_values_that_are_not_finite_are_kept_until_they_are_needed() -> None:
    values = VALUES.copy()
    values[4, 2], values[7, 0] = np.nan, np.inf
    series = SERIES.with_values(values)
    assert np.isnan(series.values[4, 2])
    with pytest.raises(SignalError, match=r"motor_velocity:link_2\.z: found nan at 0\.204 s \(sample 4, 2 in all\)"):
        series.finite()
    assert SERIES.finite() is SERIES.values


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SERIES.select("moter_position"), r"Did you mean motor_position\?"),
        (lambda: SERIES.select(), "no pattern"),
        (lambda: SERIES["motor_position"], "expected the name of one channel"),
        (lambda: SERIES[0], r"Samples by number are in series\.values"),
        (lambda: SERIES.window(0.3), "no sample from 0.3 s to the end, expected times within 0.2 to 0.209 s"),
        (lambda: SERIES.window(0.2041, 0.2049), "no sample"),
        (lambda: SERIES.window(float("nan")), "NaN"),
        (lambda: Channel("a", "motor_positon", "rad"), r"Did you mean motor_position\?"),
        (lambda: Channel("a\n", "force", "N"), "one line"),
        (lambda: Channel("", "force", "N"), "one line"),
        (lambda: TimeSeries(VALUES, 0, CHANNELS), "found 0 Hz, expected a positive number of Hz"),
        (lambda: TimeSeries(VALUES, float("inf"), CHANNELS), "found inf"),
        (lambda: TimeSeries(VALUES, 1, CHANNELS, float("nan")), "start_s: found nan"),
        (lambda: TimeSeries(VALUES, 1, CHANNELS[:2]), r"found shape \(10, 4\), expected .*\(samples, 2\)"),
        (lambda: TimeSeries(VALUES[:0], 1, CHANNELS), "at least one sample"),
        (lambda: TimeSeries(1j * VALUES, 1, CHANNELS), "complex numbers"),
        (lambda: TimeSeries(VALUES, 1, (*CHANNELS[:3], CHANNELS[0])), "motor_position:link_1.z twice"),
        (lambda: TimeSeries(VALUES, 1, ()), "at least one"),
        (lambda: TimeSeries(VALUES, 1, CHANNELS, 0, {"a": 1}), "notes"),
    ],
)
def test_what_is_no_series_or_channel_is_refused_with_a_reason(call: Any, message: str) -> None:
    with pytest.raises(SignalError, match=message):
        call()


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 1.0, 2.0, 2.0, 4.0], "found 2 s at index 3 after 2 s, expected times that increase"),
        ([0.0, 1.0, 2.0, 1.5, 4.0], "found 1.5 s at index 3 after 2 s"),
        ([0.0, 1.0, np.nan, 3.0, 4.0], "found nan at index 2"),
        ([0.0, 1.0, 2.0, 4.0, 5.0], "uneven steps: 2 s after index 2, 1 s as a rule"),
        ([0.0], "two samples or more"),
    ],
)
def test_times_that_do_not_run_evenly_are_refused_by_index(times: list[float], message: str) -> None:
    with pytest.raises(SignalError, match=message):
        TimeSeries.from_samples(times, np.zeros((len(times), 1)), CHANNELS[:1])


def test_a_column_of_another_length_than_the_times_is_refused() -> None:
    with pytest.raises(SignalError, match="found 9 samples, expected 10, one per time"):
        TimeSeries.from_samples(np.arange(10.0), np.zeros((9, 1)), CHANNELS[:1])


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_quantity_makes_a_label(quantity: Any) -> None:
    assert Channel("x", quantity).label == f"{quantity}:x"
