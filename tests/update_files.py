"""Files for the tests of `armonic update`: responses without noise, and robots that are off."""

from __future__ import annotations

import numpy as np

import armonic as am

STIFFNESS, DAMPING = "links.arm.elasticity.z.stiffness", "links.arm.elasticity.z.damping"
PATTERN = "links.arm.elasticity.z.*"  # the two parameters that the example determines best
LINES = np.arange(1, 76) * 0.4
EXACT = 1e-6
"""Without noise the minimum is the truth; the solver stops at 1e-10 of the cost."""


def measure(robot: am.Robot, name: str, posture: str | list[float] = "milling", freq_hz: np.ndarray = LINES) -> am.Frf:
    """Responses of a robot without noise, in a CSV file."""
    frf = am.frf(robot, posture, freq_hz, frame="sensor")
    am.write_frf(name, frf)
    return frf


def off(robot: am.Robot, pattern: str, factor: float = 1.3) -> str:
    """The file of a robot whose numbers are off by a factor."""
    robot.with_values({path: factor * value for path, value in robot.parameters(pattern).items()}).save("off.yaml")
    return "off.yaml"


def fitted(path: str = "new.yaml", pattern: str = PATTERN) -> dict[str, float]:
    return am.load(path).parameters(pattern)
