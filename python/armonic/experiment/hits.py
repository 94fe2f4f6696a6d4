"""The hits of a tap test: found in the force, and each one judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.contacts import at_rest, contacts, second_pulses
from armonic.experiment.signals import overloaded, roles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.series import TimeSeries

    Array: TypeAlias = NDArray[np.float64]

UNSETTLED = 0.1
"""A response that swings before a hit by more than this share of what it does after it belongs to the hit before."""
LEAST_AFTER = 8
"""Samples that must follow a contact."""


@dataclass(frozen=True)
class Hit:
    """One hit of the hammer.

    Attributes:
        record: index of its record.
        force: degree of freedom that was hit, "sensor.x".
        first: sample at which the contact begins.
        last: its last sample.
        stop: sample before which the next hit or the end of the record comes.
        start_s: time of `first`, in the record's own time.
        duration_s: of the contact.
        peak_n: greatest force with its sign, N.
        used: whether it makes frequency responses.
        reason: why not; empty if it does.
    """

    record: int
    force: str
    first: int
    last: int
    stop: int
    start_s: float
    duration_s: float
    peak_n: float
    used: bool
    reason: str


def find_hits(
    record: TimeSeries,
    *,
    number: int = 0,
    trigger: float = 0.1,
    double_hit: float = 0.05,
    full_scale: dict[int, float] | None = None,
) -> tuple[Hit, ...]:
    """The hits in a record, in order of time.

    Args:
        record: channels of force and response named PLACE.AXIS.
        number: of the record in its set.
        trigger: share of the record's largest force that a hit exceeds.
        double_hit: share of a hit's force from which on a second pulse makes it a double hit.
        full_scale: of channels by column, in their units; without one, clipping is seen by its flat tops.

    Raises:
        SignalError: no force or response among the channels, or no hit in the force.
    """
    for name, share in (("trigger", trigger), ("double_hit", double_hit)):
        if not 0 < share < 1:
            raise SignalError(name, found=repr(share), expected="a share between 0 and 1")
    known, rate, scales = roles(record, number), record.sample_rate_hz, full_scale or {}
    clipped = {c: overloaded(record.values[:, c], scales.get(c)) for c in (*known.forces, *known.responses)}
    found: list[tuple[int, int, int, float, str, str]] = []
    for column, label in zip(known.forces, known.inputs, strict=True):
        free, noise = at_rest(record.values[:, column], rate)
        for contact in contacts(free, noise, rate, trigger):
            found.append((contact.first, contact.last, column, contact.force * known.factors[column], label, ""))
    if not found:
        names = ", ".join(record.labels[c] for c in known.forces)
        raise SignalError(
            f"records[{number}]", found=f"no hit in {names}", expected="the pulse of a hammer", hint="Leave it out."
        )
    found.sort()
    hits = []
    for k, (first, last, column, peak, label, _) in enumerate(found):
        stop = found[k + 1][0] if k + 1 < len(found) else len(record)
        free, noise = at_rest(record.values[:, column], rate)
        contact = next(c for c in contacts(free, noise, rate, trigger) if c.first == first)
        level = max(double_hit * abs(contact.force), 8 * noise)
        start = found[k - 1][1] + 1 if k else 0
        pulses = second_pulses(free, contact, max(start, first - round(0.1 * rate)), stop, level)
        reason = _fault(record, known.responses, column, first, last, stop, pulses, clipped)
        at = record.start_s + first / rate
        hits.append(Hit(number, label, first, last, stop, at, (last + 1 - first) / rate, peak, not reason, reason))
    return tuple(hits)


def _fault(
    record: TimeSeries,
    responses: tuple[int, ...],
    force: int,
    first: int,
    last: int,
    stop: int,
    pulses: list[tuple[int, int, float]],
    clipped: dict[int, NDArray[np.bool_]],
) -> str:
    """Why a hit cannot be used; nothing if it can."""
    rate, values = record.sample_rate_hz, record.values
    span = slice(max(first - 2, 0), stop)
    for column in (force, *responses):
        if not np.isfinite(values[span, column]).all():
            return f"{record.labels[column]} has values that are no numbers"
        if clipped[column][span].any():
            return f"{record.labels[column]} is overloaded"
    if pulses:
        at = (pulses[0][0] - first) / rate
        return f"a double hit: {pulses[0][2]:.3g} again after {1000 * at:.0f} ms"
    if stop - last < LEAST_AFTER:
        return "the record ends with it"
    before = values[max(first - round(0.1 * rate), 0) : first, responses]
    after = values[last : min(last + round(0.3 * rate) + 2, stop), responses]
    if len(before) > 3 and np.any(np.std(before, axis=0) > UNSETTLED * np.std(after, axis=0).max()):
        return "the robot still swung from before"
    return ""
