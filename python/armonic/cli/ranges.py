"""Ranges typed on the command line: of coordinates for grids and samples, of numbers of the robot file for sweeps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from armonic.cli.arguments import UsageError
from armonic.cli.tool import with_tool_mass

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from armonic.robot import Robot

    Array = NDArray[np.float64]

MAX_VALUES = 10_000_000


def values(robot: Robot, option: str, texts: Iterable[str]) -> dict[str, Array]:
    """Values by coordinate of JOINT=lo:hi:n or JOINT=v,v,v, where numbers may have a unit.

    Raises:
        UsageError: a text is not of that form, or no coordinate of the robot.
    """
    found: dict[str, Array] = {}
    for name, given in _pairs(option, texts, "link_2.z=-30deg:30deg:50"):
        found[name] = _series(option, f"{name}={given}", given, lambda text, name=name: _coordinate(robot, name, text))
    return found


def ends(robot: Robot, option: str, texts: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Lowest and highest value by coordinate of JOINT=lo:hi.

    Raises:
        UsageError: a text is not of that form, or no coordinate of the robot.
    """
    found = {}
    for name, given in _pairs(option, texts, "link_2.z=-30deg:30deg"):
        parts = [_coordinate(robot, name, text) for text in given.split(":")]
        if len(parts) != 2 or parts[0] > parts[1]:
            raise UsageError(option, found=repr(f"{name}={given}"), expected="JOINT=lo:hi with lo <= hi")
        found[name] = (parts[0], parts[1])
    return found


def sweep(robot: Robot, texts: Sequence[str], tool_mass: str | None) -> dict[str, Array]:
    """Values by parameter path of PATH=lo:hi:n or PATH=v,v,v; of a tool mass, the file's own value and that one.

    Raises:
        UsageError: a text is not of that form, or both are given.
        UpdateError: the robot file has no such number.
    """
    import numpy as np

    if tool_mass is not None:
        if texts:
            raise UsageError("--tool-mass", found="it beside --sweep", expected="one of them; sweep tool.mass itself")
        path = "tool.mass"
        other = with_tool_mass(robot, tool_mass)
        cases = dict.fromkeys([robot.numbers(path)[path], other.numbers(path)[path]])
        return {path: np.array(list(cases))}
    found: dict[str, Array] = {}
    for path, given in _pairs("--sweep", texts, "control.kp=2000:15000:50"):
        robot.unit(path)  # says what there is
        found[path] = _series("--sweep", f"{path}={given}", given, lambda text, path=path: _plain(path, text))
    return found


def _pairs(option: str, texts: Iterable[str], example: str) -> Iterable[tuple[str, str]]:
    seen = set()
    for text in texts:
        name, equals, given = (part.strip() for part in text.partition("="))
        if not (name and equals and given):
            raise UsageError(option, found=repr(text), expected=f"NAME=range, such as {example}")
        if name in seen:
            raise UsageError(option, found=f"{name} twice", expected="each name once")
        seen.add(name)
        yield name, given


def _series(option: str, shown: str, given: str, read: object) -> Array:
    import numpy as np

    assert callable(read)
    parts = given.split(":")
    if len(parts) == 1:
        return np.array([read(text) for text in given.split(",")])
    expected = f"lo:hi:n with n from 1 to {MAX_VALUES}, or v,v,v"
    if len(parts) != 3 or not parts[2].strip().isdigit() or not 1 <= int(parts[2]) <= MAX_VALUES:
        raise UsageError(option, found=repr(shown), expected=expected)
    return np.linspace(read(parts[0]), read(parts[1]), int(parts[2]))


def _coordinate(robot: Robot, name: str, text: str) -> float:
    text = text.strip()
    value: float | str
    try:
        value = float(text)
    except ValueError:
        value = text
    return float(robot.posture({name: value})[robot.coordinates.index(name)])


def _plain(path: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UsageError("--sweep", found=repr(text), expected=f"a number in SI for {path}") from None
