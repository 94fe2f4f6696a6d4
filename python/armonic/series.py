"""Time series: evenly sampled channels that say what each of them is, measured or simulated."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armonic.errors import SignalError

Array = NDArray[np.float64]

Quantity: TypeAlias = Literal[
    "joint_position",
    "joint_velocity",
    "joint_acceleration",
    "motor_position",
    "motor_velocity",
    "motor_torque",
    "shaft_torque",
    "acceleration",
    "velocity",
    "displacement",
    "force",
    "energy",
    "power",
    "signal",
]
"""What a channel holds; "shaft_torque" is that of any spring, "signal" is whatever is not known."""

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""Every quantity a channel may hold."""

ROBOT_FILE = "robot_yaml"
"""The note that holds a whole robot file: too long for a table."""
FREE_FROM = "free_from_s"
"""The note that says from when on forces no longer change, in s of the series."""
ENDED = "ended"
"""The note of a run that did not come to its end, and why."""
UNEVEN = 0.02
"""A sample may lie this share of a step beside its place: files round their times."""


@dataclass(frozen=True)
class Channel:
    """What one column of a time series is.

    Args:
        name: where it is taken: "link_2.z", "tool.x".
        quantity: what it is, one of `QUANTITIES`.
        unit: of its values, such as "rad" or "m/s²"; empty if it has none or none is known.

    Raises:
        SignalError: a part is no text in one line, or the quantity is unknown.
    """

    name: str
    quantity: Quantity
    unit: str = ""

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            near = difflib.get_close_matches(str(self.quantity), QUANTITIES, n=1, cutoff=0.5)
            raise SignalError(
                "Channel.quantity",
                found=repr(self.quantity),
                expected=f"one of {', '.join(QUANTITIES)}",
                hint=f"Did you mean {near[0]}?" if near else None,
            )
        for part, text in (("name", self.name), ("unit", self.unit)):
            fits = isinstance(text, str) and text.isprintable() and text == text.strip()
            if not fits or (part == "name" and not text):
                raise SignalError(
                    f"Channel.{part}", found=repr(text), expected="text in one line, without outer blanks"
                )

    @property
    def label(self) -> str:
        """Quantity and name as one word: "motor_position:link_2.z"."""
        return f"{self.quantity}:{self.name}"


