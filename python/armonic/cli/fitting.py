"""`armonic update`: measured responses or modes and a robot file in, the updated robot and a report out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments, problem
from armonic.cli.arguments import ForceFlag, JsonFlag, RobotName, UsageError
from armonic.cli.delivery import deliver
from armonic.cli.measured import (
    AxesOption,
    InputsOption,
    KindOption,
    Many,
    MapOption,
    OutputsOption,
    Reading,
    ReferenceNodeOption,
    ResponseNodeOption,
    ResponsesOption,
    ScaleOption,
    SymmetrizeOption,
    SynthesizeFlag,
    measurements,
)
from armonic.cli.outputs import check_output
from armonic.cli.terminal import fit_progress, remark
from armonic.errors import ArmonicError, UpdateError

if TYPE_CHECKING:
    from armonic.robot import Robot
    from armonic.updating import Fit, Genetic, Measurement, ModalMeasurement

_DATA, _WHAT, _HOW = "What was measured", "What is fitted", "How it is fitted"
_OPTIONS = {
    **{name: f"--{name}" for name in ("parameters", "bounds", "hold", "starts", "seed", "threads", "tolerance")},
    **{"ties": "--tie", "laws": "--law", "priors": "--prior", "max_evaluations": "--max-evaluations"},
    **{"Genetic.population": "--population", "Genetic.generations": "--generations"},
}
"""What the library's arguments are called here."""


