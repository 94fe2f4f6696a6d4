"""The report of a fit: one HTML file that holds everything it shows and opens offline."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from armonic import plots, text
from armonic import report_tables as tables
from armonic.assurance import frac
from armonic.errors import ArmonicError
from armonic.modal import mac
from armonic.page import ALLEMANG_BROWN, DO_VU_LIU, embedder, render_page
from armonic.updating.bands import frf_bands, intervals_after, student
from armonic.updating.directions import directions, sloppy
from armonic.updating.uncertainty import IDENTIFIED_FACTOR, WEAK_FACTOR
from armonic.writing import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import plotly.graph_objects as go
    from markupsafe import Markup
    from numpy.typing import NDArray

    from armonic.modal import Modes
    from armonic.response import Frf
    from armonic.updating import Fit, Measurement
    from armonic.updating.bands import FrfBands
    from armonic.updating.profile import Profile

MOST_DIRECTIONS = 6
"""So many sloppy directions are put into words."""
REFERENCES = (
    (
        "H. N. Huynh, H. Assadi, V. Dambly, E. Rivière-Lorphèvre, O. Verlinden: Direct method for updating"
        " flexible multibody systems applied to a milling robot. Robotics and Computer-Integrated"
        " Manufacturing, 2021.",
        "The frequency responses (Eqs. 21 to 28), the cost of the fit (Eq. 22), damped frequencies (Eq. 20).",
    ),
    (DO_VU_LIU, "The linear model (Eq. 12), natural frequencies (Eq. 16), the stability verdict (section 3.2)."),
    (ALLEMANG_BROWN, "The modal assurance criterion (MAC)."),
    (
        "W. Heylen, S. Lammens: FRAC: a consistent way of comparing frequency response functions. Proceedings of the"
        " International Conference on Identification in Engineering Systems, 1996.",
        "The frequency response assurance criterion (FRAC).",
    ),
    (
        "J. J. Moré: The Levenberg-Marquardt algorithm, implementation and theory. Numerical Analysis, 1978.",
        "The trust region of the least squares.",
    ),
    ("P. L. Duren: Theory of H^p Spaces. 1970.", "Responses smoothed off the imaginary axis (chapter 11)."),
    (
        "H. White: A heteroskedasticity-consistent covariance matrix estimator and a direct test for"
        " heteroskedasticity. Econometrica, 1980.",
        "Intervals under weights that are not those of the noise.",
    ),
    (
        "R. N. Gutenkunst et al.: Universally sloppy parameter sensitivities in systems biology models. PLoS"
        " Computational Biology, 2007.",
        "Stiff and sloppy directions.",
    ),
)
"""What a fit rests on, and for what."""


def write_report(fit: Fit, path: str | Path, *, title: str | None = None, profiles: Sequence[Profile] = ()) -> Path:
    """Write the report of a fit: responses, cost, parameters, what the data determine, modes, and what they rest on.

    Args:
        fit: what `armonic.update` returned.
        path: the HTML file to write; it is replaced whole or not at all.
        title: the heading; by default "Model update" and the robot's name.
        profiles: profile likelihoods to show, from `armonic.profile`.

    Returns:
        The path.

    Raises:
        DataFileError: the file cannot be written.

    """
    target = Path(path)
    page = render(fit, title=title, profiles=profiles)
    write_whole(target, page.encode("utf-8", "replace"))  # a label may hold half a character
    return target


def render(fit: Fit, *, title: str | None = None, profiles: Sequence[Profile] = ()) -> str:
    """The report as a text of HTML; `write_report` writes it to a file."""
    embed = embedder()
    content = {
        "title": title or f"Model update: {fit.start.name}",
        "robot_name": fit.start.name,
        "robot_source": fit.start.source,
        "file": fit.start.path.name if fit.start.path else None,
        "summary": text.summary(fit),
        "status": fit.status,
        "doubts": fit.doubts,
        "tiles": _tiles(fit),
        "counts": {verdict: number for verdict, number in text.verdict_counts(fit).items() if number},
        "measurements": [_measurement(fit, k, embed) for k in range(len(fit.measurements))],
        "cost_figure": embed(plots.cost_history(fit)),
        "cost_words": tables.cost_words(fit),
        "starts": tables.starts_words(fit),
        "measured_modes": tables.modal_tables(fit),
        "parameters": tables.parameter_rows(fit),
        "signed": tables.has_signed(fit),
        "interval_figures": [embed(figure) for figure in _intervals(fit)],
        "identified": f"{100 * (IDENTIFIED_FACTOR - 1):g} %",
        "weak": f"{WEAK_FACTOR:g}",
        "noise": text.noise_words(fit),
        "determined": _determined(fit, embed),
        "profiles": [_profile(fit, profile, embed) for profile in profiles],
        "postures": [_posture(fit, k, embed) for k in range(len(fit.postures))],
        "references": REFERENCES,
        "message": fit.message,
        "record": tables.record_rows(fit),
    }
    return render_page("report.html.j2", content)


def _intervals(fit: Fit) -> list[go.Figure]:
    """A figure of the positive parameters, and one of those that may be zero or negative, where there are any."""
    drawn = {"log": plots.parameter_intervals, "linear": plots.bounded_intervals}
    return [draw(fit) for scale, draw in drawn.items() if any(p.scale == scale for p in fit.parameters)]


def _tiles(fit: Fit) -> list[tuple[str, str, str]]:
    """The figures to read first: name, value, and what it was before or rests on."""
    good = text.verdict_counts(fit)["identified"]
    effort = f"{text.count(fit.evaluations, 'evaluation')} in {text.format_duration(fit.duration_s)}"
    cost = ("Cost", text.format_si(fit.cost), f"{text.format_si(fit.start_cost)} before")
    determined = ("Parameters identified", f"{good} of {len(fit.parameters)}", effort)
    if not fit.measurements:  # of modes alone
        return [cost, determined]
    measured = [m.frf for m in fit.measurements]
    after, before = (_deviation(measured, side) for side in (fit.frf_after, fit.frf_before))
    return [
        cost,
        (
            "Median deviation, magnitude",
            text.format_percent(after[0]),
            f"{text.format_percent(before[0])} before",
        ),
        ("Median deviation, phase", _degrees(after[1]), f"{_degrees(before[1])} before"),
        determined,
    ]


def _degrees(angle: float) -> str:
    return f"{text.format_si(angle, digits=3)}°"


def _deviation(measured: Sequence[Frf], model: Sequence[Frf]) -> tuple[float, float]:
    """Medians over all values: relative difference in magnitude, difference in phase in degrees."""
    ratios = []
    for one, other in zip(measured, model, strict=True):
        usable = (one.values != 0) & (other.values != 0)
        with np.errstate(over="ignore"):
            ratios.append(other.values[usable] / one.values[usable])
    ratio = np.concatenate(ratios)
    if not ratio.size:
        return np.nan, np.nan
    return float(np.median(np.abs(np.abs(ratio) - 1))), float(np.median(np.abs(np.degrees(np.angle(ratio)))))


def _measurement(fit: Fit, k: int, embed: Callable[[go.Figure], Markup]) -> dict[str, Any]:
    m, before, after = fit.measurements[k], fit.frf_before[k], fit.frf_after[k]
    f = m.frf.freq_hz
    band = f"{text.format_si(f[0], digits=3)} to {text.format_si(f[-1], digits=3)} Hz"
    new, old = _deviation([m.frf], [after]), _deviation([m.frf], [before])
    figure = plots.frf_matrix(
        {"measured": m.frf, "before": before, "after": after}
        if m.raw is None
        else {"measured": m.raw, "synthesized": m.frf, "after": after}
    )
    fitted = "measurement" if m.raw is None else "synthesized responses"
    bands = _bands(fit, m)
    if bands is not None:
        plots.add_bands(figure, bands)
    return {
        "label": m.label,
        "facts": (
            f"{m.frf.kind.capitalize()} at frame {m.frame}, posture {_posture_text(m)}; "
            f"{text.count(f.size, 'line')} from {band}"
            + ("" if m.raw is None else ", synthesized from the modes that were identified in the measured responses")
        ),
        "deviation": (
            f"Median deviation from the {fitted}: {text.format_percent(new[0])} in magnitude and "
            f"{_degrees(new[1])} in phase (before: {text.format_percent(old[0])} and {_degrees(old[1])})."
        ),
        "figure": embed(figure),
        "band": _band_words(bands) if bands is not None else "",
        "inputs": m.frf.inputs,
        "frac": _frac(m, before, after),
    }


def _bands(fit: Fit, m: Measurement) -> FrfBands | None:
    """What the parameters' intervals make of the fitted responses; None if nothing can be said."""
    H, options = m.frf, {"frame": m.frame, "kind": m.frf.kind, "input_frame": m.frf.input_frame}
    try:
        return frf_bands(fit, m.posture, H.freq_hz, outputs=H.outputs, inputs=H.inputs, **options)  # type: ignore[arg-type]
    except ArmonicError:
        return None


