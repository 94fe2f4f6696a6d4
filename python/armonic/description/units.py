"""Numbers with units: turns "70 deg" or "2.5 kN/mm" into SI, and says which units a quantity may have."""

from __future__ import annotations

import math
import re
from typing import Final, Literal

from armonic.errors import RobotFileError

Dimension = Literal[
    "length",
    "angle",
    "mass",
    "inertia",
    "acceleration",
    "rotational stiffness",
    "translational stiffness",
    "coupling stiffness",
    "integral gain",
    "rotational damping",
    "translational damping",
    "coupling damping",
]

UNITS: Final[dict[Dimension, dict[str, float]]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "angle": {
        "rad": 1.0,
        "mrad": 1e-3,
        "deg": math.pi / 180,
        "arcmin": math.pi / 10800,
    },
    "mass": {"kg": 1.0, "g": 1e-3, "t": 1e3},
    "inertia": {"kg m^2": 1.0, "kg cm^2": 1e-4, "kg mm^2": 1e-6, "g cm^2": 1e-7, "g mm^2": 1e-9},
    "acceleration": {"m/s^2": 1.0, "mm/s^2": 1e-3},
    "rotational stiffness": {
        "N m/rad": 1.0,
        "kN m/rad": 1e3,
        "MN m/rad": 1e6,
        "N mm/rad": 1e-3,
        "N m/mrad": 1e3,
        "N m/arcmin": 10800 / math.pi,
        "kN m/arcmin": 10800e3 / math.pi,
    },
    "translational stiffness": {
        "N/m": 1.0,
        "N/mm": 1e3,
        "N/um": 1e6,
        "kN/m": 1e3,
        "kN/mm": 1e6,
        "MN/m": 1e6,
    },
    # Off-diagonal blocks of a 6x6 spring: a force for a rotation, which is a torque for a displacement.
    "coupling stiffness": {"N/rad": 1.0, "kN/rad": 1e3, "N": 1.0, "kN": 1e3},
    "integral gain": {"N m/(rad s)": 1.0, "kN m/(rad s)": 1e3},
    "rotational damping": {"N m s/rad": 1.0, "kN m s/rad": 1e3, "N mm s/rad": 1e-3},
    "translational damping": {"N s/m": 1.0, "N s/mm": 1e3, "kN s/m": 1e3, "kN s/mm": 1e6},
    "coupling damping": {"N s/rad": 1.0, "kN s/rad": 1e3, "N s": 1.0, "kN s": 1e3},
}
"""For each dimension its units and their size in SI; the first is the SI unit."""

LARGEST: Final = 1e30
"""Numbers beyond this are refused: no robot needs them, and their products would overflow."""

_NUMBER_THEN_UNIT = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(.*)", re.ASCII | re.DOTALL)
_PLAIN_SIGNS = str.maketrans({"·": " ", "⋅": " ", "*": " ", "²": "^2", "µ": "u", "μ": "u", "°": "deg"})
_WRITTEN_TOGETHER: Final = {
    dimension: {unit.replace(" ", ""): unit for unit in table} for dimension, table in UNITS.items()
}


def si_unit(dimension: Dimension) -> str:
    """The SI unit of a dimension, as Armonic prints it ("N m/rad")."""
    return next(iter(UNITS[dimension]))


def quantity(text: str, dimension: Dimension) -> float:
    """Read a number with its unit.

    Factors may be joined by a space, ``*`` or ``·``, or written together ("Nm/rad"); a square is ``^2``
    or ``²``.

    Args:
        text: the number and its unit, for example "70 deg", "350 mm", "2.8 MN m/rad".
        dimension: what the number must measure.

    Returns:
        The value in the SI unit of the dimension.

    Raises:
        RobotFileError: the text is not a number with a unit, the unit is unknown or of another dimension, or
            the value is not finite.
    """
    return number(text, dimension)


def number(value: object, dimension: Dimension | None) -> float:
    """Read a finite number in SI, or a text with a number and its unit (see `quantity`).

    Args:
        value: an int or float (in SI), or a text.
        dimension: what the number must measure; None for a pure number, which takes no text.

    Returns:
        The value in the SI unit of the dimension.

    Raises:
        RobotFileError: the value is neither, or is not finite, or is larger than `LARGEST`.
    """
    if isinstance(value, str) and dimension is not None:
        result = _with_unit(value, dimension)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        result = _as_float(value)
    else:
        raise _refusal(value, dimension)
    if not abs(result) <= LARGEST:
        raise RobotFileError(
            dimension or "number", found=shown(value), expected=f"a finite number, at most {LARGEST:g}"
        )
    return result


def _with_unit(text: str, dimension: Dimension) -> float:
    match = _NUMBER_THEN_UNIT.fullmatch(text.strip())
    if match is None:
        raise _refusal(text, dimension)
    figures, written = match[1], match[2].strip()
    if not written:
        raise _refusal(text, dimension, f"Write it without quotes if it is in {si_unit(dimension)}.")
    unit = _unit_name(written, dimension)
    if unit is None:
        raise _refusal(text, dimension, _why_not(written))
    return float(figures) * UNITS[dimension][unit]


def _unit_name(written: str, dimension: Dimension) -> str | None:
    plain = " ".join(written.replace("**", "^").translate(_PLAIN_SIGNS).split()).replace(" /", "/").replace("/ ", "/")
    if plain in UNITS[dimension]:
        return plain
    return _WRITTEN_TOGETHER[dimension].get(plain)


def _why_not(written: str) -> str:
    if re.match(r",\d", written):
        return "Write a decimal point, not a comma."
    for other in UNITS:
        if _unit_name(written, other) is not None:
            return f"{_short(written)} measures {_with_article(other)}."
    return f"The unit {_short(written)} is not known here."


def _with_article(dimension: str) -> str:
    if dimension.endswith(("stiffness", "damping", "mass", "inertia")):
        return dimension
    return f"an {dimension}" if dimension[0] in "aeiou" else f"a {dimension}"


def _as_float(value: int | float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _refusal(value: object, dimension: Dimension | None, hint: str | None = None) -> RobotFileError:
    expected = "a number"
    if dimension is not None:
        units = ", ".join(UNITS[dimension])
        expected += f" in {si_unit(dimension)}, or a text with a number and one of the units {units}"
    return RobotFileError(dimension or "number", found=shown(value), expected=expected, hint=hint)


def shown(value: object) -> str:
    """Name a value of a robot file in an error message, in at most 60 characters."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, int) and value.bit_length() > 200:
        return "an integer of more than 60 digits"
    return _short(value)
