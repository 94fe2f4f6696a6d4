"""Files to write: refused early where they must not be written."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from armonic.cli.arguments import UsageError


def check_output(option: str, path: Path, *, force: bool, sources: Iterable[Path] = ()) -> None:
    """Make sure that a file can be written, before the work that would be lost.

    Args:
        option: what names the path on the command line.
        path: the file.
        force: whether an existing file may be replaced.
        sources: files that must not be replaced in any case: what is read, and other outputs.

    Raises:
        UsageError: the folder does not exist or is closed, or something is there that must not be replaced.
    """
    where = f"{option} {path}"
    try:
        folder = path.resolve().parent
    except (OSError, RuntimeError):
        raise UsageError(where, found="a loop of links", expected="the name of a file") from None
    if not folder.is_dir():
        raise UsageError(where, found=f"no folder {folder}", expected="a folder that exists")
    if path.is_dir():
        raise UsageError(where, found="a folder", expected="the name of a file")
    if any(path.resolve() == source.resolve() for source in sources):
        raise UsageError(where, found="a file that this command already uses", expected="another name")
    if not os.access(folder, os.W_OK):
        raise UsageError(where, found="a folder without permission to write", expected="a writable folder")
    if path.exists() and not path.is_file():
        raise UsageError(where, found="a device or a pipe", expected="the name of a file")
    if path.exists() and not force:
        raise UsageError(where, found="a file that exists", expected="a new name", hint="Use --force to overwrite it.")
