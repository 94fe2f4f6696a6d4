"""What bad input becomes: one line on stderr, for machines a JSON object on stdout as well, and exit code 2."""

from __future__ import annotations

import contextlib
import re
import sys
from typing import Final, cast

import typer

from armonic.cli.terminal import print_json
from armonic.errors import ArmonicError

BAD_INPUT: Final = 2

# What typer raises on bad usage, click's UsageError, has no name of its own in typer.
TyperUsageError = cast("type[typer.BadParameter]", typer.BadParameter.__mro__[1])

_WORDS: Final = (
    (
        "by passing outputs= and inputs=",
        "with --outputs and --inputs, or single responses with --responses x/x,y/y",
    ),
    (
        "Give that line the weight zero, or leave that response out with frf.select(...)",
        "Leave that line out with --band, or that response with --responses",
    ),
    ("with frf.select(...), give it weight zero, or", "by naming the others with --responses x/x,y/y, or"),
    ("frf.select(outputs=..., inputs=...)", "--outputs and --inputs"),
    ("`parameters`", "--parameters"),
)
"""Hints of the library for people who write Python, and what to type instead."""
_KEYWORD: Final = re.compile(r"\b(kind|scale|response_node|reference_node)=")


def refuse(error: Exception, *, as_json: bool) -> int:
    """Say what is wrong; the result is the exit code."""
    data = error_data(error)
    line = "".join(sign if sign.isprintable() else "?" for sign in " ".join(str(data["message"]).split()))
    print(f"error: {line}", file=sys.stderr)  # noqa: T201
    if as_json:
        with contextlib.suppress(OSError):  # if stdout is what failed
            print_json({"error": data})
    return BAD_INPUT


def error_data(error: Exception) -> dict[str, str | None]:
    """An error by its parts, as far as it has them, and as the message that they make."""
    if isinstance(error, ArmonicError):
        hint = error.hint and _typed(error.hint)
        message = str(ArmonicError(error.where, found=error.found, expected=error.expected, hint=hint))
        return _data(error.where, error.found, error.expected, hint, message)
    if isinstance(error, TyperUsageError):
        command = error.ctx.command_path if error.ctx else "armonic"
        found, hint = error.format_message().rstrip("."), f"See `{command} --help`."
        return _data(command, found, None, hint, f"{found}. {hint}")
    where = str(getattr(error, "filename", None) or "system")
    found = getattr(error, "strerror", None) or str(error)
    return _data(where, found, None, None, f"{where}: {found}.")


def _data(where: str, found: str, expected: str | None, hint: str | None, message: str) -> dict[str, str | None]:
    return {"where": where, "found": found, "expected": expected, "hint": hint, "message": message}


def _typed(hint: str) -> str:
    for python, words in _WORDS:
        hint = hint.replace(python, words)
    return _KEYWORD.sub(lambda match: f"--{match[1].replace('_', '-')}", hint)
