"""What a fit may change: numbers of the description, each with a start, bounds and a scale."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from armonic.errors import UpdateError
from armonic.updating.laws import Law, slopes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.robot import Robot

    Bounds: TypeAlias = Mapping[str, Sequence[float]]
    Patterns: TypeAlias = str | Iterable[str]

DEFAULT_SPAN = 1e3
"""Without bounds, a stiffness or damping may move by this factor either way."""
BODY_SPAN = 10.0
"""Without bounds, any other positive number."""
LINEAR_SPAN = {"m": 0.1, "rad": 0.2}
"""Without bounds, a number that may be zero moves at least so far either way; one of another unit by one."""
POSITIVE = (
    "stiffness", "damping", "mass", "xx", "yy", "zz", "gear_ratio", "rotor_inertia", "shaft_stiffness", "motor_damping",
    "joint_damping", "radius", "kp", "kd", "ki",
)  # fmt: skip
"""Last words of paths to numbers that have no other sign: they are fitted by their logarithms."""

PATTERNS = "a path or pattern, or a list of them"
GROUPS = "groups of paths or patterns, as in [[first, second]]"

Scale = Literal["log", "linear"]


@dataclass(frozen=True)
class Parameter:
    """One number to fit, or several that share one value.

    Attributes:
        path: what it is called: where it stands in the description, the first place where it is tied.
        paths: all numbers of the description that take its value; none for the slope of a law.
        unit: its SI unit.
        start: value to start from.
        lower: lowest admissible value.
        upper: highest.
        scale: a fit moves x = ln(value) ("log") or x = value / size ("linear").
        size: of a linear parameter, SI; 1 on the logarithmic scale.
        indices: its places among all stiffnesses, then all dampings, of the model's impedances; none for others.
        law: how the number depends on the posture, if it does; of the slope, the law that it belongs to.
    """

    path: str
    paths: tuple[str, ...]
    unit: str
    start: float
    lower: float
    upper: float
    scale: Scale = "log"
    size: float = 1.0
    indices: tuple[int, ...] = ()
    law: Law | None = None

    def coordinate(self, value: float) -> float:
        """X of a value."""
        return float(np.log(value)) if self.scale == "log" else value / self.size

    def value(self, x: float) -> float:
        """The value at x."""
        return float(np.exp(x)) if self.scale == "log" else x * self.size

    @property
    def is_impedance(self) -> bool:
        """Whether it is a stiffness or damping of the model's impedances, whose derivatives are analytic."""
        return bool(self.indices)


def choose(
    robot: Robot,
    impedances: tuple[str, ...],
    patterns: Patterns,
    bounds: Bounds | None = None,
    *,
    hold: Patterns = (),
    ties: Iterable[Patterns] = (),
    laws: Mapping[str, Law] | None = None,
) -> tuple[Parameter, ...]:
    """The parameters that match the patterns, in the order of the file; slopes of laws stand at the end.

    Args:
        robot: holds the start values, and bounds where its file gives them.
        impedances: names of the model's spring-dampers.
        patterns: paths, shell patterns or groups ("elasticity", "stiffness", "damping"). A pattern that matches a
            stiffness or damping means only those; one that matches none, any number of the description.
        bounds: (low, high) by path or pattern, within the file's; later ones win over earlier ones.
        hold: what is not fitted, though it matches.
        ties: groups of numbers that share one value.
        laws: by path or pattern, how a stiffness or damping depends on the posture.

    Raises:
        UpdateError: nothing matches, a start is zero where it may not be, bounds are not ordered, beyond those of the
            file or exclude the start, or ties contradict each other, the bounds or what is held.
    """
    starts = numbers_of(robot, patterns, "parameters")
    held = numbers_of(robot, hold, "hold") if hold else {}
    given: dict[str, Sequence[float]] = {}
    for pattern, pair in (bounds or {}).items():
        given.update(dict.fromkeys(numbers_of(robot, pattern, "bounds"), pair))
    chosen = [_parameter(robot, path, start, given, impedances) for path, start in starts.items() if path not in held]
    if not chosen:
        raise UpdateError("hold", found="every parameter", expected="at least one that is fitted")
    chosen = _tied(robot, chosen, ties, held)
    further = slopes(robot, chosen, laws) if laws else []  # marks the numbers that have one
    return (*chosen, *further)


