"""A running spindle's harmonics are told from modes, and modes are not taken for harmonics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from armonic.errors import SignalError
from armonic.identification.harmonics import flags
from armonic.series import Channel, TimeSeries

RATE, SECONDS = 256.0, 120.0
MODES = ((17.0, 0.02), (41.0, 0.01), (73.0, 0.015))
SPINDLE_HZ = 29.0


def noisy_response(seed: int, modes: Any = MODES) -> NDArray[np.float64]:
    """Two sensors on oscillators that white noise drives: the exact discrete poles of each, in a random mix."""
    generator = np.random.default_rng(seed)
    samples = int(RATE * SECONDS)
    response = np.zeros((samples, 2))
    for freq_hz, damping in modes:
        mu = np.exp(2 * np.pi * freq_hz / RATE * (-damping + 1j * np.sqrt(1 - damping**2)))
        part = signal.lfilter([1], [1, -2 * mu.real, abs(mu) ** 2], generator.normal(size=samples + 2000))[2000:]
        response += np.outer(part / part.std(), generator.uniform(0.4, 1, 2))
    return response + 0.05 * generator.normal(size=response.shape)


def of(values: NDArray[np.float64]) -> TimeSeries:
    return TimeSeries(values, RATE, (Channel("tool.x", "acceleration"), Channel("tool.y", "acceleration")))


def test_in_100_runs_modes_that_noise_drives_are_not_flagged_and_sines_are() -> None:
    time = np.arange(int(RATE * SECONDS)) / RATE
    wrong = {"mode": 0, "sine": 0}
    for seed in range(100):
        phase = np.random.default_rng(1000 + seed).uniform(0, 6, 2)
        values = noisy_response(seed)
        for order, p in zip((1, 2), phase, strict=True):
            values += 0.5 * np.outer(np.sin(2 * np.pi * order * SPINDLE_HZ * time + p), [1.0, 0.7])
        *modes, first, second = flags(of(values), [f for f, _ in MODES] + [SPINDLE_HZ, 2 * SPINDLE_HZ])
        wrong["mode"] += any(flag.is_harmonic for flag in modes)
        wrong["sine"] += not (first.is_harmonic and second.is_harmonic)
    assert wrong["mode"] <= 5
    assert wrong["sine"] <= 5


def test_kurtosis_is_that_of_a_sine_and_of_a_normal_law() -> None:
    time = np.arange(int(RATE * SECONDS)) / RATE
    values = 0.01 * np.random.default_rng(0).normal(size=(time.size, 2))
    values[:, 0] += np.sin(2 * np.pi * 30 * time)
    sine, noise = flags(of(values), [30.0, 70.0])
    assert sine.kurtosis == pytest.approx(1.5, abs=1e-3)  # noise of 1e-4 of the energy, and less in the band
    # 420 independent amplitudes: 3/√420 = 0.15, and three of that.
    assert noise.kurtosis == pytest.approx(3, abs=0.45)
    assert (sine.is_harmonic, noise.is_harmonic) == (True, False)
    assert "like a sine" in sine.reason
    assert "like noise" in noise.reason


def test_multiples_of_a_known_speed_are_flagged_within_the_tolerance() -> None:
    series = of(noisy_response(0))
    found = flags(series, [29.0, 58.2, 59.0, 17.0, 14.5], SPINDLE_HZ)
    assert [flag.is_harmonic for flag in found] == [True, True, False, False, False]
    assert [flag.order for flag in found] == [1, 2, None, None, None]
    assert "2 x 29 Hz" in found[1].reason


def test_a_damped_mode_on_a_multiple_of_the_speed_is_a_mode() -> None:
    sharp, damped = flags(of(noisy_response(0)), [58.0, 58.0], SPINDLE_HZ, damping_ratio=[0.0001, 0.02])
    assert (sharp.is_harmonic, damped.is_harmonic) == (True, False)
    assert "damped by 2 %" in damped.reason


def test_a_record_too_short_to_tell_flags_nothing_and_says_so() -> None:
    time = np.arange(256) / RATE
    values = np.outer(np.sin(2 * np.pi * 30 * time), [1.0, 1.0])
    (flag,) = flags(of(values), 30.0)
    assert not flag.is_harmonic
    assert np.isnan(flag.kurtosis)
    assert "too short" in flag.reason


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0],), "freq_hz: found 0 Hz"),
        (([128.0],), "between 0 and 128 Hz"),
        (([10.0], -1.0), "spindle_hz"),
    ],
)
def test_frequencies_beyond_the_record_are_refused(arguments: Any, message: str) -> None:
    with pytest.raises(SignalError, match=message):
        flags(of(np.ones((500, 2))), *arguments)


def test_damping_of_another_length_is_refused() -> None:
    with pytest.raises(SignalError, match="damping_ratio"):
        flags(of(np.ones((500, 2))), [10.0, 20.0], damping_ratio=[0.1])
