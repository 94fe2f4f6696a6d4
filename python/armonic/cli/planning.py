"""`armonic plan`: which postures, impact points and directions to measure next, and what that would tell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from armonic.cli import arguments, problem, ranges
from armonic.cli.arguments import ForceFlag, JsonFlag, RobotName, UsageError
from armonic.cli.measured import Many, Reading, measurements
from armonic.cli.outputs import check_output
from armonic.cli.plan_results import plan_data, plan_tables, write_ranking
from armonic.cli.terminal import line, print_json, show

if TYPE_CHECKING:
    from armonic.robot import Robot
    from armonic.updating.candidates import Candidate
    from armonic.updating.measurement import Measurement

SAMPLES = 256


class Where(NamedTuple):
    """The postures that were typed, in the ways that there are."""

    candidates: Sequence[str]
    grid: Sequence[str]
    sample: Sequence[str]
    samples: int
    seed: int
    base: str | None


def plan(
    robot: RobotName,
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FRF_FILE", help="What the robot was fitted to: .uff or .csv."),
    ] = None,
    posture: Annotated[
        Many | None,
        typer.Option("--posture", metavar="P", help="Where it was measured; once for all files, or once per file."),
    ] = None,
    frame: Annotated[
        Many | None,
        typer.Option("--frame", metavar="F", help="The sensor's frame in the files; once, or once per file."),
    ] = None,
    candidates: Annotated[
        Many | None,
        typer.Option(
            "--candidates",
            metavar="P,P|PATH",
            help="Postures to choose from: names, a path of the robot file, or coordinates as 0,70deg,-100deg;"
            " repeatable. Default: all named postures.",
        ),
    ] = None,
    grid: Annotated[
        Many | None,
        typer.Option("--grid", metavar="JOINT=LO:HI:N", help="Choose from a grid; once for each coordinate."),
    ] = None,
    sample: Annotated[
        Many | None,
        typer.Option("--sample", metavar="JOINT=LO:HI", help="Choose from a sample; once for each coordinate."),
    ] = None,
    samples: Annotated[int, typer.Option("--samples", metavar="N", help="Postures of a sample.")] = SAMPLES,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of a sample.")] = 0,
    base: Annotated[
        str | None,
        typer.Option("--base", metavar="P", help="Where the other coordinates of a grid or sample stand. Default: 0."),
    ] = None,
    sensor: Annotated[
        Many | None,
        typer.Option("--sensor", metavar="F", help="Where the sensor may sit; repeatable. Default: as measured."),
    ] = None,
    impact: Annotated[
        Many | None,
        typer.Option("--impact", metavar="F", help="Where the force may act; repeatable. Default: as measured."),
    ] = None,
    each_input: Annotated[
        bool, typer.Option("--each-input", help="Choose directions of the force one by one, as for a hammer.")
    ] = False,
    number: Annotated[int, typer.Option("--count", metavar="N", help="How many measurements to choose.")] = 2,
    criterion: Annotated[
        str,
        typer.Option("--criterion", metavar="NAME", help="intervals, D (volume of the ellipsoid) or A (variances)."),
    ] = "intervals",
    freq: Annotated[
        str | None,
        typer.Option("--freq", metavar="LO:HI:STEP", help="Lines to measure, Hz. Default: as measured, or 0.2:30:0.2."),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option("--noise", metavar="SHARE", help="Relative noise: 0.01 or 1%. Default: that of the files, or 1%."),
    ] = None,
    parameters: Annotated[
        str,
        typer.Option("--parameters", metavar="PATTERN,...", help="What is to be known, as for `armonic update`."),
    ] = "elasticity",
    bounds: Annotated[
        Many | None, typer.Option("--bounds", metavar="PATTERN=LO:HI", help="Bounds in SI units; repeatable.")
    ] = None,
    prior: Annotated[
        Many | None,
        typer.Option(
            "--prior", metavar="PATTERN=SHARE", help="Known from elsewhere, to this relative deviation; repeatable."
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the ranking to this CSV file.")
    ] = None,
    band: Annotated[
        str | None, typer.Option("--band", metavar="LO:HI", help="Lines of the files that were fitted, Hz.")
    ] = None,
    symmetrize: Annotated[
        str | None, typer.Option("--symmetrize", metavar="HOW", help="As in `armonic update`; so are those below.")
    ] = None,
    kind: Annotated[str | None, typer.Option("--kind", metavar="KIND", help="What the files hold.")] = None,
    scale: Annotated[float | None, typer.Option("--scale", metavar="X", help="Factor from the files to SI.")] = None,
    axes: Annotated[
        str | None, typer.Option("--axes", metavar="PAIRS", help="Axes of the file onto the frame.")
    ] = None,
    outputs: Annotated[
        str | None, typer.Option("--outputs", metavar="AXES", help="Axes of the response, of files and candidates.")
    ] = None,
    inputs: Annotated[
        str | None, typer.Option("--inputs", metavar="AXES", help="Axes of the force, of files and candidates.")
    ] = None,
    responses: Annotated[
        str | None, typer.Option("--responses", metavar="OUT/IN,...", help="Responses of the files, one by one.")
    ] = None,
    response_node: Annotated[
        int | None, typer.Option("--response-node", metavar="N", help="The node of the response.")
    ] = None,
    reference_node: Annotated[
        int | None, typer.Option("--reference-node", metavar="N", help="The node of the force.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Choose the next measurements, and say what they would tell.

    Give the robot alone, or as it was updated, with the files that it was fitted to.
    """
    from armonic.updating.design import CRITERIA

    by = arguments.choice("--criterion", criterion, CRITERIA)
    lines = None if freq is None else arguments.lines(freq)
    limits = arguments.bounds(bounds or ())
    share = None if noise is None else problem.share("--noise", noise)
    read = files or []
    if output is not None:
        check_output("-o", output, force=force, sources=[*read, Path(robot)])
    the_robot = arguments.open_robot(robot)
    known = problem.priors(the_robot, prior or ())
    reading = Reading(kind, scale, axes, outputs, inputs, responses, response_node, reference_node, band, symmetrize)
    measured = _measured(the_robot, read, reading, posture or (), frame or ())
    where = Where(candidates or (), grid or (), sample or (), samples, seed, base)
    options = _candidates(the_robot, where, sensor, impact, measured, (outputs, inputs), each_input=each_input)

    from armonic.updating.planning import plan_measurement

    result = plan_measurement(
        the_robot,
        measured or None,
        options,
        count=number,
        criterion=by,
        noise=share,
        freq_hz=lines,
        parameters=parameters,
        bounds=limits or None,
        priors=known or None,
    )
    if output is not None:
        write_ranking(result, output)
    if as_json:
        print_json(plan_data(result) | {"written": {} if output is None else {"ranking": str(output)}})
        return
    show(*plan_tables(result, len(measured)))
    if output is not None:
        line(f"Wrote the ranking: {output}")


