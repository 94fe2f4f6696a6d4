"""A constant wrench on a robot: fixed in the world, or in the axes of the frame that it acts on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import PostureError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]

WrenchAxes = Literal["world", "frame"]
"""Whether a wrench keeps its direction in the world or turns with its frame."""


@dataclass(frozen=True, eq=False)
class Load:
    """What acts on a robot from outside: one wrench at a frame, or nothing.

    Attributes:
        robot: the robot.
        frame: index of the frame at whose origin the wrench acts; None: there is no wrench.
        wrench: force (N) over moment (N m), (6,).
        axes: of the wrench.
    """

    robot: Robot
    frame: int | None
    wrench: Array
    axes: WrenchAxes

    def at(self, q: Array) -> list[tuple[int, list[float]]]:
        """The wrench in world axes at coordinates q, as the core takes it."""
        if self.frame is None:
            return []
        if self.axes == "world":
            return [(self.frame, self.wrench.tolist())]
        turn = self.robot.mechanism.pose(q, self.frame)[:3, :3]
        return [(self.frame, (self.wrench.reshape(2, 3) @ turn.T).ravel().tolist())]

    def turning_stiffness(self, q: Array) -> Array | None:
        """What −∂(Jᵀτ)/∂q has more, (n_all, n_all), because the wrench turns with its frame; None if it does not.

        With τ = R τ_frame and ω_k the turn of the frame per coordinate, ∂τ/∂q_k = ω_k × τ for force and moment.
        """
        if self.frame is None or self.axes == "world":
            return None
        rows = self.robot.mechanism.jacobian(q, self.frame)
        ((_, wrench),) = self.at(q)
        change = np.cross(rows[3:].T[:, None, :], np.reshape(wrench, (1, 2, 3))).reshape(-1, 6)
        return np.asarray(-rows.T @ change.T, np.float64)


def load_of(robot: Robot, wrench: ArrayLike | None, frame: str | None, axes: WrenchAxes) -> Load:
    """The load that a wrench at a frame is.

    Raises:
        PostureError: a wrench without a frame or the other way round, or numbers, frame or axes do not fit.
    """
    if axes not in ("world", "frame"):
        raise PostureError("wrench_axes", found=repr(axes), expected='"world" or "frame"')
    if wrench is None:
        if frame is not None:
            raise PostureError("frame", found=f"{frame!r} without a wrench", expected="both or neither")
        return Load(robot, None, np.zeros(6), axes)
    if frame is None:
        raise PostureError("frame", found="nothing", expected="the frame at which the wrench acts")
    values = numbers("wrench", wrench, (6,), "six finite numbers: force x y z (N), moment x y z (N m)")
    return Load(robot, robot.frame_index(frame), values, axes)


def numbers(where: str, values: ArrayLike, lengths: tuple[int, ...], expected: str) -> Array:
    """A row of finite numbers of one of some lengths.

    Raises:
        PostureError: it is something else.
    """
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.ndim != 1 or array.size not in lengths or not np.isfinite(array).all():
        raise PostureError(where, found=f"{values!r:.60}", expected=expected)
    return array
