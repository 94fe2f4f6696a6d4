"""Joints that are not linear: hardening springs, backlash and dry friction, by joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

import numpy as np

from armonic.errors import SimulationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class JointLaw:
    """Something in some joints beside their linear springs and dampers.

    Attributes:
        joint: a coordinate ("link_2.z") or link ("link_2"), or a shell pattern over these. The shaft of a driven
            coordinate is what is meant, the spring of any other.
    """

    joint: str

    name: ClassVar[str] = "joint law"

    def __post_init__(self) -> None:
        self._check()

    def _check(self) -> None:
        """Refuse numbers that make no such law."""


@dataclass(frozen=True, kw_only=True)
class Hardening(JointLaw):
    """A spring whose torque is k x + c x³.

    Attributes:
        cubic: c, N m/rad³ or N/m³; negative for a spring that softens.
    """

    cubic: float

    name: ClassVar[str] = "Hardening"

    def _check(self) -> None:
        _number(self, "cubic", self.cubic)


@dataclass(frozen=True, kw_only=True)
class Backlash(JointLaw):
    """Free play before the spring takes hold.

    Attributes:
        gap: from stop to stop, rad at the shaft or m.
    """

    gap: float

    name: ClassVar[str] = "Backlash"

    def _check(self) -> None:
        _number(self, "gap", self.gap, least=0.0)


@dataclass(frozen=True, kw_only=True)
class Coulomb(JointLaw):
    """Dry friction c tanh(v / v₀); the rounding at rest keeps the equations smooth.

    Attributes:
        torque: c, N m or N.
        at: on the side of the "joint" or of the "motor" (behind the gear).
        speed: v₀, rad/s or m/s, small against the speeds of interest.
    """

    torque: float
    at: Literal["joint", "motor"] = "joint"
    speed: float = 1e-3

    name: ClassVar[str] = "Coulomb"

    def _check(self) -> None:
        _number(self, "torque", self.torque, least=0.0)
        _number(self, "speed", self.speed, above=0.0)
        if self.at not in ("joint", "motor"):
            raise SimulationError("Coulomb.at", found=repr(self.at), expected='"joint" or "motor"')


@dataclass(frozen=True, eq=False)
class JointTables:
    """Springs and drags as the core takes them.

    Attributes:
        springs: stiffness, cubic term and gap per moving coordinate, (n, 3).
        drags: damping, dry friction and its speed per moving coordinate, (n, 3).
        shafts: as springs, per motor, (nm, 3).
        motor_drags: as drags, per motor, (nm, 3).
    """

    springs: Array
    drags: Array
    shafts: Array
    motor_drags: Array

    @property
    def linear(self) -> bool:
        """Whether every joint is a linear spring and damper."""
        springs, drags = np.vstack([self.springs, self.shafts]), np.vstack([self.drags, self.motor_drags])
        return not (springs[:, 1:].any() or drags[:, 1].any())


def joint_tables(robot: Robot, moving: NDArray[np.intp], laws: Sequence[JointLaw]) -> JointTables:
    """The springs and drags of a robot's moving coordinates and motors.

    Raises:
        SimulationError: a law names no joint, one without a spring or motor, or one twice.
    """
    drives, n = robot.drives, len(moving)
    springs, drags = np.zeros((n, 3)), np.zeros((n, 3))
    springs[:, 0], drags[:, 0] = robot.stiffness[moving], robot.damping[moving]
    driven = np.searchsorted(moving, drives.coordinates)
    drags[driven, 0] += drives.joint_damping
    shafts, motor_drags = np.zeros((len(driven), 3)), np.zeros((len(driven), 3))
    shafts[:, 0], motor_drags[:, 0] = drives.shaft_stiffness, drives.motor_damping
    drags[:, 2] = motor_drags[:, 2] = 1.0
    tables = JointTables(springs, drags, shafts, motor_drags)
    motor_of = {int(i): j for j, i in enumerate(driven)}
    seen: set[tuple[str, int]] = set()
    for law in laws:
        if not isinstance(law, JointLaw):
            raise SimulationError("joints", found=repr(law), expected="Hardening, Backlash or Coulomb")
        for i in _matching(robot, moving, law):
            kind = law.name + (law.at if isinstance(law, Coulomb) else "")
            if (kind, i) in seen:
                where = f"{law.name} {law.joint}"
                raise SimulationError(where, found=f"{robot.coordinates[moving[i]]} twice", expected="each joint once")
            seen.add((kind, i))
            _put(tables, law, i, motor_of.get(i), robot.coordinates[moving[i]])
    return tables


def _put(tables: JointTables, law: JointLaw, i: int, motor: int | None, coordinate: str) -> None:
    if isinstance(law, Coulomb):
        if law.at == "motor" and motor is None:
            raise SimulationError("Coulomb", found=f"{coordinate}, which no motor drives", expected="a driven joint")
        row = tables.drags[i] if law.at == "joint" else tables.motor_drags[motor]
        row[1:] = law.torque, law.speed
        return
    row = tables.springs[i] if motor is None else tables.shafts[motor]
    if row[0] == 0:
        raise SimulationError(law.name, found=f"{coordinate}, which has no spring", expected="a joint with a spring")
    if isinstance(law, Hardening):
        row[1] = law.cubic
    elif isinstance(law, Backlash):
        row[2] = law.gap


def _matching(robot: Robot, moving: NDArray[np.intp], law: JointLaw) -> list[int]:
    names = [robot.coordinates[i] for i in moving]
    found = [i for i, name in enumerate(names) if fnmatchcase(name, law.joint)]
    found = found or [i for i, name in enumerate(names) if fnmatchcase(name.rsplit(".", 1)[0], law.joint)]
    if not found:
        raise SimulationError(f"{law.name}.joint", found=repr(law.joint), expected=f"one of {', '.join(names)}")
    return found


def _number(law: JointLaw, name: str, value: float, *, least: float | None = None, above: float | None = None) -> None:
    fits = isinstance(value, int | float | np.number) and math.isfinite(value)
    if fits and (least is None or value >= least) and (above is None or value > above):
        return
    bound = f" above {above:g}" if above is not None else f" of at least {least:g}" if least is not None else ""
    raise SimulationError(f"{law.name}.{name}", found=repr(value), expected=f"a finite number{bound}")
