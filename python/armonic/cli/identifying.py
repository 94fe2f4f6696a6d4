"""`armonic oma`: modes from measured or simulated responses alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments
from armonic.cli.amounts import amount, span, whole
from armonic.cli.arguments import ForceFlag, JsonFlag, UsageError
from armonic.cli.outputs import check_output
from armonic.cli.setting import SetOption, with_numbers
from armonic.cli.terminal import remark, stages_progress
from armonic.errors import ArmonicError, DataFileError, SignalError

if TYPE_CHECKING:
    from armonic.identification.oma import OmaResult
    from armonic.modal import Modes
    from armonic.series import TimeSeries

_FILE, _HOW, _MODEL = "What is read", "How it is identified", "The model beside it"
_OPTIONS = {
    **{"freq_resolution_hz": "--resolution", "damping_resolution": "--resolution", "sample_rate_hz": "--rate"},
    **{"start_s": "--window", "stop_s": "--window", "band_hz": "--band", "factor": "--decimate"},
    **{name: f"--{name}" for name in ("channels", "orders", "method", "window", "detrend", "selection", "repeats")},
    **{"spindle_hz": "--spindle", "block_rows": "--block-rows", "Criteria.freq_range_hz": "--band"},
    **{"variable": "--variable", "time_variable": "--time-variable"},
}
"""What the library's arguments are called here."""


def oma(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A time series: .zarr, .uff, .csv or .mat.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Write the modes: .csv, which `armonic update --modes` reads, or .json.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="A report as one HTML file that opens offline.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
    channels: Annotated[
        list[str] | None,
        typer.Option(
            "--channels",
            metavar="PATTERN,...",
            help="Quantities, names, labels or patterns: motor_position, tool.x0, 'acceleration:*'. Default: motor"
            " positions, or what else moves.",
            rich_help_panel=_FILE,
        ),
    ] = None,
    window: Annotated[
        str,
        typer.Option(
            "--window",
            metavar="START:STOP|decay|all|auto",
            help="Times in s; or what comes after the force; auto: that if a force acts and ends, else all.",
            rich_help_panel=_FILE,
        ),
    ] = "auto",
    detrend: Annotated[
        str,
        typer.Option(
            "--detrend",
            metavar="auto|none|mean|linear|rest",
            help="What is taken off each channel; rest: where a decay ends.",
            rich_help_panel=_FILE,
        ),
    ] = "auto",
    decimate: Annotated[
        int,
        typer.Option(
            "--decimate", metavar="N", help="Make N samples one, after a low-pass filter.", rich_help_panel=_FILE
        ),
    ] = 1,
    rate: Annotated[
        str | None,
        typer.Option("--rate", metavar="FREQ", help="Of a file that does not say: 1kHz.", rich_help_panel=_FILE),
    ] = None,
    variable: Annotated[
        str | None,
        typer.Option("--variable", metavar="NAME", help="The matrix of a .mat file.", rich_help_panel=_FILE),
    ] = None,
    time_variable: Annotated[
        str | None, typer.Option("--time-variable", metavar="NAME", help="Its times.", rich_help_panel=_FILE)
    ] = None,
    orders: Annotated[
        str | None,
        typer.Option(
            "--orders",
            metavar="LOW:HIGH[:STEP]",
            help="Model orders: lags of var, states of ssi. Default: 2:100, or what the samples are good for.",
            rich_help_panel=_HOW,
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="auto|var|ssi",
            help="Vector autoregression, or covariance-driven subspaces. auto: var for a free decay, ssi for a"
            " response to lasting excitation.",
            rich_help_panel=_HOW,
        ),
    ] = "auto",
    band: Annotated[
        str | None,
        typer.Option("--band", metavar="LOW:HIGH", help="Natural frequencies to look at, Hz.", rich_help_panel=_HOW),
    ] = None,
    block_rows: Annotated[
        int | None,
        typer.Option("--block-rows", metavar="N", help="Of the covariances of ssi.", rich_help_panel=_HOW),
    ] = None,
    selection: Annotated[
        str,
        typer.Option(
            "--selection",
            metavar="cluster|grid",
            help="cluster needs no threshold; grid is that of Do et al. 2022.",
            rich_help_panel=_HOW,
        ),
    ] = "cluster",
    resolution: Annotated[
        str | None,
        typer.Option(
            "--resolution", metavar="FREQ:DAMPING", help="Of the grid. Default: 0.1Hz:0.1%.", rich_help_panel=_HOW
        ),
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option(
            "--repeats", metavar="N", help="Orders in a cell of the grid. Default: half of all.", rich_help_panel=_HOW
        ),
    ] = None,
    spindle: Annotated[
        str | None,
        typer.Option(
            "--spindle",
            metavar="FREQ",
            help="Speed of a machine that ran: 100Hz or 6000rpm; its harmonics are told.",
            rich_help_panel=_HOW,
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="Whose modes stand beside. Default: the robot that the file notes.",
            rich_help_panel=_MODEL,
        ),
    ] = None,
    posture: Annotated[
        str | None,
        typer.Option(
            "--posture",
            metavar="P",
            help="Its posture. Default: the one that the file notes, or the only one.",
            rich_help_panel=_MODEL,
        ),
    ] = None,
    setting: SetOption = None,
    no_reference: Annotated[
        bool, typer.Option("--no-reference", help="No modes of a model.", rich_help_panel=_MODEL)
    ] = False,
) -> int:
    """Identify modes from responses alone, beside those of a model.

    Poles of many model orders, then those that hold. A file of `armonic simulate` notes its robot and posture, so that
    the modes of the model are found without being asked.
    """
    asked: dict[str, Any] = {
        "channels": _words(channels),
        "orders": None if orders is None else _orders(orders),
        "method": arguments.choice("--method", method, ("auto", "var", "ssi")),
        "detrend": arguments.choice("--detrend", detrend, ("auto", "none", "mean", "linear", "rest")),
        "decimate": decimate,
        "band_hz": None if band is None else span("--band", band, "frequency"),
        "block_rows": block_rows,
        "spindle_hz": _speed(spindle),
        **_grid(arguments.choice("--selection", selection, ("cluster", "grid")), resolution, repeats),
    }
    if block_rows is not None and (method != "ssi" or block_rows < 1):
        found = f"{block_rows} beside --method {method}"
        raise UsageError("--block-rows", found=found, expected="a positive number beside --method ssi")
    if no_reference and (robot is not None or posture is not None or setting):
        found = "a model and --no-reference"
        raise UsageError("armonic oma", found=found, expected="one of them")
    if output is not None:
        if output.suffix.lower() not in (".csv", ".json"):
            found = f"the ending {output.suffix!r}" if output.suffix else "no ending"
            raise UsageError(f"-o {output}", found=found, expected=".csv or .json")
        check_output("-o", output, force=force, sources=[file])
    if report is not None:
        check_output("--report", report, force=force, sources=[file, *([output] if output else [])])
    reading = {"variable": variable, "time_variable": time_variable}
    series = _read(file, rate, {name: word for name, word in reading.items() if word is not None})
    asked["window"] = _window(window, series)
    reference, doubt = (None, None) if no_reference else _reference(series, robot, posture, setting or ())
    try:
        result = _identify(series, asked)
    except KeyboardInterrupt:
        remark("interrupted: nothing was written")
        raise
    from armonic.cli.oma_results import deliver_oma
    from armonic.series import ENDED

    if robot is None and "robot_yaml" not in series.notes and not (no_reference or as_json):
        remark("no model beside: the file notes no robot; --robot and --posture name one")
    if ENDED in series.notes and not as_json:
        remark(f"the run did not come to its end: it {series.notes[ENDED]}")
    if "control" in series.notes and not as_json:
        remark("the run was under sampled control; the model beside has it continuous")

    return deliver_oma(result, reference, output, report, source=file, doubt=doubt, as_json=as_json)


