"""`armonic tap`: a tap test rehearsed on the simulated robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import INTERRUPTED, arguments, motions
from armonic.cli.amounts import amount
from armonic.cli.arguments import ForceFlag, JsonFlag, PostureOption, RobotName, UsageError
from armonic.cli.outputs import check_output
from armonic.cli.refusals import error_data, refuse
from armonic.cli.setting import SetOption, with_numbers
from armonic.cli.terminal import line, print_json, remark, show, steps_progress
from armonic.errors import ArmonicError
from armonic.text import count

if TYPE_CHECKING:
    from armonic.simulation.tap_test import TapTest

Many = list[str]
ENDINGS = (".uff", ".unv", ".uf58", ".h5", ".hdf5")
"""Of files that hold many records."""
_WHERE, _HAMMER, _ROBOT, _MEASURED = "What is hit and watched", "The hammer", "What the robot is", "What is measured"
_AMOUNTS = {
    **{"force_n": ("--peak", "force"), "spread": ("--spread", "share"), "pulse_s": ("--pulse", "time")},
    **{
        "pulse_spread": ("--pulse-spread", "share"),
        "tilt_rad": ("--tilt", "angle"),
        "offset_m": ("--offset", "length"),
    },
    **{
        "softening": ("--softening", "share"),
        "sample_rate_hz": ("--rate", "frequency"),
        "record_s": ("--record", "time"),
    },
    **{"pretrigger_s": ("--pretrigger", "time"), "noise": ("--noise", "number")},
    **{"force_noise_n": ("--force-noise", "force"), "force_range_n": ("--force-range", "force")},
    **{"acceleration_range": ("--acceleration-range", "number")},
}
"""The library's arguments that are amounts: their options here, and what they measure."""
_OPTIONS = {
    **{name: option for name, (option, _) in _AMOUNTS.items()},
    **{"points": "--points", "sensors": "--sensors", "hits": "--hits", "double_hits": "--double-hits"},
    **{"overloads": "--overloads", "Sensor.bits": "--bits", "seed": "--seed", "duration_s": "--record"},
    **{"Hardening": "--hardening", "Backlash": "--backlash", "Coulomb": "--friction"},
}
"""What the library's arguments are called here."""


def _of(panel: str, option: str, metavar: str, words: str) -> Any:
    return typer.Option(option, metavar=metavar, help=words, rich_help_panel=panel)


