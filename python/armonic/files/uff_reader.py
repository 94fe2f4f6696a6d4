"""Universal files in: every frequency response, or coherence, of data set 58, in text or binary, with its units.

The format is that of the UC-SDRL storehouse of universal files, data sets 58, 58b, 151 and 164. The reader is
our own because a measurement must never be read in part: every count, field and number is checked, and what
does not fit is a `DataFileError` that names the line. Other data sets and function types are passed over.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
"""A decimal number, without the extras of Python's float(): nan, infinity, underscores."""

FUNCTION_TYPES = {1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "FRF", 6: "coherence"}
FRF = 4
COHERENCE = 6
TIME_RESPONSE = 1
TIME = 17
FREQUENCY = 18
HEADER_LINES = 11
TRUNCATED = "The file looks truncated: export or copy it again."

_OPEN = re.compile(rb"    -1[ \r]*(?:\n|\Z)")
CLOSE = re.compile(rb"^    -1[ \r]*(?:\n|\Z)", re.MULTILINE)
_CLOSE_BINARY = re.compile(rb"(?:\r?\n)?    -1[ \r]*(?:\n|\Z)")  # some exporters put a line end before it
_LINE = re.compile(rb"([^\n]*)(?:\n|\Z)")
_BLANK_LINES = re.compile(rb"(?:[ \t\r]*\n)*")
_NOTHING_MORE = re.compile(rb"[\s\x1a\x00]*\Z")
SIGN_IN_WORD = re.compile(r"(?<=[\d.])(?=[+-])", re.ASCII)


class Units(NamedTuple):
    """One metre and one newton in the units of the file (data set 164): SI value = value / factor."""

    length: float = 1.0
    force: float = 1.0
    code: int = 0  # 1 is SI, 0 says that the file has no data set 164


_SI = Units()


@dataclass(frozen=True, eq=False)
class Function:
    """One frequency response of a file, in the units of the file; of a coherence the values are real.

    `response` and `reference` are (node, direction); a direction is ±1, ±2, ±3 for ±x, ±y, ±z and ±4 to ±6
    for rotations. The types are specific data types: 8 displacement, 11 velocity, 12 acceleration, 13 force.
    """

    freq_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    response: tuple[int, int]
    reference: tuple[int, int]
    response_type: int
    reference_type: int
    response_unit: str
    reference_unit: str
    title: str
    note: str
    units: Units = _SI
    line: int = 0


def parse(data: bytes, name: str, wanted: int = FRF) -> tuple[list[Function], list[str]]:
    """Every frequency response in a universal file, and what else was there.

    Args:
        data: the whole file.
        name: its name, for errors.
        wanted: function type to read, FRF or COHERENCE.

    Returns:
        the functions in file order, and one phrase for each sort of data set passed over.

    Raises:
        DataFileError: the file is not a universal file, is truncated or corrupt.
    """
    reader = Reader(data.removeprefix(b"\xef\xbb\xbf"), name)
    functions: list[Function] = []
    ignored: Counter[str] = Counter()
    units = _SI
    if _NOTHING_MORE.match(reader.data):
        raise DataFileError(name, found="an empty file", expected="a universal file with data sets 58")
    with np.errstate(all="ignore"):  # overflow and NaN are caught as numbers that are not finite
        while reader.enter():
            number, binary = reader.identify()
            if number == 58:
                kind, function = _read_58(reader, units, binary, wanted)
                if function is None:
                    ignored[f"58 of function type {kind} ({FUNCTION_TYPES.get(kind, 'other')})"] += 1
                else:
                    functions.append(function)
                continue
            ignored[str(number)] += 1
            body = reader.to_close(binary=binary is not None)
            if number == 164:
                units = read_164(reader, body)
    return functions, [what if n == 1 else f"{n} of {what}" for what, n in ignored.items()]


