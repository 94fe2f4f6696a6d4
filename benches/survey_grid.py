"""A map of one million postures of the robot Scompi, streamed into a store on two threads: its memory and its rate.

The survey runs in a process of its own, whose peak memory is that of everything in it. The loop over Pinocchio and
NumPy (one thread, poles and shapes, nothing written) runs before and after it.

    python benches/survey_grid.py [points per joint]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads
for variable in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
    os.environ.pop(variable, None)  # set for other programs, they can slow NumPy's own OpenBLAS

import re
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

import armonic as am
from pinocchio_loop import PinocchioLoop
from timing import busy_elsewhere

JOINTS = {"link_2.z": (-0.6, 0.6), "link_3.z": (1.0, 2.2), "link_4.z": (-0.4, 1.2)}
POSTURE = "c1"
OF_LOOP = 4_000
THREADS = 2
STATUS = Path("/proc/self/status")


def grid(points: int) -> am.Grid:
    return am.Grid({name: np.linspace(*ends, points) for name, ends in JOINTS.items()}, base=POSTURE)


def survey(points: int, store: str) -> None:
    """What the process does: its seconds in the survey, peak memory in bytes, and postures by the dense solver."""
    robot = am.load("scompi")
    begin = perf_counter()
    found = am.survey(robot, grid(points), store=store, threads=THREADS)
    seconds = perf_counter() - begin
    kilobyte = 1 if sys.platform == "darwin" else 1024
    # Linux counts the memory of the process that started this one too, and tells its own elsewhere.
    own = re.search(r"VmHWM:\s+(\d+) kB", STATUS.read_text()) if STATUS.exists() else None
    peak = int(own[1]) if own else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(seconds, peak * kilobyte, int(found.method.sum()))


def loop_seconds(robot: am.Robot) -> float:
    """Of the loop, per posture, over postures of the grid."""
    q = np.tile(robot.posture(POSTURE), (OF_LOOP, 1))
    for name, ends in JOINTS.items():
        q[:, robot.coordinates.index(name)] = np.linspace(*ends, OF_LOOP)
    loop = PinocchioLoop(robot)
    loop.modes(q[:100])
    begin = perf_counter()
    loop.modes(q)
    return (perf_counter() - begin) / OF_LOOP


@dataclass(frozen=True)
class Result:
    """Share of processors busy elsewhere, bytes on disk and in memory, seconds of survey and loop per posture."""

    elsewhere: float
    postures: int
    stored: int
    peak: int
    survey: float
    loop: float
    dense: int


def measure(points: int = 100) -> Result:
    robot, count = am.load("scompi"), points**3
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "map.zarr"
        elsewhere = busy_elsewhere()
        before = loop_seconds(robot)
        command = [sys.executable, __file__, "--here", str(points), str(store)]
        out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        seconds, peak, dense = (float(word) for word in out.split())
        loop = (before + loop_seconds(robot)) / 2
        size = sum(file.stat().st_size for file in store.rglob("*") if file.is_file())
    return Result(elsewhere, count, size, int(peak), seconds / count, loop, int(dense))


def main() -> None:
    if "--here" in sys.argv:
        survey(int(sys.argv[2]), sys.argv[3])
        return
    result = measure(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
    print(f"Scompi, {result.postures} postures, {THREADS} threads, into a store of {result.stored / 1e6:.0f} MB")
    print(f"other programs kept {result.elsewhere:.0%} of the processors busy at the start")
    print(f"peak memory of the process {result.peak / 2**20:.0f} MiB; by the dense solver {result.dense} postures")
    for name, each in (("Pinocchio and NumPy, a loop", result.loop), ("am.survey into a store", result.survey)):
        print(f"{name:28s} {each * 1e6:8.2f} µs   {1 / each:10.0f} postures a second")
    print(f"{result.loop / result.survey:.1f} times the loop's speed, {result.survey * result.postures:.1f} s in all")


if __name__ == "__main__":
    main()
