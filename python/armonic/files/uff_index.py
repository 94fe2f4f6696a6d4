"""The data sets of a universal file, one by one, without ever holding the file."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from armonic.errors import DataFileError
from armonic.files.uff_reader import Head, Reader, read_head_58, read_lines_58, shown

CHUNK = 1 << 20
"""Bytes that are held at a time."""
HEADER = 1 << 14
"""Bytes within which the header of a data set 58 ends: eleven lines of 80, and room for exporters that write more."""
SCANNED = 0.1
"""Share of the progress for finding the data sets, which takes less than reading their numbers."""

_OVERLAP = 512
_DELIMITER = re.compile(rb"    -1[ \t\r]*(?:\n|\Z)")
_NUMBER = re.compile(rb"(?=[ \d]{5}\d(?:[bB]|[ \t\r]*\n|[ \t\r]*\Z| ))( *\d+)([^\n]*)(?:\n|\Z)")
_ALONE = re.compile(rb"[ \d]{5}\d(?:[bB][ \d]*)?[ \t\r]*(?:\n|\Z)")
_BLANKS = re.compile(rb"[ \t\r\n\x00\x1a]*\Z|(?:[ \t\r]*\n)*")
_LINE_END = re.compile(rb"\r?\n")


class DataSet(NamedTuple):
    """A data set, or what stands between two where `number` is 0.

    Attributes:
        ordinal: which of the file, from 1.
        at: offset of the line with its number.
        number: such as 58.
        binary: the rest of that line, if it says that the values are binary.
        start: offset behind that line.
        stop: offset of the line that closes it.
        fault: why it cannot be read; empty if nothing is known against it.
    """

    ordinal: int
    at: int
    number: int
    binary: str | None
    start: int
    stop: int
    fault: str = ""


class UffSource:
    """A universal file that is open: bytes from anywhere, the line of an offset, and how far the reading is.

    Args:
        path: the file.
        progress: called with the share that is read; None for nobody.

    Raises:
        DataFileError: it is no regular file that can be read, or an empty one.
    """

    def __init__(self, path: str | Path, progress: Callable[[float], object] | None = None) -> None:
        self.name = str(path)
        self.progress = progress
        self._told = 0.0
        self._known = [(0, 1)]  # offsets in order, and the line of each
        try:
            if Path(path).exists() and not Path(path).is_file():
                raise DataFileError(self.name, found="a folder, a device or a pipe", expected="a universal file")
            self._file = Path(path).open("rb")  # noqa: SIM115  closed by __exit__
        except (OSError, ValueError) as error:
            if isinstance(error, DataFileError):
                raise
            found = getattr(error, "strerror", None) or str(error)
            raise DataFileError(self.name, found=found, expected="a readable file") from error
        self.size = self._file.seek(0, 2)

    def __enter__(self) -> UffSource:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def read(self, start: int, stop: int) -> bytes:
        """Bytes from one offset to another, fewer at the end of the file."""
        try:
            self._file.seek(start)
            return self._file.read(max(0, min(stop, self.size) - start))
        except OSError as error:
            raise DataFileError(self.name, found=str(error.strerror or error), expected="a readable file") from error

    def lines(self, start: int, stop: int) -> Iterator[tuple[int, str]]:
        """Offset and text of every line between two offsets."""
        while start < stop:
            data = self.read(start, min(stop, start + CHUNK))
            cut = data.rfind(b"\n") + 1 if start + len(data) < stop else len(data)
            for line in data[: cut or len(data)].splitlines(keepends=True):
                yield start, line.decode("latin-1").rstrip("\r\n")
                start += len(line)
            if not data:
                return

    def line_of(self, offset: int) -> int:
        """The line in which an offset lies, from 1."""
        k = bisect_right(self._known, offset, key=lambda pair: pair[0]) - 1
        at, line = self._known[k]
        if at == offset:
            return line
        while at < offset:
            data = self.read(at, min(offset, at + CHUNK))
            if not data:
                return line
            line += data.count(b"\n")
            at += len(data)
        self._known.insert(k + 1, (at, line))
        return line

    def place(self, offset: int) -> str:
        """File and line, for errors."""
        return f"{self.name}, line {self.line_of(offset)}"

    def done(self, share: float) -> None:
        """Tell how far the reading is; it never goes back, though some functions are read after later ones."""
        self._told = max(self._told, min(share, 1.0))
        if self.progress is not None:
            self.progress(self._told)

    def reader(self, data_set: DataSet) -> Reader:
        """A reader over the header of a data set, whose errors name lines of the file."""
        data = self.read(data_set.start, min(data_set.stop, data_set.start + HEADER))
        return Reader(data, self.name, self.line_of(data_set.start))

    def find(self, start: int, pattern: re.Pattern[bytes], literal: bytes) -> tuple[int, int] | None:
        """Where a pattern is first met, and ends, at or after an offset.

        Args:
            start: the offset.
            pattern: of less than half a kilobyte.
            literal: what it begins with, for speed.
        """
        step = 1 << 12  # most data sets are short
        while start < self.size:
            data = self.read(start, start + step + _OVERLAP)
            at = data.find(literal)
            while 0 <= at < step:
                match = pattern.match(data, at)
                if match is not None:
                    return start + at, start + match.end()
                at = data.find(literal, at + 1)
            start += step
            step = min(2 * step, CHUNK)
            self.done(SCANNED * start / self.size)
        return None


def data_sets(source: UffSource) -> list[DataSet]:
    """All data sets of a universal file, and what stands between them.

    A data set whose end or whose successor's beginning is lost ends where the next begins.

    Args:
        source: the file.

    Raises:
        DataFileError: it is empty, or there is no data set in it.
    """
    found: list[DataSet] = []
    index, position = 0, 3 if source.read(0, 3) == b"\xef\xbb\xbf" else 0
    while (position := _past_blanks(source, position)) < source.size:
        here = _opened(source, position) or (_numbered(source, position) if found else None)
        if here is None:
            following = _next_opening(source, position)
            found.append(DataSet(index, position, 0, None, position, following, _odd(source, position)))
            position = following
            continue
        index += 1
        at, number, binary, start = here
        made = DataSet(index, at, number, binary, start, source.size)
        stop, position, fault = _end(source, made)
        found.append(made._replace(stop=stop, fault=fault))
    if not found:
        raise DataFileError(source.name, found="an empty file", expected="a universal file with data sets 58")
    if not index:
        raise DataFileError(
            source.place(found[0].at),
            found=shown(source.read(found[0].at, found[0].at + 80).decode("latin-1").split("\n")[0].rstrip("\r")),
            expected="the line '    -1' that opens a data set of a universal file",
            hint="The file is not a universal file.",
        )
    return found


def _past_blanks(source: UffSource, position: int) -> int:
    while position < source.size:
        data = source.read(position, position + _OVERLAP)
        match = _BLANKS.match(data)
        length = match.end() if match else 0
        # Blanks without a line end reach the end of the data by chance if the file goes on.
        if length == len(data) and position + length < source.size:
            length = data.rfind(b"\n") + 1 or length
        if not length:
            break
        position += length
    return position


def _opened(source: UffSource, position: int) -> tuple[int, int, str | None, int] | None:
    """Offset and number of a data set that opens here, the rest of that line if binary, and the offset behind."""
    match = _DELIMITER.match(source.read(position, position + _OVERLAP))
    return _numbered(source, position + match.end()) if match else None


def _numbered(source: UffSource, position: int) -> tuple[int, int, str | None, int] | None:
    match = _NUMBER.match(source.read(position, position + _OVERLAP))
    if match is None:
        return None
    rest = match[2].decode("latin-1")
    return position, int(match[1]), rest[1:] if rest[:1] in ("b", "B") else None, position + match.end()


def _next_opening(source: UffSource, position: int) -> int:
    """Offset of the next line '    -1' with a number behind it, or the size of the file."""
    position += 1
    while found := source.find(position, _DELIMITER, b"    -1"):
        at_line = source.read(found[0] - 1, found[0]) == b"\n"
        if _numbered(source, found[1]) if at_line else _alone(source, found[1]):
            return found[0]
        position = found[0] + 1
    return source.size


def _odd(source: UffSource, position: int) -> str:
    lines = source.read(position, position + 200).decode("latin-1").split("\n")
    opened = lines[0].rstrip() == "    -1"
    text = (lines[1] if len(lines) > 1 else "") if opened else lines[0]
    wanted = "the number of a data set in columns 1 to 6" if opened else "the line '    -1' that opens a data set"
    return f"found {shown(text.rstrip())}, expected {wanted}"


def _end(source: UffSource, data_set: DataSet) -> tuple[int, int, str]:
    """Where a data set is closed, where the next begins, and why it cannot be read.

    A line that closes may be lost with what stood before it, so that the next data set opens within a line.
    """
    start = data_set.start
    if data_set.binary is not None:
        # Binary values may look like a line that closes: it is looked for behind them.
        for stop, behind in _ends_by_size(source, data_set):
            return stop, behind, ""
    position = start
    while found := source.find(position, _DELIMITER, b"    -1"):
        at, behind = found
        if _alone(source, behind):
            # It opens another: the end of this one, or the opening of that, is lost.
            return at, at, ""
        if data_set.binary is not None:
            closes = _next_is_fine(source, behind)
        else:
            closes = at == start or source.read(at - 1, at) == b"\n"
        if closes:
            return at, behind, ""
        position = at + 1
    return source.size, source.size, "the file is cut off within it"


def _alone(source: UffSource, position: int) -> bool:
    """Whether a line with the number of a data set and nothing else stands here."""
    return _ALONE.match(source.read(position, position + _OVERLAP)) is not None


def _next_is_fine(source: UffSource, position: int) -> bool:
    """Whether the file ends here or another data set opens."""
    position = _past_blanks(source, position)
    return position >= source.size or _opened(source, position) is not None


def _ends_by_size(source: UffSource, data_set: DataSet) -> Iterator[tuple[int, int]]:
    """Where a binary data set should be closed by what its header says, and where that line ends; if it is there."""
    if data_set.number != 58:
        return
    reader = source.reader(data_set)
    with suppress(DataFileError):  # a damaged header is named when it is read
        head = read_head_58(reader, *read_lines_58(reader))
        for stop in (data_set.start + reader.offset + size for size in _sizes(data_set, head)):
            data = source.read(stop, stop + _OVERLAP)
            ending = _LINE_END.match(data)  # some exporters put a line end before it
            match = _DELIMITER.match(data, ending.end() if ending else 0)
            if match is not None:
                yield stop, stop + match.end()


def _sizes(data_set: DataSet, head: Head) -> list[int]:
    """How many bytes the values of a binary data set may take."""
    item = 8 if head.double else 4
    sizes = [head.length * len(head.columns) * item]
    if head.double and not head.even:  # by the format abscissas stay single, but most programs write them double
        sizes.append(head.length * ((len(head.columns) - 1) * item + 4))
    said = (data_set.binary or "")[24:36].strip()
    if said.isdecimal():
        sizes.append(int(said))
    return sizes
