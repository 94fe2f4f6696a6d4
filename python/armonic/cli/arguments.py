"""Words typed on the command line into values, and the options that several commands share."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from armonic.errors import ArmonicError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from armonic.robot import Robot

    Array = NDArray[np.float64]

MAX_LINES = 1_000_000

RobotName = Annotated[str, typer.Argument(metavar="ROBOT", help="A robot file, or a name that `armonic robots` lists.")]
PostureOption = Annotated[
    str | None,
    typer.Option(
        "--posture",
        metavar="P",
        help="A name in the robot file, or the joint coordinates: 0,70deg,-100deg."
        " Default: the only posture of the file.",
    ),
]
FrameOption = Annotated[
    str | None,
    typer.Option("--frame", metavar="F", help="A frame of the robot. Default: the only one of its file."),
]
JsonFlag = Annotated[bool, typer.Option("--json", help="Print JSON for machines, nothing else.")]
ForceFlag = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]

_NUMBER = re.compile(r"\s*[+-]?\.?\d")
_AXIS = re.compile(r"r?[xyz]")
_Choice = TypeVar("_Choice", bound=str)


class UsageError(ArmonicError):
    """An option or argument of the command line does not make sense."""


def open_robot(name: str) -> Robot:
    """The robot of a catalog name or path."""
    from armonic.robot import load

    return load(name)


def posture(robot: Robot, text: str | None) -> tuple[str | Array, str]:
    """A posture as typed, and what to call it; the only named one by default.

    Returns:
        The name, or all coordinates (n,); and a short label.

    Raises:
        UsageError: nothing was typed and there is not exactly one named posture.
        PostureError: there is no such posture, or the numbers do not fit.
    """
    if text is None:
        names = tuple(robot.postures)
        if len(names) != 1:
            raise UsageError(
                "--posture",
                found="no posture",
                expected=f"one of {', '.join(names)}" if names else f"values of {', '.join(robot.joint_coordinates)}",
                hint=None if names else "The robot file names no posture.",
            )
        return names[0], names[0]
    if text in robot.postures:
        return text, text
    parts = text.split(",")
    if any(_NUMBER.match(part) for part in parts):
        return robot.posture([_plain_or_unit(part) for part in parts]), "".join(text.split())
    robot.posture(text)  # which says what there is
    return text, text


def _plain_or_unit(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text.strip()


def frame(robot: Robot, text: str | None, option: str = "--frame") -> str:
    """A frame as typed; by default the only one that the robot file defines.

    Raises:
        UsageError: nothing was typed and the file does not define exactly one frame.
        PostureError: there is no such frame.
    """
    if text is not None:
        robot.frame_index(text)
        return text
    names = [entry.name for entry in robot.description.frames]
    if len(names) != 1:
        raise UsageError(option, found="no frame", expected=f"one of {', '.join(names or robot.frames)}")
    return names[0]


def choice(option: str, text: str, choices: Sequence[_Choice]) -> _Choice:
    """One of a few words.

    Raises:
        UsageError: it is none of them.
    """
    for one in choices:
        if text == one:
            return one
    raise UsageError(option, found=repr(text), expected=f"one of {', '.join(choices)}")


def lines(text: str) -> Array:
    """Frequencies in Hz of start:stop:step, both ends included where the step meets them.

    Raises:
        UsageError: it is not such a range.
    """
    import numpy as np

    expected = "start:stop:step in Hz with 0 <= start <= stop and step > 0, such as 0.2:30:0.2"
    try:
        # Decimal arithmetic gives 0.6, where 3 * 0.2 in binary does not.
        start, stop, step = (Decimal(part.strip()) for part in text.split(":"))
        if not (0 <= start <= stop and step > 0 and stop.is_finite() and step.is_finite()):
            raise ValueError
        steps = (stop - start) / step
    except (ValueError, ArithmeticError):  # of Decimal: no number, NaN, or beyond its range
        raise UsageError("--freq", found=repr(text), expected=expected) from None
    if steps >= MAX_LINES:
        raise UsageError("--freq", found=repr(text), expected=f"at most {MAX_LINES} lines")
    return np.array([float(start + k * step) for k in range(int(steps) + 1)])


def wrench(text: str) -> list[float]:
    """Force and moment of fx,fy,fz,mx,my,mz.

    Raises:
        UsageError: it is not six finite numbers.
    """
    return _numbers("--wrench", text, ",", 6, "fx,fy,fz,mx,my,mz in N and N m, such as 100,0,0,0,0,0")


def band(text: str) -> tuple[float, float]:
    """The ends of a band lo:hi in Hz.

    Raises:
        UsageError: it is not two numbers in order.
    """
    expected = "lo:hi in Hz, such as 5:25"
    low, high = _numbers("--band", text, ":", 2, expected)
    if not low <= high:
        raise UsageError("--band", found=repr(text), expected=expected)
    return low, high


def bounds(texts: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Bounds by pattern of PATTERN=lo:hi; whether they make sense is for the fit to say.

    Raises:
        UsageError: one is not of that form.
    """
    expected = "PATTERN=lo:hi in SI units, such as 'links.arm.*.stiffness=1e6:5e6'"
    found = {}
    for text in texts:
        pattern, equals, ends = text.rpartition("=")
        if not (equals and pattern.strip()):
            raise UsageError("--bounds", found=repr(text), expected=expected)
        low, high = _numbers("--bounds", ends, ":", 2, expected, shown=text)
        found[pattern.strip()] = (low, high)
    return found