def _words(texts: Sequence[str] | None) -> list[str] | None:
    """Patterns typed apart or with commas."""
    if not texts:
        return None
    words = [word.strip() for text in texts for word in text.split(",")]
    if not all(words):
        raise UsageError("--channels", found=repr(",".join(texts)), expected="PATTERN,..., such as motor_position")
    return words


def _orders(text: str) -> range | tuple[int, int]:
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise UsageError("--orders", found=repr(text), expected="LOW:HIGH or LOW:HIGH:STEP, such as 2:100")
    low, high, *step = (whole("--orders", part, least=1, shown=text) for part in parts)
    if low > high:
        raise UsageError("--orders", found=repr(text), expected="the lowest order first")
    return range(low, high + 1, step[0]) if step else (low, high)


def _speed(text: str | None) -> float | None:
    if text is None:
        return None
    speed = amount("--spindle", text, "frequency")
    if speed <= 0:
        raise UsageError("--spindle", found=repr(text), expected="a speed above 0, such as 100Hz or 6000rpm")
    return speed


def _grid(selection: str, resolution: str | None, repeats: int | None) -> dict[str, Any]:
    """The selection with its resolutions.

    Raises:
        UsageError: options of the grid without it, or not of their form.
    """
    for option, value in (("--resolution", resolution), ("--repeats", repeats)):
        if value is not None and selection != "grid":
            raise UsageError(option, found=f"it beside --selection {selection}", expected="--selection grid")
    found: dict[str, Any] = {"selection": selection, "repeats": repeats}
    if resolution is not None:
        freq, colon, damping = resolution.partition(":")
        if not (freq.strip() and colon and damping.strip()):
            raise UsageError("--resolution", found=repr(resolution), expected="FREQ:DAMPING, such as 0.1Hz:0.1%")
        found["freq_resolution_hz"] = amount("--resolution", freq, "frequency", shown=resolution)
        found["damping_resolution"] = amount("--resolution", damping, "share", shown=resolution)
    return found


