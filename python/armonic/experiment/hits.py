"""Hits of a tap test: found in the force, measured, and judged whether a frequency response can be made of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.contacts import REBOUND_S, Contact, at_rest, contacts, second_pulses
from armonic.experiment.cutting import Cut, above_noise, end_levels, quiet_level
from armonic.experiment.room import Room, window_samples
from armonic.experiment.signals import Roles, as_records, full_scales, overloaded, roles
from armonic.series import TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

PRETRIGGER = 20
"""Samples of the window before the contact where nothing is asked: a filter without phase rings ahead."""
WEAK = 0.2
"""A hit below this share of the median at its point tests another amplitude than the others do."""
RESTLESS = 0.1
"""What is left of the hit before, as a share of the response, adds its square (1 %) as noise to each spectrum."""
TOGETHER = 0.3
"""A force on a second channel beyond this share is no crosstalk."""
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Hit:
    """One hit of a tap test.

    Attributes:
        record: index of its record.
        force: where it hits, PLACE.AXIS.
        start_s: when the contact begins, in the record's time.
        peak_n: greatest force with its sign, N (N·m for a moment), without the offset.
        duration_s: of the contact.
        used: whether a frequency response is made of it.
        reason: why not, in one sentence; empty for a good hit.
        second_ratio: greatest further pulse within the window as a share of the peak; 0 without one.
        before_ratio: what the response still is of the hit before, as a share of its start: the median of all channels.
        end_ratio: RMS of the response over the last 5 % of the window as a share of that over the first 5 %, noise
            taken off: the largest of all channels; NaN if the window is not in the record.
        cut: its samples in the record.
    """

    record: int
    force: str
    start_s: float
    peak_n: float
    duration_s: float
    used: bool
    reason: str
    second_ratio: float
    before_ratio: float
    end_ratio: float
    cut: Cut


@dataclass(frozen=True, eq=False)
class Examined:
    """All hits of some records, and the window they share.

    Attributes:
        hits: in order of records and time.
        samples: of the window.
        remarks: how its length came about, in full sentences.
    """

    hits: tuple[Hit, ...]
    samples: int
    remarks: tuple[str, ...]


def find_hits(
    records: TimeSeries | Sequence[TimeSeries],
    *,
    trigger: float = 0.1,
    double_hit: float = 0.05,
    window_s: float | None = None,
    resolution_hz: float | None = None,
    pretrigger_s: float | None = None,
    full_scale: Mapping[str, float] | None = None,
    keep: Sequence[int] | None = None,
) -> tuple[Hit, ...]:
    """Every hit of a tap test, with what is wrong with those that cannot be used.

    Args:
        records: with channels of force and of motion named PLACE.AXIS; each holds one hit or several. With several
            forces, a hit belongs to the one that is largest.
        trigger: a hit exceeds this share of the largest force of its channel in the record, and eight standard
            deviations of its noise.
        double_hit: a further pulse of this share of the peak makes a double hit.
        window_s: length of the window of each hit; by default to the next hit or the end of the record, for all hits
            as long as for the one with the least room.
        resolution_hz: spacing of the lines wanted: no longer window than 1 / resolution_hz is taken.
        pretrigger_s: how much of it lies before the contact; 20 samples by default, less where less was recorded.
        full_scale: largest value that a channel can take, by pattern as in `TimeSeries.select`; without it a signal
            counts as clipped where it stands still at its extreme.
        keep: indices of the hits to use, these and no others, whatever is wrong with them.

    Raises:
        SignalError: a record has no hit, no force or no response, an argument is out of its range, or a hit that is to
            be kept has no full window of finite values.
    """
    given = as_records(records)
    return examine(
        given,
        tuple(roles(record, k) for k, record in enumerate(given)),
        trigger=trigger,
        double_hit=double_hit,
        window_s=window_s,
        resolution_hz=resolution_hz,
        pretrigger_s=pretrigger_s,
        full_scale=full_scale,
        keep=keep,
    ).hits


@dataclass(frozen=True, eq=False)
class _Found:
    """A contact with what is known before the window is."""

    record: int
    force: int
    contact: Contact
    free: Array
    level: float
    rival: tuple[str, float] | None
    quiet: int
    start: int
    stop: int


def examine(
    records: tuple[TimeSeries, ...],
    channels: tuple[Roles, ...],
    *,
    trigger: float,
    double_hit: float,
    window_s: float | None,
    resolution_hz: float | None,
    pretrigger_s: float | None,
    full_scale: Mapping[str, float] | None,
    keep: Sequence[int] | None,
) -> Examined:
    """As `find_hits`, with the window that all hits share."""
    for name, share in (("trigger", trigger), ("double_hit", double_hit)):
        if not 0 < share < 1:
            raise SignalError(name, found=f"{share!r:.60}", expected="a share above 0 and below 1")
    if pretrigger_s is not None and not (math.isfinite(pretrigger_s) and pretrigger_s >= 0):
        raise SignalError("pretrigger_s", found=repr(pretrigger_s), expected="a time in s, 0 or more")
    rate = records[0].sample_rate_hz
    before = PRETRIGGER if pretrigger_s is None else round(pretrigger_s * rate)
    scales = full_scales(records, full_scale)
    found = [
        hit
        for k, (record, role) in enumerate(zip(records, channels, strict=True))
        for hit in _found(k, record, role, trigger, double_hit, before)
    ]
    kept = _kept(keep, len(found))
    early = [_early(hit, found, records, channels) for hit in found]
    fit = [k in kept if kept is not None else not early[k] for k in range(len(found))]
    rooms = [Room(hit.record, hit.start, hit.stop) for hit in found]
    samples, remarks = window_samples(rooms, fit, rate, window_s, resolution_hz)
    clipped = [
        {c: overloaded(record.values[:, c], scale.get(c)) for c in (*role.forces, *role.responses)}
        for record, role, scale in zip(records, channels, scales, strict=True)
    ]
    noise = _noise(found, records, channels, samples)
    hits = []
    for k, hit in enumerate(found):
        record, role = records[hit.record], channels[hit.record]
        judged = _judged(hit, early[k], record, role, clipped[hit.record], noise[hit.record], samples)
        whole = hit.start + samples <= min(hit.stop, len(record))
        hits.append(_with_wish(judged, k, kept, hit, record, role, whole=whole))
    return Examined(tuple(hits), samples, remarks)


def _found(
    number: int, record: TimeSeries, role: Roles, trigger: float, double_hit: float, before: int
) -> list[_Found]:
    """The hits of a record in order of time."""
    rate, ahead = record.sample_rate_hz, []
    quietest = []
    for k, column in enumerate(role.forces):
        free, noise = at_rest(record.values[:, column] * role.factors[column], rate)
        quietest.append((free, noise))
        ahead += [(contact, k) for contact in contacts(free, noise, rate, trigger)]
    ahead.sort(key=lambda pair: (pair[0].first, -abs(pair[0].force)))
    alone: list[tuple[Contact, int, tuple[str, float] | None]] = []
    for contact, k in ahead:
        rivals = [(abs(o.force / contact.force), j) for o, j in ahead if j != k and _overlap(contact, o)]
        share, j = max(rivals, default=(0.0, k))
        if share <= 1 and not (share == 1 and j < k):
            alone.append((contact, k, (role.inputs[j], share) if share > TOGETHER else None))
    if not alone:
        worst = max(range(len(quietest)), key=lambda k: float(np.abs(quietest[k][0]).max(initial=0.0)))
        largest, noise = float(np.abs(quietest[worst][0]).max(initial=0.0)), quietest[worst][1]
        times = f", {largest / noise:.2g} times its noise" if noise else ""
        raise SignalError(
            f"records[{number}], {record.labels[role.forces[worst]]}",
            found=f"no hit; the largest force is {largest:.3g}{times}",
            expected="a hit that stands out of the noise by a factor of 8",
            hint="Leave the record out, or say excitation='random' if a shaker drove it.",
        )
    found = []
    for place, (contact, k, rival) in enumerate(alone):
        quiet = alone[place - 1][0].last + 1 if place else 0
        start = max(contact.first - before, quiet)
        stop = max(alone[place + 1][0].first - before, contact.last + 1) if place + 1 < len(alone) else len(record)
        free, noise = quietest[k]
        level = max(double_hit * abs(contact.force), 6 * noise)
        found.append(_Found(number, k, contact, free, level, rival, quiet, start, stop))
    return found


def _overlap(one: Contact, other: Contact) -> bool:
    slack = max(one.samples, other.samples)
    return one.first <= other.last + slack and other.first <= one.last + slack


def _kept(keep: Sequence[int] | None, count: int) -> frozenset[int] | None:
    if keep is None:
        return None
    chosen = frozenset(int(k) for k in keep)
    if not chosen or not all(0 <= k < count for k in chosen):
        expected = f"indices of hits from 0 to {count - 1}, one at least"
        raise SignalError("keep", found=f"{sorted(chosen)}", expected=expected)
    return chosen


def _early(hit: _Found, found: list[_Found], records: tuple[TimeSeries, ...], channels: tuple[Roles, ...]) -> str:
    """What is wrong with a hit whatever its window."""
    if hit.rival is not None:
        label, share = hit.rival
        return f"A second force, {label}, acts at the same time with {100 * share:.0f} % of it."
    horizon = hit.contact.first + int(REBOUND_S * records[hit.record].sample_rate_hz)
    if pulses := second_pulses(hit.free, hit.contact, hit.quiet, min(horizon, hit.stop), hit.level):
        return _double(hit, pulses, records[hit.record].sample_rate_hz)
    label = channels[hit.record].inputs[hit.force]
    peers = [abs(other.contact.force) for other in found if channels[other.record].inputs[other.force] == label]
    typical = float(np.median(peers))
    if abs(hit.contact.force) < WEAK * typical:
        return f"Its peak is only {100 * abs(hit.contact.force) / typical:.0f} % of that of the other hits at {label}."
    return ""


def _double(hit: _Found, pulses: list[tuple[int, int, float]], rate: float) -> str:
    first, _, height = max(pulses, key=lambda pulse: pulse[2])
    apart = (first - hit.contact.first) / rate
    share = 100 * height / abs(hit.contact.force)
    when = f"{1000 * abs(apart):.0f} ms {'after' if apart > 0 else 'before'}"
    return f"It is a double hit: {when} its start the hammer touches again with {share:.0f} % of the peak."


def _cut(hit: _Found, samples: int, length: int) -> Cut:
    return Cut(hit.quiet, hit.start, hit.contact.first, hit.contact.last, min(hit.start + samples, length))


def _noise(
    found: list[_Found], records: tuple[TimeSeries, ...], channels: tuple[Roles, ...], samples: int
) -> dict[int, tuple[Array, int]]:
    """Of each record the RMS of its responses before the first hit, and over how many samples."""
    levels: dict[int, tuple[Array, int]] = {}
    for hit in found:
        if hit.record not in levels:
            responses = records[hit.record].values[:, list(channels[hit.record].responses)]
            cut = _cut(hit, samples, len(responses))
            levels[hit.record] = quiet_level(responses, cut), cut.before.stop - cut.before.start
    return levels


def _judged(
    hit: _Found,
    early: str,
    record: TimeSeries,
    role: Roles,
    clipped: Mapping[int, NDArray[np.bool_]],
    noise: tuple[Array, int],
    samples: int,
) -> Hit:
    """A hit with the first thing that is wrong with it."""
    rate, contact = record.sample_rate_hz, hit.contact
    cut = _cut(hit, samples, len(record))
    pulses = second_pulses(hit.free, contact, cut.start, min(cut.stop, hit.stop), hit.level)
    last = max([contact.last, *(pulse[1] for pulse in pulses)])
    cut = Cut(cut.quiet, cut.start, cut.first, min(last, cut.stop - 1), cut.stop)
    responses = record.values[:, list(role.responses)]
    bad = _not_finite(hit, cut, record, role)
    before_ratio, end_ratio = 0.0, math.nan
    if not bad:
        with np.errstate(invalid="ignore", divide="ignore"):
            start, end = end_levels(responses, cut)
            if hit.quiet:
                left = above_noise(quiet_level(responses, cut), noise[0], (cut.stretch, noise[1]))
                before_ratio = float(np.median(np.nan_to_num(left / start, posinf=0.0)))
            if cut.stop - cut.start == samples:
                left = above_noise(end, noise[0], (cut.stretch, noise[1]))
                end_ratio = float(np.max(np.nan_to_num(left / start, posinf=0.0)))
    return Hit(
        record=hit.record,
        force=role.inputs[hit.force],
        start_s=record.start_s + contact.first / rate,
        peak_n=contact.force,
        duration_s=contact.samples / rate,
        used=False,
        reason=bad
        or _overload(hit, cut, record, role, clipped)
        or (_double(hit, pulses, rate) if pulses else "")
        or early
        or _no_room(hit, samples, record)
        or _restless(before_ratio),
        second_ratio=max((pulse[2] for pulse in pulses), default=0.0) / abs(contact.force),
        before_ratio=before_ratio,
        end_ratio=end_ratio,
        cut=cut,
    )


def _not_finite(hit: _Found, cut: Cut, record: TimeSeries, role: Roles) -> str:
    for column in (role.forces[hit.force], *role.responses):
        bad = np.flatnonzero(~np.isfinite(record.values[cut.start : cut.stop, column]))
        if bad.size:
            when = record.start_s + (cut.start + int(bad[0])) / record.sample_rate_hz
            return f"{record.labels[column]} is not finite at {when:.4g} s ({bad.size} such samples in the window)."
    return ""


def _overload(
    hit: _Found, cut: Cut, record: TimeSeries, role: Roles, clipped: Mapping[int, NDArray[np.bool_]]
) -> str:
    for column in (role.forces[hit.force], *role.responses):
        at = np.flatnonzero(clipped[column][cut.start : cut.stop])
        if at.size:
            k = cut.start + int(at[0])
            value, unit = record.values[k, column], record.channels[column].unit
            when = record.start_s + k / record.sample_rate_hz
            return f"{record.labels[column]} is overloaded: clipped at {f'{value:.4g} {unit}'.strip()}, {when:.4g} s."
    return ""


def _no_room(hit: _Found, samples: int, record: TimeSeries) -> str:
    if hit.start + samples <= hit.stop:
        return ""
    rate = record.sample_rate_hz
    what = "the record ends" if hit.stop == len(record) else "the next hit comes"
    after, window = (hit.stop - hit.contact.first) / rate, samples / rate
    return f"Only {after:.3g} s after it {what}; the window has {window:.4g} s."


def _restless(before_ratio: float) -> str:
    if before_ratio <= RESTLESS:
        return ""
    return f"The response to the hit before had not decayed: {100 * before_ratio:.0f} % were left."


def _with_wish(
    hit: Hit, index: int, kept: frozenset[int] | None, found: _Found, record: TimeSeries, role: Roles, *, whole: bool
) -> Hit:
    """The hit, used if it is good, or if it is one of those to keep."""
    from dataclasses import replace

    if kept is None:
        return replace(hit, used=not hit.reason)
    if index not in kept:
        return replace(hit, reason=hit.reason or "It is not among those to keep.")
    if bad := _not_finite(found, hit.cut, record, role) or ("" if whole else hit.reason):
        raise SignalError(
            "keep",
            found=f"hit {index} (records[{hit.record}], {hit.start_s:.4g} s): {bad}",
            expected="hits with a whole window of finite values",
        )
    return replace(hit, used=True)
