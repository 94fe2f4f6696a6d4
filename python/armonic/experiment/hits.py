"""The hits of a tap test: found in the force, and each one judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.contacts import LOUD, at_rest, contacts, second_pulses
from armonic.experiment.signals import overloaded, roles

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from armonic.experiment.contacts import Contact
    from armonic.experiment.signals import Roles
    from armonic.series import TimeSeries

UNSETTLED = 0.1
"""A response that swings before a hit by more than this share of what it does after it belongs to the hit before."""
LEAST_AFTER = 8
"""Samples that must follow a contact."""
BEFORE_S, AFTER_S = 0.1, 0.3
"""Times over which a response is looked at before a hit and after it."""
CROSSTALK = 0.1
"""A pulse smaller than this share of one in another force at the same time is no hit."""
NO_NUMBERS = "has values that are no numbers"
"""The one fault that no asking overrules."""


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
    full_scale: Mapping[int, float] | None = None,
) -> tuple[Hit, ...]:
    """The hits in a record, in order of time.

    Args:
        record: channels of force and response named PLACE.AXIS.
        number: of the record in its set.
        trigger: share of the record's largest force that a hit exceeds.
        double_hit: share of a hit's force from which on a second pulse makes it a double hit.
        full_scale: of channels by column, in their units; without one, clipping is seen by its flat tops.

    Returns:
        Every hit, used or not; none if the force holds no pulse.

    Raises:
        SignalError: no force or response among the channels, or a share that is none.
    """
    for name, share in (("trigger", trigger), ("double_hit", double_hit)):
        if not 0 < share < 1:
            raise SignalError(name, found=repr(share), expected="a share between 0 and 1")
    known, rate, scales = roles(record, number), record.sample_rate_hz, full_scale or {}
    clipped = {c: overloaded(record.values[:, c], scales.get(c)) for c in (*known.forces, *known.responses)}
    at_rests = [at_rest(record.values[:, column], rate) for column in known.forces]
    found = [
        (contact, k) for k, (free, noise) in enumerate(at_rests) for contact in contacts(free, noise, rate, trigger)
    ]
    found = [pair for pair in found if not _crosstalk(pair, found, known)]
    found.sort(key=lambda pair: pair[0].first)
    hits = []
    for n, (contact, k) in enumerate(found):
        stop = found[n + 1][0].first if n + 1 < len(found) else len(record)
        first, last, column, (free, noise) = contact.first, contact.last, known.forces[k], at_rests[k]
        start = max(found[n - 1][0].last + 1 if n else 0, first - round(BEFORE_S * rate))
        level = max(double_hit * abs(contact.force), LOUD * noise)
        pulses = second_pulses(free, contact, start, stop, level)
        reason = _fault(record, known.responses, column, slice(start, stop), contact, pulses, clipped)
        hits.append(
            Hit(
                record=number,
                force=known.inputs[k],
                first=first,
                last=last,
                stop=stop,
                start_s=record.start_s + first / rate,
                duration_s=contact.samples / rate,
                peak_n=contact.force * known.factors[column],
                used=not reason,
                reason=reason,
            )
        )
    return tuple(hits)


def _crosstalk(pair: tuple[Contact, int], every: Sequence[tuple[Contact, int]], known: Roles) -> bool:
    """Whether a contact is what another force, at the same time, leaves in this channel."""
    contact, k = pair
    size = abs(contact.force) * known.factors[known.forces[k]]
    return any(
        size < CROSSTALK * abs(other.force) * known.factors[known.forces[n]]
        for other, n in every
        if n != k and other.first <= contact.last and contact.first <= other.last
    )


def _fault(
    record: TimeSeries,
    responses: tuple[int, ...],
    force: int,
    span: slice,
    contact: Contact,
    pulses: list[tuple[int, int, float]],
    clipped: dict[int, NDArray[np.bool_]],
) -> str:
    """Why a hit cannot be used; nothing if it can."""
    rate, values, first, last = record.sample_rate_hz, record.values, contact.first, contact.last
    for column in (force, *responses):
        if not np.isfinite(values[span, column]).all():
            return f"{record.labels[column]} {NO_NUMBERS}"
        if clipped[column][span].any():
            return f"{record.labels[column]} is overloaded"
    if pulses:
        at = (pulses[0][0] - first) / rate
        return f"a double hit: {pulses[0][2]:.3g} again after {1000 * at:.0f} ms"
    if span.stop - last < LEAST_AFTER:
        return "the record ends, or the next hit comes, with it"
    before = values[span.start : first, responses]
    after = values[last : min(last + round(AFTER_S * rate) + 2, span.stop), responses]
    if len(before) > 3 and np.any(np.std(before, axis=0) > UNSETTLED * np.std(after, axis=0).max()):
        return "the robot still swung from before"
    return ""
