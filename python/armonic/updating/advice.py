"""A plan in sentences: what to measure, what is gained, what stays open and why."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armonic.text import count, format_si, format_spread, listing, split_path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from armonic.updating.expected import PlannedParameter
    from armonic.updating.planning import Plan

OPEN = "not identifiable"
NOTHING = 1.01
"""Intervals that become no more than so many times narrower have not changed."""
MOST_NAMED = 6
"""More parameters of one quantity than this are counted, not named."""


def advice(plan: Plan) -> tuple[str, ...]:
    """What the plan says, in full sentences."""
    told = [_before(plan), _gain(plan), *_promoted(plan), *_open(plan), _assumption(plan)]
    return tuple(sentence for sentence in told if sentence)


def _before(plan: Plan) -> str:
    if not plan.information.any():
        return "Nothing has been measured yet."
    return f"Before: {_tally(plan, 0)}."


def _tally(plan: Plan, step: int) -> str:
    verdicts = [p.verdicts[step] for p in plan.parameters]
    parts = [f"{n} {name}" for name in ("identified", "weak", OPEN) if (n := verdicts.count(name))]  # type: ignore[arg-type]
    return f"of {count(len(verdicts), 'parameter')} {listing(parts)}"


def _gain(plan: Plan) -> str:
    what = listing([c.label for c in plan.chosen])
    known = [p for p in plan.parameters if p.verdicts[0] != OPEN]
    ratios = sorted(p.deviations[0] / p.deviations[-1] for p in known)
    after = f"After {what}: {_tally(plan, -1)}."
    if not ratios:
        return after
    if ratios[-1] < NOTHING:
        return f"{after} Intervals that were closed before stay as they are."
    low, high = (format_si(r, digits=2) for r in (ratios[0], ratios[-1]))
    narrower = f"{high} times" if low == high else f"{low} to {high} times"
    whose = "The interval that was" if len(known) == 1 else "Intervals that were"
    return f"{after} {whose} closed before {'becomes' if len(known) == 1 else 'become'} {narrower} narrower."


def _promoted(plan: Plan) -> Iterable[str]:
    """What was open and is so no longer."""
    for name, words in (("identified", "newly identified"), ("weak", "determined, though weakly")):
        rank = {"identified": 0, "weak": 1, OPEN: 2}
        new = [p for p in plan.parameters if p.verdicts[-1] == name and rank[p.verdicts[0]] > rank[name]]
        if new and plan.information.any():
            verb = "is" if len(new) == 1 else "are"
            yield f"{_named(new, _spread(-1))} {verb} {words}."


def _open(plan: Plan) -> Iterable[str]:
    left = [p for p in plan.parameters if p.verdicts[-1] == OPEN]
    if not left:
        yield "Nothing stays open."
        return
    blind = [p for p in left if math.isinf(p.with_all)]
    never = [p for p in left if p.verdict_with_all == OPEN and p not in blind]
    more = [p for p in left if p.verdict_with_all != OPEN]
    every = f"all {len(plan.ranking)} candidates together" if len(plan.ranking) > 1 else "the only candidate"
    if blind:
        yield f"{_named(blind)} {_stay(blind)} open: no candidate sees {_them(blind)}."
    if never:
        yield f"{_named(never, _spread(-1))} {_stay(never)} open: not even {every} determine {_them(never)}."
    if more:
        yield (
            f"{_named(more, _spread(-1))} {_stay(more)} open after {count(len(plan.chosen), 'measurement')}; "
            f"{every} would determine {_them(more)}."
        )


def _assumption(plan: Plan) -> str:
    return (
        "So that what the data leave open has a measure, the criterion takes every parameter to lie within its bounds, "
        "or within a factor of 1000 where it has none; intervals and verdicts do not count that as knowledge."
    )


def _stay(which: Sequence[PlannedParameter]) -> str:
    return "stays" if len(which) == 1 else "stay"


def _them(which: Sequence[PlannedParameter]) -> str:
    return "it" if len(which) == 1 else "them"


def _spread(step: int) -> Callable[[PlannedParameter], str]:
    return lambda p: "" if math.isinf(p.share(step)) else f" ({spread(p, step)})"


def _named(which: Sequence[PlannedParameter], remark: Callable[[PlannedParameter], str] = lambda p: "") -> str:
    """Parameters by quantity: "The dampings of carousel.z (x/÷ 5) and arm.y and the stiffness of arm.x"."""
    groups: dict[str, list[tuple[str, PlannedParameter]]] = {}
    for p in which:
        name, quantity = split_path(p.path)
        groups.setdefault(quantity, []).append((name, p))
    parts = []
    for quantity, members in groups.items():
        if len(members) > MOST_NAMED:
            parts.append(count(len(members), quantity or "other number"))
            continue
        names = listing([f"{name}{remark(p)}" for name, p in members])
        parts.append(f"the {quantity if len(members) == 1 else _plural(quantity)} of {names}" if quantity else names)
    words = listing(parts)
    return words[0].upper() + words[1:] if words.startswith("the ") else words


def _plural(quantity: str) -> str:
    return {"stiffness": "stiffnesses"}.get(quantity, f"{quantity}s")


def spread(p: PlannedParameter, step: int) -> str:
    """Half a 95 % interval: "± 4 %" or "×/÷ 5.1", of what may be zero "± 0.01 m", or "open"."""
    low, high = p.intervals[step]
    if p.scale == "log":
        return format_spread(low, high)
    return f"± {format_si((high - low) / 2, p.unit, digits=2)}" if math.isfinite(high) else "open"
