"""What is fitted and what is known of it, as typed: held numbers, ties, laws and priors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from armonic.cli.arguments import UsageError
from armonic.errors import ArmonicError

if TYPE_CHECKING:
    from armonic.robot import Robot
    from armonic.updating import Law, Prior

PRIOR = "PATTERN=SHARE or PATTERN=SHARE@VALUE, such as 'links.arm.*.damping=50%'"


def share(option: str, text: str) -> float:
    """A share as 0.01 or 1%.

    Raises:
        UsageError: it is no positive number.
    """
    bare = text.strip()
    value = _number(bare.removesuffix("%")) / (100 if bare.endswith("%") else 1)
    if not 0 < value < math.inf:
        raise UsageError(option, found=repr(text), expected="a positive share, such as 0.01 or 1%")
    return value


def hold(robot: Robot, texts: Iterable[str]) -> tuple[Robot, list[str]]:
    """The robot with the values typed as PATTERN=VALUE, in SI or with a unit, and every pattern that is held.

    Raises:
        UsageError: a text is not PATTERN or PATTERN=VALUE, or a value is none that the robot can have.
        UpdateError: a pattern matches nothing.
    """
    from armonic.updating.parameters import numbers_of

    patterns = []
    for text in texts:
        pattern, equals, given = (part.strip() for part in text.partition("="))
        if not pattern or (equals and not given):
            raise UsageError(
                "--hold", found=repr(text), expected="PATTERN or PATTERN=VALUE, such as links.arm.mass=250"
            )
        patterns.append(pattern)
        if not equals:
            continue
        value: float | str = given if math.isnan(_number(given)) else float(given)
        for path in numbers_of(robot, pattern, "--hold"):
            try:
                robot = robot.with_values({path: value})
            except ArmonicError as error:
                where = f"--hold {text}"
                raise UsageError(where, found=error.found, expected=error.expected, hint=error.hint) from error
    return robot, patterns


def ties(texts: Iterable[str]) -> list[list[str]]:
    """Groups of patterns of PATTERN,PATTERN.

    Raises:
        UsageError: one of them is empty.
    """
    found = []
    for text in texts:
        group = [part.strip() for part in text.split(",")]
        if not all(group):
            raise UsageError(
                "--tie", found=repr(text), expected="PATTERN,PATTERN,..., or one pattern of several numbers"
            )
        found.append(group)
    return found


def laws(texts: Iterable[str]) -> dict[str, Law]:
    """Laws by pattern of PATTERN=COORDINATE or PATTERN=torque.

    Raises:
        UsageError: one is not of that form.
    """
    from armonic.updating import Law

    expected = "PATTERN=COORDINATE or PATTERN=torque, such as 'links.arm.elasticity.z.stiffness=torque'"
    return {pattern: Law(over) for pattern, over in _pairs("--law", texts, expected)}


def priors(robot: Robot, texts: Sequence[str]) -> dict[str, Prior]:
    """Priors by pattern of PATTERN=SHARE or PATTERN=SHARE@VALUE.

    Raises:
        UsageError: one is not of that form, or a share of a number that may be zero or negative.
    """
    from armonic.updating import Prior

    found = {}
    for pattern, given in _pairs("--prior", texts, PRIOR):
        deviation, at, value = given.partition("@")
        if at and not math.isfinite(_number(value)):
            raise UsageError("--prior", found=repr(f"{pattern}={given}"), expected=PRIOR)
        if deviation.strip().endswith("%"):
            _refuse_signed(robot, pattern, given)
        found[pattern] = Prior(share("--prior", deviation), float(value) if at else None)
    return found


def _refuse_signed(robot: Robot, pattern: str, given: str) -> None:
    """Numbers that may be negative have deviations of their own unit, of which percent are none."""
    from armonic.updating.parameters import is_positive, numbers_of

    for path, value in numbers_of(robot, pattern, "--prior").items():
        if not is_positive(path, value):
            unit = robot.unit(path)
            raise UsageError(
                f"--prior {pattern}={given}",
                found=f"percent of {path}, which may be zero or negative",
                expected=f"a standard deviation in {unit}" if unit else "a standard deviation as a number",
            )


def _pairs(option: str, texts: Iterable[str], expected: str) -> list[tuple[str, str]]:
    pairs = []
    for text in texts:
        pattern, equals, given = (part.strip() for part in text.rpartition("="))
        if not (pattern and equals and given):
            raise UsageError(option, found=repr(text), expected=expected)
        pairs.append((pattern, given))
    if len(dict(pairs)) < len(pairs):
        names = [pattern for pattern, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError(option, found=f"{twice} twice", expected="each pattern once")
    return pairs


def _number(text: str) -> float:
    """The number, or NaN."""
    try:
        return float(text)
    except ValueError:
        return math.nan
