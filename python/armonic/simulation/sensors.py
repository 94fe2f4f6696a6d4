"""What sensors make of a true signal: anti-alias filter, coarser sampling, noise and steps, in that order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from armonic.errors import SignalError
from armonic.series import TimeSeries
from armonic.simulation.control import is_number

if TYPE_CHECKING:
    from armonic.robot import Robot

Array = NDArray[np.float64]

BITS_MAX = 52
"""Finer steps than that a double cannot hold."""
SPOILT = 1e-3
"""A filter may change what is constant by this share, by rounding."""


@dataclass(frozen=True)
class AntiAlias:
    """A low-pass filter ahead of the sampling: causal, so that it delays, as the analog one of a real sensor does.

    Args:
        cutoff: where it passes 1/√2 of the amplitude: a share of the Nyquist frequency after sampling, or Hz.
        unit: what `cutoff` counts, "share" or "hz".
        order: of the filter, 1 to 12.
        kind: "butterworth" is flattest in amplitude; "bessel" delays all frequencies it passes alike.

    Raises:
        SignalError: a number or word is none of those.
    """

    cutoff: float = 0.8
    unit: Literal["share", "hz"] = "share"
    order: int = 4
    kind: Literal["butterworth", "bessel"] = "butterworth"

    def __post_init__(self) -> None:
        _positive("AntiAlias.cutoff", self.cutoff)
        if self.unit not in ("share", "hz"):
            raise SignalError("AntiAlias.unit", found=repr(self.unit), expected="share or hz")
        if self.kind not in ("butterworth", "bessel"):
            raise SignalError("AntiAlias.kind", found=repr(self.kind), expected="butterworth or bessel")
        if not _is_whole(self.order, 1, 12):
            raise SignalError("AntiAlias.order", found=repr(self.order), expected="a whole number from 1 to 12")


@dataclass(frozen=True)
class Sensor:
    """How one sort of channel is measured.

    Args:
        bits: values come in steps of full_range / 2^bits, rounded to the nearest; None leaves them as they are.
        full_range: what all steps together span, in the unit of the channel; one turn in rad of an encoder.
        saturates: values stop at ± half the range, as those of an analog converter do; an encoder counts on.
        noise: standard deviation of white noise as a share of that of the channel itself (0.001 is 0.1 %).
        noise_std: standard deviation of white noise in the unit of the channel, instead of `noise`.
        anti_alias: the filter ahead of the sampling; None samples at once, as an encoder does.

    Raises:
        SignalError: a number is out of its range, or there are two sorts of noise.
    """

    bits: int | None = None
    full_range: float = 2 * math.pi
    saturates: bool = False
    noise: float | None = None
    noise_std: float | None = None
    anti_alias: AntiAlias | None = None

    def __post_init__(self) -> None:
        if self.bits is not None and not _is_whole(self.bits, 1, BITS_MAX):
            raise SignalError("Sensor.bits", found=repr(self.bits), expected=f"a whole number from 1 to {BITS_MAX}")
        _positive("Sensor.full_range", self.full_range)
        for name, value in (("noise", self.noise), ("noise_std", self.noise_std)):
            if value is not None and not (is_number(value) and value >= 0):
                raise SignalError(f"Sensor.{name}", found=repr(value), expected="a number of at least 0")
        if self.noise is not None and self.noise_std is not None:
            raise SignalError("Sensor.noise_std", found="noise as well", expected="one of the two")
        if not isinstance(self.saturates, bool):
            raise SignalError("Sensor.saturates", found=f"{self.saturates!r:.60}", expected="true or false")
        if not (self.anti_alias is None or isinstance(self.anti_alias, AntiAlias)):
            found = f"{self.anti_alias!r:.60}"
            raise SignalError("Sensor.anti_alias", found=found, expected="an AntiAlias, or None")

    @property
    def step(self) -> float:
        """One step of the values, in the unit of the channel; zero if they have none."""
        return 0.0 if self.bits is None else self.full_range / 2**self.bits


def encoders(robot: Robot, bits: int) -> dict[str, Sensor]:
    """The encoders of a robot's motors, for `measure`: each sits on its rotor, ahead of the gear.

    A turn of the rotor has 2^bits steps, so that the angle after the gear, which motor positions are, has steps smaller
    by the gear ratio.

    Args:
        robot: with drives.
        bits: of every encoder, 1 to 52.

    Raises:
        SignalError: the robot has no motor, or the bits are out of their range.
    """
    drives = robot.drives
    if not drives.names:
        raise SignalError(robot.name, found="no motor", expected="a robot with drives")
    turns = zip(drives.names, (2 * math.pi / drives.gear_ratio).tolist(), strict=True)
    return {f"motor_position:{name}": Sensor(bits=bits, full_range=turn) for name, turn in turns}


def measure(
    series: TimeSeries, sensors: Mapping[str, Sensor] | None = None, *, decimation: int = 1, seed: int = 0
) -> TimeSeries:
    """A true signal as sensors see it: filtered, then sampled more coarsely, then with noise, then in steps.

    The truth has to be sampled finely, for what lies above its own Nyquist frequency is not in it. Noise depends on
    the seed and the label of the channel only, so that a channel has the same whatever is measured beside it.

    Args:
        series: the truth.
        sensors: by pattern, as in `TimeSeries.select`; where several match a channel, the last counts. Channels that
            none matches are sampled only.
        decimation: every so many samples one is taken, from the first on.
        seed: of the noise.

    Returns:
        The same channels at sample_rate_hz / decimation.

    Raises:
        SignalError: a pattern matches nothing or has no Sensor, a value is not finite, or a cut-off lies beyond the
            truth's Nyquist frequency, or so far below it that rounding spoils the filter.
    """
    if not _is_whole(decimation, 1, len(series)):
        expected = f"a whole number from 1 to {len(series)}"
        raise SignalError("decimation", found=repr(decimation), expected=expected)
    if not _is_whole(seed, 0, math.inf):
        raise SignalError("seed", found=repr(seed), expected="a whole number of at least 0")
    of_column = {column: sensor for pattern, sensor in _checked(sensors).items() for column in series.matching(pattern)}
    rate = series.sample_rate_hz / decimation
    truth = series.finite()
    values = np.array(truth[::decimation])
    for column, sensor in of_column.items():
        if sensor.anti_alias is not None:
            values[:, column] = _filtered(truth[:, column], series.sample_rate_hz, rate, sensor.anti_alias)[
                ::decimation
            ]
        std = sensor.noise_std if sensor.noise is None else sensor.noise * float(values[:, column].std())
        if std:
            generator = np.random.default_rng([seed, *series.labels[column].encode()])
            values[:, column] += generator.normal(0.0, std, len(values))
        if sensor.bits is not None:
            values[:, column] = _in_steps(values[:, column], sensor)
    return series.with_values(values, sample_rate_hz=rate)


def _checked(sensors: Any) -> Mapping[str, Sensor]:
    if sensors is None:
        return {}
    expected = 'a Sensor by pattern, such as {"motor_position": Sensor(bits=17)}'
    if not isinstance(sensors, Mapping):
        raise SignalError("sensors", found=f"{sensors!r:.60}", expected=expected)
    for pattern, sensor in sensors.items():
        if not (isinstance(pattern, str) and isinstance(sensor, Sensor)):
            raise SignalError("sensors", found=f"{sensor!r:.60} for {pattern!r:.60}", expected=expected)
    return sensors


def _filtered(values: Array, rate: float, new_rate: float, wanted: AntiAlias) -> Array:
    from scipy import signal

    cutoff_hz = wanted.cutoff * (new_rate / 2 if wanted.unit == "share" else 1.0)
    if not cutoff_hz < rate / 2:
        raise SignalError(
            "AntiAlias.cutoff",
            found=f"{cutoff_hz:g} Hz",
            expected=f"less than {rate / 2:g} Hz, the Nyquist frequency of the truth",
            hint="Simulate with a shorter output step and sample more coarsely with decimation=.",
        )
    sos: Any
    if wanted.kind == "butterworth":
        sos = signal.butter(wanted.order, cutoff_hz, fs=rate, output="sos")
    else:
        sos = signal.bessel(wanted.order, cutoff_hz, fs=rate, output="sos", norm="mag")
    sums = sos.reshape(-1, 2, 3).sum(axis=2)
    passed = np.prod(sums[:, 0] / np.where(sums[:, 1] == 0, np.inf, sums[:, 1]))  # of a constant: all of it, if exact
    if not abs(passed - 1) <= SPOILT:
        raise SignalError(
            "AntiAlias.cutoff",
            found=f"{cutoff_hz:g} Hz, so low that rounding spoils the filter",
            expected=f"a larger share of {rate / 2:g} Hz, the Nyquist frequency of the truth",
        )
    at_rest = signal.sosfilt_zi(sos) * values[0]  # as if the first value had stood there for ever
    filtered, _ = signal.sosfilt(sos, values, zi=at_rest)
    return np.asarray(filtered, np.float64)


def _in_steps(values: Array, sensor: Sensor) -> Array:
    counts = np.rint(values / sensor.step)
    if sensor.saturates:
        half = 2.0 ** ((sensor.bits or 1) - 1)
        counts = np.clip(counts, -half, half - 1)
    return np.asarray(counts * sensor.step, np.float64)


def _is_whole(value: object, least: float, most: float) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= most


def _positive(where: str, value: float) -> None:
    if not (is_number(value) and value > 0):
        raise SignalError(where, found=repr(value), expected="a positive number")
