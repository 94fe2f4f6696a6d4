"""Measured files as typed: time records become frequency responses, and what was left or is doubtful is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli.amounts import amount
from armonic.cli.arguments import UsageError, choice
from armonic.cli.terminal import stages_progress
from armonic.errors import ArmonicError, DataFileError, FrfError, SignalError

if TYPE_CHECKING:
    from armonic.experiment.estimation import FrfEstimate
    from armonic.files.measured_file import MeasuredFile
    from armonic.frf_set import FrfSet

_SIGNALS = "From time records to frequency responses"
ChannelsOption = Annotated[
    Path | None,
    typer.Option(
        "--channels",
        metavar="FILE",
        help="What the file's channels are: a map from names or nodes to robot frames and axes, .yaml or .csv.",
        rich_help_panel="What is read",
    ),
]
KindOption = Annotated[
    str | None,
    typer.Option(
        "--kind",
        metavar="KIND",
        help="Of a file that does not say: receptance, mobility or accelerance.",
        rich_help_panel="What is read",
    ),
]
OutputsOption = Annotated[
    str | None,
    typer.Option(
        "--outputs",
        metavar="PLACE.AXIS,...",
        help="Names of the responses of a matrix that has none: sensor.x,sensor.y.",
        rich_help_panel="What is read",
    ),
]
InputsOption = Annotated[
    str | None,
    typer.Option("--inputs", metavar="PLACE.AXIS,...", help="Names of its forces.", rich_help_panel="What is read"),
]
RateOption = Annotated[
    str | None,
    typer.Option(
        "--rate", metavar="FREQ", help="Sampling rate of records that do not say: 1kHz.", rich_help_panel="What is read"
    ),
]
EstimatorOption = Annotated[
    str,
    typer.Option(
        "--estimator",
        metavar="H1|H2|Hv",
        help="H1: noise on the responses; H2: on the forces; Hv: on both.",
        rich_help_panel=_SIGNALS,
    ),
]
ExcitationOption = Annotated[
    str,
    typer.Option(
        "--excitation",
        metavar="auto|hits|random|sweep",
        help="Hammer or shaker. auto: as the force looks.",
        rich_help_panel=_SIGNALS,
    ),
]
ResolutionOption = Annotated[
    str | None,
    typer.Option(
        "--resolution",
        metavar="FREQ",
        help="Distance of the lines: 0.5Hz. Default: one over the time from hit to hit.",
        rich_help_panel=_SIGNALS,
    ),
]
DecayOption = Annotated[
    str,
    typer.Option(
        "--decay",
        metavar="auto|RATE",
        help="Rate of an exponential window in 1/s, 0 for none; modes come out without the damping it adds. auto: what"
        " brings a long decay down to 1 % at its end.",
        rich_help_panel=_SIGNALS,
    ),
]
KeepOption = Annotated[
    str | None,
    typer.Option(
        "--keep",
        metavar="N,...",
        help="Use these hits, whatever is wrong with them; counted from 1 as they are listed.",
        rich_help_panel=_SIGNALS,
    ),
]


@dataclass(frozen=True)
class FileReading:
    """How measured files are read where they do not say it themselves; None leaves it to them."""

    channels: Path | None = None
    kind: str | None = None
    outputs: str | None = None
    inputs: str | None = None
    rate: str | None = None

    def options(self) -> dict[str, Any]:
        """Arguments of `read_measured`.

        Raises:
            UsageError: a word or number makes no sense.
        """
        found: dict[str, Any] = {"channels": self.channels}
        if self.kind is not None:
            found["kind"] = choice("--kind", self.kind, ("receptance", "mobility", "accelerance"))
        for name in ("outputs", "inputs"):
            if (text := getattr(self, name)) is not None:
                found[name] = [word.strip() for word in text.split(",")]
        if self.rate is not None:
            found["sample_rate_hz"] = amount("--rate", self.rate, "frequency")
        return found


@dataclass(frozen=True)
class Estimating:
    """How time records become frequency responses, as typed."""

    estimator: str = "H1"
    excitation: str = "auto"
    resolution: str | None = None
    decay: str = "auto"
    keep: str | None = None

    def options(self) -> dict[str, Any]:
        """Arguments of `estimate_frf`.

        Raises:
            UsageError: a word or number makes no sense.
        """
        found: dict[str, Any] = {
            "estimator": choice("--estimator", self.estimator, ("H1", "H2", "Hv")),
            "excitation": choice("--excitation", self.excitation, ("auto", "hits", "random", "sweep")),
        }
        if self.resolution is not None:
            found["resolution_hz"] = amount("--resolution", self.resolution, "frequency")
        if self.decay != "auto":
            try:
                found["decay_rate"] = float(self.decay)
            except ValueError:
                raise UsageError("--decay", found=repr(self.decay), expected="auto, or a rate in 1/s") from None
        if self.keep is not None:
            numbers = [word.strip() for word in self.keep.split(",")]
            if not all(word.isdecimal() and int(word) > 0 for word in numbers):
                raise UsageError("--keep", found=repr(self.keep), expected="numbers of hits, such as 1,2,5")
            found["keep"] = [int(word) - 1 for word in numbers]
        return found


@dataclass(frozen=True, eq=False)
class Responses:
    """Frequency responses and what they are from; `estimate` is None where the file held responses already."""

    frfs: FrfSet
    estimate: FrfEstimate | None
    file: MeasuredFile


def responses(paths: Sequence[Path], reading: FileReading, estimating: Estimating) -> Responses:
    """The frequency responses of measured files, estimated from time records where they hold no others.

    Raises:
        UsageError: an option does not make sense.
        DataFileError: a file cannot be read, or holds neither.
        SignalError: the records make no frequency responses.
    """
    options = estimating.options()
    file = _read(paths, reading)
    if (frfs := file.frfs) is not None:
        typed = [name for name, value in vars(estimating).items() if value != getattr(Estimating(), name)]
        if typed:
            found = f"it with {file.path}, which holds frequency responses"
            raise UsageError(f"--{typed[0]}", found=found, expected="time records")
        if file.records:
            told = f"Time records beside frequency responses are not used: {len(file.records)}."
            file = replace(file, remarks=(*file.remarks, told))
        return Responses(frfs, None, file)
    if not file.records:
        left = "; ".join(map(str, file.skipped[:3]))
        found = f"neither frequency responses nor time records{f' ({left})' if left else ''}"
        raise DataFileError(file.path, found=found, expected="a measurement")
    from armonic.experiment.estimation import estimate_frf

    try:
        estimate = estimate_frf(file.records, **options)
    except (SignalError, FrfError) as error:
        raise _named(error, estimating, file.remarks if reading.channels else ()) from error
    return Responses(estimate.frfs, estimate, file)


def _read(paths: Sequence[Path], reading: FileReading) -> MeasuredFile:
    from armonic.files.measured_files import read_measured

    places = [path.resolve() for path in paths]
    if twice := [path for path, place in zip(paths, places, strict=True) if places.count(place) > 1]:
        raise UsageError("FILE...", found=f"{twice[0]} twice", expected="every file once")
    with stages_progress("Reading") as say:
        moved: Callable[[float], object] | None = None if say is None else lambda share: say(f"{share:.0%}")
        try:
            return read_measured(list(paths), progress=moved, **reading.options())
        except DataFileError as error:
            if error.where == "options":
                option = f"--{error.found.removesuffix('=').replace('sample_rate_hz', 'rate')}"
                expected = "formats whose files do not say it"
                raise UsageError(option, found=f"it with {paths[0].name}", expected=expected) from error
            said = [error.expected, error.hint or ""]
            for name in ("sample_rate_hz", "outputs", "inputs", "kind"):
                option = f"--{name.replace('sample_rate_hz', 'rate')}"
                said = [text.replace(f"{name}=", option) for text in said]
            raise DataFileError(error.where, found=error.found, expected=said[0], hint=said[1] or None) from error


_OPTIONS = {"resolution_hz": "--resolution", "decay_rate": "--decay"}


def _named(error: ArmonicError, typed: Estimating, remarks: Sequence[str]) -> ArmonicError:
    """The error, with the name of the option that was typed, and with what a map did not meet."""
    if error.where == "keep" and typed.keep is not None:  # there counted from 0
        expected = error.expected if "hits of a hammer" in error.expected else "numbers of usable hits, counted from 1"
        return UsageError("--keep", found=repr(typed.keep), expected=expected)
    said = error.hint or ""
    hint = " ".join([said.replace("keep=", "--keep").replace("excitation=", "--excitation"), *remarks]).strip() or None
    where = _OPTIONS.get(error.where)
    if error.where == "window_s" and typed.resolution is not None:
        where = "--resolution"
    if where is None:
        return type(error)(error.where, found=error.found, expected=error.expected, hint=hint)
    return UsageError(where, found=error.found, expected=error.expected, hint=hint)
