"""`armonic map`: modal parameters over the workspace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments, ranges
from armonic.cli.arguments import ForceFlag, FrameOption, JsonFlag, PostureOption, RobotName, UsageError
from armonic.cli.model import WrenchAxesOption, WrenchOption
from armonic.cli.outputs import check_output
from armonic.cli.terminal import heading, line, print_json, remark, show, steps_progress, table
from armonic.cli.tool import ToolMassOption
from armonic.text import count, format_hz, format_percent

if TYPE_CHECKING:
    import xarray as xr
    from rich.table import Table

    from armonic.loads import WrenchAxes
    from armonic.map_summary import MapSummary
    from armonic.robot import Robot

POINTS = 100
"""Of a path that is typed without saying how many."""


def map_(
    robot: RobotName,
    path: Annotated[
        str | None,
        typer.Option(
            "--path", metavar="NAME|P..P", help="A path of the robot file, or postures to go through: c1..c50."
        ),
    ] = None,
    points: Annotated[
        int | None, typer.Option("--points", metavar="N", help=f"Postures of a typed path. Default: {POINTS}.")
    ] = None,
    grid: Annotated[
        list[str] | None,
        typer.Option("--grid", metavar="JOINT=LO:HI:N", help="A coordinate over a grid; once for each of several."),
    ] = None,
    sample: Annotated[
        list[str] | None,
        typer.Option("--sample", metavar="JOINT=LO:HI", help="A coordinate of a sample; once for each of several."),
    ] = None,
    number: Annotated[int, typer.Option("--count", metavar="N", help="Postures of a sample.")] = 1024,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of a sample.")] = 0,
    posture: PostureOption = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            "--sweep",
            metavar="PATH=LO:HI:N|V,V",
            help="A number of the robot file over values; several go along with each other.",
        ),
    ] = None,
    tool_mass: ToolMassOption = None,
    wrench: WrenchOption = None,
    frame: FrameOption = None,
    wrench_axes: WrenchAxesOption = "world",
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="STORE", help="Stream the map into this Zarr store, or go on with it."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="Write figures and tables to this HTML file.")
    ] = None,
    shapes: Annotated[bool, typer.Option("--shapes", help="Keep mode shapes in the map.")] = False,
    participation: Annotated[
        bool, typer.Option("--participation/--no-participation", help="Keep energy shares of the joints in the map.")
    ] = True,
    threads: Annotated[int | None, typer.Option("--threads", metavar="N", help="Default: one per processor.")] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Let the workers of a Dask cluster do it.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Modal parameters over paths, grids, samples and sweeps.

    Modes are followed from posture to posture and checked to be complete. With --tool-mass the map holds two cases, the
    robot as its file has it and with that tool. A map that was interrupted goes on when the command is typed again.
    """
    axes: WrenchAxes = arguments.choice("--wrench-axes", wrench_axes, ("world", "frame"))
    load = None if wrench is None else arguments.wrench(wrench)
    if load is None and frame is not None:
        raise UsageError("--frame", found=f"{frame!r} without a wrench", expected="both, or neither")
    the_robot = arguments.open_robot(robot)
    if report is not None:
        check_output("--report", report, force=force, sources=[Path(robot), *([output] if output else [])])
    at = None if load is None else arguments.frame(the_robot, frame)
    swept = ranges.sweep(the_robot, sweep or (), tool_mass)
    where = _postures(the_robot, path, points, grid or (), sample or (), number, seed, posture, swept)

    from armonic.surveying import survey

    try:
        with steps_progress("Mapping", "postures") as progress:
            result = survey(
                the_robot,
                where,
                sweep=swept,
                wrench=load,
                frame=at,
                wrench_axes=axes,
                shapes=shapes,
                participation=participation,
                store=output,
                threads=threads,
                client=scheduler,
                progress=progress,
            )
    except KeyboardInterrupt:
        kept = "nothing was kept" if output is None else f"{output} keeps what was done, type the same again to go on"
        remark(f"Interrupted: {kept}.")
        raise
    if report is not None:
        from armonic.map_report import write_map_report

        write_map_report(result, report, robot=the_robot)
    _tell(the_robot, result, output, report, as_json=as_json)