@dataclass(frozen=True, eq=False, repr=False)
class TimeSeries:
    """Channels sampled at one rate; immutable.

    Values are copied in C order and made read-only. They may be NaN or infinite, for a damaged measurement still has
    to be read and looked at; `finite` refuses them. Two instances are equal only if they are the same object.

    Args:
        values: (samples, channels), each in the unit of its channel.
        sample_rate_hz: samples per second.
        channels: one per column, with different labels.
        start_s: the time of the first sample in s.
        notes: free text on where the series is from, such as robot and posture; files keep it.

    Raises:
        SignalError: shapes do not fit, a label stands twice, or the rate or start is no such number.
    """

    values: Array
    sample_rate_hz: float
    channels: tuple[Channel, ...]
    start_s: float = 0.0
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rate = _number("TimeSeries.sample_rate_hz", self.sample_rate_hz, "a positive number of Hz")
        if rate <= 0:
            found = f"{rate:g} Hz"
            raise SignalError("TimeSeries.sample_rate_hz", found=found, expected="a positive number of Hz")
        object.__setattr__(self, "sample_rate_hz", rate)
        object.__setattr__(self, "start_s", _number("TimeSeries.start_s", self.start_s, "a number of seconds"))
        object.__setattr__(self, "channels", _checked_channels(self.channels))
        object.__setattr__(self, "values", _samples(self.values, len(self.channels)))
        notes = dict(self.notes) if isinstance(self.notes, Mapping) else {"": None}
        if not all(isinstance(text, str) for pair in notes.items() for text in pair):
            raise SignalError("TimeSeries.notes", found=f"{self.notes!r:.60}", expected="text by name, both str")
        object.__setattr__(self, "notes", MappingProxyType(notes))

    @classmethod
    def from_samples(
        cls,
        time_s: ArrayLike,
        values: ArrayLike,
        channels: Iterable[Channel],
        *,
        notes: Mapping[str, str] | None = None,
    ) -> TimeSeries:
        """A series whose rate follows from the times of its samples.

        Args:
            time_s: (samples,) in s, increasing in even steps up to a rounding of 2 % of a step; two at least.
            values: (samples, channels), each in the unit of its channel.
            channels: one per column.
            notes: free text.

        Raises:
            SignalError: a time is not finite or not after the one before, the steps are uneven, or the rest
                does not fit.
        """
        time = np.asarray(time_s)
        start_s, rate = even_sampling(time)
        table = np.asarray(values)
        if table.ndim == 2 and table.shape[0] != time.size:
            raise SignalError("values", found=f"{table.shape[0]} samples", expected=f"{time.size}, one per time")
        return cls(table, rate, tuple(channels), start_s, notes or {})

    def __len__(self) -> int:
        """How many samples."""
        return int(self.values.shape[0])

    def __repr__(self) -> str:
        labels = [channel.label for channel in self.channels]
        listed = ", ".join(labels if len(labels) < 5 else [*labels[:3], "…", labels[-1]])
        return (
            f"TimeSeries({len(self)} samples at {self.sample_rate_hz:g} Hz from {self.start_s:g} s, "
            f"{len(labels)} channels: {listed})"
        )

    def __reduce__(self) -> tuple[object, ...]:
        """Made again from its parts, so that it crosses to another process."""
        return type(self), (self.values, self.sample_rate_hz, self.channels, self.start_s, dict(self.notes))

    @property
    def time_s(self) -> Array:
        """(samples,) time of each sample in s."""
        return self.start_s + np.arange(len(self)) / self.sample_rate_hz

    @property
    def duration_s(self) -> float:
        """From the first sample to the last, in s."""
        return (len(self) - 1) / self.sample_rate_hz

    @property
    def labels(self) -> tuple[str, ...]:
        """The labels of all channels, in order."""
        return tuple(channel.label for channel in self.channels)

    def matching(self, *patterns: str) -> tuple[int, ...]:
        """The columns that some patterns name, in the order of the series.

        Args:
            patterns: each a quantity, a name, a label, or a shell pattern over labels or names such as "motor_*:*".

        Raises:
            SignalError: a pattern matches no channel.
        """
        found: set[int] = set()
        for pattern in patterns:
            of_this = _matches(pattern, self.channels)
            if not of_this:
                raise SignalError(
                    "channels",
                    found=f"none that {pattern!r} names",
                    expected=f"some of {_listed(self.labels)}",
                    hint=_near(pattern, self.channels),
                )
            found.update(of_this)
        return tuple(sorted(found))

    def select(self, *patterns: str) -> TimeSeries:
        """The channels that some patterns name, in the order of the series.

        Args:
            patterns: each a quantity, a name, a label, or a shell pattern over labels or names such as "motor_*:*".

        Raises:
            SignalError: there is no pattern, or one matches no channel.
        """
        if not patterns:
            raise SignalError("channels", found="no pattern", expected=f"some of {_listed(self.labels)}")
        columns = list(self.matching(*patterns))
        return replace(self, values=self.values[:, columns], channels=tuple(self.channels[c] for c in columns))

    def index(self, pattern: str) -> int:
        """The column of the one channel that a pattern names.

        Raises:
            SignalError: it names none or several.
        """
        columns = self.matching(pattern)
        if len(columns) > 1:
            listed = _listed([self.labels[column] for column in columns])
            raise SignalError("channels", found=f"{pattern!r} for {listed}", expected="the name of one channel")
        return columns[0]

    def __getitem__(self, pattern: str) -> Array:
        """(samples,) of the one channel that a pattern names.

        Raises:
            SignalError: it names none or several.
        """
        if not isinstance(pattern, str):
            hint = "Samples by number are in series.values."
            raise SignalError("channels", found=repr(pattern), expected="the name of a channel", hint=hint)
        return self.values[:, self.index(pattern)]

    def window(self, start_s: float | None = None, stop_s: float | None = None) -> TimeSeries:
        """The samples from `start_s` to `stop_s`, both included; None leaves that end where it is.

        Raises:
            SignalError: there is no sample in between.
        """
        slack = 1e-6  # of a step: the time of a sample is known up to rounding
        first, last = 0, len(self) - 1
        if start_s is not None:
            first = max(first, int(np.ceil(_steps(self, start_s, "start_s") - slack)))
        if stop_s is not None:
            last = min(last, int(np.floor(_steps(self, stop_s, "stop_s") + slack)))
        if first > last:
            raise SignalError(
                "window",
                found=f"no sample from {_end(start_s, 'the start')} to {_end(stop_s, 'the end')}",
                expected=f"times within {self.start_s:g} to {self.start_s + self.duration_s:g} s",
            )
        start = self.start_s + first / self.sample_rate_hz
        return replace(self, values=self.values[first : last + 1], start_s=start)

    def with_values(
        self, values: ArrayLike, *, sample_rate_hz: float | None = None, start_s: float | None = None
    ) -> TimeSeries:
        """Other values of the same channels.

        Args:
            values: (samples, channels); as many samples as wanted.
            sample_rate_hz: None keeps it.
            start_s: None keeps it.

        Raises:
            SignalError: as when the series is made.
        """
        rate = self.sample_rate_hz if sample_rate_hz is None else sample_rate_hz
        start = self.start_s if start_s is None else start_s
        return TimeSeries(np.asarray(values), rate, self.channels, start, self.notes)

    def finite(self) -> Array:
        """The values, (samples, channels), all of them finite.

        Raises:
            SignalError: one is not; it names the first in time.
        """
        good = np.isfinite(self.values)
        if not good.all():
            sample, column = (int(k) for k in np.unravel_index(np.argmin(good), good.shape))
            bad = int(good.size - np.count_nonzero(good))
            raise SignalError(
                self.labels[column],
                found=f"{self.values[sample, column]} at {self.time_s[sample]:.9g} s (sample {sample}, {bad} in all)",
                expected="finite values",
                hint="Cut it out with series.window(start_s, stop_s), or leave the channel out with series.select.",
            )
        return self.values


