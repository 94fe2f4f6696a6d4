"""What drives and their control add to a linear model: Do, Vu, Liu 2022 in explicit form, and as one impedance each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.description.drives import Control, Drives
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Motors behind flexible shafts, under control, on some of a model's coordinates.

    With z = [q; q_m] and deviations from the desired state, the motor torques are τ_m = ff − P δz − V ż − I ∫δz.

    Attributes:
        drives: the nm drives, arrays (nm,).
        control: their gains.
        driven: index of each drive's coordinate among the model's n link coordinates, (nm,).
        links: n.
    """

    drives: Drives
    control: Control
    driven: NDArray[np.intp]
    links: int

    @classmethod
    def of(cls, robot: Robot, keep: NDArray[np.intp]) -> ClosedLoop:
        """The loop of a robot whose link coordinates `keep` stay in the model; every driven one is among them."""
        return cls(robot.drives, robot.control, np.searchsorted(keep, robot.drives.coordinates), len(keep))

    def __len__(self) -> int:
        """Number of drives, nm."""
        return len(self.drives.names)

    @property
    def motors(self) -> NDArray[np.intp]:
        """Index of each motor among all coordinates of the explicit form, (nm,)."""
        return self.links + np.arange(len(self))

    @cached_property
    def position(self) -> Array:
        """P, (nm, N): torque taken off per deviation of a coordinate."""
        return self._law(self.control.kp, self.control.link_kp, self.control.position)

    @cached_property
    def velocity(self) -> Array:
        """V, (nm, N): torque taken off per velocity."""
        return self._law(self.control.kd, self.control.link_kd, self.control.velocity)

    @cached_property
    def integral(self) -> Array:
        """I, (nm, N): torque taken off per integral of a deviation."""
        return self._law(self.control.ki, self.control.link_ki, np.zeros((len(self), 2 * len(self))))

    def _law(self, own: Array, link: Array, matrix: Array) -> Array:
        rows = np.zeros((len(self), self.links + len(self)))
        rows[:, self.driven] = np.diag(self.drives.scale * link) + matrix[:, : len(self)]
        rows[:, self.motors] = np.diag(own) + matrix[:, len(self) :]
        return rows

    @cached_property
    def integrating(self) -> NDArray[np.intp]:
        """The drives whose control integrates; each has one integrator, whose state is its torque I ∫δz."""
        return np.flatnonzero(self.integral.any(axis=1))

    @property
    def local(self) -> bool:
        """Whether every motor listens to its own joint only: each drive then is one impedance on its coordinate."""
        own = np.zeros(self.position.shape, np.bool_)
        own[np.arange(len(self)), self.driven] = own[np.arange(len(self)), self.motors] = True
        return not (self.position[~own].any() or self.velocity[~own].any())

    def explicit(self, mass: Array, damping: Array, stiffness: Array) -> tuple[Array, Array, Array]:
        """M̄, D̄, K̄ of Do et al. 2022, Eqs. 9 to 11, (N, N) each, from those of the links, (n, n).

        The link side of the control and the state feedback stand in the rows of the motors, beside K_P and K_D.
        """
        if not len(self):
            return mass, damping, stiffness
        d, c, m = self.drives, self.driven, self.motors
        explicit = [np.zeros((m[-1] + 1, m[-1] + 1)) for _ in range(3)]
        for whole, part in zip(explicit, (mass, damping, stiffness), strict=True):
            whole[: self.links, : self.links] = part
        big_mass, big_damping, big_stiffness = explicit
        big_mass[m, m] = d.inertia
        big_damping[c, c] += d.joint_damping
        big_damping[m, m] = d.motor_damping
        big_damping[m] += self.velocity
        big_stiffness[np.ix_(np.r_[c, m], np.r_[c, m])] += self.shafts()
        big_stiffness[m] += self.position
        return big_mass, big_damping, big_stiffness

    def widened(self, rows: Array) -> Array:
        """Rows over the link coordinates, (r, n), with zeros for the motors, (r, N)."""
        return np.hstack([rows, np.zeros((len(rows), len(self)))]) if len(self) else rows

    def shafts(self) -> Array:
        """Stiffness of the shafts over driven coordinates and motors, [[K W², −K W], [−K W, K]], (2 nm, 2 nm)."""
        k, w = self.drives.shaft_stiffness, self.drives.scale
        return np.block([[np.diag(w**2 * k), -np.diag(w * k)], [-np.diag(w * k), np.diag(k)]])

    def impedances(self) -> Array:
        """A row per drive of what its impedance is made of, (nm, 9), if the loop is local.

        −w k t(s) is added to the coordinate, t(s) = (w k − c_l(s)) / Δ(s) the motor's turn per unit of it, with
        Δ(s) = B s² + (D_m + K_D) s + k + K_P + K_I / s and c_l(s) the feedback of the link side. The columns are w, k,
        B, D_m + K_D, k + K_P, K_I, then c_l's position, velocity and integral gain.
        """
        d, rows = self.drives, np.arange(len(self))
        own = [law[rows, self.motors] for law in (self.velocity, self.position, self.integral)]
        link = [law[rows, self.driven] for law in (self.position, self.velocity, self.integral)]
        columns = [d.scale, d.shaft_stiffness, d.inertia, d.motor_damping + own[0], d.shaft_stiffness + own[1], own[2]]
        return np.array([*columns, *link]).T
