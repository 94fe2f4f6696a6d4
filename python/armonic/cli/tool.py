"""The option that gives the tool of a robot file another mass."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated

import typer

from armonic.cli.arguments import UsageError

if TYPE_CHECKING:
    from armonic.robot import Robot

ToolMassOption = Annotated[
    str | None,
    typer.Option("--tool-mass", metavar="KG", help="Another mass of the tool that the robot file describes."),
]


def with_tool_mass(robot: Robot, mass: str | None) -> Robot:
    """The robot with that mass at its tool; as it is if nothing was typed.

    Raises:
        UsageError: the robot has no tool.
        RobotFileError: no mass of this world.
    """
    if mass is None:
        return robot
    if robot.description.tool is None:
        raise UsageError(
            "--tool-mass",
            found="a robot file without a tool",
            expected="`tool: {frame: ..., mass: ...}` in it",
        )
    value: float | str = mass
    with contextlib.suppress(ValueError):  # it may have a unit
        value = float(mass)
    return robot.with_values({"tool.mass": value})
