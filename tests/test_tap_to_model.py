"""From the taps of a simulated KUKA KR90 whose joints soften to a model of it, on the whole route of the paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armonic as am

ROBOT = "kuka_kr90"


@pytest.fixture(scope="module")
def taps() -> am.TapTest:
    return am.tap_test(am.load(ROBOT), "milling", seed=1, softening=0.008, bits=16, double_hits=1, overloads=1)


@pytest.fixture(scope="module")
def estimate(taps: am.TapTest) -> am.FrfEstimate:
    return am.estimate_frf(taps.records)


def test_the_double_hit_and_the_overload_are_left_out_and_nothing_else(
    taps: am.TapTest, estimate: am.FrfEstimate
) -> None:
    left = [hit for hit in estimate.hits if not hit.used]
    assert len(estimate.hits) == 15
    assert sorted("double" in hit.reason or "overloaded" in hit.reason for hit in left) == [True, True]
    assert estimate.frfs.complete


@pytest.mark.parametrize("method", ["plscf", "lsce"])
def test_four_modes_are_found_below_thirty_hertz_as_in_table_6(
    taps: am.TapTest, estimate: am.FrfEstimate, method: str
) -> None:
    found = am.ema(estimate, band_hz=(5, 40), method=method)  # type: ignore[arg-type]
    seen = found.natural_freq_hz < 30
    assert np.count_nonzero(seen) == 4
    # joints that soften by 0.8 % lower frequencies by half of that
    np.testing.assert_allclose(found.natural_freq_hz[seen], taps.modes.natural_freq_hz[:4], rtol=0.005)
    np.testing.assert_allclose(found.damping_ratio[seen], taps.modes.damping_ratio[:4], rtol=0.15)


def test_the_update_on_synthesized_responses_agrees_with_the_truth(
    taps: am.TapTest, estimate: am.FrfEstimate, tmp_path: Path, armonic
) -> None:
    am.write_measured(tmp_path / "taps.h5", records=taps.records)
    out = tmp_path / "new.yaml"
    code = armonic("update", ROBOT, str(tmp_path / "taps.h5"), "--synthesize", "--band", "5:30", "-o", str(out)).code
    assert code == 0
    updated = am.modes(am.load(out), "milling")
    # Springs that the data leave open may add poles without oscillation; the four modes are paired by poles and shapes.
    pairs = {pair.index_b: pair for pair in am.compare(updated, taps.modes).pairs}
    for mode in range(4):
        assert abs(pairs[mode].freq_difference) < 0.01
        assert abs(pairs[mode].damping_difference) < 0.15 * taps.modes.damping_ratio[mode]


def test_a_hammer_that_is_held_askew_does_not_make_wrong_springs_certain() -> None:
    robot = am.load(ROBOT)
    taps = am.tap_test(robot, "milling", hits=3)  # linear joints, directions known to 0.02 rad
    made = am.synthesized_matrix(am.ema(am.estimate_frf(taps.records)), "sensor")
    fit = am.update(robot, am.Measurement(made.frf, "milling", coherence=made.coherence, raw=made.raw))
    true = robot.parameters("links.*.elasticity.*.stiffness")
    known = [p for p in fit.parameters if p.path in true and p.verdict == "identified"]
    assert len(known) >= 5  # of nine: wide intervals must not be the way out
    for p in known:
        assert p.value == pytest.approx(true[p.path], rel=0.25), p.path  # what the verdict promises
