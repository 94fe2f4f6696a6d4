"""Universal files out: frequency responses as data sets 58 (text) or 58b (binary) in SI units."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.uff_reader import FREQUENCY, FRF, HEADER_LINES, Function

_ZERO = "0.00000e+00"


def encode(functions: Iterable[Function], *, binary: bool, title: str) -> bytes:
    """A universal file: header (151), SI units (164) and one data set 58 or 58b in double precision each.

    Text keeps 13 digits of the values and about 10 of the frequencies; binary keeps every bit of the values.

    Args:
        functions: what to write; their values must be in SI units.
        binary: write 58b instead of text.
        title: the name of the model in the header.

    Raises:
        DataFileError: frequencies are too close to each other to be told apart in text.
    """
    return b"".join([header(title), *(_encode_58(function, binary=binary) for function in functions)])


def _encode_58(function: Function, *, binary: bool) -> bytes:
    return data_set_58(
        kind=FRF,
        ids=(function.title, "", timestamp(), function.note, ""),
        response=("NONE", *function.response),
        reference=("NONE", *function.reference),
        abscissa=(FREQUENCY, "Frequency", "Hz"),
        ordinate=(function.response_type, "Response", function.response_unit),
        denominator=(function.reference_type, "Reference", function.reference_unit),
        form=frequencies(function.freq_hz, function.values, binary=binary),
        binary=binary,
    )


class Form(NamedTuple):
    """Values as a data set 58 stores them: start and step as text, whether these are all, how many, and the bytes."""

    storage: int
    start: str
    step: str
    even: bool
    length: int
    payload: bytes


def data_set_58(
    *,
    kind: int,
    ids: Sequence[str],
    response: tuple[str, int, int],
    reference: tuple[str, int, int],
    abscissa: tuple[int, str, str],
    ordinate: tuple[int, str, str],
    denominator: tuple[int, str, str],
    form: Form,
    binary: bool,
    version: int = 0,
) -> bytes:
    """One data set 58, or 58b.

    Args:
        kind: function type.
        ids: the five lines ahead.
        response: entity of at most ten letters or NONE, node, and direction.
        reference: likewise.
        abscissa: specific data type, label and unit.
        ordinate: likewise.
        denominator: likewise.
        form: the values.
        binary: whether the values are.
        version: or sequence number.
    """
    size = f"b{1:6d}{2:6d}{HEADER_LINES:12d}{len(form.payload):12d}{0:6d}{0:6d}{0:12d}{0:12d}" if binary else ""
    dofs = " ".join(f"{entity:10}{node:10d}{direction:4d}" for entity, node, direction in (response, reference))
    lines = [
        "    -1",
        f"    58{size}",
        *(_id_line(text) for text in ids),
        f"{kind:5d}{0:10d}{version:5d}{0:10d} {dofs}",
        f"{form.storage:10d}{form.length:10d}{form.even:10d}{form.start:>13}{form.step:>13}{_ZERO:>13}",
        *(
            f"{number:10d}{0:5d}{0:5d}{0:5d} {label:20.20} {unit or 'NONE':20.20}"
            for number, label, unit in (abscissa, ordinate, denominator, (0, "NONE", "NONE"))
        ),
    ]
    return ascii_lines(lines) + form.payload + b"    -1\n"


def frequencies(f: NDArray[np.float64], values: NDArray[Any], *, binary: bool) -> Form:
    """Complex or real values over frequencies in Hz, double precision.

    Raises:
        DataFileError: frequencies are too close to each other to be told apart in text.
    """
    start, step, even = _spacing(f)
    parts = [values.real, values.imag] if np.iscomplexobj(values) else [values]
    if binary:
        columns = parts if even else [f, *parts]
        payload = np.column_stack(columns).astype("<f8").tobytes()
    else:
        payload = _text_values(f, parts, even=even)
    return Form(2 + 2 * len(parts), start, step, even, f.size, payload)


def _spacing(f: NDArray[np.float64]) -> tuple[str, str, bool]:
    """Start and step as text, and whether they give back every frequency."""
    if f.size == 1:
        return decimal(f[0]), _ZERO, True
    start, step = decimal(f[0]), decimal((f[-1] - f[0]) / (f.size - 1))
    off = np.abs(float(start) + float(step) * np.arange(f.size) - f).max()
    even = bool(off <= min(1e-9 * f[-1], 1e-3 * np.diff(f).min()))
    return (start, step, True) if even else (_ZERO, _ZERO, False)


def _text_values(f: NDArray[np.float64], parts: list[NDArray[np.float64]], *, even: bool) -> bytes:
    if even:
        numbers = np.column_stack(parts).ravel()
        full, rest = divmod(numbers.size, 4)
        form = ("%20.12e" * 4 + "\n") * full + ("%20.12e" * rest + "\n" if rest else "")
        return (form % tuple(numbers)).encode()
    abscissas = [decimal(value) for value in f]
    if not (np.diff([float(text) for text in abscissas]) > 0).all():
        raise DataFileError(
            "freq_hz",
            found="unevenly spaced frequencies that differ only after the tenth digit",
            expected="frequencies which a universal file in text can tell apart",
            hint="Write it with binary=True, or as CSV.",
        )
    rows = zip(abscissas, *parts, strict=True)
    words = [f"{text:>13}" + "".join(f"{value:20.12e}" for value in row) for text, *row in rows]
    at_once = 3 - len(parts)  # rows in a line: two of real values, one of complex ones
    return "".join("".join(words[k : k + at_once]) + "\n" for k in range(0, len(words), at_once)).encode()


def decimal(value: float) -> str:
    """The closest decimal number within 12 characters; always with a point, which Fortran needs."""
    return next(text for n in range(11, 0, -1) if len(text := f"{value:#.{n}g}") <= 12)


def header(title: str) -> bytes:
    """Data sets 151 and 164 of a file in SI units."""
    one, zero = "1.00000000000000000D+00", "0.00000000000000000D+00"
    stamp = f"{timestamp():20}"
    return ascii_lines(
        [
            *("    -1", "   151", _id_line(title), "NONE", "Armonic"),
            *(f"{stamp}{0:10d}{0:10d}{0:10d}", stamp, "Armonic", stamp, "    -1"),
            *("    -1", "   164", f"{1:10d}{'SI: Meter (newton)':20}{1:10d}"),
            *(f"{one:>25}{one:>25}{one:>25}", f"{zero:>25}", "    -1"),
        ]
    )


def _id_line(text: str) -> str:
    return " ".join(text.split()) or "NONE"


def timestamp() -> str:
    """Now, as universal files write it."""
    return time.strftime("%d-%b-%y %H:%M:%S")


def ascii_lines(lines: Iterable[str]) -> bytes:
    """Lines of at most 80 characters; what is not ASCII becomes a question mark."""
    return "".join(f"{line:.80}\n" for line in lines).encode("ascii", "replace")
