"""Make the pictures of README and docs: `python docs/pictures.py [name ...]` fits, maps and photographs the results.

It needs Chromium or Google Chrome on the path, and nothing from the network.
"""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import plotly.graph_objects as go

import armonic as am
from armonic import examples, plots

WIDTH, SCALE = 1200, 1.5
FONTS = "'Helvetica Neue', 'Liberation Sans', Arial, sans-serif"
FOLDER = Path(__file__).parent / "pictures"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = (
    "--headless",
    "--hide-scrollbars",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    wanted = sys.argv[1:]
    for make in (kuka_fit, scompi_map, kuka_cases, stabilization):
        if wanted and make.__name__ not in wanted:
            continue
        for name, figures in make().items():
            photograph(figures, FOLDER / f"{name}.png")
            print(f"wrote {FOLDER / name}.png")


def kuka_fit() -> dict[str, list[go.Figure]]:
    """Measured, start and fitted responses, and how well each parameter is determined."""
    folder = Path(examples.__file__).parent
    robot = am.load(folder / examples.START)
    measured = am.read_frf(folder / examples.MEASURED)
    fit = am.update(robot, am.Measurement(measured, posture="milling", frame="sensor"))
    frfs = {"measured": measured, "before": fit.frf_before[0], "after": fit.frf_after[0]}
    return {"kuka_fit": [plots.frf_matrix(frfs, cell_height=196), plots.parameter_intervals(fit)]}


def scompi_map() -> dict[str, list[go.Figure]]:
    """Natural frequencies over the path of the paper, without and with a tool (Do et al. 2022, Fig. 3)."""
    cases = am.survey(am.load("scompi"), "table", sweep={"tool.mass": [0, 4]})
    return {"scompi_map": [plots.frequency_map(cases)]}


def kuka_cases() -> dict[str, list[go.Figure]]:
    """The three cases of Huynh et al. 2021, section 5."""
    program = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "kuka_cases.py"))
    return program["figures"](program["study"]())


def stabilization() -> dict[str, list[go.Figure]]:
    """Frequencies and damping of all orders from the motor positions of case 2 (Do et al. 2022, Fig. 9)."""
    robot = am.load("scompi").with_values({"tool.mass": 4.0})
    hit = am.Impulse(axis="y0", force=50.0, duration_s=0.006)
    result = am.oma(am.simulate(robot, "c8", hit, duration_s=3.0).series, channels="motor_position")
    modes = am.modes(robot, "c8")
    figures = [
        plots.stabilization_diagram(result.stabilization, result.modes, what=what, reference=modes)
        for what in ("frequency", "damping")
    ]
    return {"stabilization": figures}


def photograph(figures: list[go.Figure], target: Path) -> None:
    """Render figures below each other to a PNG."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"docs/pictures.py: no browser on the path; install one of {', '.join(BROWSERS)}.")
    height = sum(figure.layout.height for figure in figures) + 16
    parts: list[str] = []
    for figure in figures:
        figure.update_layout(width=WIDTH - 32, font={"family": FONTS, "size": 13})
        script = not parts
        parts.append(figure.to_html(full_html=False, include_plotlyjs=script, config={"staticPlot": True}))
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "page.html", Path(folder) / "shot.png"
        page.write_text(f'<body style="margin: 8px 16px; background: white">{"".join(parts)}</body>', "utf-8")
        options = [*QUIET, f"--user-data-dir={folder}/profile", f"--window-size={WIDTH},{height}"]
        options += [
            f"--force-device-scale-factor={SCALE}",
            "--virtual-time-budget=8000",
            f"--screenshot={shot}",
        ]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            options.append("--no-sandbox")  # Chromium refuses to sandbox root
        command = [browser, *options, page.as_uri()]
        run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        if not shot.exists():
            sys.exit(f"docs/pictures.py: {browser} took no picture.\n{run.stderr[-2000:]}")
        shutil.copyfile(shot, target)


if __name__ == "__main__":
    main()
