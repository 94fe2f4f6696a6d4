"""What a fit may change: numbers of the description, each with a start and bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import UpdateError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from armonic.robot import Robot

    Bounds: TypeAlias = Mapping[str, Sequence[float]]

DEFAULT_SPAN = 1e3
"""Without bounds, a parameter may move by this factor either way."""


@dataclass(frozen=True)
class Parameter:
    """One number to fit, on a logarithmic scale.

    Attributes:
        path: where it stands in the description.
        unit: its SI unit.
        start: value to start from.
        lower: lowest admissible value, positive.
        upper: highest.
        index: its place among all stiffnesses, then all dampings, of the model's impedances.
    """

    path: str
    unit: str
    start: float
    lower: float
    upper: float
    index: int


def choose(
    robot: Robot, impedances: tuple[str, ...], patterns: str | Iterable[str], bounds: Bounds | None
) -> tuple[Parameter, ...]:
    """The parameters that match the patterns, in the order of the file.

    Args:
        robot: holds the start values, and bounds where its file gives them.
        impedances: names of the model's spring-dampers.
        patterns: paths, shell patterns or groups ("elasticity", "stiffness", "damping").
        bounds: (low, high) by path or pattern, within the file's; later ones win over earlier ones.

    Raises:
        UpdateError: nothing matches, a start is zero, or bounds are not positive, not ordered, beyond those of the file
            or exclude the start.
    """
    starts = robot.parameters(patterns)
    given: dict[str, Sequence[float]] = {}
    for pattern, pair in (bounds or {}).items():
        given.update(dict.fromkeys(robot.parameters(pattern), pair))
    chosen = []
    for path, start in starts.items():
        if not start > 0:
            raise UpdateError(
                path,
                found=f"{start:g} to start from",
                expected="a positive value, since its logarithm is fitted",
                hint="Give it a small positive start, or leave it out of `parameters`.",
            )
        of_file = robot.bounds(path)
        lower, upper = of_file or (start / DEFAULT_SPAN, start * DEFAULT_SPAN)
        if path in given:
            lower, upper = _checked(path, given[path], of_file)
        if not lower <= start <= upper:
            raise UpdateError(
                f"bounds of {path}",
                found=f"[{lower:g}, {upper:g}], which exclude the start {start:g}",
                expected="bounds around the start",
                hint="Move the start in the robot file, or widen the bounds.",
            )
        chosen.append(Parameter(path, robot.unit(path), start, lower, upper, _index(path, impedances)))
    return tuple(chosen)


def refuse_loaded(chosen: Iterable[Parameter], loaded: Iterable[str]) -> None:
    """Refuses the stiffness of bushings that carry load in a measured posture.

    Their load, and the stiffness that comes from it, would change with the parameter; the model holds both fixed.

    Raises:
        UpdateError: one of them is to be fitted.
    """
    for parameter in chosen:
        for name in loaded:
            if parameter.path.startswith(f"bushings.{name}.stiffness."):
                raise UpdateError(
                    parameter.path,
                    found="a bushing that carries load in a measured posture",
                    expected="bushings at rest there",
                    hint="Remove its `rest`, or leave it out of `parameters`.",
                )


def _checked(path: str, pair: Sequence[float], of_file: tuple[float, float] | None) -> tuple[float, float]:
    try:
        lower, upper = (float(v) for v in pair)
    except (TypeError, ValueError):
        lower, upper = np.nan, np.nan
    if not 0 < lower < upper < np.inf or np.log(lower) == np.log(upper):
        raise UpdateError(f"bounds of {path}", found=repr(pair), expected="two positive numbers, low < high")
    if of_file is not None and not of_file[0] <= lower < upper <= of_file[1]:
        raise UpdateError(
            f"bounds of {path}",
            found=f"[{lower:g}, {upper:g}]",
            expected=f"bounds within those of the robot file, [{of_file[0]:g}, {of_file[1]:g}]",
            hint="Widen them in the robot file: the updated robot must be valid there.",
        )
    return lower, upper


def _index(path: str, impedances: tuple[str, ...]) -> int:
    """links.L.elasticity.A.stiffness belongs to links.L.elasticity.A, bushings.B.damping.x to bushings.B.x."""
    parts = path.split(".")
    quantity = parts.pop(-1 if parts[0] == "links" else -2)
    return impedances.index(".".join(parts)) + (len(impedances) if quantity == "damping" else 0)
