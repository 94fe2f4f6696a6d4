"""The report of a run in time: one HTML file with the history of every quantity."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from armonic.page import DO_VU_LIU, embedder, render_page
from armonic.plots.series import MAX_CHANNELS, time_histories
from armonic.series import ROBOT_FILE
from armonic.text import count, format_si
from armonic.writing import write_whole

if TYPE_CHECKING:
    from armonic.series import TimeSeries

_ABOUT_START = ("joint_position", "motor_position", "motor_torque", "shaft_torque")
"""Quantities whose channels stand far apart even at rest."""


def write_run_report(series: TimeSeries, path: str | Path, *, title: str | None = None) -> Path:
    """Write time histories of a run, or of a measurement, to a page that opens offline.

    Args:
        series: any channels; a figure per quantity.
        path: the HTML file; it is replaced whole or not at all.
        title: the heading; by default the robot and posture that the series notes.

    Returns:
        The path.

    Raises:
        DataFileError: the file cannot be written.
    """
    target = Path(path)
    write_whole(target, render(series, title=title).encode("utf-8", "replace"))
    return target


def render(series: TimeSeries, *, title: str | None = None) -> str:
    """The page as a text of HTML."""
    embed = embedder()
    robot = series.notes.get("robot", "")
    sections: list[dict[str, Any]] = []
    for quantity in dict.fromkeys(channel.quantity for channel in series.channels):
        count_of_this = sum(channel.quantity == quantity for channel in series.channels)
        words = quantity.replace("_", " ")
        about_mean = quantity in _ABOUT_START
        told = ["Each channel less its mean."] if about_mean else []
        if count_of_this > MAX_CHANNELS:
            told.append(f"The first {MAX_CHANNELS} of {count_of_this} channels.")
        figure = time_histories(series, quantity, about="mean" if about_mean else "zero")
        sections.append({"title": words[:1].upper() + words[1:], "text": " ".join(told), "figure": embed(figure)})
    content = {
        "title": title or (f"{robot}, posture {series.notes.get('posture', 'not noted')}" if robot else "Time series"),
        "robot_name": robot or "not noted in the series",
        "robot_source": None,
        "file": None,
        "summary": (
            f"{count(len(series), 'sample')} of {count(len(series.channels), 'channel')} at"
            f" {format_si(series.sample_rate_hz, 'Hz')}, {format_si(series.duration_s, 's')}. Angles in degrees."
        ),
        "sections": sections,
        "notes": [(name, text) for name, text in series.notes.items() if name != ROBOT_FILE],
        "references": ((DO_VU_LIU, "The equations of motion and figures of this kind (Figs. 7, B.1 and B.2)."),),
    }
    return render_page("run_report.html.j2", content)
