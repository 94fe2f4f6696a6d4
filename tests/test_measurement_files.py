"""Measurement files: what others write is read right, what we write they read, and damage never passes."""

from __future__ import annotations

import os
import random
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from armonic.errors import DataFileError, FrfError
from armonic.files import read_csv, read_frf, read_uff, write_csv, write_frf, write_uff
from armonic.response import KINDS, Frf, Kind

EVEN_HZ = np.linspace(2.0, 40.0, 77)  # steps of 0.5 Hz, exact in every format
UNEVEN_HZ = np.geomspace(2.0, 40.0, 77)
TYPES = {"receptance": 8, "mobility": 11, "accelerance": 12}

# Digits that survive: %13.5e keeps 6, %20.11e (pyuff) 12, %20.12e (ours) 13, binary single 24 bits.
SINGLE_TEXT, DOUBLE_TEXT, OUR_TEXT, SINGLE_BINARY = 6e-6, 6e-12, 6e-13, 6e-8

Dof = tuple[int, int]


def oscillator(dof: Dof, freq_hz: NDArray[np.float64] = EVEN_HZ) -> NDArray[np.complex128]:
    """Accelerance of two masses between springs (a closed 2x2 inverse) by signed direction; not symmetric."""
    w = 2 * np.pi * freq_hz
    s = 1j * w
    a, b, c = 8e4 + 40 * s - 3 * w**2, -3e4 - 10 * s, 5e4 + 25 * s - 2 * w**2
    adjugate = {(1, 1): c, (1, 2): -b, (2, 1): -b, (2, 2): a}
    output, force = abs(dof[0]), abs(dof[1])
    entry = adjugate[1 + output % 2, 1 + force % 2] * (1 + 0.1 * output + 0.01 * force) / (a * c - b * b)
    return np.asarray(np.sign(dof[0]) * np.sign(dof[1]) * -(w**2) * entry)


def by_pyuff(
    path: Path,
    dofs: list[Dof],
    *,
    freq_hz: NDArray[np.float64] = EVEN_HZ,
    even: bool = True,
    binary: bool = False,
    double: bool = True,
    types: tuple[int, int] = (12, 13),
    first: tuple[dict[str, Any], ...] = (),
    **fields: Any,
) -> Path:
    """A universal file from the other library's writer; `fields` override those of every function."""
    sets = list(first)
    for dof in dofs:
        function = pyuff.prepare_58(
            binary=int(binary),
            func_type=4,
            rsp_node=7,
            rsp_dir=dof[0],
            ref_node=7,
            ref_dir=dof[1],
            data=oscillator(dof, freq_hz),
            x=freq_hz,
            id1="hammer test",
            rsp_ent_name="TCP",
            ref_ent_name="TCP",
            abscissa_spacing=int(even),
            abscissa_spec_data_type=18,
            ordinate_spec_data_type=types[0],
            orddenom_spec_data_type=types[1],
        )
        sets.append(function | {"ord_data_type": 6 if double else 5} | fields)
    return write_sets(path, sets, force_double=double)


def write_sets(path: Path, sets: list[dict[str, Any]], *, force_double: bool = True) -> Path:
    path.unlink(missing_ok=True)  # "overwrite" of pyuff loses the header of binary sets
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves binary files to the garbage collector
        pyuff.UFF(str(path)).write_sets(sets, force_double=force_double)
    return path


def units(length: float, force: float, code: int = 9) -> dict[str, Any]:
    return {
        "type": 164,
        "units_code": code,
        "length": length,
        "force": force,
        "temp": 1.0,
        "temp_offset": 0.0,
    }


def by_hand(
    dof: Dof = (1, 1),
    *,
    data: bytes | None = None,
    freq_hz: NDArray[np.float64] = EVEN_HZ,
    storage: int = 6,
    even: bool = True,
    binary: str = "",
    count: int | None = None,
    end: str = "\n",
    edit: dict[int, str] | None = None,
) -> bytes:
    """One data set 58 written out by the columns of the format; `edit` replaces header lines (1 to 11)."""
    values = oscillator(dof, freq_hz)
    count = freq_hz.size if count is None else count
    if data is None:
        data = "".join(f"{v.real:20.12E}{v.imag:20.12E}{end}" for v in values).encode()
    start, step = (freq_hz[0], freq_hz[1] - freq_hz[0]) if even else (0.0, 0.0)
    none = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {'NONE':20}"
    header = [
        *("NONE",) * 5,
        f"{4:5d}{0:10d}{0:5d}{0:10d} {'NONE':10}{7:10d}{dof[0]:4d} {'NONE':10}{7:10d}{dof[1]:4d}",
        f"{storage:10d}{count:10d}{even:10d}{start:13.5E}{step:13.5E}{0.0:13.5E}",
        *(f"{number:10d}{none[10:]}" for number in (18, 12, 13)),
        none,
    ]
    for number, text in (edit or {}).items():
        header[number - 1] = text
    head = end.join(["    -1", f"    58{binary}", *header, ""]).encode("latin-1")
    return head + data + f"    -1{end}".encode()


def binary_id(size: int, order: int = 1, floats: int = 2, lines: int = 11) -> str:
    return f"b{order:6d}{floats:6d}{lines:12d}{size:12d}{0:6d}{0:6d}{0:12d}{0:12d}"


def binary_by_hand(
    item: str, *, freq_hz: NDArray[np.float64] = EVEN_HZ, even: bool = True, x: str = ""
) -> bytes:
    values = oscillator((1, 1), freq_hz)
    layout = ([] if even else [("x", x or item)]) + [("re", item), ("im", item)]
    rows = np.zeros(freq_hz.size, dtype=layout)
    rows["re"], rows["im"] = values.real, values.imag
    if not even:
        rows["x"] = freq_hz
    data = rows.tobytes()
    order = 1 if item[0] == "<" else 2
    storage = 5 if item[1] == "4" or item[2] == "4" else 6
    return by_hand(
        data=data, freq_hz=freq_hz, storage=storage, even=even, binary=binary_id(len(data), order), dof=(1, 1)
    )


