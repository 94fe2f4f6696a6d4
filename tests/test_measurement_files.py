"""Measurement files: what other programs and people write is read right, in SI, along the right axes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff

from armonic.errors import DataFileError, FrfError
from armonic.files import read_csv, read_uff
from armonic.response import KINDS, Kind
from frf_files import (
    DOUBLE_TEXT,
    EVEN_HZ,
    OUR_TEXT,
    SINGLE_BINARY,
    SINGLE_TEXT,
    TABLE,
    TYPES,
    UNEVEN_HZ,
    Dof,
    binary_by_hand,
    binary_id,
    by_hand,
    by_pyuff,
    oscillator,
    save,
    units,
    write_sets,
)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("binary", [True, False])
def test_a_matrix_written_by_pyuff_in_double_precision_is_read_entry_by_entry(
    tmp_path: Path, binary: bool, even: bool
) -> None:
    freq_hz = EVEN_HZ if even else UNEVEN_HZ
    dofs = [(o, i) for i in (1, 2) for o in (3, 1, 2)]
    frf = read_uff(by_pyuff(tmp_path / "a.uff", dofs, freq_hz=freq_hz, even=even, binary=binary), frame="tool")
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
    with pytest.raises(DataFileError, match=r"2411, 2 of 58 of function type 6 \(coherence\), .*1 \(time response\)"):
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
