"""Comma-separated text as a header and rows of numbers, each with the line it stands in."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.cells import read_bytes
from armonic.files.uff_reader import NUMBER, shown


class Sheet(NamedTuple):
    """A table as it stands in a file: comments start with #, blank lines count for nothing."""

    comments: list[str]
    place: str
    header: list[str]
    rows: list[tuple[str, list[str]]]

    def numbers(self) -> NDArray[np.float64]:
        """All rows, (R, columns).

        Raises:
            DataFileError: a row has another number of values than the header, or something else than a finite number.
        """
        return np.array([_row(place, words, self.header) for place, words in self.rows])


def read_sheet(path: str | Path, expected: str) -> Sheet:
    """A file of comma-separated text, its numbers still as text.

    Args:
        path: the file.
        expected: what its header should be, for errors.

    Raises:
        DataFileError: the file cannot be read, is empty, no text, or cut off within a line.
    """
    lines = list(enumerate(text_of(path, expected).split("\n"), 1))
    table = [(f"{path}, line {k}", line.split(",")) for k, line in lines if line.strip() and not line.startswith("#")]
    if not table:
        raise DataFileError(str(path), found="no table", expected=expected)
    return Sheet([line for _, line in lines if line.startswith("#")], *table[0], table[1:])


def text_of(path: str | Path, expected: str) -> str:
    """The text of a file with its line ends made one; a DataFileError that says what was expected if it is none."""
    try:
        text = read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        found = f"bytes that are not text, at {error.start}"
        raise DataFileError(str(path), found=found, expected="comma-separated text in UTF-8") from error
    if not text.strip():
        raise DataFileError(str(path), found="an empty file", expected=expected)
    if not text.endswith("\n"):
        line = text.count("\n") + 1
        raise DataFileError(
            f"{path}, line {line}",
            found="the end of the file within the line",
            expected="a line end",
            hint="The file looks truncated; if it is whole, end its last line.",
        )
    return text


def _row(place: str, words: list[str], header: list[str]) -> list[float]:
    if len(words) != len(header):
        raise DataFileError(place, found=f"{len(words)} values", expected=f"{len(header)}, one per column")
    for word, column in zip(words, header, strict=True):
        if not NUMBER.fullmatch(word.strip()) or not np.isfinite(float(word)):
            raise DataFileError(place, found=f"{shown(word)} for {column.strip()}", expected="a finite number")
    return [float(word) for word in words]
