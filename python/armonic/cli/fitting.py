"""`armonic update`: measured responses and a robot file in, the updated robot and a report out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import INTERRUPTED, arguments
from armonic.cli.arguments import ForceFlag, JsonFlag, RobotName, UsageError
from armonic.cli.outputs import check_output
from armonic.cli.refusals import error_data, refuse
from armonic.cli.terminal import fit_progress, line, print_json, remark, show
from armonic.errors import ArmonicError

if TYPE_CHECKING:
    from armonic.response import Frf
    from armonic.robot import Robot
    from armonic.updating import Fit, Measurement

Many = list[str]
Axes = str | tuple[str, ...] | None


@dataclass(frozen=True)
class Reading:
    """How measured files are to be read, where they do not say it themselves; None leaves it to the file."""

    kind: str | None = None
    scale: float | None = None
    axes: str | None = None
    outputs: str | None = None
    inputs: str | None = None
    responses: str | None = None
    response_node: int | None = None
    reference_node: int | None = None
    band: str | None = None
    symmetrize: str | None = None

    def read(self, path: Path) -> list[Frf]:
        """The responses of one file: its matrix, or each of `responses` by itself.

        Raises:
            UsageError: an option does not make sense.
            DataFileError: the file does not hold a whole FRF matrix, or not these responses.
            FrfError: an option does not fit the file.
        """
        if self.responses is None:
            outputs = self.outputs and arguments.axes("--outputs", self.outputs)
            inputs = self.inputs and arguments.axes("--inputs", self.inputs)
            return [self._matrix(path, outputs, inputs)]
        for option in ("outputs", "inputs", "symmetrize"):
            if getattr(self, option) is not None:
                raise UsageError("--responses", found=f"--{option} as well", expected="only one of them")
        return [self._matrix(path, output, force) for output, force in arguments.responses(self.responses)]

    def _matrix(self, path: Path, outputs: Axes, inputs: Axes) -> Frf:
        from armonic.files import read_frf
        from armonic.response import KINDS

        options: dict[str, Any] = {
            "kind": self.kind and arguments.choice("--kind", self.kind, KINDS),
            "axes": self.axes and arguments.axis_map(self.axes),
            "outputs": outputs,
            "inputs": inputs,
        }
        universal = {
            "scale": self.scale,
            "response_node": self.response_node,
            "reference_node": self.reference_node,
        }
        if path.suffix.lower() != ".csv":
            options |= universal
        elif given := [name for name, value in universal.items() if value is not None]:
            option = f"--{given[0].replace('_', '-')}"
            raise UsageError(option, found=f"the CSV file {path}", expected="universal files, which alone have it")
        frf = read_frf(path, **options)
        if self.band is not None:
            frf = frf.band(*arguments.band(self.band))
        if self.symmetrize is not None:
            frf = frf.symmetrized(arguments.choice("--symmetrize", self.symmetrize, ("average", "upper", "lower")))
        return frf


def update(
    robot: RobotName,
    files: Annotated[list[Path], typer.Argument(metavar="FRF_FILE...", help="Measured responses: .uff or .csv.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The updated robot file.")],
    report: Annotated[
        Path | None,
        typer.Option("--report", metavar="FILE", help="A report as one HTML file that opens offline."),
    ] = None,
    posture: Annotated[
        Many | None,
        typer.Option("--posture", metavar="P", help="Where it was measured; once for all files, or once per file."),
    ] = None,
    frame: Annotated[
        Many | None,
        typer.Option(
            "--frame",
            metavar="F",
            help="The sensor's frame; once, or once per file. Default: as in the file.",
        ),
    ] = None,
    parameters: Annotated[
        str,
        typer.Option(
            "--parameters",
            metavar="PATTERN,...",
            help="What to fit: elasticity, stiffness, damping, or paths as links.arm.elasticity.*.stiffness.",
        ),
    ] = "elasticity",
    bounds: Annotated[
        Many | None,
        typer.Option(
            "--bounds",
            metavar="PATTERN=LO:HI",
            help="Bounds in SI units, within those of the robot file; repeatable."
            " Default: those, or a factor of 1000 either way.",
        ),
    ] = None,
    weights: Annotated[
        str,
        typer.Option("--weights", metavar="peaks|uniform", help="Stress the peaks, or take every line alike."),
    ] = "peaks",
    band: Annotated[str | None, typer.Option("--band", metavar="LO:HI", help="Fit these lines only, Hz.")] = None,
    symmetrize: Annotated[
        str | None,
        typer.Option("--symmetrize", metavar="HOW", help="Make H reciprocal: average, upper or lower triangle."),
    ] = None,
    max_evaluations: Annotated[
        int, typer.Option("--max-evaluations", metavar="N", help="Stop after so many evaluations.")
    ] = 1000,
    kind: Annotated[
        str | None,
        typer.Option("--kind", metavar="KIND", help="Measured receptance, mobility or accelerance."),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option("--scale", metavar="X", help="Factor from the file's values to SI; 9.80665 from g."),
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option("--axes", metavar="PAIRS", help="Axes of the file onto those of the frame: x:-z,z:x."),
    ] = None,
    outputs: Annotated[
        str | None, typer.Option("--outputs", metavar="AXES", help="Use only these axes of the response.")
    ] = None,
    inputs: Annotated[
        str | None, typer.Option("--inputs", metavar="AXES", help="Use only these axes of the force.")
    ] = None,
    responses: Annotated[
        str | None,
        typer.Option(
            "--responses",
            metavar="OUT/IN,...",
            help="Use only these responses, one by one, as of a file that lacks some: x/x,y/y,z/z.",
        ),
    ] = None,
    response_node: Annotated[
        int | None, typer.Option("--response-node", metavar="N", help="The node of the response, of several.")
    ] = None,
    reference_node: Annotated[
        int | None, typer.Option("--reference-node", metavar="N", help="The node of the force, of several.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
) -> int:
    """Fit joint stiffness and damping to measured responses."""
    limits = arguments.bounds(bounds or ())
    stress = arguments.choice("--weights", weights, ("peaks", "uniform"))
    if max_evaluations < 1:
        raise UsageError("--max-evaluations", found=str(max_evaluations), expected="at least 1")
    reading = Reading(kind, scale, axes, outputs, inputs, responses, response_node, reference_node, band, symmetrize)
    check_output("-o", output, force=force, sources=files)
    if report is not None:
        check_output("--report", report, force=force, sources=[*files, output, Path(robot)])
    the_robot = arguments.open_robot(robot)
    measurements, labels = _measurements(the_robot, files, reading, posture or (), frame or (), stress)
    fit = run(the_robot, measurements, parameters=parameters, bounds=limits, max_evaluations=max_evaluations)
    if len(labels) != len(fit.postures):  # postures typed apart, but equal to the digits that a fit tells apart
        labels = list(fit.postures)
    return deliver(fit, labels, output, report, as_json=as_json)


def run(robot: Robot, measurements: Sequence[Measurement], **options: Any) -> Fit:
    """The fit, under a progress bar."""
    from armonic.updating import update as compute

    with fit_progress() as progress:
        return compute(robot, measurements, progress=progress, **options)


def deliver(
    fit: Fit,
    postures: Sequence[str],
    robot: Path,
    report: Path | None,
    *,
    as_json: bool,
    true_values: Mapping[str, float] | None = None,
) -> int:
    """Write and show a fit: robot, tables, report, so that what fails loses nothing that came before.

    Args:
        fit: the result.
        postures: what to call each of `fit.postures`.
        robot: where the updated robot goes.
        report: where the report goes, if one is wanted.
        as_json: print one JSON object, at the end, instead of tables.
        true_values: values by path, to be shown beside.

    Returns:
        The exit code.
    """
    from armonic.cli.results import fit_data, fit_tables

    written: dict[str, str] = {}
    failure: ArmonicError | OSError | None = None
    try:  # before the tables, which end the process if nobody reads them, as under `| head`
        fit.robot.save(robot)
        written["robot"] = str(robot)
    except (ArmonicError, OSError) as error:
        failure = error
    if not as_json:
        show(*fit_tables(fit, postures, true_values), "")
    try:
        if report is not None and failure is None:
            _write_report(fit, report, robot)
            written["report"] = str(report)
    except (ArmonicError, OSError) as error:
        failure = error
    finally:  # also if the report ends in an exception that nobody foresaw
        if as_json:
            ending = {"written": written} | ({"error": error_data(failure)} if failure else {})
            print_json(fit_data(fit, postures, true_values) | ending)
        elif written:
            advice = ": open the report in a browser" if "report" in written else ""
            line(f"Wrote {' and '.join(written.values())}{advice}.")
    if failure is not None:
        return refuse(failure, as_json=False)
    if fit.status != "interrupted":
        return 0
    remark(f"interrupted: the best of {fit.evaluations} evaluations was kept and written")
    return INTERRUPTED


def _write_report(fit: Fit, report: Path, robot: Path) -> None:
    from armonic.report import write_report

    try:
        write_report(fit, report)
    except (ArmonicError, OSError) as error:
        found = error_data(error)["found"] or type(error).__name__
        raise ArmonicError(
            f"--report {report}",
            found=found,
            expected="a report that can be written",
            hint=f"The updated robot is safe in {robot}.",
        ) from error


def _measurements(
    robot: Robot,
    files: Sequence[Path],
    reading: Reading,
    postures: Sequence[str],
    frames: Sequence[str],
    weights: str,
) -> tuple[list[Measurement], list[str]]:
    """One measurement per file or single response, and a label for each posture in the order of the fit's."""
    from armonic.updating import Measurement

    wheres = arguments.one_for_each("--posture", postures, files)
    sensors = arguments.one_for_each("--frame", frames, files)
    measurements: list[Measurement] = []
    labels: dict[str | bytes, str] = {}
    for path, where, sensor in zip(files, wheres, sensors, strict=True):
        posture, label = arguments.posture(robot, where)
        key = posture if isinstance(posture, str) else posture.tobytes()
        labels.setdefault(key, label)
        measurements += [
            Measurement(
                frf,
                posture=posture,
                frame=_sensor(robot, path, frf, sensor),
                weights=weights,
                label=path.name,
            )
            for frf in reading.read(path)
        ]
    return measurements, list(labels.values())


def _sensor(robot: Robot, path: Path, frf: Frf, typed: str | None) -> str:
    """The frame as typed, as noted in the file, or the robot's only one."""
    if typed is None and frf.frame is not None:
        if frf.frame not in robot.frames:
            raise UsageError(
                str(path),
                found=f"a sensor frame {frf.frame!r}",
                expected=f"one of the robot's: {', '.join(robot.frames)}",
                hint="Say with --frame where the sensor sat.",
            )
        return frf.frame
    return arguments.frame(robot, typed)
