"""What a posture costs against the number of coordinates, beside NumPy's eigenvalues of the state matrix alone.

Random serial chains, seeded: with a drive on every joint, and with a spring and damper on every joint. One thread;
everything takes turns in this process, and medians are compared. Armonic starts from the robot and keeps poles and
shapes; NumPy gets the finished state matrices. With --write the tables go into a page, with those of the other benches
of surveys.

    python benches/survey_cost.py [--write docs/performance.md]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads
for variable in ("OPENBLAS_CORETYPE", "OPENBLAS_L2_SIZE"):
    os.environ.pop(variable, None)  # set for other programs, they can slow NumPy's own OpenBLAS

import json
import platform
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import armonic as am
import survey_against_pinocchio
import survey_grid
from armonic import _core
from pinocchio_loop import smooth_path
from timing import interleaved

SIZES = (3, 4, 6, 8, 12, 16, 20, 24, 30)
POINTS, MATRICES, ROUNDS = 100_000, 40, 7


@dataclass(frozen=True)
class Cost:
    """Seconds per posture of one chain with n coordinates and m modes."""

    n: int
    modes: int
    survey: float
    linearization: float
    following: float
    numpy: float
    dense: int


def chain(n: int, driven: bool) -> am.Robot:
    """A random chain whose links get lighter outwards, every joint with a frequency of its own of 5 to 50 Hz."""
    rng = np.random.default_rng(n)
    mass = 30.0 * 0.9 ** np.arange(n)
    links = []
    for i in range(n):
        a = float(rng.uniform(0.1, 0.4))
        links.append(
            {
                "name": f"link_{i + 1}",
                "parent": f"link_{i}" if i else "base",
                "dh": {"d": float(rng.uniform(0, 0.2)), "a": a, "alpha": float(rng.choice([-1, 0, 1]) * np.pi / 2)},
                "joint": {"type": "revolute"},
                "mass": float(mass[i]),
                "com": [-a / 2, *rng.uniform(-0.05, 0.05, 2).tolist()],
                "inertia": dict(
                    zip(("xx", "yy", "zz"), (mass[i] * a**2 / np.array([24, 10, 10])).tolist(), strict=True)
                ),
            }
        )
    q = rng.uniform(-1, 1, n).tolist()
    document = {"armonic": 1, "name": f"Chain of {n}", "links": links, "postures": {"start": q}}
    # JSON is YAML; the bare robot tells how heavy each joint's load is.
    bare = am.Robot.from_yaml(json.dumps(document))
    for link, load in zip(links, np.diag(bare.mechanism.mass_matrix(np.array(q))), strict=True):
        rate = 2 * np.pi * float(rng.uniform(5, 50))
        stiffness, damping = float(load * rate**2), float(0.02 * load * rate)
        if driven:
            motor = {"gear_ratio": 100, "rotor_inertia": float(load * rng.uniform(0.2, 1) * 1e-4)}
            link["drive"] = motor | {"shaft_stiffness": stiffness, "joint_damping": damping, "motor_damping": damping}
        else:
            link["elasticity"] = {"z": {"stiffness": stiffness, "damping": damping}}
    if driven:
        document["control"] = {"kp": [link["drive"]["shaft_stiffness"] / 5 for link in links]}
    return am.Robot.from_yaml(json.dumps(document))


def cost(n: int, driven: bool) -> Cost:
    robot = chain(n, driven)
    path = smooth_path(robot, POINTS)[: 16_000 if n <= 8 else 4_000 if n <= 16 else 2_000]
    found = am.survey(robot, path, threads=1)
    matrices = [am.linearize(robot, q).state_matrix() for q in path[:: len(path) // MATRICES]]
    start = am.modes(robot, path[0])
    model = am.linearize(robot, path[0])
    part = path[:1000]
    mass, gravity = robot.mechanism.at_rest(part)
    diagonal = np.arange(n)
    stiffness = gravity + np.zeros(1)
    stiffness[:, diagonal, diagonal] += np.diag(model.stiffness)[:n] - np.diag(gravity[0])
    drives = np.zeros((1, 0, 9))
    if driven:
        own, control, nothing = robot.drives, robot.control, np.zeros(n)
        gains = [own.motor_damping + control.kd, own.shaft_stiffness + control.kp]
        columns = [own.scale, own.shaft_stiffness, own.inertia, *gains, nothing, nothing, nothing, nothing]
        drives = np.array(columns).T[None]
    dampers = np.ascontiguousarray(np.diag(np.diag(model.damping)[:n])[None])
    links = np.ascontiguousarray(start.shapes.T[:, :n])
    places = list(range(drives.shape[1]))

    def follow() -> int:
        poles = _core.follow(mass, dampers, stiffness, drives, places, np.empty((0, n)), start.poles, links)[0]
        return len(poles)

    if follow() != len(part):
        raise SystemExit(f"a chain of {n} coordinates cannot be followed without Python")
    times = interleaved(
        lambda: am.survey(robot, path, threads=1, shapes=True, participation=False),
        lambda: robot.mechanism.at_rest(part),
        follow,
        lambda: [np.linalg.eig(matrix) for matrix in matrices],
        rounds=ROUNDS,
    )
    counts = (len(path), len(part), len(part), len(matrices))
    return Cost(n, found.sizes["mode"], *(t / c for t, c in zip(times, counts, strict=True)), int(found.method.sum()))


def table(costs: list[Cost]) -> list[str]:
    head = "| n | modes | NumPy over Armonic | linearization | following | the rest | Armonic, µs | NumPy, µs |"
    rows = [head, "|" + "--:|" * 8]
    for c in costs:
        rest = max(0.0, 1 - (c.linearization + c.following) / c.survey)
        shares = f"{c.linearization / c.survey:.0%} | {c.following / c.survey:.0%} | {rest:.0%}"
        times = f"{c.survey * 1e6:.1f} | {c.numpy * 1e6:.0f}"
        rows.append(f"| {c.n} | {c.modes} | {c.numpy / c.survey:.1f} | {shares} | {times} |")
    return rows


def machine() -> str:
    """What the figures depend on, without a name."""
    flags = Path("/proc/cpuinfo")
    wide = ", AVX-512" if flags.exists() and "avx512f" in flags.read_text() else ""
    python = ".".join(platform.python_version_tuple()[:2])
    return f"{os.cpu_count()} processors ({platform.machine()}{wide}), Python {python}, NumPy {np.__version__}"


PAGE = """\
# Performance