def numbers_of(robot: Robot, patterns: Patterns, where: str) -> dict[str, float]:
    """Values by path of what a fit may change; see `choose` for patterns.

    Args:
        robot: holds the numbers.
        patterns: paths, shell patterns or groups.
        where: the argument that they come from.

    Raises:
        UpdateError: a pattern matches nothing, or is none.
    """
    words = patterns.split(",") if isinstance(patterns, str) else listed(patterns, where, PATTERNS)
    if wrong := [word for word in words if not isinstance(word, str)]:
        raise UpdateError(where, found=repr(wrong[0]), expected=PATTERNS)
    found: dict[str, float] = {}
    try:
        for word in words:
            found |= _matches(robot, word)
        if not words:
            robot.parameters(words)  # which says what is missing
    except UpdateError as error:
        raise UpdateError(where, found=error.found, expected=error.expected, hint=error.hint) from None
    return {path: found[path] for path in robot.numbers() if path in found}


def _matches(robot: Robot, pattern: str) -> dict[str, float]:
    try:
        return robot.parameters([pattern])
    except UpdateError as error:
        try:
            return robot.numbers([pattern])
        except UpdateError:
            raise error from None


def listed(given: object, where: str, expected: str) -> list[Any]:
    """What stands in an argument that has to be a list or the like.

    Raises:
        UpdateError: it is none.
    """
    if not isinstance(given, Iterable) or isinstance(given, str | bytes):
        raise UpdateError(where, found=repr(given), expected=expected)
    return list(given)


def _parameter(robot: Robot, path: str, start: float, given: Bounds, impedances: tuple[str, ...]) -> Parameter:
    indices = _indices(path, impedances)
    unit, of_file = robot.unit(path), robot.bounds(path)
    positive = bool(indices) or is_positive(path, start)
    if positive and not start > 0:
        raise UpdateError(
            path,
            found=f"{start:g} to start from",
            expected="a positive value, since its logarithm is fitted",
            hint="Give it a small positive start, or leave it out of `parameters`.",
        )
    lower, upper = of_file or _default_bounds(start, unit, positive=positive, impedance=bool(indices))
    if path in given:
        lower, upper = _checked(path, given[path], of_file, positive=positive)
    if not lower <= start <= upper:
        raise UpdateError(
            f"bounds of {path}",
            found=f"[{lower:g}, {upper:g}], which exclude the start {start:g}",
            expected="bounds around the start",
            hint="Move the start in the robot file, or widen the bounds.",
        )
    if positive:
        return Parameter(path, (path,), unit, start, lower, upper, indices=indices)
    return Parameter(path, (path,), unit, start, lower, upper, "linear", (upper - lower) / 10)


def is_positive(path: str, value: float) -> bool:
    """Whether a number is fitted by its logarithm, which one that may be zero or negative does not have."""
    words = path.split(".")
    place = {"control": 1, "bushings": -2}.get(words[0], -1)
    return value > 0 and (words[-1] in POSITIVE or words[place] in POSITIVE)


def _default_bounds(start: float, unit: str, *, positive: bool, impedance: bool) -> tuple[float, float]:
    if positive:
        span = DEFAULT_SPAN if impedance else BODY_SPAN
        return start / span, start * span
    reach = max(abs(start), LINEAR_SPAN.get(unit, 1.0))
    return start - reach, start + reach