def _postures(
    robot: Robot,
    path: str | None,
    points: int | None,
    grid: Sequence[str],
    sample: Sequence[str],
    number: int,
    seed: int,
    posture: str | None,
    swept: Mapping[str, Any],
) -> Any:
    """What was typed of where to go; exactly one of path, grid and sample, or a posture for a sweep.

    Raises:
        UsageError: none or several of them.
    """
    from armonic.surveying import Grid, Sample
    from armonic.surveying import path as through

    given = [name for name, value in (("--path", path), ("--grid", grid), ("--sample", sample)) if value]
    if len(given) > 1 or not (given or swept):
        paths = f" (paths of this file: {', '.join(robot.paths)})" if robot.paths else ""
        raise UsageError(
            "armonic map",
            found=" and ".join(given) or "nothing to go over",
            expected=f"one of --path, --grid and --sample, or --sweep at a --posture{paths}",
        )
    if points is not None and (path is None or path in robot.paths):
        raise UsageError("--points", found=str(points), expected="a --path of postures that are typed, such as c1..c50")
    if path is not None:
        if posture is not None:
            raise UsageError("--posture", found="a posture beside a path", expected="one of them")
        if path in robot.paths:
            return path
        parts = path.split("..")
        if len(parts) < 2:
            known = f"one of {', '.join(robot.paths)}, or " if robot.paths else ""
            raise UsageError("--path", found=repr(path), expected=f"{known}two or more postures with .. between them")
        corners = [arguments.posture(robot, part.strip())[0] for part in parts]
        return through(robot, corners, POINTS if points is None else points)
    if not given:
        return arguments.posture(robot, posture)[0]
    base = None if posture is None else arguments.posture(robot, posture)[0]
    if grid:
        return Grid(ranges.values(robot, "--grid", grid), base)
    return Sample(ranges.ends(robot, "--sample", sample), number, seed=seed, base=base)


def _tell(robot: Robot, result: xr.Dataset, output: Path | None, report: Path | None, *, as_json: bool) -> None:
    from armonic.map_summary import summarize

    summary = summarize(result)
    if as_json:
        print_json(_data(robot, result, summary, output, report))
        return
    from rich.text import Text

    dims = " x ".join(f"{dim} {result.sizes[dim]}" for dim in summary.layout.dims)
    show(heading(f"{robot.name}: {count(summary.count, 'set')} of modes over {dims}"), "", _ranges(summary), "")
    if summary.unstable:
        show(Text(f"Unstable in {summary.unstable} of {summary.count}: some motion grows there.", style="red"))
    elif summary.marginal:
        show(Text(f"Marginally stable in {summary.marginal} of {summary.count}.", style="yellow"))
    else:
        show(Text("Asymptotically stable everywhere.", style="green"))
    met = ", ".join(f"{number} {name}{'s' if number != 1 else ''}" for name, number in summary.totals.items())
    show(f"Modes that meet: {met or 'none'}. Every set of modes was checked to be complete.")
    if summary.dense:
        show(f"The dense solver took over at {summary.dense} of {summary.count}.")
    for what, place in (("map", output), ("report", report)):
        if place is not None:
            line(f"Wrote the {what}: {place}")


def _ranges(summary: MapSummary) -> Table:
    grid = table(">", ">natural Hz\nfrom", ">\nto", ">damping %\nfrom", ">\nto")
    for mode in summary.modes:
        damping = (format_percent(end.value).removesuffix(" %") for end in (mode.least_damped, mode.most_damped))
        grid.add_row(str(mode.number), format_hz(mode.slowest.value), format_hz(mode.fastest.value), *damping)
    return grid


def _data(
    robot: Robot, result: xr.Dataset, summary: MapSummary, output: Path | None, report: Path | None
) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "dims": {dim: result.sizes[dim] for dim in summary.layout.dims},
        "sets_of_modes": summary.count,
        "unstable": summary.unstable,
        "marginal": summary.marginal,
        "dense": summary.dense,
        "events": dict(summary.totals),
        "modes": [
            {
                "mode": mode.number,
                "natural_freq_hz": [mode.slowest.value, mode.fastest.value],
                "damping_ratio": [mode.least_damped.value, mode.most_damped.value],
            }
            for mode in summary.modes
        ],
        "map": None if output is None else str(output),
        "report": None if report is None else str(report),
    }
