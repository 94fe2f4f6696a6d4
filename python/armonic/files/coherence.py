"""Measured coherence, from universal files and CSV, laid on the lines of the responses it belongs to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError
from armonic.files.cells import read_bytes, remapping
from armonic.files.sheet import read_sheet
from armonic.files.uff_reader import COHERENCE, parse, shown
from armonic.files.universal import at_node, axis_of
from armonic.response import Frf

Array = NDArray[np.float64]

SAME_LINE = 1e-5
"""Lines this near, as a share of the highest frequency, are one: a text of single precision keeps six digits."""
ABOVE_ONE = 1e-5
"""By so much single precision takes a coherence above one."""
_HEADER = "a header such as freq_hz,x/x,x/y (response/force; coherence from 0 to 1)"


@dataclass(frozen=True, eq=False)
class Coherence:
    """The coherence γ² of a file.

    Attributes:
        path: the file.
        functions: frequencies in Hz and values, (L,) each, by output and input axis.
    """

    path: str
    functions: Mapping[tuple[str, str], tuple[Array, Array]]

    def on(self, frf: Frf) -> Array:
        """The values on the lines of some responses, (L, outputs, inputs).

        Raises:
            DataFileError: the file has none for one of the responses or lines.
        """
        values = np.empty(frf.values.shape)
        for a, output in enumerate(frf.outputs):
            for b, force in enumerate(frf.inputs):
                values[:, a, b] = self._of(output, force, frf.freq_hz)
        return values

    def _of(self, output: str, force: str, freq_hz: Array) -> Array:
        name = f"{output}/{force}"
        if (output, force) not in self.functions:
            there = ", ".join("/".join(pair) for pair in self.functions)
            raise DataFileError(
                self.path,
                found=f"no coherence of {name}",
                expected="that of every response that is used",
                hint=f"There is {there}.",
            )
        own, values = self.functions[output, force]
        order = np.argsort(own)
        own, values = own[order], values[order]
        nearest = np.searchsorted((own[1:] + own[:-1]) / 2, freq_hz)
        apart = np.abs(own[nearest] - freq_hz) > SAME_LINE * freq_hz[-1]
        if apart.any():
            raise DataFileError(
                self.path,
                found=f"no coherence of {name} at {freq_hz[np.argmax(apart)]:.7g} Hz",
                expected="a value on every line of the response",
            )
        return values[nearest]


def read_coherence(
    path: str | Path,
    *,
    axes: Mapping[str, str] | None = None,
    response_node: int | None = None,
    reference_node: int | None = None,
) -> Coherence:
    """Read the coherence of every response, from a universal file or comma-separated text.

    Of a universal file the data sets 58 of function type 6 are read; it may hold the responses as well. A CSV file has
    the header `freq_hz,x/y,...`, where x/y belongs to the response along x to a force along y, then one line per
    frequency.

    Args:
        path: the file; a name that ends in .csv is CSV, any other a universal file.
        axes: from an axis of the file to the axis of the sensor frame it lies along, as in `read_uff`.
        response_node: the node of the response, where a universal file has several.
        reference_node: the node of the force, where it has several.

    Raises:
        DataFileError: the file holds no coherence, is damaged, has a function twice, or a value beyond 0 to 1.
        FrfError: `axes` does not make sense.
    """
    remap = {source: target for source, (target, _) in remapping(axes).items()}
    of_file = _in_csv(path) if Path(path).suffix.lower() == ".csv" else _in_uff(path, response_node, reference_node)
    functions: dict[tuple[str, str], tuple[Array, Array]] = {}
    for place, output, force, freq_hz, values in of_file:
        key = remap.get(output, output), remap.get(force, force)
        if key in functions:
            raise DataFileError(place, found=f"{'/'.join(key)} again", expected="one coherence of each response")
        if not ((values >= 0) & (values <= 1 + ABOVE_ONE)).all():
            found = f"{values[np.argmax(np.abs(values - 0.5))]:g} at {freq_hz[np.argmax(np.abs(values - 0.5))]:g} Hz"
            raise DataFileError(place, found=found, expected="a coherence from 0 to 1")
        functions[key] = freq_hz, np.minimum(values, 1.0)
    return Coherence(str(path), functions)


_Functions = list[tuple[str, str, str, Array, Array]]  # place, output, input, frequencies, values


def _in_uff(path: str | Path, response_node: int | None, reference_node: int | None) -> _Functions:
    functions, ignored = parse(read_bytes(path), str(path), COHERENCE)
    if not functions:
        found = f"only data sets {', '.join(ignored)}" if ignored else "no data set"
        raise DataFileError(str(path), found=found, expected="coherence: data sets 58 of function type 6")
    functions = at_node(path, functions, "response", response_node)
    functions = at_node(path, functions, "reference", reference_node)
    listed = []
    for function in functions:
        place = f"{path}, line {function.line}"
        output, force = (
            axis_of(place, end, direction)[0]
            for end, (_, direction) in (("response", function.response), ("reference", function.reference))
        )
        listed.append((place, output, force, function.freq_hz, function.values.real))
    return listed


def _in_csv(path: str | Path) -> _Functions:
    sheet = read_sheet(path, _HEADER)
    pairs = [tuple(word.strip().split("/")) for word in sheet.header[1:]]
    wrong = [word for word, pair in zip(sheet.header[1:], pairs, strict=True) if len(pair) != 2 or " " in "".join(pair)]
    if sheet.header[0].strip() != "freq_hz" or not pairs or wrong:
        found = f"column {shown(wrong[0])}" if wrong else shown(",".join(sheet.header))
        raise DataFileError(sheet.place, found=found, expected=_HEADER)
    if not sheet.rows:
        raise DataFileError(str(path), found="a header and no frequency line", expected="at least one line")
    table = sheet.numbers()
    return [
        (f"{path}, column {pair[0]}/{pair[1]}", pair[0], pair[1], table[:, 0], table[:, k])
        for k, pair in enumerate(pairs, 1)
    ]