def save(path: Path, *sets: bytes) -> Path:
    path.write_bytes(b"".join(sets))
    return path


def measured(freq_hz: NDArray[np.float64] = EVEN_HZ, frame: str | None = "sensor") -> Frf:
    """Three outputs and two inputs, in an order that is not the alphabet's."""
    outputs, inputs = ("x", "y", "z"), ("x", "z")
    code = {"x": 1, "y": 2, "z": 3}
    values = np.array([[oscillator((code[o], code[i]), freq_hz) for i in inputs] for o in outputs])
    return Frf(freq_hz, np.moveaxis(values, 2, 0), "accelerance", outputs, inputs, frame)


def assert_same(a: Frf, b: Frf, tolerance: float, *, freq_tolerance: float = 1e-9) -> None:
    assert (a.kind, a.outputs, a.inputs, a.frame) == (b.kind, b.outputs, b.inputs, b.frame)
    np.testing.assert_allclose(a.freq_hz, b.freq_hz, rtol=freq_tolerance, atol=0)
    # Per part, since a small imaginary part keeps its own digits.
    np.testing.assert_allclose(a.values.real, b.values.real, rtol=tolerance, atol=0)
    np.testing.assert_allclose(a.values.imag, b.values.imag, rtol=tolerance, atol=0)


# --- universal files in ------------------------------------------------------------------------------------


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("binary", [True, False])
def test_a_matrix_written_by_pyuff_in_double_precision_is_read_entry_by_entry(
    tmp_path: Path, binary: bool, even: bool
) -> None:
    freq_hz = EVEN_HZ if even else UNEVEN_HZ
    dofs = [(o, i) for i in (1, 2) for o in (3, 1, 2)]
    frf = read_uff(
        by_pyuff(tmp_path / "a.uff", dofs, freq_hz=freq_hz, even=even, binary=binary), frame="tool"
    )
    assert (frf.kind, frf.outputs, frf.inputs, frf.frame) == (
        "accelerance",
        ("x", "y", "z"),
        ("x", "y"),
        "tool",
    )
    exact_hz = even or binary
    np.testing.assert_allclose(frf.freq_hz, freq_hz, rtol=0 if exact_hz else SINGLE_TEXT)
    for o, i in dofs:
        expected = oscillator((o, i), freq_hz)
        np.testing.assert_allclose(frf.values[:, o - 1, i - 1], expected, rtol=0 if binary else DOUBLE_TEXT)


@pytest.mark.parametrize("even", [True, False])
def test_single_precision_text_written_by_pyuff_is_read(tmp_path: Path, even: bool) -> None:
    freq_hz = EVEN_HZ if even else UNEVEN_HZ
    frf = read_uff(by_pyuff(tmp_path / "a.uff", [(1, 1)], freq_hz=freq_hz, even=even, double=False))
    np.testing.assert_allclose(frf.freq_hz, freq_hz, rtol=SINGLE_TEXT)
    np.testing.assert_allclose(frf.values[:, 0, 0], oscillator((1, 1), freq_hz), rtol=SINGLE_TEXT)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("item", ["<f4", ">f4", "<f8", ">f8"])
def test_binary_of_both_precisions_and_byte_orders_is_read(tmp_path: Path, item: str, even: bool) -> None:
    freq_hz = EVEN_HZ if even else UNEVEN_HZ
    frf = read_uff(save(tmp_path / "a.uff", binary_by_hand(item, freq_hz=freq_hz, even=even)))
    tolerance = SINGLE_BINARY if item[2] == "4" else 0
    np.testing.assert_allclose(frf.freq_hz, freq_hz, rtol=tolerance)
    np.testing.assert_allclose(frf.values[:, 0, 0], oscillator((1, 1), freq_hz), rtol=tolerance)


def test_binary_with_single_abscissas_among_double_values_is_read_as_the_format_says(tmp_path: Path) -> None:
    file = binary_by_hand("<f8", freq_hz=UNEVEN_HZ, even=False, x="<f4")
    frf = read_uff(save(tmp_path / "a.uff", file))
    np.testing.assert_allclose(frf.freq_hz, UNEVEN_HZ, rtol=SINGLE_BINARY)
    np.testing.assert_array_equal(frf.values[:, 0, 0], oscillator((1, 1), UNEVEN_HZ))


def test_binary_values_that_look_like_the_end_of_the_data_set_are_values(tmp_path: Path) -> None:
    data = b"    -1\n " * 2 * EVEN_HZ.size  # a finite double, 6e-154
    frf = read_uff(save(tmp_path / "a.uff", by_hand(data=data, binary=binary_id(len(data)))))
    assert (frf.values.real == np.frombuffer(b"    -1\n ")[0]).all()


def _fortran(file: bytes) -> bytes:
    return file.replace(b"E+", b"D+").replace(b"E-", b"D-")


def _blanks_to_column_80(file: bytes) -> bytes:
    return b"".join(line.ljust(80) + b"\n" for line in file.splitlines())


