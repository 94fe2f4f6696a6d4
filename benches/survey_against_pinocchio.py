"""Poles and shapes of the robot Scompi along a dense path, against a loop over Pinocchio and NumPy's eigenvalues.

All run in this process, in turn; printed are medians per posture and the ratio to the loop. NumPy has one thread, its
fastest at this size. Both sides keep all poles and shapes; Armonic also numbers the modes from the first posture to the
last, checks every set to be complete and marks crossings and veerings.

    python benches/survey_against_pinocchio.py [rounds]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads
for variable in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
    os.environ.pop(variable, None)  # set for other programs, they can slow NumPy's own OpenBLAS

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import armonic as am
from armonic import _core
from pinocchio_loop import PinocchioLoop, blas_kernel, smooth_path
from timing import busy_elsewhere, interleaved

POINTS, POSTURES, OF_LOOP = 100_000, 20_000, 2_000
CHUNK = 4096
SAME = 1e-9


def core_alone(robot: am.Robot, path: np.ndarray) -> Callable[[], object]:
    """Linearization and following, with nothing before and after."""
    drives, n = robot.drives, len(robot.coordinates)
    springs = drives.scale**2 * drives.shaft_stiffness
    dampers = np.diag(drives.joint_damping)[None]
    control = robot.control
    nothing = np.zeros(len(springs))
    own = [drives.motor_damping + control.kd, drives.shaft_stiffness + control.kp]
    columns = [drives.scale, drives.shaft_stiffness, drives.inertia, *own, nothing, nothing, nothing, nothing]
    motors = np.array(columns).T[None]
    start = am.modes(robot, path[0])
    diagonal = np.arange(n)

    def run() -> None:
        poles, shapes = start.poles, start.shapes.T
        for first in range(0, len(path), CHUNK):
            mass, stiffness = robot.mechanism.at_rest(path[first : first + CHUNK])
            stiffness[:, diagonal, diagonal] += springs
            links = np.ascontiguousarray(shapes[:, :n])
            found = _core.follow(mass, dampers, stiffness, motors, list(range(n)), np.empty((0, n)), poles, links)
            if len(found[0]) != len(mass):
                raise RuntimeError("the path is not dense enough to be followed without Python")
            poles, shapes = found[0][-1], found[1][-1]

    return run


@dataclass(frozen=True)
class Result:
    """Seconds per posture by name, the loop first; share of the processors busy elsewhere; what was surveyed."""

    each: dict[str, float]
    elsewhere: float
    postures: int
    step: float
    difference: float
    dense: int


def measure(rounds: int = 15) -> Result:
    robot = am.load("scompi")
    path = smooth_path(robot, POINTS)[:POSTURES]
    few = path[:: POSTURES // OF_LOOP]
    loop = PinocchioLoop(robot)

    def survey(threads: int) -> Callable[[], object]:
        return lambda: am.survey(robot, path, threads=threads, shapes=True, participation=False)

    found = am.survey(robot, path, threads=1)
    theirs, _ = loop.modes(few)
    ours = found.pole.values[:: POSTURES // OF_LOOP]
    ours = np.take_along_axis(ours, np.argsort(np.abs(ours), axis=1), axis=1)
    difference = float(np.abs(ours / theirs - 1).max())
    if not difference < SAME:
        raise SystemExit(f"the poles differ by {difference:.1e}, allowed are {SAME:g}")
    elsewhere = busy_elsewhere()
    times = interleaved(lambda: loop.modes(few), survey(1), survey(2), core_alone(robot, path), rounds=rounds)
    names = ("Pinocchio and NumPy, a loop", "am.survey, one thread", "am.survey, two threads", "core alone, one thread")
    each = {name: seconds / len(few if name == names[0] else path) for name, seconds in zip(names, times, strict=True)}
    step = float(np.abs(np.diff(path, axis=0)).max())
    return Result(each, elsewhere, len(path), step, difference, int(found.method.sum()))


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    result = measure(rounds)
    print(f"Scompi, n = 6 and 6 motors, {result.postures} postures, steps up to {result.step * 1e3:.2f} mrad or mm")
    print(f"largest relative difference of a pole {result.difference:.1e}; by the dense solver {result.dense}")
    print(f"NumPy runs on {blas_kernel()}; medians of {rounds}")
    print(f"other programs kept {result.elsewhere:.0%} of the processors busy at the start")
    loop, one, two, _ = result.each.values()
    for name, seconds in result.each.items():
        print(f"{name:28s} {seconds * 1e6:8.2f} µs   {loop / seconds:6.1f} times the loop's speed")
    print(f"two threads over one: {one / two:.2f}")


if __name__ == "__main__":
    main()