class Reader:
    """A position in the bytes of a file, or of a part that begins at its line `first_line`; errors name the line."""

    def __init__(self, data: bytes, name: str, first_line: int = 1) -> None:
        self.data, self.name, self.first_line = data, name, first_line
        self.offset = self.start = 0

    def error(self, found: str, expected: str, hint: str | None = None, *, at: int | None = None) -> DataFileError:
        """An error at the line of a place in the data, by default the present one."""
        line = self.first_line + self.data.count(b"\n", 0, self.offset if at is None else at)
        return DataFileError(f"{self.name}, line {line}", found=found, expected=expected, hint=hint)

    def line(self) -> str:
        """The next line, without its end; the reader stands behind it."""
        match = _LINE.match(self.data, self.offset)
        assert match is not None  # the pattern matches the empty line as well
        self.offset = match.end()
        return _text(match[1])

    def enter(self) -> bool:
        """Step into the next data set; False at the end of the file."""
        if _NOTHING_MORE.match(self.data, self.offset):
            return False
        if blank := _BLANK_LINES.match(self.data, self.offset):
            self.offset = blank.end()
        opening = _OPEN.match(self.data, self.offset)
        if opening is None:
            raise self.error(
                shown(self.line_here()),
                "the line '    -1' that opens a data set of a universal file",
                "The file is not a universal file, or the end of a data set is lost.",
            )
        self.offset = self.start = opening.end()
        return True

    def line_here(self) -> str:
        """The rest of the present line, at most 80 characters; the reader stays."""
        return _text(self.data[self.offset : self.offset + 80].split(b"\n")[0])

    def identify(self) -> tuple[int, str | None]:
        """Number of the data set, and the rest of its line if it is binary."""
        line = self.line()
        if not re.fullmatch(r" *\d+ *", line[:6], re.ASCII):
            raise self.error(shown(line), "the number of a data set in columns 1 to 6", at=self.start)
        return int(line[:6]), line[7:] if line[6:7] in ("b", "B") else None

    def to_close(self, *, binary: bool = False) -> bytes:
        """The rest of this data set, and step behind it."""
        close = (_CLOSE_BINARY if binary else CLOSE).search(self.data, self.offset)
        if close is None:
            raise self.error(
                "the end of the file", "the line '    -1' that closes the data set", TRUNCATED, at=self.start
            )
        body = self.data[self.offset : close.start()]
        self.offset = close.end()
        return body

    def integer(self, text: str, what: str, at: int) -> int:
        """An integer field; blank is zero, as in Fortran."""
        if not text.strip():
            return 0
        if not re.fullmatch(r" *[+-]?\d+ *", text, re.ASCII):
            raise self.error(shown(text), f"an integer: {what}", at=at)
        return int(text)

    def number(self, text: str, what: str, at: int) -> float:
        """A finite number; blank is zero, and the exponent may be written with D, as in Fortran."""
        text = text.strip().replace("D", "E").replace("d", "e")
        if not text:
            return 0.0
        if not NUMBER.fullmatch(text) or not np.isfinite(float(text)):
            raise self.error(shown(text), f"a finite number: {what}", at=at)
        return float(text)


def _text(raw: bytes) -> str:
    raw = raw.rstrip(b"\r")
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def shown(text: str) -> str:
    """Text of a file as an error quotes it: short, and without control characters."""
    return repr(text if len(text) <= 40 else text[:40] + "…")


def read_164(reader: Reader, body: bytes) -> Units:
    """The units of a data set 164: factors to SI."""
    lines = _text(body).split("\n")
    words = " ".join(lines[1:]).split()
    if len(words) < 2:
        raise reader.error(f"{len(words)} unit factors", "factors for length and force (data set 164)", at=reader.start)
    factors = [reader.number(word, "a unit factor (data set 164)", reader.start) for word in words[:2]]
    if min(factors) <= 0:
        raise reader.error(f"a unit factor of {min(factors):g}", "positive factors (data set 164)", at=reader.start)
    return Units(factors[0], factors[1], reader.integer(lines[0][:10], "units code", reader.start))


