"""Points and the lines that join them in universal files: data sets 15, 2411 and 82, both ways."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from armonic.errors import DataFileError
from armonic.files.measured_file import Geometry
from armonic.files.uff_index import DataSet, UffSource
from armonic.files.uff_reader import NUMBER, SIGN_IN_WORD, shown
from armonic.files.uff_writer import ascii_lines, decimal

IN_A_LINE = 8
"""Numbers in a line of a data set 82."""
LONGEST_TRACE = 240
"""Numbers in a data set 82; the format allows 250."""
_NODE_MAX = 10**10 - 1  # ten columns


class Points:
    """Points and trace lines as they are found, data set by data set."""

    def __init__(self) -> None:
        self.points: dict[int, tuple[float, float, float]] = {}
        self.traces: list[list[int]] = []
        self.local = False

    def add_nodes(self, source: UffSource, data_set: DataSet, length: float) -> None:
        """Add the nodes of a data set 15 or 2411, all or none.

        Args:
            source: the file.
            data_set: which.
            length: one metre in its units.

        Raises:
            DataFileError: a line is damaged, or a node stands twice at different places.
        """
        new: dict[int, tuple[float, float, float]] = {}
        local = False
        for at, words in _node_words(source, data_set):
            label, system = (_integer(source, at, word) for word in words[:2])
            x, y, z = (_number(source, at, word) / length for word in words[4:])
            earlier = new.get(label) or self.points.get(label)
            if earlier and not np.allclose(earlier, (x, y, z), rtol=1e-5, atol=1e-9):
                found = f"node {label} at another place than before"
                raise DataFileError(source.place(at), found=found, expected="every node once")
            new[label] = (x, y, z)
            local = local or system > 1
        if not new:
            raise DataFileError(source.place(data_set.at), found="no node", expected="at least one")
        self.points |= new
        self.local = self.local or local

    def add_trace(self, source: UffSource, data_set: DataSet) -> None:
        """Add the trace line of a data set 82.

        Raises:
            DataFileError: it is damaged.
        """
        lines = [(at, text) for at, text in source.lines(data_set.start, data_set.stop) if at == data_set.start or text]
        if len(lines) < 3:
            found = f"{len(lines)} lines"
            raise DataFileError(source.place(data_set.at), found=found, expected="three at least")
        count = _integer(source, lines[0][0], lines[0][1][10:20])
        nodes = [_integer(source, at, word) for at, text in lines[2:] for word in _tens(text)]
        if len(nodes) != count:
            found, expected = f"{len(nodes)} nodes", f"{count}, as its first line says"
            raise DataFileError(source.place(lines[2][0]), found=found, expected=expected)
        self.traces.append(nodes)

    def geometry(self, names: Mapping[int, str], remarks: list[str]) -> Geometry | None:
        """What was found, with the names of nodes; None if there is no point.

        Args:
            names: of nodes; the others are called by their number.
            remarks: sentences are added.
        """
        if not self.points:
            return None
        index = {node: k for k, node in enumerate(self.points)}
        joined: dict[tuple[int, int], None] = {}
        unknown: dict[int, None] = {}
        for trace in self.traces:
            for a, b in itertools.pairwise(trace):
                if not a or not b or a == b:
                    continue  # a move of the pen
                if missing := [node for node in (a, b) if node not in index]:
                    unknown |= dict.fromkeys(missing)
                    continue
                joined[index[a], index[b]] = None
        if unknown:
            listed = ", ".join(str(node) for node in list(unknown)[:6]) + (", ..." if len(unknown) > 6 else "")
            remarks.append(f"Lines lead to nodes that are no points of the file ({listed}): they are left out.")
        if self.local:
            remarks.append(
                "Points stand in coordinate systems of their own: their coordinates are taken as global ones."
            )
        labels = [names.get(node, str(node)) for node in self.points]
        if len(set(labels)) < len(labels):
            labels = [str(node) for node in self.points]
        return Geometry(tuple(labels), np.array(list(self.points.values())), tuple(joined))


def encode_geometry(geometry: Geometry, nodes: Mapping[str, int]) -> bytes:
    """Data sets 15 and 82 in SI units.

    Args:
        geometry: points and lines; coordinates keep seven digits or more.
        nodes: the number of each point.
    """
    numbers = [nodes[name] for name in geometry.names]
    rows = [
        f"{node:10d}{0:10d}{0:10d}{0:10d}" + "".join(f"{decimal(float(x)):>13}" for x in position)
        for node, position in zip(numbers, geometry.positions, strict=True)
    ]
    parts = [ascii_lines(["    -1", "    15", *rows, "    -1"])]
    trace: list[int] = []
    for number, a, b in _pens(geometry.lines):
        step = [numbers[b]] if number else [0, numbers[a], numbers[b]] if trace else [numbers[a], numbers[b]]
        if len(trace) + len(step) > LONGEST_TRACE:
            parts.append(_trace(len(parts), trace))
            trace, step = [], [numbers[a], numbers[b]]
        trace += step
    if trace:
        parts.append(_trace(len(parts), trace))
    return b"".join(parts)


def _pens(lines: Iterable[tuple[int, int]]) -> Iterator[tuple[bool, int, int]]:
    """Lines, each with whether it goes on where the one before ended."""
    end: int | None = None
    for a, b in lines:
        yield a == end, a, b
        end = b


def _trace(number: int, nodes: list[int]) -> bytes:
    rows = ["".join(f"{node:10d}" for node in nodes[k : k + IN_A_LINE]) for k in range(0, len(nodes), IN_A_LINE)]
    return ascii_lines(["    -1", "    82", f"{number:10d}{len(nodes):10d}{0:10d}", "NONE", *rows, "    -1"])


def _node_words(source: UffSource, data_set: DataSet) -> Iterator[tuple[int, list[str]]]:
    """Offset and seven words of each node; of a data set 2411 they stand in two lines."""
    split: list[str] = []
    for at, text in source.lines(data_set.start, data_set.stop):
        words = SIGN_IN_WORD.sub(" ", re.sub("[dD](?=[-+0-9])", "e", text)).split()
        if not words:
            continue
        words = split + words
        if data_set.number == 2411 and len(words) == 4:
            split = words
            continue
        split = []
        if len(words) != 7:
            found = f"{len(words)} numbers"
            raise DataFileError(source.place(at), found=found, expected="seven: a node, three codes, coordinates")
        yield at, words
    if split:
        raise DataFileError(source.place(data_set.stop), found="a node without coordinates", expected="three")


def _tens(text: str) -> list[str]:
    """Fields of ten columns, or words where these do not keep to columns."""
    text = text.rstrip()
    fields = [text[k : k + 10] for k in range(0, len(text), 10)]
    return fields if all(field.strip().isdecimal() for field in fields) else text.split()


def _integer(source: UffSource, at: int, text: str) -> int:
    if not re.fullmatch(r" *\d{1,10} *", text, re.ASCII) or int(text) > _NODE_MAX:
        raise DataFileError(source.place(at), found=shown(text), expected="a number of at most ten digits")
    return int(text)


def _number(source: UffSource, at: int, text: str) -> float:
    if not NUMBER.fullmatch(text) or not np.isfinite(float(text)):
        raise DataFileError(source.place(at), found=shown(text), expected="a finite number")
    return float(text)
