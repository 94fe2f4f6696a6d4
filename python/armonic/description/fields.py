"""Single values of the robot file: numbers, names, vectors, axes and spring matrices, read or refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Annotated, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator

from armonic.description.document import Location
from armonic.description.units import LARGEST, Dimension, number, shown
from armonic.errors import ArmonicError, RobotFileError

Vector3 = tuple[float, float, float]
Matrix6 = tuple[tuple[float, ...], ...]

TURNS: Final[dict[str, Vector3]] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
MOVES: Final[dict[str, Vector3]] = {f"t{letter}": axis for letter, axis in TURNS.items()}
DIRECTIONS: Final = ("x", "y", "z", "rx", "ry", "rz")
"""Rows of a bushing: displacement along, then rotation about, the axes of its first frame."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


class FieldError(RobotFileError):
    """An error inside a validator; `at` leads from the validated value to the fault.

    With `at_key` the fault is the key there, not its value; with `is_missing` it is what a mapping lacks.
    `suggest` makes the hint, which is slow among many names and wanted for the first errors only.
    """

    at_key = False
    is_missing = False
    suggest: Callable[[], str | None] | None = None

    def __init__(self, found: object, expected: str, hint: str | None = None, at: Location = ()) -> None:
        super().__init__(
            "here", found=found if isinstance(found, Found) else shown(found), expected=expected, hint=hint
        )
        self.at = at


class Found(str):
    """A finding in words, not a value to quote."""

    __slots__ = ()


def measured(value: object, dimension: Dimension | None, at: Location = ()) -> float:
    """A number or a text with a unit, in SI (no unit if the dimension is None); a `FieldError` otherwise."""
    try:
        return number(value, dimension)
    except ArmonicError as error:
        raise FieldError(Found(error.found), error.expected, error.hint, at) from None


class InUnit(NamedTuple):
    """A raw value with the dimension that its coordinate gives it."""

    raw: object
    dimension: Dimension | None


def in_unit(value: object, at: Location = ()) -> float:
    """The number of a raw value, by the dimension that comes with it."""
    given, dimension = value if isinstance(value, InUnit) else (value, None)
    return measured(given, dimension, at)


def raw(value: object) -> object:
    """A value as the file has it."""
    return value.raw if isinstance(value, InUnit) else value


def measure(dimension: Dimension | None) -> PlainValidator:
    """Validates one number of a dimension; a pure number if it is None."""
    return PlainValidator(lambda value: measured(value, dimension))


def not_negative(dimension: Dimension, expected: str = "a number, 0 or larger") -> PlainValidator:
    """Validates one number of a dimension that is zero or larger."""

    def read(value: object) -> float:
        result = measured(value, dimension)
        if result < 0.0:
            raise FieldError(value, expected)
        return result

    return PlainValidator(read)


def positive(dimension: Dimension | None) -> PlainValidator:
    """Validates one number of a dimension (a pure number if it is None) that is larger than zero."""

    def read(value: object) -> float:
        result = measured(value, dimension)
        # A smaller one is a mistake, and its reciprocal or square would leave the range of a float.
        if not result * LARGEST >= 1.0:
            raise FieldError(value, "a positive number" if result <= 0.0 else f"at least {1 / LARGEST:g}")
        return result

    return PlainValidator(read)


def vector(dimension: Dimension) -> PlainValidator:
    """Validates three numbers of a dimension."""

    def read(value: object) -> Vector3:
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise FieldError(value, "a list of three numbers [x, y, z]")
        x, y, z = (measured(v, dimension, (i,)) for i, v in enumerate(value))
        return x, y, z

    return PlainValidator(read)


def _identifier(value: object) -> str:
    if not isinstance(value, str) or not _IDENTIFIER.fullmatch(value):
        raise FieldError(value, "a name: a letter or _, then letters, digits, _ or -")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        hint = "Put it in quotes." if isinstance(value, int | float) else None
        raise FieldError(value, "a text", hint)
    if not value.strip():
        raise FieldError(value, "a text that is not empty")
    return value


def _version(value: object) -> int:
    if type(value) is not int or value != 1:
        raise FieldError(value, "1", "This version of Armonic reads robot files of format 1.")
    return 1


def _axis(value: object) -> str | Vector3:
    if isinstance(value, str):
        if value in TURNS:
            return value
        raise FieldError(value, "x, y, z or a list of three numbers")
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise FieldError(value, "x, y, z or a list of three numbers")
    x, y, z = (measured(v, None, (i,)) for i, v in enumerate(value))
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        raise FieldError(Found("the zero vector"), "an axis: a vector that is not zero")
    x, y, z = x / largest, y / largest, z / largest
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def matrix6(translation: Dimension, rotation: Dimension, coupling: Dimension, *, nonzero: bool) -> PlainValidator:
    """Validates a 6x6 spring or damper: six diagonal entries, or a symmetric positive semidefinite matrix."""

    def dimension(i: int, j: int) -> Dimension:
        return (translation if i < 3 else rotation) if (i < 3) == (j < 3) else coupling

    def read(value: object) -> Matrix6:
        if not isinstance(value, list | tuple) or len(value) != 6:
            raise FieldError(value, f"a list of six numbers ({', '.join(DIRECTIONS)}) or a 6x6 symmetric list")
        matrix = np.zeros((6, 6))
        if any(isinstance(row, list | tuple) for row in value):
            for i, row in enumerate(value):
                if not isinstance(row, list | tuple) or len(row) != 6:
                    raise FieldError(row, "a row of six numbers", at=(i,))
                matrix[i] = [measured(v, dimension(i, j), (i, j)) for j, v in enumerate(row)]
            _refuse_bad_spring_matrix(matrix)
        else:
            for i, entry in enumerate(value):
                matrix[i, i] = measured(entry, dimension(i, i), (i,))
                if matrix[i, i] < 0.0:
                    raise FieldError(entry, "a number, 0 or larger", at=(i,))
        if nonzero and not matrix.any():
            raise FieldError(Found("six zeros"), "a stiffness in at least one direction")
        return tuple(tuple(row) for row in matrix.tolist())

    return PlainValidator(read)


def _refuse_bad_spring_matrix(matrix: NDArray[np.float64]) -> None:
    root = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    for i in range(6):
        if matrix[i, i] < 0.0:
            raise FieldError(matrix[i, i].item(), "a number, 0 or larger", at=(i, i))
        for j in range(i):
            if matrix[i, j] != matrix[j, i]:
                expected = f"{matrix[j, i]:g} as in row {j + 1}: symmetric"
                raise FieldError(matrix[i, j].item(), expected, at=(i, j))
            largest = root[i] * root[j]
            if abs(matrix[i, j]) > largest * (1.0 + 1e-9):
                expected = f"at most {largest:g}, or the spring could release energy"
                raise FieldError(matrix[i, j].item(), expected, at=(i, j))
    # Scaled to a unit diagonal, so that N/m and N m/rad weigh the same; rounded tables need the tolerance.
    root[root == 0.0] = 1.0
    if np.linalg.eigvalsh(matrix / root / root[:, None])[0] < -1e-9:
        raise FieldError(Found("a matrix with a negative eigenvalue"), "a positive semidefinite matrix")


Name = Annotated[str, PlainValidator(_identifier)]
Text = Annotated[str, PlainValidator(_text)]
Version = Annotated[int, PlainValidator(_version)]
Axis = Annotated[str | Vector3, PlainValidator(_axis)]