def _tied(
    robot: Robot, chosen: list[Parameter], ties: Iterable[Patterns], held: Mapping[str, float]
) -> list[Parameter]:
    """The parameters with those of each tie as one, at the place of the first."""
    groups = [list(numbers_of(robot, patterns, "ties")) for patterns in listed(ties, "ties", GROUPS)]
    by_path = {p.path: p for p in chosen}
    twice = [path for path, count in Counter(path for group in groups for path in group).items() if count > 1]
    if twice:
        raise UpdateError(
            "ties", found=f"{twice[0]} in two of them", expected="every number in one tie at most", hint="Join them."
        )
    for group in groups:
        name = "tie of " + ", ".join(group[:3]) + (", ..." if len(group) > 3 else "")
        if len(group) < 2:
            raise UpdateError(name, found="one number", expected="at least two to tie together")
        if outside := [path for path in group if path not in by_path]:
            found = f"{outside[0]}, which is {'held' if outside[0] in held else 'not fitted'}"
            raise UpdateError(name, found=found, expected="numbers that are all fitted")
        members = [by_path[path] for path in group]
        if len({(p.unit, p.scale) for p in members}) > 1:
            units = " and ".join(sorted({p.unit or "a pure number" for p in members}))
            raise UpdateError(name, found=units, expected="numbers of one kind")
        lower, upper = max(p.lower for p in members), min(p.upper for p in members)
        if not lower < upper:
            raise UpdateError(
                name, found="bounds that have no value in common", expected="bounds that overlap", hint="Widen them."
            )
        first = members[0]
        by_path[first.path] = replace(
            first,
            paths=tuple(group),
            start=min(max(first.start, lower), upper),
            lower=lower,
            upper=upper,
            indices=tuple(i for p in members for i in p.indices),
        )
        for path in group[1:]:
            del by_path[path]
    return list(by_path.values())


def refuse_loaded(chosen: Iterable[Parameter], loaded: Iterable[str]) -> None:
    """Refuses the stiffness of bushings that carry load in a measured posture.

    Their load, and the stiffness that comes from it, would change with the parameter; the model holds both fixed.

    Raises:
        UpdateError: one of them is to be fitted.
    """
    for path in (path for parameter in chosen for path in parameter.paths):
        for name in loaded:
            if path.startswith(f"bushings.{name}.stiffness."):
                raise UpdateError(
                    path,
                    found="a bushing that carries load in a measured posture",
                    expected="bushings at rest there",
                    hint="Remove its `rest`, or leave it out of `parameters`.",
                )


def _checked(
    path: str, pair: Sequence[float], of_file: tuple[float, float] | None, *, positive: bool
) -> tuple[float, float]:
    try:
        lower, upper = (float(v) for v in pair)
    except (TypeError, ValueError):
        lower, upper = np.nan, np.nan
    if positive and (not 0 < lower < upper < np.inf or np.log(lower) == np.log(upper)):
        raise UpdateError(f"bounds of {path}", found=repr(pair), expected="two positive numbers, low < high")
    if not -np.inf < lower < upper < np.inf:
        raise UpdateError(f"bounds of {path}", found=repr(pair), expected="two numbers, low < high")
    if of_file is not None and not of_file[0] <= lower < upper <= of_file[1]:
        raise UpdateError(
            f"bounds of {path}",
            found=f"[{lower:g}, {upper:g}]",
            expected=f"bounds within those of the robot file, [{of_file[0]:g}, {of_file[1]:g}]",
            hint="Widen them in the robot file: the updated robot must be valid there.",
        )
    return lower, upper


def _indices(path: str, impedances: tuple[str, ...]) -> tuple[int, ...]:
    """links.L.elasticity.A.stiffness belongs to links.L.elasticity.A, bushings.B.damping.x to bushings.B.x."""
    parts = path.split(".")
    if parts[0] == "bushings":
        quantity = parts.pop(-2)
    elif "elasticity" in parts:
        quantity = parts.pop()
    else:
        return ()
    return (impedances.index(".".join(parts)) + (len(impedances) if quantity == "damping" else 0),)