def tap(
    robot: RobotName,
    posture: PostureOption = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write the records: .uff or .h5.")
    ] = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
    points: Annotated[
        str | None,
        _of(
            _WHERE,
            "--points",
            "PLACE.AXIS,...",
            "Where it is hit, one after the other: sensor.x,arm.y. Default: x, y and z of the only frame of the file.",
        ),
    ] = None,
    sensors: Annotated[
        str | None,
        _of(_WHERE, "--sensors", "PLACE.AXIS,...", "Where accelerometers are. Default: x, y and z of that frame."),
    ] = None,
    hits: Annotated[int, _of(_WHERE, "--hits", "N", "On each point.")] = 5,
    peak: Annotated[str, _of(_HAMMER, "--peak", "FORCE", "Peak force of a middling hit.")] = "200N",
    spread: Annotated[str, _of(_HAMMER, "--spread", "SHARE", "How much it scatters.")] = "25%",
    pulse: Annotated[
        str, _of(_HAMMER, "--pulse", "TIME", "Contact: 5-10 ms of a soft tip, 1-2 ms of a hard.")
    ] = "10ms",
    pulse_spread: Annotated[str, _of(_HAMMER, "--pulse-spread", "SHARE", "How much it scatters.")] = "5%",
    tilt: Annotated[str, _of(_HAMMER, "--tilt", "ANGLE", "How far its direction is off.")] = "1.2deg",
    offset: Annotated[str, _of(_HAMMER, "--offset", "LENGTH", "How far beside the point it hits.")] = "2mm",
    double_hits: Annotated[int, _of(_HAMMER, "--double-hits", "N", "How many of all hits rebound.")] = 0,
    overloads: Annotated[int, _of(_HAMMER, "--overloads", "N", "How many are too hard for the range.")] = 0,
    seed: Annotated[int, _of(_HAMMER, "--seed", "N", "Seed of all scatter and noise.")] = 0,
    softening: Annotated[
        str,
        _of(_ROBOT, "--softening", "SHARE", "By how much springs are softer as far as a middling hit swings them: 1%."),
    ] = "0",
    hardening: Annotated[
        Many | None,
        _of(_ROBOT, "--hardening", "JOINT=VALUE", "Cubic term of a spring or shaft, N m/rad^3; repeatable, as these."),
    ] = None,
    backlash: Annotated[Many | None, _of(_ROBOT, "--backlash", "JOINT=GAP", "Free play, from stop to stop.")] = None,
    friction: Annotated[
        Many | None, _of(_ROBOT, "--friction", "JOINT=TORQUE[@motor]", "Dry friction of the joint, or of its motor.")
    ] = None,
    setting: SetOption = None,
    rate: Annotated[str, _of(_MEASURED, "--rate", "FREQ", "Samples per second.")] = "512Hz",
    record: Annotated[
        str, _of(_MEASURED, "--record", "TIME", "Length of a record: its inverse is the resolution.")
    ] = "8s",
    pretrigger: Annotated[str, _of(_MEASURED, "--pretrigger", "TIME", "From its start to the hit.")] = "100ms",
    together: Annotated[
        bool,
        typer.Option("--together", help="All hits on a point in one record, so far apart.", rich_help_panel=_MEASURED),
    ] = False,
    noise: Annotated[str, _of(_MEASURED, "--noise", "X", "Of the accelerometers, m/s^2.")] = "0.001",
    force_noise: Annotated[str, _of(_MEASURED, "--force-noise", "FORCE", "Of the hammer.")] = "50mN",
    bits: Annotated[int, _of(_MEASURED, "--bits", "N", "Of the converter.")] = 24,
    force_range: Annotated[
        str | None, _of(_MEASURED, "--force-range", "FORCE", "Its end. Default: twice a middling hit.")
    ] = None,
    acceleration_range: Annotated[
        str | None,
        _of(_MEASURED, "--acceleration-range", "X", "Likewise, m/s^2. Default: twice what such a hit makes."),
    ] = None,
) -> int:
    """Rehearse a tap test: hit the simulated robot and record it.

    The records are what a hammer and accelerometers would give, for `armonic ema` and others; the true modes are
    printed beside. Numbers may have units: N, kN, ms, Hz, deg, mm, %. Ctrl-C keeps the records that are complete.
    """
    typed = {
        **{"force_n": peak, "spread": spread, "pulse_s": pulse, "pulse_spread": pulse_spread, "tilt_rad": tilt},
        **{"offset_m": offset, "softening": softening, "sample_rate_hz": rate, "record_s": record},
        **{"pretrigger_s": pretrigger, "noise": noise, "force_noise_n": force_noise},
        **{"force_range_n": force_range, "acceleration_range": acceleration_range},
    }
    options: dict[str, Any] = {
        name: amount(_AMOUNTS[name][0], text, _AMOUNTS[name][1]) for name, text in typed.items() if text is not None
    }
    if output is not None:
        _check_output(output, force=force, source=Path(robot))
    the_robot = with_numbers(arguments.open_robot(robot), setting or ())
    where, _ = arguments.posture(the_robot, posture)
    options |= {
        "points": _labels(points),
        "sensors": _labels(sensors),
        "hits": hits,
        "double_hits": double_hits,
        "overloads": overloads,
        "joints": motions.joint_laws(the_robot, hardening or (), backlash or (), friction or ()),
        "one_record_per_hit": not together,
        "bits": bits,
        "seed": seed,
    }
    from armonic.simulation import tap_test as rehearsing

    try:
        with steps_progress("Tapping", "records") as progress:
            test = rehearsing.tap_test(the_robot, where, progress=progress, **options)
    except ArmonicError as error:
        raise _named(error) from error
    return _deliver(test, output, as_json=as_json)


def _deliver(test: TapTest, output: Path | None, *, as_json: bool) -> int:
    """Write and show a test, so that what fails loses nothing that came before."""
    from armonic.cli.tap_results import tap_data, tap_tables

    written: dict[str, str] = {}
    failure: ArmonicError | OSError | None = None
    if output is not None:
        from armonic.files import measured_files

        try:
            measured_files.write_measured(output, records=test.records, geometry=test.geometry)
            written["records"] = str(output)
        except (ArmonicError, OSError) as error:
            failure = error
    if as_json:
        ending = {"written": written} | ({"error": error_data(failure)} if failure else {})
        print_json(tap_data(test) | ending)
    else:
        show(*tap_tables(test))
        if written:
            line(f"Wrote {output}: {count(len(test.records), 'record')}.")
        elif failure is None:
            show("Write the records to a file with -o FILE.uff or .h5.")
    if failure is not None:
        return refuse(failure, as_json=False)
    if test.status == "complete":
        return 0
    kept = f" and written to {output}" if output else ", and nothing was written"
    remark(f"interrupted: the first {count(len(test.records), 'record')} were taken{kept}")
    return INTERRUPTED


def _check_output(path: Path, *, force: bool, source: Path) -> None:
    if path.suffix.lower() not in ENDINGS:
        found = f"the ending {path.suffix!r}" if path.suffix else "no ending"
        raise UsageError(f"-o {path}", found=found, expected=f"one of {', '.join(ENDINGS)}")
    check_output("-o", path, force=force, sources=[source])


def _labels(text: str | None) -> Sequence[str] | None:
    return None if text is None else [label.strip() for label in text.split(",")]


def _named(error: ArmonicError) -> ArmonicError:
    """The error, with the name of the option that was typed."""
    option = _OPTIONS.get(error.where, _OPTIONS.get(error.where.partition(".")[0]))
    if option is None:
        return error
    hint = error.hint and error.hint.replace("joints=, such as Hardening or Backlash", "--hardening or --backlash")
    return UsageError(option, found=error.found, expected=error.expected, hint=hint)