def even_sampling(time_s: ArrayLike) -> tuple[float, float]:
    """The first of some times and the rate at which they follow each other, in s and Hz.

    Args:
        time_s: (samples,) in s, increasing in even steps up to a rounding of 2 % of a step; two at least.

    Raises:
        SignalError: there are too few, one is not finite or not after the one before, or the steps are uneven.
    """
    raw = np.asarray(time_s)
    if raw.ndim != 1 or raw.size < 2 or raw.dtype.kind not in "fiu":
        found = f"shape {raw.shape} of {raw.dtype}"
        raise SignalError("time_s", found=found, expected="the times of two samples or more, as one row of numbers")
    time = raw.astype(np.float64)
    if not np.isfinite(time).all():
        k = int(np.argmin(np.isfinite(time)))
        raise SignalError("time_s", found=f"{time[k]} at index {k}", expected="finite times in s")
    rising = time[1:] > time[:-1]
    if not rising.all():
        k = int(np.argmin(rising)) + 1
        found = f"{time[k]:.9g} s at index {k} after {time[k - 1]:.9g} s"
        raise SignalError("time_s", found=found, expected="times that increase")
    step = (time[-1] - time[0]) / (time.size - 1)
    off = np.abs(time - (time[0] + step * np.arange(time.size)))
    rounding = float(np.finfo(raw.dtype).eps) * np.abs(time).max() if raw.dtype.kind == "f" else 0.0
    if off.max() > UNEVEN * step + rounding:
        steps = np.diff(time)
        k = int(np.argmax(np.abs(steps - np.median(steps))))
        raise SignalError(
            "time_s",
            found=f"uneven steps: {steps[k]:.6g} s after index {k}, {np.median(steps):.6g} s as a rule",
            expected="evenly sampled times",
            hint="Interpolate onto even times first, or fill in the samples that were lost.",
        )
    return float(time[0]), float(f"{1 / step:.12g}")  # the last digits are rounding: 1000 Hz, not 999.9999999999999


def _number(where: str, value: Any, expected: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise SignalError(where, found=f"{value!r:.60}", expected=expected) from error
    if not np.isfinite(number):
        raise SignalError(where, found=repr(number), expected=expected)
    return number


def _checked_channels(channels: Any) -> tuple[Channel, ...]:
    expected = "a tuple of Channel, at least one"
    if isinstance(channels, (str, bytes)) or not isinstance(channels, Iterable):
        raise SignalError("TimeSeries.channels", found=f"{channels!r:.60}", expected=expected)
    given = tuple(channels)
    if not given or not all(isinstance(channel, Channel) for channel in given):
        raise SignalError("TimeSeries.channels", found=f"{given!r:.60}", expected=expected)
    labels = [channel.label for channel in given]
    if twice := [label for label in dict.fromkeys(labels) if labels.count(label) > 1]:
        raise SignalError("TimeSeries.channels", found=f"{twice[0]} twice", expected="channels with different labels")
    return given


def _samples(values: Any, channels: int) -> Array:
    expected = f"real numbers of shape (samples, {channels}), at least one sample"
    try:
        if np.iscomplexobj(values):
            raise TypeError("complex numbers")
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        found = f"{type(values).__name__} ({error})"
        raise SignalError("TimeSeries.values", found=found, expected=expected) from error
    if array.ndim != 2 or array.shape[1] != channels or array.shape[0] < 1:
        raise SignalError("TimeSeries.values", found=f"shape {array.shape}", expected=expected)
    array.setflags(write=False)
    return array


def _matches(pattern: str, channels: tuple[Channel, ...]) -> list[int]:
    exact = [k for k, c in enumerate(channels) if pattern in (c.label, c.name, c.quantity)]
    return exact or [k for k, c in enumerate(channels) if fnmatchcase(c.label, pattern) or fnmatchcase(c.name, pattern)]


def _near(pattern: str, channels: tuple[Channel, ...]) -> str | None:
    known = list(dict.fromkeys(word for c in channels for word in (c.quantity, c.name, c.label)))
    near = difflib.get_close_matches(str(pattern)[:80], known, n=1, cutoff=0.5)
    return f"Did you mean {near[0]}?" if near else None


def _listed(labels: Iterable[str]) -> str:
    shown = list(labels)
    return ", ".join(shown) if len(shown) <= 12 else f"{', '.join(shown[:12])} and {len(shown) - 12} more"


def _steps(series: TimeSeries, time_s: float, where: str) -> float:
    """How many steps a time lies after the first sample, within one step beyond either end."""
    steps = (float(time_s) - series.start_s) * series.sample_rate_hz
    if np.isnan(steps):
        raise SignalError(where, found="NaN", expected="a number of seconds")
    return float(np.clip(steps, -1, len(series)))


def _end(time_s: float | None, otherwise: str) -> str:
    return otherwise if time_s is None else f"{time_s:g} s"
