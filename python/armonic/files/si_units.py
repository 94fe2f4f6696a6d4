"""Units of vibration channels: what each measures, and its factor to SI."""

from __future__ import annotations

import math
from typing import NamedTuple

from armonic.files.sampling import plain
from armonic.series import Quantity

STANDARD_GRAVITY = 9.80665
"""m/s² of one g, by definition."""


class Unit(NamedTuple):
    """What a unit is in SI.

    Attributes:
        quantity: what is measured in it; None where several are.
        unit: its SI unit.
        factor: by which a value is multiplied.
    """

    quantity: Quantity | None
    unit: str
    factor: float


def _table() -> dict[str, Unit]:
    inch, pound = 0.0254, 4.4482216152605  # both by definition
    table: dict[str, Unit] = {}
    lengths = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "µm": 1e-6, "um": 1e-6, "in": inch}
    for name, factor in lengths.items():
        table[name] = Unit("displacement", "m", factor)
        table[f"{name}/s"] = Unit("velocity", "m/s", factor)
        for second in ("/s²", "/s2", "/s/s", "/sec²", "/(s²)"):
            table[name + second] = Unit("acceleration", "m/s²", factor)
    for name in ("g", "gn", "g0", "g_n"):
        table[name] = Unit("acceleration", "m/s²", STANDARD_GRAVITY)
    for name, factor in {"N": 1.0, "kN": 1e3, "mN": 1e-3, "lbf": pound, "kgf": STANDARD_GRAVITY}.items():
        table[name] = Unit("force", "N", factor)
    for name, factor in {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}.items():
        for rate in ("", "/s", "/s²"):
            table[name + rate] = Unit(None, "rad" + rate, factor)
    return table


_UNITS = _table()
_LOOSE = {name.lower(): unit for name, unit in _UNITS.items() if name != "mN"}  # MN, written small, is another one
_OF_QUANTITY: dict[str, tuple[str, str]] = {
    "displacement": ("m", "rad"), "velocity": ("m/s", "rad/s"), "acceleration": ("m/s²", "rad/s²"),
    "force": ("N", "N·m"),
}  # fmt: skip


def si_unit(text: str) -> Unit | None:
    """What a unit is in SI, however it is written; None if it is not known.

    Args:
        text: such as "g", "mm/s^2", "kN".
    """
    name = plain(text).replace(" ", "").replace("μ", "µ")
    return _UNITS.get(name) or _LOOSE.get(name.lower())


def unit_of(quantity: str, axis: str) -> str:
    """The SI unit of a quantity along an axis x, y, z or about one; empty where it has none.

    Args:
        quantity: of a channel.
        axis: x y z rx ry rz.
    """
    return _OF_QUANTITY.get(quantity, ("", ""))[axis.startswith("r")]