VARIANTS: dict[str, bytes] = {
    "D exponents": _fortran(by_hand()),
    "Windows line ends": by_hand(end="\r\n"),
    "lines filled to column 80": _blanks_to_column_80(by_hand()),
    "a byte order mark": b"\xef\xbb\xbf" + by_hand(),
    "blank lines around": b"\n  \n" + by_hand() + b"\n\n\x1a",
    "no line end at the end": by_hand().rstrip(b"\n"),
    "zeros that fill the last line": by_hand()[:-7] + b"  0.00000E+00  0.00000E+00\n    -1\n",
    "text in Latin-1": by_hand(edit={1: "Fräse, Ø 20"}),
    "a line end after binary values": binary_by_hand("<f8")[:-7] + b"\r\n    -1\r\n",
    "empty fields for zero": by_hand(edit={5: "", 11: ""}),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_the_dialects_of_other_programs_are_read(tmp_path: Path, name: str) -> None:
    frf = read_uff(save(tmp_path / "a.uff", VARIANTS[name]))
    np.testing.assert_allclose(frf.freq_hz, EVEN_HZ, rtol=1e-15)
    np.testing.assert_allclose(frf.values[:, 0, 0], oscillator((1, 1)), rtol=OUR_TEXT)


def test_a_negative_direction_turns_the_sign(tmp_path: Path) -> None:
    positive = read_uff(by_pyuff(tmp_path / "a.uff", [(1, 1), (1, 2), (3, 1), (3, 2)]))
    negative = read_uff(by_pyuff(tmp_path / "b.uff", [(1, -1), (1, 2), (-3, -1), (-3, 2)]))
    np.testing.assert_allclose(negative.values, positive.values, rtol=DOUBLE_TEXT)
    raw = pyuff.UFF(str(tmp_path / "b.uff")).read_sets()[0]
    np.testing.assert_allclose(raw["data"], -positive.values[:, 0, 0], rtol=DOUBLE_TEXT)  # it was negative


def test_remapped_axes_are_a_change_of_basis(tmp_path: Path) -> None:
    path = by_pyuff(tmp_path / "a.uff", [(o, i) for o in (1, 2, 3) for i in (1, 2, 3)])
    H = read_uff(path).values
    # Columns: where the x, y and z of the file point in the sensor frame.
    R = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    remapped = read_uff(path, axes={"x": "-z", "y": "y", "z": "x"})
    assert remapped.outputs == remapped.inputs == ("x", "y", "z")
    np.testing.assert_allclose(remapped.values, R @ H @ R.T, rtol=1e-15)


@pytest.mark.parametrize(
    "axes", [{"x": "z"}, {"x": "y", "y": "y"}, {"x": "w"}, {"w": "x"}, {"x": "rx", "rx": "x"}, {"x": 3}]
)
def test_axes_that_are_no_permutation_are_refused(tmp_path: Path, axes: Any) -> None:
    with pytest.raises(FrfError, match="axes"):
        read_uff(by_pyuff(tmp_path / "a.uff", [(1, 1)]), axes=axes)


@pytest.mark.parametrize(
    ("length", "force", "dof", "factor"),
    [
        (1e3, 1.0, (1, 1), 1e-3),  # 1 mm/s²/N is 0.001 m/s²/N
        (1e3, 1e3, (1, 2), 1.0),  # mm and mN
        (1 / 0.0254, 1 / 4.4482216152605, (2, 1), 0.0254 / 4.4482216152605),  # inch and pound
        (1e3, 1.0, (4, 1), 1.0),  # rad/s²/N has no length
        (1e3, 1.0, (1, 4), 1.0),  # 1 mm/s² per N mm is 1 m/s² per N m
        (1e3, 1.0, (4, 5), 1e3),  # 1 rad/s² per N mm is 1000 rad/s² per N m
    ],
)
def test_values_are_converted_to_si_by_the_units_of_the_file(
    tmp_path: Path, length: float, force: float, dof: Dof, factor: float
) -> None:
    first = (units(length, force),)
    frf = read_uff(by_pyuff(tmp_path / "a.uff", [dof], first=first, ordinate_axis_units_lab="mm/s^2"))
    np.testing.assert_allclose(frf.values[:, 0, 0], factor * oscillator(dof), rtol=DOUBLE_TEXT)


@pytest.mark.parametrize(
    ("first", "label", "denominator"),
    [
        ((), "g", "N"),
        ((units(1.0, 1.0, 1),), "g/N", "N"),
        ((), "(mm/s^2)/N", "N"),
        ((), "m/s^2", "lbf"),
        ((units(3.28083989501312334, 2.2480894309971048e-01, 1),), "m/s^2", "N"),  # "SI", but in feet
    ],
)
def test_units_that_contradict_each_other_are_an_error_until_scale_decides(
    tmp_path: Path, first: tuple[dict[str, Any], ...], label: str, denominator: str
) -> None:
    labels: dict[str, Any] = {"ordinate_axis_units_lab": label, "orddenom_axis_units_lab": denominator}
    path = by_pyuff(tmp_path / "a.uff", [(1, -1)], first=first, **labels)
    with pytest.raises(DataFileError, match=r"scale="):
        read_uff(path)
    decided = read_uff(path, scale=9.80665)
    np.testing.assert_allclose(decided.values[:, 0, 0], 9.80665 * oscillator((1, 1)), rtol=DOUBLE_TEXT)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_must_be_positive(tmp_path: Path, scale: float) -> None:
    with pytest.raises(FrfError, match="scale"):
        read_uff(by_pyuff(tmp_path / "a.uff", [(1, 1)]), scale=scale)


@pytest.mark.parametrize("kind", KINDS)
def test_the_kind_is_what_the_file_says(tmp_path: Path, kind: Kind) -> None:
    assert read_uff(by_pyuff(tmp_path / "a.uff", [(1, 1)], types=(TYPES[kind], 13))).kind == kind


@pytest.mark.parametrize("types", [(0, 13), (12, 0), (0, 0), (12, 12), (3, 13)])
def test_an_unknown_kind_is_asked_for(tmp_path: Path, types: tuple[int, int]) -> None:
    path = by_pyuff(tmp_path / "a.uff", [(1, 1)], types=types)
    with pytest.raises(DataFileError, match=r"kind="):
        read_uff(path)
    assert read_uff(path, kind="mobility").kind == "mobility"
    with pytest.raises(FrfError, match="receptance, mobility, accelerance"):
        read_uff(path, kind="compliance")  # type: ignore[arg-type]


def test_several_nodes_are_an_error_that_lists_them_and_the_keyword_picks_one(tmp_path: Path) -> None:
    a = pyuff.UFF(str(by_pyuff(tmp_path / "a.uff", [(1, 1), (2, 1)]))).read_sets()
    for node, function in zip((3, 12), a, strict=True):
        function["rsp_node"] = node
    write_sets(tmp_path / "b.uff", a)
    with pytest.raises(DataFileError, match=r"response nodes 3, 12.*response_node="):
        read_uff(tmp_path / "b.uff")
    assert read_uff(tmp_path / "b.uff", response_node=12).outputs == ("y",)
    with pytest.raises(DataFileError, match=r"response nodes 3, 12, expected node 5"):
        read_uff(tmp_path / "b.uff", response_node=5)
    with pytest.raises(DataFileError, match=r"reference nodes 7, expected node 5"):
        read_uff(tmp_path / "b.uff", response_node=12, reference_node=5)


def test_one_response_node_and_another_reference_node_are_fine(tmp_path: Path) -> None:
    assert read_uff(by_pyuff(tmp_path / "a.uff", [(1, 1)], rsp_node=2)).outputs == ("x",)


def test_other_data_sets_and_functions_are_passed_over(tmp_path: Path) -> None:
    coherence = by_hand(edit={6: by_hand().splitlines()[7].decode().replace("    4", "    6", 1)})
    nodes = b"    -1\n  2411\n         1         1         1        11\n   0.0   0.0   0.0\n    -1\n"
    wave = binary_by_hand("<f8").replace(b"\n    4 ", b"\n    1 ", 1)
    frf = read_uff(save(tmp_path / "a.uff", nodes, coherence, wave, by_hand((2, 3)), coherence))
    assert (frf.outputs, frf.inputs) == (("y",), ("z",))
    with pytest.raises(
        DataFileError, match=r"2411, 2 of 58 of function type 6 \(coherence\), .*1 \(time response\)"
    ):
        read_uff(save(tmp_path / "b.uff", nodes, coherence, wave, coherence))


def test_holes_in_the_matrix_are_named_and_a_whole_part_can_be_read(tmp_path: Path) -> None:
    path = by_pyuff(tmp_path / "a.uff", [(1, 1), (2, 1), (3, 1), (2, 2), (3, 3)])
    with pytest.raises(DataFileError, match=r"no response x/y, x/z, y/z, z/y, .*outputs= and inputs="):
        read_uff(path)
    column = read_uff(path, inputs="x")
    assert (column.outputs, column.inputs) == (("x", "y", "z"), ("x",))
    block = read_uff(path, outputs=("y",), inputs=("y", "x"))
    np.testing.assert_allclose(block.values[:, 0, 0], oscillator((2, 2)), rtol=DOUBLE_TEXT)
    np.testing.assert_allclose(block.values[:, 0, 1], oscillator((2, 1)), rtol=DOUBLE_TEXT)
    with pytest.raises(DataFileError, match="no response rx/x"):
        read_uff(path, outputs="rx", inputs="x")
    for nothing in ((), ("x", "x")):
        with pytest.raises(FrfError, match="outputs"):
            read_uff(path, outputs=nothing)


HEADER_6 = by_hand().splitlines()[7].decode()
HEADER_7 = by_hand().splitlines()[8].decode()
BINARY = binary_by_hand("<f8")
BAD_UFF: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "empty file"),
    "only blanks": (b" \n\n  \n", "empty file"),
    "prose": (b"Dear colleague,\nhere are the data.\n", r"line 1: found 'Dear colleague,'.*'    -1'"),
    "bytes": (bytes(range(256)), "not a universal file"),
    "a zip file": (b"PK\x03\x04" + bytes(100), "not a universal file"),
    "no function": (b"    -1\n   151\nNONE\n    -1\n", "only data sets 151"),
    "no number of the data set": (b"    -1\n    xx\n    -1\n", "number of a data set"),
    "a data set that never ends": (by_hand()[:-7], "truncated"),
    "a header that ends early": (b"    -1\n    58\nNONE\nNONE\n    -1\n", "found 2 header lines"),
    "values that end early": (
        b"\n".join(by_hand().split(b"\n")[:40]) + b"\n    -1\n",
        "found 54 numbers, expected 154",
    ),
    "too many values": (by_hand()[:-7] + b" 1.0 2.0\n    -1\n", "found 156 numbers, expected 154"),
    "a lost end between two functions": (by_hand()[:-7] + by_hand((2, 1)), r"found '    58'"),
    "the same entry twice": (by_hand() + by_hand((-1, -1)), r"line 93: found x/x again.*line 2"),
    "functions of different length": (
        by_hand() + by_hand((2, 1), freq_hz=EVEN_HZ[:-1]),
        r"76 lines from 2 to 39.5 Hz.*77 lines from 2 to 40 Hz.*as x/x",
    ),
    "functions with different start": (
        by_hand() + by_hand((2, 1), freq_hz=EVEN_HZ + 0.5),
        "77 lines from 2.5",
    ),
    "functions with different step": (
        by_hand() + by_hand((2, 1), freq_hz=2 * EVEN_HZ - 2),
        "first step 1 Hz",
    ),
    "functions of different kind": (
        by_hand() + by_hand((2, 1), edit={9: f"{11:10d}"}),
        r"accelerance \(line 2\), mobility \(line 93\)",
    ),
    "not a number": (by_hand().replace(b" -", b"NaN", 20).replace(b"   NaN1", b"    -1"), "finite|number"),
    "an overflowed field": (by_hand()[:200] + by_hand()[200:].replace(b"E+00", b"****", 1), r"\*\*"),
    "an infinite value": (by_hand().replace(b"E-05", b"E+999", 3).replace(b"E-04", b"E+999", 3), "infinity"),
    "binary NaN": (BINARY[:-15] + b"\xff" * 8 + BINARY[-7:], "NaN"),
    "binary values cut off": (BINARY[:-100], "truncated"),
    "binary values too few": (BINARY[:-15] + BINARY[-7:], "found 1224 bytes of values, expected 1232"),
    "binary values too many": (BINARY[:-7] + bytes(16) + BINARY[-7:], "found 1248 bytes"),
    "VAX floats": (BINARY.replace(b"b     1     2", b"b     1     1"), "float format 1"),
    "unknown byte order": (BINARY.replace(b"b     1     2", b"b     3     2"), "byte order 3"),
    "another header length": (BINARY.replace(b"          11", b"          12", 1), "12 header lines"),
    "a declared length of 1e10 in text": (by_hand(count=9999999999), "expected 19999999998"),
    "a declared length of 1e10 in binary": (
        BINARY.replace(f"{77:10d}".encode(), b"9999999999", 1),
        "expected 159999999984",
    ),
    "a declared length of zero": (by_hand(count=0), "found 0 values"),
    "a negative declared length": (by_hand(count=-5), "found -5 values"),
    "a length that is no number": (
        by_hand(edit={7: HEADER_7.replace("77", "7x")}),
        "integer: number of values",
    ),
    "real values": (by_hand(storage=4), r"ordinate data type 4 \(real\).*complex"),
    "an unknown storage": (by_hand(storage=3), "ordinate data type 3"),
    "an unknown spacing": (by_hand(edit={7: HEADER_7[:29] + "2" + HEADER_7[30:]}), "spacing 2"),
    "a step of zero": (by_hand(edit={7: HEADER_7[:43] + f"{0:13d}" + HEADER_7[56:]}), "strictly increasing"),
    "falling frequencies": (by_hand(freq_hz=EVEN_HZ[::-1]), "strictly increasing"),
    "negative frequencies": (by_hand(freq_hz=EVEN_HZ - 3), "-1 Hz"),
    "a step that is infinite": (
        by_hand(edit={7: HEADER_7[:43] + "    1.0E+9999"}),
        "finite number: abscissa",
    ),
    "frequencies that overflow": (by_hand(edit={7: HEADER_7[:43] + "     1.0E+308"}), "infinity"),
    "time for frequency": (by_hand(edit={8: f"{17:10d}"}), "data type 17.*frequency"),
    "rad/s for Hz": (by_hand(edit={8: f"{18:10d}{'':36}rad/s"}), "rad/s"),
    "a scalar direction": (by_hand((0, 1)), r"direction 0 \(scalar\)"),
    "an unknown direction": (by_hand(edit={6: HEADER_6[:51] + "   7" + HEADER_6[55:]}), "direction 7"),
    "a direction that is no number": (
        by_hand(edit={6: HEADER_6[:51] + "  +X" + HEADER_6[55:]}),
        "integer: dir",
    ),
    "unit factors of zero": (
        b"    -1\n   164\n         1\n 0.0 1.0 1.0\n 0.0\n    -1\n" + by_hand(),
        "positive",
    ),
    "unit factors missing": (b"    -1\n   164\n         1\n 1.0\n    -1\n" + by_hand(), "1 unit factors"),
    "unit factors that are no numbers": (b"    -1\n   164\n         1\n mm N\n    -1\n" + by_hand(), "'mm'"),
}


