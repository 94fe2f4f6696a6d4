"""The report of an identification: one HTML file with its modes, diagrams and what it did not take for modes."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armonic import identification_tables as tables
from armonic import text
from armonic.comparison import compare
from armonic.modal import mac
from armonic.page import ALLEMANG_BROWN, DO_VU_LIU, embedder, render_page
from armonic.plots.matrices import mac_matrix
from armonic.plots.series import MAX_CHANNELS, time_histories
from armonic.plots.stabilization import stabilization_diagram
from armonic.series import ROBOT_FILE
from armonic.writing import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable

    import plotly.graph_objects as go
    from markupsafe import Markup

    from armonic.comparison import Comparison
    from armonic.identification.oma import OmaResult
    from armonic.modal import Modes

    Embed = Callable[[go.Figure], Markup]

METHODS = {
    "var": "vector autoregression (VAR)",
    "ssi": "covariance-driven stochastic subspace identification (SSI)",
}
"""What identified the modes, by its short name."""
MOST_PANELS = 12
"""Up to so many channels have a panel each; more share one axis per quantity."""

_REYNDERS = (
    "E. Reynders, J. Houbrechts, G. De Roeck: Fully automated (operational) modal analysis. Mechanical Systems and"
    " Signal Processing, 2012.",
    "The criteria by which a pole is stable or not; mean phase deviation (MPD).",
)
_VAR = (
    "V.-H. Vu, M. Thomas, A. A. Lakis, L. Marcouiller: Operational modal analysis by updating autoregressive model."
    " Mechanical Systems and Signal Processing, 2011.",
    "The vector autoregression, and the order modal assurance criterion (OMAC).",
)
_SSI = (
    "B. Peeters, G. De Roeck: Reference-based stochastic subspace identification for output-only modal analysis."
    " Mechanical Systems and Signal Processing, 1999.",
    "The subspace identification.",
)
_COMMON = (
    (DO_VU_LIU, "Output-only identification of a robot (section 4.3) and its figures (Figs. 7 to 9, B.1 to B.3)."),
    _REYNDERS,
    (ALLEMANG_BROWN, "The modal assurance criterion (MAC)."),
    (
        "R. S. Pappa, K. B. Elliott, A. Schenk: Consistent-mode indicator for the eigensystem realization algorithm."
        " Journal of Guidance, Control, and Dynamics, 1993.",
        "Modal phase collinearity (MPC).",
    ),
)


def write_identification_report(
    result: OmaResult, path: str | Path, reference: Modes | None = None, *, title: str | None = None
) -> Path:
    """Write the report of an identification: modes beside a model's, stabilization diagrams, MAC, and how it was made.

    Args:
        result: what `armonic.oma` returned.
        path: the HTML file to write; it is replaced whole or not at all.
        reference: modes of a model, which those identified are paired with by `armonic.compare`; what has no partner on
            either side is said.
        title: the heading; by default "Identified modes" and the robot's name, if the series notes one.

    Returns:
        The path.

    Raises:
        DataFileError: the file cannot be written.
    """
    target = Path(path)
    page = render(result, reference, title=title)
    write_whole(target, page.encode("utf-8", "replace"))  # a name may hold half a character
    return target


def render(result: OmaResult, reference: Modes | None = None, *, title: str | None = None) -> str:
    """The report as a text of HTML; `write_identification_report` writes it to a file."""
    embed = embedder()
    robot = result.series.notes.get("robot", "")
    comparison = compare(result, reference) if reference is not None and result.modes else None
    few = len(result.series.channels) <= MOST_PANELS
    content = {
        "title": title or f"Identified modes{f': {robot}' if robot else ''}",
        "robot_name": robot or "not noted in the series",
        "robot_source": None,
        "file": result.series.notes.get("file"),
        "summary": _lead(result),
        "doubts": _doubts(result),
        "tiles": _tiles(result, comparison),
        "modes": tables.mode_rows(result, reference, comparison),
        "aliased": _aliased(result),
        "compared": reference is not None,
        "partners": tables.partner_words(result, reference, comparison),
        "posture": reference.posture if reference is not None else "",
        "diagrams": _diagrams(result, reference, embed),
        "macs": _macs(result, reference, comparison, embed),
        "histories": embed(time_histories(result.series, by="channel" if few else "quantity", about="mean")),
        "history_words": _history_words(result),
        "rejected": tables.rejected_rows(result),
        "made_rows": _how(result),
        "exact": tables.exact_rows(result),
        "shapes": tables.shape_rows(result),
        "channels": result.channels,
        "references": (*_COMMON, _VAR if result.method == "var" else _SSI),
    }
    return render_page("identification_report.html.j2", content)


def _orders(result: OmaResult) -> str:
    low, high = result.orders
    unit = "model orders" if result.method == "var" else "numbers of states"
    return f"{unit} {low} to {high}"


def _span(values: list[float]) -> tuple[float, float]:
    return min(values), max(values)


def _lead(result: OmaResult) -> str:
    series = result.series
    data = (
        f"from {text.count(len(result.channels), 'channel')} of {text.count(len(series), 'sample')} at"
        f" {text.format_si(series.sample_rate_hz, 'Hz')} by {METHODS[result.method]}, {_orders(result)}"
    )
    if not result.modes:
        return f"No modes were identified {data}."
    low, high = _span([mode.natural_freq_hz for mode in result.modes])
    least, most = _span([mode.damping_ratio for mode in result.modes])
    return (
        f"{text.count(len(result.modes), 'mode')} identified {data}: natural frequencies from {text.format_hz(low)} to"
        f" {text.format_hz(high)} Hz, damping ratios from {text.format_percent(least)} to {text.format_percent(most)}."
    )


def _doubts(result: OmaResult) -> list[str]:
    if not result.modes:
        return ["Nothing held over enough model orders to be a mode. The rejected clusters below say why, one by one."]
    told = []
    for number, (mode, flag) in enumerate(zip(result.modes, result.harmonics, strict=True), 1):
        if flag.is_harmonic:
            freq = text.format_hz(mode.natural_freq_hz)
            told.append(f"Mode {number} at {freq} Hz may be no mode but a harmonic of the excitation: {flag.reason}.")
    return told


def _aliased(result: OmaResult) -> str:
    """A word on modes faster than half the sampling rate, if there are any."""
    half = result.series.sample_rate_hz / 2
    fast = [str(number) for number, mode in enumerate(result.modes, 1) if mode.natural_freq_hz > half]
    if not fast:
        return ""
    modes = f"{'Mode' if len(fast) == 1 else 'Modes'} {text.listing(fast)}"
    return (
        f"{modes}: natural frequency above half the sampling rate, {text.format_si(half, 'Hz')}. The damped one cannot"
        " come out above that; a faster one is folded back, which shifts frequency and damping."
    )


def _tiles(result: OmaResult, comparison: Comparison | None) -> list[tuple[str, str, str]]:
    """The numbers to read first."""
    stable, total = int(np.count_nonzero(result.stabilization.stable)), len(result.stabilization.order)
    tiles = [
        ("Modes", str(len(result.modes)), f"{text.count(len(result.rejected), 'cluster')} rejected"),
        ("Stable poles", str(stable), f"of {total}, {_orders(result)}"),
    ]
    if comparison is not None and comparison.pairs:
        worst = max(abs(pair.freq_difference) for pair in comparison.pairs)
        apart = max(abs(pair.damping_difference) for pair in comparison.pairs)
        pairs = f"in {text.count(len(comparison.pairs), 'pair')} with the model"
        return [
            *tiles,
            ("Largest frequency difference", text.format_percent(worst, digits=2), pairs),
            ("Largest damping difference", f"{text.format_si(100 * apart, digits=2)} points", pairs),
        ]
    duration = (len(result.series) - 1) / result.series.sample_rate_hz
    return [
        *tiles,
        ("Data", f"{text.format_si(duration, digits=3)} s", f"{text.count(len(result.channels), 'channel')}"),
        ("Computed in", text.format_duration(result.seconds), METHODS[result.method]),
    ]


def _diagrams(result: OmaResult, reference: Modes | None, embed: Embed) -> list[tuple[str, Markup]]:
    poles, modes = result.stabilization, result.modes
    return [
        ("Over natural frequency", embed(stabilization_diagram(poles, modes, reference=reference))),
        ("Over damping ratio", embed(stabilization_diagram(poles, modes, what="damping", reference=reference))),
    ]


def _macs(
    result: OmaResult, reference: Modes | None, comparison: Comparison | None, embed: Embed
) -> list[tuple[str, Markup]]:
    """MAC with the model where both have shapes at the same places, and of the identified modes among themselves."""
    if not result.modes:
        return []
    own = tables.frequency_labels([mode.natural_freq_hz for mode in result.modes])
    shapes = np.stack([mode.shape for mode in result.modes], axis=1)
    found = []
    if comparison is not None and reference is not None and comparison.mac is not None:
        known = np.isfinite(comparison.mac)  # of a mode without a shape a whole row or column is not
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if rows.size:
            cross, other = comparison.mac[np.ix_(rows, columns)], tables.frequency_labels(reference.natural_freq_hz)
            labels = [own[i] for i in rows], [other[k] for k in columns]
            figure = mac_matrix(cross, *labels, row_title="identified", column_title="model")
            found.append(("identified against the model", embed(figure)))
    if np.isfinite(shapes).all() and (np.abs(shapes).max(axis=0) > 0).all():
        figure = mac_matrix(mac(shapes, shapes), own, own, row_title="identified", column_title="identified")
        found.append(("identified among themselves", embed(figure)))
    return found


def _history_words(result: OmaResult) -> str:
    series = result.series
    told = "The channels as they were identified from, after preprocessing, each less its mean; angles in degrees."
    if len(series.channels) > MAX_CHANNELS:
        told += f" The first {MAX_CHANNELS} of {len(series.channels)} are drawn."
    return told


def _how(result: OmaResult) -> list[tuple[str, str]]:
    """All that a reader needs to do it again."""
    series, stabilization = result.series, result.stabilization
    limits = [
        f"{field.name} = {value!r}"
        for field in fields(stabilization.criteria)
        if (value := getattr(stabilization.criteria, field.name)) is not None
    ]
    off = [f.name for f in fields(stabilization.criteria) if getattr(stabilization.criteria, f.name) is None]
    spread = ", ".join(f"{channel.label} ({channel.unit or 'no unit'})" for channel in series.channels)
    return [
        ("method", METHODS[result.method]),
        ("orders", _orders(result)),
        ("series", spread),
        ("samples", f"{len(series)} at {series.sample_rate_hz!r} Hz, from {series.start_s!r} s"),
        ("channels", ", ".join(result.channels)),
        ("criteria", ", ".join(limits) or "none"),
        *([("criteria off", ", ".join(off))] if off else []),
        ("poles", f"{len(stabilization.order)}, of which {int(np.count_nonzero(stabilization.stable))} stable"),
        ("computed in", text.format_duration(result.seconds)),
        *((f"note: {name}", note) for name, note in series.notes.items() if name != ROBOT_FILE),
    ]
