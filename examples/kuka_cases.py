"""The three cases of Huynh et al. 2021, section 5, on a robot whose numbers are known.

    python examples/kuka_cases.py [folder] [--write docs/kuka_cases.md]

The paper fits 18 elastic parameters of a KUKA KR90 to responses (a) of a model, (b) as measured, from a robot that is
neither linear nor reciprocal, and (c) synthesized from measured modes and made symmetric. Its measurements are not
public. Here a simulated robot stands in for the real one: the model of (a) with one joint that softens the harder it
is hit, and noise. The program writes figures into the folder and the tables beside those of the paper into the page.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import find_peaks

import armonic as am
from armonic import examples
from armonic.text import format_duration, format_spread, split_path

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

POSTURE, FRAME, AXES = "milling", "sensor", ("x", "y", "z")
MODELLED_HZ, MEASURED_HZ = np.arange(1, 151) / 5, np.arange(1, 61) / 2
SEED, NOISE = 2021, 0.02
SOFT = "links.carousel.elasticity.z.stiffness"
"""The joint that softens: the one whose turn is mode 1."""
SOFTENING, KNEE_RAD = 0.3, 2e-5
"""k(a) = k (1 − SOFTENING a/(a + KNEE_RAD)) for a tap that turns the joint by a (root mean square over the record)."""
IMPULSE, RECORD = 4.0, 2.0
"""Of each tap, N s, flat over the band; length of the record, s, which makes lines every 0.5 Hz."""
MODES = 4


PRINTED_ELASTICITY = (
    (5.0, 5.0, 5.0, 3.5),
    (6.1, 5.4, 5.8, 7.0),
    (11.9, 15.4, 10.0, 11.9),
    (6.9, 5.9, 8.0, 6.9),
    (11.8, 11.3, 9.5, 22.6),
    (8.1, 9.0, 32.0, 18.2),
    (2.8, 2.8, 2.8, 2.7),
    (5.2, 18.2, 100.0, 0.9),
    (12.0, 23.3, 100.0, 21.01),
    (0.02, 0.03, 0.12, 1.5),
    (0.04, 0.6, 0.02, 0.001),
    (3.1, 0.3, 0.006, 7.3),
    (2.4, 2.6, 9.16, 0.4),
    (0.04, 0.2, 0.01, 0.002),
    (9.4, 10.0, 4.0, 0.3),
    (0.2, 0.2, 0.03, 0.3),
    (9.2, 4.1, 2.6, 0.08),
    (0.08, 0.7, 9.0, 0.06),
)
"""Table 5 of the paper: earlier work, cases a, b, c; stiffness in MN m/rad, then damping in kN m s/rad."""
PRINTED_MODES = (
    (10.0, 10.0, 10.0, 11.0, 10.0),
    (11.0, 11.1, 11.1, 11.2, 11.1),
    (19.2, 18.7, 18.7, 19.5, 19.5),
    (23.7, 23.8, 23.8, 24.0, 23.6),
    (1.4, 1.1, 1.0, 1.6, 0.9),
    (1.0, 1.0, 1.0, 0.3, 1.0),
    (0.5, 0.6, 0.6, 0.1, 0.7),
    (0.8, 0.8, 0.8, 0.5, 0.8),
)
"""Table 6: measured, earlier work, cases a, b, c; Hz, then per cent."""
PRINTED_EFFORT = {"a": ("17 101", "2210 s", "64"), "b": ("400 000", "12 h", "above 300"), "c": ("150 000", "4 h", "–")}
"""Section 5: iterations, time, final cost; case b was stopped by hand."""
MARK = "<!-- end -->"
"""After each table of the page."""


@dataclass(frozen=True, eq=False)
class Case:
    """One fit, with what it was made of.

    Attributes:
        name: "a", "b", "c".
        title: what was fitted.
        fit: the fit by the default method.
        shown: responses for its figure, by label.
    """

    name: str
    title: str
    fit: am.Fit
    shown: dict[str, am.Frf]


@dataclass(frozen=True, eq=False)
class Study:
    """All of it.

    Attributes:
        cases: the three.
        genetic: case a by the paper's own method.
        identified: poles of the modal model behind case c, (4,), rad/s.
    """

    cases: tuple[Case, ...]
    genetic: am.Fit
    identified: Complex


def truth() -> am.Robot:
    """The robot of earlier work: Table 5, column "From [34]"."""
    return am.load("kuka_kr90")


def start() -> am.Robot:
    """Initial values and bounds of Table 4."""
    return am.load(Path(examples.__file__).parent / examples.START)


def stiffness_under(axis: int) -> float:
    """Stiffness of the soft joint that a tap along an axis finds: where it fits the deflection that it causes."""
    k = rigid = truth().parameters()[SOFT]
    for _ in range(60):
        model = am.linearize(truth().with_values({SOFT: k}), POSTURE)
        s = 2j * np.pi * MEASURED_HZ[:, None, None]
        force = model.jacobian(FRAME)[axis].astype(complex)
        turn = np.linalg.solve(s**2 * model.mass + s * model.damping + model.stiffness, force[:, None])[:, 0, 0]
        # Parseval: the mean square over the record from the spectrum on its lines, 1/RECORD apart.
        a = IMPULSE / RECORD * np.sqrt(2 * np.sum(np.abs(turn) ** 2))
        k = rigid * (1 - SOFTENING * a / (a + KNEE_RAD))
    return float(k)


def measured() -> am.Frf:
    """Tap by tap, a column each, on the robot as that tap finds it, with relative noise."""
    robots = [truth().with_values({SOFT: stiffness_under(axis)}) for axis in range(3)]
    columns = [am.frf(r, POSTURE, MEASURED_HZ, frame=FRAME, inputs=axis) for r, axis in zip(robots, AXES, strict=True)]
    values = np.concatenate([column.values for column in columns], axis=2)
    real, imaginary = np.random.default_rng(SEED).standard_normal((2, *values.shape))
    return am.Frf(MEASURED_HZ, values * np.exp(NOISE * (real + 1j * imaginary)), "accelerance", AXES, AXES, FRAME)


def synthesized(frf: am.Frf) -> tuple[am.Frf, Complex]:
    """Responses of the modal model that fits a symmetric matrix best, and its poles.

    Four pairs of poles that all responses share, a symmetric matrix of residues for each, and a constant receptance for
    the modes above the band. The poles are sought by least squares from the highest peaks, in relative differences;
    for given poles residues and constant are linear (variable projection, Golub and Pereyra 1973).
    """
    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    s = 2j * np.pi * frf.freq_hz
    H = frf.to("receptance").values
    targets = np.stack([H[:, a, b] for a, b in pairs], axis=1)
    level = np.log(np.abs(frf.values)).sum(axis=(1, 2))
    peaks, found = find_peaks(level, prominence=0.1)
    highest = np.sort(peaks[np.argsort(-found["prominences"])[:MODES]])

    def basis(x: Array) -> Complex:
        pole = np.exp(x[:MODES]) * (-np.exp(x[MODES:]) + 1j)
        left, right = 1 / (s[:, None] - pole), 1 / (s[:, None] - pole.conj())
        return np.concatenate([left + right, 1j * (left - right), np.ones((len(s), 1))], axis=1)

    def model(x: Array) -> Complex:
        columns = []
        for target in targets.T:
            rows = basis(x) / np.abs(target)[:, None]
            aim = target / np.abs(target)
            stacked = np.concatenate([rows.real, rows.imag]), np.concatenate([aim.real, aim.imag])
            columns.append(basis(x) @ np.linalg.lstsq(*stacked, rcond=None)[0])
        return np.stack(columns, axis=1)

    def residual(x: Array) -> Array:
        difference = ((model(x) - targets) / np.abs(targets)).ravel()
        return np.concatenate([difference.real, difference.imag])

    first = np.concatenate([np.log(np.abs(s[highest])), np.full(MODES, np.log(0.01))])
    x = least_squares(residual, first, x_scale=np.repeat([0.01, 0.3], MODES)).x
    values = np.empty_like(H)
    for column, (a, b) in zip(model(x).T, pairs, strict=True):
        values[:, a, b] = values[:, b, a] = column
    made = replace(frf.to("receptance"), values=values).to(frf.kind)
    return made, np.exp(x[:MODES]) * (-np.exp(x[MODES:]) + 1j)


def study() -> Study:
    """Runs everything; takes some ten seconds, nearly all of them for the genetic method."""
    modelled, raw = am.frf(truth(), POSTURE, MODELLED_HZ, frame=FRAME), measured()
    smooth, poles = synthesized(raw.symmetrized("average"))
    given = {
        "a": ("modelled responses", am.Measurement(modelled, POSTURE)),
        "b": ("responses as measured", am.Measurement(raw, POSTURE)),
        "c": ("responses synthesized from measured modes, symmetric", am.Measurement(smooth, POSTURE)),
    }
    cases = []
    for name, (title, measurement) in given.items():
        fit = am.update(start(), measurement)
        shown = {"measured": measurement.frf, "before": fit.frf_before[0], "after": fit.frf_after[0]}
        if name == "c":
            shown = {"measured": raw, "synthesized": smooth, "after": fit.frf_after[0]}
        cases.append(Case(name, title, fit, shown))
    options = am.Genetic(population=100, generations=20, simplex_iterations=10_000, tolerance=300, rounds=10)
    return Study(tuple(cases), am.update(start(), given["a"][1], method="genetic", genetic=options, seed=SEED), poles)


def tables(found: Study) -> dict[str, list[str]]:
    """Effort, parameters and modes beside those of the paper, as Markdown."""
    return {"effort": _effort(found), "parameters": _parameters(found), "modes": _modes(found)}


def _effort(found: Study) -> list[str]:
    rows = ["| case | by | evaluations | time | final cost |", "|---|---|--:|--:|--:|"]
    for case in found.cases:
        rows.append(f"| {case.name} | the paper | {' | '.join(PRINTED_EFFORT[case.name])} |")
        if case.name == "a":
            rows.append(f"| a | its method here, to its tolerance of 300 | {_ran(found.genetic)} |")
        rows.append(f"| {case.name} | `am.update` | {_ran(case.fit)} |")
    return rows


def _ran(fit: am.Fit) -> str:
    cost = "0" if fit.cost < 1e-9 else f"{fit.cost:.3g}"
    evaluations = f"{fit.evaluations:,}".replace(",", " ")
    return f"{evaluations} | {format_duration(fit.duration_s)} | {cost}"


def _parameters(found: Study) -> list[str]:
    names = ("earlier work", *(f"{case.name} {side}" for case in found.cases for side in ("paper", "here")))
    rows = ["| | " + " | ".join(names) + " |", "|---|" + "--:|" * len(names)]
    ordered = sorted(range(18), key=lambda i: found.cases[0].fit.parameters[i].path.endswith("damping"))
    for printed, i in zip(PRINTED_ELASTICITY, ordered, strict=True):
        name, quantity = split_path(found.cases[0].fit.parameters[i].path)
        unit = 1e6 if quantity == "stiffness" else 1e3
        cells = [f"{printed[0]:g}"]
        for case, value in zip(found.cases, printed[1:], strict=True):
            cells += [f"{value:g}", _told(case.fit.parameters[i], unit, case.name != "a")]
        rows.append(f"| {'k' if unit == 1e6 else 'd'} {name} | " + " | ".join(cells) + " |")
    return rows


def _told(p: am.FittedParameter, unit: float, spread: bool) -> str:
    value = f"{p.value / unit:.3g}"
    if p.verdict == "at bound":
        return f"{value} (bound)"
    return f"{value} {format_spread(*p.interval)}" if spread else value


def _modes(found: Study) -> list[str]:
    robot = am.modes(truth(), POSTURE)
    fits = [case.fit.after[0] for case in found.cases]
    nearest = [np.argmax(am.mac(robot, fit)[:MODES], axis=1) for fit in fits]
    hz = [fit.damped_freq_hz[near] for fit, near in zip(fits, nearest, strict=True)]
    ratio = [100 * fit.damping_ratio[near] for fit, near in zip(fits, nearest, strict=True)]
    poles = found.identified
    ours = np.array(
        [
            [*poles.imag / 2 / np.pi, *(-100 * poles.real / np.abs(poles))],
            [*robot.damped_freq_hz[:MODES], *100 * robot.damping_ratio[:MODES]],
            *([*f, *z] for f, z in zip(hz, ratio, strict=True)),
        ]
    ).T
    head = ("measured", "earlier work", "a", "b", "c", "measured", "robot", "a", "b", "c")
    rows = ["| | " + " | ".join(head) + " |", "|---|" + "--:|" * len(head)]
    names = [f"f{i + 1}, Hz" for i in range(MODES)] + [f"ζ{i + 1}, %" for i in range(MODES)]
    for k, name in enumerate(names):
        digits = 1 if k < MODES else 2
        cells = [f"{x:g}" for x in PRINTED_MODES[k]] + [f"{x:.{digits + (k < MODES)}f}" for x in ours[k]]
        rows.append(f"| {name} | " + " | ".join(cells) + " |")
    printed = np.array(PRINTED_MODES)
    for name, part in (("mean error of f, %", slice(0, MODES)), ("mean error of ζ, %", slice(MODES, None))):
        cells = []
        for block in (printed, ours):
            error = 100 * np.abs(block[part] / block[part, :1] - 1).mean(axis=0)
            cells += ["", *(f"{e:.2g}" if e >= 0.05 else "0" for e in error[1:])]
        rows.append(f"| {name} | " + " | ".join(cells) + " |")
    return rows


def figures(found: Study) -> dict[str, list[go.Figure]]:
    """Responses of each case, how the cost of case a fell by two methods, and what b and c determine, by name."""
    from armonic import plots

    a, b, c = found.cases
    drawn = {f"kuka_case_{case.name}": [plots.frf_matrix(case.shown, cell_height=196)] for case in found.cases}
    drawn["kuka_case_a"].append(_costs({"paper's method": found.genetic, "continuation": a.fit}))
    for case in (b, c):
        drawn[f"kuka_case_{case.name}"].append(plots.parameter_intervals(case.fit))
    return drawn


def _costs(fits: dict[str, am.Fit]) -> go.Figure:
    """Lowest cost over evaluations, on two logarithmic scales; that of the ladder's rungs is another and left out."""
    import plotly.graph_objects as go

    from armonic.plots.look import AFTER, BEFORE, TEMPLATE

    figure = go.Figure(layout={"template": TEMPLATE, "height": 280, "margin": {"l": 70, "r": 8, "t": 36, "b": 46}})
    for (name, fit), colour in zip(fits.items(), (BEFORE, AFTER), strict=True):
        counts = np.cumsum([0, *(len(stage.history) for stage in fit.stages)])
        xs = [np.arange(len(stage.history)) + begin + 1 for stage, begin in zip(fit.stages, counts, strict=False)]
        told = [(x, stage.history) for x, stage in zip(xs, fit.stages, strict=True) if stage.sigma == 0]
        x, y = (np.concatenate(parts) for parts in zip(*told, strict=True))
        y = np.minimum.accumulate(np.append(fit.start_cost, y))
        line = {"color": colour, "width": 1.8, "shape": "hv"}
        figure.add_scatter(x=np.append(1, x), y=y, name=name, mode="lines", line=line)
    decades = {"type": "log", "exponentformat": "power", "dtick": 1}
    figure.update_xaxes(**decades, title={"text": "Evaluations"}, range=[0, 5])
    figure.update_yaxes(**decades | {"dtick": 2}, title={"text": "Cost"}, range=[-6.5, 5.5])
    return figure


def main() -> None:
    """Write figures into the folder and tables into the page."""
    words = sys.argv[1:]
    page = Path(words[words.index("--write") + 1]) if "--write" in words else None
    named = [word for i, word in enumerate(words) if word != "--write" and (i == 0 or words[i - 1] != "--write")]
    folder = Path(named[0]) if named else Path("demo")
    folder.mkdir(exist_ok=True, parents=True)
    found = study()
    for name, drawn in figures(found).items():
        parts = [f.to_html(full_html=False, include_plotlyjs=not i) for i, f in enumerate(drawn)]
        (folder / f"{name}.html").write_text(f"<body>{''.join(parts)}</body>", "utf-8")
    made = tables(found)
    (folder / "kuka_cases.md").write_text("\n\n".join("\n".join(rows) for rows in made.values()) + "\n", "utf-8")
    if page is not None:
        text = page.read_text("utf-8")
        for name, rows in made.items():
            begin = f"<!-- {name}: written by examples/kuka_cases.py -->"
            before, _, rest = text.partition(begin)
            text = "\n".join([before + begin, "", *rows, "", MARK + rest.partition(MARK)[2]])
        page.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
