"""A run in time, shown: what was done, where the energy went, and how far everything moved."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic.cli.terminal import heading, table, warning
from armonic.text import count, format_duration, format_percent, format_si

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from armonic.series import TimeSeries
    from armonic.simulation.running import Run

LEAST_ENERGY = 1e-18
"""J; a force that moves nothing does less work, of which nothing has to be accounted for."""
ENERGIES = {
    "work of forces": "work of the forces",
    "work of motors": "work of the motors",
    "dissipated": "dissipated",
}


def peaks(series: TimeSeries) -> list[dict[str, Any]]:
    """Per quantity and unit, but of energy: the channel that leaves its start farthest, by how much and when."""
    found: list[dict[str, Any]] = []
    groups: dict[tuple[str, str], list[int]] = {}
    for column, channel in enumerate(series.channels):
        if channel.quantity not in ("energy", "power"):
            groups.setdefault((channel.quantity, channel.unit), []).append(column)
    for (quantity, unit), columns in groups.items():
        values = series.values[:, columns]
        # A force acts from nothing; all else from where the run began.
        change = np.abs(values - (0.0 if quantity == "force" else values[0]))
        sample, k = (int(i) for i in np.unravel_index(np.argmax(change), change.shape))
        found.append(
            {
                "quantity": quantity,
                "unit": unit,
                "channel": series.channels[columns[k]].name,
                "change": float(change[sample, k]),
                "value": float(values[sample, k]),
                "time_s": float(series.time_s[sample]),
            }
        )
    return found


def energies(run: Run) -> dict[str, float]:
    """Energy at the end against the start, what was given and lost, and the most that is not accounted for, J."""
    names = {channel.name for channel in run.series.channels if channel.quantity == "energy"}
    last = {name: float(run[f"energy:{name}"][-1]) for name in names}
    held = run["energy:kinetic"] + run["energy:potential"]
    return {
        "held": float(held[-1] - held[0]),
        **{name: last[name] for name in ENERGIES},
        "unaccounted": float(np.abs(run.energy_error()).max()),
    }


def run_tables(series: TimeSeries, run: Run | None, context: str, what: list[str]) -> Iterator[RenderableType]:
    """What is printed of a run.

    Args:
        series: every channel, without what sensors make of it.
        run: how it was computed; None of the linear response.
        context: robot, posture and the like.
        what: each thing that acted or was changed, as typed.
    """
    yield heading(context)
    yield f"{count(len(series), 'sample')} at {series.sample_rate_hz:g} Hz, {format_si(series.duration_s, 's')}" + (
        f", {', '.join(what)}" if what else ", nothing acting"
    )
    yield ""
    yield peak_table(series)
    yield ""
    if run is None:
        yield "The linearized model by matrix exponentials, without an error of integration."
        return
    fast = series.duration_s / run.seconds if run.seconds > 0 else np.inf
    pace = f"{format_si(fast, digits=2)} times real time"
    yield (
        f"{count(run.steps, f'{run.method} step')}, {run.rejected} of them taken back, in"
        f" {format_duration(run.seconds)}: {pace}."
    )
    spent = energies(run)
    given = ", ".join(f"{words} {format_si(spent[name], 'J', digits=3)}" for name, words in ENERGIES.items())
    yield (
        f"Energy: {given}, held at the end {format_si(spent['held'], 'J', digits=3)};"
        f" unaccounted for {format_si(spent['unaccounted'], 'J', digits=2)} at most."
    )
    size = max(abs(spent[name]) for name in ENERGIES)
    if spent["unaccounted"] > 1e-3 * size > LEAST_ENERGY:
        yield warning(
            f"the energy balance is open by {format_percent(spent['unaccounted'] / size, digits=2)}: lower --tolerance."
        )


def peak_table(series: TimeSeries) -> Table:
    """A row per quantity; positions as changes from the start."""
    grid = table("largest change of", "where", ">from the start", ">to", "", ">at s")
    for peak in peaks(series):
        moved = peak["change"] > 0
        numbers = [format_si(peak[key], digits=4) for key in ("change", "value")]
        at = format_si(peak["time_s"], digits=4) if moved else "–"
        words = peak["quantity"].replace("_", " ")
        grid.add_row(words, peak["channel"] if moved else "–", *numbers, peak["unit"], at)
    return grid


def run_data(series: TimeSeries, run: Run | None) -> dict[str, Any]:
    """The same for machines."""
    data: dict[str, Any] = {
        "model": "linear" if run is None else "nonlinear",
        "samples": len(series),
        "sample_rate_hz": series.sample_rate_hz,
        "duration_s": series.duration_s,
        "channels": list(series.labels),
        "peaks": peaks(series),
    }
    if run is None:
        return data | {"status": "complete"}
    return data | {
        "status": run.status,
        "method": run.method,
        "steps": run.steps,
        "rejected": run.rejected,
        "evaluations": run.evaluations,
        "seconds": run.seconds,
        "energy_j": energies(run),
    }
