"""An experimental modal analysis written and shown: hits, modes, what was left, and the model beside."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic.cli.refusals import error_data, refuse
from armonic.cli.terminal import heading, line, plain, print_json, show, table, warning
from armonic.errors import ArmonicError
from armonic.text import count, format_duration, format_si, scatter

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from armonic.cli.campaign import Responses
    from armonic.comparison import Comparison
    from armonic.identification.ema import EmaResult
    from armonic.modal import Modes
    from armonic.robot import Robot

METHODS = {"plscf": "least squares of complex frequency responses", "lsce": "least squares of complex exponentials"}
LEAST_DEVIATION = 1e-9
"""Relative; no mode is known better than anybody should rely on."""


@dataclass(frozen=True)
class Wanted:
    """Files to write, and how the synthesized responses are made symmetric."""

    modes: Path | None
    frfs: Path | None
    synthesized: Path | None
    report: Path | None
    side: Any


@dataclass(frozen=True, eq=False)
class Beside:
    """The model beside the modes, if there is one."""

    robot: Robot | None
    posture: Any
    modes: Modes | None


def deliver_ema(result: EmaResult, found: Responses, beside: Beside, wanted: Wanted, *, as_json: bool) -> int:
    """Write and show an analysis, so that what fails loses nothing that came before; the result is the exit code."""
    comparison = _compared(result, beside)
    data = ema_data(result, found, comparison)
    written: dict[str, str] = {}
    failure: ArmonicError | OSError | None = None
    try:
        for name, path in (("modes", wanted.modes), ("frfs", wanted.frfs), ("synthesized", wanted.synthesized)):
            if path is not None:
                _write(name, path, result, found, wanted.side, data)
                written[name] = str(path)
        if wanted.report is not None:
            from armonic.ema_report import write_ema_report

            write_ema_report(
                result,
                wanted.report,
                reference=beside.modes,
                robot=beside.robot,
                posture=beside.posture,
                estimate=found.estimate,
                geometry=found.file.geometry,
                remarks=[*found.file.remarks, *(f"Not read: {left}." for left in found.file.skipped)],
            )
            written["report"] = str(wanted.report)
    except (ArmonicError, OSError) as error:
        failure = error
    if as_json:
        print_json(data | {"written": written} | ({"error": error_data(failure)} if failure else {}))
    else:
        show(*ema_tables(result, found, comparison))
        if written:
            advice = ": open the report in a browser" if "report" in written else ""
            line(f"Wrote {' and '.join(written.values())}{advice}.")
    return 0 if failure is None else refuse(failure, as_json=False)


def _compared(result: EmaResult, beside: Beside) -> Comparison | None:
    if beside.robot is None or beside.modes is None or not result.modes:
        return None
    from armonic.comparison import compare
    from armonic.comparison_at import modes_at
    from armonic.linear import linearize

    try:
        return compare(result, modes_at(linearize(beside.robot, beside.posture), beside.modes, result.channels))
    except ArmonicError:
        return compare(result, beside.modes)  # points that are no frames of the robot: poles alone


def _write(name: str, path: Path, result: EmaResult, found: Responses, side: Any, data: dict[str, Any]) -> None:
    from armonic.comparison import ModeTable
    from armonic.files.measured_files import write_measured
    from armonic.writing import write_whole

    if name == "frfs":
        write_measured(path, frfs=result.measured)
    elif name == "synthesized":
        write_measured(path, frfs=result.synthesized(symmetric=side))
    elif path.suffix.lower() == ".json":
        text = json.dumps(plain(data), allow_nan=False, ensure_ascii=False, indent=1) + "\n"
        write_whole(path, text.encode("utf-8", "replace"))
    elif path.suffix.lower() == ".csv":
        rows = ["natural_freq_hz,damping_ratio,freq_deviation,damping_deviation"]
        for mode in result.modes:
            shares = (mode.freq_std_hz / mode.natural_freq_hz, mode.damping_std / mode.damping_ratio)
            deviations = (max(share, LEAST_DEVIATION) for share in shares)
            rows.append(",".join(map(repr, (mode.natural_freq_hz, mode.damping_ratio, *deviations))))
        write_whole(path, ("\n".join(rows) + "\n").encode())
    else:
        scaling = result.scaling
        modes = ModeTable(result.poles, scaling.shapes, scaling.dofs)
        known = np.where(scaling.scaled, scaling.modal_a, 0)
        scale: dict[str, Any] = {"modal_a": known} if path.suffix.lower() == ".uff" else {}
        write_measured(path, modes=modes, geometry=found.file.geometry, **scale)


def ema_tables(result: EmaResult, found: Responses, comparison: Comparison | None) -> Iterator[RenderableType]:
    """What is printed of an analysis, in 80 columns."""
    frfs, (low, high) = result.frfs, result.orders
    names = ", ".join(Path(name).name for name in found.file.path.split(", "))
    yield heading(f"{names}: {count(len(result.modes), 'mode')} identified")
    if found.estimate is not None and found.estimate.hits:
        hits = found.estimate.hits
        used = sum(hit.used for hit in hits)
        yield f"{count(used, 'hit')} of {len(hits)} used, by {found.estimate.estimator}"
        for number, hit in enumerate(hits, 1):
            if not hit.used and hit.reason != "left out":
                yield f"  hit {number} (record {hit.record + 1}, {hit.start_s:.3g} s, {hit.force}): {hit.reason}"
    if found.estimate is not None and not found.estimate.hits:
        made = found.estimate
        yield f"{made.excitation} force, blocks of {made.window_s:.4g} s, by {made.estimator}"
    span = f"{format_si(frfs.freq_hz[0], digits=3)} to {format_si(frfs.freq_hz[-1], digits=3)} Hz"
    yield (
        f"{count(int(frfs.measured.sum()), 'response')} of {count(frfs.freq_hz.size, 'line')}, {span};"
        f" {METHODS[result.method]}, orders {low} to {high}, in {format_duration(result.seconds)}"
    )
    yield ""
    yield (
        _modes_table(result)
        if result.modes
        else warning("nothing held over enough orders to be a mode; try other --orders, --band or --method.")
    )
    if comparison is not None and comparison.pairs:
        yield ""
        yield "Beside the modes of the model:"
        yield _beside_table(comparison)
    if result.modes:
        yield "± is what noise leaves; what filters, a hammer held askew or amplitude shift is not in it."
    yield ""
    worst = np.nanmin(result.frac) if np.isfinite(result.frac).any() else np.nan
    if result.modes:
        i, j = np.unravel_index(np.nanargmin(result.frac), result.frac.shape) if np.isfinite(worst) else (0, 0)
        least = f"{result.frfs.outputs[i]} to {result.frfs.inputs[j]}"
        yield f"FRAC of synthesized and measured responses: {worst:.3f} at least ({least})."
    if result.rejected:
        yield f"{count(len(result.rejected), 'group')} of poles rejected; --report says why."
    told = (*found.file.remarks, *(found.estimate.remarks if found.estimate else ()))
    for text in (*told, *(f"{text[:1].upper()}{text[1:].rstrip('.')}." for text in result.remarks)):
        yield f"- {text}"
    for left in found.file.skipped[:5]:
        yield warning(f"not read: {left}")
    if len(found.file.skipped) > 5:
        yield warning(f"and {len(found.file.skipped) - 5} more")


def _modes_table(result: EmaResult) -> Table:
    grid = table(">", ">natural\nHz", ">±\nHz", ">damped\nHz", ">damping\n%", ">±\n%", ">MPC", ">orders\nheld")
    for number, mode in enumerate(result.modes, 1):
        grid.add_row(
            str(number),
            format_si(mode.natural_freq_hz, digits=5),
            scatter(mode.freq_std_hz, mode.natural_freq_hz),
            format_si(mode.pole.imag / (2 * np.pi), digits=5),
            format_si(100 * mode.damping_ratio),
            scatter(100 * mode.damping_std, 100 * mode.damping_ratio),
            f"{result.scaling.mpc[number - 1]:.2f}",
            str(mode.orders),
        )
    return grid


def _beside_table(comparison: Comparison) -> Table:
    from armonic.identification_tables import signed

    grid = table(">", ">natural\nHz", ">model\nHz", ">difference\n%", ">damping\n%", ">model\n%", ">MAC")
    a, b = comparison.a, comparison.b
    for pair in comparison.pairs:
        i, k = pair.index_a, pair.index_b
        grid.add_row(
            str(i + 1),
            format_si(float(a.natural_freq_hz[i]), digits=5),
            format_si(float(b.natural_freq_hz[k]), digits=5),
            signed(100 * pair.freq_difference),
            format_si(100 * float(a.damping_ratio[i])),
            format_si(100 * float(b.damping_ratio[k])),
            "–" if pair.mac is None else f"{pair.mac:.3f}",
        )
    return grid


def ema_data(result: EmaResult, found: Responses, comparison: Comparison | None) -> dict[str, Any]:
    """The same for machines."""
    scaling, estimate = result.scaling, found.estimate
    return {
        "file": found.file.path,
        "method": result.method,
        "orders": list(result.orders),
        "channels": list(result.channels),
        "outputs": list(result.frfs.outputs),
        "inputs": list(result.frfs.inputs),
        "decay_rate": result.frfs.decay_rate,
        "frac": result.frac,
        "hits": [] if estimate is None else [_hit(hit) for hit in estimate.hits],
        "modes": [
            {
                "natural_freq_hz": mode.natural_freq_hz,
                "damped_freq_hz": mode.pole.imag / (2 * np.pi),
                "damping_ratio": mode.damping_ratio,
                "freq_std_hz": mode.freq_std_hz,
                "damping_std": mode.damping_std,
                "orders": mode.orders,
                "pole": {"re": mode.pole.real, "im": mode.pole.imag},
                "shape": {"re": mode.shape.real, "im": mode.shape.imag},
                "mpc": float(scaling.mpc[k]),
                "modal_mass": float(scaling.modal_mass[k]),
            }
            for k, mode in enumerate(result.modes)
        ],
        "rejected": [
            {"natural_freq_hz": mode.natural_freq_hz, "damping_ratio": mode.damping_ratio, "reason": mode.reason}
            for mode in result.rejected
        ],
        "pairs": []
        if comparison is None
        else [
            {
                "mode": pair.index_a + 1,
                "model": pair.index_b + 1,
                "freq_difference": pair.freq_difference,
                "mac": pair.mac,
            }
            for pair in comparison.pairs
        ],
        "skipped": [str(left) for left in found.file.skipped],
        "remarks": [*found.file.remarks, *(estimate.remarks if estimate else ()), *result.remarks],
        "seconds": result.seconds,
    }


def _hit(hit: Any) -> dict[str, Any]:
    return {
        "record": hit.record + 1,
        "start_s": hit.start_s,
        "force": hit.force,
        "peak_n": hit.peak_n,
        "used": hit.used,
        "reason": hit.reason,
    }
