"""Damaged measurement files: each is one clear error, and no damage passes as NaN or infinity."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armonic.errors import DataFileError, FrfError
from armonic.files import read_csv, read_frf, read_uff
from frf_files import (
    BINARY,
    EVEN_HZ,
    TABLE,
    UNEVEN_HZ,
    binary_by_hand,
    binary_id,
    by_hand,
    save,
)

HEADER_6 = by_hand().splitlines()[7].decode()
HEADER_7 = by_hand().splitlines()[8].decode()
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
def test_a_bad_universal_file_is_one_error_that_names_file_fault_and_expectation(tmp_path: Path, case: str) -> None:
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
    for action in draw(st.lists(st.sampled_from(["flip", "digit", "drop", "double", "cut"]), min_size=1, max_size=4)):
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
def test_random_text_is_refused(tmp_path_factory: pytest.TempPathFactory, name: str, head: str, content: str) -> None:
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
