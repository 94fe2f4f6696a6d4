"""Amounts typed with their units: forces, times, frequencies, angles and the like into SI."""

from __future__ import annotations

import math
import re
from typing import Final

from armonic.cli.arguments import UsageError

UNITS: Final[dict[str, dict[str, float]]] = {
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "moment": {"N m": 1.0, "N mm": 1e-3, "kN m": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3, "rpm": 1 / 60},
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "arcmin": math.pi / 10800},
    "length": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
    "rotational cubic stiffness": {"N m/rad^3": 1.0, "kN m/rad^3": 1e3},
    "translational cubic stiffness": {"N/m^3": 1.0, "kN/m^3": 1e3},
    "share": {"": 1.0, "%": 0.01},
    "number": {"": 1.0},
}
"""For each dimension its units and their size in SI; a plain number is in the first."""

_AMOUNT = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(.*)", re.ASCII | re.DOTALL)
_SIGNS = str.maketrans({"·": "", "⋅": "", "*": "", " ": "", "³": "^3", "µ": "u", "μ": "u", "°": "deg"})


def amount(option: str, text: str, dimension: str, *, shown: str | None = None) -> float:
    """A number in SI, or with a unit: "6ms", "50 N", "1.5 kHz".

    Args:
        option: what names it on the command line.
        text: the number.
        dimension: what it measures, a key of `UNITS`.
        shown: the whole of what was typed, for the error; the text itself by default.

    Raises:
        UsageError: it is no finite number, or its unit measures something else.
    """
    found = _AMOUNT.fullmatch(text.strip())
    unit = "" if found is None else found[2].translate(_SIGNS)
    size = 1.0 if not unit else _size(unit, dimension)
    value = math.nan if found is None or size is None else float(found[1]) * size
    if math.isfinite(value):
        return value
    units = [name for name in UNITS[dimension] if name]
    expected = "a number" if not units else f"a number, alone or in {', '.join(units)}"
    other = next((name for name in UNITS if unit and _size(unit, name) is not None), None)
    hint = None if other is None or size is not None else f"{found[2].strip()} measures a {other}."  # type: ignore[index]
    where = option if shown is None or shown == text else f"{option} {shown}"
    raise UsageError(where, found=repr(text.strip()), expected=expected, hint=hint)


def span(option: str, text: str, dimension: str, *, separator: str = ":") -> tuple[float, float]:
    """Two amounts "lo:hi", in order.

    Raises:
        UsageError: they are not two, or not in order.
    """
    parts = text.split(separator)
    ends = [amount(option, part, dimension, shown=text) for part in parts] if len(parts) == 2 else []
    if not ends or ends[0] >= ends[1]:
        expected = f"LOW{separator}HIGH, with the lower end first"
        raise UsageError(option, found=repr(text), expected=expected)
    return ends[0], ends[1]


def whole(option: str, text: str, *, least: int, shown: str | None = None) -> int:
    """A whole number.

    Raises:
        UsageError: it is none, or too small.
    """
    bare = text.strip()
    if not (bare.isascii() and bare.isdigit() and int(bare) >= least):
        where = option if shown is None or shown == text else f"{option} {shown}"
        raise UsageError(where, found=repr(bare), expected=f"a whole number of at least {least}")
    return int(bare)


def _size(unit: str, dimension: str) -> float | None:
    for name, size in UNITS[dimension].items():
        if name and name.replace(" ", "") == unit:
            return size
    return None