def _numbers(
    option: str, text: str, separator: str, count: int, expected: str, shown: str | None = None
) -> list[float]:
    try:
        values = [float(part) for part in text.split(separator)]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise UsageError(option, found=repr(text if shown is None else shown), expected=expected)
    return values


def axes(option: str, text: str) -> tuple[str, ...]:
    """Axes of a frame: xyz, or x,rz.

    Raises:
        UsageError: it is not a row of different axes.
    """
    bare = re.sub(r"[\s,]", "", text)
    found = tuple(_AXIS.findall(bare))
    if not found or "".join(found) != bare or len(set(found)) < len(found):
        raise UsageError(option, found=repr(text), expected="different axes among x y z rx ry rz, such as xyz or x,rz")
    return found


def responses(text: str) -> tuple[tuple[str, str], ...]:
    """Single responses as pairs of output and input axis: x/x,y/z.

    Raises:
        UsageError: it is not a row of different pairs.
    """
    pairs = [tuple(end.strip() for end in part.split("/")) for part in text.split(",")]
    found = tuple((pair[0], pair[1]) for pair in pairs if len(pair) == 2 and all(map(_AXIS.fullmatch, pair)))
    if len(set(found)) < len(pairs):
        expected = "different pairs output/input of axes among x y z rx ry rz, such as x/x,y/y,z/z"
        raise UsageError("--responses", found=repr(text), expected=expected)
    return found


def axis_map(text: str) -> dict[str, str]:
    """Axes of a file onto axes of the sensor frame: x:-z,z:x.

    Raises:
        UsageError: it is not such a list of pairs.
    """
    pairs = [part.split(":") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise UsageError("--axes", found=repr(text), expected="pairs such as x:-z,z:x (axis of the file, of the frame)")
    return {source.strip(): target.strip() for source, target in pairs}


def one_for_each(option: str, given: Sequence[str], files: Sequence[Path]) -> list[str | None]:
    """An option that was given not at all, once for all files, or once per file.

    Raises:
        UsageError: it was given another number of times.
    """
    if len(given) not in {0, 1, len(files)}:
        expected = "one" if len(files) == 1 else f"one, or one for each of the {len(files)} files"
        raise UsageError(option, found=f"{len(given)} of them", expected=expected)
    return list(given) if len(given) == len(files) else [given[0] if given else None] * len(files)
