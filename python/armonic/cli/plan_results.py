"""A plan in tables for people, in plain data for machines and as a table of numbers."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armonic.cli.terminal import VERDICT_STYLE, heading, table
from armonic.text import count, format_percent, format_si, split_path
from armonic.writing import write_whole

if TYPE_CHECKING:
    from rich.console import RenderableType

    from armonic.robot import Robot
    from armonic.updating.candidates import Candidate
    from armonic.updating.planning import Plan

SHOWN = 10
"""So many of the ranking are printed."""
STEPS = 3
"""Up to so many measurements have a column of their own."""


def plan_tables(result: Plan, measured: int) -> list[RenderableType]:
    """The ranking, the intervals before and after, and what the plan says.

    Args:
        result: the plan.
        measured: how many measurements there were before.
    """
    title = f"{result.robot.name}: what to measure next"
    basis = f"after {count(measured, 'measurement')}" if measured else "nothing measured yet"
    about = (
        f"{count(len(result.ranking), 'candidate')}, {basis}, noise {format_percent(result.noise, digits=2)}, "
        f"criterion {result.criterion}. How many times narrower the intervals become is a geometric mean over all "
        "parameters, each within its bounds at first."
    )
    rest = len(result.ranking) - SHOWN
    more = [f"... and {count(rest, 'candidate')} more"] if rest > 0 else []
    tables: list[RenderableType] = [heading(title), "", _ranking(result), *more, "", about, ""]
    tables += [heading("95 % intervals, expected"), "", _parameters(result), ""]
    return [*tables, *result.notes]


def _ranking(result: Plan) -> RenderableType:
    chosen = {id(c): i for i, c in enumerate(result.chosen, 1)}
    grid = table(">measure", "candidate", ">alone\nrank", ">intervals\nnarrower", ">identified")
    rows = [(rank, one) for rank, one in enumerate(result.ranking, 1)]
    first = sorted((row for row in rows if id(row[1].candidate) in chosen), key=lambda r: chosen[id(r[1].candidate)])
    others = [row for row in rows[:SHOWN] if id(row[1].candidate) not in chosen]
    for rank, one in [*first, *others]:
        order = chosen.get(id(one.candidate))
        told = f"{format_si(one.narrowing, digits=3)} times", f"{one.identified} of {len(result.parameters)}"
        grid.add_row("" if order is None else f"{order}.", one.candidate.label, str(rank), *told)
    return grid


def _parameters(result: Plan) -> RenderableType:
    from rich.text import Text

    from armonic.updating.advice import spread

    steps = len(result.chosen)
    shown = [0, *range(1, steps + 1)] if steps <= STEPS else [0, 1, steps]
    names = ["before", *(f"after {step}" for step in shown[1:])]
    grid = table("", *(f">{name}" for name in names), "verdict")
    groups: dict[tuple[str, str], list[Any]] = {}
    for p in result.parameters:
        groups.setdefault((split_path(p.path)[1], p.unit), []).append(p)
    for (quantity, unit), members in groups.items():
        if quantity:
            grid.add_row(Text(quantity, style="italic"), Text(unit, style="italic"))
        for p in members:
            before, after = p.verdicts[0], p.verdicts[-1]
            verdict = Text(before, style=VERDICT_STYLE[before])
            if after != before:
                verdict.append(" → ", style="default").append(after, style=VERDICT_STYLE[after])
            grid.add_row(f"  {split_path(p.path)[0]}", *(spread(p, step) for step in shown), verdict)
    return grid


def _candidate(robot: Robot, c: Candidate) -> dict[str, Any]:
    return {
        "candidate": c.label,
        "posture": dict(zip(robot.coordinates, robot.posture(c.posture).tolist(), strict=True)),
        "sensor": c.frame,
        "impact": c.input_frame or c.frame,
        "outputs": list(c.outputs),
        "inputs": list(c.inputs),
    }


def plan_data(result: Plan) -> dict[str, Any]:
    """The whole plan; an interval end of null is open."""
    robot = result.robot
    return {
        "robot": robot.name,
        "criterion": result.criterion,
        "noise": result.noise,
        "chosen": [_candidate(robot, c) for c in result.chosen],
        "ranking": [
            _candidate(robot, r.candidate) | {"gain": r.gain, "narrowing": r.narrowing, "identified": r.identified}
            for r in result.ranking
        ],
        "parameters": [
            {
                "path": p.path,
                "unit": p.unit,
                "value": p.value,
                "intervals": [list(interval) for interval in p.intervals],
                "verdicts": list(p.verdicts),
                "verdict_with_all": p.verdict_with_all,
            }
            for p in result.parameters
        ],
        "log_widths": result.log_widths,
        "notes": list(result.notes),
    }


def write_ranking(result: Plan, path: Path) -> None:
    """One row per candidate, the most useful alone first; postures to the last digit, in rad and m."""
    chosen = {id(c): i for i, c in enumerate(result.chosen, 1)}
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    names = ("rank", "measure", "candidate", "sensor", "impact", "outputs", "inputs", "gain", "narrowing", "identified")
    rows.writerow([*names, *result.robot.coordinates])
    for rank, one in enumerate(result.ranking, 1):
        told = _candidate(result.robot, one.candidate)
        rows.writerow(
            [
                rank,
                chosen.get(id(one.candidate), ""),
                *(told[name] for name in ("candidate", "sensor", "impact")),
                *(" ".join(told[name]) for name in ("outputs", "inputs")),
                *(repr(v) for v in (one.gain, one.narrowing, one.identified)),
                *(repr(v) for v in told["posture"].values()),
            ]
        )
    write_whole(path, text.getvalue().encode("utf-8"))
