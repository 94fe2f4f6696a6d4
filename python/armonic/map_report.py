"""The report of a survey: one HTML file with its figures, ranges and events, that opens offline."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from armonic import text
from armonic.errors import ArmonicError, SurveyError
from armonic.map_figures import sections
from armonic.map_summary import MapSummary, summarize
from armonic.page import ALLEMANG_BROWN, DO_VU_LIU, embedder, render_page
from armonic.plots.dataset import place_of, specification
from armonic.robot import Robot
from armonic.writing import write_whole

if TYPE_CHECKING:
    from armonic.map_summary import Extreme, ModeRange

REFERENCES = (
    (
        DO_VU_LIU,
        "The model (Eqs. 8 to 12), natural frequency and damping (Eqs. 16, 17), mode shapes (Eq. 18), the stability"
        " verdict (section 3.2), and the figures (Figs. 2 to 6).",
    ),
    (ALLEMANG_BROWN, "The modal assurance criterion (MAC), by which modes are followed."),
    (
        "J. L. du Bois, S. Adhikari, N. A. J. Lieven: On the quantification of eigenvalue curve veering: a veering"
        " index. Journal of Applied Mechanics, 2011.",
        "Crossing and veering told apart by how shapes turn.",
    ),
)
"""What a map rests on, and for what."""

MOST_EVENTS = 24
"""Crossings and veerings beyond this are listed by the modes that meet."""


def write_map_report(ds: xr.Dataset, path: str | Path, *, robot: Robot | None = None, title: str | None = None) -> Path:
    """Write the report of a survey: figures, the range of every mode, crossings and veerings, and where it is from.

    What is drawn follows the dims: over a path, the robot, frequencies, damping and mode shapes (Do et al. 2022, Figs.
    2, 3, 4, 6); over a parameter, frequencies beside damping (Fig. 5); over a grid, heat maps of the lowest modes; of a
    sample, frequencies over each joint. Large surveys are thinned for drawing, which the figures say; numbers in tables
    come from all of it.

    Args:
        ds: what `armonic.survey` returned, or a store of it that was opened.
        path: the HTML file to write; it is replaced whole or not at all.
        robot: the robot of the survey; by default it is read from the text that the dataset carries, which does if
            that names no other file.
        title: the heading; by default "Modal map" and the robot's name.

    Returns:
        The path.

    Raises:
        SurveyError: the dataset is no survey, or one of another robot.
        DataFileError: the file cannot be written.
    """
    target = Path(path)
    page = render(ds, robot=robot, title=title)
    write_whole(target, page.encode("utf-8", "replace"))  # a name may hold half a character
    return target


def render(ds: xr.Dataset, *, robot: Robot | None = None, title: str | None = None) -> str:
    """The report as a text of HTML; `write_map_report` writes it to a file."""
    summary = summarize(ds)
    file = str(ds.attrs.get("robot_file", ""))
    robot = _robot(file, robot)
    name = str(ds.attrs.get("robot", robot.name if robot else "unknown"))
    places = _Places(ds)
    content = {
        "title": title or f"Modal map: {name}",
        "robot_name": name,
        "robot_source": robot.source if robot else None,
        "file": robot.path.name if robot and robot.path else None,
        "summary": _lead(ds, summary),
        "doubts": [_unstable(summary, places)] if summary.unstable else [],
        "tiles": _tiles(summary, places),
        "sections": sections(ds, summary.layout, robot, embedder()),
        "ranges": [_range_row(mode, places) for mode in summary.modes],
        "real": _real(summary),
        "events": _event_rows(summary, places),
        "events_text": _events_text(summary),
        "stability": _stability(summary),
        "computation": _computation(ds, summary),
        "references": REFERENCES,
        "spec": [(key, _shortened(value)) for key, value in specification(ds).items()],
        "robot_file": file,
        "made_by": str(ds.attrs.get("armonic", "of unknown version")),
    }
    return render_page("map_report.html.j2", content, libraries={"xarray": xr.__version__})


def _robot(file: str, given: Robot | None) -> Robot | None:
    """The robot given, or the one in the dataset; None where its text does not stand alone."""
    if given is not None:
        if file and given.to_yaml() != file:
            hint = "Give the robot that was surveyed, or none: the dataset carries the text of its file."
            raise SurveyError("robot", found=f"another robot or other numbers ({given.name})", expected="the robot of"
                              " the survey", hint=hint)  # fmt: skip
        return given
    try:
        return Robot.from_yaml(file) if file else None
    except ArmonicError:
        return None


@dataclass
class _Places:
    """Places in words."""

    ds: xr.Dataset
    known: dict[tuple[int, ...], str] = field(default_factory=dict)

    def of(self, at: dict[str, int]) -> str:
        key = tuple(at.values())
        if key not in self.known:
            self.known[key] = place_of(self.ds, at)
        return self.known[key]


def _lead(ds: xr.Dataset, summary: MapSummary) -> str:
    low = min(mode.slowest.value for mode in summary.modes)
    high = max(mode.fastest.value for mode in summary.modes)
    least = min(mode.least_damped.value for mode in summary.modes)
    most = max(mode.most_damped.value for mode in summary.modes)
    layout, sizes = summary.layout, ds.sizes
    where = {
        "path": "along a path of {}",
        "sample": "at a sample of {}",
        "grid": "over a grid of {}",
        "sweep": "at one posture",
    }[layout.kind].format(text.count(int(np.prod([sizes[axis] for axis in layout.axes])), "posture"))
    if layout.kind == "grid" and len(layout.axes) > 1:
        where += f" ({' × '.join(str(sizes[axis]) for axis in layout.axes)})"
    cases = f", for {text.count(sizes[layout.sweep], 'value')} of {layout.sweep}" if layout.sweep else ""
    return (
        f"{text.count(len(summary.modes), 'mode')} {where}{cases}: natural frequencies from {text.format_hz(low)} to"
        f" {text.format_hz(high)} Hz, damping ratios from {text.format_percent(least)} to {text.format_percent(most)}."
        f"{'' if summary.unstable else f' {_stability(summary)}'}"
    )


def _stability(summary: MapSummary) -> str:
    if summary.unstable is None:
        return "The survey does not say whether the robot is stable."
    of_all = f"of {text.count(summary.count, 'place')}"
    if summary.unstable:
        return f"The robot is unstable at {summary.unstable} {of_all}."
    if summary.marginal:
        return f"The robot is marginally stable at {summary.marginal} {of_all}, nowhere unstable."
    return "The robot is asymptotically stable everywhere."


def _unstable(summary: MapSummary, places: _Places) -> str:
    first = f" First at {places.of(summary.first_unstable)}." if summary.first_unstable else ""
    return f"{_stability(summary)}{first}"


def _tiles(summary: MapSummary, places: _Places) -> list[tuple[str, str, str]]:
    def tile(name: str, extreme: Extreme, value: str) -> tuple[str, str, str]:
        return name, value, f"at {places.of(extreme.at)}"

    lowest = min((mode.slowest for mode in summary.modes), key=lambda e: e.value)
    highest = max((mode.fastest for mode in summary.modes), key=lambda e: e.value)
    least = min((mode.least_damped for mode in summary.modes), key=lambda e: e.value)
    return [
        tile("Lowest frequency", lowest, f"{text.format_hz(lowest.value)} Hz"),
        tile("Highest frequency", highest, f"{text.format_hz(highest.value)} Hz"),
        tile("Least damping", least, text.format_percent(least.value)),
        ("Modes", str(len(summary.modes)), _totals(summary)),
    ]


def _range_row(mode: ModeRange, places: _Places) -> dict[str, Any]:
    frequencies = [(text.format_hz(e.value), places.of(e.at)) for e in (mode.slowest, mode.fastest)]
    damping = [
        (text.format_si(100 * e.value, digits=3), places.of(e.at)) for e in (mode.least_damped, mode.most_damped)
    ]
    return {"number": mode.number, "extremes": [*frequencies, *damping]}


def _real(summary: MapSummary) -> str:
    """Which modes do not vibrate, in a sentence; empty if all do everywhere."""
    words = [
        f"mode {mode.number}"
        f" ({'everywhere' if mode.real == 1 else f'{text.format_percent(mode.real, digits=2)} of the places'})"
        for mode in summary.modes
        if mode.real
    ]
    return f"The pole is real, so that nothing vibrates, in {text.listing(words)}." if words else ""


def _event_rows(summary: MapSummary, places: _Places) -> list[dict[str, str]]:
    """One row per event or, where there are many, per modes that meet."""
    if len(summary.events) <= MOST_EVENTS and len(summary.events) == sum(summary.totals.values()):
        return [
            {
                "name": event.name,
                "modes": _meeting(event.modes),
                "freq": text.format_hz(event.freq_hz),
                "place": places.of(event.at),
            }
            for event in summary.events
        ]
    return [
        {
            "name": pair.name if pair.count == 1 else f"{pair.name}, {pair.count} places",
            "modes": _meeting(pair.modes),
            "freq": " to ".join(dict.fromkeys(text.format_hz(f) for f in (pair.low_hz, pair.high_hz))),
            "place": f"first at {places.of(pair.first)}",
        }
        for pair in summary.pairs
    ]


def _meeting(modes: tuple[int, ...]) -> str:
    """Which modes meet; where three do so at once, only one may be marked."""
    return text.listing([str(mode) for mode in modes]) if len(modes) > 1 else f"{modes[0]} and another"


def _totals(summary: MapSummary) -> str:
    found = [text.count(number, name) for name, number in summary.totals.items() if number]
    return text.listing(found) or "no modes cross or veer"


def _events_text(summary: MapSummary) -> str:
    if not sum(summary.totals.values()):
        return "No modes cross or veer."
    return (
        f"{_totals(summary)}. Modes that cross pass each other with their shapes unchanged; modes that veer turn away"
        " and trade shapes, so that a number after a veering stands for another motion than before."
    )


def _computation(ds: xr.Dataset, summary: MapSummary) -> str:
    parts = []
    if summary.dense is not None:
        followed = summary.count - summary.dense
        parts.append(
            f"Of {text.count(summary.count, 'place')}, {followed} by continuation from a neighbour and {summary.dense}"
            " by the dense solver."
        )
    if np.isfinite(summary.residual):
        name = str(ds["residual"].attrs.get("long_name", "largest residual"))
        parts.append(f"{name[:1].upper()}{name[1:]}: {text.format_si(summary.residual, digits=2)}.")
    return " ".join(parts)


def _shortened(value: Any) -> str:
    """A value of the spec as JSON, long lists by their ends."""
    if isinstance(value, list) and len(value) > 12:
        return f"[{json.dumps(value[0])}, {json.dumps(value[1])}, …, {json.dumps(value[-1])}] ({len(value)} values)"
    if isinstance(value, dict) and value:
        return f"{{{', '.join(f'{json.dumps(key)}: {_shortened(entry)}' for key, entry in value.items())}}}"
    return json.dumps(value, ensure_ascii=False)
