"""The command line in the tests: run in this process, and read back as a person or a machine would."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

WIDTH = 80
EXAMPLES = Path(__file__).parents[1] / "python" / "armonic" / "examples"
MEASURED, START, TRUE = (str(EXAMPLES / name) for name in ("kuka_milling.uff", "kuka_start.yaml", "kuka_true.yaml"))


@dataclass(frozen=True)
class Run:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def words(self) -> str:
        """What was printed, without line breaks and runs of blanks."""
        return " ".join(self.out.split())

    @property
    def json(self) -> dict[str, Any]:
        """The one JSON object on stdout, which must hold nothing else; NaN and Infinity are no JSON."""

        def refuse(word: str) -> None:
            raise AssertionError(f"{word} is no JSON")

        assert (self.code, self.err) == (0, ""), self
        data = json.loads(self.out, parse_constant=refuse)
        assert isinstance(data, dict)
        assert all(math.isfinite(number) for number in numbers(data))
        return data

    @property
    def error(self) -> str:
        """The one line that bad input gets."""
        lines = self.err.splitlines()
        assert self.code == 2, self
        assert len(lines) == 1, self
        assert lines[0].startswith("error: "), self
        assert "Traceback" not in self.out
        return lines[0]


class Armonic(Protocol):
    """The command: words in, what it left behind out."""

    def __call__(self, *words: str | Path) -> Run: ...


def numbers(data: Any) -> Iterator[float]:
    """Every number in nested lists and mappings."""
    if isinstance(data, dict):
        data = list(data.values())
    if isinstance(data, list):
        for value in data:
            yield from numbers(value)
    elif isinstance(data, int | float) and not isinstance(data, bool):
        yield data


def files(folder: Path) -> list[str]:
    """What is in a folder, hidden files too."""
    return sorted(os.listdir(folder))  # noqa: PTH208
