"""What is still found of Scompi's twelve modes when motor positions come from encoders, or with noise.

Both cases of Do et al. 2022, section 4.3, their impulse, 1 kHz, orders 2 to 100; five draws where chance has a part.

    python benches/identify_with_noise.py [--write docs/identification.md]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import armonic as am

MARKS = ("<!-- written by benches/identify_with_noise.py -->", "<!-- end -->")
DRAWS = 5
HEAD = (
    "| motor positions | case | found of 12 | missing | false | worst of 1 to 11 in frequency | in damping |",
    "|---|---|---|---|---|---|---|",
)


def cases() -> Iterator[tuple[int, am.Robot, am.Run]]:
    hit = am.Impulse(axis="y0", force=50.0, duration_s=0.006)
    for case, mass in ((1, 0.0), (2, 4.0)):
        robot = am.load("scompi").with_values({"tool.mass": mass})
        yield case, robot, am.simulate(robot, "c8", hit, duration_s=3.0)


def measured(robot: am.Robot, run: am.Run) -> Iterator[tuple[str, list[am.TimeSeries]]]:
    yield "as simulated", [run.series]
    for bits in (24, 20, 18):
        yield f"encoders of {bits} bits", [am.measure(run.series, am.encoders(robot, bits))]
    for share in (1e-5, 1e-3, 1e-2):
        noisy = {"motor_position": am.Sensor(noise=share)}
        yield f"{100 * share:g} % of noise", [am.measure(run.series, noisy, seed=seed) for seed in range(DRAWS)]


def row(label: str, case: int, robot: am.Robot, draws: list[am.TimeSeries]) -> str:
    truth = am.modes(robot, "c8")
    comparisons = [am.compare(am.oma(series, channels="motor_position"), truth) for series in draws]
    pairs = [pair for comparison in comparisons for pair in comparison.pairs if pair.index_b < 11]
    missing = sorted({mode + 1 for comparison in comparisons for mode in comparison.only_b})
    found = [len(comparison.pairs) for comparison in comparisons]
    counted = f"{min(found)}" if min(found) == max(found) else f"{min(found)} to {max(found)}"
    freq = 100 * np.abs([pair.freq_difference for pair in pairs]).max()
    damping = 100 * np.abs([pair.damping_difference for pair in pairs]).max()
    false = sum(len(comparison.only_a) for comparison in comparisons)
    lost = ", ".join(map(str, missing)) or "none"
    return f"| {label} | {case} | {counted} | {lost} | {false} | {freq:.2g} % | {damping:.2g} points |"


def table() -> list[str]:
    rows: dict[str, list[str]] = {}
    for case, robot, run in cases():
        for label, draws in measured(robot, run):
            rows.setdefault(label, []).append(row(label, case, robot, draws))
            print(rows[label][-1], flush=True)
    return [*HEAD, *(line for lines in rows.values() for line in lines)]


def main() -> None:
    lines = table()
    if "--write" in sys.argv:
        page = Path(sys.argv[sys.argv.index("--write") + 1])
        before, _, rest = page.read_text("utf-8").partition(MARKS[0])
        after = rest.partition(MARKS[1])[2]
        page.write_text("\n".join([before + MARKS[0], "", *lines, "", MARKS[1] + after]), "utf-8")


if __name__ == "__main__":
    main()