def _band_words(bands: FrfBands) -> str:
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(bands.low > 0, np.sqrt(bands.high / bands.low), 1.0)
    line, a, b = (int(i) for i in np.unravel_index(np.argmax(factor), factor.shape))
    middle, widest = (text.format_spread(1 / f, f) for f in (float(np.median(factor)), float(factor[line, a, b])))
    place = f"H_{bands.frf.outputs[a]}{bands.frf.inputs[b]} at {bands.frf.freq_hz[line]:.4g} Hz"
    told = (
        "The 95 % band is what the parameters' intervals make of the fitted magnitude and phase; its half width is "
        f"{middle} of the magnitude in the median and {widest} at most, in {place}."
    )
    if share := float(np.mean(bands.open)):
        told += f" In {text.format_percent(share, digits=2)} of the values bounds hold it rather than data."
    return told


def _frac(m: Measurement, before: Frf, after: Frf) -> list[tuple[str, list[str]]]:
    """FRAC of every response before and after, by rows of the matrix."""
    used = m.line_weights() > 0
    old, new = (frac(m.frf, replace(m.frf, values=side.values), used=used) for side in (before, after))
    return [
        (output, [f"{old[a, b]:.3f} → {new[a, b]:.3f}".replace("nan", "–") for b in range(old.shape[1])])
        for a, output in enumerate(m.frf.outputs)
    ]


