"""The report of an experimental modal analysis: one HTML file from hits and responses to modes and their shapes."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic import ema_figures as figures
from armonic import ema_tables as tables
from armonic import text
from armonic.page import ALLEMANG_BROWN, embedder, render_page
from armonic.plots.indicators import mode_indicators
from armonic.plots.measured import frf_with_coherence
from armonic.plots.nyquist import nyquist
from armonic.plots.stabilization import stabilization_diagram
from armonic.series import ROBOT_FILE
from armonic.writing import write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.comparison import Comparison
    from armonic.experiment.estimation import FrfEstimate
    from armonic.files.measured_file import Geometry
    from armonic.frf_set import FrfSet
    from armonic.identification.ema import EmaResult
    from armonic.identification.refinement import Refinement
    from armonic.linear import Posture
    from armonic.modal import Modes
    from armonic.robot import Robot

METHODS = {
    "plscf": "polyreference least-squares complex frequency (pLSCF)",
    "lsce": "polyreference least-squares complex exponential (LSCE)",
}
"""What identified the poles, by its short name."""

_HUYNH = (
    "H. N. Huynh, H. Assadi, V. Dambly, E. Rivière-Lorphèvre, O. Verlinden: Direct method for updating flexible"
    " multibody systems applied to a milling robot. Robotics and Computer-Integrated Manufacturing, 2021.",
    "From a tap test to modes and synthesized responses of a robot (section 5), and the figures (Figs. 9 to 11).",
)
_PLSCF = (
    "B. Peeters, H. Van der Auweraer, P. Guillaume, J. Leuridan: The PolyMAX frequency-domain method: a new standard"
    " for modal parameter estimation? Shock and Vibration, 2004.",
    "The identification of the poles.",
)
_LSCE = (
    "H. Vold, J. Kundrat, G. T. Rocklin, R. Russell: A multi-input modal estimation algorithm for mini-computers. SAE"
    " Technical Paper 820194, 1982.",
    "The identification of the poles.",
)
_REFERENCES = (
    (
        "J. S. Bendat, A. G. Piersol: Random Data: Analysis and Measurement Procedures. 4th edition, 2010.",
        "Estimators of frequency responses, coherence, and the scatter of both.",
    ),
    (
        "W. Heylen, S. Lammens, P. Sas: Modal Analysis Theory and Testing. 1998.",
        "Residues, upper and lower residuals, modal A and modal mass.",
    ),
    (
        "R. Pintelon, P. Guillaume, J. Schoukens: Uncertainty calculation in (operational) modal analysis. Mechanical"
        " Systems and Signal Processing, 2007.",
        "Standard deviations of frequency and damping.",
    ),
    (ALLEMANG_BROWN, "The modal assurance criterion (MAC)."),
    (
        "W. Heylen, S. Lammens: FRAC: a consistent way of comparing frequency response functions. Proceedings of the"
        " International Conference on Identification in Engineering Systems, 1996.",
        "The frequency response assurance criterion (FRAC).",
    ),
    (
        "C. Y. Shih, Y. G. Tsuei, R. J. Allemang, D. L. Brown: Complex mode indication function and its applications to"
        " spatial domain parameter estimation. Mechanical Systems and Signal Processing, 1988.",
        "The complex mode indicator function (CMIF).",
    ),
    (
        "R. Williams, J. Crowley, H. Vold: The multivariate mode indicator function in modal analysis. Proceedings of"
        " the 3rd International Modal Analysis Conference, 1985.",
        "The multivariate mode indicator function (MMIF).",
    ),
    (
        "R. S. Pappa, K. B. Elliott, A. Schenk: Consistent-mode indicator for the eigensystem realization algorithm."
        " Journal of Guidance, Control, and Dynamics, 1993.",
        "Modal phase collinearity (MPC).",
    ),
)
_WINDOW = (
    "W. A. Fladung, R. Rost: Application and correction of the exponential window for frequency response functions."
    " Mechanical Systems and Signal Processing, 1997.",
    "The damping that an exponential window adds, and how it is taken off.",
)


def write_ema_report(
    result: EmaResult,
    path: str | Path,
    *,
    reference: Modes | None = None,
    robot: Robot | None = None,
    posture: Posture | None = None,
    estimate: FrfEstimate | None = None,
    geometry: Geometry | None = None,
    remarks: Sequence[str] = (),
    title: str | None = None,
) -> Path:
    """Write the report of an experimental modal analysis: responses, modes, diagrams, shapes, and how it was made.

    Args:
        result: what `armonic.ema` returned.
        path: the HTML file to write; it is replaced whole or not at all.
        reference: modes of a model, which those identified are paired with by `armonic.compare`; what has no partner on
            either side is said. With `robot`, shapes are compared as well, at the frames that were measured.
        robot: the robot, on which shapes are drawn, if measured points are frames of it.
        posture: where it stood; by default the posture of `reference`, or the only one it names.
        estimate: how the responses came from signals: hits and remarks.
        geometry: positions of points that are no frames of the robot, and lines.
        remarks: further sentences that stand first, such as what of the file was not read.
        title: the heading; by default "Identified modes" and the robot's name, if it is known.

    Returns:
        The path.

    Raises:
        DataFileError: the file cannot be written.
        PostureError: the posture does not fit the robot.
        ModelError: the reference is not over the robot's coordinates.
    """
    target = Path(path)
    page = render(
        result,
        reference=reference,
        robot=robot,
        posture=posture,
        estimate=estimate,
        geometry=geometry,
        remarks=remarks,
        title=title,
    )
    write_whole(target, page.encode("utf-8", "replace"))  # a name may hold half a character
    return target


def render(
    result: EmaResult,
    *,
    reference: Modes | None = None,
    robot: Robot | None = None,
    posture: Posture | None = None,
    estimate: FrfEstimate | None = None,
    geometry: Geometry | None = None,
    remarks: Sequence[str] = (),
    title: str | None = None,
) -> str:
    """The report as a text of HTML; `write_ema_report` writes it to a file."""
    embed = embedder()
    if robot is not None and posture is None and reference is not None and reference.posture in robot.postures:
        posture = reference.posture
    place = figures.Place(robot, posture, geometry)
    comparison = None if reference is None or not result.modes else figures.compared(result, reference, place)
    frfs, name = result.frfs, robot.name if robot is not None else result.frfs.notes.get("robot", "")
    found = bool(result.modes)
    poles, lines = (result.stabilization, result.modes), result.natural_freq_hz.tolist()
    content = {
        "title": title or f"Identified modes{f': {name}' if name else ''}",
        "robot_name": name or "not noted in the file",
        "robot_source": None if robot is None else robot.source,
        "file": frfs.notes.get("file"),
        "summary": _lead(result),
        "doubts": _doubts(result),
        "remarks": _remarks(result, estimate, remarks),
        "tiles": _tiles(result, comparison),
        "modes": tables.mode_rows(result, reference, comparison),
        "deviations": _deviation_words(result),
        "scaling": tables.scaling_rows(result) if found else [],
        "scaling_words": _scaling_words(result) if found else "",
        "compared": reference is not None,
        "partners": tables.partner_words(result, reference, comparison),
        "posture": "" if reference is None else reference.posture,
        "responses": embed(frf_with_coherence(frfs, others=figures.synthesized(result))),
        "response_words": _response_words(result),
        "frac": tables.frac_rows(result) if found else [],
        "inputs": frfs.inputs,
        "stabilization": embed(stabilization_diagram(*poles, reference=figures.within(reference, frfs), frfs=frfs)),
        "damping_diagram": embed(stabilization_diagram(*poles, what="damping")),
        "indicators": embed(mode_indicators(frfs, lines)),
        "circles": embed(nyquist(frfs, result.poles, model=result.model)) if found else None,
        "stills": figures.stills(result, reference, comparison, place, embed) if found else [],
        "shape_words": _shape_words(result, place) if found else "",
        "motions": figures.motions(result, reference, comparison, place) if found else [],
        "macs": figures.macs(result, reference, comparison, embed) if found else [],
        "hits": [] if estimate is None else tables.hit_rows(estimate),
        "rejected": tables.rejected_rows(result),
        "made_rows": _how(result, estimate),
        "exact": tables.exact_rows(result),
        "shapes": tables.shape_rows(result),
        "channels": result.channels,
        "references": _references(result),
    }
    return render_page("ema_report.html.j2", content)


def _responses(frfs: FrfSet) -> str:
    ends = f"{text.format_si(frfs.freq_hz[0], digits=3)} to {text.format_si(frfs.freq_hz[-1], 'Hz', digits=3)}"
    return f"{text.count(int(frfs.measured.sum()), 'response')} of {text.count(len(frfs.freq_hz), 'line')}, {ends}"


def _lead(result: EmaResult) -> str:
    low, high = result.orders
    by = f"from {_responses(result.frfs)}, by {METHODS.get(result.method, result.method)} of orders {low} to {high}"
    if not result.modes:
        return f"No modes were identified {by}."
    refined = "" if result.refinement is None else ", refined by a fit of maximum likelihood"
    return (
        f"{text.count(len(result.modes), 'mode')} identified {by}{refined}: natural frequencies"
        f" {tables.span_hz(result.natural_freq_hz)}, damping ratios {tables.span_percent(result.damping_ratio)}."
    )


def _doubts(result: EmaResult) -> list[str]:
    if not result.modes:
        return ["Nothing held over enough model orders to be a mode. The rejected clusters below say why, one by one."]
    poor = tables.poor_words(result)
    return [*([poor] if poor else []), *tables.defect_words(result)]


def _remarks(result: EmaResult, estimate: FrfEstimate | None, further: Sequence[str]) -> list[str]:
    told = list(further)
    told += list(estimate.remarks) if estimate is not None else []
    told += [_sentence(words) for words in result.remarks]
    if result.refinement is not None:
        told += [_sentence(words) for words in _ended(result.refinement)]
    if result.modes:
        told += [_sentence(words) for words in result.scaling.remarks]
    if result.frfs.decay_rate and not any("exponential window" in words for words in told):
        told.append(
            f"The responses have an exponential window of {text.format_si(result.frfs.decay_rate, '1/s')}; the damping"
            " that it adds is taken off the modes."
        )
    return told


def _ended(refinement: Refinement) -> list[str]:
    return [] if refinement.converged else [f"the refinement stopped after {refinement.iterations} iterations"]


def _sentence(words: str) -> str:
    """With a capital, and a full stop."""
    return f"{words[:1].upper()}{words[1:].rstrip('.')}."


def _tiles(result: EmaResult, comparison: Comparison | None) -> list[tuple[str, str, str]]:
    """The numbers to read first."""
    frfs = result.frfs
    ends = f"{text.format_si(frfs.freq_hz[0], digits=3)} to {text.format_si(frfs.freq_hz[-1], 'Hz', digits=3)}"
    tiles = [
        ("Modes", str(len(result.modes)), f"{text.count(len(result.rejected), 'cluster')} rejected"),
        ("Responses", str(int(frfs.measured.sum())), f"{text.count(len(frfs.freq_hz), 'line')}, {ends}"),
    ]
    if result.modes:
        frac = result.frac[frfs.measured]
        worst, middle = float(np.nanmin(frac)), float(np.nanmedian(frac))
        tiles.append(("FRAC of the synthesis", f"{middle:.3f}", f"median; least {worst:.3f}"))
    if comparison is not None and comparison.pairs:
        worst = max(abs(pair.freq_difference) for pair in comparison.pairs)
        pairs = f"in {text.count(len(comparison.pairs), 'pair')} with the model"
        tiles.append(("Largest frequency difference", text.format_percent(worst, digits=2), pairs))
    else:
        tiles.append(("Computed in", text.format_duration(result.seconds), result.method))
    return tiles


def _deviation_words(result: EmaResult) -> str:
    """What the standard deviations in the table of modes are."""
    refinement = result.refinement
    if refinement is None:
        return "the scatter over the model orders"
    if refinement.noise_known:
        return "the standard deviation that the noise leaves, as coherence and averages tell it"
    return "the standard deviation that the noise leaves, as the misfit tells it"


def _scaling_words(result: EmaResult) -> str:
    told = (
        "MPC, modal phase collinearity, is 1 for a real shape; MPD is the mean deviation of its phases. The rank defect"
        " is what a single mode leaves of the residues, the reciprocity defect how far they are from symmetric."
    )
    scaling = result.scaling
    if scaling.scaled.any():
        told += " Modal mass (kg for translations) and modal A are those of shapes of unit length."
    for reason in dict.fromkeys(scaling.unscaled):
        if reason:
            numbers = [str(k + 1) for k, why in enumerate(scaling.unscaled) if why == reason]
            whose = "No mode" if len(numbers) == len(scaling.unscaled) else f"Not mode {text.listing(numbers)}"
            told += f" {whose} has a scale: {reason}."
    if result.refinement is not None:
        told += " Significance is how far the misfit grows without the mode; a pole in noise has about 1."
    return told


def _response_words(result: EmaResult) -> str:
    told = "Black: measured, with its coherence γ² in green."
    if result.frfs.coherence is None:
        told = "Black: measured; no coherence is known."
    if result.modes:
        told += " Dotted blue: synthesized from the modes and residuals."
    if result.frfs.decay_rate:
        told += (
            " The measurement has an exponential window, which lowers and widens its peaks; one curve of the model has"
            " the same window, the other none."
        )
    return told


def _shape_words(result: EmaResult, place: figures.Place) -> str:
    if any(place.known(label) for label in result.channels):
        return (
            "Grey: at rest. In colour: both extremes, all modes enlarged to the same deflection; thin curves are paths"
            " of points, ellipses where a shape is complex. Mode numbers are those of the tables above."
        )
    where = "no robot was given" if place.robot is None else f"they are no frames of {place.robot.name}"
    return (
        f"The measured points have no position ({where}), so shapes are not drawn; the last table has them as numbers."
    )


def _how(result: EmaResult, estimate: FrfEstimate | None) -> list[tuple[str, str]]:
    """All that a reader needs to do it again."""
    frfs, poles, refinement = result.frfs, result.stabilization, result.refinement
    limits = _settings(poles.criteria)
    rows = [
        ("method", METHODS.get(result.method, result.method)),
        ("orders", f"{result.orders[0]} to {result.orders[1]}"),
        ("responses", f"{frfs.kind}, {_responses(frfs)}"),
        ("outputs", ", ".join(frfs.outputs)),
        ("inputs", ", ".join(frfs.inputs)),
    ]
    if frfs.averages is not None:
        counts = frfs.averages[frfs.measured]
        rows.append(("averages", str(counts.min()) if np.ptp(counts) == 0 else f"{counts.min()} to {counts.max()}"))
    rows.append(("exponential window", f"{frfs.decay_rate!r} 1/s" if frfs.decay_rate else "none"))
    if estimate is not None:
        rows.append(("responses from signals", ", ".join(_settings(estimate))))
    rows.append(("criteria", ", ".join(limits)))
    rows.append(("poles", f"{len(poles.order)}, of which {int(np.count_nonzero(poles.stable))} stable"))
    if refinement is not None:
        unit = "standard deviations" if refinement.noise_known else "of the RMS of each response"
        rest = f"{text.format_si(refinement.residual, digits=3)} {unit}"
        outside = text.count(len(result.model.background_poles), "pole")
        rows.append(("refinement", f"{refinement.iterations} iterations, misfit {rest}, {outside} outside the band"))
    rows.append(("computed in", text.format_duration(result.seconds)))
    return [*rows, *((f"note: {name}", note) for name, note in frfs.notes.items() if name not in _OWN_NOTES)]


_OWN_NOTES = ("robot", "file", ROBOT_FILE)


def _settings(thing: Any) -> list[str]:
    """Plain fields of a dataclass, as "name = value"."""
    if not is_dataclass(thing):
        return []
    values = {field.name: getattr(thing, field.name) for field in fields(thing)}
    plain = {name: value for name, value in values.items() if _is_plain(value)}
    return [f"{name} = {value!r}" for name, value in plain.items()]


def _is_plain(value: Any) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(isinstance(part, int | float) for part in value)
    return isinstance(value, str | int | float)


def _references(result: EmaResult) -> tuple[tuple[str, str], ...]:
    own = {"plscf": (_PLSCF,), "lsce": (_LSCE,)}.get(result.method, (_PLSCF, _LSCE))
    window = (_WINDOW,) if result.frfs.decay_rate else ()
    return (_HUYNH, *own, *_REFERENCES, *window)
