"""Measured files as typed: time records become frequency responses, and what was left or is doubtful is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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


def responses(paths: Sequence[Path], channels: Path | None, estimating: Estimating) -> Responses:
    """The frequency responses of measured files, estimated from time records where they hold no others.

    Raises:
        UsageError: an option does not make sense.
        DataFileError: a file cannot be read, or holds neither.
        SignalError: the records make no frequency responses.
    """
    from armonic.files.measured_files import read_measured

    options = estimating.options()
    with stages_progress("Reading") as say:
        moved: Callable[[float], object] | None = None if say is None else lambda share: say(f"{share:.0%}")
        file = read_measured(list(paths), channels=channels, progress=moved)
    if file.frfs is not None:
        typed = [name for name, value in vars(estimating).items() if value != getattr(Estimating(), name)]
        if typed:
            found = f"it with {file.path}, which holds frequency responses"
            raise UsageError(f"--{typed[0]}", found=found, expected="time records")
        return Responses(file.frfs, None, file)
    if not file.records:
        left = "; ".join(map(str, file.skipped[:3]))
        found = f"neither frequency responses nor time records{f' ({left})' if left else ''}"
        raise DataFileError(file.path, found=found, expected="a measurement")
    from armonic.experiment.estimation import estimate_frf

    try:
        estimate = estimate_frf(file.records, **options)
    except (SignalError, FrfError) as error:
        raise _named(error, estimating.keep) from error
    return Responses(estimate.frfs, estimate, file)


_OPTIONS = {"resolution_hz": "--resolution", "window_s": "--resolution", "decay_rate": "--decay"}


def _named(error: ArmonicError, keep: str | None) -> ArmonicError:
    """The error, with the name of the option that was typed."""
    if error.where == "keep":  # there counted from 0
        return UsageError("--keep", found=repr(keep), expected="numbers of usable hits, counted from 1")
    hint = None if error.hint is None else error.hint.replace("keep=", "--keep").replace("excitation=", "--excitation")
    where = _OPTIONS.get(error.where)
    if where is None:
        return type(error)(error.where, found=error.found, expected=error.expected, hint=hint)
    return UsageError(where, found=error.found, expected=error.expected, hint=hint)