class Head(NamedTuple):
    """The header of a data set 58: all lines, where each begins in the data of the reader, and the fields.

    `kind` is the function type; `numbers` are function identification, version and load case, zero where unreadable.
    `response` and `reference` are (node, direction). `storage` is the ordinate data type; an abscissa that is `even`
    has `start` and `step`. `types` and `units` are of abscissa, ordinate and denominator.
    """

    lines: list[str]
    places: list[int]
    kind: int
    numbers: tuple[int, int, int]
    response: tuple[int, int]
    reference: tuple[int, int]
    storage: int
    length: int
    even: bool
    start: float
    step: float
    types: tuple[int, int, int]
    units: tuple[str, str, str]

    @property
    def real(self) -> bool:
        """Whether the values are."""
        return self.storage in (2, 4)

    @property
    def double(self) -> bool:
        """Whether they have 64 bits each."""
        return self.storage in (4, 6)

    @property
    def columns(self) -> tuple[str, ...]:
        """What stands in a row of the values: x if it is uneven, re, im if it is complex."""
        return (*(() if self.even else ("x",)), "re", *(() if self.real else ("im",)))


def read_lines_58(reader: Reader) -> tuple[int, list[str], list[int]]:
    """Function type and lines of the header of a data set 58, and where each begins; the reader stands behind them."""
    lines: list[str] = []
    places: list[int] = []
    for count in range(HEADER_LINES):
        if reader.offset >= len(reader.data) or CLOSE.match(reader.data, reader.offset):
            raise reader.error(f"{count} header lines", f"{HEADER_LINES} header lines of data set 58", TRUNCATED)
        places.append(reader.offset)
        lines.append(reader.line())
    return reader.integer(lines[5][0:5], "function type", places[5]), lines, places


def read_head_58(reader: Reader, kind: int, lines: list[str], places: list[int]) -> Head:
    """The fields of a header, from what `read_lines_58` found."""
    dof, form = lines[5], lines[6]
    nodes = [reader.integer(dof[a:b], "node", places[5]) for a, b in ((41, 51), (66, 76))]
    directions = [reader.integer(dof[a:b], "direction", places[5]) for a, b in ((51, 55), (76, 80))]
    storage, count, spacing = (
        reader.integer(form[10 * i : 10 * i + 10], what, places[6])
        for i, what in enumerate(("ordinate data type", "number of values", "abscissa spacing"))
    )
    start, step = (reader.number(form[a:b], "abscissa", places[6]) for a, b in ((30, 43), (43, 56)))
    types = [reader.integer(lines[k][:10], "specific data type", places[k]) for k in (7, 8, 9)]
    if count < 1:
        raise reader.error(f"{count} values", "at least one", at=places[6])
    if spacing not in (0, 1):
        raise reader.error(f"abscissa spacing {spacing}", "0 (uneven) or 1 (even)", at=places[6])
    units = [line[46:67].strip() for line in lines[7:10]]
    return Head(
        lines,
        places,
        kind,
        (_tolerant(dof[5:15]), _tolerant(dof[15:20]), _tolerant(dof[20:30])),
        (nodes[0], directions[0]),
        (nodes[1], directions[1]),
        storage,
        count,
        spacing == 1,
        start,
        step,
        (types[0], types[1], types[2]),
        (units[0], units[1], units[2]),
    )


def refuse_other_abscissa(reader: Reader, head: Head, wanted: int) -> None:
    """Refuse an abscissa that is not frequency in Hz (FREQUENCY) or time in s (TIME), as is wanted."""
    kind, unit, at = head.types[0], head.units[0], head.places[7]
    found = f"an abscissa of data type {kind} in {unit or 'no unit'}"
    if wanted == FREQUENCY and (kind not in (0, 1, FREQUENCY) or re.search("rad|rpm|khz", unit, re.I)):
        raise reader.error(found, "18 (frequency) in Hz", at=at)
    if wanted == TIME and (kind not in (0, 1, TIME) or unit.lower() not in ("", "none", "s", "sec", "seconds")):
        raise reader.error(found, "17 (time) in s", at=at)


def _tolerant(text: str) -> int:
    return int(text) if re.fullmatch(r" *[+-]?\d+ *", text, re.ASCII) else 0


