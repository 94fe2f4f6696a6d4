"""A run in time written and shown, whole or as far as it came."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from armonic.cli import INTERRUPTED
from armonic.cli.arguments import UsageError
from armonic.cli.outputs import check_output
from armonic.cli.refusals import error_data, refuse
from armonic.cli.terminal import line, print_json, remark, show
from armonic.errors import ArmonicError
from armonic.text import count, format_si

if TYPE_CHECKING:
    from armonic.errors import SimulationError
    from armonic.series import TimeSeries
    from armonic.simulation.running import Run

ENDINGS = (".zarr", ".uff", ".unv", ".uf58", ".csv", ".txt", ".mat")


def check_series_output(option: str, path: Path, *, force: bool, sources: Iterable[Path] = ()) -> None:
    """Make sure that a time series can be written, before the work that would be lost.

    Raises:
        UsageError: the ending is unknown, or as `outputs.check_output`; a Zarr folder is a file here.
    """
    if path.suffix.lower() not in ENDINGS:
        found = f"the ending {path.suffix!r}" if path.suffix else "no ending"
        raise UsageError(f"{option} {path}", found=found, expected=f"one of {', '.join(ENDINGS)}")
    if path.suffix.lower() == ".zarr" and path.is_dir():
        if not force:
            expected, hint = "a new name", "Use --force to overwrite it."
            raise UsageError(f"{option} {path}", found="a folder that exists", expected=expected, hint=hint)
        from armonic.files.series_zarr import refuse_other_zarr

        refuse_other_zarr(path)
        return
    check_output(option, path, force=force, sources=sources)


def deliver_run(
    truth: TimeSeries,
    measured: TimeSeries,
    run: Run | None,
    output: Path | None,
    plot: Path | None,
    *,
    context: str,
    what: Sequence[str],
    failure: SimulationError | None,
    as_json: bool,
) -> int:
    """Write and show a run, so that what fails loses nothing that came before.

    Args:
        truth: what the robot did.
        measured: what sensors make of it; this is written.
        run: how it was computed; None of the linear response.
        output: where the series goes, if anywhere.
        plot: where its histories go, if anywhere.
        context: robot and posture.
        what: what acted and was changed, as typed.
        failure: what ended the run before its time.
        as_json: print one JSON object instead of tables.

    Returns:
        The exit code.
    """
    from armonic.cli.run_results import run_data, run_tables

    written: dict[str, str] = {}
    error: ArmonicError | OSError | None = failure
    try:
        if output is not None:
            from armonic.files.series_files import write_series

            write_series(output, measured)
            written["series"] = str(output)
        if plot is not None:
            from armonic.run_report import write_run_report

            write_run_report(measured, plot)
            written["plot"] = str(plot)
    except (ArmonicError, OSError) as other:
        error = error or other
    if as_json:
        ending = {"written": written} | ({"error": error_data(error)} if error else {})
        if failure is not None:
            ending["status"] = "failed"  # type: ignore[assignment]
        named = {"robot": truth.notes["robot"], "posture": truth.notes["posture"], "what": list(what)}
        print_json(named | run_data(truth, run) | ending)
    else:
        show(*run_tables(truth, run, context, list(what)))
        if written:
            line(f"Wrote {' and '.join(written.values())}: {count(len(truth.channels), 'channel')}.")
        elif failure is None and error is None:
            show("Write every channel to a file with -o FILE.zarr, .uff, .csv or .mat.")
    if error is not None:
        return refuse(error, as_json=False)
    if run is None or run.status != "interrupted":
        return 0
    until = format_si(truth.duration_s, "s")
    kept = f" and written to {output}" if output else ", and nothing was written"
    remark(f"interrupted: the first {until} were computed{kept}")
    return INTERRUPTED
