"""Coherence and tables of modes come in from files as they are, and what does not fit is refused with its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.files.coherence import read_coherence
from armonic.files.modal_table import read_modal_table
from frf_files import DOUBLE_TEXT, EVEN_HZ, SINGLE_BINARY, SINGLE_TEXT, UNEVEN_HZ, by_pyuff, oscillator

LAYOUTS: list[dict[str, Any]] = [
    {"even": even, "binary": binary, "double": double}
    for even in (True, False)
    for binary in (False, True)
    for double in (True, False)
]


def coherence_of(freq_hz: np.ndarray) -> np.ndarray:
    return np.asarray(1 - 0.5 * np.exp(-freq_hz / 10))


def responses(*axes: str, freq_hz: np.ndarray = EVEN_HZ) -> am.Frf:
    values = np.ones((len(freq_hz), len(axes), len(axes)), complex)
    return am.Frf(freq_hz, values, "accelerance", axes, axes)


def coherent(path: Path, dofs: list[tuple[int, int]], freq_hz: np.ndarray, **fields: Any) -> Path:
    """A universal file with coherence, real values as other programs write them.

    Binary ones that are said to be single are made so here: the other library writes doubles all the same.
    """
    double, binary = fields.get("double", True), fields.get("binary", False)
    fields |= {"func_type": 6, "data": coherence_of(freq_hz), "ord_data_type": 4 if double else 2}
    file = by_pyuff(path, dofs, freq_hz=freq_hz, **fields)
    if binary and not double:
        columns = [coherence_of(freq_hz)] if fields["even"] else [freq_hz, coherence_of(freq_hz)]
        table = np.column_stack(columns)
        content = file.read_bytes()
        assert content.count(table.astype("<f8").tobytes()) == len(dofs)
        file.write_bytes(content.replace(table.astype("<f8").tobytes(), table.astype("<f4").tobytes()))
    return file


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_real_coherence_of_a_universal_file_is_read(tmp_path: Path, layout: dict[str, Any]) -> None:
    freq_hz = EVEN_HZ if layout["even"] else UNEVEN_HZ
    path = coherent(tmp_path / "c.uff", [(1, 1), (-2, 1)], freq_hz, **layout)
    values = read_coherence(path).on(responses("x", freq_hz=freq_hz))
    digits = DOUBLE_TEXT if layout["double"] else SINGLE_BINARY if layout["binary"] else SINGLE_TEXT
    np.testing.assert_allclose(values[:, 0, 0], coherence_of(freq_hz), rtol=digits)
    assert set(read_coherence(path).functions) == {("x", "x"), ("y", "x")}  # a turned sensor has the same coherence


def test_a_file_may_hold_responses_and_their_coherence(tmp_path: Path) -> None:
    both = (
        by_pyuff(tmp_path / "f.uff", [(1, 1)]).read_bytes()
        + coherent(tmp_path / "c.uff", [(1, 1)], EVEN_HZ).read_bytes()
    )
    path = tmp_path / "both.uff"
    path.write_bytes(both)
    frf = am.read_frf(path)
    np.testing.assert_allclose(frf.values[:, 0, 0], oscillator((1, 1)), rtol=1e-11)
    np.testing.assert_allclose(read_coherence(path).on(frf)[:, 0, 0], coherence_of(EVEN_HZ), rtol=SINGLE_TEXT)


def test_coherence_lies_on_the_lines_and_axes_of_the_responses(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    path.write_text("freq_hz,x/x,y/x,x/y,y/y\n3,0.3,1,0.33,1\n1,0.1,1,0.11,1\n2,0.2,1,0.22,1\n", "utf-8")
    coherence = read_coherence(path)
    part = responses("x", "y", freq_hz=np.array([1.0, 3.0]))
    np.testing.assert_array_equal(coherence.on(part)[:, 0], [[0.1, 0.11], [0.3, 0.33]])
    turned = read_coherence(path, axes={"x": "-z", "z": "x"})
    np.testing.assert_array_equal(turned.on(responses("z", freq_hz=np.array([2.0])))[:, 0, 0], [0.2])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("freq_hz\n1\n", "a header such as freq_hz,x/x"),
        ("f,x/x\n1,1\n", "a header such as freq_hz,x/x"),
        ("freq_hz,x/x re,x/x im\n1,1,0\n", "found column 'x/x re'"),
        ("freq_hz,x\n1,1\n", "found column 'x'"),
        ("freq_hz,x/x,x/x\n1,1,1\n", "found x/x again"),
        ("freq_hz,x/x\n", "no frequency line"),
        ("freq_hz,x/x\n1,nan\n", "line 2: found 'nan'"),
        ("freq_hz,x/x\n1,1.1\n", "column x/x: found 1.1 at 1 Hz, expected a coherence from 0 to 1"),
        ("freq_hz,x/x\n1,0.5\n2,-0.1\n", "found -0.1 at 2 Hz"),
        ("freq_hz,x/x\n1,1", "truncated"),
        ("", "an empty file"),
    ],
)
def test_what_is_no_coherence_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(am.DataFileError, match=r".") as caught:
        read_coherence(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)


def test_rounding_above_one_is_one(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    path.write_text("freq_hz,x/x\n1,1.000001\n", "utf-8")
    assert read_coherence(path).on(responses("x", freq_hz=np.array([1.0])))[0, 0, 0] == 1


def test_coherence_without_a_direction_belongs_to_no_response(tmp_path: Path) -> None:
    path = coherent(tmp_path / "c.uff", [(1, 0)], EVEN_HZ)
    with pytest.raises(am.DataFileError, match=r"reference direction 0 \(scalar\)"):
        read_coherence(path)


def test_complex_responses_are_no_coherence_nor_real_ones_responses(tmp_path: Path) -> None:
    with pytest.raises(am.DataFileError, match=r"expected coherence: data sets 58 of function type 6"):
        read_coherence(by_pyuff(tmp_path / "f.uff", [(1, 1)]))
    with pytest.raises(am.DataFileError, match=r"58 of function type 6 \(coherence\)"):
        am.read_frf(coherent(tmp_path / "c.uff", [(1, 1)], EVEN_HZ))


@pytest.mark.parametrize(
    ("header", "row", "damped", "damping", "deviations"),
    [
        ("natural_freq_hz", "10", False, None, (None, None)),
        ("damped_freq_hz,damping_ratio", "10,0.02", True, 0.02, (None, None)),
        ("damping_percent,natural_freq_hz", "2,10", False, 0.02, (None, None)),
        (
            "natural_freq_hz,damping_ratio,freq_deviation,damping_deviation",
            "10,0.02,0.001,0.2",
            False,
            0.02,
            (0.001, 0.2),
        ),
        ("natural_freq_hz,freq_deviation_percent", "10,0.1", False, None, (0.001, None)),
    ],
)
def test_the_header_of_a_table_of_modes_says_what_the_numbers_are(
    tmp_path: Path, header: str, row: str, damped: bool, damping: float | None, deviations: tuple[float | None, ...]
) -> None:
    path = tmp_path / "m.csv"
    path.write_text(f"# hammer test\n{header}\n{row}\n\n{row}\n", "utf-8")
    table = read_modal_table(path)
    assert table.damped is damped
    np.testing.assert_array_equal(table.freq_hz, [10, 10])
    for found, expected in zip(table[2:], (damping, *deviations), strict=True):
        assert (found is None) is (expected is None)
        if expected is not None:
            np.testing.assert_allclose(found, [expected] * 2, rtol=1e-15)
