"""`armonic demo`: the fit of the KUKA KR90 from a measured file, and a modal map of Scompi, as one would run them."""

from __future__ import annotations

import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from armonic.cli.arguments import JsonFlag, UsageError
from armonic.cli.refusals import BAD_INPUT
from armonic.cli.terminal import heading, line, show

ROBOT = "updated.yaml"
REPORT = "report.html"
MAP = "map.html"


def demo(
    into: Annotated[Path, typer.Option("--into", metavar="DIR", help="The folder for the files.")] = Path("demo"),
    as_json: JsonFlag = False,
) -> int:
    """Fit a KUKA KR90 to a measurement, and map the modes of Scompi.

    The robots are those of Huynh et al. 2021 and of Do, Vu, Liu 2022. The example, the updated robot and two
    reports go into a folder; files of an earlier demo are overwritten.
    """
    from armonic import examples
    from armonic.cli.delivery import deliver
    from armonic.cli.fitting import run
    from armonic.files import read_frf
    from armonic.map_report import write_map_report
    from armonic.robot import load
    from armonic.surveying import survey
    from armonic.updating import Measurement
    from armonic.writing import write_whole

    if into.exists() and not into.is_dir():
        raise UsageError(f"--into {into}", found="a file", expected="a folder, or the name of a new one")
    into.mkdir(parents=True, exist_ok=True)
    for name in (examples.MEASURED, examples.START, examples.TRUE, examples.TAPS):
        write_whole(into / name, examples.read(name))
    true, measured = load(into / examples.TRUE), read_frf(into / examples.MEASURED)
    measurement = Measurement(measured, posture="milling", frame="sensor", label=examples.MEASURED)
    fit = run(load(into / examples.START), [measurement])
    if not as_json:
        show(
            heading("KUKA KR90 R3100 HA, first three axes: 18 parameters from 9 measured FRFs"),
            "The measurement was synthesized from the true values, with 1 % noise.",
            "",
        )
    code = deliver(fit, fit.postures, into / ROBOT, into / REPORT, as_json=as_json, true_values=true.parameters())
    if code == BAD_INPUT:
        return code
    write_map_report(survey(load("scompi"), "table", sweep={"tool.mass": [0, 4]}), into / MAP)
    if not as_json:
        show("", heading("Scompi in closed loop: 12 modes over 50 postures, with and without a tool"))
        show(f"Every mode tracked, every set checked to be complete: open {into / MAP}.")
        _explain(into)
    return code


def _explain(into: Path) -> None:
    from armonic import examples

    start, measured, robot, report = (
        shlex.quote(str(into / name)) for name in (examples.START, examples.MEASURED, ROBOT, REPORT)
    )
    typed = Path(sys.argv[0])  # a path where the virtual environment is not active
    command = shlex.quote(str(typed)) if typed.name == "armonic" and not shutil.which("armonic") else "armonic"
    show("", heading("The same by hand, and what to try next"))
    line(f"  {command} check {start}")
    line(f"  {command} update {start} {measured} \\")
    line(f"      -o {robot} --report {report} --force")
    line(f"  {command} ema {shlex.quote(str(into / examples.TAPS))}")
    line(f"  {command} update kuka_kr90 {shlex.quote(str(into / examples.TAPS))} --synthesize")
    line(f"  {command} modes {robot}")
    line(f"  {command} frf {robot} -o {shlex.quote(str(into / 'updated.uff'))}")
    line(f"  {command} modes scompi --posture c8")
    line(f"  {command} map scompi --path table --tool-mass 4 \\")
    line(f"      --report {shlex.quote(str(into / MAP))} --force")
