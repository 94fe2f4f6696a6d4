"""Stiffness that depends on the posture or on the load: what one set of parameters cannot say."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import UpdateError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from armonic.linear import LinearModel
    from armonic.robot import Robot
    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """k(ξ) = k0 + k1 ξ over the measured postures, with ξ a joint coordinate or the load of the joint.

    k0 is the number of the description; k1, the slope, is one parameter more. The stiffness must stay positive in every
    measured posture.

    Attributes:
        over: name of a coordinate ("arm.z"), or "torque": the size of the static torque (N m) or force (N) that gravity
            puts on the joint itself, so that a positive slope is a joint that hardens under load.
        slope: k1 to start from, in the unit of the number per rad, m, N m or N.
    """

    over: str
    slope: float = 0.0

    def variable(self, robot: Robot, q: Array, path: str) -> float:
        """ξ of a number in a posture, given all link coordinates q (n,)."""
        if self.over == "torque":
            words = path.split(".")  # links.L.elasticity.A.stiffness
            coordinate = robot.coordinates.index(f"{words[1]}.{words[3]}")
            return float(abs(robot.mechanism.gravity_torque(q)[coordinate]))
        return float(q[robot.coordinates.index(self.over)])


def slopes(robot: Robot, chosen: list[Parameter], laws: Mapping[str, Law]) -> list[Parameter]:
    """The slopes of laws as parameters; the numbers they belong to are marked in `chosen`.

    Raises:
        UpdateError: a law of what is no fitted elasticity, over an unknown coordinate, or two laws of one number.
    """
    from dataclasses import replace

    from armonic.updating.parameters import Parameter, numbers_of

    found: list[Parameter] = []
    for pattern, law in laws.items():
        if not isinstance(law, Law):
            raise UpdateError(f"law of {pattern}", found=repr(law), expected='a Law, as Law(over="arm.z")')
        if not isinstance(law.slope, Real) or not np.isfinite(law.slope):
            raise UpdateError(f"law of {pattern}", found=f"a slope of {law.slope!r}", expected="a finite number")
        if law.over != "torque" and law.over not in robot.coordinates:
            raise UpdateError(
                f"law of {pattern}", found=repr(law.over), expected=f'"torque" or one of {", ".join(robot.coordinates)}'
            )
        for path in numbers_of(robot, pattern, "laws"):
            place = next((i for i, p in enumerate(chosen) if path in p.paths), None)
            if place is None or not path.startswith("links.") or not chosen[place].indices:
                raise UpdateError(
                    f"law of {path}", found="a number that is not fitted, or no elasticity", expected="one that is"
                )
            base = chosen[place]
            if base.law is not None:
                raise UpdateError(f"law of {path}", found="a second one", expected="one law per number")
            chosen[place] = replace(base, law=law)
            unit = "N m" if law.over == "torque" else robot_unit(robot, law.over)
            # Within this reach the number changes by its own size over a radian, a metre, or its load at rest.
            scale = _reach(robot, law, path)
            size, limit = base.start / scale, 10 * base.upper / scale
            if abs(law.slope) > limit:
                raise UpdateError(
                    f"law of {path}", found=f"a slope of {law.slope:g}", expected=f"one within {limit:g} either way"
                )
            if law.over == "torque" and len(base.paths) > 1:
                raise UpdateError(
                    f"law of {path}",
                    found="a number that is tied, over a torque that every joint has its own of",
                    expected="a law over a coordinate, or a number that is not tied",
                )
            found.append(
                Parameter(
                    f"{base.path} per {law.over}",
                    (),
                    f"{base.unit} per {unit}",
                    law.slope,
                    -limit,
                    limit,
                    "linear",
                    size,
                    law=law,
                )
            )
    return found


def robot_unit(robot: Robot, coordinate: str) -> str:
    """Rad or m."""
    kinds = [kind for kind in robot.tree.kinds if kind != "fixed"]
    return "rad" if kinds[robot.coordinates.index(coordinate)] == "revolute" else "m"


def _reach(robot: Robot, law: Law, path: str) -> float:
    """The size of ξ over the robot's postures, or one."""
    postures = list(robot.postures.values()) or [np.zeros(len(robot.coordinates))]
    return max((abs(law.variable(robot, np.asarray(q), path)) for q in postures), default=0.0) or 1.0


def values_in(parameters: Sequence[Parameter], values: Array, model: LinearModel) -> tuple[Array, Array]:
    """The numbers of a posture under their laws, and how they follow from the parameters.

    Args:
        parameters: those of a fit, c of them.
        values: theirs, (c,).
        model: the posture.

    Returns:
        Values (c,) in this posture, of the slopes zero; derivatives of their logarithms by x (c, c), a row of zeros for
        each slope.

    Raises:
        ArithmeticError: a number is not positive there.
    """
    here, chain = values.copy(), np.eye(len(values))
    slope_of = {p.path: i for i, p in enumerate(parameters) if p.law is not None and not p.paths}
    for i, p in enumerate(parameters):
        if p.law is None or not p.paths:
            continue
        j = slope_of[f"{p.path} per {p.law.over}"]
        variable = p.law.variable(model.robot, model.q, p.path)
        here[i] = values[i] + values[j] * variable
        if not here[i] > 0:
            raise ArithmeticError(f"{p.path} is {here[i]:g} in posture {model.posture}")
        chain[i, i] = values[i] / here[i]
        chain[i, j] = variable * parameters[j].size / here[i]
    for j in slope_of.values():
        here[j], chain[j, j] = 0.0, 0.0
    return here, chain
