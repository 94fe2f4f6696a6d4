"""The postures of a survey in the order in which they are visited: each a neighbour of the one before."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from armonic.errors import SurveyError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Indices: TypeAlias = NDArray[np.intp]

LARGEST_MAP = 2**40
"""Postures beyond this are a mistake: they would take a year."""
LONGEST_LIST = 10**8
"""Postures one by one, which stand in memory."""


@dataclass(frozen=True)
class Grid:
    """Every combination of values of some coordinates.

    Attributes:
        values: by coordinate name, its values (rad or m) in order; the first name varies slowest.
        base: the posture that gives all other coordinates: a name, joint coordinates, or None for zero.
    """

    values: Mapping[str, ArrayLike]
    base: Any = None


@dataclass(frozen=True)
class Sample:
    """Postures spread over ranges of some coordinates.

    Attributes:
        ranges: by coordinate name, its lowest and highest value (rad or m).
        count: number of postures.
        kind: "sobol" (low-discrepancy, scrambled) or "random" (uniform).
        seed: of the random numbers; the same seed gives the same postures.
        base: the posture that gives all other coordinates, as in `Grid`.
    """

    ranges: Mapping[str, tuple[float, float]]
    count: int
    kind: Literal["sobol", "random"] = "sobol"
    seed: int = 0
    base: Any = None


@dataclass(frozen=True)
class Walk:
    """Points of a box of one or more axes, walked back and forth so that each step changes one axis by one place.

    Attributes:
        axes: names of the box's axes; the sweep, if any, comes first.
        shape: points along each axis.
        sweep: parameter paths with their values, each as long as the first axis; empty without a sweep.
        coordinates: values along each axis that is a coordinate of the robot, by name.
        base: all coordinates of the robot where no axis moves them, (n,).
        columns: for each axis of `coordinates`, the index of that coordinate.
        listed: (P, n) postures one by one along the last axis, for paths and samples; None for grids.
    """

    axes: tuple[str, ...]
    shape: tuple[int, ...]
    sweep: Mapping[str, Array]
    coordinates: Mapping[str, Array]
    base: Array
    columns: tuple[int, ...] = ()
    listed: Array | None = field(default=None, repr=False)

    @property
    def count(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    @property
    def kind(self) -> str:
        """The word for what varies beside the sweep: "posture", "list" or "grid"."""
        return "grid" if self.coordinates else "list" if self.listed is not None else "posture"

    def rows_and_postures(self, places: Indices) -> tuple[Indices, Array]:
        """Sweep index (P,) and coordinates (P, n) of points given by their place in the box (row-major)."""
        index = np.unravel_index(places, self.shape)
        q = np.broadcast_to(self.base, (len(places), len(self.base))).copy()
        if self.listed is not None:
            q = self.listed[index[-1]]
        offset = len(self.shape) - len(self.columns)
        for axis, (column, values) in enumerate(zip(self.columns, self.coordinates.values(), strict=True)):
            q[:, column] = values[index[offset + axis]]
        row = index[0] if self.sweep else np.zeros(len(places), np.intp)
        return np.asarray(row, np.intp), q

    def described(self) -> dict[str, Any]:
        """What was surveyed, in words that JSON knows; long lists of postures by their digest."""
        digest = None if self.listed is None else hashlib.sha256(self.listed.tobytes()).hexdigest()
        return {
            "axes": list(self.axes),
            "shape": list(self.shape),
            "sweep": {path: values.tolist() for path, values in self.sweep.items()},
            "coordinates": {name: values.tolist() for name, values in self.coordinates.items()},
            "base": self.base.tolist(),
            "listed_sha256": digest,
        }


def reflected(shape: Sequence[int], steps: Indices) -> Indices:
    """Places (row-major) that the back-and-forth walk through a box visits at the given steps.

    The walk is the reflected mixed-radix Gray code: an axis runs backwards where the axes before it add up to odd.
    """
    digits = np.unravel_index(steps, tuple(shape))
    parity = np.zeros(len(steps), np.intp)
    place = np.zeros(len(steps), np.intp)
    for digit, size in zip(digits, shape, strict=True):
        turned = np.where(parity % 2 == 0, digit, size - 1 - digit)
        place = place * size + turned
        parity = parity + turned
    return place


def block_shape(shape: Sequence[int], target: int) -> tuple[int, ...]:
    """The largest sub-box of about `target` points that the walk fills in one go: full last axes, part of one more."""
    block = [1] * len(shape)
    size = 1
    for axis in range(len(shape) - 1, -1, -1):
        block[axis] = max(1, min(shape[axis], target // size))
        size *= block[axis]
        if block[axis] < shape[axis]:
            break
    return tuple(block)


def blocks(shape: Sequence[int], block: Sequence[int]) -> Iterator[tuple[int, int, tuple[slice, ...]]]:
    """Blocks in walking order: first and last step (exclusive), and the sub-box they fill."""
    counts = [-(-size // part) for size, part in zip(shape, block, strict=True)]
    start = 0
    for step in range(math.prod(counts)):
        index = np.unravel_index(_block_at(counts, shape, block, step), counts)
        box = tuple(
            slice(int(i) * part, min(size, (int(i) + 1) * part))
            for i, part, size in zip(index, block, shape, strict=True)
        )
        size = math.prod(s.stop - s.start for s in box)
        yield start, start + size, box
        start += size


def _block_at(counts: Sequence[int], shape: Sequence[int], block: Sequence[int], step: int) -> int:
    """The block (row-major) that is walked at a step: axes before the divided one have blocks of one place."""
    digits = [int(d) for d in np.unravel_index(step, tuple(counts))]
    parity, place = 0, 0
    for digit, count, size, part in zip(digits, counts, shape, block, strict=True):
        turned = digit if parity % 2 == 0 else count - 1 - digit
        place = place * count + turned
        # Only whole places before the divided axis turn what follows.
        parity += turned if part == 1 and size == count else 0
    return place


def walk_of(robot: Robot, postures: Any, sweep: Mapping[str, ArrayLike] | None) -> Walk:
    """The walk of a survey.

    Args:
        robot: the robot.
        postures: a `Grid`, a `Sample`, the name of a path or posture in the robot file, coordinates of one posture, or
            an array (P, n) or (P, joints) or list of postures.
        sweep: values by parameter path, all of one length, that go along with each other.

    Raises:
        SurveyError: names, values or lengths do not fit, or the map is too large.
        PostureError: a posture does not fit the robot.
    """
    swept = _sweep_values(robot, {} if sweep is None else sweep)
    axes = [next(iter(swept))] if swept else []
    shape = [len(next(iter(swept.values())))] if swept else []
    if isinstance(postures, Grid):
        given = _named("grid", postures.values, "values of at least one coordinate")
        values = {name: _axis("grid", robot, name, row) for name, row in given.items()}
        columns = tuple(robot.coordinates.index(name) for name in values)
        shape += [len(v) for v in values.values()]
        _refuse_too_many(shape)
        base = _base(robot, postures.base)
        return Walk((*axes, *values), tuple(shape), swept, values, base, columns)
    zero = np.zeros(len(robot.coordinates))
    if isinstance(postures, Sample):
        listed = _sampled(robot, postures)
    elif isinstance(postures, str) and postures in robot.paths:
        listed = robot.paths[postures]
    elif _is_one(robot, postures):
        q = robot.posture(postures)
        if swept:
            return Walk(tuple(axes), tuple(shape), swept, {}, q)
        listed = q[None]
    else:
        listed = _listed(robot, postures)
    _refuse_too_many([*shape, len(listed)])
    return Walk((*axes, "posture"), (*shape, len(listed)), swept, {}, zero, listed=listed)


def path(robot: Robot, through: Sequence[Any], points: int) -> Array:
    """Postures on straight lines in joint space through some postures, evenly spaced, both ends included.

    Args:
        robot: the robot.
        through: at least two postures, by name or coordinates.
        points: how many postures the path has, at least one per given posture.

    Returns:
        (points, n) all coordinates.

    Raises:
        PostureError: a posture does not fit the robot.
        SurveyError: too few postures or points.
    """
    corners = np.array([robot.posture(posture) for posture in ([through] if isinstance(through, str) else through)])
    if len(corners) < 2 or not _whole(points, 2, LONGEST_LIST):
        found = f"{len(corners)} postures and {points!r:.60} points"
        raise SurveyError("path", found=found, expected=f"at least two of each, and at most {LONGEST_LIST} points")
    where = np.linspace(0.0, len(corners) - 1.0, points)
    knots = np.arange(len(corners))
    return np.stack([np.interp(where, knots, column) for column in corners.T], axis=1)


def _whole(value: object, least: int, most: int) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(least <= value <= most)


def _named(where: str, given: object, expected: str) -> Mapping[str, Any]:
    if not isinstance(given, Mapping) or not given or not all(isinstance(name, str) for name in given):
        raise SurveyError(where, found=f"{given!r:.60}", expected=f"{expected}, by name")
    return given


def _is_one(robot: Robot, postures: Any) -> bool:
    if isinstance(postures, str | Mapping):
        return True
    if isinstance(postures, np.ndarray):
        return postures.ndim == 1
    lengths = (len(robot.joint_coordinates), len(robot.coordinates))
    listed = isinstance(postures, Sequence) and len(postures) in lengths
    return listed and not any(
        isinstance(entry, Sequence | np.ndarray | Mapping) for entry in postures if not _unit(entry)
    )


def _unit(entry: Any) -> bool:
    """Whether a text is a number with its unit, not the name of a posture."""
    return isinstance(entry, str) and entry[:1] in "+-.0123456789"


def _listed(robot: Robot, postures: Any) -> Array:
    if isinstance(postures, np.ndarray) and postures.ndim == 2 and postures.dtype == np.float64 and len(postures):
        n, joints = len(robot.coordinates), len(robot.joint_coordinates)
        if not np.isfinite(postures).all():
            row = int(np.flatnonzero(~np.isfinite(postures).all(axis=1))[0])
            raise SurveyError(f"postures, row {row}", found="a number that is not finite", expected="finite numbers")
        if postures.shape[1] == n:
            return np.ascontiguousarray(postures)
        if postures.shape[1] == joints:
            q = np.zeros((len(postures), n))
            q[:, list(robot.tree.joint_indices)] = postures
            return q
    try:
        rows = list(postures)
        if getattr(postures, "ndim", 2) != 2:
            raise TypeError
    except TypeError:
        found = f"{type(postures).__name__} {' x '.join(map(str, getattr(postures, 'shape', ())))}".strip()
        raise SurveyError("postures", found=found, expected="a path, a Grid, a Sample or a list of postures") from None
    if not rows:
        raise SurveyError("postures", found="an empty list", expected="at least one posture")
    return np.array([robot.posture(row) for row in rows])


def _base(robot: Robot, base: Any) -> Array:
    return np.zeros(len(robot.coordinates)) if base is None else robot.posture(base)


def _axis(where: str, robot: Robot, name: str, given: ArrayLike) -> Array:
    if name not in robot.coordinates:
        expected = f"a coordinate of the robot: {', '.join(robot.coordinates)}"
        raise SurveyError(where, found=repr(name), expected=expected)
    return _values(f"{where}, {name}", given)


def _values(where: str, given: ArrayLike) -> Array:
    try:
        values = np.asarray(given, float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all():
        raise SurveyError(where, found=f"{given!r:.60}", expected="a row of finite numbers")
    if values.size > LARGEST_MAP:
        raise SurveyError(where, found=f"{values.size} values", expected=f"at most {LARGEST_MAP}")
    return values


def _sweep_values(robot: Robot, sweep: Mapping[str, ArrayLike]) -> dict[str, Array]:
    if not (isinstance(sweep, Mapping) and not sweep):
        sweep = _named("sweep", sweep, "values of at least one number of the robot file")
    swept = {path: _values(f"sweep, {path}", given) for path, given in sweep.items()}
    lengths = {len(values) for values in swept.values()}
    if len(lengths) > 1:
        found = ", ".join(f"{len(values)} values of {path}" for path, values in swept.items())
        raise SurveyError("sweep", found=found, expected="the same number of each, for they go along with each other")
    for name in swept:
        robot.unit(name)  # says what there is
    return swept


def _refuse_too_many(shape: Sequence[int]) -> None:
    count = math.prod(int(size) for size in shape)
    if count > LARGEST_MAP:
        found = f"{' x '.join(map(str, shape))} = {count:.3g} postures"
        raise SurveyError("map", found=found, expected=f"at most {LARGEST_MAP:.3g} postures")


def _sampled(robot: Robot, sample: Sample) -> Array:
    from scipy.stats import qmc

    if sample.kind not in ("sobol", "random"):
        raise SurveyError("sample", found=f"the kind {sample.kind!r}", expected='"sobol" or "random"')
    if not _whole(sample.count, 1, LONGEST_LIST):
        expected = f"1 to {LONGEST_LIST} postures"
        raise SurveyError("sample", found=f"a count of {sample.count!r:.60}", expected=expected)
    if not _whole(sample.seed, 0, 2**63):
        raise SurveyError(
            "sample", found=f"the seed {sample.seed!r:.60}", expected="a whole number that is not negative"
        )
    low, high = [], []
    for name, ends in _named("sample", sample.ranges, "a range of at least one coordinate").items():
        values = _axis("sample", robot, name, ends)
        if len(values) != 2 or values[0] > values[1]:
            raise SurveyError(f"sample, {name}", found=f"{ends!r:.60}", expected="lowest and highest value")
        low.append(values[0])
        high.append(values[1])
    d = len(low)
    if sample.kind == "random":
        unit = np.random.default_rng(sample.seed).random((sample.count, d))
    else:
        exponent = max(0, math.ceil(math.log2(sample.count)))
        unit = qmc.Sobol(d, seed=sample.seed).random_base2(exponent)[: sample.count]
    q = np.broadcast_to(_base(robot, sample.base), (sample.count, len(robot.coordinates))).copy()
    order = _neighbours_first(unit)
    for column, name in enumerate(sample.ranges):
        values = low[column] + (high[column] - low[column]) * unit[order, column]
        q[:, robot.coordinates.index(name)] = values
    return q


def _neighbours_first(unit: Array) -> Indices:
    """An order of points in the unit cube by cells that are walked back and forth, so that steps are short."""
    count, d = unit.shape
    cells = max(1, round(count ** (1.0 / d)))
    cell = np.minimum((unit * cells).astype(np.intp), cells - 1)
    parity = np.zeros(count, np.intp)
    rank = np.zeros(count, np.intp)
    for axis in range(d - 1):
        turned = np.where(parity % 2 == 0, cell[:, axis], cells - 1 - cell[:, axis])
        rank = rank * cells + turned
        parity = parity + turned
    last = np.where(parity % 2 == 0, unit[:, -1], -unit[:, -1])
    return np.lexsort((last, rank))
