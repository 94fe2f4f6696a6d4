"""Hits are found, and those that would spoil a measurement are left out and say why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armonic.errors import SignalError
from armonic.experiment.estimation import estimate_frf
from armonic.experiment.hits import find_hits
from armonic.series import Channel, TimeSeries
from tapped import PULSE_S, tap


def changed(record: TimeSeries, change) -> TimeSeries:
    values = record.values.copy()
    change(values)
    return replace(record, values=values)


def test_a_hit_is_told_with_its_time_force_and_contact() -> None:
    (hit,) = find_hits(tap(starts_s=[0.25], peaks_n=[-180.0]))
    assert (hit.force, hit.used, hit.reason) == ("tip.x", True, "")
    assert hit.start_s == pytest.approx(0.25, abs=2 / 2048)  # samples
    assert hit.duration_s == pytest.approx(PULSE_S, abs=3 / 2048)
    assert hit.peak_n == pytest.approx(-180.0, rel=0.01)  # no sample falls on the peak


def test_several_hits_in_a_record_end_where_the_next_begins() -> None:
    hits = find_hits(tap(starts_s=[0.2, 12.0], peaks_n=[200.0, 90.0], duration_s=24.0))
    assert [hit.used for hit in hits] == [True, True]
    assert hits[0].stop == hits[1].first
    assert hits[1].stop == 24 * 2048


def test_a_hammer_that_is_heavy_in_its_wire_is_no_hit() -> None:
    record = tap()
    rng = np.random.default_rng(0)
    drift = 2.0 + np.cumsum(rng.standard_normal(len(record))) * 0.002  # an offset of 1 % that wanders
    (hit,) = find_hits(changed(record, lambda v: v.__setitem__((slice(None), 0), v[:, 0] + drift)))
    assert hit.used


@pytest.mark.parametrize(
    ("reason", "change"),
    [
        ("a double hit", lambda v: v.__setitem__((slice(500, 512), 0), 40 * np.sin(np.pi * np.arange(12) / 12))),
        ("force:tip.x is overloaded", lambda v: np.clip(v[:, 0], None, 120, out=v[:, 0])),
        ("displacement:tip.y is overloaded", lambda v: np.clip(v[:, 2], -1e-6, 1e-6, out=v[:, 2])),
        ("displacement:tip.x has values that are no numbers", lambda v: v.__setitem__((3000, 1), np.nan)),
        ("force:tip.x has values that are no numbers", lambda v: v.__setitem__((4000, 0), np.inf)),
    ],
)
def test_a_faulty_hit_says_why(reason: str, change) -> None:
    (hit,) = find_hits(changed(tap(), change))
    assert not hit.used
    assert hit.reason.startswith(reason)


def test_a_hit_into_the_swing_of_the_one_before_is_left_out() -> None:
    first, second = find_hits(tap(starts_s=[0.2, 1.2], peaks_n=[200.0, 200.0]))
    assert first.used
    assert second.reason == "the robot still swung from before"


def test_a_hit_at_the_end_of_the_record_is_left_out() -> None:
    hits = find_hits(tap(starts_s=[0.2, 9.994], peaks_n=[200.0, 200.0], duration_s=10.0))
    assert hits[-1].reason == "the record ends, or the next hit comes, with it"


def test_what_one_force_leaves_in_the_channel_of_another_is_no_hit() -> None:
    record = tap()
    crosstalk = 0.02 * record.values[:, :1]
    both = TimeSeries(np.hstack([record.values, crosstalk]), 2048.0, (*record.channels, Channel("tip.y", "force", "N")))
    assert [hit.force for hit in find_hits(both)] == ["tip.x"]


def test_a_record_without_a_hit_is_told_and_the_others_count() -> None:
    silent = changed(tap(), lambda v: v.__setitem__((slice(None), 0), 0.0))
    found = estimate_frf([tap(), silent, tap()])
    assert len(found.hits) == 2
    assert any(remark.startswith("Record 2 is left out: in force:tip.x") for remark in found.remarks)
    with pytest.raises(SignalError, match="the same value throughout"):
        estimate_frf([silent])
    noisy = np.random.default_rng(0).standard_normal(len(silent))
    hum = changed(tap(), lambda v: v.__setitem__((slice(None), 0), noisy))
    with pytest.raises(SignalError, match=r"no hit in force:tip\.x"):
        estimate_frf([hum], excitation="hits")


def test_what_is_no_share_is_refused() -> None:
    with pytest.raises(SignalError, match="trigger: found 2"):
        find_hits(tap(), trigger=2)
