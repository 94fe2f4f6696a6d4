"""Linear models along the coordinates of a fit: the slopes of M, C, K, G and of frames' Jacobians.

Stiffness and damping of impedances enter by their analytic derivative, any other number of the description by central
differences of the matrices, whose steps are chosen for what the number is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ModelError, RobotFileError
from armonic.linear import LinearModel, linearize

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot
    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]

POLYNOMIAL_STEP = 2.0**-5
"""Masses, centres of mass, inertia, lengths, gains, shafts and gears enter the matrices by their second power at most.
Central differences of those are exact, so the step is wide and rounding shrinks with it; it is a share of the number or
of its size, whichever is larger."""
CURVED_STEP = 2.0**-17
"""Angles (in rad) and radii (a share) enter by sines and inverses: the cube root of the rounding unit balances what
rounding adds against the third derivative, and leaves about 1e-10 of the slope."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """A robot on either side along one coordinate of a fit; None where a number is impossible.

    Attributes:
        low: the robot with the smaller number.
        high: with the larger one.
        step: the distance of either in x.
    """

    low: Robot | None
    high: Robot | None
    step: float

    def models(self, centre: LinearModel, posture: Posture) -> tuple[LinearModel, LinearModel, float]:
        """The models on either side and their distance in x.

        At the edge of what is possible the centre stands for one side, which is exact for what is linear still.

        Raises:
            ModelError: neither side has a model.
        """
        found: list[LinearModel | None] = []
        refused: ModelError | None = None
        for robot in (self.low, self.high):
            try:
                found.append(None if robot is None else linearize(robot, posture))
            except ModelError as error:
                found.append(None)
                refused = error
        low, high = found
        if low is None and high is None:
            raise refused or AssertionError
        return low or centre, high or centre, self.step * (2 - found.count(None))


@dataclass(frozen=True, eq=False)
class Tangent:
    """A linear model and the slopes of its matrices in the coordinates of a fit.

    Attributes:
        model: the model.
        spring: slope of the stiffness of every impedance, (c, r); zero rows for other numbers.
        damper: of their damping, (c, r).
        sides: for other numbers the models on either side and their distance in x; None for impedances.
    """

    model: LinearModel
    spring: Array
    damper: Array
    sides: tuple[tuple[LinearModel, LinearModel, float] | None, ...]

    @classmethod
    def still(cls, model: LinearModel) -> Tangent:
        """A model without any slopes."""
        none = np.zeros((0, len(model.impedances)))
        return cls(model, none, none, ())

    @property
    def general(self) -> list[int]:
        """The coordinates that are more than impedances."""
        return [i for i, sides in enumerate(self.sides) if sides is not None]

    @cached_property
    def matrices(self) -> Array:
        """Slopes of G, K, C and M, the powers −1 to 2 of s, (c, 4, N, N)."""
        B = self.model.directions
        out = np.zeros((len(self.sides), 4, *self.model.mass.shape))
        out[:, 1] = np.einsum("ra,cr,rb->cab", B, self.spring, B)
        out[:, 2] = np.einsum("ra,cr,rb->cab", B, self.damper, B)
        for i, sides in enumerate(self.sides):
            if sides is not None:
                low, high, width = sides
                for k, name in enumerate(("integral", "stiffness", "damping", "mass")):
                    out[i, k] += (getattr(high, name) - getattr(low, name)) / width
        return out

    def jacobian(self, frame: str) -> Array:
        """Slopes of the Jacobian of a frame in its own axes, (c, 6, N)."""
        out = np.zeros((len(self.sides), 6, len(self.model.coordinates)))
        for i in self.general:
            low, high, width = self.sides[i] or (self.model, self.model, 1.0)
            out[i] = (high.jacobian(frame) - low.jacobian(frame)) / width
        return out


def values_of(robot: Robot, parameters: Sequence[Parameter]) -> Array:
    """The numbers of a robot that parameters stand for, (c,), SI."""
    numbers = robot.numbers()
    return np.array([numbers[p.path] for p in parameters])


def given(parameters: Sequence[Parameter], values: Iterable[float]) -> dict[str, float]:
    """Values of parameters by path, for `Robot.with_values`; those that are tied get the same."""
    return {path: float(v) for p, v in zip(parameters, values, strict=True) for path in p.paths}


def _slope(parameter: Parameter, value: float) -> float:
    """∂value/∂x of a coordinate."""
    return value if parameter.scale == "log" else parameter.size


def is_impedance(robot: Robot, parameter: Parameter) -> bool:
    """Whether a parameter is stiffness or damping of impedances, and enters nowhere else.

    The stiffness of a bushing with a rest posture of its own does: it decides on the load of the bushing.
    """
    strained = tuple(f"bushings.{b.name}.stiffness." for b in robot.bushings if b.rest is not None)
    free = not any(path.startswith(strained) for path in parameter.paths)
    return free and 0 < len(parameter.indices) == len(parameter.paths)


def neighbours(base: Robot, parameters: Sequence[Parameter], values: Array) -> tuple[Neighbours | None, ...]:
    """The robots on either side along every coordinate that is more than an impedance; None for impedances.

    Args:
        base: the robot.
        parameters: the c coordinates.
        values: where to stand, (c,).

    Raises:
        RobotFileError: neither side is a possible robot.
    """
    centre = given(parameters, values)

    def pair(p: Parameter, value: float) -> Neighbours:
        curved = p.unit == "rad" or p.path.endswith(".radius")
        scale = 1.0 if p.unit == "rad" else max(abs(value), 0.0 if p.scale == "log" else p.size)
        step = (CURVED_STEP if curved else POLYNOMIAL_STEP) * scale
        sides: list[Robot | None] = []
        refused: RobotFileError | None = None
        for side in (value - step, value + step):
            try:
                sides.append(base.with_values(centre | dict.fromkeys(p.paths, side)))
            except RobotFileError as error:
                sides.append(None)
                refused = error
        low, high = sides
        if low is None and high is None:
            raise refused or AssertionError
        return Neighbours(low, high, step / _slope(p, value))

    return tuple(None if is_impedance(base, p) else pair(p, float(v)) for p, v in zip(parameters, values, strict=True))


def tangent(
    model: LinearModel,
    posture: Posture,
    parameters: Sequence[Parameter],
    values: Array,
    sides: Sequence[Neighbours | None],
) -> Tangent:
    """A robot's linear model with the slopes of its matrices.

    Args:
        model: of the robot at those values.
        posture: where it was linearized.
        parameters: the c coordinates.
        values: their values, (c,).
        sides: from `neighbours`, shared by all postures.

    Raises:
        PostureError: the posture does not fit the robot.
        ModelError: a model cannot be built.
    """
    r = len(model.impedances)
    slopes = np.zeros((len(parameters), 2 * r))
    for i, p in enumerate(parameters):
        if sides[i] is None:
            np.add.at(slopes[i], list(p.indices), _slope(p, float(values[i])))
    models = tuple(None if side is None else side.models(model, posture) for side in sides)
    return Tangent(model, slopes[:, :r], slopes[:, r:], models)


class Course:
    """A robot's linear models in several postures, at any point x of a fit.

    Args:
        robot: the robot that holds all other numbers.
        postures: one for each thing that was measured; equal ones are linearized once.
        parameters: the c coordinates.

    Raises:
        PostureError: a posture does not fit the robot.
        ModelError: a model cannot be built.
    """

    def __init__(self, robot: Robot, postures: Iterable[Posture], parameters: Sequence[Parameter]) -> None:
        self.robot, self.parameters = robot, tuple(parameters)
        places = [robot.posture(posture) for posture in postures]
        first: dict[bytes, int] = {}
        self._which = [first.setdefault(place.tobytes(), len(first)) for place in places]
        self._places = [places[self._which.index(i)] for i in range(len(first))]
        self.impedances_only = all(is_impedance(robot, p) for p in parameters)
        self._models = [linearize(robot, place) for place in self._places]

    def tangents(self, x: Array) -> list[Tangent]:
        """The models and the slopes of their matrices, one per posture given.

        Raises:
            ArithmeticError: there is no such robot or model.
        """
        values = self._values(x)
        try:
            sides = neighbours(self.robot, self.parameters, values)
            models = self._at(values)
            found = [
                tangent(model, place, self.parameters, values, sides)
                for model, place in zip(models, self._places, strict=True)
            ]
        except (RobotFileError, ModelError) as error:
            raise ArithmeticError(str(error)) from None
        return [found[i] for i in self._which]

    def models(self, x: Array) -> list[LinearModel]:
        """The models alone, one per posture given.

        Raises:
            ArithmeticError: there is no such robot or model.
        """
        try:
            found = self._at(self._values(x))
        except (RobotFileError, ModelError) as error:
            raise ArithmeticError(str(error)) from None
        return [found[i] for i in self._which]

    def _values(self, x: Array) -> Array:
        with np.errstate(over="ignore"):
            values = np.array([p.value(float(v)) for p, v in zip(self.parameters, x, strict=True)])
        if not np.isfinite(values).all():
            raise ArithmeticError("a value that is not finite")
        return values

    def _at(self, values: Array) -> list[LinearModel]:
        if not self.impedances_only:
            robot = self.robot.with_values(given(self.parameters, values))
            return [linearize(robot, place) for place in self._places]
        changed = []
        for model in self._models:
            theta = np.concatenate([model.spring, model.damper])
            for p, value in zip(self.parameters, values, strict=True):
                theta[list(p.indices)] = value
            changed.append(model.with_impedances(*theta.reshape(2, -1)))
        return changed