@pytest.mark.parametrize("case", BAD_UFF)
def test_a_bad_universal_file_is_one_error_that_names_file_fault_and_expectation(
    tmp_path: Path, case: str
) -> None:
    content, message = BAD_UFF[case]
    with pytest.raises(DataFileError, match=message) as caught:
        read_uff(save(tmp_path / "bad.uff", content))
    assert str(caught.value).startswith(str(tmp_path / "bad.uff"))
    assert caught.value.found
    assert caught.value.expected
    assert "\n" not in str(caught.value)


def test_values_that_overflow_in_si_are_an_error(tmp_path: Path) -> None:
    data = b"  1.0E+308" * 2 * EVEN_HZ.size + b"\n"
    path = save(tmp_path / "a.uff", by_hand(data=data))
    with pytest.raises(DataFileError, match="finite"):
        read_uff(path, scale=1e10)


def test_a_file_that_is_not_there_or_a_folder_is_an_error(tmp_path: Path) -> None:
    for path in (tmp_path / "none.uff", tmp_path, tmp_path / "bad\0name.uff"):
        with pytest.raises(DataFileError, match="readable file"):
            read_uff(path)


def test_a_file_cut_anywhere_is_an_error(tmp_path: Path) -> None:
    for whole in (
        by_hand(freq_hz=EVEN_HZ[:3]),
        by_hand(freq_hz=EVEN_HZ[:3], data=bytes(48), binary=binary_id(48)),
    ):
        for length in range(len(whole) - 1):  # the last byte is the line end, which is not needed
            with pytest.raises(DataFileError):
                read_uff(save(tmp_path / "cut.uff", whole[:length]))


