"""Single values of the robot file: numbers, names, vectors, axes and spring matrices, read or refused."""

from __future__ import annotations

import math
import re
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator

from armonic.document import Location
from armonic.errors import ArmonicError, RobotFileError
from armonic.units import Dimension, number, shown

Vector3 = tuple[float, float, float]
Matrix6 = tuple[tuple[float, ...], ...]

TURNS: Final[dict[str, Vector3]] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
MOVES: Final[dict[str, Vector3]] = {f"t{letter}": axis for letter, axis in TURNS.items()}
DIRECTIONS: Final = ("x", "y", "z", "rx", "ry", "rz")
"""Rows of a bushing: displacement along, then rotation about, the axes of its first frame."""

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")


class Fault(RobotFileError):
    """An error inside a validator; `at` leads from the validated value to the fault."""

    def __init__(self, found: object, expected: str, hint: str | None = None, at: Location = ()) -> None:
        super().__init__(
            "here", found=found if isinstance(found, Found) else shown(found), expected=expected, hint=hint
        )
        self.at = at


class Found(str):
    """A finding in words, not a value to quote."""

    __slots__ = ()


def measured(value: object, dimension: Dimension, at: Location = ()) -> float:
    """A number or a text with a unit, in SI; a `Fault` otherwise."""
    try:
        return number(value, dimension)
    except ArmonicError as error:
        raise Fault(Found(error.found), error.expected, error.hint, at) from None


def measure(dimension: Dimension) -> PlainValidator:
    return PlainValidator(lambda value: measured(value, dimension))


def vector(dimension: Dimension) -> PlainValidator:
    def read(value: object) -> Vector3:
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise Fault(value, "a list of three numbers [x, y, z]")
        x, y, z = (measured(v, dimension, (i,)) for i, v in enumerate(value))
        return x, y, z

    return PlainValidator(read)


def _identifier(value: object) -> str:
    if not isinstance(value, str) or not _IDENTIFIER.fullmatch(value):
        raise Fault(value, "a name: a letter or _, then letters, digits, _ or -")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        hint = "Put it in quotes." if isinstance(value, int | float) else None
        raise Fault(value, "a text", hint)
    if not value.strip():
        raise Fault(value, "a text that is not empty")
    return value


def _version(value: object) -> int:
    if type(value) is not int or value != 1:
        raise Fault(value, "1", "This version of Armonic reads robot files of format 1.")
    return 1


def _axis(value: object) -> str | Vector3:
    if isinstance(value, str):
        if value in TURNS:
            return value
        raise Fault(value, "x, y, z or a list of three numbers")
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise Fault(value, "x, y, z or a list of three numbers")
    x, y, z = (
        measured(v, "length", (i,)) if not isinstance(v, str) else _no_unit(v, i) for i, v in enumerate(value)
    )
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        raise Fault(Found("the zero vector"), "an axis: a vector that is not zero")
    x, y, z = x / largest, y / largest, z / largest
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def _no_unit(value: str, index: int) -> float:
    raise Fault(value, "a number without a unit", at=(index,))


def matrix6(
    translation: Dimension, rotation: Dimension, coupling: Dimension, *, nonzero: bool
) -> PlainValidator:
    def dimension(i: int, j: int) -> Dimension:
        return (translation if i < 3 else rotation) if (i < 3) == (j < 3) else coupling

    def read(value: object) -> Matrix6:
        if not isinstance(value, list | tuple) or len(value) != 6:
            raise Fault(value, f"a list of six numbers ({', '.join(DIRECTIONS)}) or a 6x6 symmetric list")
        matrix = np.zeros((6, 6))
        if any(isinstance(row, list | tuple) for row in value):
            for i, row in enumerate(value):
                if not isinstance(row, list | tuple) or len(row) != 6:
                    raise Fault(row, "a row of six numbers", at=(i,))
                matrix[i] = [measured(v, dimension(i, j), (i, j)) for j, v in enumerate(row)]
            _refuse_bad_spring_matrix(matrix)
        else:
            for i, entry in enumerate(value):
                matrix[i, i] = measured(entry, dimension(i, i), (i,))
                if matrix[i, i] < 0.0:
                    raise Fault(entry, "a number, 0 or larger", at=(i,))
        if nonzero and not matrix.any():
            raise Fault(Found("six zeros"), "a stiffness in at least one direction")
        return tuple(tuple(row) for row in matrix.tolist())

    return PlainValidator(read)


def _refuse_bad_spring_matrix(matrix: NDArray[np.float64]) -> None:
    for i in range(6):
        for j in range(i):
            if matrix[i, j] != matrix[j, i]:
                raise Fault(matrix[i, j].item(), f"{matrix[j, i]:g} as in row {j + 1}: symmetric", at=(i, j))
    diagonal = np.diag(matrix)
    if (diagonal < 0.0).any():
        i = int(np.argmin(diagonal))
        raise Fault(diagonal[i].item(), "a number, 0 or larger", at=(i, i))
    # Scaled to a unit diagonal, so that N/m and N m/rad weigh the same; rounded tables need the tolerance.
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    if np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0] < -1e-9:
        raise Fault(Found("a matrix that can release energy"), "a positive semidefinite matrix")


Name = Annotated[str, PlainValidator(_identifier)]
Text = Annotated[str, PlainValidator(_text)]
Version = Annotated[int, PlainValidator(_version)]
Axis = Annotated[str | Vector3, PlainValidator(_axis)]
