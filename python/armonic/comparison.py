"""Two sets of modes beside each other: which belong together, how far apart they are, and what has no partner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.identification.shape_criteria import mac_table
from armonic.modal import Modes, mac

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

RATES = {
    "signal": 0,
    "joint_position": 0,
    "motor_position": 0,
    "displacement": 0,
    "joint_velocity": 1,
    "motor_velocity": 1,
    "velocity": 1,
    "joint_acceleration": 2,
    "acceleration": 2,
}
"""How often a quantity has been differentiated: its part of a shape is that of the motion times λ to this power. Forces
and torques are not here; they are no motion."""
SHAPE_WEIGHT = 0.5
"""Weight of 1 − MAC beside the difference of poles as a share of the largest one that is allowed."""
LEAST_COMMON = 2
"""Coordinates that two shapes must share: of one coordinate alone the MAC is always 1."""


@dataclass(frozen=True, eq=False, repr=False)
class ModeTable:
    """What a comparison needs to know of a set of modes.

    Args:
        poles: λ, (m,), rad/s.
        shapes: by rows, (m, d), amplitudes of motion; None if there are none. A row of NaN is a shape not known.
        coordinates: names of the d coordinates, each once; None if there are no shapes.

    Raises:
        SignalError: a pole is not finite, or shapes and names do not fit.
    """

    poles: Complex
    shapes: Complex | None = None
    coordinates: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if self.poles.ndim != 1 or not np.isfinite(self.poles).all():
            found = f"shape {self.poles.shape}" if self.poles.ndim != 1 else "a pole that is not finite"
            raise SignalError("ModeTable.poles", found=found, expected="finite poles (m,) in rad/s")
        if (self.shapes is None) != (self.coordinates is None):
            raise SignalError("ModeTable", found="shapes or coordinates alone", expected="both or neither")
        if self.shapes is None or self.coordinates is None:
            return
        wanted = (len(self.poles), len(self.coordinates))
        if self.shapes.shape != wanted:
            raise SignalError("ModeTable.shapes", found=f"shape {self.shapes.shape}", expected=f"shape {wanted}")
        if len(set(self.coordinates)) < len(self.coordinates):
            twice = next(name for name in self.coordinates if self.coordinates.count(name) > 1)
            raise SignalError("ModeTable.coordinates", found=f"{twice!r} twice", expected="every name once")

    @property
    def natural_freq_hz(self) -> Array:
        """|λ| / 2π, (m,)."""
        return np.asarray(np.abs(self.poles) / (2 * np.pi), np.float64)

    @property
    def damping_ratio(self) -> Array:
        """−Re λ / |λ|, (m,), a fraction; zero for a pole at zero."""
        size = np.abs(self.poles)
        return np.divide(-self.poles.real, size, out=np.zeros(len(size)), where=size > 0)


@dataclass(frozen=True)
class ModePair:
    """A mode of each set that belong together.

    Attributes:
        index_a: the mode's place in the first set.
        index_b: and in the second.
        freq_difference: f_a / f_b − 1 of the natural frequencies; the second set is the reference.
        damping_difference: ζ_a − ζ_b, a fraction.
        mac: of the shapes over the coordinates that both sets have; None where these are too few.
    """

    index_a: int
    index_b: int
    freq_difference: float
    damping_difference: float
    mac: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """How the modes of two sets pair; printed, it is a table that says what has no partner.

    Attributes:
        a: the first set.
        b: the second, the reference.
        pairs: what belongs together, in the order of the second set.
        only_a: modes of the first set without a partner, by index.
        only_b: modes of the second set without one.
        mac: of every mode of the first with every mode of the second, (m_a, m_b); None without common coordinates, NaN
            where a shape is zero or not known.
        coordinates: those over which it was taken.
    """

    a: ModeTable
    b: ModeTable
    pairs: tuple[ModePair, ...]
    only_a: tuple[int, ...]
    only_b: tuple[int, ...]
    mac: Array | None
    coordinates: tuple[str, ...]

    def __repr__(self) -> str:
        """The table: a line per pair, then a line per mode without a partner. Modes are counted from 1."""
        lines = [" a   b     f_a Hz     f_b Hz     df %    z_a %    z_b %    dz pp    MAC"]
        for pair in self.pairs:
            alike = "    –" if pair.mac is None else f"{pair.mac:.3f}"
            (f_a, z_a), (f_b, z_b) = _figures(self.a, pair.index_a), _figures(self.b, pair.index_b)
            lines.append(
                f"{pair.index_a + 1:>3} {pair.index_b + 1:>3} {f_a:>10.4f} {f_b:>10.4f} "
                f"{100 * pair.freq_difference:>+8.3f} {z_a:>8.3f} {z_b:>8.3f} "
                f"{100 * pair.damping_difference:>+8.3f}  {alike}"
            )
        for name, table, alone in (("a", self.a, self.only_a), ("b", self.b, self.only_b)):
            for i in alone:
                freq, damping = _figures(table, i)
                lines.append(f"mode {i + 1} of {name}, {freq:.4f} Hz at {damping:.3f} %, has no partner")
        return "\n".join(lines)


def _figures(table: ModeTable, mode: int) -> tuple[float, float]:
    """Natural frequency in Hz and damping ratio in %."""
    return float(table.natural_freq_hz[mode]), 100 * float(table.damping_ratio[mode])


def compare(a: Any, b: Any, *, max_freq_difference: float = 0.1, least_mac: float | None = None) -> Comparison:
    """Pairs the modes of two sets so that the pairs together differ least; either set may hold what the other lacks.

    The cost of a pair is |λ_a − λ_b| / max(|λ_a|, |λ_b|), which frequency and damping share, as a part of
    `max_freq_difference`, plus (1 − MAC) / 2 if shapes can be compared: those of weakly excited modes are uncertain.
    Two modes are left alone rather than paired at a cost of 1 or more. Of all ways to pair, the one of least total cost
    is taken (the assignment problem, Crouse 2016), so a mode does not take the partner of another one that has no other
    choice. Shapes are compared over the coordinates that both sets name; of motors only, say, where motor encoders were
    measured. Velocities and accelerations are taken for the motion they belong to. Of two `Modes` with the same
    coordinates, the MAC is weighted by the mass matrix of `a`.

    Args:
        a: modes of a model (`Modes`), the result of an identification (with `modes` and `channels`), a `ModeTable`, or
            a list of (natural frequency in Hz, damping ratio) or of objects with `natural_freq_hz` and `damping_ratio`.
        b: the same; the reference, of which differences are counted.
        max_freq_difference: modes whose frequencies differ by a larger share of the higher one are never a pair.
        least_mac: neither are modes whose shapes are less alike, where shapes can be compared.

    Returns:
        Pairs, what has no partner, and the MAC matrix.

    Raises:
        SignalError: something that is no set of modes, no common coordinates although `least_mac` is given, or a limit
            outside 0 to 1.
    """
    if not 0 < max_freq_difference <= 1:
        raise SignalError("max_freq_difference", found=repr(max_freq_difference), expected="a share, above 0 up to 1")
    if not (least_mac is None or 0 <= least_mac <= 1):
        raise SignalError("least_mac", found=repr(least_mac), expected="a number from 0 to 1, or None")
    tables = mode_table(a, "a"), mode_table(b, "b")
    alike, common = _alike(a, b, *tables)
    if alike is None and least_mac is not None:
        raise SignalError(
            "least_mac",
            found=f"{len(common)} common coordinates",
            expected=f"at least {LEAST_COMMON} that both sets name",
            hint=f"The sets name {_names(tables[0])} and {_names(tables[1])}.",
        )
    chosen = _assigned(_costs(*tables, alike, max_freq_difference, least_mac))
    (f_a, f_b), (z_a, z_b) = ([t.natural_freq_hz for t in tables], [t.damping_ratio for t in tables])
    pairs = tuple(
        ModePair(
            index_a=i,
            index_b=j,
            freq_difference=float(f_a[i] / f_b[j] - 1) if f_b[j] > 0 else 0.0,
            damping_difference=float(z_a[i] - z_b[j]),
            mac=None if alike is None or np.isnan(alike[i, j]) else float(alike[i, j]),
        )
        for i, j in sorted(chosen, key=lambda pair: pair[1])
    )
    used_a, used_b = {pair.index_a for pair in pairs}, {pair.index_b for pair in pairs}
    return Comparison(
        a=tables[0],
        b=tables[1],
        pairs=pairs,
        only_a=tuple(i for i in range(len(f_a)) if i not in used_a),
        only_b=tuple(j for j in range(len(f_b)) if j not in used_b),
        mac=alike,
        coordinates=common,
    )


def mode_table(modes: Any, where: str = "modes") -> ModeTable:
    """Poles, shapes and coordinates of any set of modes that `compare` takes.

    Args:
        modes: see `compare`.
        where: its name in an error.

    Raises:
        SignalError: it is no set of modes.
    """
    if isinstance(modes, ModeTable):
        return modes
    if isinstance(modes, Modes):
        return ModeTable(modes.poles, modes.shapes.T, modes.coordinates)
    if hasattr(modes, "modes") and hasattr(modes, "channels"):
        poles = np.array([mode.pole for mode in modes.modes], np.complex128)
        shapes = np.array([mode.shape for mode in modes.modes], np.complex128).reshape(len(poles), len(modes.channels))
        return _of_channels(poles, shapes, [str(getattr(channel, "label", channel)) for channel in modes.channels])
    if isinstance(modes, str) or not isinstance(modes, Sequence):
        raise SignalError(
            where,
            found=f"{type(modes).__name__}",
            expected="Modes, the result of an identification, a ModeTable, or a list of modes",
        )
    return ModeTable(np.array([_pole(mode, f"{where}[{i}]") for i, mode in enumerate(modes)], np.complex128))


def _of_channels(poles: Complex, shapes: Complex, labels: Sequence[str]) -> ModeTable:
    """The table of modes over channels: of each coordinate the first one that tells its motion, as a displacement."""
    columns: dict[str, Complex] = {}
    for column, label in zip(shapes.T, labels, strict=True):
        quantity, colon, name = label.partition(":")
        rate = RATES.get(quantity) if colon else 0
        if rate is not None:
            moving = np.where(poles != 0, poles, 1.0)
            columns.setdefault(name if colon else label, column / moving**rate)
    if not columns:
        return ModeTable(poles)
    return ModeTable(poles, np.column_stack(list(columns.values())), tuple(columns))


def _pole(mode: Any, where: str) -> complex:
    """The pole of a mode that is given by frequency and damping."""
    pair = (getattr(mode, "natural_freq_hz", None), getattr(mode, "damping_ratio", None))
    if None in pair and isinstance(mode, Sequence) and not isinstance(mode, str) and len(mode) == 2:
        pair = (mode[0], mode[1])
    try:
        freq, damping = (float(value) for value in pair)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        freq, damping = np.nan, np.nan
    if not (0 <= freq < np.inf and -1 <= damping <= 1):
        expected = "a natural frequency in Hz, not negative, and a damping ratio as a fraction, from -1 to 1"
        hint = "Damping in percent has to be divided by 100." if 1 < damping < np.inf else None
        raise SignalError(where, found=f"{mode!r:.80}", expected=expected, hint=hint)
    return complex(2 * np.pi * freq * (-damping + 1j * np.sqrt(1 - damping**2)))


def _alike(a: Any, b: Any, table_a: ModeTable, table_b: ModeTable) -> tuple[Array | None, tuple[str, ...]]:
    """MAC of every pair and the coordinates it was taken over."""
    if table_a.shapes is None or table_b.shapes is None or not table_a.coordinates or not table_b.coordinates:
        return None, ()
    common = tuple(name for name in table_a.coordinates if name in set(table_b.coordinates))
    if len(common) < LEAST_COMMON:
        return None, common
    if isinstance(a, Modes) and isinstance(b, Modes) and a.coordinates == b.coordinates:
        return mac(a, b), common
    columns = (
        table.shapes[:, [names.index(name) for name in common]]
        for table, names in ((table_a, table_a.coordinates), (table_b, table_b.coordinates))
        if table.shapes is not None
    )
    return mac_table(*columns), common


def _costs(a: ModeTable, b: ModeTable, alike: Array | None, most: float, least_mac: float | None) -> Array:
    """Cost of every pair, (m_a, m_b), at most 1: what costs that is not paired."""
    size = np.maximum.outer(np.abs(a.poles), np.abs(b.poles))
    apart = np.abs(np.subtract.outer(a.poles, b.poles))
    cost = np.divide(apart, size, out=np.zeros(size.shape), where=size > 0) / most
    detuned = np.abs(np.subtract.outer(np.abs(a.poles), np.abs(b.poles)))
    cost[detuned > most * size] = 1.0
    if alike is not None:
        # A shape that is not known speaks neither for nor against a pair.
        known = np.isfinite(alike)
        cost[known] += SHAPE_WEIGHT * (1.0 - alike[known])
        if least_mac is not None:
            cost[known & (np.where(known, alike, 0.0) < least_mac)] = 1.0
    return np.minimum(cost, 1.0)


def _assigned(cost: Array) -> list[tuple[int, int]]:
    """Pairs of least total cost; leaving one of each set alone costs 1."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(cost)
    return [(i, j) for i, j in zip(rows.tolist(), columns.tolist(), strict=True) if cost[i, j] < 1.0]


def _names(table: ModeTable) -> str:
    names = table.coordinates or ()
    return ", ".join(names[:4]) + (", …" if len(names) > 4 else "") if names else "no coordinates"