# --- universal files out -----------------------------------------------------------------------------------


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(
    "freq_hz", [EVEN_HZ, UNEVEN_HZ, np.linspace(10, 200, 152)], ids=["even", "uneven", "thirds"]
)
def test_what_we_write_pyuff_reads(tmp_path: Path, binary: bool, freq_hz: NDArray[np.float64]) -> None:
    frf = measured(freq_hz)
    write_uff(tmp_path / "a.uff", frf, node=42, binary=binary, name="KR90")
    header, stated, *functions = pyuff.UFF(str(tmp_path / "a.uff")).read_sets()
    assert (header["type"], header["model_name"]) == (151, "KR90")
    assert (stated["type"], stated["units_code"], stated["length"], stated["force"]) == (164, 1, 1.0, 1.0)
    assert len(functions) == 6
    for function in functions:
        assert (function["type"], function["func_type"], function["ord_data_type"]) == (58, 4, 6)
        assert (function["rsp_node"], function["ref_node"], function["binary"]) == (42, 42, int(binary))
        types = ("abscissa_spec_data_type", "ordinate_spec_data_type", "orddenom_spec_data_type")
        assert [function[key] for key in types] == [18, 12, 13]
        labels = ("abscissa_axis_units_lab", "ordinate_axis_units_lab", "orddenom_axis_units_lab")
        assert [function[key] for key in labels] == ["Hz", "m/s^2", "N"]
        assert function["num_pts"] == freq_hz.size
        if binary:
            assert function["n_bytes"] == freq_hz.size * 8 * (2 if function["abscissa_spacing"] else 3)
        np.testing.assert_allclose(function["x"], freq_hz, rtol=1e-9)
        expected = frf.values[:, function["rsp_dir"] - 1, (function["ref_dir"] - 1) // 2]
        np.testing.assert_allclose(function["data"], expected, rtol=0 if binary else OUR_TEXT)
    assert functions[0]["abscissa_spacing"] == (0 if freq_hz is UNEVEN_HZ else 1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("freq_hz", [EVEN_HZ, UNEVEN_HZ, np.array([3.0]), np.array([0.0, 1e-3, 5e4])])
def test_a_universal_file_comes_back_as_it_was(
    tmp_path: Path, kind: Kind, binary: bool, freq_hz: NDArray[np.float64]
) -> None:
    values = measured(freq_hz).values + 1e-3  # nowhere zero
    frf = Frf(freq_hz, values, kind, ("x", "y", "rz"), ("z", "ry"), "milling spindle")
    write_uff(tmp_path / "a.uff", frf, binary=binary)
    assert_same(read_uff(tmp_path / "a.uff"), frf, 0 if binary else OUR_TEXT)
    assert read_uff(tmp_path / "a.uff", frame="other").frame == "other"


def test_text_of_a_universal_file_stays_within_its_columns(tmp_path: Path) -> None:
    values = np.array([1.0, -1e-300j, -1e300 - 1e-99j])[:, None, None]
    frf = Frf(np.array([0.0, 1e-7, 123456.789012]), values, "mobility", ("x",), ("x",))
    write_uff(tmp_path / "a.uff", frf, name="long " * 50 + "\n    -1\n")
    assert max(map(len, (tmp_path / "a.uff").read_text("ascii").splitlines())) <= 80
    np.testing.assert_allclose(read_uff(tmp_path / "a.uff").values, values, rtol=OUR_TEXT)
    np.testing.assert_allclose(
        pyuff.UFF(str(tmp_path / "a.uff")).read_sets(2)["data"], values[:, 0, 0], rtol=OUR_TEXT
    )


@pytest.mark.parametrize(("frame", "noted"), [("tool tip", "tool tip"), ("Fräser", None), ("t" * 90, None)])
def test_the_frame_is_noted_in_a_universal_file_whole_or_not_at_all(
    tmp_path: Path, frame: str, noted: str | None
) -> None:
    write_uff(tmp_path / "a.uff", measured(frame=frame))
    assert read_uff(tmp_path / "a.uff").frame == noted


def test_frequencies_too_close_for_text_are_refused_and_kept_in_binary(tmp_path: Path) -> None:
    frf = measured(np.array([100.0, 100.00000000001, 100.5]))
    with pytest.raises(DataFileError, match="binary=True"):
        write_uff(tmp_path / "a.uff", frf)
    assert list(tmp_path.iterdir()) == []
    write_uff(tmp_path / "a.uff", frf, binary=True)
    np.testing.assert_array_equal(read_uff(tmp_path / "a.uff").freq_hz, frf.freq_hz)


def test_axes_and_nodes_without_a_place_in_the_format_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FrfError, match="found tip"):
        write_uff(
            tmp_path / "a.uff", Frf(EVEN_HZ, measured().values, "mobility", ("x", "y", "tip"), ("x", "z"))
        )
    for node in (0, -1, 10**10):
        with pytest.raises(FrfError, match="node"):
            write_uff(tmp_path / "a.uff", measured(), node=node)
    assert list(tmp_path.iterdir()) == []


# --- CSV ---------------------------------------------------------------------------------------------------

TABLE = """\
# armonic frf kind=receptance frame=tool tip
# measured on a Monday
freq_hz,x/y re,x/y im,z/y re,z/y im
1.5,1,-2e-3,.5,+4
2,0.25,0,-1.,1E2
"""


def test_a_table_written_by_hand_is_read(tmp_path: Path) -> None:
    frf = read_csv(save(tmp_path / "a.csv", TABLE.encode()))
    assert (frf.kind, frf.outputs, frf.inputs, frf.frame) == ("receptance", ("x", "z"), ("y",), "tool tip")
    assert frf.freq_hz.tolist() == [1.5, 2.0]
    assert frf.values[:, :, 0].tolist() == [[1 - 0.002j, 0.5 + 4j], [0.25, -1 + 100j]]


def test_a_table_from_a_spreadsheet_is_read(tmp_path: Path) -> None:
    text = "\ufeff" + TABLE.replace("\n", "\r\n").replace(",", ", ") + "\r\n"
    assert read_csv(save(tmp_path / "a.csv", text.encode())).values[1, 1, 0] == -1 + 100j


def test_what_was_measured_may_be_said_by_keyword_and_must_be_said(tmp_path: Path) -> None:
    path = save(tmp_path / "a.csv", TABLE[TABLE.index("freq") :].encode())
    with pytest.raises(DataFileError, match=r"kind= as one of receptance, mobility, accelerance"):
        read_csv(path)
    frf = read_csv(path, kind="mobility", frame="flange")
    assert (frf.kind, frf.frame) == ("mobility", "flange")


def test_axes_of_a_table_can_be_remapped_and_picked(tmp_path: Path) -> None:
    path = save(tmp_path / "a.csv", TABLE.encode())
    frf = read_csv(path, axes={"x": "-z", "z": "x"}, outputs="x")
    assert (frf.outputs, frf.inputs) == (("x",), ("y",))
    assert frf.values[:, 0, 0].tolist() == [0.5 + 4j, -1 + 100j]  # the z of the file
    assert read_csv(path, axes={"x": "-z", "z": "x"}, outputs="z").values[0, 0, 0] == -1 + 0.002j


def test_the_written_table_is_plain(tmp_path: Path) -> None:
    values = np.array([[[1 + 2j, 0.1]], [[-1e-9j, 3e20]]])
    write_csv(
        tmp_path / "a.csv", Frf(np.array([0.5, 10.0]), values, "accelerance", ("y",), ("x", "y"), "sensor")
    )
    assert (tmp_path / "a.csv").read_bytes().decode() == (
        "# armonic frf kind=accelerance frame=sensor\n"
        "freq_hz,y/x re,y/x im,y/y re,y/y im\n"
        "0.5,1.0,2.0,0.1,0.0\n"
        "10.0,-0.0,-1e-09,3e+20,0.0\n"
    )


finite = st.floats(allow_nan=False, allow_infinity=False)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(
    freq_hz=st.lists(st.floats(0, 1e300), min_size=1, max_size=4, unique=True).map(sorted),
    numbers=st.lists(finite, min_size=16, max_size=16),
    kind=st.sampled_from(KINDS),
    frame=st.none() | st.just("tool tip"),
)
def test_a_table_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    freq_hz: list[float],
    numbers: list[float],
    kind: Kind,
    frame: str | None,
) -> None:
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    values = np.array(numbers).view(np.complex128).reshape(-1, 2, 1)[: len(freq_hz)]
    values = np.concatenate([values] * 2)[: len(freq_hz)]
    frf = Frf(np.array(freq_hz), values, kind, ("z", "tip"), ("x",), frame)
    write_csv(path, frf)
    assert_same(read_csv(path), frf, 0, freq_tolerance=0)


