"""`armonic simulate`: a robot under forces over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments, motions
from armonic.cli.amounts import amount
from armonic.cli.arguments import ForceFlag, JsonFlag, PostureOption, RobotName, UsageError
from armonic.cli.model import WrenchAxesOption, WrenchOption
from armonic.cli.outputs import check_output
from armonic.cli.run_delivery import check_series_output, deliver_run
from armonic.cli.setting import SetOption, with_numbers
from armonic.errors import ArmonicError, SimulationError

if TYPE_CHECKING:
    from armonic.loads import WrenchAxes
    from armonic.robot import Robot
    from armonic.series import TimeSeries
    from armonic.simulation.control import SampledControl
    from armonic.simulation.running import Run
    from armonic.simulation.sensors import Sensor

Many = list[str]
_FORCES, _ROBOT, _HOW, _SENSORS = "What acts", "What the robot is", "How it is computed", "What is measured"
_OPTIONS = {
    **{"MeasuredForce": "--force-file", "BandNoise": "--noise", "duration_s": "--duration", "sample_rate_hz": "--rate"},
    **{"tolerance": "--tolerance", "method": "--method", "control": "--control-rate", "equilibrium": "--static"},
    **{"SampledControl.rate_hz": "--control-rate", "SampledControl.delay_s": "--delay"},
    **{"SampledControl.encoder_bits": "--encoder-bits", "channels": "--sensor"},
    **{"Hardening": "--hardening", "Backlash": "--backlash", "Coulomb": "--friction"},
}
"""What the library's arguments are called here."""
_EARLY = "Shorten the run, or say that the force may end early."


def _typed_force(option: str, metavar: str, words: str) -> Any:
    return typer.Option(option, metavar=metavar, help=words, rich_help_panel=_FORCES)


