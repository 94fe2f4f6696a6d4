"""The response of the linearized closed loop to the same excitations, without an error of integration."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SimulationError
from armonic.linear import linearize
from armonic.series import TimeSeries
from armonic.simulation.assembly import set_in_motion
from armonic.simulation.excitations import Excitation
from armonic.simulation.running import acting_of, frames_of, samples_of
from armonic.simulation.signals import WORLD, Columns, force_names, notes_of, units_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Equilibrium, LinearModel, Posture
    from armonic.loads import WrenchAxes
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]

MOST_KNOWN = 1000
"""Exponentials that are kept, for lengths that come again."""
LINES_PER_PERIOD = 100
"""Straight lines that stand for a period of a sweep: off by 0.05 % of its amplitude at most."""


@dataclass(frozen=True, eq=False)
class Source:
    """One excitation as a small linear system w' = S w with force w[0], started anew where its formula changes.

    Attributes:
        push: what a unit of it does to the velocities of the coordinates, (N,).
        rate: ω of S = [[0, ω], [−ω, 0]], rad/s; zero for a straight line, S = [[0, 1], [0, 0]].
        pieces: start and end of each piece, s, and w at its start; in order.
    """

    push: Array
    rate: float
    pieces: list[tuple[float, float, Array]]

    def at(self, time_s: float) -> Array:
        """The state w at the start of a piece of the run; zero where no piece of its own begins or goes on."""
        last = bisect_right(self.pieces, time_s + 1e-12, key=lambda piece: piece[0]) - 1
        if last < 0 or time_s >= self.pieces[last][1] - 1e-12:
            return np.zeros(2)
        begin, _, w = self.pieces[last]
        length = time_s - begin
        if not self.rate:
            return np.array([w[0] + w[1] * length, w[1]])
        c, s = np.cos(self.rate * length), np.sin(self.rate * length)
        return np.array([c * w[0] + s * w[1], c * w[1] - s * w[0]])

    @property
    def generator(self) -> Array:
        """S, (2, 2)."""
        return np.array([[0.0, self.rate], [-self.rate, 0.0]] if self.rate else [[0.0, 1.0], [0.0, 0.0]])


def linear_response(
    robot: Robot,
    posture: Posture,
    excitations: Excitation | Sequence[Excitation] = (),
    *,
    duration_s: float,
    sample_rate_hz: float = 1000.0,
    frames: Sequence[str] | None = None,
    displacement: Mapping[str, float] | None = None,
    velocity: Mapping[str, float] | None = None,
    wrench: ArrayLike | None = None,
    frame: str | None = None,
    wrench_axes: WrenchAxes = "world",
    equilibrium: Equilibrium = "reference",
) -> TimeSeries:
    """What the model linearized at the posture does (Do et al. 2022, Eqs. 8 and 14), by matrix exponentials.

    Constant, straight and sinusoidal forces are solved exactly; a sweep is taken as a hundred straight lines a period.

    Args:
        robot: as in `simulate`, with all that follows.
        posture: where the robot is linearized.
        excitations: what acts; directions that turn with a frame are those of the posture.
        duration_s: length of the run.
        sample_rate_hz: samples per second.
        frames: whose motion is wanted.
        displacement: by coordinate or motor, at the start.
        velocity: by coordinate or motor, at the start.
        wrench: constant, as in `linearize`.
        frame: where it acts.
        wrench_axes: as in `linearize`.
        equilibrium: as in `linearize`.

    Returns:
        Positions and velocities of joints and motors (deviations added to the posture), motion of frames, forces.

    Raises:
        PostureError: posture, frame or wrench do not fit the robot.
        SimulationError: an argument does not make sense.
        ModelError: as `linearize`.
    """
    acting = acting_of(excitations)
    samples, step = samples_of(duration_s, sample_rate_hz)
    watched = frames_of(robot, frames)
    model = linearize(robot, posture, wrench=wrench, frame=frame, wrench_axes=wrench_axes, equilibrium=equilibrium)
    sources = [_source(model, excitation, (samples - 1) * step, step) for excitation in acting]
    x = set_in_motion(np.zeros(len(model.state_matrix())), model.coordinates, displacement, velocity)
    states, rates, forces = _walk(model, sources, x, samples, step)
    if not np.isfinite(states).all():
        found = "a response too large for numbers"
        raise SimulationError(robot.name, found=found, expected="forces of this world, and a loop that is stable")
    return _series(model, acting, watched, states, rates, forces, sample_rate_hz)


def _walk(
    model: LinearModel, sources: Sequence[Source], x: Array, samples: int, step: float
) -> tuple[Array, Array, Array]:
    """States, their rates and forces at the samples, (samples, ...), each piece from its own start."""
    from scipy.linalg import block_diag, expm

    A, n, count = model.state_matrix(), len(model.coordinates), len(x)
    B = np.zeros((count, 2 * len(sources)))
    for k, source in enumerate(sources):
        B[n : 2 * n, 2 * k] = source.push
    S = block_diag(*(source.generator for source in sources)) if sources else np.zeros((0, 0))
    whole = np.block([[A, B], [np.zeros((len(S), count)), S]])
    known: dict[float, Array] = {}

    def over(length: float) -> Array:
        if length not in known:
            if len(known) >= MOST_KNOWN:
                known.clear()
            known[length] = np.asarray(expm(whole * length), np.float64)
        return known[length]

    edges = _edges(sources, (samples - 1) * step, step)
    out = np.empty((samples, len(whole)))
    done, stride = 0, over(step)
    for begin, end in pairwise(edges.tolist()):
        state = np.concatenate([x, *(source.at(begin) for source in sources)])
        at = begin
        while done < samples and done * step < end - 1e-9 * step:
            jump = done * step - at
            state = stride @ state if abs(jump - step) < 1e-9 * step else over(round(jump, 15)) @ state
            at = done * step
            out[done] = state
            done += 1
        last = over(round(end - at, 15)) @ state
        x = last[:count]
    # The last sample sees the forces as they are just before.
    out[done:] = last
    return out[:, :count], out @ whole[:count].T, out[:, count::2]


def _edges(sources: Sequence[Source], last: float, step: float) -> Array:
    jumps = {0.0, last} | {t for source in sources for piece in source.pieces for t in piece[:2] if 0 < t < last}
    edges = np.array(sorted(jumps))
    on_samples = np.round(edges / step) * step
    edges = np.unique(np.where(np.abs(edges - on_samples) <= 1e-9 * step, on_samples, edges))
    return edges if len(edges) > 1 else np.array([0.0, step])


def _source(model: LinearModel, excitation: Excitation, duration_s: float, step: float) -> Source:
    index, direction, own_axes, kind, numbers, values = excitation.on(model.robot, duration_s)
    mechanism = model.robot.mechanism
    jacobian = mechanism.jacobian(model.q, index, own_axes=own_axes)[:, model.robot.flexible]
    force = model.loop.widened((np.array(direction) @ jacobian)[None])[0]
    factor = model.mass_factor
    push = np.asarray(np.linalg.solve(factor.T, np.linalg.solve(factor, force)), np.float64)
    if kind == "constant":
        begin, end, value = numbers
        return Source(push, 0.0, [(begin, end, np.array([value, 0.0]))])
    if kind in ("half-sine", "sine"):
        begin, end, size = numbers[:3]
        rate, phase = (np.pi / (end - begin), 0.0) if kind == "half-sine" else (2 * np.pi * numbers[3], numbers[4])
        return Source(push, rate, [(begin, end, size * np.array([np.sin(phase), np.cos(phase)]))])
    if kind == "sweep":
        over = numbers[1]
        numbers, values = _sampled_sweep(numbers, step, duration_s)
    else:
        over = np.inf
    begin, width = numbers
    slopes = np.diff(values) / width
    pieces = [
        (begin + i * width, min(begin + (i + 1) * width, over), np.array([values[i], slope]))
        for i, slope in enumerate(slopes)
    ]
    return Source(push, 0.0, pieces)


def _sampled_sweep(numbers: list[float], step: float, duration_s: float) -> tuple[list[float], list[float]]:
    begin, end, size, low, high, logarithmic = numbers
    if end <= begin:  # it starts after the run
        return [begin, step], [0.0, 0.0]
    # Parts of a sampling time, so that few exponentials serve all of them.
    width, length = step / max(1, np.ceil(LINES_PER_PERIOD * max(low, high) * step)), end - begin
    x = np.arange(int(np.ceil(min(length, duration_s - begin + width) / width)) + 1) * width
    rate = np.log(high / low) / length if logarithmic and low != high else 0.0
    turns = low * np.expm1(rate * x) / rate if rate else low * x + (high - low) * x**2 / (2 * length)
    return [begin, width], (size * np.sin(2 * np.pi * turns)).tolist()


def _series(
    model: LinearModel,
    acting: Sequence[Excitation],
    frames: Sequence[str],
    states: Array,
    rates: Array,
    forces: Array,
    sample_rate_hz: float,
) -> TimeSeries:
    N, n = len(model.coordinates), model.links
    robot, moving = model.robot, np.flatnonzero(model.robot.flexible)
    links, motors = model.coordinates[:n], model.coordinates[n:]
    reference = np.concatenate([model.q[moving], model.motor_position])
    position, velocity, acceleration = states[:, :N] + reference, states[:, N : 2 * N], rates[:, N : 2 * N]
    units = units_of(robot, moving)
    columns = Columns()
    add = columns.add
    add(position[:, n:], "motor_position", motors, ["rad"] * len(motors))
    add(position[:, :n], "joint_position", links, units)
    add(velocity[:, n:], "motor_velocity", motors, ["rad/s"] * len(motors))
    add(velocity[:, :n], "joint_velocity", links, [f"{u}/s" for u in units])
    add(acceleration[:, :n], "joint_acceleration", links, [f"{u}/s²" for u in units])
    for name in frames:
        rows = robot.mechanism.jacobian(model.q, robot.frame_index(name))[:3, moving].T
        names = [f"{name}.{axis}" for axis in WORLD]
        add((states[:, :n] - states[0, :n]) @ rows, "displacement", names, ["m"] * 3)
        add(velocity[:, :n] @ rows, "velocity", names, ["m/s"] * 3)
        add(acceleration[:, :n] @ rows, "acceleration", names, ["m/s²"] * 3)
    add(forces, "force", force_names(robot, acting), [e.unit for e in acting])
    notes = notes_of(robot, model.posture, model.q, acting, (len(states) - 1) / sample_rate_hz) | {"model": "linear"}
    return columns.series(sample_rate_hz, notes)