def test_labels_that_would_break_the_table_are_refused(tmp_path: Path) -> None:
    for label in ("a b", "a,b", "a/b", 'a"b', "a\n"):
        with pytest.raises(FrfError, match="without blanks"):
            write_csv(tmp_path / "a.csv", Frf([1.0], np.ones((1, 1, 1)), "mobility", (label,), ("x",)))  # type: ignore[arg-type]
    with pytest.raises(FrfError, match="one line"):
        write_csv(tmp_path / "a.csv", measured(frame="a\nb"))
    assert list(tmp_path.iterdir()) == []


BAD_CSV: dict[str, tuple[str | bytes, str]] = {
    "nothing": ("", "empty file"),
    "only comments": ("# armonic frf kind=mobility\n", "no table"),
    "prose": ("# armonic frf kind=mobility\nDear colleague,\n", "line 2.*'Dear colleague,'"),
    "bytes": (b"\xff\xfe\x00", "not text"),
    "an unknown kind": (TABLE.replace("receptance", "compliance"), "'compliance'"),
    "a header alone": (TABLE[: TABLE.index("1.5")], "no frequency line"),
    "another first column": (TABLE.replace("freq_hz", "omega"), "'omega"),
    "semicolons": (TABLE.replace(",", ";"), "freq_hz,"),
    "a column that is no pair": (TABLE.replace("x/y re", "x re"), "column 'x re'"),
    "a part that is neither": (TABLE.replace("x/y im", "x/y deg"), "column 'x/y deg'"),
    "a column twice": (TABLE.replace("x/y im", "x/y re"), "twice"),
    "a real part alone": (TABLE.replace("z/y im", "w/y im"), "z/y re alone"),
    "a hole in the matrix": (TABLE.replace("z/y", "z/x"), "no response x/x, z/y"),
    "a value missing": (TABLE.replace(",.5", ""), r"line 4: found 4 values, expected 5"),
    "a value too many": (TABLE.replace(",.5", ",.5,7"), "found 6 values"),
    "an empty value": (TABLE.replace(".5,+4", ",+4"), "'' for z/y re"),
    "text for a number": (TABLE.replace("+4", "four"), "'four' for z/y im"),
    "a number only Python knows": (TABLE.replace("+4", "1_0"), "'1_0'"),
    "not a number": (TABLE.replace("+4", "nan"), "'nan'"),
    "an infinite value": (TABLE.replace("+4", "1e999"), "'1e999'"),
    "falling frequencies": (TABLE.replace("\n2,", "\n1,"), "1 Hz at index 1 after 1.5 Hz"),
    "a negative frequency": (TABLE.replace("\n1.5,", "\n-1.5,"), "-1.5 Hz"),
    "an end within the last line": (TABLE[:-1], "line 5: found the end of the file"),
}


