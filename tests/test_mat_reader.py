"""The reader of MATLAB files agrees with SciPy's on whole files, and refuses damaged ones instead of crashing."""

from __future__ import annotations

import io
import random
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from armonic.files.mat_reader import Cells, DamageError, Text, parse

RANDOM = np.random.default_rng(0)
NUMBERS: dict[str, Any] = {
    "double": RANDOM.normal(size=(4, 3)),
    "single": RANDOM.normal(size=(2, 5)).astype("f4"),
    "whole": np.arange(6, dtype="i8").reshape(2, 3),
    "bytes": np.arange(5, dtype="u1"),
    "shorts": np.array([[-300, 300]], "i2"),
    "logical": np.array([[True, False]]),
    "complex": RANDOM.normal(size=(2, 2)) + 1j,
    "cube": np.arange(24.0).reshape(2, 3, 4),
    "scalar": 3.5,
    "nothing": np.empty((0, 3)),
    "not_finite": np.array([np.nan, np.inf]),
}


def saved(content: dict[str, Any], *, compressed: bool = False) -> bytes:
    file = io.BytesIO()
    savemat(file, content, do_compression=compressed)
    return file.getvalue()


@pytest.mark.parametrize("compressed", [False, True])
def test_numbers_of_every_class_and_shape_are_read_as_scipy_reads_them(compressed: bool) -> None:
    data = saved(NUMBERS, compressed=compressed)
    expected, found = loadmat(io.BytesIO(data)), parse(data)
    assert list(found) == list(NUMBERS)
    for name, value in found.items():
        assert isinstance(value, np.ndarray)
        np.testing.assert_array_equal(value, expected[name])
        assert value.dtype == expected[name].dtype


def test_text_and_cells_are_read_and_the_rest_is_passed_over() -> None:
    cell = np.array(["m/s²", "", 2.0], dtype=object)
    found = parse(saved({"word": "Gelenk ä", "rows": np.array(["ab", "cd"]), "cell": cell, "s": {"a": 1}}))
    assert found["word"] == Text(("Gelenk ä",))
    assert found["rows"] == Text(("ab", "cd"))
    assert found["s"] is None
    assert isinstance(found["cell"], Cells)
    first, second, third = found["cell"].items
    assert first == Text(("m/s²",))
    assert second in (Text(("",)), Text(()))
    assert isinstance(third, np.ndarray)
    assert third.tolist() == [[2.0]]


def test_a_file_of_a_machine_with_the_other_byte_order_is_read() -> None:
    def words(*numbers: int) -> bytes:
        return np.array(numbers, ">u4").tobytes()

    value = np.array([[1.5, -2.5]])
    name = words(1, 1) + b"x" + bytes(7)
    body = words(6, 8, 6, 0) + words(5, 8, 1, 2) + name + words(9, 16) + value.astype(">f8").tobytes()
    found = parse(b"MATLAB 5.0".ljust(124) + b"\x01\x00MI" + words(14, len(body)) + body)
    np.testing.assert_array_equal(found["x"], value)  # type: ignore[arg-type]


@pytest.mark.parametrize("compressed", [False, True])
def test_a_file_cut_off_anywhere_is_refused(compressed: bool) -> None:
    data = saved({"t": np.arange(9.0), "y": np.arange(18.0).reshape(9, 2)}, compressed=compressed)
    whole = set()
    for length in range(len(data)):
        try:
            whole.add(tuple(parse(data[:length])))
        except DamageError:
            continue
    assert whole == {(), ("t",)}  # between two variables nothing tells that one is missing


def test_damaged_bytes_are_read_or_refused_and_never_bring_the_process_down() -> None:
    data = saved({"y": np.arange(18.0).reshape(9, 2), "w": "text", "c": np.array(["a", 2.0], dtype=object)})
    generator, refused = random.Random(0), 0
    for _ in range(3000):
        damaged = bytearray(data)
        for _ in range(generator.randint(1, 3)):
            damaged[generator.randrange(len(damaged))] = generator.randrange(256)
        try:
            parse(bytes(damaged))
        except DamageError:
            refused += 1
    assert refused > 1000


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "too few for a header"),
        (bytes(200), "no header of version 5"),
        (b"MATLAB 5.0".ljust(124) + b"\x00\x02IM", "no header of version 5"),
    ],
)
def test_what_is_no_matlab_file_says_so(data: bytes, message: str) -> None:
    with pytest.raises(DamageError, match=message):
        parse(data)
