"""What people and machines see: tables and lines on a terminal, JSON on stdout, a progress bar on stderr."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

    from armonic.updating import Progress as FitProgress

VERDICT_STYLE = {"identified": "green", "weak": "yellow", "not identifiable": "red", "at bound": "magenta"}


def console() -> Console:
    """The terminal that stdout is now; it takes text as it is, without markup."""
    from rich.console import Console

    return Console(markup=False, emoji=False, highlight=False)


def show(*things: RenderableType) -> None:
    """Print texts and tables."""
    terminal = console()
    for thing in things:
        terminal.print(thing)


def line(text: str) -> None:
    """Print a line that is never broken, so that what stands in it can be copied."""
    sys.stdout.write(f"{text}\n")


def remark(text: str) -> None:
    """One line for people on stderr."""
    print(" ".join(text.split()), file=sys.stderr)  # noqa: T201


def heading(text: str) -> RenderableType:
    """A line in bold."""
    from rich.text import Text

    return Text(text, style="bold")


def warning(text: str) -> RenderableType:
    """A sentence in yellow that says so."""
    from rich.text import Text

    return Text(f"Warning: {text}", style="yellow")


def table(*columns: str) -> Table:
    """An empty table; columns of numbers, marked by a leading ">", are right-aligned and never broken."""
    from rich import box
    from rich.table import Table

    grid = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for column in columns:
        is_number = column.startswith(">")
        grid.add_column(
            column.removeprefix(">"),
            justify="right" if is_number else "left",
            no_wrap=is_number,
            overflow="fold",
            vertical="top",
        )
    return grid


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object on one line; what is not finite becomes null."""
    sys.stdout.write(json.dumps(plain(data), allow_nan=False, ensure_ascii=False) + "\n")


def plain(data: Any) -> Any:
    """Data made of what JSON knows."""
    if isinstance(data, Mapping):
        return {str(key): plain(value) for key, value in data.items()}
    if hasattr(data, "tolist"):  # arrays and scalars of numpy
        return plain(data.tolist())
    if isinstance(data, list | tuple):
        return [plain(value) for value in data]
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    return data


@contextmanager
def fit_progress() -> Iterator[Callable[[FitProgress], None] | None]:
    """A bar on stderr that vanishes at the end, and what moves it; None if nobody would see it."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("Fitting"), BarColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("linearizing", total=1.0)

        def move(now: FitProgress) -> None:
            bar.update(task, completed=now.done, description=f"evaluation {now.evaluations}, cost {now.cost:.4g}")

        yield move


@contextmanager
def stages_progress(doing: str) -> Iterator[Callable[[str], object] | None]:
    """A line on stderr that says what is done now and vanishes at the end; None if nobody would see it."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn(doing), BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda stage: bar.update(task, description=stage)


@contextmanager
def steps_progress(doing: str, what: str) -> Iterator[Callable[[int, int], None] | None]:
    """A bar on stderr that vanishes at the end, and what moves it to (done, all); None if nobody would see it."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(doing), BarColumn(), MofNCompleteColumn(), TextColumn(what), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(doing, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
