"""The option that gives numbers of the robot file other values."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import typer

from armonic.cli.arguments import UsageError
from armonic.errors import ArmonicError

if TYPE_CHECKING:
    from armonic.robot import Robot

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Another value of numbers of the robot file, in SI or with a unit, as tool.mass=4; repeatable.",
    ),
]


def with_numbers(robot: Robot, texts: Iterable[str]) -> Robot:
    """The robot with the values typed as PATH=VALUE or PATTERN=VALUE.

    Raises:
        UsageError: a text is not of that form, a path is unknown, or a value is none that the robot can have.
    """
    for text in texts:
        pattern, equals, given = (part.strip() for part in text.partition("="))
        if not (pattern and equals and given):
            raise UsageError("--set", found=repr(text), expected="PATH=VALUE, such as tool.mass=4")
        value: float | str = given
        with contextlib.suppress(ValueError):  # it may have a unit
            value = float(given)
        try:
            paths = robot.numbers(pattern) if any(sign in pattern for sign in "*?[") else [pattern]
            robot = robot.with_values(dict.fromkeys(paths, value))
        except ArmonicError as error:
            where = f"--set {text}"
            raise UsageError(where, found=error.found, expected=error.expected, hint=error.hint) from error
    return robot
