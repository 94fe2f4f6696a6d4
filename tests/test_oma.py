"""One call from a time series to modes: what it takes, what it cuts, and how it refuses."""

from __future__ import annotations

import re

import numpy as np
import pytest

import armonic as am
from armonic.identification.autoregressive import vector_autoregression
from armonic.identification.regression import Regression
from armonic.identification.sharpening import sharpened

RATE = 200.0
POLES = (2 * np.pi * np.array([5.0, 5.2, 23.0])) * np.exp(1j * (np.pi / 2 + np.arcsin([0.03, 0.04, 0.01])))
SHAPES = np.array([[1.0, 0.6, -0.3], [0.4, -1.0, 0.8], [-0.7, 0.2, 1.0]])
CHANNELS = tuple(am.Channel(f"m{i}", "motor_position", "rad") for i in range(3))


def decay(samples: int = 1500, *, force: bool = False, offset: float = 0.0) -> am.TimeSeries:
    """Three modes let go at 1 s; before that a force holds them still."""
    time = np.arange(samples) / RATE
    values = 2 * np.real(np.exp(np.multiply.outer(time, POLES)) @ SHAPES) + offset
    if not force:
        return am.TimeSeries(values, RATE, CHANNELS)
    held = np.vstack([np.repeat(values[:1], int(RATE), axis=0), values])
    push = np.r_[np.full(int(RATE), 3.0), np.zeros(samples)]
    return am.TimeSeries(np.column_stack([held, push]), RATE, (*CHANNELS, am.Channel("tip.y0", "force", "N")))


def random_response(seed: int, samples: int = 20_000, line_hz: float | None = None) -> am.TimeSeries:
    """The same modes under white noise on every modal coordinate, exactly sampled."""
    rng = np.random.default_rng(seed)
    step = np.exp(POLES / RATE)
    modal = np.zeros((samples, 3), np.complex128)
    kicks = rng.normal(size=(samples, 3)) + 1j * rng.normal(size=(samples, 3))
    for k in range(1, samples):
        modal[k] = step * modal[k - 1] + kicks[k]
    values = np.real(modal @ SHAPES)
    if line_hz is not None:
        values += 3 * values.std() * np.sin(2 * np.pi * line_hz * np.arange(samples) / RATE)[:, None]
    return am.TimeSeries(values, RATE, CHANNELS)


def assert_found(result: am.OmaResult, rel: float) -> None:
    found = np.array([mode.pole for mode in result.modes])
    truth = POLES[np.argsort(np.abs(POLES))]
    assert len(found) == len(truth)
    assert np.abs(found / truth - 1).max() < rel


def test_a_noise_free_decay_gives_back_its_poles() -> None:
    # Rounding alone, 5e-15 as it is; other machines round otherwise, and a second mode lies 4 % away.
    assert_found(am.oma(decay(), orders=(2, 20)), 1e-8)


def test_the_free_decay_begins_where_the_force_ends() -> None:
    result = am.oma(decay(force=True), orders=(2, 20))
    assert result.window == "decay"
    assert len(result.series) == 1500
    assert_found(result, 1e-8)
    assert result.channels == tuple(channel.label for channel in CHANNELS)


def test_an_offset_of_the_channels_does_not_matter() -> None:
    assert_found(am.oma(decay(force=True, offset=0.7), orders=(2, 20)), 1e-6)  # rest is the mean of a decaying tail


@pytest.mark.parametrize("method", ["var", "ssi"])
def test_a_random_response_gives_the_modes_with_either_method(method: str) -> None:
    # Of 40 000 samples; a mode of 5 Hz with 3 % has some 6000 statistically independent ones: 1.3 % of its decay rate.
    result = am.oma(random_response(1, 40_000), orders=(6, 40), method=method)
    table = am.compare(result, list(zip(np.abs(POLES) / (2 * np.pi), -POLES.real / np.abs(POLES), strict=True)))
    assert len(table.pairs) == 3
    assert max(abs(pair.freq_difference) for pair in table.pairs) < 0.01
    assert max(abs(pair.damping_difference) for pair in table.pairs) < 0.01


def test_a_band_leaves_out_what_lies_outside() -> None:
    result = am.oma(decay(), orders=(2, 20), band_hz=(4.0, 6.0))
    assert [round(f, 6) for f in result.natural_freq_hz] == [5.0, 5.2]


def test_the_grid_of_the_papers_tool_finds_them_too() -> None:
    result = am.oma(decay(), orders=(2, 20), selection="grid", freq_resolution_hz=0.01, damping_resolution=1e-3)
    assert_found(result, 1e-6)


def test_a_spindle_is_flagged_and_modes_are_not() -> None:
    result = am.oma(random_response(2, line_hz=31.0), orders=(4, 40), spindle_hz=31.0)
    flagged = {round(m.natural_freq_hz): f.is_harmonic for m, f in zip(result.modes, result.harmonics, strict=True)}
    assert flagged[31]
    assert not any(yes for freq, yes in flagged.items() if freq != 31)


def test_lags_that_are_spaced_solve_the_spaced_least_squares_problem() -> None:
    values = np.random.default_rng(0).normal(size=(300, 2)).cumsum(axis=0)
    fit = Regression(values, 5, spacing=3).fit(4)
    rows = np.arange(12, 300)
    lags = np.hstack([values[rows - 3 * j] for j in range(1, 5)])
    stacked = np.linalg.lstsq(lags, values[rows], rcond=None)[0]
    own = fit.coefficients * fit.scale[:, None] / fit.scale
    # Rounding alone: the lagged random walks have a condition of 46.
    assert np.allclose(own.transpose(0, 2, 1).reshape(8, 2), stacked, rtol=1e-11, atol=1e-12)
    assert fit.rows == 288


