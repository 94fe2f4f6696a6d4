"""Tables and sentences of the report of a fit: parameters, measured modes, starts, what the cost is, the record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armonic import text
from armonic.linear import linearize
from armonic.updating.modal_data import ModalResidual

if TYPE_CHECKING:
    from armonic.modal import Modes
    from armonic.updating import Fit, FittedParameter, ModalMeasurement, Parameter

MOST_STARTS = 12
"""Of more starts than these no single costs are told."""
SAME = 1.01
"""Within this factor of the lowest cost starts count as having ended alike."""
NONE = "–"


def parameter_rows(fit: Fit) -> list[dict[str, str]]:
    """A row for each parameter, with what it is tied to and the law it follows."""
    return [_parameter_row(p, c) for p, c in zip(fit.parameters, fit.coordinates, strict=True)]


def _parameter_row(p: FittedParameter, coordinate: Parameter) -> dict[str, str]:
    signed = p.scale == "linear"
    return {
        "path": p.path,
        "notes": _notes(p, coordinate),
        "unit": unit_words(p.unit),
        "start": text.format_si(p.start),
        "value": text.format_si(p.value),
        "interval": text.format_interval(*p.interval, signed=signed),
        "bounds": text.format_interval(p.lower, p.upper, signed=signed),
        "verdict": p.verdict,
    }


def unit_words(unit: str) -> str:
    """A unit as a page has it: "N·m/rad per N·m"."""
    return unit.replace(" ", "·").replace("·per·", " per ")


def _notes(p: FittedParameter, coordinate: Parameter) -> str:
    told = [f"tied to it: {', '.join(path for path in p.tied if path != p.path)}"] if p.tied else []
    if coordinate.law is not None:
        over = "the static torque on its joint" if coordinate.law.over == "torque" else coordinate.law.over
        told.append(f"where {over} is zero" if coordinate.paths else f"slope of the above over {over}")
    return "; ".join(told)


def has_signed(fit: Fit) -> bool:
    """Whether some parameters may be zero or negative."""
    return any(p.scale == "linear" for p in fit.parameters)


def cost_words(fit: Fit) -> str:
    """What the cost is, and what the stages on the way to it were."""
    if fit.measurements:
        kind = "relative" if fit.task.relative else "log"
        told = f"Weighted sum of the squared {kind} differences between model and measurement"
        if fit.modal_measurements:
            told += ", and of those between modelled and measured modes over their stated deviations"
    else:
        told = "Sum of the squared differences between modelled and measured modes over their stated deviations"
    if fit.task.anchors.indices:
        told += ", priors included"
    told += "; the best so far after each evaluation."
    if fit.method == "genetic":
        return f"{told} The genetic stage and the simplex take turns."
    if len(fit.stages) < 2:
        return told
    if not fit.measurements:
        return f"{told} Grey: with wider deviations first, which let a mode that is far off be found."
    if not any(stage.sigma > 0 for stage in fit.stages):
        return told
    return (
        f"{told} On the way the stages of a run have costs of their own (grey where they do): down the ladder of "
        "contours at distances σ (rad/s) from the imaginary axis, which melt the peaks, then under levelled weights, "
        "at last the cost that was asked for."
    )


def starts_words(fit: Fit) -> str:
    """How the starts ended, if there was more than one."""
    ends = np.sort(np.asarray(fit.starts, float))
    if len(ends) < 2:
        return ""
    alike = int(np.count_nonzero(ends <= SAME * ends[0]))
    told = f"{alike} of {len(ends)} starts ended within 1 % of the lowest cost"
    if len(ends) <= MOST_STARTS:
        costs = ", ".join(text.format_si(float(cost)) if np.isfinite(cost) else "no end" for cost in fit.starts)
        return f"{told}. Final costs, in order: {costs}."
    return f"{told}, {text.format_si(float(ends[0]))}; the median is {text.format_si(float(np.median(ends)))}."


def modal_tables(fit: Fit) -> list[dict[str, Any]]:
    """Measured modes beside those of the model before and after, paired as the fit paired them."""
    return [_modal_table(fit, m) for m in fit.modal_measurements]


def _modal_table(fit: Fit, m: ModalMeasurement) -> dict[str, Any]:
    index = fit.postures.index(linearize(fit.start, m.posture).posture)
    start = np.array([p.coordinate(p.start) for p in fit.coordinates])
    end = np.array([c.coordinate(p.value) for c, p in zip(fit.coordinates, fit.parameters, strict=True)])
    before, after = (_beside(fit, m, modes, x) for modes, x in ((fit.before[index], start), (fit.after[index], end)))
    damping = None if m.damping_ratio is None else np.asarray(m.damping_ratio)
    rows = []
    for i, freq in enumerate(np.asarray(m.natural_freq_hz)):
        row = [_compared(float(freq), float(np.asarray(m.freq_deviation)[i]), before[0][i], after[0][i], digits="hz")]
        if damping is not None:
            spread = float(np.asarray(m.damping_deviation)[i])
            row.append(_compared(float(damping[i]), spread, before[1][i], after[1][i], digits="percent"))
        rows.append([cell for part in row for cell in part])
    return {
        "label": m.label,
        "posture": fit.postures[index],
        "kind": "Damped" if m.damped else "Natural",
        "damping": damping is not None,
        "shapes": m.shapes is not None,
        "rows": rows,
    }


def _beside(fit: Fit, m: ModalMeasurement, modes: Modes, x: np.ndarray[Any, Any]) -> tuple[list[float], list[float]]:
    """Frequencies and damping ratios of the modes that the measured ones are paired with; NaN if there are none."""
    try:
        (pairs,) = ModalResidual(fit.start, m, fit.coordinates).pairs(x)
    except ArithmeticError:
        return [np.nan] * len(m), [np.nan] * len(m)
    frequencies = modes.damped_freq_hz if m.damped else modes.natural_freq_hz
    return frequencies[pairs].tolist(), modes.damping_ratio[pairs].tolist()


def _compared(measured: float, deviation: float, before: float, after: float, *, digits: str) -> list[str]:
    """Measured with its deviation, before, after, and how far the last is from the first."""

    def told(value: float) -> str:
        return text.format_hz(value) if digits == "hz" else text.format_si(100 * value, digits=3)

    apart = 100 * (after / measured - 1)
    off = f"{apart:+.2f} %".replace("-", "−") if abs(apart) >= 0.005 else "0.00 %"
    own = f"{told(measured)} ± {text.format_percent(deviation, digits=2)}"
    return [
        own,
        *(told(value) if np.isfinite(value) else NONE for value in (before, after)),
        off if np.isfinite(apart) else NONE,
    ]


def record_rows(fit: Fit) -> list[tuple[str, str]]:
    """The run's record by names for people."""
    r = fit.record
    versions = f"Armonic {r.armonic}, Python {r.python}, NumPy {r.numpy}, SciPy {r.scipy}"
    options = ", ".join(f"{name} = {value}" for name, value in r.options.items() if value not in (None, {}, []))
    return [
        ("method", r.method),
        ("options", options),
        ("seed", str(r.seed)),
        ("started", r.started),
        ("versions", versions),
        ("robot", f"{r.robot}, SHA-256 {r.robot_sha256}"),
        *((f"measurement {label}", f"SHA-256 {digest}") for label, digest in r.measurements),
        ("parameters", ", ".join(r.parameters)),
        ("fingerprint", r.fingerprint),
    ]