def _determined(fit: Fit, embed: Callable[[go.Figure], Markup]) -> dict[str, Any]:
    """Directions in words and as a picture, and correlations; of one parameter, or no noise, there are none."""
    if len(fit.coordinates) < 2 or student(fit) is None:
        return {}
    found = directions(fit)
    loose = sloppy(found)
    return {
        "sloppy": [d.words for d in loose[:MOST_DIRECTIONS]],
        "more": max(len(loose) - MOST_DIRECTIONS, 0),
        "best": found[0].words,
        "worst": found[-1].words,
        "figure": embed(plots.principal_directions(fit)),
        "correlations": embed(plots.correlation_matrix(fit)),
    }


def _profile(fit: Fit, profile: Profile, embed: Callable[[go.Figure], Markup]) -> dict[str, Any]:
    known = next((p for p in fit.parameters if p.path == profile.path), None)
    signed = known is not None and known.scale == "linear"
    return {
        "path": profile.path,
        "interval": text.format_interval(*profile.interval, signed=signed),
        "linear": text.format_interval(*known.interval, signed=signed) if known else "–",
        "unit": tables.unit_words(profile.unit),
        "figure": embed(plots.profile_curve(profile)),
    }


def _posture_text(measurement: Measurement) -> str:
    posture: Any = measurement.posture
    if isinstance(posture, str):
        return posture
    if hasattr(posture, "items"):
        return ", ".join(f"{name} = {value}" for name, value in posture.items())
    return f"[{', '.join(str(value) for value in np.asarray(posture).tolist())}]"


def _posture(fit: Fit, k: int, embed: Callable[[go.Figure], Markup]) -> dict[str, Any]:
    before, after, cross = fit.before[k], fit.after[k], fit.mac[k]
    old, new = _frequencies(before), _frequencies(after)
    partner = dict(zip(*(index.tolist() for index in linear_sum_assignment(-cross.T)), strict=True))
    rows: list[dict[str, Any]] = [
        {
            "mac": f"{cross[partner[j], j]:.2f}" if j in partner else "–",
            "before": _mode(before, partner[j]) if j in partner else None,
            "after": _mode(after, j),
        }
        for j in range(len(after))
    ]
    for row, interval in zip(rows, _modal_intervals(fit, k), strict=False):
        row["after"] |= interval
    lost = sorted(set(range(len(before))) - set(partner.values()))
    rows += [{"mac": "–", "before": _mode(before, i), "after": None} for i in lost]
    return {
        "name": fit.postures[k],
        "rows": rows,
        "stability": {"before": before.stability, "after": after.stability},
        "figures": [
            ("after against before", embed(plots.mac_matrix(cross, old, new, **_titles("before")))),
            (
                "after against itself",
                embed(plots.mac_matrix(mac(after, after), new, new, **_titles("after"))),
            ),
        ],
    }


def _modal_intervals(fit: Fit, k: int) -> list[dict[str, str]]:
    """Half intervals of natural frequency and damping ratio of the modes after; none if they cannot be told."""
    found = intervals_after(fit, k)
    if found is None:
        return []
    return [
        {
            "natural_spread": _half(*found.natural_freq_hz[i], held=found.open[i, 0]),
            "damping_spread": _half(*found.damping_ratio[i], held=found.open[i, 1]),
        }
        for i in range(len(found.modes))
    ]


def _half(low: float, high: float, *, held: bool) -> str:
    return f"{text.format_spread(low, high)}{' *' if held else ''}" if high > low > 0 else ""


def _titles(rows: str) -> dict[str, str]:
    return {"row_title": rows, "column_title": "after"}


def _frequencies(modes: Modes) -> list[str]:
    frequencies: NDArray[np.float64] = modes.natural_freq_hz
    return [f"{f:.1f} Hz" if f >= 1 else text.format_si(float(f), "Hz", digits=2) for f in frequencies]


def _mode(modes: Modes, i: int) -> dict[str, str]:
    movers = [f"{name} {100 * share:.0f} %".replace(" ", "\N{NO-BREAK SPACE}") for name, share in modes.movers(i)]
    return {
        "natural": text.format_hz(float(modes.natural_freq_hz[i])),
        "damped": text.format_hz(float(modes.damped_freq_hz[i])) if modes.oscillatory[i] else "real pole",
        "damping": text.format_si(100 * float(modes.damping_ratio[i]), digits=3),
        "movers": ", ".join(movers) or "–",
        "natural_spread": "",
        "damping_spread": "",
    }
