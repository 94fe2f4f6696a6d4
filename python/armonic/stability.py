"""How far the gains of each drive are from making the closed loop unstable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.linear import Equilibrium, LinearModel, model_of
from armonic.loads import WrenchAxes
from armonic.modal import STABILITY_TOLERANCE, modes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

FACTORS = np.logspace(0.0, 6.0, 49)
"""Factors on the gains that are looked at, and their inverses: eight per decade."""
BATCH_BYTES = 2**25
"""State matrices that are solved at once take no more memory than that."""


@dataclass(frozen=True)
class GainMargin:
    """By which factors one drive's gains, all of them together, may be multiplied until the loop turns unstable.

    Attributes:
        motor: name of the drive's motor.
        upper: the first factor above one at which motion grows; infinite if there is none below 1e6, NaN if the loop is
            unstable as it is.
        lower: the first factor below one; zero if there is none above 1e-6, NaN likewise.
        freq_hz: frequency of the motion that starts to grow at `upper`, or at `lower` if only that is there; 0 Hz is a
            fall without oscillation, NaN where there is neither.
    """

    motor: str
    upper: float
    lower: float
    freq_hz: float


def gain_margins(
    robot: Robot | LinearModel,
    posture: Posture | None = None,
    *,
    wrench: ArrayLike | None = None,
    frame: str | None = None,
    wrench_axes: WrenchAxes = "world",
    equilibrium: Equilibrium = "reference",
) -> tuple[GainMargin, ...]:
    """The gain margin of every drive, with the gains of the others as they are.

    Position, velocity and integral gains of the motor and of the link side and the drive's row of the state feedback
    are multiplied by one factor. The largest real part of the poles is sampled at eight factors per decade, and where
    it changes sign the factor is found by bracketing; a band of instability narrower than that is not seen. The
    operating point stays what it is with the gains of the file.

    Args:
        robot: a robot, or a linear model that is taken as it is.
        posture: as in `modes`.
        wrench: as in `linearize`.
        frame: as in `linearize`.
        wrench_axes: as in `linearize`.
        equilibrium: as in `linearize`.

    Returns:
        One margin per drive, in their order; none for a robot without drives.

    Raises:
        PostureError: posture, wrench or frame do not fit the robot, or come with a linear model.
        ModelError: no positive definite mass matrix, no equilibrium, or every coordinate locked.
    """
    model = model_of(robot, posture, wrench=wrench, frame=frame, wrench_axes=wrench_axes, equilibrium=equilibrium)
    names, n, loop = model.drives.names, len(model.coordinates), model.loop
    if not names:
        return ()
    if modes(model).stability == "unstable":
        return tuple(GainMargin(motor, np.nan, np.nan, np.nan) for motor in names)
    A = model.state_matrix()
    # What seems to grow in a loop that is not unstable is rounding; a rigid body has a double pole, where it is large.
    found = np.linalg.eigvals(A)
    share = max(STABILITY_TOLERANCE, 10 * float(found.real.max()) / float(np.abs(found).max()))
    margins = []
    for i, motor in enumerate(names):
        # The drive's feedback is one row of A, for nothing but the motor's own inertia stands between.
        feedback = np.zeros(len(A))
        feedback[:n], feedback[n : 2 * n] = loop.position[i], loop.velocity[i]
        feedback[2 * n :] = loop.integrating == i
        margins.append(_margin(motor, A, n + model.links + i, -feedback / model.drives.inertia[i], share))
    return tuple(margins)


def _margin(motor: str, A: Array, row: int, feedback: Array, share: float) -> GainMargin:
    """The margin of a loop with state matrix A whose row `row` holds `feedback`."""
    upper, upper_hz = _limit(A, row, feedback, FACTORS, share)
    lower, lower_hz = _limit(A, row, feedback, 1.0 / FACTORS, share)
    return GainMargin(motor, upper, 0.0 if np.isinf(lower) else lower, lower_hz if np.isinf(upper) else upper_hz)


def _limit(A: Array, row: int, feedback: Array, factors: Array, share: float) -> tuple[float, float]:
    """First of the factors from one on at which the loop is unstable, and the frequency in Hz of what grows there.

    Infinity and NaN if there is none. Real parts below `share` of the largest pole are rounding.
    """
    from scipy.optimize import brentq

    def poles(some: Array) -> Complex:
        matrices = np.repeat(A[None], len(some), axis=0)
        matrices[:, row] += (some - 1.0)[:, None] * feedback
        return np.asarray(np.linalg.eigvals(matrices), np.complex128)

    growth, rounding = np.zeros(len(factors)), np.zeros(len(factors))
    count = max(1, BATCH_BYTES // A.nbytes)
    for start in range(0, len(factors), count):
        part = slice(start, start + count)
        found = poles(factors[part])
        growth[part], rounding[part] = found.real.max(axis=1), share * np.abs(found).max(axis=1)
    unstable = growth > rounding
    unstable[0] = False
    if not unstable.any():
        return np.inf, np.nan
    first = int(np.argmax(unstable))
    before, after = np.log(factors[[first - 1, first]]).tolist()
    # A loop that is marginal before has no sign to change; there it counts when growth is more than rounding.
    level = share if growth[first - 1] >= 0 else 0.0

    def above(logarithm: float) -> float:
        found = poles(np.exp([logarithm]))
        return float(found.real.max() - level * np.abs(found).max())

    factor = float(np.exp(brentq(above, before, after, xtol=1e-13, rtol=1e-14)))
    critical = poles(np.array([factor]))[0]
    return factor, float(np.abs(critical[np.argmax(critical.real)].imag) / (2 * np.pi))
