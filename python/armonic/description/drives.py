"""Drives and control as arrays, one row per motor; the motors in the order of the links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armonic.description.actuation import GAINS, ControlEntry
from armonic.description.names import motor_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.description.schema import Link

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Drives:
    """Motors behind flexible shafts (Do, Vu, Liu 2022, Appendix A), SI; motor angles are those after the gear.

    Attributes:
        names: of the nm motors, "link.motor".
        coordinates: (nm,) index of the coordinate that each motor drives.
        scale: (nm,) w, rad of the shaft for one m or rad of the coordinate: 1/radius, or 1 for a revolute joint.
        shaft_stiffness: (nm,) k, N m/rad.
        gear_ratio: (nm,) N, turns of the rotor for one after the gear.
        inertia: (nm,) B = N² I, kg m²: rotors as felt after the gear (Eq. A.12).
        motor_damping: (nm,) N m s/rad, on the motor's side.
        joint_damping: (nm,) N m s/rad or N s/m, on the link's side.
    """

    names: tuple[str, ...]
    coordinates: NDArray[np.intp]
    scale: Array
    shaft_stiffness: Array
    gear_ratio: Array
    inertia: Array
    motor_damping: Array
    joint_damping: Array


@dataclass(frozen=True, eq=False)
class Control:
    """The control law of nm motors (Do, Vu, Liu 2022, Eq. 2, with further gains), SI, torques after the gear.

    Torque of a motor, with w of its drive, e = w (q_d - q) on the link's side and e_m = q_m,d - q_m on its own:
    feedforward + kp e_m + ki ∫e_m - kd q_m' + link_kp e + link_ki ∫e - link_kd w q'
    - position [q - q_d; q_m - q_m,d] - velocity [q'; q_m'].

    Attributes:
        kp: (nm,) N m/rad, on the motor's position; `ki` N m/(rad s) on its integral, `kd` N m s/rad on its velocity.
        ki: (nm,).
        kd: (nm,).
        link_kp: (nm,) likewise on the link's side.
        link_ki: (nm,).
        link_kd: (nm,).
        position: (nm, 2 nm) feedback of the driven coordinates, then of the motors; N m/m or N m/rad.
        velocity: (nm, 2 nm), N m s/m or N m s/rad.
        feedforward: whether the motors carry gravity and wrench of the desired posture.
    """

    kp: Array
    ki: Array
    kd: Array
    link_kp: Array
    link_ki: Array
    link_kd: Array
    position: Array
    velocity: Array
    feedforward: bool


def compile_drives(links: Sequence[Link], coordinates: Sequence[str]) -> Drives:
    """The drives of links, none of them or some having one.

    Args:
        links: in tree order.
        coordinates: the names of all coordinates.
    """
    pairs = [(link, link.drive) for link in links if link.drive is not None]
    indices = np.array([coordinates.index(f"{link.name}.{link.joint.own}") for link, _ in pairs], dtype=np.intp)
    indices.setflags(write=False)
    return Drives(
        names=tuple(motor_names(links)),
        coordinates=indices,
        scale=frozen([1.0 if drive.radius is None else 1.0 / drive.radius for _, drive in pairs]),
        shaft_stiffness=frozen([drive.shaft_stiffness for _, drive in pairs]),
        gear_ratio=frozen([drive.gear_ratio for _, drive in pairs]),
        inertia=frozen([drive.gear_ratio**2 * drive.rotor_inertia for _, drive in pairs]),
        motor_damping=frozen([drive.motor_damping for _, drive in pairs]),
        joint_damping=frozen([drive.joint_damping for _, drive in pairs]),
    )


def compile_control(entry: ControlEntry | None, count: int) -> Control:
    """The gains of `count` motors, each written out; zeros where the file has no control."""
    given = ControlEntry() if entry is None else entry
    feedback = given.state_feedback
    gains = {name: frozen(np.broadcast_to(getattr(given, name), (count,))) for name in GAINS}
    shape = (count, 2 * count)
    return Control(
        **gains,
        position=frozen(feedback.position or np.zeros(shape)),
        velocity=frozen(feedback.velocity or np.zeros(shape)),
        feedforward=given.feedforward,
    )


def frozen(values: object) -> Array:
    """A new read-only array of floats."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
