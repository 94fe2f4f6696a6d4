"""`armonic robots` and `armonic check`: what there is, and whether a robot file makes sense."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from armonic.cli import arguments
from armonic.cli.arguments import JsonFlag, RobotName
from armonic.cli.refusals import BAD_INPUT
from armonic.cli.terminal import heading, print_json, remark, show, table
from armonic.text import count

if TYPE_CHECKING:
    from armonic.checks import Finding


def robots(as_json: JsonFlag = False) -> None:
    """List the robots that ship with Armonic."""
    from armonic import catalog
    from armonic.robot import load

    shipped = {name: load(name) for name in catalog.names()}
    if as_json:
        print_json(
            {
                "robots": [
                    {
                        "name": name,
                        "title": robot.name,
                        "source": robot.source,
                        "coordinates": list(robot.coordinates),
                        "postures": list(robot.postures),
                        "frames": [frame.name for frame in robot.description.frames],
                    }
                    for name, robot in shipped.items()
                ]
            }
        )
        return
    grid = table("name", "robot", ">coordinates", "postures", "source")
    for name, robot in shipped.items():
        postures = ", ".join(robot.postures) or "none"
        grid.add_row(name, robot.name, str(len(robot.coordinates)), postures, robot.source or "")
    show(grid, "", "Use a name in place of a robot file: armonic modes kuka_kr90")


def check(robot: RobotName, as_json: JsonFlag = False) -> None:
    """Look for what is wrong or doubtful in a robot file.

    The exit code is 2 if something is wrong, and 0 if there are only warnings.
    """
    from armonic.checks import Finding
    from armonic.checks import check as findings_of
    from armonic.errors import RobotFileError

    try:
        the_robot = arguments.open_robot(robot)
        name, findings = the_robot.name, findings_of(the_robot)
    except RobotFileError as error:
        if not (error.errors or as_json):
            raise
        name = "no valid robot file"
        findings = tuple(
            Finding("error", one.where.removeprefix(f"{robot}, "), str(one).removeprefix(f"{one.where}: "))
            for one in error.errors or (error,)
        )
    errors = sum(finding.level == "error" for finding in findings)
    if as_json:
        listed = [{"level": f.level, "where": f.where, "message": f.message} for f in findings]
        print_json({"robot": robot, "ok": not errors, "findings": listed})
    else:
        _show(robot, name, findings)
    if errors:
        remark(f"error: {robot}: {count(errors, 'error')} found.")
        raise typer.Exit(BAD_INPUT)


def _show(source: str, name: str, findings: tuple[Finding, ...]) -> None:
    from rich.text import Text

    if not findings:
        show(f"{source}: {name}. No findings.")
        return
    grid = table("", "where", "finding")
    for finding in findings:
        style = "red" if finding.level == "error" else "yellow"
        grid.add_row(Text(finding.level, style=style), finding.where, finding.message)
    show(heading(f"{source}: {name}"), "", grid)
