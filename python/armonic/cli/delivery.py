"""A fit written and shown: robot, tables, report, and how an interrupted one goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from armonic.cli import INTERRUPTED
from armonic.cli.refusals import error_data, refuse
from armonic.cli.terminal import line, print_json, remark, show
from armonic.errors import ArmonicError

if TYPE_CHECKING:
    from armonic.updating import Fit

UNDER_LAW = (
    "Of a number under a law the robot file holds the value where the coordinate, or the load, is zero. In a posture "
    "it is that and the slope times the coordinate or load there."
)


def deliver(
    fit: Fit,
    postures: Sequence[str],
    robot: Path | None,
    report: Path | None,
    *,
    as_json: bool,
    true_values: Mapping[str, float] | None = None,
    more: str = "",
) -> int:
    """Write and show a fit: robot, tables, report, so that what fails loses nothing that came before.

    Args:
        fit: the result.
        postures: what to call each of `fit.postures`.
        robot: where the updated robot goes; it is only shown if there is no place.
        report: where the report goes, if one is wanted.
        as_json: print one JSON object, at the end, instead of tables.
        true_values: values by path, to be shown beside.
        more: how a run that was interrupted goes on, if it does.

    Returns:
        The exit code.
    """
    from armonic.cli.results import fit_data, fit_tables

    written: dict[str, str] = {}
    failure: ArmonicError | OSError | None = None
    try:  # before the tables, which end the process if nobody reads them, as under `| head`
        if robot is not None:
            fit.robot.save(robot)
            written["robot"] = str(robot)
    except (ArmonicError, OSError) as error:
        failure = error
    if not as_json:
        show(*fit_tables(fit, postures, true_values), "")
        if any(p.law is not None for p in fit.coordinates):
            show(UNDER_LAW, "")
    try:
        if report is not None and failure is None:
            _write_report(fit, report, robot)
            written["report"] = str(report)
    except (ArmonicError, OSError) as error:
        failure = error
    finally:  # also if the report ends in an exception that nobody foresaw
        if as_json:
            ending = {"written": written} | ({"error": error_data(failure)} if failure else {})
            print_json(fit_data(fit, postures, true_values) | ending)
        elif written:
            advice = ": open the report in a browser" if "report" in written else ""
            line(f"Wrote {' and '.join(written.values())}{advice}.")
    if failure is not None:
        return refuse(failure, as_json=False)
    if not (written or as_json):
        remark("nothing was written: -o FILE keeps the updated robot")
    if fit.status != "interrupted":
        return 0
    kept = f"interrupted: the best of {fit.evaluations} evaluations was kept{' and written' if written else ''}"
    remark(f"{kept}; {more}" if more else kept)
    return INTERRUPTED


def _write_report(fit: Fit, report: Path, robot: Path | None) -> None:
    from armonic.report import write_report

    try:
        write_report(fit, report)
    except (ArmonicError, OSError) as error:
        found = error_data(error)["found"] or type(error).__name__
        raise ArmonicError(
            f"--report {report}",
            found=found,
            expected="a report that can be written",
            hint=None if robot is None else f"The updated robot is safe in {robot}.",
        ) from error
