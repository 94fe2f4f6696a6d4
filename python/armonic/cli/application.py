"""All commands together, and what bad input becomes: one line on stderr and exit code 2."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from typing import Annotated, cast

import typer

from armonic import __version__
from armonic.cli import INTERRUPTED, demo, fitting, model, robots
from armonic.errors import ArmonicError

BAD_INPUT = 2

# What typer raises on bad usage, click's UsageError, has no name of its own in typer.
_TyperUsageError = cast("type[typer.BadParameter]", typer.BadParameter.__mro__[1])

app = typer.Typer(
    name="armonic",
    help="The vibration of flexible-joint robots: from a robot file and measured FRFs to a verified dynamic model.",
    epilog="Try `armonic demo` first, then `armonic COMMAND --help`.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (model.modes, model.frf, fitting.update, robots.check, robots.robots, demo.demo):
    app.command()(command)


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
    except ArmonicError as error:
        return _refuse(str(error))
    except _TyperUsageError as error:
        command = error.ctx.command_path if error.ctx else "armonic"
        return _refuse(f"{error.format_message().rstrip('.')}. See `{command} --help`.")
    except OSError as error:
        return _refuse(f"{error.filename or 'system'}: {error.strerror or error}.")
    except typer.Abort:
        return INTERRUPTED
    return status if isinstance(status, int) else 0


def _refuse(message: str) -> int:
    line = "".join(sign if sign.isprintable() else "?" for sign in " ".join(message.split()))
    print(f"error: {line}", file=sys.stderr)  # noqa: T201
    return BAD_INPUT
