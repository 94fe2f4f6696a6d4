"""What moves a robot in a run, as typed: forces over time, joints that are not linear, and the sensors that look on."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armonic.cli.amounts import amount, whole
from armonic.cli.arguments import UsageError
from armonic.errors import ArmonicError, DataFileError

if TYPE_CHECKING:
    from armonic.robot import Robot
    from armonic.simulation.excitations import Excitation
    from armonic.simulation.joints import JointLaw
    from armonic.simulation.sensors import Sensor

FORMS = {
    "--impulse": "AXIS:FORCE:DURATION[@START], such as y0:50N:6ms",
    "--hammer": "AXIS:FORCE:DURATION[@START], such as z:800N:2ms@0.5s",
    "--step": "AXIS:FORCE[@START], such as z0:-100N",
    "--sine": "AXIS:FORCE:FREQ[@START], such as x:20N:35Hz",
    "--sweep": "AXIS:FORCE:FROM-TO[:log][@START], such as x:20N:5Hz-100Hz",
    "--noise": "AXIS:RMS:LOW-HIGH[@START], such as x:5N:2Hz-200Hz",
    "--force-file": "FILE[#CHANNEL]:AXIS, such as tap.uff:z or run.zarr#force:tool.y0:y0",
    "--hardening": "JOINT=VALUE, such as link_2=1e6",
    "--backlash": "JOINT=GAP, such as link_2=1arcmin",
    "--friction": "JOINT=TORQUE[@motor], such as link_2=5",
    "--sensor": "PATTERN:BITSbit[/RANGE], PATTERN:NOISE%, or both with a comma, such as motor_position:20bit",
}
"""How each is typed."""
_UNIT = re.compile(r"[a-zA-Z]+$")


def excitations(typed: Sequence[tuple[str, str]], frame: str | None, seed: int) -> list[Excitation]:
    """Forces over time.

    Args:
        typed: option and text of each; of files see `measured_forces`.
        frame: where all of them act; None is the only frame of the robot file.
        seed: of the first noise; the next has the next, so that two are independent.

    Raises:
        UsageError: one is not of its form, or makes no force.
    """
    from armonic.simulation.excitations import BandNoise, HammerPulse, Impulse, Sine, Step, Sweep

    found: list[Excitation] = []
    noises = 0
    for option, text in typed:
        parts, when = _parts(option, text)
        common: dict[str, Any] = {"frame": frame, **when}
        make: type[Excitation]
        if option in ("--impulse", "--hammer"):
            make = Impulse if option == "--impulse" else HammerPulse
            common["duration_s"] = amount(option, parts[2], "time", shown=text)
        elif option == "--step":
            make = Step
        elif option == "--sine":
            make = Sine
            common["freq_hz"] = amount(option, parts[2], "frequency", shown=text)
        elif option == "--sweep":
            make = Sweep
            common["from_hz"], common["to_hz"] = _range(option, parts[2], text)
            common["logarithmic"] = len(parts) == 4
        else:
            make = BandNoise
            common["low_hz"], common["high_hz"] = _range(option, parts[2], text)
            common["seed"] = seed + noises
            noises += 1
        size = amount(option, parts[1], _of_axis(parts[0]), shown=text)
        common["rms" if option == "--noise" else "force"] = size
        found.append(_made(option, text, make, axis=parts[0], **common))
    return found


def measured_forces(
    texts: Iterable[str], frame: str | None, *, rate_hz: float | None, ends_early: bool
) -> list[Excitation]:
    """Forces of files.

    Args:
        texts: FILE:AXIS, or FILE#CHANNEL:AXIS.
        frame: where all of them act.
        rate_hz: samples per second of files that do not say.
        ends_early: whether a force may end before the run.

    Raises:
        UsageError: a text is not of that form, or a file holds no such force.
    """
    from armonic.files.series_files import read_series
    from armonic.simulation.measured_force import MeasuredForce

    found: list[Excitation] = []
    for text in texts:
        place, colon, axis = text.rpartition(":")  # a path may hold colons too
        file, _, channel = place.partition("#")
        if not (colon and file and axis):
            raise UsageError("--force-file", found=repr(text), expected=FORMS["--force-file"])
        try:
            series = read_series(file, sample_rate_hz=rate_hz)
        except DataFileError as error:
            hint = "Say it with --force-rate." if "sampling rate" in error.found and rate_hz is None else error.hint
            raise DataFileError(error.where, found=error.found, expected=error.expected, hint=hint) from error
        options: dict[str, Any] = {"axis": axis, "frame": frame, "ends_early": ends_early}
        found.append(_made("--force-file", text, MeasuredForce.of, series, channel or "force", **options))
    return found


def force_files(texts: Iterable[str]) -> list[Path]:
    """The files of --force-file."""
    return [Path(text.rpartition(":")[0].partition("#")[0]) for text in texts]


def joint_laws(
    robot: Robot, hardening: Iterable[str], backlash: Iterable[str], friction: Iterable[str]
) -> list[JointLaw]:
    """Joints that are not linear; values in SI of the joint's shaft or spring, or with a unit.

    Raises:
        UsageError: a text is not of its form, or a value is none of the joint.
    """
    from armonic.simulation.joints import Backlash, Coulomb, Hardening

    found: list[JointLaw] = []
    for text in hardening:
        joint, given = _pair("--hardening", text)
        turning = _turns(robot, joint, shaft=True)
        dimension = f"{'rotational' if turning else 'translational'} cubic stiffness"
        value = amount("--hardening", given, dimension, shown=text)
        found.append(_made("--hardening", text, Hardening, joint=joint, cubic=value))
    for text in backlash:
        joint, given = _pair("--backlash", text)
        dimension = "angle" if _turns(robot, joint, shaft=True) else "length"
        gap = amount("--backlash", given, dimension, shown=text)
        found.append(_made("--backlash", text, Backlash, joint=joint, gap=gap))
    for text in friction:
        joint, given = _pair("--friction", text)
        given, at, side = given.partition("@")
        if at and side.strip() not in ("joint", "motor"):
            raise UsageError("--friction", found=repr(text), expected=FORMS["--friction"])
        side = side.strip() or "joint"
        dimension = "moment" if _turns(robot, joint, shaft=side == "motor") else "force"
        torque = amount("--friction", given, dimension, shown=text)
        found.append(_made("--friction", text, Coulomb, joint=joint, torque=torque, at=side))
    return found


def sensors(texts: Iterable[str]) -> dict[str, Sensor]:
    """Sensors by pattern of channels.

    Raises:
        UsageError: a text is not of its form, or a number out of range.
    """
    from armonic.simulation.sensors import Sensor

    found: dict[str, Sensor] = {}
    for text in texts:
        pattern, colon, given = (part.strip() for part in text.rpartition(":"))
        if not (pattern and colon and given):
            raise UsageError("--sensor", found=repr(text), expected=FORMS["--sensor"])
        if pattern in found:
            raise UsageError("--sensor", found=f"{pattern} twice", expected="each pattern once")
        options: dict[str, Any] = {}
        for part in (word.strip() for word in given.split(",")):
            steps, bit, rest = part.partition("bit")
            if bit and "bits" not in options and (not rest or rest.startswith("/")):
                options["bits"] = whole("--sensor", steps, least=1, shown=text)
                if rest:  # the range of a converter, which stops at its ends; an encoder counts on
                    options["full_range"] = amount("--sensor", rest[1:], "number", shown=text)
                    options["saturates"] = True
            elif part.endswith("%") and "noise" not in options:
                options["noise"] = amount("--sensor", part, "share", shown=text)
            else:
                raise UsageError("--sensor", found=repr(text), expected=FORMS["--sensor"])
        found[pattern] = _made("--sensor", text, Sensor, **options)
    return found


def _made(option: str, text: str, make: Callable[..., Any], *given: Any, **named: Any) -> Any:
    """What the library makes of it; what it refuses is said of the option."""
    try:
        return make(*given, **named)
    except ArmonicError as error:
        part = error.where.rpartition(".")[2].removesuffix("_s").removesuffix("_hz")
        found = error.found if part == error.where or part == "axis" else f"{part} {error.found}"
        raise UsageError(f"{option} {text}", found=found, expected=error.expected, hint=error.hint) from error


def _parts(option: str, text: str) -> tuple[list[str], dict[str, float]]:
    """What stands between the colons, as many as the option has, and when it starts, if that was typed."""
    body, at, start = text.rpartition("@") if "@" in text else (text, "", "")
    parts = [part.strip() for part in body.split(":")]
    wanted = {"--step": (2,), "--sweep": (3, 4)}.get(option, (3,))
    logarithmic = len(parts) != 4 or parts[3] == "log"
    if len(parts) not in wanted or not all(parts) or not logarithmic:
        raise UsageError(option, found=repr(text), expected=FORMS[option])
    return parts, {"start_s": amount(option, start, "time", shown=text)} if at else {}


def _of_axis(axis: str) -> str:
    return "moment" if axis.startswith("r") else "force"


def _range(option: str, given: str, text: str) -> tuple[float, float]:
    """Both ends of FROM-TO; a minus behind an e belongs to the number."""
    for minus in re.finditer("-", given):
        ends = given[: minus.start()].strip(), given[minus.end() :].strip()
        if all(ends) and ends[0][-1] not in "eE":
            break
    else:
        raise UsageError(option, found=repr(text), expected=FORMS[option])
    units = {_UNIT.sub("", end) and (_UNIT.search(end) or [""])[0] for end in ends}
    if "" in units and not units <= {"", "Hz"}:
        # 1-2kHz: from one Hertz or from one kilohertz? Not to be guessed.
        raise UsageError(f"{option} {text}", found=repr(given), expected="a unit at both ends, or none")
    low, high = (amount(option, end, "frequency", shown=text) for end in ends)
    return low, high


def _pair(option: str, text: str) -> tuple[str, str]:
    name, equals, given = (part.strip() for part in text.rpartition("="))
    if not (name and equals and given):
        raise UsageError(option, found=repr(text), expected=FORMS[option])
    return name, given


def _turns(robot: Robot, joint: str, *, shaft: bool) -> bool:
    """Whether what a pattern of joints means turns: a shaft always does, else it is as the joint is."""
    kinds = [kind for kind in robot.tree.kinds if kind != "fixed"]
    driven = set(robot.drives.coordinates.tolist()) if shaft else set()
    for i, name in enumerate(robot.coordinates):
        of_this = fnmatchcase(name, joint) or fnmatchcase(name.rsplit(".", 1)[0], joint)
        if of_this and i not in driven and robot.flexible[i]:
            return kinds[i] != "prismatic"
    return True