@pytest.mark.parametrize("case", BAD_CSV)
def test_a_bad_table_is_one_error_that_names_file_fault_and_expectation(tmp_path: Path, case: str) -> None:
    content, message = BAD_CSV[case]
    data = content.encode() if isinstance(content, str) else content
    with pytest.raises(DataFileError, match=message) as caught:
        read_csv(save(tmp_path / "bad.csv", data))
    assert str(caught.value).startswith(str(tmp_path / "bad.csv"))
    assert "\n" not in str(caught.value)


# --- both --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.uff", "a.unv", "a.uf58", "a.csv", "A.UFF"])
def test_the_ending_picks_the_format(tmp_path: Path, name: str) -> None:
    write_frf(tmp_path / name, measured())
    first = (tmp_path / name).read_bytes()[:6]
    assert first == (b"# armo" if name.endswith("csv") else b"    -1")
    assert_same(read_frf(str(tmp_path / name)), measured(), OUR_TEXT)
    assert read_frf(tmp_path / name, frame="flange").frame == "flange"


@pytest.mark.parametrize("name", ["a.xlsx", "a"])
def test_an_unknown_ending_is_an_error_that_lists_the_known_ones(tmp_path: Path, name: str) -> None:
    for use in (lambda: read_frf(tmp_path / name), lambda: write_frf(tmp_path / name, measured())):
        with pytest.raises(DataFileError, match=r"\.uff, \.unv, \.uf58, \.csv"):
            use()


