"""An identification written and shown: its modes, the model's beside them, and what has no partner."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic.cli.refusals import error_data, refuse
from armonic.cli.terminal import heading, line, plain, print_json, show, table, warning
from armonic.errors import ArmonicError
from armonic.text import count, format_duration, format_si, listing, scatter

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from armonic.comparison import Comparison, ModePair
    from armonic.identification.oma import OmaResult
    from armonic.modal import Modes

METHODS = {"var": "vector autoregression", "ssi": "stochastic subspaces"}
LEAST_DEVIATION = 1e-9
"""Relative; modes of data without noise scatter less than anybody should rely on."""


def deliver_oma(
    result: OmaResult,
    reference: Modes | None,
    output: Path | None,
    report: Path | None,
    *,
    source: Path,
    doubt: str | None,
    as_json: bool,
) -> int:
    """Write and show an identification, so that what fails loses nothing that came before.

    Args:
        result: the modes.
        reference: those of a model, if there is one.
        output: where the modes go, .csv or .json.
        report: where the report goes.
        source: the file they are from.
        doubt: why there are no modes of a model although the file notes one.
        as_json: print one JSON object instead of tables.

    Returns:
        The exit code.
    """
    from armonic.comparison import compare

    comparison = compare(result, reference) if reference is not None and result.modes else None
    data = oma_data(result, reference, comparison) | {"file": str(source)} | ({"doubt": doubt} if doubt else {})
    written: dict[str, str] = {}
    failure: ArmonicError | OSError | None = None
    try:
        if output is not None:
            _write_modes(result, output, source, data)
            written["modes"] = str(output)
        if report is not None:
            from armonic.identification_report import write_identification_report

            write_identification_report(result, report, reference)
            written["report"] = str(report)
    except (ArmonicError, OSError) as error:
        failure = error
    if as_json:
        print_json(data | {"written": written} | ({"error": error_data(failure)} if failure else {}))
    else:
        show(*oma_tables(result, reference, comparison, source.name))
        if doubt:
            show("", warning(doubt))
        if written:
            advice = ": open the report in a browser" if "report" in written else ""
            line(f"Wrote {' and '.join(written.values())}{advice}.")
    return 0 if failure is None else refuse(failure, as_json=False)


def _write_modes(result: OmaResult, output: Path, source: Path, data: dict[str, Any]) -> None:
    from armonic.writing import write_whole

    if output.suffix.lower() == ".json":
        text = json.dumps(plain(data), allow_nan=False, ensure_ascii=False, indent=1) + "\n"
    else:
        # What stands in it is what `armonic update --modes` reads; deviations are shares. A harmonic is no mode to fit.
        rows = ["natural_freq_hz,damping_ratio,freq_deviation,damping_deviation"]
        for mode, flag in zip(result.modes, result.harmonics, strict=True):
            if flag.is_harmonic:
                rows.append(f"# left out as a harmonic: {mode.natural_freq_hz!r} Hz, {flag.reason}")
                continue
            scatter = (mode.freq_std_hz / mode.natural_freq_hz, mode.damping_std / mode.damping_ratio)
            deviations = (max(share, LEAST_DEVIATION) for share in scatter)
            rows.append(",".join(map(repr, (mode.natural_freq_hz, mode.damping_ratio, *deviations))))
        name = "".join(sign if sign.isprintable() else "?" for sign in source.name)
        orders = f"{result.orders[0]} to {result.orders[1]}"
        text = "\n".join([f"# {count(len(result.modes), 'mode')} of {name} by {result.method}, orders {orders}", *rows])
        text += "\n"
    write_whole(output, text.encode("utf-8", "replace"))


def oma_tables(
    result: OmaResult, reference: Modes | None, comparison: Comparison | None, source: str
) -> Iterator[RenderableType]:
    """What is printed of an identification, in 80 columns."""
    from armonic.identification_tables import partner_words

    series, (low, high) = result.series, result.orders
    robot = series.notes.get("robot")
    yield heading(f"{source}{f' ({robot})' if robot else ''}: {count(len(result.modes), 'mode')} identified")
    yield (
        f"{METHODS[result.method]}, orders {low} to {high}, {count(len(result.channels), 'channel')} of"
        f" {count(len(series), 'sample')} at {series.sample_rate_hz:g} Hz ({_window_words(result)}), in"
        f" {format_duration(result.seconds)}"
    )
    yield ""
    yield (
        _modes_table(result)
        if result.modes
        else warning("nothing held over enough orders to be a mode; try other --orders, --channels or --window.")
    )
    if fast := [str(k) for k, mode in enumerate(result.modes, 1) if mode.natural_freq_hz > series.sample_rate_hz / 2]:
        half = format_si(series.sample_rate_hz / 2, "Hz")
        yield warning(
            f"{'modes' if len(fast) > 1 else 'mode'} {listing(fast)} above half the sampling rate, {half}: a damped"
            " frequency beyond that is folded back, which shifts frequency and damping."
        )
    for number, (mode, flag) in enumerate(zip(result.modes, result.harmonics, strict=True), 1):
        if flag.is_harmonic:
            freq = format_si(mode.natural_freq_hz, "Hz")
            yield warning(f"mode {number} at {freq} may be no mode but a harmonic: {flag.reason}.")
    if reference is not None:
        if comparison is not None and comparison.pairs:
            yield ""
            yield f"Beside the modes of the model in posture {reference.posture}:"
            yield _beside_table(comparison)
        yield ""
        yield partner_words(result, reference, comparison)
    yield ""
    poles = result.stabilization
    stable = int(np.count_nonzero(poles.stable))
    yield (
        f"{stable} of {count(len(poles.order), 'pole')} are stable. {_rejected_words(result)}"
        " ± is the scatter over the orders, not the error."
    )


def _window_words(result: OmaResult) -> str:
    series = result.series
    span = f"{series.start_s:.4g} to {series.start_s + series.duration_s:.4g} s"
    return f"the decay, {span}" if result.window == "decay" else span


def _rejected_words(result: OmaResult) -> str:
    if not result.rejected:
        return "No cluster was rejected."
    number = count(len(result.rejected), "cluster")
    verb = "was" if len(result.rejected) == 1 else "were"
    return f"{number} that held over the orders {verb} rejected; --report says why."


def _modes_table(result: OmaResult) -> Table:
    grid = table(">", ">natural\nHz", ">±\nHz", ">damped\nHz", ">damping\n%", ">±\n%", ">orders\nheld", ">from\norder")
    for number, mode in enumerate(result.modes, 1):
        grid.add_row(
            str(number),
            _figures(mode.natural_freq_hz),
            scatter(mode.freq_std_hz, mode.natural_freq_hz),
            _figures(mode.pole.imag / (2 * np.pi)),
            format_si(100 * mode.damping_ratio),
            scatter(100 * mode.damping_std, 100 * mode.damping_ratio),
            str(mode.orders),
            str(mode.first_order),
        )
    return grid


def _beside_table(comparison: Comparison) -> Table:
    from armonic.identification_tables import signed

    grid = table(
        ">", ">natural\nHz", ">model\nHz", ">difference\n%", ">damping\n%", ">model\n%", ">difference\npoints", ">MAC"
    )
    a, b = comparison.a, comparison.b
    for pair in comparison.pairs:
        i, k = pair.index_a, pair.index_b
        grid.add_row(
            str(i + 1),
            _figures(float(a.natural_freq_hz[i])),
            _figures(float(b.natural_freq_hz[k])),
            signed(100 * pair.freq_difference),
            format_si(100 * float(a.damping_ratio[i])),
            format_si(100 * float(b.damping_ratio[k])),
            signed(100 * pair.damping_difference),
            "–" if pair.mac is None else f"{pair.mac:.3f}",
        )
    return grid


def _figures(frequency: float) -> str:
    """To five digits, as the differences beside it are told."""
    return format_si(frequency, digits=5)


def oma_data(result: OmaResult, reference: Modes | None, comparison: Comparison | None) -> dict[str, Any]:
    """The same for machines."""
    partner = {pair.index_a: pair for pair in comparison.pairs} if comparison is not None else {}
    poles = result.stabilization
    data: dict[str, Any] = {
        "method": result.method,
        "window": result.window,
        "orders": list(result.orders),
        "channels": list(result.channels),
        "samples": len(result.series),
        "sample_rate_hz": result.series.sample_rate_hz,
        "start_s": result.series.start_s,
        "seconds": result.seconds,
        "poles": len(poles.order),
        "stable_poles": int(np.count_nonzero(poles.stable)),
        "modes": [_mode_data(result, i, partner.get(i), reference) for i in range(len(result.modes))],
        "rejected": [
            {
                "natural_freq_hz": cluster.natural_freq_hz,
                "damping_ratio": cluster.damping_ratio,
                "orders": cluster.orders,
                "reason": cluster.reason,
            }
            for cluster in result.rejected
        ],
    }
    if reference is None:
        return data | {"reference": None}
    alone = range(len(reference)) if comparison is None else comparison.only_b
    return data | {
        "reference": {
            "posture": reference.posture,
            "pairs": len(partner),
            "without_partner": [
                {
                    "mode": k + 1,
                    "natural_freq_hz": float(reference.natural_freq_hz[k]),
                    "damping_ratio": float(reference.damping_ratio[k]),
                }
                for k in alone
            ],
        }
    }


def _mode_data(result: OmaResult, i: int, pair: ModePair | None, reference: Modes | None) -> dict[str, Any]:
    mode, flag = result.modes[i], result.harmonics[i]
    data: dict[str, Any] = {
        "natural_freq_hz": mode.natural_freq_hz,
        "damped_freq_hz": mode.pole.imag / (2 * np.pi),
        "damping_ratio": mode.damping_ratio,
        "freq_std_hz": mode.freq_std_hz,
        "damping_std": mode.damping_std,
        "orders": mode.orders,
        "first_order": mode.first_order,
        "pole": {"re": mode.pole.real, "im": mode.pole.imag},
        "shape": {"re": mode.shape.real, "im": mode.shape.imag},
        "harmonic": flag.reason if flag.is_harmonic else None,
        "model": None,
    }
    if pair is not None and reference is not None:
        k = pair.index_b
        data["model"] = {
            "mode": k + 1,
            "natural_freq_hz": float(reference.natural_freq_hz[k]),
            "damping_ratio": float(reference.damping_ratio[k]),
            "freq_difference": pair.freq_difference,
            "damping_difference": pair.damping_difference,
            "mac": pair.mac,
        }
    return data
