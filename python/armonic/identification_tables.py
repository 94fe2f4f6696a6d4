"""Tables and sentences of the report of an identification: modes beside a model's, what was rejected, exact numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armonic import text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from armonic.comparison import Comparison, ModePair
    from armonic.identification.oma import OmaResult
    from armonic.identification.selection import SelectedMode
    from armonic.modal import Modes

NONE = "–"


def mode_rows(result: OmaResult, reference: Modes | None, comparison: Comparison | None) -> list[dict[str, Any]]:
    """A row per identified mode, then one per mode of the model that has no partner, by natural frequency."""
    partner = {pair.index_a: pair for pair in comparison.pairs} if comparison is not None else {}
    rows = []
    for i, mode in enumerate(result.modes):
        row = _identified(result, i, mode)
        pair = partner.get(i)
        if reference is not None:
            row["model"] = _beside(pair, reference) if pair is not None else [NONE] * 6
        rows.append((mode.natural_freq_hz, row))
    if reference is not None:
        rows += [(float(reference.natural_freq_hz[k]), _missed(reference, k)) for k in _alone(reference, comparison)]
    return [row for _, row in sorted(rows, key=lambda entry: entry[0])]


def _alone(reference: Modes, comparison: Comparison | None) -> list[int]:
    """Modes of the model without a partner."""
    return list(range(len(reference))) if comparison is None else [int(k) for k in comparison.only_b]


def _missed(reference: Modes, k: int) -> dict[str, Any]:
    """The row of a mode of the model that was not identified."""
    freq, damping = float(reference.natural_freq_hz[k]), float(reference.damping_ratio[k])
    model = [str(k + 1), _hz(freq), NONE, _percent(damping), NONE, NONE]
    return {"number": NONE, "cells": None, "harmonic": "", "model": model}


def _identified(result: OmaResult, i: int, mode: SelectedMode) -> dict[str, Any]:
    mpc = result.stabilization.mpc[np.asarray(mode.members, np.intp)]
    known = mpc[np.isfinite(mpc)]
    flag = result.harmonics[i]
    return {
        "number": str(i + 1),
        "cells": {
            "natural": _hz(mode.natural_freq_hz),
            "natural_std": _deviation(mode.freq_std_hz, mode.natural_freq_hz, "Hz"),
            "damped": _hz(float(np.imag(mode.pole)) / (2 * np.pi)),
            "damping": _percent(mode.damping_ratio),
            "damping_std": _deviation(100 * mode.damping_std, 100 * mode.damping_ratio, "%"),
            "orders": str(mode.orders),
            "first": str(mode.first_order),
            "mpc": f"{np.median(known):.3f}" if known.size else NONE,
        },
        "harmonic": flag.reason if flag.is_harmonic else "",
        "model": None,
    }


def _deviation(value: float, of: float, unit: str) -> str:
    return f"± {text.scatter(value, of, unit)}" if np.isfinite(value) else ""


def _hz(frequency: float) -> str:
    """To five digits: differences of a hundredth of a per cent are told beside it."""
    return text.format_si(frequency, digits=5)


def _percent(ratio: float) -> str:
    return text.format_si(100 * ratio, digits=4)


def _beside(pair: ModePair, reference: Modes) -> list[str]:
    """Number, frequency with its difference in %, damping with its difference in points, and MAC of the partner."""
    return [
        str(pair.index_b + 1),
        _hz(float(reference.natural_freq_hz[pair.index_b])),
        signed(100 * pair.freq_difference),
        _percent(float(reference.damping_ratio[pair.index_b])),
        signed(100 * pair.damping_difference),
        f"{pair.mac:.3f}" if pair.mac is not None and np.isfinite(pair.mac) else NONE,
    ]


def signed(value: float, *, decimals: int = 3) -> str:
    """A difference with its sign, a true minus; zero has none."""
    words = f"{value:+.{decimals}f}"
    return f"{0:.{decimals}f}" if float(words) == 0 else words.replace("-", "−")


def partner_words(result: OmaResult, reference: Modes | None, comparison: Comparison | None) -> str:
    """How many modes were paired, and which on either side have no partner; empty without a reference."""
    if reference is None:
        return ""
    alone = [int(i) for i in comparison.only_a] if comparison is not None else []
    missing = _alone(reference, comparison)
    found = [(mode.natural_freq_hz, mode.damping_ratio) for mode in result.modes]
    known = list(zip(reference.natural_freq_hz.tolist(), reference.damping_ratio.tolist(), strict=True))
    told = [f"{text.count(len(comparison.pairs) if comparison is not None else 0, 'pair')} with the model."]
    for indices, values, whose, where in (
        (alone, found, "Identified", "in the model"),
        (missing, known, "Of the model,", "among those identified"),
    ):
        if indices:
            names = [f"mode {i + 1} ({_hz(values[i][0])} Hz, {text.format_percent(values[i][1])})" for i in indices]
            words, verb = text.listing(names), "has" if len(names) == 1 else "have"
            told.append(f"{whose} {words} {verb} no partner {where}.")
    if not alone and not missing:
        told.append("None is left without a partner.")
    return " ".join(told)


def rejected_rows(result: OmaResult) -> list[list[str]]:
    """A row per rejected cluster: natural frequency, damping ratio, orders that hold it, and the reason."""
    return [
        [
            _hz(cluster.natural_freq_hz),
            _percent(cluster.damping_ratio),
            str(cluster.orders),
            cluster.reason,
        ]
        for cluster in result.rejected
    ]


def exact_rows(result: OmaResult) -> list[list[str]]:
    """A row per mode with numbers to compute on with: real and imaginary part of its pole, frequency, damping ratio."""
    return [
        [
            str(number),
            *(
                f"{value:.9g}"
                for value in (
                    float(np.real(mode.pole)),
                    float(np.imag(mode.pole)),
                    mode.natural_freq_hz,
                    mode.damping_ratio,
                )
            ),
        ]
        for number, mode in enumerate(result.modes, 1)
    ]


def shape_rows(result: OmaResult) -> list[list[str]]:
    """A row per mode: amplitude relative to the largest, and phase to it in degrees, per channel."""
    rows = []
    for number, mode in enumerate(result.modes, 1):
        shape = np.asarray(mode.shape, np.complex128)
        largest = shape[np.argmax(np.where(np.isfinite(shape), np.abs(shape), 0.0))]
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = shape / largest
        rows.append([str(number), *map(_polar, relative.tolist())])
    return rows


def _polar(z: complex) -> str:
    if not np.isfinite(z):
        return NONE
    return f"{abs(z):.3f} ∠ {np.degrees(np.angle(z)):.0f}°".replace("-0°", "0°").replace("-", "−")


def frequency_labels(freq_hz: Iterable[float]) -> list[str]:
    """Labels of a MAC matrix: "6.4 Hz"."""
    return [f"{f:.1f} Hz" if f >= 1 else text.format_si(f, "Hz", digits=2) for f in map(float, freq_hz)]
