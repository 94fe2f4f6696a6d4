"""Sensors filter, sample, add noise and round, each as a closed form or a count says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import signal

from armonic.errors import SignalError
from armonic.series import Channel, TimeSeries
from armonic.simulation.sensors import AntiAlias, Sensor, measure

ANGLE = Channel("link_1.z", "motor_position", "rad")
FORCE = Channel("tool.x", "force", "N")


def sine(freq_hz: float, *, rate: float = 10_000.0, samples: int = 40_000) -> TimeSeries:
    time = np.arange(samples) / rate
    return TimeSeries(np.sin(2 * np.pi * freq_hz * time)[:, None], rate, (ANGLE,))


def amplitude(series: TimeSeries, freq_hz: float) -> complex:
    """Amplitude and phase over the last half, of whole periods: a scalar product."""
    part = series.values[len(series) // 2 :, 0]
    turn = np.exp(-2j * np.pi * freq_hz * series.time_s[len(series) // 2 :])
    return complex(2j * (part * turn).mean())


def test_rounding_errors_of_an_encoder_are_uniform_over_one_step() -> None:
    truth = TimeSeries(np.random.default_rng(1).normal(size=(200_000, 1)), 1000.0, (ANGLE,))
    sensor = Sensor(bits=12)
    error = (measure(truth, {"motor_position": sensor}).values - truth.values)[:, 0] / (2 * math.pi / 4096)
    assert np.abs(error).max() <= 0.5 + 1e-9  # rounding of numbers of some thousand steps
    # 1/√12 is known to 1/√(5 N) of itself from N values of a uniform law, 0.1 %; four of that.
    assert error.std() == pytest.approx(1 / math.sqrt(12), rel=4e-3)
    assert error.mean() == pytest.approx(0, abs=4 / math.sqrt(12 * error.size))
    counts = np.histogram(error, 10, (-0.5, 0.5))[0]
    assert ((counts - error.size / 10) ** 2 / (error.size / 10)).sum() < 27.9  # χ² of 9 degrees, once in 1000


def test_values_of_an_encoder_are_whole_steps_and_count_on_beyond_a_turn() -> None:
    truth = TimeSeries(np.linspace(-20, 20, 999)[:, None], 1.0, (ANGLE,))
    steps = measure(truth, {"link_1.z": Sensor(bits=8)}).values / (2 * math.pi / 256)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.ptp(steps) == pytest.approx(40 / (2 * math.pi / 256), abs=1)


def test_a_converter_that_saturates_stops_at_half_its_range() -> None:
    truth = TimeSeries(np.array([[-9.0], [-0.3], [0.3], [9.0]]), 1.0, (FORCE,))
    seen = measure(truth, {"force": Sensor(bits=3, full_range=8.0, saturates=True)})
    assert seen.values[:, 0].tolist() == [-4, 0, 0, 3]  # two's complement: one step less above than below


def low(cutoff_hz: float, order: int, kind: Any = "butterworth") -> TimeSeries:
    return measure(sine(1, samples=20), {"*": Sensor(anti_alias=AntiAlias(cutoff_hz, "hz", order, kind))})


@pytest.mark.parametrize("order", [2, 4, 7])
@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_butterworth_filter_attenuates_as_its_closed_form_says(order: int, share: float) -> None:
    decimation, rate = 10, 10_000.0
    sensor = Sensor(anti_alias=AntiAlias(share, order=order))
    warped = [math.tan(math.pi * f / rate) for f in (share * 500, 200.0, 499.0)]
    for freq_hz, w in zip((200.0, 499.0), warped[1:], strict=True):
        seen = measure(sine(freq_hz), {"*": sensor}, decimation=decimation)
        assert seen.sample_rate_hz == 1000
        # |H|² = 1/(1 + (w/wc)^2n) in tan(π f/fs); 499 Hz is no multiple of 1/2 s, but both are of 1 s.
        assert abs(amplitude(seen, freq_hz)) == pytest.approx((1 + (w / warped[0]) ** (2 * order)) ** -0.5, rel=1e-6)


def test_without_a_filter_what_is_above_nyquist_comes_down_and_with_one_it_hardly_does() -> None:
    bare = measure(sine(900), {}, decimation=10)
    assert abs(amplitude(bare, 100)) == pytest.approx(1, rel=1e-9)  # 1000 - 900 Hz
    filtered = measure(sine(900), {"*": Sensor(anti_alias=AntiAlias(0.8, order=8))}, decimation=10)
    assert abs(amplitude(filtered, 100)) < (900 / 400) ** -8


def test_a_bessel_filter_delays_all_it_passes_alike_and_a_butterworth_filter_does_not() -> None:
    delays: dict[str, list[float]] = {"bessel": [], "butterworth": []}
    for kind, found in delays.items():
        filter_ = AntiAlias(400, "hz", order=4, kind=kind)  # type: ignore[arg-type]
        for freq_hz in (20.0, 300.0):
            seen = amplitude(measure(sine(freq_hz), {"*": Sensor(anti_alias=filter_)}), freq_hz)
            found.append(-math.atan2(seen.imag, seen.real) % (2 * math.pi) / (2 * math.pi * freq_hz))
    assert delays["bessel"][1] == pytest.approx(delays["bessel"][0], rel=0.02)  # bilinear: π²(f/fs)²/3 and less
    assert delays["butterworth"][1] > 1.1 * delays["butterworth"][0]


def test_the_filter_is_causal_and_does_not_ring_over_a_constant() -> None:
    values = np.full((400, 1), 5.0)
    values[200:] += 1
    seen = measure(TimeSeries(values, 1000.0, (ANGLE,)), {"*": Sensor(anti_alias=AntiAlias(100, "hz"))})
    np.testing.assert_allclose(seen.values[:200], 5, rtol=1e-12)
    assert abs(seen.values[200, 0] - 6) > 0.9
    sos = signal.butter(4, 100, fs=1000, output="sos")
    step = signal.sosfilt(sos, np.ones(200))
    np.testing.assert_allclose(seen.values[200:, 0], 5 + step, rtol=1e-9)


def test_noise_has_the_stated_share_of_the_channel_or_the_stated_deviation() -> None:
    generator = np.random.default_rng(0)
    truth = TimeSeries(7 + 3 * generator.normal(size=(100_000, 2)), 1000.0, (ANGLE, FORCE))
    seen = measure(truth, {"force": Sensor(noise_std=0.25), "motor_position": Sensor(noise=0.001)}, seed=5)
    noise = seen.values - truth.values
    # A deviation from N values is known to 1/√(2N) = 0.22 %; four of that.
    assert noise[:, 0].std() == pytest.approx(0.001 * truth.values[:, 0].std(), rel=9e-3)
    assert noise[:, 1].std() == pytest.approx(0.25, rel=9e-3)
    for lag in (0, 1, 5):  # white, and one channel's is not another's
        other = noise[: len(noise) - lag, 0], noise[lag:, 1 if lag == 0 else 0]
        assert abs(np.corrcoef(*other)[0, 1]) < 4 / math.sqrt(len(noise))


def test_the_same_seed_gives_the_same_measurement_whatever_is_measured_beside_it() -> None:
    truth = TimeSeries(np.random.default_rng(0).normal(size=(100, 2)), 1000.0, (ANGLE, FORCE))
    sensors = {"*": Sensor(noise=0.1)}
    first = measure(truth, sensors, seed=3)
    np.testing.assert_array_equal(measure(truth, sensors, seed=3).values, first.values)
    np.testing.assert_array_equal(measure(truth.select("force"), sensors, seed=3)["force"], first["force"])
    assert not np.any(measure(truth, sensors, seed=4).values == first.values)


def test_noise_comes_before_the_steps() -> None:
    truth = TimeSeries(np.zeros((5000, 1)), 1.0, (ANGLE,))
    seen = measure(truth, {"*": Sensor(bits=2, full_range=4.0, noise_std=1.0)})
    assert set(np.unique(seen.values)) > {-1.0, 0.0, 1.0}
    np.testing.assert_array_equal(seen.values, np.rint(seen.values))


def test_the_last_pattern_that_matches_counts_and_other_channels_are_only_sampled() -> None:
    truth = TimeSeries(np.arange(20.0).reshape(10, 2) + 0.3, 10.0, (ANGLE, FORCE), 1.0)
    whole = Sensor(bits=6, full_range=64.0)
    seen = measure(truth, {"*": whole, "force": Sensor()}, decimation=3)
    assert seen["motor_position"].tolist() == [0, 6, 12, 18]
    assert seen["force"].tolist() == truth["force"][::3].tolist()
    assert (seen.start_s, seen.channels) == (1.0, truth.channels)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Sensor(bits=0), "Sensor.bits: found 0"),
        (lambda: Sensor(full_range=0.0), "full_range"),
        (lambda: Sensor(noise=-1.0), "Sensor.noise: found -1.0"),
        (lambda: Sensor(noise=0.1, noise_std=0.1), "one of the two"),
        (lambda: AntiAlias(0), "cutoff"),
        (lambda: AntiAlias(1, "Hz"), "share or hz"),  # type: ignore[arg-type]
        (lambda: AntiAlias(kind="fir"), "butterworth or bessel"),  # type: ignore[arg-type]
        (lambda: AntiAlias(order=0), "order"),
        (lambda: measure(sine(1), {"forse": Sensor()}), "none that 'forse' names"),
        (lambda: measure(sine(1), decimation=0), "decimation: found 0"),
        (lambda: measure(sine(1), seed=-1), "seed"),
        (lambda: measure(sine(1), {"*": Sensor(anti_alias=AntiAlias(5000, "hz"))}), "less than 5000 Hz"),
        (lambda: measure(sine(1).with_values([[np.nan]])), "found nan"),
        (lambda: Sensor(noise="a"), "Sensor.noise: found 'a'"),  # type: ignore[arg-type]
        (lambda: Sensor(noise_std=[1]), r"Sensor.noise_std: found \[1\]"),  # type: ignore[arg-type]
        (lambda: Sensor(full_range="a"), "Sensor.full_range: found 'a'"),  # type: ignore[arg-type]
        (lambda: Sensor(bits=True), "Sensor.bits: found True"),
        (lambda: Sensor(saturates="no"), "Sensor.saturates: found 'no'"),  # type: ignore[arg-type]
        (lambda: Sensor(anti_alias=0.8), "Sensor.anti_alias: found 0.8"),  # type: ignore[arg-type]
        (lambda: AntiAlias("a"), "AntiAlias.cutoff: found 'a'"),  # type: ignore[arg-type]
        (lambda: AntiAlias(order=True), "AntiAlias.order: found True"),
        (lambda: measure(sine(1), {"*": 3}), r"sensors: found 3 for '\*'"),  # type: ignore[dict-item]
        (lambda: measure(sine(1), {3: Sensor()}), "sensors: found Sensor"),  # type: ignore[dict-item]
        (lambda: measure(sine(1), [Sensor()]), "expected a Sensor by pattern"),  # type: ignore[arg-type]
        (lambda: measure(sine(1), decimation=True), "decimation: found True"),
        (lambda: low(1e-9, 12), "found 1e-09 Hz, so low that rounding spoils the filter"),
        (lambda: low(1e-5, 12), "rounding spoils"),
        (lambda: low(1e-300, 1), "rounding spoils"),
    ],
)
def test_sensors_that_make_no_sense_are_refused(call: Any, message: str) -> None:
    with pytest.raises(SignalError, match=message):
        call()


@pytest.mark.parametrize("kind", ["butterworth", "bessel"])
@pytest.mark.parametrize("cutoff_hz", [1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.1])
@pytest.mark.parametrize("order", [1, 2, 5, 12])
def test_a_filter_of_any_low_cutoff_either_keeps_a_constant_or_is_refused(
    order: int, cutoff_hz: float, kind: str
) -> None:
    truth = TimeSeries(np.full((50, 1), 7.0), 1000.0, (ANGLE,))
    sensors = {"*": Sensor(anti_alias=AntiAlias(cutoff_hz, "hz", order, kind))}  # type: ignore[arg-type]
    if cutoff_hz >= 0.1:  # 1/10000 of the rate: rounding is amplified by its square, to 1e-8
        np.testing.assert_allclose(measure(truth, sensors).values, 7, rtol=1e-6)
        return
    try:
        seen = measure(truth, sensors).values
    except SignalError:
        return
    np.testing.assert_allclose(seen, 7, rtol=2e-3)  # a filter off by 1e-3 still passes
