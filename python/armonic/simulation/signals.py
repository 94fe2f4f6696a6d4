"""The rows of a run as labelled channels: of joints, motors, frames, forces and energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.series import FREE_FROM, ROBOT_FILE, Channel, TimeSeries

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from armonic.robot import Robot
    from armonic.series import Quantity
    from armonic.simulation.assembly import Assembly
    from armonic.simulation.excitations import Excitation, Waveform

    Array: TypeAlias = NDArray[np.float64]

ENERGIES = ("kinetic", "potential", "work of forces", "work of motors", "dissipated")
"""Channels of energy: the first two are held, the others summed up from the start."""
WORLD = ("x0", "y0", "z0")


class Columns:
    """Channels as they come, and the time series of all of them."""

    def __init__(self) -> None:
        self._values: list[Array] = []
        self._channels: list[Channel] = []

    def add(self, values: Array, quantity: Quantity, names: Sequence[str], units: Sequence[str]) -> None:
        """Channels of one quantity: values (samples, k), and a name and unit for each of the k."""
        self._values.append(values)
        self._channels.extend(Channel(name, quantity, unit) for name, unit in zip(names, units, strict=True))

    def series(self, sample_rate_hz: float, notes: Mapping[str, str]) -> TimeSeries:
        """All of them, (samples, channels)."""
        return TimeSeries(np.hstack(self._values), sample_rate_hz, tuple(self._channels), notes=notes)


def signals(assembly: Assembly, rows: Array, sample_rate_hz: float, frames: Sequence[str]) -> TimeSeries:
    """Every channel of a run.

    Args:
        assembly: what was run.
        rows: of the core, (samples, numbers).
        sample_rate_hz: samples per second.
        frames: whose motion is wanted: displacement from the start, velocity and acceleration of their origins in
            world axes (Do et al. 2022, Eq. A.4).
    """
    n, nm, z = len(assembly.moving), len(assembly.loop), assembly.bodies
    acting = assembly.constant + len(assembly.excitations)
    ends = np.cumsum([z, z, z, n, nm, nm, acting])
    position, velocity, acceleration, spring, shaft, torque, force, energy = np.split(rows, ends, axis=1)
    reference = np.concatenate([assembly.q[assembly.moving], assembly.rest.motor_position])
    position = position + reference
    units = units_of(assembly.robot, assembly.moving)
    columns = Columns()
    add = columns.add
    links, motors = assembly.names[:n], assembly.names[n:]
    add(position[:, n:], "motor_position", motors, ["rad"] * nm)
    add(position[:, :n], "joint_position", links, units)
    add(velocity[:, n:], "motor_velocity", motors, ["rad/s"] * nm)
    add(velocity[:, :n], "joint_velocity", links, [f"{u}/s" for u in units])
    add(acceleration[:, :n], "joint_acceleration", links, [f"{u}/s²" for u in units])
    add(torque, "motor_torque", motors, ["N m"] * nm)
    springs = [i for i in range(n) if assembly.joints.springs[i, 0] > 0]
    turning = {"rad": "N m", "m": "N"}
    add(spring[:, springs], "shaft_torque", [links[i] for i in springs], [turning[units[i]] for i in springs])
    add(shaft, "shaft_torque", motors, ["N m"] * nm)
    for name in frames:
        names = [f"{name}.{axis}" for axis in WORLD]
        displacement, speed, change = _motion(assembly, name, position, velocity, acceleration)
        add(displacement, "displacement", names, ["m"] * 3)
        add(speed, "velocity", names, ["m/s"] * 3)
        add(change, "acceleration", names, ["m/s²"] * 3)
    names = force_names(assembly.robot, assembly.excitations)
    add(force[:, assembly.constant :], "force", names, [e.unit for e in assembly.excitations])
    add(energy, "energy", ENERGIES, ["J"] * len(ENERGIES))
    notes = notes_of(assembly.robot, assembly.label, assembly.q, assembly.excitations, (len(rows) - 1) / sample_rate_hz)
    return columns.series(sample_rate_hz, notes)


def notes_of(
    robot: Robot, label: str, q: Array, excitations: Sequence[Excitation], duration_s: float
) -> dict[str, str]:
    """What a series says of where it comes from: enough to compute the robot's modes again, and when it was left alone.

    A pulse may lie between two samples, so that the forces among the channels do not tell.
    """
    coordinates = ", ".join(repr(float(value)) for value in q)
    notes = {"robot": robot.name, "posture": label, "coordinates": coordinates, ROBOT_FILE: robot.to_yaml()}
    ends = [_last_change(excitation.waveform(duration_s)) for excitation in excitations]
    return notes | ({FREE_FROM: repr(max(ends))} if ends and max(ends) < duration_s else {})


def _last_change(waveform: Waveform) -> float:
    """When a force is over, or no longer changes, s."""
    kind, numbers, samples = waveform
    if kind == "samples":
        return numbers[0] + numbers[1] * (len(samples) - 1)
    return numbers[0] if kind == "constant" and numbers[1] == np.inf else numbers[1]


def units_of(robot: Robot, moving: NDArray[np.intp]) -> list[str]:
    """The unit of each moving coordinate."""
    kinds = [kind for kind in robot.tree.kinds if kind != "fixed"]
    return ["m" if kinds[i] == "prismatic" else "rad" for i in moving]


def _motion(assembly: Assembly, frame: str, *moving: Array) -> tuple[Array, Array, Array]:
    """Displacement from the start, velocity and acceleration of a frame's origin in world axes, (samples, 3) each."""
    n, samples = len(assembly.moving), len(moving[0])
    q, qd, qdd = (np.zeros((samples, len(assembly.q))) for _ in range(3))
    q[:] = assembly.q
    for whole, part in zip((q, qd, qdd), moving, strict=True):
        whole[:, assembly.moving] = part[:, :n]
    mechanism, index = assembly.robot.mechanism, assembly.robot.frame_index(frame)
    place = mechanism.pose(q, index)[:, :3, 3]
    motion = mechanism.frame_motion(q, qd, qdd, index)
    return place - place[0], motion[:, 0, :3], motion[:, 1, :3]


def force_names(robot: Robot, excitations: Sequence[Excitation]) -> list[str]:
    """Frame and axis of each excitation; a number behind where two are the same."""
    names: list[str] = []
    for excitation in excitations:
        name = f"{excitation.frame_on(robot)}.{excitation.axis}"
        count = sum(other.split(" ")[0] == name for other in names)
        names.append(name if not count else f"{name} {count + 1}")
    return names