@pytest.mark.parametrize("write", [write_uff, write_csv])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path, Frf], None]
) -> None:
    path = save(tmp_path / "a.uff", b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DataFileError, match=r"a\.uff: found No space left on device"):
        write(path, measured())
    assert [file.name for file in tmp_path.iterdir()] == ["a.uff"]
    assert path.read_bytes() == b"old"
    monkeypatch.undo()
    write(path, measured())
    assert [file.name for file in tmp_path.iterdir()] == ["a.uff"]
    assert path.stat().st_size > 1000


def test_a_place_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.uff").mkdir()
    for name in ("none/a.uff", "file/a.uff", "folder.uff", "bad\0name.uff"):
        with pytest.raises(DataFileError, match="a place where a file can be written"):
            write_uff(tmp_path / name, measured())
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder.uff"]


def test_nothing_is_printed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_frf(tmp_path / "a.uff", measured(), binary=True)
    read_frf(tmp_path / "a.uff")
    assert capfd.readouterr() == ("", "")


# --- damage at random --------------------------------------------------------------------------------------

SEEDS: dict[str, tuple[str, bytes]] = {
    "text": ("a.uff", by_hand(freq_hz=EVEN_HZ[:5]) + by_hand((2, 1), freq_hz=EVEN_HZ[:5])),
    "binary": ("a.uff", binary_by_hand("<f8", freq_hz=EVEN_HZ[:9]) + by_hand((2, 1), freq_hz=EVEN_HZ[:9])),
    "binary, single and uneven": ("a.uff", binary_by_hand(">f4", freq_hz=UNEVEN_HZ[:9], even=False)),
    "table": ("a.csv", TABLE.encode()),
}


def read_or_refuse(folder: Path, name: str, content: bytes) -> None:
    try:
        frf = read_frf(save(folder / name, content))
    except (DataFileError, FrfError):
        return
    assert np.isfinite(frf.values).all()
    assert np.isfinite(frf.freq_hz).all()


@st.composite
def damage(draw: st.DrawFn) -> tuple[str, bytes]:
    """A valid file with bytes flipped, lines taken out or doubled, and its end cut off."""
    name, content = SEEDS[draw(st.sampled_from(sorted(SEEDS)))]
    dice = random.Random(draw(st.integers(0, 2**32)))
    for action in draw(
        st.lists(st.sampled_from(["flip", "digit", "drop", "double", "cut"]), min_size=1, max_size=4)
    ):
        spot = dice.randrange(max(len(content), 1))
        if action == "flip":
            content = content[:spot] + bytes([dice.randrange(256)]) + content[spot + 1 :]
        elif action == "digit":
            content = content[:spot] + dice.choice([b"0", b"9", b"-", b" ", b"E", b"."]) + content[spot + 1 :]
        elif action == "cut":
            content = content[:spot]
        else:
            lines = content.splitlines(keepends=True) or [b""]
            line = dice.randrange(len(lines))
            lines[line : line + 1] = [] if action == "drop" else 2 * [lines[line]]
            content = b"".join(lines)
    return name, content


@settings(deadline=None, derandomize=True, max_examples=1500)
@given(damaged=damage())
def test_a_damaged_file_is_refused_or_read_as_finite_numbers(
    tmp_path_factory: pytest.TempPathFactory, damaged: tuple[str, bytes]
) -> None:
    read_or_refuse(tmp_path_factory.getbasetemp(), *damaged)


@settings(deadline=None, derandomize=True, max_examples=300)
@given(
    name=st.sampled_from(["a.uff", "a.csv"]),
    head=st.sampled_from(
        ["", "    -1\n", "    -1\n    58\n", "    -1\n   164\n", "# armonic frf kind=mobility\nfreq_hz,"]
    ),
    content=st.text(max_size=200) | st.text("\n 0123456789+-.,eEx/", max_size=400),
)
def test_random_text_is_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, head: str, content: str
) -> None:
    read_or_refuse(tmp_path_factory.getbasetemp(), name, (head + content).encode("utf-8", "surrogatepass"))


@settings(deadline=None, derandomize=True, max_examples=300)
@given(
    name=st.sampled_from(["a.uff", "a.csv"]),
    head=st.sampled_from([b"", b"    -1\n", by_hand()[:950], BINARY[:940]]),
    content=st.binary(max_size=300),
)
def test_random_bytes_are_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, head: bytes, content: bytes
) -> None:
    read_or_refuse(tmp_path_factory.getbasetemp(), name, head + content)