def update(
    robot: RobotName,
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FRF_FILE", help="Measured: responses or time records, .uff, .csv, .h5."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="The updated robot file.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="A report as one HTML file that opens offline."),
    ] = None,
    posture: Annotated[
        Many | None,
        typer.Option(
            "--posture",
            metavar="P",
            help="Where it was measured; once for all files, or once per file, those of --modes last.",
            rich_help_panel=_DATA,
        ),
    ] = None,
    frame: Annotated[
        Many | None,
        typer.Option(
            "--frame",
            metavar="F",
            help="The sensor's frame; once, or once per FRF file. Default: as in the file.",
            rich_help_panel=_DATA,
        ),
    ] = None,
    coherence: Annotated[
        list[Path] | None,
        typer.Option(
            "--coherence",
            metavar="FILE",
            help="Coherence, which weighs every value; once per FRF file: .uff (it may be the same file),"
            " or .csv with freq_hz,x/x,x/y,...",
            rich_help_panel=_DATA,
        ),
    ] = None,
    modes: Annotated[
        list[Path] | None,
        typer.Option(
            "--modes",
            metavar="FILE",
            help="Measured modes, alone or beside responses; repeatable. Universal files (data set 55) and .h5 with"
            " their shapes, or .csv with the columns natural_freq_hz or damped_freq_hz;"
            " damping_ratio or damping_percent; freq_deviation, damping_deviation (shares; 0.005 and 0.1 if absent).",
            rich_help_panel=_DATA,
        ),
    ] = None,
    weights: Annotated[
        str,
        typer.Option(
            "--weights",
            metavar="peaks|uniform",
            help="Stress the peaks, or take every line alike.",
            rich_help_panel=_DATA,
        ),
    ] = "peaks",
    band: Annotated[
        str | None,
        typer.Option("--band", metavar="LO:HI", help="Fit these lines only, Hz.", rich_help_panel=_DATA),
    ] = None,
    kind: KindOption = None,
    scale: ScaleOption = None,
    axes: AxesOption = None,
    outputs: OutputsOption = None,
    inputs: InputsOption = None,
    responses: ResponsesOption = None,
    response_node: ResponseNodeOption = None,
    reference_node: ReferenceNodeOption = None,
    symmetrize: SymmetrizeOption = None,
    synthesize: SynthesizeFlag = False,
    channels: MapOption = None,
    parameters: Annotated[
        str,
        typer.Option(
            "--parameters",
            metavar="PATTERN,...",
            help="elasticity, stiffness, damping, or paths as links.arm.elasticity.*.stiffness; also any other number:"
            " links.arm.mass, links.*.com.x, control.kp.",
            rich_help_panel=_WHAT,
        ),
    ] = "elasticity",
    bounds: Annotated[
        Many | None,
        typer.Option(
            "--bounds",
            metavar="PATTERN=LO:HI",
            help="Bounds in SI units, within those of the robot file; repeatable."
            " Default: those, or a factor of 1000 either way (10 for masses and the like).",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    hold: Annotated[
        Many | None,
        typer.Option(
            "--hold",
            metavar="PATTERN[=VALUE]",
            help="Leave these as they are, or at that value; repeatable.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    tie: Annotated[
        Many | None,
        typer.Option(
            "--tie",
            metavar="PATTERN,PATTERN",
            help="Let these share one value, as of equal gears; repeatable.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    prior: Annotated[
        Many | None,
        typer.Option(
            "--prior",
            metavar="PATTERN=SHARE[@VALUE]",
            help="Known beforehand to this relative deviation, 20% or 0.2, about the robot's value or another;"
            " repeatable. Of numbers that may be negative a deviation in SI units.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    law: Annotated[
        Many | None,
        typer.Option(
            "--law",
            metavar="PATTERN=COORDINATE",
            help="A stiffness or damping that changes in proportion to a joint coordinate, as arm.z,"
            " or to the load of its joint: torque; repeatable.",
            rich_help_panel=_WHAT,
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="NAME",
            help="continuation needs no good start; least-squares goes straight down from the robot's values; genetic"
            " is the procedure of Huynh et al. 2021.",
            rich_help_panel=_HOW,
        ),
    ] = "continuation",
    cost: Annotated[
        str,
        typer.Option(
            "--cost",
            metavar="NAME",
            help="Differences of logarithms: logarithmic; or shares of the measured values: relative.",
            rich_help_panel=_HOW,
        ),
    ] = "logarithmic",
    loss: Annotated[
        str,
        typer.Option(
            "--loss",
            metavar="NAME",
            help="squares, or against values that are far off huber or cauchy.",
            rich_help_panel=_HOW,
        ),
    ] = "squares",
    starts: Annotated[
        int,
        typer.Option(
            "--starts",
            metavar="N",
            help="The robot's values and N - 1 random starts within the bounds; the best is kept.",
            rich_help_panel=_HOW,
        ),
    ] = 1,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of all chance.", rich_help_panel=_HOW)] = 0,
    threads: Annotated[
        int | None,
        typer.Option(
            "--threads", metavar="N", help="For several starts. Default: one per processor.", rich_help_panel=_HOW
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance",
            metavar="X",
            help="Relative change of cost and step at which the fit has converged.",
            rich_help_panel=_HOW,
        ),
    ] = 1e-10,
    max_evaluations: Annotated[
        int | None,
        typer.Option(
            "--max-evaluations",
            metavar="N",
            help="Stop each start after so many. Default: 1000, of the genetic method 200000.",
            rich_help_panel=_HOW,
        ),
    ] = None,
    population: Annotated[
        int | None,
        typer.Option("--population", metavar="N", help="Of the genetic method. Default: 100.", rich_help_panel=_HOW),
    ] = None,
    generations: Annotated[
        int | None,
        typer.Option("--generations", metavar="N", help="Of each genetic stage. Default: 20.", rich_help_panel=_HOW),
    ] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            "--checkpoint",
            metavar="FILE",
            help="Keep the state of the run in this file; if it is there, go on from it.",
            rich_help_panel=_HOW,
        ),
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
) -> int:
    """Fit stiffness, damping or any numbers to measurements.

    Ctrl-C ends a fit and writes the best that it has found. With --checkpoint a fit that was ended in whatever way goes
    on, to the same result, when the command is typed again.
    """
    frf_files, modal_files = files or [], modes or []
    if not frf_files and not modal_files:
        raise UsageError("armonic update", found="no measured file", expected="FRF_FILE..., --modes FILE, or both")
    limits = arguments.bounds(bounds or ())
    stress = arguments.choice("--weights", weights, ("peaks", "uniform"))
    by = arguments.choice("--method", method, ("continuation", "least-squares", "genetic"))
    options: dict[str, Any] = {
        "cost": arguments.choice("--cost", cost, ("logarithmic", "relative")),
        "loss": arguments.choice("--loss", loss, ("squares", "huber", "cauchy")),
        "method": by.replace("-", "_"),
        "genetic": _genetic(by, population, generations, starts),
        **{"starts": starts, "seed": seed, "threads": threads, "tolerance": tolerance},
        **{"max_evaluations": max_evaluations, "checkpoint": checkpoint},
    }
    reading = Reading(
        *(kind, scale, axes, outputs, inputs, responses, response_node, reference_node, band, symmetrize),
        channels=channels,
        synthesize=synthesize,
    )
    sources = [*frf_files, *modal_files, *(coherence or ()), *(path for path in (checkpoint, channels) if path)]
    if output is not None:
        check_output("-o", output, force=force, sources=sources)
    if report is not None:
        check_output("--report", report, force=force, sources=[*sources, *([output] if output else []), Path(robot)])
    the_robot = arguments.open_robot(robot)
    again = "the same command" if force else "the same command with --force"
    try:
        measured, modal, labels = measurements(
            the_robot,
            frf_files,
            reading,
            posture or (),
            frame or (),
            stress,
            coherence=coherence or (),
            modes=modal_files,
        )
        the_robot, held = problem.hold(the_robot, hold or ())
        options |= {"parameters": parameters, "bounds": limits, "hold": held, "ties": problem.ties(tie or ())}
        options |= {"priors": problem.priors(the_robot, prior or ()), "laws": problem.laws(law or ())}
        fit = run(the_robot, [*measured, *modal], **options)
    except KeyboardInterrupt:
        kept = checkpoint is not None and checkpoint.exists()
        goes_on = f", but the same command goes on from {checkpoint}" if kept else ""
        remark(f"interrupted: nothing was written{goes_on}")
        raise
    if len(labels) != len(fit.postures):  # postures typed apart, but equal to the digits that a fit tells apart
        labels = list(fit.postures)
    more = f"{again} goes on from {checkpoint}" if checkpoint is not None and checkpoint.exists() else ""
    return deliver(fit, labels, output, report, as_json=as_json, more=more)


def _genetic(method: str, population: int | None, generations: int | None, starts: int) -> Genetic | None:
    """Options of the genetic method, if any are given.

    Raises:
        UsageError: an option that the method does not have, or out of range.
    """
    given = {"population": population, "generations": generations}
    sizes: dict[str, Any] = {name: size for name, size in given.items() if size is not None}
    if method == "genetic" and starts != 1:
        raise UsageError("--starts", found=f"{starts} beside --method genetic", expected="one start, or another method")
    if method != "genetic" and sizes:
        raise UsageError(f"--{next(iter(sizes))}", found=f"it beside --method {method}", expected="--method genetic")
    if not sizes:
        return None
    from armonic.updating import Genetic

    try:
        return Genetic(**sizes)
    except UpdateError as error:
        raise _typed(error) from error


def _typed(error: UpdateError) -> ArmonicError:
    """The error, with the name of the option that was typed."""
    if error.where not in _OPTIONS:
        return error
    return UsageError(_OPTIONS[error.where], found=error.found, expected=error.expected, hint=error.hint)


def run(robot: Robot, measured: Sequence[Measurement | ModalMeasurement], **options: Any) -> Fit:
    """The fit, under a progress bar.

    Raises:
        ArmonicError: what the fit refuses, with the names of options.
    """
    from armonic.updating import update as compute

    with fit_progress() as progress:
        try:
            return compute(robot, measured, progress=progress, **options)
        except UpdateError as error:
            raise _typed(error) from error