def _measured(
    robot: Robot, files: Sequence[Path], reading: Reading, postures: Sequence[str], frames: Sequence[str]
) -> list[Measurement]:
    if files:
        return measurements(robot, files, reading, postures, frames, "uniform")[0]
    for option, given in (("--posture", postures), ("--frame", frames)):
        if given:
            expected = "the FRF files that were measured there"
            hint = "Postures to choose from are --candidates, where the sensor may sit is --sensor."
            raise UsageError(option, found="it without files", expected=expected, hint=hint)
    return []


def _candidates(
    robot: Robot,
    where: Where,
    sensors: Sequence[str] | None,
    impacts: Sequence[str] | None,
    measured: Sequence[Measurement],
    axes: tuple[str | None, str | None],
    *,
    each_input: bool,
) -> tuple[Candidate, ...]:
    from armonic.updating.candidates import candidates
    from armonic.updating.planning import measured_sight

    options: dict[str, Any] = measured_sight(measured) if measured else {}
    options |= {"frames": sensors} if sensors else {}
    options |= {"impacts": impacts} if impacts else {}
    typed = zip(("outputs", "inputs"), axes, strict=True)
    options |= {name: arguments.axes(f"--{name}", text) for name, text in typed if text is not None}
    if not measured and not sensors:
        options["frames"] = arguments.frame(robot, None, "--sensor")
    return candidates(robot, _postures(robot, where), each_input=each_input, **options)


def _postures(robot: Robot, where: Where) -> Any:
    """What was typed of where to measure; one of the ways to say it, or the robot's named postures.

    Raises:
        UsageError: several ways, or no posture at all.
    """
    from armonic.surveying import Grid, Sample

    ways = (("--candidates", where.candidates), ("--grid", where.grid), ("--sample", where.sample))
    given = [name for name, value in ways if value]
    if len(given) > 1:
        raise UsageError("armonic plan", found=" and ".join(given), expected="one of them")
    if where.base is not None and given not in (["--grid"], ["--sample"]):
        raise UsageError("--base", found="it without --grid or --sample", expected="one of them")
    base = None if where.base is None else arguments.posture(robot, where.base)[0]
    if where.grid:
        return Grid(ranges.values(robot, "--grid", where.grid), base)
    if where.sample:
        return Sample(ranges.ends(robot, "--sample", where.sample), where.samples, seed=where.seed, base=base)
    if not where.candidates:
        if len(robot.postures) < 2:
            found = "no candidates" if robot.postures else "no candidates, and no posture in the robot file"
            raise UsageError("armonic plan", found=found, expected="one of --candidates, --grid and --sample")
        return list(robot.postures)
    found_all: list[Any] = []
    for text in where.candidates:
        if text in robot.paths:
            found_all += list(robot.paths[text])
            continue
        parts = [part.strip() for part in text.split(",")]
        named = not any(part.startswith(tuple("+-.0123456789")) for part in parts)
        found_all += [arguments.posture(robot, part)[0] for part in (parts if named else [text])]
    return found_all
