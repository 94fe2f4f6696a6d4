"""What in a record is a force and what a response, where they act, and their factors to SI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError, SignalError
from armonic.frf_set import split_label
from armonic.series import TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Mask: TypeAlias = NDArray[np.bool_]

POWERS = {"displacement": 0, "velocity": 1, "acceleration": 2}
"""Quantities of a response, and the power of s that leads to each from a displacement."""
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180}
_GRAVITY = {"g": 9.80665, "gn": 9.80665, "mg": 9.80665e-3}
_FORCES = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216152605}
_MOMENTS = {"Nm": 1.0, "Nmm": 1e-3, "kNm": 1e3}
_NEAR = 0.995
"""Of its full scale a converter reaches all but one step, and of few bits a step is large."""
_RUN = 3
"""Two equal samples stand on top of any symmetric pulse."""
_EDGE_STEPS = 4.0
"""A parabola that stays three samples within one step is less than three steps lower beside them."""
_FEWEST_STEPS = 256
"""In the span of a signal: no converter is coarser, but a short pulse alone has few values."""
_AWAY = 0.1
"""A signal at rest stands like a table, too: what is clipped lies farther from the median, as a share of the span."""
_PLAIN = str.maketrans({"²": "2", "^": None, "·": None, "*": None, " ": None, "µ": "u", "μ": "u"})


@dataclass(frozen=True, eq=False)
class Roles:
    """The channels of a record by what they are for.

    Attributes:
        forces: columns of the forces.
        inputs: their degrees of freedom, PLACE.AXIS.
        responses: columns of the responses.
        outputs: their degrees of freedom.
        powers: of each response, 0 for a displacement, 1 for a velocity, 2 for an acceleration.
        factors: of every column of the record to SI, 1 where a channel is neither.
        unlabelled: labels of those whose unit is not stated.
        ignored: labels of channels that are neither force nor response.
    """

    forces: tuple[int, ...]
    inputs: tuple[str, ...]
    responses: tuple[int, ...]
    outputs: tuple[str, ...]
    powers: tuple[int, ...]
    factors: Array
    unlabelled: tuple[str, ...]
    ignored: tuple[str, ...]


def as_records(given: TimeSeries | Sequence[TimeSeries]) -> tuple[TimeSeries, ...]:
    """One record or several as a tuple, all of the same rate.

    Raises:
        SignalError: there is none, one is no `TimeSeries`, or their rates differ.
    """
    records = (given,) if isinstance(given, TimeSeries) else tuple(given)
    if not records:
        raise SignalError("records", found="none", expected="one TimeSeries or several")
    for k, record in enumerate(records):
        if not isinstance(record, TimeSeries):
            raise SignalError(f"records[{k}]", found=f"a {type(record).__name__}", expected="a TimeSeries")
    rate = records[0].sample_rate_hz
    for k, record in enumerate(records):
        # Files state the step rather than the rate, in single precision.
        if abs(record.sample_rate_hz / rate - 1) > 1e-6:
            raise SignalError(
                f"records[{k}]",
                found=f"different resolutions: {record.sample_rate_hz:g} Hz, after {rate:g} Hz in records[0]",
                expected="records of one sampling rate",
                hint="Estimate each rate by itself, or bring the records to one rate first (decimate).",
            )
    return records


def roles(record: TimeSeries, number: int = 0) -> Roles:
    """Which channels of a record are forces and which responses: accelerations, velocities, displacements.

    Args:
        record: with channels named PLACE.AXIS.
        number: of the record in the set, for messages.

    Raises:
        SignalError: there is no force or no response, a name is not PLACE.AXIS, a unit is unknown, or one degree of
            freedom is measured twice.
    """
    where = f"records[{number}]"
    forces = [k for k, channel in enumerate(record.channels) if channel.quantity == "force"]
    responses = [k for k, channel in enumerate(record.channels) if channel.quantity in POWERS]
    listed = _short(record.labels)
    if not forces:
        raise SignalError(
            where,
            found=f"no force among {listed}",
            expected="a channel of force",
            hint="Say which one it is with a channel map; without one only output-only identification is possible.",
        )
    if not responses:
        raise SignalError(
            where,
            found=f"no response among {listed}",
            expected="a channel of acceleration, velocity or displacement",
            hint="Say what the channels are with a channel map.",
        )
    names = [channel.name for channel in record.channels]
    for k in (*forces, *responses):
        try:
            split_label(names[k])
        except FrfError as error:
            expected = "a name of the form PLACE.AXIS, such as sensor.x"
            raise SignalError(f"{where}, {record.labels[k]}", found=repr(names[k]), expected=expected) from error
    outputs = tuple(names[k] for k in responses)
    for k, name in enumerate(outputs):
        if name in outputs[:k]:
            both = " and ".join(record.labels[c] for c in responses if names[c] == name)
            expected = "one response for a degree of freedom"
            raise SignalError(where, found=both, expected=expected, hint="Leave one out with record.select.")
    factors = np.ones(len(names))
    for k in (*forces, *responses):
        factors[k] = _factor(record, k, where)
    used = {*forces, *responses}
    return Roles(
        forces=tuple(forces),
        inputs=tuple(names[k] for k in forces),
        responses=tuple(responses),
        outputs=outputs,
        powers=tuple(POWERS[record.channels[k].quantity] for k in responses),
        factors=factors,
        unlabelled=tuple(record.labels[k] for k in sorted(used) if not record.channels[k].unit),
        ignored=tuple(label for k, label in enumerate(record.labels) if k not in used),
    )


def full_scales(
    records: Sequence[TimeSeries], given: object, where: str = "full_scale"
) -> tuple[dict[int, float], ...]:
    """The stated full scale of channels, per record by column, in the unit of the channel.

    Args:
        records: all of them.
        given: full scale by pattern, as in `TimeSeries.select`; None for none.
        where: name of the argument, for messages.

    Raises:
        SignalError: it is no mapping of positive numbers, or a pattern matches no channel of any record.
    """
    found: tuple[dict[int, float], ...] = tuple({} for _ in records)
    if given is None:
        return found
    if not hasattr(given, "items"):
        expected = 'a number by channel, such as {"force:sensor.x": 500}'
        raise SignalError(where, found=f"{given!r:.60}", expected=expected)
    for pattern, value in given.items():
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = np.nan
        if not (np.isfinite(number) and number > 0):
            raise SignalError(f"{where}[{pattern!r}]", found=f"{value!r:.60}", expected="a positive number")
        matched, refusal = False, None
        for record, scales in zip(records, found, strict=True):
            try:
                columns = record.matching(pattern)
            except SignalError as error:  # a roving channel is in some of the records only
                refusal = error
                continue
            matched = True
            scales.update(dict.fromkeys(columns, number))
        if not matched and refusal is not None:
            raise SignalError(f"{where}[{pattern!r}]", found=refusal.found, expected=refusal.expected)
    return found


def overloaded(values: Array, full_scale: float | None = None) -> Mask:
    """Where a signal is clipped, (samples,).

    With a full scale, where it comes within 0.5 % of it. Without one, where three or more equal samples stand at the
    record's maximum or minimum like a table, away from where it rests: the signal falls off by more than four of its
    smallest steps on either side, which the rounded top of a slow vibration does not.

    Args:
        values: (samples,) as they were recorded; NaN is not looked at.
        full_scale: of the channel, in its unit.
    """
    clipped = np.zeros(values.shape, bool)
    if full_scale is not None:
        return np.asarray(np.abs(np.nan_to_num(values)) >= _NEAR * full_scale)
    finite = values[np.isfinite(values)]
    if finite.size < _RUN or np.ptp(finite) == 0:
        return clipped
    rest, span = float(np.median(finite)), float(np.ptp(finite))
    smallest = min(float(np.diff(np.unique(finite)).min()), span / _FEWEST_STEPS)  # of a converter, its step
    for extreme in (finite.max(), finite.min()):
        if abs(extreme - rest) < _AWAY * span:
            continue
        at = np.flatnonzero(values == extreme)
        runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        for run in runs:
            if len(run) < _RUN:
                continue
            beside = [values[k] for k in (run[0] - 1, run[-1] + 1) if 0 <= k < len(values) and np.isfinite(values[k])]
            if beside and max(abs(extreme - side) for side in beside) > _EDGE_STEPS * smallest:
                clipped[run] = True
    return clipped


def _factor(record: TimeSeries, column: int, where: str) -> float:
    """What the values of a channel are multiplied by to be SI."""
    channel = record.channels[column]
    turning = split_label(channel.name)[1].startswith("r")
    unit = channel.unit.translate(_PLAIN)
    if not unit:
        return 1.0
    if channel.quantity == "force":
        known = _MOMENTS if turning else _FORCES
    else:
        per = ("", "/s", "/s2")[POWERS[channel.quantity]]
        known = {f"{name}{per}": factor for name, factor in (_ANGLES if turning else _LENGTHS).items()}
        if channel.quantity == "acceleration" and not turning:
            known |= _GRAVITY
    if unit not in known:
        place, expected = f"{where}, {record.labels[column]}", f"one of {', '.join(known)}"
        raise SignalError(place, found=f"the unit {channel.unit!r}", expected=expected)
    return known[unit]


def _short(labels: Sequence[str]) -> str:
    return ", ".join(labels) if len(labels) < 9 else f"{', '.join(labels[:8])} and {len(labels) - 8} more"
