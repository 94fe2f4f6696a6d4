"""`armonic update`: measured responses and a robot file in, the updated robot and a report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import INTERRUPTED, arguments
from armonic.cli.arguments import ForceFlag, JsonFlag, RobotName, UsageError
from armonic.cli.outputs import check_output, write_results
from armonic.cli.terminal import fit_progress, line, print_json, remark, show

if TYPE_CHECKING:
    from armonic.response import Frf
    from armonic.robot import Robot
    from armonic.updating import Fit, Measurement

Many = list[str]


@dataclass(frozen=True)
class Reading:
    """How measured files are to be read, where they do not say it themselves; None leaves it to the file."""

    kind: str | None = None
    scale: float | None = None
    axes: str | None = None
    outputs: str | None = None
    inputs: str | None = None
    response_node: int | None = None
    reference_node: int | None = None
    band: str | None = None
    symmetrize: str | None = None

    def read(self, path: Path) -> Frf:
        """The responses of one file.

        Raises:
            UsageError: an option does not make sense.
            DataFileError: the file does not hold a whole FRF matrix.
            FrfError: an option does not fit the file.
        """
        from armonic.files import read_frf
        from armonic.response import KINDS

        options: dict[str, Any] = {
            "kind": self.kind and arguments.choice("--kind", self.kind, KINDS),
            "axes": self.axes and arguments.axis_map(self.axes),
            "outputs": self.outputs and arguments.axes("--outputs", self.outputs),
            "inputs": self.inputs and arguments.axes("--inputs", self.inputs),
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
            help="Bounds in SI units, over those of the file; repeatable.",
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
    reading = Reading(
        kind, scale, axes, outputs, inputs, response_node, reference_node, band=band, symmetrize=symmetrize
    )
    check_output("-o", output, force=force, sources=files)
    if report is not None:
        check_output("--report", report, force=force, sources=[*files, output, Path(robot)])
    the_robot = arguments.open_robot(robot)
    measurements, labels = _measurements(the_robot, files, reading, posture or (), frame or (), stress)
    fit = run(the_robot, measurements, parameters=parameters, bounds=limits, max_evaluations=max_evaluations)
    write_results(fit, output, report)
    if len(labels) != len(fit.postures):  # postures typed apart, but equal to the digits that a fit tells apart
        labels = list(fit.postures)
    written = {"robot": str(output)} | ({} if report is None else {"report": str(report)})
    if as_json:
        from armonic.cli.results import fit_data

        print_json({**fit_data(fit, labels), "written": written})
    else:
        from armonic.cli.results import fit_tables

        show(*fit_tables(fit, labels), "")
        line(f"Wrote {' and '.join(written.values())}.")
    return ended(fit)


def run(robot: Robot, measurements: Sequence[Measurement], **options: Any) -> Fit:
    """The fit, under a progress bar."""
    from armonic.updating import update as compute

    with fit_progress() as progress:
        return compute(robot, measurements, progress=progress, **options)


def ended(fit: Fit) -> int:
    """The exit code of a fit whose results are written."""
    if fit.status != "interrupted":
        return 0
    remark(f"interrupted: the best of {fit.evaluations} evaluations was kept and written")
    return INTERRUPTED


def _measurements(
    robot: Robot,
    files: Sequence[Path],
    reading: Reading,
    postures: Sequence[str],
    frames: Sequence[str],
    weights: str,
) -> tuple[list[Measurement], list[str]]:
    """One measurement per file, and a label for each posture in the order of the fit's."""
    from armonic.updating import Measurement

    wheres = arguments.one_for_each("--posture", postures, files)
    sensors = arguments.one_for_each("--frame", frames, files)
    measurements: list[Measurement] = []
    labels: dict[str | bytes, str] = {}
    for path, where, sensor in zip(files, wheres, sensors, strict=True):
        posture, label = arguments.posture(robot, where)
        key = posture if isinstance(posture, str) else posture.tobytes()
        labels.setdefault(key, label)
        frf = reading.read(path)
        measurements.append(
            Measurement(
                frf,
                posture=posture,
                frame=_sensor(robot, path, frf, sensor),
                weights=weights,
                label=path.name,
            )
        )
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
