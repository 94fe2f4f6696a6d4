"""All commands together, and how they end."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from armonic import __version__
from armonic.cli import (
    INTERRUPTED,
    analysing,
    demo,
    export,
    fitting,
    identifying,
    mapping,
    model,
    planning,
    robots,
    simulating,
    tapping,
)
from armonic.cli.refusals import TyperUsageError, refuse
from armonic.cli.sections import Sectioned
from armonic.errors import ArmonicError

app = typer.Typer(
    name="armonic",
    help="The vibration of flexible-joint robots: from a robot file and measured FRFs to a verified dynamic model.",
    epilog="Try `armonic demo` first, then `armonic COMMAND --help`.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    model.modes,
    model.frf,
    export.export,
    fitting.update,
    planning.plan,
    simulating.simulate,
    tapping.tap,
    analysing.ema,
    identifying.oma,
    robots.check,
    robots.robots,
    demo.demo,
):
    app.command(cls=Sectioned)(command)
app.command("map")(mapping.map_)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"armonic {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _armonic(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop."),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run(arguments: Sequence[str] | None) -> int:
    """Run the words after `armonic`, by default those of the process; the result is the exit code."""
    with contextlib.suppress(AttributeError, ValueError):  # a stand-in for stdout need not know how
        sys.stdout.reconfigure(errors="replace")  # type: ignore[union-attr]  # a terminal may lack a sign
    try:
        status = app(args=arguments, prog_name="armonic", standalone_mode=False)
    except (ArmonicError, OSError, TyperUsageError) as error:
        # Bad usage ends before any command knows that JSON was wanted.
        return refuse(error, as_json="--json" in (sys.argv[1:] if arguments is None else arguments))
    except typer.Abort:
        return INTERRUPTED
    return status if isinstance(status, int) else 0
