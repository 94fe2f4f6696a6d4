"""Files to write: refused early where they must not be written, and written together or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from armonic.cli.arguments import UsageError

if TYPE_CHECKING:
    from armonic.updating import Fit


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
    folder = path.resolve().parent
    if not folder.is_dir():
        raise UsageError(where, found=f"no folder {folder}", expected="a folder that exists")
    if path.is_dir():
        raise UsageError(where, found="a folder", expected="the name of a file")
    if any(path.resolve() == source.resolve() for source in sources):
        raise UsageError(where, found="a file that this command already uses", expected="another name")
    if not os.access(folder, os.W_OK):
        raise UsageError(where, found="a folder without permission to write", expected="a writable folder")
    if path.exists() and not force:
        raise UsageError(where, found="a file that exists", expected="a new name", hint="Use --force to overwrite it.")


def write_results(fit: Fit, robot: Path, report: Path | None) -> None:
    """Write the updated robot and, if wanted, the report: both whole, or neither."""
    if report is None:
        fit.robot.save(robot)
        return
    from armonic.report import write_report

    target = report.resolve()
    beside = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        write_report(fit, beside)
        fit.robot.save(robot)
        beside.replace(target)
    finally:
        with suppress(OSError):
            beside.unlink()  # left over only if something failed