def _read_58(reader: Reader, units: Units, binary: str | None, wanted: int) -> tuple[int, Function | None]:
    kind, lines, places = read_lines_58(reader)
    if kind != wanted:
        reader.to_close(binary=binary is not None)
        return kind, None
    head = read_head_58(reader, kind, lines, places)
    if head.storage not in (5, 6) and not (head.real and wanted == COHERENCE):
        found = f"ordinate data type {head.storage}{' (real)' if head.real else ''}"
        expected = "5 or 6 (complex) for an FRF" if wanted == FRF else "2 or 4 (real) for a coherence"
        raise reader.error(found, expected, at=places[6])
    refuse_other_abscissa(reader, head, FREQUENCY)
    if binary is None:
        table = _text_table(reader, head.length, head.columns)
    else:
        table = binary_table(reader, binary, head.length, head.columns, double=head.double)
    freq_hz = np.float64(head.start) + head.step * np.arange(head.length) if head.even else table[:, 0]
    if not (np.isfinite(table).all() and np.isfinite(freq_hz).all()):
        raise reader.error("NaN or infinity among the values", "finite numbers", at=reader.start)
    imaginary = np.zeros(head.length) if head.real else table[:, -1]
    return kind, Function(
        freq_hz=freq_hz,
        values=table[:, head.columns.index("re")] + 1j * imaginary,
        response=head.response,
        reference=head.reference,
        response_type=head.types[1],
        reference_type=head.types[2],
        response_unit=head.units[1],
        reference_unit=head.units[2],
        title=lines[0].strip(),
        note=lines[3].strip(),
        units=units,
        line=1 + reader.data.count(b"\n", 0, reader.start),
    )


def _text_table(reader: Reader, count: int, columns: tuple[str, ...]) -> NDArray[np.float64]:
    at = reader.offset
    text = _text(reader.to_close()).replace("D", "E").replace("d", "e")
    words = SIGN_IN_WORD.sub(" ", text).split()  # full columns may leave no blank before a sign
    for word in words:
        if not NUMBER.fullmatch(word):
            raise reader.error(shown(word), "a number", at=at + max(text.find(word), 0))
    width = len(columns)
    needed = count * width
    # Some exporters fill the last line with zeros, of which a line holds six at most.
    padded = needed < len(words) < needed + 6 and not any(float(word) for word in words[needed:])
    if len(words) != needed and not padded:
        raise reader.error(
            f"{len(words)} numbers",
            f"{needed}, for {count} lines of {', '.join(columns)}",
            TRUNCATED if len(words) < needed else None,
            at=at,
        )
    return np.array([float(word) for word in words[:needed]]).reshape(count, width)


def binary_table(
    reader: Reader, rest: str, count: int, columns: tuple[str, ...], *, double: bool
) -> NDArray[np.float64]:
    """The values of a data set 58b, (count, columns), after the rest of its first line."""
    order, floats, lines = (
        reader.integer(rest[a:b], "a field of 58b", reader.start) for a, b in ((0, 6), (6, 12), (12, 24))
    )
    if order not in (1, 2) or floats != 2 or lines != HEADER_LINES:
        raise reader.error(
            f"58b with byte order {order}, float format {floats}, {lines} header lines",
            f"byte order 1 or 2, float format 2 (IEEE 754), {HEADER_LINES} header lines",
            at=reader.start,
        )
    number = f"{'<' if order == 1 else '>'}f{8 if double else 4}"
    layouts = [np.dtype([(column, number) for column in columns])]
    if double and columns[0] == "x":  # the format says that abscissas stay single; most programs write them double
        layouts.append(np.dtype([("x", number[:2] + "4"), *((column, number) for column in columns[1:])]))
    at = reader.offset
    for layout in layouts:
        close = _CLOSE_BINARY.match(reader.data, at + count * layout.itemsize)
        if close is not None and at + count * layout.itemsize <= len(reader.data):
            rows = np.frombuffer(reader.data, dtype=layout, count=count, offset=at)
            reader.offset = close.end()
            return np.column_stack([rows[column].astype(np.float64) for column in columns])
    found = len(reader.to_close(binary=True))
    raise reader.error(
        f"{found} bytes of values",
        f"{count * layouts[0].itemsize}, for {count} lines of {', '.join(columns)}",
        TRUNCATED,
        at=at,
    )