def test_spaced_lags_sharpen_close_modes_and_add_none() -> None:
    series = decay(force=True)
    once, twice = (am.oma(series, orders=(2, 30), spacing=spacing) for spacing in (1, 3))
    assert len(once.modes) == len(twice.modes)
    assert once.spacing == (1, 1, 1)
    slow = vector_autoregression(twice.series.values, RATE, orders=(2, 30), spacing=3)
    modes, spacing = sharpened(once.modes, slow, RATE, 3)
    assert len(modes) == 3
    assert spacing[2] == 1  # 23 Hz lies above half of 33 Hz, where poles of spaced lags fold


def test_a_pulse_between_two_samples_still_says_when_the_robot_is_free() -> None:
    hit = am.HammerPulse(axis="z0", force=800, duration_s=0.002)
    series = am.simulate(am.load("huynh_3r"), {}, hit, duration_s=4, sample_rate_hz=200).series
    assert not series["force"].any()
    result = am.oma(series, channels="acceleration")
    assert result.window == "decay"
    assert result.series.start_s == pytest.approx(0.205)
    pairs = am.compare(result, am.modes(am.load("huynh_3r"), {})).pairs
    assert [pair.index_b for pair in pairs] == [0, 1, 2]
    # A blow of 800 N moves the arm by so much that its frequencies are not quite those of small vibration.
    assert max(abs(pair.freq_difference) for pair in pairs) < 1e-3


def test_a_window_after_the_last_force_is_a_decay_as_well() -> None:
    series = decay(force=True)
    assert am.oma(series, orders=(2, 12), window=(1.5, 5.0)).method == "var"
    assert am.oma(series, orders=(2, 12), window=(0.5, 5.0)).method == "ssi"


def test_a_step_is_a_decay_from_where_it_sets_in() -> None:
    series = am.simulate(am.load("scompi"), "c8", am.Step(axis="y0", force=20), duration_s=2).series
    result = am.oma(series)
    assert (result.window, result.series.start_s) == ("decay", pytest.approx(0.2))
    assert result.method == "var"


def test_a_run_stands_for_its_series_and_lasting_noise_calls_for_subspaces() -> None:
    noise = am.BandNoise(axis="y0", rms=5, low_hz=1, high_hz=300)
    run = am.simulate(am.load("scompi"), "c8", noise, duration_s=2)
    assert am.oma(run).method == "ssi"


def test_each_stage_is_told() -> None:
    heard: list[str] = []
    am.oma(decay(), orders=(2, 12), progress=heard.append)
    assert heard[0] == "preparing the samples"
    assert any("orders 2 to 12" in stage for stage in heard)


def test_motor_positions_come_first_where_nothing_is_asked() -> None:
    series = decay()
    labelled = (am.Channel("tip.x0", "acceleration", "m/s²"), *CHANNELS[1:])
    mixed = am.TimeSeries(series.values, RATE, labelled)
    assert am.oma(mixed, orders=(2, 12)).channels == ("motor_position:m1", "motor_position:m2")


def nan_at(series: am.TimeSeries, sample: int, column: int) -> am.TimeSeries:
    values = series.values.copy()
    values[sample, column] = np.nan
    return series.with_values(values)


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        pytest.param(
            lambda s: s.window(0, 0.5), {"orders": (2, 60), "method": "var"}, "at most 25", id="too few samples"
        ),
        pytest.param(lambda s: nan_at(s, 40, 1), {}, r"motor_position:m1.*0\.2 s", id="NaN"),
        pytest.param(
            lambda s: s.with_values(s.values * [1, 0, 1] + [0, 2, 0]),
            {},
            "motor_position:m1.*the same value",
            id="still",
        ),
        pytest.param(lambda s: s, {"channels": "motor_positon"}, "Did you mean motor_position", id="typing error"),
        pytest.param(lambda s: s, {"orders": (9, 3)}, "ascending positive integers", id="orders backwards"),
        pytest.param(lambda s: s, {"method": "era"}, "one of auto, var, ssi", id="method"),
        pytest.param(lambda s: s, {"window": "free"}, "one of auto, decay, all", id="window word"),
        pytest.param(lambda s: s, {"window": (90.0, 99.0)}, "no sample", id="window beyond"),
        pytest.param(lambda s: s, {"detrend": "median"}, "one of auto", id="detrend"),
        pytest.param(lambda s: s, {"selection": "all"}, "one of cluster, grid", id="selection"),
        pytest.param(lambda s: s, {"band_hz": (6.0, 4.0)}, "0 <= low < high", id="band"),
        pytest.param(lambda s: s, {"spacing": 0}, "at least 1", id="spacing"),
        pytest.param(lambda s: s, {"method": "ssi", "spacing": 2}, "var", id="spacing of ssi"),
        pytest.param(lambda s: s, {"method": "ssi", "deviations": True}, "var", id="deviations of ssi"),
        pytest.param(lambda s: s, {"decimate": 0}, "at least 1", id="decimate"),
    ],
)
def test_bad_input_is_refused_in_one_line(change, options, words) -> None:
    with pytest.raises(am.SignalError) as caught:
        am.oma(change(decay()), **({"orders": (2, 12)} | options))
    assert re.search(words, str(caught.value))
    assert "\n" not in str(caught.value)
