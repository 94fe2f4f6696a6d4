"""Tables and sentences of the report of an experimental modal analysis: modes, scaling, hits, FRAC, exact numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armonic import text
from armonic.identification_tables import NONE, signed

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from armonic.comparison import Comparison, ModePair
    from armonic.experiment.estimation import FrfEstimate
    from armonic.identification.ema import EmaResult
    from armonic.modal import Modes

MOST_PARTS = 4
"""So many poor responses are named; of more, their number is told."""
LEAST_FRAC = 0.9
"""Below it a response counts as poorly described."""
RANK_DEFECT = 0.2
"""Share of a mode's residues that the best matrix of rank one leaves, above which they are hardly those of one mode."""


def mode_rows(result: EmaResult, reference: Modes | None, comparison: Comparison | None) -> list[dict[str, Any]]:
    """A row per identified mode, then one per mode of the model in the band without a partner, by natural frequency."""
    partner = {pair.index_a: pair for pair in comparison.pairs} if comparison is not None else {}
    rows = []
    for k, mode in enumerate(result.modes):
        freq, damping = float(result.natural_freq_hz[k]), float(result.damping_ratio[k])
        row: dict[str, Any] = {
            "number": str(k + 1),
            "natural": _hz(freq),
            "natural_std": _spread(float(result.freq_std_hz[k]), freq, "Hz"),
            "damped": _hz(float(result.poles[k].imag) / (2 * np.pi)),
            "damping": _percent(damping),
            "damping_std": _spread(100 * float(result.damping_std[k]), 100 * damping, "%"),
            "orders": str(mode.orders),
            "first": str(mode.first_order),
            "model": None,
        }
        pair = partner.get(k)
        if reference is not None:
            row["model"] = [NONE] * 6 if pair is None else _beside(pair, reference)
        rows.append((freq, row))
    if reference is not None:
        for k in missed(result, reference, comparison):
            freq, damping = float(reference.natural_freq_hz[k]), float(reference.damping_ratio[k])
            model = [str(k + 1), _hz(freq), NONE, _percent(damping), NONE, NONE]
            rows.append((freq, {"number": "", "model": model}))
    return [row for _, row in sorted(rows, key=lambda entry: entry[0])]


def missed(result: EmaResult, reference: Modes, comparison: Comparison | None) -> list[int]:
    """Modes of the model that vibrate within the band that was measured and have no partner, by index."""
    low, high = result.frfs.freq_hz[0], result.frfs.freq_hz[-1]
    alone = range(len(reference)) if comparison is None else comparison.only_b
    inside = (reference.natural_freq_hz >= low) & (reference.natural_freq_hz <= high) & reference.oscillatory
    return [int(k) for k in alone if inside[k]]


def partner_words(result: EmaResult, reference: Modes | None, comparison: Comparison | None) -> str:
    """How many modes were paired, and which have no partner; empty without a reference."""
    if reference is None:
        return ""
    told = [f"{text.count(len(comparison.pairs) if comparison is not None else 0, 'pair')} with the model."]
    alone = [int(k) for k in comparison.only_a] if comparison is not None else []
    for indices, freq, damping, whose, where in (
        (alone, result.natural_freq_hz, result.damping_ratio, "Identified", "in the model"),
        (
            missed(result, reference, comparison),
            reference.natural_freq_hz,
            reference.damping_ratio,
            "Of the model within the band,",
            "among those identified",
        ),
    ):
        if indices:
            names = [f"mode {k + 1} ({_hz(freq[k])} Hz, {text.format_percent(float(damping[k]))})" for k in indices]
            verb = "has" if len(names) == 1 else "have"
            told.append(f"{whose} {text.listing(names)} {verb} no partner {where}.")
    if len(told) == 1:
        told.append("None within the band is left without a partner.")
    return " ".join(told)


def scaling_rows(result: EmaResult) -> list[list[str]]:
    """A row per mode: complexity, how nearly its residues are those of one mode, modal mass, modal A, significance."""
    scaling, refinement = result.scaling, result.refinement
    return [
        [
            str(k + 1),
            _hz(float(result.natural_freq_hz[k])),
            _fixed(scaling.mpc[k], ".3f"),
            _fixed(scaling.mpd_deg[k], ".1f"),
            _fixed(scaling.rank_defect[k], ".3f"),
            _fixed(scaling.reciprocity_defect[k], ".3f"),
            text.format_si(float(scaling.modal_mass[k]), digits=4) if np.isfinite(scaling.modal_mass[k]) else NONE,
            polar(complex(scaling.modal_a[k]), digits=4),
            NONE if refinement is None else text.format_si(float(refinement.significance[k]), digits=3),
        ]
        for k in range(len(result.modes))
    ]


def frac_rows(result: EmaResult) -> list[list[tuple[str, bool]]]:
    """A row per output: its label, then FRAC per input and whether that is poor."""
    rows = []
    for i, output in enumerate(result.frfs.outputs):
        cells = [(output, False)]
        for j in range(len(result.frfs.inputs)):
            value = float(result.frac[i, j])
            known = bool(result.frfs.measured[i, j]) and np.isfinite(value)
            cells.append((f"{value:.4f}" if known else NONE, known and value < LEAST_FRAC))
        rows.append(cells)
    return rows


