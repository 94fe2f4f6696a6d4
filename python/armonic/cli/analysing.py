"""`armonic ema`: modes from tap tests, shaker tests or frequency responses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments
from armonic.cli.amounts import span
from armonic.cli.arguments import ForceFlag, JsonFlag, UsageError
from armonic.cli.campaign import (
    ChannelsOption,
    DecayOption,
    Estimating,
    EstimatorOption,
    ExcitationOption,
    FileReading,
    InputsOption,
    KeepOption,
    KindOption,
    OutputsOption,
    RateOption,
    ResolutionOption,
    responses,
)
from armonic.cli.outputs import check_output
from armonic.cli.terminal import remark, stages_progress
from armonic.errors import ArmonicError, FrfError, SignalError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from armonic.modal import Modes
    from armonic.robot import Robot

_HOW, _MODEL = "How modes are identified", "The model beside them"
_OPTIONS = {"method": "--method", "orders": "--orders", "band_hz": "--band", "band": "--band"}
SIDES = ("average", "upper", "lower", "none")


def ema(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Time records or frequency responses: .uff, .h5, .mat, .csv."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write the modes: .csv, .json, .uff (data set 55) or .h5."),
    ] = None,
    responses_file: Annotated[
        Path | None,
        typer.Option("--frfs", metavar="FILE", help="Write the frequency responses as estimated: .uff or .h5."),
    ] = None,
    synthesized: Annotated[
        Path | None,
        typer.Option("--synthesized", metavar="FILE", help="Write responses made of the modes: .uff, .h5 or .csv."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="A report as one HTML file that opens offline.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
    channels: ChannelsOption = None,
    kind: KindOption = None,
    outputs: OutputsOption = None,
    inputs: InputsOption = None,
    rate: RateOption = None,
    estimator: EstimatorOption = "H1",
    excitation: ExcitationOption = "auto",
    resolution: ResolutionOption = None,
    decay: DecayOption = "auto",
    keep: KeepOption = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="plscf|lsce",
            help="Least squares of complex frequency responses, or of complex exponentials.",
            rich_help_panel=_HOW,
        ),
    ] = "plscf",
    orders: Annotated[
        str | None,
        typer.Option(
            "--orders", metavar="LOW:HIGH", help="Model orders. Default: 2:60, or fewer.", rich_help_panel=_HOW
        ),
    ] = None,
    band: Annotated[
        str | None,
        typer.Option("--band", metavar="LOW:HIGH", help="Lines that are used, Hz.", rich_help_panel=_HOW),
    ] = None,
    real: Annotated[bool, typer.Option("--real", help="Real modes only.", rich_help_panel=_HOW)] = False,
    no_refine: Annotated[
        bool, typer.Option("--no-refine", help="Leave the poles as the orders give them.", rich_help_panel=_HOW)
    ] = False,
    symmetrize: Annotated[
        str,
        typer.Option(
            "--symmetrize",
            metavar="HOW",
            help="Of what --synthesized writes: average, upper, lower or none.",
            rich_help_panel=_HOW,
        ),
    ] = "average",
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="Whose modes stand beside, and on which shapes are drawn. Default: the robot that the file notes.",
            rich_help_panel=_MODEL,
        ),
    ] = None,
    posture: Annotated[
        str | None, typer.Option("--posture", metavar="P", help="Its posture.", rich_help_panel=_MODEL)
    ] = None,
) -> int:
    """Identify modes from tap tests or frequency responses.

    Hits are found and judged, frequency responses are estimated with their coherence, and modes are identified over
    many model orders, refined and scaled. `armonic update ROBOT FILE --synthesize` does the same on its way to a model.
    """
    asked: dict[str, Any] = {
        "method": arguments.choice("--method", method, ("plscf", "lsce")),
        "orders": None if orders is None else _orders(orders),
        "band_hz": None if band is None else span("--band", band, "frequency"),
        "refine": not no_refine,
        "real": real,
    }
    side = arguments.choice("--symmetrize", symmetrize, SIDES)
    written = {"-o": output, "--frfs": responses_file, "--synthesized": synthesized, "--report": report}
    _check_outputs(written, files, force=force)
    reading = FileReading(channels, kind, outputs, inputs, rate)
    found = responses(files, reading, Estimating(estimator, excitation, resolution, decay, keep))
    if synthesized is not None and synthesized.suffix.lower() == ".csv":
        found.frfs.matrix(as_measured=True)  # refused now what has no place in that format later
    notes = dict(found.frfs.notes) or dict(found.file.records[0].notes if found.file.records else {})
    model, where, reference = beside(notes, robot, posture)
    from armonic.identification.ema import ema as compute

    try:
        with stages_progress("Identifying") as progress:
            result = compute(found.frfs, progress=progress, **asked)
    except KeyboardInterrupt:
        remark("interrupted: nothing was written")
        raise
    except (SignalError, FrfError) as error:
        option = _OPTIONS.get(error.where)
        if option is None:
            raise
        raise UsageError(option, found=error.found, expected=error.expected, hint=error.hint) from error
    from armonic.cli.ema_results import Beside, Wanted, deliver_ema

    wanted = Wanted(output, responses_file, synthesized, report, None if side == "none" else side)
    return deliver_ema(result, found, Beside(model, where, reference), wanted, as_json=as_json)


def _orders(text: str) -> tuple[int, int]:
    from armonic.cli.amounts import whole

    low, colon, high = text.partition(":")
    if not colon:
        raise UsageError("--orders", found=repr(text), expected="LOW:HIGH, such as 2:60")
    first, last = (whole("--orders", part, least=1, shown=text) for part in (low, high))
    if first > last:
        raise UsageError("--orders", found=repr(text), expected="the lowest order first")
    return first, last


def _check_outputs(outputs: Mapping[str, Path | None], files: list[Path], *, force: bool) -> None:
    endings = {
        "-o": (".csv", ".json", ".uff", ".h5"),
        "--frfs": (".uff", ".h5"),
        "--synthesized": (".uff", ".h5", ".csv"),
    }
    taken = list(files)
    for option, path in outputs.items():
        if path is None:
            continue
        allowed = endings.get(option)
        if allowed and path.suffix.lower() not in allowed:
            found = f"the ending {path.suffix!r}" if path.suffix else "no ending"
            raise UsageError(f"{option} {path}", found=found, expected=f"one of {', '.join(allowed)}")
        check_output(option, path, force=force, sources=taken)
        taken.append(path)


def beside(notes: Mapping[str, str], robot: str | None, posture: str | None) -> tuple[Robot | None, Any, Modes | None]:
    """The robot as typed or noted, its posture, and its modes there.

    Raises:
        ArmonicError: robot or posture that were typed make no model.
    """
    from armonic.linear import linearize
    from armonic.modal import modes
    from armonic.robot import Robot

    if robot is None and "robot_yaml" not in notes:
        if posture is not None:
            raise UsageError("--posture", found="it without a robot", expected="--robot ROBOT as well")
        return None, None, None
    typed = robot is not None or posture is not None
    try:
        if robot is not None:
            model = arguments.open_robot(robot)
        else:
            model = Robot.from_yaml(notes["robot_yaml"], origin="the robot that the file notes")
        noted = notes.get("posture") if notes.get("posture") in model.postures else None
        where = arguments.posture(model, posture if posture is not None else noted)[0]
        return model, where, modes(linearize(model, where))
    except (ArmonicError, ValueError):
        if typed:
            raise
        return None, None, None