def _window(text: str, series: TimeSeries) -> str | tuple[float, float]:
    """A word, or two times of which either may be left out."""
    if text in ("auto", "decay", "all"):
        return text
    start, colon, stop = (part.strip() for part in text.partition(":"))
    if not colon or ":" in stop:
        raise UsageError("--window", found=repr(text), expected="START:STOP in s, decay, all or auto")
    first = amount("--window", start, "time", shown=text) if start else series.start_s
    last = amount("--window", stop, "time", shown=text) if stop else series.start_s + series.duration_s
    if first >= last:
        raise UsageError("--window", found=repr(text), expected="a start before the stop")
    return first, last


def _read(file: Path, rate: str | None, options: dict[str, str]) -> TimeSeries:
    from armonic.files.series_files import read_series

    rate_hz = None if rate is None else amount("--rate", rate, "frequency")
    try:
        return read_series(file, sample_rate_hz=rate_hz, **options)
    except SignalError as error:
        if error.where == "options":
            option = f"--{next(iter(options)).replace('_', '-')}"
            raise UsageError(option, found=f"it with {file.suffix}", expected="a .mat file") from error
        raise _named(error) from error
    except DataFileError as error:
        hint = None if error.hint is None else error.hint.replace("sample_rate_hz=", "--rate, as --rate 1kHz")
        hint = (
            None
            if hint is None
            else hint.replace("time_variable=", "--time-variable").replace("variable=", "--variable")
        )
        expected = error.expected.replace("as sample_rate_hz says", "as --rate says")
        raise DataFileError(error.where, found=error.found, expected=expected, hint=hint) from error


def _reference(
    series: TimeSeries, robot: str | None, posture: str | None, setting: Sequence[str]
) -> tuple[Modes | None, str | None]:
    """Modes of the robot that was typed, or of the one that the file notes; and why there are none, if it notes one.

    Raises:
        ArmonicError: robot, posture or numbers that were typed make no model.
    """
    from armonic.linear import linearize
    from armonic.modal import modes
    from armonic.robot import Robot

    notes = series.notes
    if robot is None and "robot_yaml" not in notes:
        for option, value in (("--posture", posture), ("--set", setting)):
            if value:
                hint = "The file notes no robot."
                raise UsageError(option, found="it without a robot", expected="--robot ROBOT as well", hint=hint)
        return None, None
    typed = robot is not None or posture is not None or bool(setting)
    options: dict[str, Any] = {}
    where: Any
    try:
        if robot is not None:
            model = arguments.open_robot(robot)
        else:
            model = Robot.from_yaml(notes["robot_yaml"], origin="the robot that the file notes")
        model = with_numbers(model, setting)
        if posture is None and robot is None and "coordinates" in notes:
            there = model.posture([float(word) for word in notes["coordinates"].split(",")])
            label = notes.get("posture", "")
            named = label in model.postures and bool((model.postures[label] == there).all())
            where, options = label if named else there, _load(notes)
        else:
            where = arguments.posture(model, posture)[0]
        return modes(linearize(model, where, **options)), None
    except (ArmonicError, ValueError) as error:
        if typed:
            raise
        return None, f"no modes of a model: {error}"


def _load(notes: Any) -> dict[str, Any]:
    """Equilibrium and constant wrench as `armonic simulate` notes them."""
    found: dict[str, Any] = {"equilibrium": notes.get("equilibrium", "reference")}
    if "wrench" in notes:
        found["wrench"] = [float(word) for word in notes["wrench"].split(",")]
        found |= {"frame": notes["wrench_frame"], "wrench_axes": notes["wrench_axes"]}
    return found


def _identify(series: TimeSeries, asked: dict[str, Any]) -> OmaResult:
    from armonic.identification.oma import oma as compute

    with stages_progress("Identifying") as progress:
        try:
            return compute(series, progress=progress, **asked)
        except SignalError as error:
            raise _named(error) from error


def _named(error: SignalError) -> ArmonicError:
    """The error, with the name of the option that was typed."""
    option, hint = _OPTIONS.get(error.where), error.hint
    if error.where == "series":  # it was cut or filtered, by one of these
        option = "--decimate" if "filter" in error.expected else "--window"
    if option is None:
        return error
    if hint is not None and "quiet=" in hint:
        hint = "Say with --window START:STOP what to take."
    return UsageError(option, found=error.found, expected=error.expected, hint=hint)
