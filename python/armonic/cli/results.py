"""A fit in tables for people and in plain data for machines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from armonic.cli.terminal import VERDICT_STYLE, heading, table, warning
from armonic.text import (
    format_hz,
    format_interval,
    format_si,
    format_spread,
    listing,
    noise_words,
    parameter_name,
    split_path,
    summary,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import RenderableType

    from armonic.modal import Modes
    from armonic.updating import Fit, FittedParameter
    from armonic.updating.bands import ModalIntervals

NONE = "–"
"""Stands in a table where there is no number."""
MOST_DIRECTIONS = 4
"""So many sloppy directions are printed."""


def fit_tables(
    fit: Fit, postures: Sequence[str], true_values: Mapping[str, float] | None = None
) -> Iterator[RenderableType]:
    """The parameter table, the modal table of each posture, and how the fit went.

    Args:
        fit: the result.
        postures: what to call each of `fit.postures`.
        true_values: values by path for a column of their own.
    """
    from armonic.updating.bands import intervals_after, student

    yield heading("Parameters")
    yield _parameter_table(fit.parameters, true_values)
    yield from _ties(fit)
    yield ""
    if len(fit.coordinates) > 1 and student(fit) is not None:
        yield heading("What the data leave open together")
        yield from _open_words(fit)
        yield ""
    known = [intervals_after(fit, k) for k in range(len(fit.postures))]
    for label, before, after, mac, intervals in zip(postures, fit.before, fit.after, fit.mac, known, strict=True):
        yield heading(f"Modes in posture {label}, before → after, paired by MAC")
        yield _modal_table(before, after, mac, intervals)
        yield ""
    if any(intervals is not None for intervals in known):
        yield "± is half the 95 % interval of natural frequency and of damping, in percent of it or as a factor."
    if any(intervals is not None and intervals.open.any() for intervals in known):
        yield "* bounds of parameters hold it, not data."
    yield ""
    yield f"{summary(fit)} {noise_words(fit)}"
    for doubt in fit.doubts:
        yield ""
        yield warning(doubt)


def _ties(fit: Fit) -> Iterator[RenderableType]:
    """Which parameters stand for several numbers, and which are those of a law, a paragraph each."""
    from rich.padding import Padding

    for p, coordinate in zip(fit.parameters, fit.coordinates, strict=True):
        name = parameter_name(p.path)
        if p.tied:
            others = listing([parameter_name(path) for path in p.tied if path != p.path])
            yield Padding(f"{name} is tied to {others}.", (0, 0, 0, 2))
        if coordinate.law is not None and coordinate.paths:
            over = "the static torque on its joint" if coordinate.law.over == "torque" else coordinate.law.over
            yield Padding(f"{name} follows a law; the table has it where {over} is zero.", (0, 0, 0, 2))


def _open_words(fit: Fit) -> Iterator[RenderableType]:
    """The directions along which the data leave parameters open, least known first, a paragraph each."""
    from rich.padding import Padding

    from armonic.updating.directions import directions, sloppy

    found = directions(fit)
    loose = sloppy(found)
    for direction in loose[:MOST_DIRECTIONS]:
        yield Padding(direction.words, (0, 0, 0, 2))
    if (more := len(loose) - MOST_DIRECTIONS) > 0:
        yield f"  ... and {more} more"
    if not loose:
        yield Padding(f"Nothing by more than a quarter; least known: {found[-1].words}", (0, 0, 0, 2))


def _parameter_table(parameters: Sequence[FittedParameter], true_values: Mapping[str, float] | None) -> RenderableType:
    from rich.text import Text

    columns = [
        "",
        ">start",
        ">fitted",
        *([">true"] if true_values is not None else []),
        ">95 % interval",
        "verdict",
    ]
    grid = table(*columns)
    groups: dict[tuple[str, str], list[FittedParameter]] = {}
    for parameter in parameters:
        groups.setdefault((split_path(parameter.path)[1], parameter.unit), []).append(parameter)
    for (quantity, unit), members in groups.items():
        grid.add_row(Text(quantity, style="italic"), Text(unit, style="italic"))
        for p in members:
            true = [] if true_values is None else [format_si(true_values[p.path]) if p.path in true_values else NONE]
            grid.add_row(
                f"  {split_path(p.path)[0] if quantity else parameter_name(p.path)}",
                format_si(p.start),
                format_si(p.value),
                *true,
                format_interval(*p.interval, signed=p.scale == "linear"),
                Text(p.verdict, style=VERDICT_STYLE[p.verdict]),
            )
    return grid


def _modal_table(
    before: Modes, after: Modes, mac: NDArray[np.float64], intervals: ModalIntervals | None
) -> RenderableType:
    """Each mode after the fit beside the one before that it resembles most, one to one as in the report."""
    from scipy.optimize import linear_sum_assignment

    was = dict(zip(*(index.tolist() for index in linear_sum_assignment(-mac.T)), strict=True))
    rows = [(_mode_words(before, was.get(i)), _mode_words(after, i)) for i in range(len(after))]
    widths = [[max(len(row[side][k]) for row in rows) for k in range(3)] for side in (0, 1)]
    grid = table(">", ">was", ">natural Hz", ">±", ">damped Hz", ">damping %", ">±", ">MAC")
    for i, (old, new) in enumerate(rows):
        natural, _, damping = (f"{old[k]:>{widths[0][k]}} → {new[k]:>{widths[1][k]}}" for k in range(3))
        pair = (str(was[i] + 1), f"{mac[was[i], i]:.2f}") if i in was else (NONE, NONE)
        spreads = (NONE, NONE) if intervals is None else _spreads(intervals, i)
        grid.add_row(str(i + 1), pair[0], natural, spreads[0], new[1], damping, spreads[1], pair[1])
    return grid


def _spreads(intervals: ModalIntervals, i: int) -> tuple[str, str]:
    told = []
    for k, side in enumerate((intervals.natural_freq_hz, intervals.damping_ratio)):
        low, high = (float(end) for end in side[i])
        spread = format_spread(low, high).removeprefix("± ").replace("×/÷ ", "×÷")
        told.append(f"{spread}{'*' if intervals.open[i, k] else ''}" if high > low > 0 else NONE)
    return told[0], told[1]


def _mode_words(modes: Modes, i: int | None) -> tuple[str, str, str]:
    if i is None:
        return NONE, NONE, NONE
    damped = format_hz(float(modes.damped_freq_hz[i])) if modes.oscillatory[i] else "none"
    return format_hz(float(modes.natural_freq_hz[i])), damped, f"{100 * modes.damping_ratio[i]:.2f}"


def modes_data(modes: Modes) -> list[dict[str, Any]]:
    """Each mode with its numbers; shares and shapes are by coordinate."""
    return [
        {
            "natural_freq_hz": modes.natural_freq_hz[i],
            "damped_freq_hz": modes.damped_freq_hz[i],
            "damping_ratio": modes.damping_ratio[i],
            "oscillatory": bool(modes.oscillatory[i]),
            "pole": {"re": modes.poles[i].real, "im": modes.poles[i].imag},
            "participation": dict(zip(modes.coordinates, modes.participation[:, i].tolist(), strict=True)),
            "shape": {"re": modes.shapes[:, i].real, "im": modes.shapes[:, i].imag},
        }
        for i in range(len(modes))
    ]


def fit_data(fit: Fit, postures: Sequence[str], true_values: Mapping[str, float] | None = None) -> dict[str, Any]:
    """The whole fit, as in `fit_tables`; an interval end of null is open."""
    from armonic.updating.bands import intervals_after
    from armonic.updating.directions import correlation, directions

    return {
        "status": fit.status,
        "message": fit.message,
        "method": fit.method,
        "cost": fit.cost,
        "start_cost": fit.start_cost,
        "evaluations": fit.evaluations,
        "stages": [
            {
                "name": stage.name,
                "sigma": stage.sigma,
                "evaluations": len(stage.history),
                "cost": stage.history[-1] if len(stage.history) else None,
            }
            for stage in fit.stages
        ],
        "starts": list(fit.starts),
        "noise": fit.noise,
        "doubts": list(fit.doubts),
        "duration_s": fit.duration_s,
        "record": fit.record.as_dict(),
        "parameters": [
            {
                "path": p.path,
                "unit": p.unit,
                "start": p.start,
                "value": p.value,
                "bounds": [p.lower, p.upper],
                "interval": list(p.interval),
                "verdict": p.verdict,
                "scale": p.scale,
                "deviation": p.deviation,
                "tied": list(p.tied),
                "law": None if c.law is None else c.law.over,
                **({} if true_values is None else {"true": true_values.get(p.path)}),
            }
            for p, c in zip(fit.parameters, fit.coordinates, strict=True)
        ],
        "correlation": correlation(fit.covariance),
        "directions": [
            {
                "deviation": direction.deviation,
                "weights": dict(zip((p.path for p in fit.coordinates), direction.weights.tolist(), strict=True)),
                "words": direction.words,
            }
            for direction in directions(fit)
        ],
        "postures": [
            {
                "posture": label,
                "coordinates": list(before.coordinates),
                "before": modes_data(before),
                "after": modes_data(after),
                "after_intervals": _intervals_data(intervals_after(fit, k)),
                "mac": mac,
            }
            for k, (label, before, after, mac) in enumerate(zip(postures, fit.before, fit.after, fit.mac, strict=True))
        ],
    }


def _intervals_data(intervals: ModalIntervals | None) -> list[dict[str, Any]] | None:
    """95 % intervals of the modes after, and whether bounds hold them rather than data."""
    if intervals is None:
        return None
    return [
        {
            "natural_freq_hz": intervals.natural_freq_hz[i],
            "damped_freq_hz": intervals.damped_freq_hz[i],
            "damping_ratio": intervals.damping_ratio[i],
            "open": {"natural_freq_hz": bool(intervals.open[i, 0]), "damping_ratio": bool(intervals.open[i, 1])},
        }
        for i in range(len(intervals.modes))
    ]
