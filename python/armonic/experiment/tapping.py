"""Records of a tap test: which hits are used, how long their windows are, and the spectra in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.contacts import at_rest, contacts
from armonic.experiment.hits import BEFORE_S, NO_NUMBERS, Hit, find_hits
from armonic.experiment.spectra import LEAST_SAMPLES, Block, Usable, accelerations

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

DECAYED = 0.01
"""What a response should have come down to at the end of its window."""
FASTEST_DECAY = 0.1
"""Of the sampling rate: a steeper window leaves a few samples."""
SHORT = 0.5
"""A hit with less room than this share of the median is left out rather than shorten all windows."""
MOST_BEFORE = 0.1
"""Share of a window that may lie before its hit."""
RINGING = 4
"""Contact times around a pulse that are the ringing of its anti-alias filter."""


def looks_like_hits(records: Sequence[Usable], trigger: float) -> bool:
    """Whether in most records some force consists of short pulses."""
    seen = [any(_pulses(one, column, trigger) for column in one.roles.forces) for one in records]
    return 2 * sum(seen) > len(seen)


def _pulses(one: Usable, column: int, trigger: float) -> bool:
    rate = one.record.sample_rate_hz
    free, noise = at_rest(one.record.values[:, column], rate)
    free = np.nan_to_num(free)
    found = contacts(free, noise, rate, trigger)
    busy = sum(contact.samples for contact in found)
    loud = float(np.mean(np.abs(free) > 0.05 * np.abs(free).max(initial=0.0)))
    return bool(found) and busy < 0.1 * len(free) and loud < 0.1


def chosen_hits(
    records: Sequence[Usable],
    scales: Mapping[int, Mapping[int, float]],
    trigger: float,
    double_hit: float,
    keep: Sequence[int] | None,
    shortest_s: float | None,
) -> tuple[tuple[Hit, ...], list[str]]:
    """All hits, those that are used among them, and what is to be said.

    Args:
        records: of one rate.
        scales: full scales by column of each, by its number.
        trigger: see `hits.find_hits`.
        double_hit: likewise.
        keep: indices of hits that are used whatever is wrong with them, and no others.
        shortest_s: length of the window that was asked for; None lets hits with little room go.

    Raises:
        SignalError: there is no hit, or none that can be used.
    """
    found: list[Hit] = []
    remarks: list[str] = []
    for one in records:
        scale = scales[one.number]
        hits = find_hits(one.record, number=one.number, trigger=trigger, double_hit=double_hit, full_scale=scale)
        hits = tuple(hit for hit in hits if hit.force in one.roles.inputs)
        if not hits:
            remarks.append(f"Record {one.number + 1} holds no hit.")
        found += hits
    if not found:
        names = ", ".join(records[0].record.labels[c] for c in records[0].roles.forces)
        hint = "Of a shaker say excitation=."
        raise SignalError("records", found=f"no hit in {names}", expected="pulses of a hammer", hint=hint)
    if keep is not None:
        _refuse_odd_indices(keep, found)
        found = [replace(h, used=k in keep, reason=h.reason if k in keep else "left out") for k, h in enumerate(found)]
    elif shortest_s is None and any(hit.used for hit in found):
        median = float(np.median([hit.stop - hit.first for hit in found if hit.used]))
        found = [_judged_by_room(hit, median, records[0].record.sample_rate_hz) for hit in found]
    if not any(hit.used for hit in found):
        listed = "; ".join(f"hit {k}: {hit.reason}" for k, hit in enumerate(found[:4], 1))
        said = f"no usable hit ({listed})"
        raise SignalError("records", found=said, expected="one at least", hint="keep= uses hits all the same.")
    return tuple(found), remarks


def _refuse_odd_indices(keep: Sequence[int], found: Sequence[Hit]) -> None:
    expected = f"indices of {len(found)} hits, 0 to {len(found) - 1}"
    listed = list(keep) if isinstance(keep, Sequence) and not isinstance(keep, str) else [keep]
    odd = [k for k in listed if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 0 <= k < len(found)]
    if odd or not listed:
        raise SignalError("keep", found=f"{odd[0]!r}" if odd else "none", expected=expected)
    if bad := [k for k in listed if NO_NUMBERS in found[k].reason]:
        raise SignalError("keep", found=f"index {bad[0]}: {found[bad[0]].reason}", expected="hits of numbers")


def _judged_by_room(hit: Hit, median: float, rate: float) -> Hit:
    room = hit.stop - hit.first
    if not hit.used or room >= SHORT * median:
        return hit
    reason = f"only {room / rate:.3g} s until the next hit or the end, where others have {median / rate:.3g} s"
    return replace(hit, used=False, reason=reason)


def window_samples(hits: Sequence[Hit], rate: float, asked_s: float | None) -> tuple[int, list[str]]:
    """Samples of the window of every hit, and what is to be said of it.

    Raises:
        SignalError: the window that was asked for is longer than there is room for, or too short.
    """
    room = {k: hit.stop - hit.first for k, hit in enumerate(hits) if hit.used}
    least, most = min(room.values()), max(room.values())
    if asked_s is None:
        if least < LEAST_SAMPLES:
            raise SignalError("records", found=f"{least} samples after a hit", expected=f"at least {LEAST_SAMPLES}")
        if most <= 1.1 * least:
            return least, []
        told = f"Windows of {least / rate:.3g} s, the shortest from a hit to the next; others have {most / rate:.3g} s."
        return least, [told]
    samples = round(asked_s * rate)
    if samples < LEAST_SAMPLES:
        raise SignalError("window_s", found=f"{asked_s:g} s", expected=f"at least {LEAST_SAMPLES / rate:g} s")
    if samples > least + BEFORE_S * rate:
        k = min(room, key=lambda key: room[key])
        raise SignalError(
            "window_s",
            found=f"{asked_s:g} s, where hit {k + 1} is followed by {room[k] / rate:.4g} s",
            expected=f"at most {least / rate:.4g} s",
            hint=f"Lines come no closer than {rate / least:.3g} Hz then.",
        )
    return samples, []


def decay_of(
    records: Sequence[Usable], hits: Sequence[Hit], samples: int, asked: float | str
) -> tuple[float, list[str]]:
    """The rate of the exponential window, 1/s, and what is to be said of it.

    Raises:
        SignalError: the rate that was asked for leaves nothing.
    """
    of_number = {one.number: one for one in records}
    rate = records[0].record.sample_rate_hz
    if not isinstance(asked, str):
        if asked > FASTEST_DECAY * rate:
            expected = f"at most {FASTEST_DECAY * rate:g}/s, a tenth of the sampling rate"
            raise SignalError("decay_rate", found=f"{asked:g}/s", expected=expected)
        return float(asked), []
    left = 0.0
    for hit in hits:
        if not hit.used:
            continue
        one = of_number[hit.record]
        columns = list(one.roles.responses)
        begin = max(hit.first - round(BEFORE_S * rate), 0)
        values = one.record.values[begin : min(hit.first + samples, hit.stop), columns] * one.roles.factors[columns]
        values = values[hit.first - begin :] - values[: hit.first - begin + 1].mean(axis=0)
        part = max(len(values) // 20, 2)
        start, end = (np.sqrt((side**2).mean(axis=0)) for side in (values[:part], values[-part:]))
        k = int(np.argmax(start))
        left = max(left, float(end[k] / start[k]) if start[k] > 0 else 0.0)
    if left <= DECAYED:
        return 0.0, []
    a = min(float(np.log(left / DECAYED) * rate / samples), FASTEST_DECAY * rate)
    return a, [
        f"Responses have {100 * left:.2g} % left at the end of their windows: an exponential window of {a:.3g}/s brings"
        " that to 1 %; what it adds to damping is taken off the modes."
    ]


def tapped(
    one: Usable,
    hit: Hit,
    force: Array,
    samples: int,
    decay_rate: float,
    *,
    pretrigger_s: float,
    after: int,
    force_window: bool,
) -> Block:
    """Spectra of force and responses in the window of a hit.

    Force and responses have the same exponential window from the same origin, so that their quotient is the response
    at s = iω + a exactly (Fladung and Rost 1997). The force is taken for zero away from its contact.

    Args:
        one: the record.
        hit: in it.
        force: of the whole record at rest around zero, (N,), in its unit; see `contacts.at_rest`.
        samples: of the window.
        decay_rate: a, 1/s.
        pretrigger_s: what of the window lies before the hit; less if the window is short or the hit before is near.
        after: sample behind the contact of the hit before.
        force_window: whether the force is taken for zero away from its contact.
    """
    record, known, rate = one.record, one.roles, one.record.sample_rate_hz
    column = known.forces[known.inputs.index(hit.force)]
    before = min(round(pretrigger_s * rate), int(MOST_BEFORE * samples))
    start = max(hit.first - before, after, 0)
    stop = min(start + samples, hit.stop)
    force = force[start:stop] * known.factors[column]
    if force_window:
        reach = RINGING * (hit.last + 1 - hit.first)
        span = np.arange(start, stop)
        beyond = np.maximum(np.maximum(hit.first - reach - span, span - hit.last - reach), 0)
        force = force * np.where(beyond < reach, 0.5 + 0.5 * np.cos(np.pi * np.minimum(beyond / reach, 1)), 0.0)
    columns = list(known.responses)
    rest = record.values[max(hit.first - round(BEFORE_S * rate), after, 0) : max(hit.first, 1)][:, columns]
    responses = (record.values[start:stop][:, columns] - rest.mean(axis=0)) * known.factors[columns]
    fall = np.exp(-decay_rate * np.arange(stop - start) / rate)
    F = np.fft.rfft(force * fall, samples)[:, None] / rate
    Y = np.fft.rfft(responses * fall[:, None], samples, axis=0) / rate
    Y = accelerations(Y, known.powers, np.fft.rfftfreq(samples, 1 / rate), decay_rate)
    return Block((hit.force,), known.outputs, F, Y)


def all_tapped(
    records: Sequence[Usable],
    hits: Sequence[Hit],
    samples: int,
    decay_rate: float,
    *,
    pretrigger_s: float,
    force_window: bool,
) -> list[Block]:
    """The spectra of all hits that are used; see `tapped`."""
    of_number = {one.number: one for one in records}
    found: list[Block] = []
    last: dict[int, int] = {}
    forces: dict[tuple[int, str], Array] = {}
    for hit in hits:
        after = last.get(hit.record, 0)
        last[hit.record] = hit.last + 1
        if hit.used:
            one, key = of_number[hit.record], (hit.record, hit.force)
            if key not in forces:
                column = one.roles.forces[one.roles.inputs.index(hit.force)]
                forces[key], _ = at_rest(one.record.values[:, column], one.record.sample_rate_hz)
            found.append(
                tapped(
                    one,
                    hit,
                    forces[key],
                    samples,
                    decay_rate,
                    pretrigger_s=pretrigger_s,
                    after=after,
                    force_window=force_window,
                )
            )
    return found