Written by `python benches/survey_cost.py --write docs/performance.md`; do not edit. What is compared takes
turns in one run, and medians are compared, so the ratios say more than the times. The machine:
{machine}.

## A dense path

Scompi (six joints, six motors, twelve modes) at {path.postures} neighbouring postures of a random motion, steps
up to {step:.2f} mrad or mm, poles and shapes kept. The peer is a loop over the postures with Pinocchio (mass
matrix, derivative of gravity) and NumPy (one solution with the mass matrix, eigenvalues and vectors of the
24x24 state matrix, sorted) into arrays made once. The poles of both agree to {path.difference:.0e} of their
size; the dense solver took {path.dense} postures. Armonic also numbers the modes through the whole path, checks
every set to be complete and marks crossings and veerings. The core alone is linearization and following.
`python benches/survey_against_pinocchio.py`

{path_table}

Two threads are {scaling:.2f} times as fast as one, other programs having kept {path.elsewhere:.0%} of the
processors busy at the start.

## A large grid

{grid.postures} postures of Scompi, three joints gridded, streamed into a Zarr store with energy shares, on two
threads, in a process of its own. The loop, which writes nothing, runs before and after it. `python
benches/survey_grid.py`

{grid_table}

## Cost against the number of coordinates

Random chains of n revolute joints along a dense path, one thread, poles and shapes kept. NumPy's part is the
eigenvalues and vectors of state matrices that are there already; Armonic's starts from the robot. Given are
shares of its time; the rest is Python: blocks, events, the labelled result. Modes are followed side by side in
lanes (16 with AVX-512, 8 with AVX2), so a few modes cost as much as all lanes full.

A drive on every joint, 4n states:

{driven}

A spring and damper on every joint, 2n states:

{sprung}

## Other benches

`make bench` runs all of them: the core's kernels (criterion), frequency responses and fits beside NumPy and
SciPy (`benches/frf_against_numpy.py`, `benches/update_against_numpy.py`), the start of a process
(`benches/startup.py`), and these. `benches/success_rate.py` counts how often a fit finds the minimum.
"""


def page(
    path: survey_against_pinocchio.Result, grid: survey_grid.Result, driven: list[Cost], sprung: list[Cost]
) -> str:
    loop, one, two, _ = path.each.values()
    of_path = [f"| {name} | {loop / seconds:.1f} | {seconds * 1e6:.2f} |" for name, seconds in path.each.items()]
    of_grid = [
        f"| times the loop's speed | {grid.loop / grid.survey:.1f} |",
        f"| peak memory of the process | {grid.peak / 2**20:.0f} MiB |",
        f"| on disk | {grid.stored / 1e6:.0f} MB |",
        f"| postures by the dense solver | {grid.dense} |",
        f"| postures per second | {1 / grid.survey:.0f} |",
        f"| processors busy with other programs at the start | {grid.elsewhere:.0%} |",
    ]
    return PAGE.format(
        machine=machine(),
        path=path,
        step=path.step * 1e3,
        path_table="\n".join(["| | times the loop's speed | µs per posture |", "|---|--:|--:|", *of_path]),
        scaling=one / two,
        grid=grid,
        grid_table="\n".join(["| | |", "|---|--:|", *of_grid]),
        driven="\n".join(table(driven)),
        sprung="\n".join(table(sprung)),
    )


def main() -> None:
    if "--write" not in sys.argv:
        for driven in (True, False):
            print("a drive on every joint" if driven else "a spring on every joint")
            print(*table([cost(n, driven) for n in SIZES]), sep="\n")
        return
    # The page's other parts first, while this process is small.
    parts = survey_against_pinocchio.measure(), survey_grid.measure()
    costs = [[cost(n, driven) for n in SIZES] for driven in (True, False)]
    Path(sys.argv[sys.argv.index("--write") + 1]).write_text(page(*parts, *costs), encoding="utf-8")


if __name__ == "__main__":
    main()
