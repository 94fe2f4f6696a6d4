"""A fit in tables for people and in plain data for machines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from armonic.cli.terminal import VERDICT_STYLE, heading, table, warning
from armonic.text import (
    format_hz,
    format_interval,
    format_percent,
    format_si,
    split_path,
    summary,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import RenderableType

    from armonic.modal import Modes
    from armonic.updating import Fit, FittedParameter

NONE = "–"
"""Stands in a table where there is no number."""


def fit_tables(
    fit: Fit, postures: Sequence[str], true_values: Mapping[str, float] | None = None
) -> Iterator[RenderableType]:
    """The parameter table, the modal table of each posture, and how the fit went.

    Args:
        fit: the result.
        postures: what to call each of `fit.postures`.
        true_values: values by path for a column of their own.
    """
    yield heading("Parameters")
    yield _parameter_table(fit.parameters, true_values)
    yield ""
    for label, before, after, mac in zip(postures, fit.before, fit.after, fit.mac, strict=True):
        yield heading(f"Modes in posture {label}, before → after, paired by MAC")
        yield _modal_table(before, after, mac)
        yield ""
    if fit.measurements:
        differ = (
            f"Model and measurement differ by about {format_percent(fit.noise, digits=2)} (one standard deviation, "
            "equal weights); the intervals take that for noise that is the same share of every value."
        )
    else:
        times = format_si(fit.noise, digits=2)
        differ = f"Modelled and measured modes differ by about {times} times the deviations that were stated."
    yield f"{summary(fit)} {differ}"
    for doubt in fit.doubts:
        yield ""
        yield warning(doubt)


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
                f"  {split_path(p.path)[0]}",
                format_si(p.start),
                format_si(p.value),
                *true,
                format_interval(*p.interval, signed=p.scale == "linear"),
                Text(p.verdict, style=VERDICT_STYLE[p.verdict]),
            )
    return grid


def _modal_table(before: Modes, after: Modes, mac: NDArray[np.float64]) -> RenderableType:
    """Each mode after the fit beside the one before that it resembles most, one to one as in the report."""
    from scipy.optimize import linear_sum_assignment

    was = dict(zip(*(index.tolist() for index in linear_sum_assignment(-mac.T)), strict=True))
    rows = [(_mode_words(before, was.get(i)), _mode_words(after, i)) for i in range(len(after))]
    widths = [[max(len(row[side][k]) for row in rows) for k in range(3)] for side in (0, 1)]
    grid = table(">", ">was", ">natural Hz", ">damped Hz", ">damping %", ">MAC")
    for i, (old, new) in enumerate(rows):
        steps = [f"{old[k]:>{widths[0][k]}} → {new[k]:>{widths[1][k]}}" for k in range(3)]
        pair = (str(was[i] + 1), f"{mac[was[i], i]:.2f}") if i in was else (NONE, NONE)
        grid.add_row(str(i + 1), pair[0], *steps, pair[1])
    return grid


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
                **({} if true_values is None else {"true": true_values.get(p.path)}),
            }
            for p in fit.parameters
        ],
        "postures": [
            {
                "posture": label,
                "coordinates": list(before.coordinates),
                "before": modes_data(before),
                "after": modes_data(after),
                "mac": mac,
            }
            for label, before, after, mac in zip(postures, fit.before, fit.after, fit.mac, strict=True)
        ],
    }
