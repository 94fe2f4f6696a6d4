"""Springs that soften the farther they swing, by a share at a stated amplitude."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from armonic.errors import SimulationError
from armonic.simulation.joints import Hardening

if TYPE_CHECKING:
    from armonic.robot import Robot


def softening_laws(robot: Robot, amplitude: Mapping[str, float], share: float) -> tuple[Hardening, ...]:
    """Cubic terms by which every spring is softer by a share when it swings at its amplitude.

    The harmonic part of k x + c x³ under x = X cos ωt is (k + ¾ c X²) X (describing function: Nayfeh and Mook 1979,
    section 4.1), so that c = −(4/3) share k / X². Frequencies of small motions stay those of the linear robot.

    Args:
        robot: the robot. Its drives stay linear: their shafts carry gravity, at which a cubic spring would be softer
            already at rest.
        amplitude: X by coordinate, rad or m; coordinates that do not move keep their spring.
        share: 0.02 for 2 %.

    Raises:
        SimulationError: no spring could soften.
    """
    if not share:
        return ()
    driven = {robot.coordinates[i] for i in robot.drives.coordinates.tolist()}
    stiffness = dict(zip(robot.coordinates, robot.stiffness.tolist(), strict=True))
    springs = [name for name, k in stiffness.items() if k > 0 and name not in driven and amplitude.get(name, 0.0) > 0]
    if not springs:
        raise SimulationError(
            "softening",
            found=f"{robot.name}, where no spring stands beside the drives",
            expected="a robot whose joints have an `elasticity`",
            hint="Give laws of single joints with joints=, such as Hardening or Backlash.",
        )
    cubic = {name: -4 / 3 * share * stiffness[name] / np.square(amplitude[name]) for name in springs}
    return tuple(Hardening(joint=name, cubic=float(c)) for name, c in cubic.items())