def simulate(
    robot: RobotName,
    duration: Annotated[str, typer.Option("--duration", metavar="TIME", help="Length of the run: 3s.")],
    posture: PostureOption = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write the time series: .zarr, .uff, .csv or .mat."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Time histories as one HTML file that opens offline.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
    impulse: Annotated[
        Many | None,
        _typed_force("--impulse", "AXIS:FORCE:DURATION[@START]", "A constant force for a while: y0:50N:6ms."),
    ] = None,
    hammer: Annotated[
        Many | None,
        _typed_force("--hammer", "AXIS:FORCE:DURATION[@START]", "Half a sine, as of a modal hammer: z:800N:2ms."),
    ] = None,
    step: Annotated[
        Many | None, _typed_force("--step", "AXIS:FORCE[@START]", "A force that sets in and stays: z0:-100N.")
    ] = None,
    sine: Annotated[
        Many | None, _typed_force("--sine", "AXIS:FORCE:FREQ[@START]", "A sine, of this amplitude: x:20N:35Hz.")
    ] = None,
    sweep: Annotated[
        Many | None,
        _typed_force(
            "--sweep", "AXIS:FORCE:FROM-TO[:log][@START]", "A sine whose frequency runs to the end: x:20N:5Hz-100Hz."
        ),
    ] = None,
    noise: Annotated[
        Many | None,
        _typed_force("--noise", "AXIS:RMS:LOW-HIGH[@START]", "Gaussian noise of a band: x:5N:2Hz-200Hz."),
    ] = None,
    force_file: Annotated[
        Many | None,
        _typed_force("--force-file", "FILE[#CHANNEL]:AXIS", "A measured force: tap.uff:z. Default: its only force."),
    ] = None,
    force_rate: Annotated[
        str | None, _typed_force("--force-rate", "FREQ", "Sampling rate of force files that do not say.")
    ] = None,
    force_ends: Annotated[
        bool,
        typer.Option(
            "--force-ends", help="A measured force may end before the run, which goes on.", rich_help_panel=_FORCES
        ),
    ] = False,
    at: Annotated[
        str | None,
        _typed_force(
            "--at",
            "FRAME",
            "Where all forces act. Default: the only frame of the file. Axes are x y z rx ry rz of the frame,"
            " with a 0 behind of the world.",
        ),
    ] = None,
    wrench: WrenchOption = None,
    wrench_axes: WrenchAxesOption = "world",
    setting: SetOption = None,
    static: Annotated[
        bool,
        typer.Option(
            "--static", help="Begin where gravity and load settle the posture; else at it.", rich_help_panel=_ROBOT
        ),
    ] = False,
    control_rate: Annotated[
        str | None,
        typer.Option(
            "--control-rate",
            metavar="FREQ",
            help="Control by a computer at this rate: 1kHz. Default: continuous.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    delay: Annotated[
        str | None,
        typer.Option("--delay", metavar="TIME", help="Of its torques: 1ms.", rich_help_panel=_ROBOT),
    ] = None,
    encoder_bits: Annotated[
        int | None,
        typer.Option(
            "--encoder-bits", metavar="N", help="Of its encoders, per turn of a rotor.", rich_help_panel=_ROBOT
        ),
    ] = None,
    hardening: Annotated[
        Many | None,
        typer.Option(
            "--hardening",
            metavar="JOINT=VALUE",
            help="Cubic term of a spring or shaft, N m/rad^3; repeatable, as all of these.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    backlash: Annotated[
        Many | None,
        typer.Option(
            "--backlash", metavar="JOINT=GAP", help="Free play, from stop to stop: 1arcmin.", rich_help_panel=_ROBOT
        ),
    ] = None,
    friction: Annotated[
        Many | None,
        typer.Option(
            "--friction",
            metavar="JOINT=TORQUE[@motor]",
            help="Dry friction of the joint, or of its motor.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    linear: Annotated[
        bool, typer.Option("--linear", help="The response of the linearized model instead.", rich_help_panel=_HOW)
    ] = False,
    rate: Annotated[
        str, typer.Option("--rate", metavar="FREQ", help="Samples per second.", rich_help_panel=_HOW)
    ] = "1kHz",
    tolerance: Annotated[
        float | None,
        typer.Option("--tolerance", metavar="X", help="Relative error. Default: 1e-10.", rich_help_panel=_HOW),
    ] = None,
    method: Annotated[
        str, typer.Option("--method", metavar="auto|explicit|implicit", help="The steps.", rich_help_panel=_HOW)
    ] = "auto",
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Seed of all noise.", rich_help_panel=_HOW)] = 0,
    frames: Annotated[
        str | None,
        typer.Option(
            "--frames",
            metavar="F,F",
            help="Frames whose motion is wanted. Default: those of the robot file.",
            rich_help_panel=_SENSORS,
        ),
    ] = None,
    sensor: Annotated[
        Many | None,
        typer.Option(
            "--sensor",
            metavar="PATTERN:20bit|0.1%",
            help="How channels are written: in steps of an encoder, so many bits per turn of its rotor; with noise, a"
            " share of the signal; or both with a comma. 16bit/200 is a converter over 200 units. Repeatable.",
            rich_help_panel=_SENSORS,
        ),
    ] = None,
) -> int:
    """Simulate a robot and its control under forces over time.

    The nonlinear closed loop, from rest in a posture. Numbers may have units: N, kN, N m, ms, Hz, kHz, rpm, deg. Ctrl-C
    ends a run and keeps what was computed until then.
    """
    axes: WrenchAxes = arguments.choice("--wrench-axes", wrench_axes, ("world", "frame"))
    load = None if wrench is None else arguments.wrench(wrench)
    forces = (
        *(("--impulse", impulse), ("--hammer", hammer), ("--step", step), ("--sine", sine)),
        *(("--sweep", sweep), ("--noise", noise)),
    )
    typed = [(option, text) for option, texts in forces for text in texts or ()]
    laws = {"--hardening": hardening, "--backlash": backlash, "--friction": friction}
    if linear:
        given = {"--control-rate": control_rate, **laws, "--tolerance": tolerance}
        _refuse_beside_linear(given, method)
    if seed < 0:
        raise UsageError("--seed", found=str(seed), expected="a whole number of at least 0")
    sources = [Path(robot), *motions.force_files(force_file or ())]
    if output is not None:
        check_series_output("-o", output, force=force, sources=sources)
    if plot is not None:
        check_output("--plot", plot, force=force, sources=[*sources, *([output] if output else [])])
    options: dict[str, Any] = {
        "duration_s": amount("--duration", duration, "time"),
        "sample_rate_hz": amount("--rate", rate, "frequency"),
        "frames": None if frames is None else [name.strip() for name in frames.split(",")],
        "equilibrium": "static" if static else "reference",
    }
    control = _control(control_rate, delay, encoder_bits)
    seen_by = motions.sensors(sensor or ())
    the_robot = with_numbers(arguments.open_robot(robot), setting or ())
    where, label = arguments.posture(the_robot, posture)
    for option, names in (("--at", [at] if at else []), ("--frames", options["frames"] or [])):
        _refuse_unknown(the_robot, option, names)
    if load is not None:
        options |= {"wrench": load, "frame": arguments.frame(the_robot, at, "--at"), "wrench_axes": axes}
    reading = {"rate_hz": None if force_rate is None else amount("--force-rate", force_rate, "frequency")}
    acting = [
        *motions.excitations(typed, at, seed),
        *motions.measured_forces(force_file or (), at, ends_early=force_ends, **reading),
    ]
    if not linear:
        joints = motions.joint_laws(the_robot, hardening or (), backlash or (), friction or ())
        options |= {"control": control, "joints": joints, "method": method}
        options |= {} if tolerance is None else {"tolerance": tolerance}
    files = [("--force-file", text) for text in force_file or ()]
    changes = [(option, text) for option, texts in (("--set", setting), *laws.items()) for text in texts or ()]
    what = [f"{option} {text}" for option, text in (*typed, *files, *changes)]
    notes = _notes(what, sensor or (), options, seed)
    try:
        if seen_by:
            _measured(the_robot, _briefly(the_robot, where, acting, options, linear=linear), seen_by, seed)
        series, run, failure = _run(the_robot, where, acting, options, linear=linear)
    except ArmonicError as error:
        raise _named(error) from error
    series = replace(series, notes={**series.notes, **notes, "posture": label})
    return deliver_run(
        series,
        _measured(the_robot, series, seen_by, seed) if seen_by else series,
        run,
        output,
        plot,
        context=f"{the_robot.name}, posture {label}{', at static equilibrium' if static else ''}",
        what=what,
        failure=failure,
        as_json=as_json,
    )


def _refuse_unknown(robot: Robot, option: str, frames: Sequence[str]) -> None:
    for name in frames:
        try:
            robot.frame_index(name)
        except ArmonicError as error:
            raise UsageError(option, found=error.found, expected=error.expected, hint=error.hint) from error


def _refuse_beside_linear(given: Mapping[str, Any], method: str) -> None:
    used = [option for option, value in given.items() if value] + (["--method"] if method != "auto" else [])
    if used:
        raise UsageError("--linear", found=f"{used[0]} beside it", expected="one of them")


def _control(rate: str | None, delay: str | None, bits: int | None) -> SampledControl | None:
    """The computer that controls, if one was typed."""
    if rate is None:
        for option, value in (("--delay", delay), ("--encoder-bits", bits)):
            if value is not None:
                raise UsageError(option, found="it alone", expected="--control-rate as well, such as 1kHz")
        return None
    from armonic.simulation.control import SampledControl

    rate_hz = amount("--control-rate", rate, "frequency")
    late = 0.0 if delay is None else amount("--delay", delay, "time")
    try:
        return SampledControl(rate_hz=rate_hz, delay_s=late, encoder_bits=bits)
    except SimulationError as error:
        raise _named(error) from error


def _run(
    robot: Robot, posture: Any, acting: Sequence[Any], options: Mapping[str, Any], *, linear: bool
) -> tuple[TimeSeries, Run | None, SimulationError | None]:
    """The series, how it was computed if by steps, and what ended it early if it left all bounds."""
    from armonic.simulation.linear_response import linear_response
    from armonic.simulation.running import simulate as compute

    if linear:
        return linear_response(robot, posture, acting, **options), None, None
    with _progress(options["duration_s"]) as progress:
        try:
            run = compute(robot, posture, acting, progress=progress, **options)
        except SimulationError as error:
            if error.run is None:
                raise
            return error.run.series, error.run, error
    return run.series, run, None


def _briefly(
    robot: Robot, posture: Any, acting: Sequence[Any], options: Mapping[str, Any], *, linear: bool
) -> TimeSeries:
    """The channels of a run, from its first two samples without a force: a word that fits none is told before."""
    from armonic.simulation.excitations import Step

    still = [Step(axis=one.axis, frame=one.frame, force=0.0) for one in acting]
    brief = {**options, "duration_s": 1 / options["sample_rate_hz"]}
    return _run(robot, posture, still, brief, linear=linear)[0]


def _measured(robot: Robot, series: TimeSeries, seen_by: Mapping[str, Sensor], seed: int) -> TimeSeries:
    """What the sensors make of it. A turn of a motor's encoder is one of its rotor, ahead of the gear."""
    from armonic.simulation.sensors import encoders, measure

    of_channel: dict[str, Sensor] = {}
    for pattern, sensor in seen_by.items():
        for column in series.matching(pattern):
            channel = series.channels[column]
            of_channel[channel.label] = sensor
            if sensor.bits is None or sensor.saturates:
                continue
            if channel.unit != "rad":  # a turn is the range of an angle only
                raise UsageError(
                    f"--sensor {pattern}",
                    found=f"{channel.label} in {channel.unit} with bits of a turn",
                    expected="the range of the converter, such as 16bit/200",
                )
            if channel.quantity == "motor_position":
                turn = encoders(robot, sensor.bits)[channel.label].full_range
                of_channel[channel.label] = replace(sensor, full_range=turn)
    return measure(series, of_channel, seed=seed)


def _notes(what: Sequence[str], sensors: Sequence[str], options: Mapping[str, Any], seed: int) -> dict[str, str]:
    """What the file says of how it was made, beside what the library notes of the robot."""
    notes = {"simulated": "; ".join(what) or "nothing acting"}
    if sensors:
        notes["sensors"] = "; ".join(sensors)
    if sensors or "--noise" in notes["simulated"]:
        notes["seed"] = str(seed)
    if options["equilibrium"] != "reference":
        notes["equilibrium"] = options["equilibrium"]
    if "wrench" in options:
        notes |= {"wrench": ", ".join(map(repr, options["wrench"])), "wrench_frame": options["frame"]}
        notes["wrench_axes"] = options["wrench_axes"]
    if options.get("control") is not None:
        notes["control"] = repr(options["control"])
    return notes


def _named(error: ArmonicError) -> ArmonicError:
    """The error, with the name of the option that was typed."""
    option = _OPTIONS.get(error.where, _OPTIONS.get(error.where.partition(".")[0].partition(" ")[0]))
    if option is None:
        return error
    hint = "Shorten the run, or give --force-ends." if error.hint == _EARLY else error.hint
    return UsageError(option, found=error.found, expected=error.expected, hint=hint)


@contextmanager
def _progress(duration_s: float) -> Iterator[Callable[[float], object] | None]:
    """A bar on stderr that vanishes at the end; None if nobody would see it."""
    import sys

    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("Simulating"), BarColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=duration_s)
        yield lambda now: bar.update(task, completed=now, description=f"{now:.3g} of {duration_s:g} s")