def poor_words(result: EmaResult) -> str:
    """Which responses the modes describe poorly; empty if none."""
    found = [
        (float(result.frac[i, j]), f"{result.frfs.outputs[i]} to {result.frfs.inputs[j]}")
        for i, j in np.argwhere(result.frfs.measured)
        if result.frac[i, j] < LEAST_FRAC
    ]
    if not found:
        return ""
    found.sort()
    names = [f"{pair} (FRAC {value:.2f})" for value, pair in found[:MOST_PARTS]]
    if len(found) > MOST_PARTS:
        names.append(f"{len(found) - MOST_PARTS} more")
    return f"The modes describe poorly: {text.listing(names)}."


def hit_rows(estimate: FrfEstimate) -> list[dict[str, str]]:
    """A row per hit: where, when, how hard, how long, and whether and why it was not used."""
    return [
        {
            "number": str(number),
            "record": str(hit.record + 1),
            "start": f"{hit.start_s:.3f}",
            "force": hit.force,
            "peak": text.format_si(hit.peak_n, digits=3).replace("-", "−"),
            "duration": text.format_si(1000 * hit.duration_s, digits=3),
            "used": "used" if hit.used else "not used",
            "reason": hit.reason,
        }
        for number, hit in enumerate(estimate.hits, 1)
    ]


def rejected_rows(result: EmaResult) -> list[list[str]]:
    """A row per rejected cluster: natural frequency, damping ratio, orders that hold it, and the reason."""
    return [
        [_hz(group.natural_freq_hz), _percent(group.damping_ratio), str(group.orders), group.reason]
        for group in result.rejected
    ]


def exact_rows(result: EmaResult) -> list[list[str]]:
    """A row per mode with numbers to compute on with: real and imaginary part of its pole, frequency, damping ratio."""
    return [
        [str(k + 1), *(f"{value:.9g}" for value in (pole.real, pole.imag, freq, damping))]
        for k, (pole, freq, damping) in enumerate(
            zip(result.poles.tolist(), result.natural_freq_hz.tolist(), result.damping_ratio.tolist(), strict=True)
        )
    ]


def shape_rows(result: EmaResult) -> list[list[str]]:
    """A row per mode: amplitude relative to the largest, and phase to it in degrees, per degree of freedom."""
    rows = []
    for number, mode in enumerate(result.modes, 1):
        shape = np.asarray(mode.shape, np.complex128)
        size = np.where(np.isfinite(shape), np.abs(shape), 0.0)
        largest = shape[np.argmax(size)] if size.any() else 1.0
        rows.append([str(number), *(polar(complex(z), digits=0) for z in shape / largest)])
    return rows


def polar(z: complex, *, digits: int) -> str:
    """Size and angle: "0.412 ∠ 178°"; with digits of its own for a size of any order."""
    if not np.isfinite(z):
        return NONE
    size = text.format_si(abs(z), digits=digits) if digits else f"{abs(z):.3f}"
    angle = f"{np.degrees(np.angle(z)):.0f}"
    return f"{size} ∠ {'0' if angle == '-0' else angle.replace('-', '−')}°"


def defect_words(result: EmaResult) -> list[str]:
    """Modes whose residues are hardly those of one mode."""
    if min(len(result.frfs.outputs), len(result.frfs.inputs)) < 2:
        return []
    return [
        f"Mode {k + 1} at {_hz(float(result.natural_freq_hz[k]))} Hz: its residues are hardly those of a single mode,"
        f" which leaves {text.format_percent(float(defect), digits=2)} of them."
        for k, defect in enumerate(result.scaling.rank_defect[: len(result.modes)])
        if defect > RANK_DEFECT
    ]


def span_hz(freq_hz: ArrayLike) -> str:
    """Least and greatest of some frequencies: "10.00 to 23.70 Hz"."""
    low, high = (text.format_hz(float(end)) for end in (np.min(freq_hz), np.max(freq_hz)))
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


def span_percent(ratios: ArrayLike) -> str:
    """Least and greatest of some fractions: "0.500 % to 1.40 %"."""
    low, high = (text.format_percent(float(end)) for end in (np.min(ratios), np.max(ratios)))
    return low if low == high else f"{low} to {high}"


def _beside(pair: ModePair, reference: Modes) -> list[str]:
    """Number, frequency with its difference in %, damping with its difference in points, and MAC of the partner."""
    k = pair.index_b
    return [
        str(k + 1),
        _hz(float(reference.natural_freq_hz[k])),
        signed(100 * pair.freq_difference),
        _percent(float(reference.damping_ratio[k])),
        signed(100 * pair.damping_difference),
        NONE if pair.mac is None or not np.isfinite(pair.mac) else f"{pair.mac:.3f}",
    ]


def _spread(value: float, of: float, unit: str) -> str:
    return f"± {text.scatter(value, of, unit)}" if np.isfinite(value) else ""


def _hz(frequency: float) -> str:
    """To five digits: differences of a hundredth of a per cent are told beside it."""
    return text.format_si(float(frequency), digits=5)


def _percent(ratio: float) -> str:
    return text.format_si(100 * float(ratio), digits=4)


def _fixed(value: float, form: str) -> str:
    return f"{value:{form}}" if np.isfinite(value) else NONE
