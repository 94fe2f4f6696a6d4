"""Measured files as typed: responses, their coherence, and modes, each where it was taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments
from armonic.cli.arguments import UsageError
from armonic.errors import DataFileError

if TYPE_CHECKING:
    from armonic.identification.modal_model import Side
    from armonic.response import Frf
    from armonic.robot import Robot
    from armonic.updating import Measurement, ModalMeasurement

Many = list[str]
Axes = str | tuple[str, ...] | None

_FILES = "Reading the files"
KindOption = Annotated[
    str | None,
    typer.Option(
        "--kind", metavar="KIND", help="Measured receptance, mobility or accelerance.", rich_help_panel=_FILES
    ),
]
ScaleOption = Annotated[
    float | None,
    typer.Option(
        "--scale", metavar="X", help="Factor from the file's values to SI; 9.80665 from g.", rich_help_panel=_FILES
    ),
]
AxesOption = Annotated[
    str | None,
    typer.Option(
        "--axes", metavar="PAIRS", help="Axes of the file onto those of the frame: x:-z,z:x.", rich_help_panel=_FILES
    ),
]
OutputsOption = Annotated[
    str | None,
    typer.Option("--outputs", metavar="AXES", help="Use only these axes of the response.", rich_help_panel=_FILES),
]
InputsOption = Annotated[
    str | None,
    typer.Option("--inputs", metavar="AXES", help="Use only these axes of the force.", rich_help_panel=_FILES),
]
ResponsesOption = Annotated[
    str | None,
    typer.Option(
        "--responses",
        metavar="OUT/IN,...",
        help="Use only these responses, one by one, as of a file that lacks some: x/x,y/y,z/z.",
        rich_help_panel=_FILES,
    ),
]
ResponseNodeOption = Annotated[
    int | None,
    typer.Option("--response-node", metavar="N", help="The node of the response, of several.", rich_help_panel=_FILES),
]
ReferenceNodeOption = Annotated[
    int | None,
    typer.Option("--reference-node", metavar="N", help="The node of the force, of several.", rich_help_panel=_FILES),
]
SymmetrizeOption = Annotated[
    str | None,
    typer.Option(
        "--symmetrize",
        metavar="HOW",
        help="Make H reciprocal: average, upper or lower triangle.",
        rich_help_panel=_FILES,
    ),
]


SynthesizeFlag = Annotated[
    bool,
    typer.Option(
        "--synthesize",
        help="Identify modes in the measurement and fit responses made of them, reciprocal and without noise.",
        rich_help_panel=_FILES,
    ),
]
MapOption = Annotated[
    Path | None,
    typer.Option(
        "--channels",
        metavar="FILE",
        help="What a file's channels are: a map from names or nodes to frames and axes, .yaml or .csv.",
        rich_help_panel=_FILES,
    ),
]


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
    channels: Path | None = None
    synthesize: bool = False

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

    def set_of(self, path: Path, place: str | None) -> tuple[Frf, Any, Frf | None] | None:
        """Response, coherence and raw response of a file that is read as a set: of time records, or to synthesize.

        None for a file of one matrix of responses that is to be fitted as it is.

        Raises:
            UsageError: options of files with one matrix beside it.
            ArmonicError: the file makes no responses.
        """
        if not (self.synthesize or self.channels is not None or _is_read_as_set(path)):
            return None
        others = ("kind", "scale", "axes", "outputs", "inputs", "responses", "response_node", "reference_node")
        if typed := [name for name in others if getattr(self, name) is not None]:
            option = f"--{typed[0].replace('_', '-')}"
            hint = "Say with --channels what the file's channels are."
            raise UsageError(option, found=f"it with {path.name}", expected="a file of responses alone", hint=hint)
        from armonic.cli.synthesizing import matrix_of_modes, measured_matrix

        band = None if self.band is None else arguments.band(self.band)
        sides: tuple[Side, ...] = ("average", "upper", "lower")
        side: Side | None = (
            None if self.symmetrize is None else arguments.choice("--symmetrize", self.symmetrize, sides)
        )
        if self.synthesize:
            return matrix_of_modes(path, self.channels, band=band, place=place, side=side or "average")
        frf, coherence = measured_matrix(path, self.channels, band=band, place=place)
        return (frf, coherence, None) if side is None else (frf.symmetrized(side), None, None)

    def with_coherence(self, frfs: Sequence[Frf], path: Path | None) -> list[tuple[Frf, Any]]:
        """Each response with its coherence from a file, (L, outputs, inputs); None if there is no file.

        Raises:
            UsageError: the responses were made symmetric, which no coherence follows.
            DataFileError: the file does not hold the coherence of these responses on these lines.
        """
        if path is None:
            return [(frf, None) for frf in frfs]
        if self.symmetrize is not None:
            raise UsageError("--coherence", found="--symmetrize as well", expected="only one of them")
        from armonic.files.coherence import read_coherence

        coherence = read_coherence(
            path,
            axes=arguments.axis_map(self.axes) if self.axes else None,
            response_node=self.response_node,
            reference_node=self.reference_node,
        )
        return [(frf, coherence.on(frf)) for frf in frfs]


def measurements(
    robot: Robot,
    files: Sequence[Path],
    reading: Reading,
    postures: Sequence[str],
    frames: Sequence[str],
    weights: str,
    *,
    coherence: Sequence[Path] = (),
    modes: Sequence[Path] = (),
) -> tuple[list[Measurement], list[ModalMeasurement], list[str]]:
    """Measured responses and modes, and a label for each posture in the order of the fit's.

    Args:
        robot: it was measured at.
        files: of responses; each is one measurement, or one for each single response.
        reading: how they are read.
        postures: none, one for all files, or one for each of `files` and then of `modes`.
        frames: of the sensor; none, one for all, or one for each of `files`.
        weights: "peaks" or "uniform".
        coherence: none, or a file for each of `files`.
        modes: files of measured modes.

    Raises:
        UsageError: options that do not fit each other or the files.
        DataFileError: a file that cannot be read.
    """
    from armonic.updating import Measurement

    typed = [name for name, value in vars(reading).items() if value is not None and value is not False] + [
        "frame"
    ] * bool(frames)
    if not files and typed:
        option = f"--{typed[0].replace('_', '-')}"
        raise UsageError(option, found="it without FRF files", expected="responses, which alone have it")
    if len(coherence) not in (0, len(files)):
        expected = f"as many as there are FRF files, {len(files)}"
        raise UsageError("--coherence", found=f"{len(coherence)} of them", expected=expected)
    wheres = arguments.one_for_each("--posture", postures, [*files, *modes])
    sensors = arguments.one_for_each("--frame", frames, files)
    places = [arguments.posture(robot, where) for where in wheres]
    labels: dict[str | bytes, str] = {}
    for posture, label in places:
        labels.setdefault(posture if isinstance(posture, str) else posture.tobytes(), label)
    responses: list[Measurement] = []
    beside: Sequence[Path | None] = coherence or [None] * len(files)
    for path, (posture, _), sensor, noise in zip(files, places, sensors, beside, strict=False):
        if (found := reading.set_of(path, sensor)) is not None:
            if noise is not None:
                raise UsageError("--coherence", found=f"it with {path.name}", expected="a file of responses alone")
            frf, quality, raw = found
            at = sensor if sensor is not None and frf.frame not in robot.frames else None
            frame = arguments.frame(robot, at) if at else _sensor(robot, path, frf, sensor)
            responses.append(Measurement(frf, posture, frame, weights, label=path.name, coherence=quality, raw=raw))
            continue
        responses += [
            Measurement(
                frf,
                posture=posture,
                frame=_sensor(robot, path, frf, sensor),
                weights=weights,
                label=path.name,
                coherence=values,
            )
            for frf, values in reading.with_coherence(reading.read(path), noise)
        ]
    modal = [_modes(path, posture) for path, (posture, _) in zip(modes, places[len(files) :], strict=True)]
    return responses, modal, list(labels.values())


def _is_read_as_set(path: Path) -> bool:
    """Whether a file is of a format that is read as a set, or a universal file of time records alone."""
    from armonic.files.measured_files import FORMATS

    if (kind := FORMATS.get(path.suffix.lower())) != "uff":
        return kind == "hdf5"
    from armonic.files.measured_uff import function_types
    from armonic.files.uff_reader import FRF, TIME_RESPONSE

    try:
        types = function_types(path)
    except DataFileError:
        return False  # the reader of matrices says what is wrong
    return TIME_RESPONSE in types and FRF not in types


def _modes(path: Path, posture: Any) -> ModalMeasurement:
    from armonic.files.measured_files import FORMATS

    if FORMATS.get(path.suffix.lower()) in ("uff", "hdf5"):
        return _modes_with_shapes(path, posture)
    from armonic.files.modal_table import read_modal_table
    from armonic.updating import ModalMeasurement

    table = read_modal_table(path)
    deviations = {"freq_deviation": table.freq_deviation, "damping_deviation": table.damping_deviation}
    return ModalMeasurement(
        posture,
        table.freq_hz,
        table.damping_ratio,
        damped=table.damped,
        label=path.name,
        **{name: values for name, values in deviations.items() if values is not None},  # type: ignore[arg-type]
    )


def _modes_with_shapes(path: Path, posture: Any) -> ModalMeasurement:
    """Modes of a file that may hold shapes; shapes count where every place has the same axes.

    Raises:
        DataFileError: the file holds no modes.
    """
    from armonic.files.measured_files import read_measured
    from armonic.frf_set import split_label
    from armonic.updating import ModalMeasurement

    modes = read_measured(path).modes
    if modes is None:
        raise DataFileError(str(path), found="no modes", expected="modes, such as data sets 55 of a universal file")
    dofs = [split_label(name) for name in modes.coordinates or ()]
    places, axes = (tuple(dict.fromkeys(dof[k] for dof in dofs)) for k in (0, 1))
    order = [dofs.index((place, axis)) for place in places for axis in axes if (place, axis) in dofs]
    whole = modes.shapes is not None and len(order) == len(places) * len(axes) > 1
    return ModalMeasurement(
        posture,
        modes.natural_freq_hz,
        modes.damping_ratio,
        shapes=modes.shapes[:, order] if whole and modes.shapes is not None else None,
        frame=places if whole else (),
        outputs=axes if whole else ("x", "y", "z"),
        label=path.name,
    )


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
