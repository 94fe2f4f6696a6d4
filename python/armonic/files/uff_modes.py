"""Modes in universal files: data sets 55 of normal modes and complex eigenvalues, both ways."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armonic.comparison import ModeTable
from armonic.errors import DataFileError
from armonic.files.cells import AXES
from armonic.files.measured_file import Skipped
from armonic.files.series_uff import MARK, of_ours, stem_of
from armonic.files.uff_index import DataSet, UffSource
from armonic.files.uff_reader import NUMBER, SIGN_IN_WORD, Units, shown
from armonic.files.uff_writer import ascii_lines, decimal, timestamp

Complex = NDArray[np.complex128]

NORMAL, COMPLEX = (2,), (3, 7)
"""Analysis types whose data are modes."""
ANALYSES = {0: "unknown", 1: "static", 4: "transient", 5: "frequency response", 6: "buckling"}
"""The other ones."""
COLUMNS = 13
_SAME_POLE, _PARALLEL = 1e-9, 0.99
"""Two modes of one pole, and of a MAC beyond that, are one; two of a symmetric structure have different shapes."""
_AGREE = 1e-4
"""A pole in full may differ from that of the field, of six digits or fewer, by this share of its size."""


class UffMode(NamedTuple):
    """A mode of a data set 55.

    Attributes:
        data_set: where it stands.
        pole: λ, Im λ > 0 if it oscillates, rad/s.
        shapes: of each node along and about x, y, z, complex; NaN for what the data set has no values for.
        modal_a: modal A of a complex mode, 0 if not given: the residue of a pair is ψψᵀ / A.
        modal_b: modal B, −λ A.
        modal_mass: of a normal mode, in the units of the file, 0 if not given.
    """

    data_set: DataSet
    pole: complex
    shapes: Mapping[int, Complex]
    modal_a: complex = 0.0
    modal_b: complex = 0.0
    modal_mass: float = 0.0


def read_mode(source: UffSource, data_set: DataSet, units: Units | None) -> UffMode:
    """A mode, from a data set 55 of data at nodes.

    A normal mode has a natural frequency and a viscous damping ratio, or half the hysteretic one; a complex mode has
    its eigenvalue in rad/s, of which one that turns backwards is taken for its conjugate.

    Args:
        source: the file.
        data_set: which.
        units: of the file; displacements become metres.

    Raises:
        DataFileError: it is damaged or no mode.
    """
    lines = [(at, text) for at, text in source.lines(data_set.start, data_set.stop)]
    if len(lines) < 8:
        found = f"{len(lines)} header lines"
        raise DataFileError(source.place(data_set.at), found=found, expected="8 header lines of data set 55")
    _, analysis, characteristic, _, storage, width = _integers(source, *lines[5], 6)
    if analysis not in NORMAL + COMPLEX:
        found = f"analysis type {analysis} ({ANALYSES.get(analysis, 'other')})"
        raise DataFileError(source.place(lines[5][0]), found=found, expected="2, 3 or 7: modes")
    if characteristic not in (0, 2, 3) or width not in (3, 6) or storage not in (2, 5):
        found = f"data characteristic {characteristic}, data type {storage}, {width} values per node"
        raise DataFileError(source.place(lines[5][0]), found=found, expected="3 or 6 real or complex values per node")
    parameters = _reals(source, *lines[7])
    needed = 1 if analysis in NORMAL else 2
    if len(parameters) < needed:
        found = f"{len(parameters)} parameters"
        raise DataFileError(source.place(lines[7][0]), found=found, expected=f"{needed} at least")
    parameters += [0.0] * (6 - len(parameters))
    shapes = _shapes(source, lines[8:], width, real=storage == 2)
    length = 1.0 if units is None else units.length
    shapes = {node: np.concatenate([shape[:3] / length, shape[3:]]) for node, shape in shapes.items()}
    if analysis in NORMAL:
        freq_hz, mass, viscous, hysteretic = parameters[:4]
        damping = viscous or hysteretic / 2
        if not freq_hz > 0 or not -1 < damping < 1:
            found = f"{freq_hz:g} Hz with a damping ratio of {damping:g}"
            raise DataFileError(source.place(lines[7][0]), found=found, expected="a frequency in Hz, a ratio below 1")
        pole = 2 * np.pi * freq_hz * (-damping + 1j * np.sqrt(1 - damping**2))
        return UffMode(data_set, complex(pole), shapes, modal_mass=mass)
    pole, a, b = (complex(*parameters[k : k + 2]) for k in (0, 2, 4))
    if abs(pole) == 0:
        raise DataFileError(source.place(lines[7][0]), found="an eigenvalue of zero", expected="one in rad/s")
    pole = _exact(lines[3][1], pole)
    if pole.imag < 0:
        pole, a, b = pole.conjugate(), a.conjugate(), b.conjugate()
        shapes = {node: shape.conj() for node, shape in shapes.items()}
    return UffMode(data_set, pole, shapes, a, b)


def mode_table(
    modes: Sequence[UffMode], names: Mapping[int, str], skipped: list[Skipped], source: UffSource
) -> ModeTable | None:
    """Modes as a table over PLACE.AXIS, in the order of the file; None if there is none.

    Nodes that a data set leaves out, and degrees of freedom that are zero in every mode, do not move or were not
    measured: the former are zero, the latter are left out.

    Args:
        modes: from `read_mode`.
        names: of nodes.
        skipped: modes that stand in the file again, as half of a conjugate pair or for another reference.
        source: the file.
    """
    kept: list[UffMode] = []
    for mode in modes:
        twin = next((m for m in kept if _same(m, mode)), None)
        if twin is None:
            kept.append(mode)
            continue
        reason = f"its pole is that of data set {twin.data_set.ordinal}, which is kept"
        skipped.append(Skipped(mode.data_set.ordinal, source.line_of(mode.data_set.at), "data set 55, a mode", reason))
    if not kept:
        return None
    poles = np.array([mode.pole for mode in kept])
    nodes = {node: n for n, node in enumerate(dict.fromkeys(node for mode in kept for node in mode.shapes))}
    values = np.zeros((len(kept), len(nodes), len(AXES)), np.complex128)
    for k, mode in enumerate(kept):
        for node, shape in mode.shapes.items():
            values[k, nodes[node]] = np.nan_to_num(shape)
    flat = values.reshape(len(kept), -1)
    moving = np.flatnonzero(flat.any(axis=0))
    if not moving.size:
        return ModeTable(poles)
    labels = [f"{names.get(node, str(node))}.{axis}" for node in nodes for axis in AXES]
    if len({labels[k] for k in moving}) < moving.size:
        labels = [f"{node}.{axis}" for node in nodes for axis in AXES]
    return ModeTable(poles, flat[:, moving], tuple(labels[k] for k in moving))


def encode_modes(modes: ModeTable, nodes: Mapping[str, int], modal_a: ArrayLike | None = None) -> bytes:
    """Data sets 55 in the form of complex eigenvalues, one for each mode.

    Poles keep every bit in a line that other programs show as text, and six digits where these read them; shapes keep
    seven digits or more of numbers from 1e-3 to 1e9, and six of others.

    Args:
        modes: poles and shapes over PLACE.AXIS.
        nodes: the number of each place.
        modal_a: modal A of each mode, (m,); zeros, which say that it is not known, if not given.

    Raises:
        DataFileError: there are no shapes, one is not known, or a coordinate is no PLACE.AXIS.
    """
    if modes.shapes is None or modes.coordinates is None:
        raise DataFileError("modes", found="modes without shapes", expected="shapes, which data sets 55 hold")
    if not np.isfinite(modes.shapes).all():
        raise DataFileError("modes", found="a shape that is not known", expected="shapes of all modes")
    a = np.zeros(len(modes.poles), np.complex128) if modal_a is None else np.asarray(modal_a, np.complex128)
    if a.shape != modes.poles.shape or not np.isfinite(a).all():
        raise DataFileError("modal_a", found=f"shape {a.shape}", expected=f"{len(modes.poles)} finite numbers")
    dofs = []
    for name in modes.coordinates:
        place, code = stem_of(name)
        if not code:
            hint = "Write modes of other coordinates as HDF5."
            raise DataFileError("modes", found=f"coordinate {name!r}", expected="PLACE.AXIS of x to rz", hint=hint)
        dofs.append((place, code - 1))
    places = {place: n for n, place in enumerate(dict.fromkeys(place for place, _ in dofs))}
    width = 6 if any(axis > 2 for _, axis in dofs) else 3
    parts = []
    for k, (pole, shape) in enumerate(zip(modes.poles, modes.shapes, strict=True)):
        table = np.zeros((len(places), width), np.complex128)
        for (place, axis), value in zip(dofs, shape, strict=True):
            table[places[place], axis] = value
        parts.append(_encoded(k + 1, complex(pole), complex(a[k]), table, [nodes[place] for place in places]))
    return b"".join(parts)


def _encoded(number: int, pole: complex, modal_a: complex, table: Complex, nodes: list[int]) -> bytes:
    width = table.shape[1]
    f, damping = abs(pole) / (2 * np.pi), -pole.real / abs(pole) if pole else 0.0
    lines = [
        *("    -1", "    55", f"Mode {number}: {f:.6g} Hz, damping {100 * damping:.4g} %", "NONE", timestamp()),
        MARK + json.dumps({"re": pole.real, "im": pole.imag}),
        "NONE",
        f"{1:10d}{COMPLEX[0]:10d}{2 if width == 3 else 3:10d}{8:10d}{5:10d}{width:10d}",
        f"{2:10d}{6:10d}{0:10d}{number:10d}",
        _fields(np.array([pole, modal_a, -pole * modal_a]))[0],
    ]
    for node, row in zip(nodes, table, strict=True):
        lines += [f"{node:10d}", *_fields(row)]
    return ascii_lines([*lines, "    -1"])


def _fields(values: Complex) -> list[str]:
    """Lines of six numbers each."""
    words = [f"{_decimal(x):>{COLUMNS}}" for x in np.column_stack([values.real, values.imag]).ravel().tolist()]
    return ["".join(words[k : k + 6]) for k in range(0, len(words), 6)]


def _decimal(value: float) -> str:
    # An exponent of three digits leaves no room for a sign: such a number is nothing beside the others.
    return decimal(value) if value == 0 or abs(value) >= 1e-90 else decimal(0.0)


def _exact(line: str, pole: complex) -> complex:
    """The pole in full, where a line of ours has it and the fields do not say otherwise."""
    about = of_ours(line.strip())
    re_, im = about.get("re"), about.get("im")
    if not (isinstance(re_, float) and isinstance(im, float)):
        return pole
    own = complex(re_, im)
    return own if abs(own - pole) <= _AGREE * abs(pole) else pole


def _same(one: UffMode, other: UffMode) -> bool:
    if abs(one.pole - other.pole) > _SAME_POLE * abs(other.pole):
        return False
    common = [node for node in one.shapes if node in other.shapes]
    if not common:
        return False
    a, b = (np.nan_to_num(np.concatenate([mode.shapes[node] for node in common])) for mode in (one, other))
    return bool(abs(np.vdot(a, b)) ** 2 >= _PARALLEL * np.vdot(a, a).real * np.vdot(b, b).real)


def _shapes(source: UffSource, lines: list[tuple[int, str]], width: int, *, real: bool) -> dict[int, Complex]:
    needed = width * (1 if real else 2)
    shapes: dict[int, Complex] = {}
    k = 0
    while k < len(lines):
        at, text = lines[k]
        if not text.strip():
            k += 1
            continue
        node = _integers(source, at, text, 1)[0]
        numbers: list[float] = []
        while len(numbers) < needed and k + 1 < len(lines):
            k += 1
            numbers += _reals(source, *lines[k])
        if len(numbers) != needed:
            found = f"{len(numbers)} numbers for node {node}"
            raise DataFileError(source.place(at), found=found, expected=f"{needed}, and the next node in its own line")
        if node in shapes:
            raise DataFileError(source.place(at), found=f"node {node} again", expected="every node once")
        values = np.array(numbers) + 0j if real else np.array(numbers[::2]) + 1j * np.array(numbers[1::2])
        shapes[node] = np.concatenate([values, np.full(len(AXES) - width, np.nan)])
        k += 1
    return shapes


def _integers(source: UffSource, at: int, text: str, count: int) -> list[int]:
    fields = [text[10 * k : 10 * k + 10].strip() for k in range(count)]
    if not all(re.fullmatch(r"-?\d+", field, re.ASCII) for field in fields):
        expected = "a node" if count == 1 else f"{count} integers of ten columns each"
        raise DataFileError(source.place(at), found=shown(text.rstrip()), expected=expected)
    return [int(field) for field in fields]


def _reals(source: UffSource, at: int, text: str) -> list[float]:
    words = SIGN_IN_WORD.sub(" ", re.sub("[dD](?=[-+0-9])", "e", text)).split()
    for word in words:
        if not NUMBER.fullmatch(word) or not np.isfinite(float(word)):
            raise DataFileError(source.place(at), found=shown(word), expected="a finite number")
    return [float(word) for word in words]
