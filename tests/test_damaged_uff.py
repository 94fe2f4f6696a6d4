"""Damaged universal files: what is whole is read, what is not is named with data set and line, and nothing passes."""

from __future__ import annotations

import random
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armonic.errors import DataFileError
from armonic.files.measured_file import MeasuredFile
from armonic.files.measured_uff import read_measured_uff
from armonic.files.measured_uff_writer import write_measured_uff
from armonic.series import Channel, TimeSeries
from frf_files import DOUBLE_TEXT, SINGLE_BINARY, binary_by_hand, by_hand
from measured_systems import KUKA
from uff_files import FORCE, NAN, record, save, tap, wave


def sets_of(path: Path) -> list[bytes]:
    """The data sets of a file in text, with their delimiters."""
    return re.findall(rb"    -1\n.*?\n    -1\n", path.read_bytes(), re.DOTALL)


def three(tmp_path: Path, **fields: Any) -> list[bytes]:
    return sets_of(save(tmp_path / "whole.uff", *tap(**fields)))


def read(tmp_path: Path, *parts: bytes) -> MeasuredFile:
    (tmp_path / "damaged.uff").write_bytes(b"".join(parts))
    return read_measured_uff(tmp_path / "damaged.uff")


def remaining(found: MeasuredFile, reason: str, ordinal: int = 2) -> None:
    """The first and third of three channels are read, and the second is named with its data set and line."""
    (one,) = found.records
    assert one.labels == ("force:1.x", "acceleration:2.z")
    np.testing.assert_allclose(one.values, np.column_stack([wave(1, 1, 13), -wave(2, -3, 12)]), atol=DOUBLE_TEXT)
    named = [left for left in found.skipped if left.dataset == ordinal]
    assert any(re.search(reason, left.reason) for left in named), found.skipped


DAMAGES: dict[str, tuple[Any, str]] = {
    "garbage among the numbers": (lambda s: s[:1200] + b"#" + s[1201:], r"found '.*#.*', expected a number"),
    "an overflowed field": (lambda s: s[:1200] + b"*" * 20 + s[1220:], r"\*\*, expected a number|'\*"),
    "a number less": (lambda s: s[:-28] + s[-8:], "found 127 numbers, expected 128"),
    "a number more": (lambda s: s[:-7] + b" 1.0\n    -1\n", "more than 128 numbers"),
    "too great a count": (lambda s: s.replace(b"       128", b"9999999999", 1), "expected 9999999999 numbers"),
    "a negative count": (lambda s: s.replace(b"       128", b"      -128", 1), "found -128 values"),
    "a count that is no number": (lambda s: s.replace(b"       128", b"       12x", 1), "an integer: number of values"),
    "complex values": (lambda s: s.replace(b"\n         4", b"\n         6", 1), "found complex values|numbers"),
    "an unknown storage": (lambda s: s.replace(b"\n         4", b"\n         3", 1), "ordinate data type 3"),
    "an unknown spacing": (lambda s: s.replace(b"       128         1", b"       128         7", 1), "spacing 7"),
    "no step": (lambda s: s.replace(b"1.95312e-03", b"0.00000e+00", 1), "a time step of 0 s"),
    "an abscissa in another unit": (lambda s: s.replace(b" s  ", b" ms ", 1), "expected 17 .time. in s"),
    "no node": (lambda s: s.replace(b"NONE         1   1", b"NONE         ?   1", 1), "an integer: node"),
    "no such direction": (lambda s: s.replace(b"NONE         1   1", b"NONE         1   9", 1), "direction 9"),
    "a header that ends early": (lambda s: b"\n".join(s.split(b"\n")[:6]) + b"\n    -1\n", "found 4 header lines"),
    "a function type that is no number": (lambda s: s.replace(b"\n    1  ", b"\n    q  ", 1), "function type"),
    "a lost end and lost numbers": (lambda s: s[:-400], "numbers, expected 128"),
}  # fmt: skip


@pytest.mark.parametrize("case", DAMAGES)
def test_a_damaged_function_is_left_and_the_rest_of_its_record_read(tmp_path: Path, case: str) -> None:
    change, reason = DAMAGES[case]
    first, second, third = three(tmp_path)
    damaged = change(second)
    assert damaged != second
    remaining(read(tmp_path, first, damaged, third), reason)


def test_what_is_left_is_named_with_data_set_line_and_what_it_is(tmp_path: Path) -> None:
    first, second, third = three(tmp_path)
    found = read(tmp_path, first, second.replace(b"e-01", b"x-01", 1), third)
    (left,) = found.skipped
    line = first.count(b"\n") + 2
    assert (left.dataset, left.line, left.what) == (2, line, "data set 58, time response at 1:+X")
    assert str(left).startswith(f"data set 2, line {line}: data set 58, time response at 1:+X: found ")


def test_a_lost_end_or_beginning_harms_nothing_that_is_whole(tmp_path: Path) -> None:
    first, second, third = three(tmp_path)
    end = b"    -1\n"
    for parts in ((first[:-7], second, third), (first, second[7:], third), (first, second[:-7], third)):
        found = read(tmp_path, *parts)
        assert found.skipped == ()
        assert len(found.records[0].channels) == 3
    assert first.endswith(end)


def test_text_between_data_sets_is_named_and_passed_over(tmp_path: Path) -> None:
    first, second, third = three(tmp_path)
    found = read(tmp_path, first, b"Dear colleague,\nhere the rest.\n", second, b"\n \n", third)
    assert len(found.records[0].channels) == 3
    (left,) = found.skipped
    assert (left.dataset, left.what) == (1, "text between data sets")
    assert "found 'Dear colleague,', expected the line '    -1'" in left.reason


def test_a_number_of_a_data_set_that_is_none_is_passed_over(tmp_path: Path) -> None:
    first, second, third = three(tmp_path)
    found = read(tmp_path, first, second.replace(b"    58", b"    xx", 1), third)
    remaining(found, "found 'xx', expected the number of a data set|found '    xx'", 1)


@pytest.mark.parametrize("number", [18, 2420, 1858, 999999])
def test_data_sets_of_no_use_are_named_quietly(tmp_path: Path, number: int) -> None:
    first, second, third = three(tmp_path)
    found = read(tmp_path, first, f"    -1\n{number:6d}\n whatever\n   1 2 3\n    -1\n".encode(), second, third)
    assert len(found.records[0].channels) == 3
    (left,) = found.skipped
    assert str(left).startswith("data set 2, line ")
    assert (left.what, left.reason) == (f"data set {number}", "a data set of which Armonic makes no use")


def test_spectra_are_passed_over(tmp_path: Path) -> None:
    spectra = [record(1, 1) | {"func_type": kind} for kind in (2, 3, 9)]
    found = read_measured_uff(save(tmp_path / "a.uff", *spectra, *tap()))
    assert [left.reason.partition(",")[0] for left in found.skipped] == [
        "function type 2 (auto spectrum)", "function type 3 (cross spectrum)", "function type 9 (other)",
    ]  # fmt: skip
    assert len(found.records[0].channels) == 3


@pytest.mark.parametrize("item", ["<f8", ">f8", "<f4", ">f4"])
def test_a_wrong_byte_order_is_detected_and_named(tmp_path: Path, item: str) -> None:
    stated, real = (b"b     1", b"b     2") if item[0] == "<" else (b"b     2", b"b     1")
    wrong = binary_by_hand(item).replace(stated, real, 1)
    found = read(tmp_path, binary_by_hand(item).replace(b"   7   1", b"   8   1", 1), wrong)
    assert found.frfs is not None
    assert found.frfs.outputs == ("8.x",)
    (left,) = found.skipped
    assert "numbers that make sense only with the" in left.reason
    assert f"expected byte order {real[-1:].decode()}, as the data set states" in left.reason


def test_data_sets_of_different_byte_orders_in_one_file_are_all_read(tmp_path: Path) -> None:
    parts = [
        binary_by_hand(item).replace(b"   7   1", f"   {k}   1".encode(), 1)
        for k, item in enumerate(("<f8", ">f8", ">f4", "<f4"))
    ]
    found = read(tmp_path, *parts)
    assert found.skipped == ()
    assert found.frfs is not None
    assert len(found.frfs.outputs) == 4
    first = np.broadcast_to(found.frfs.values[:, :1], found.frfs.values.shape)
    np.testing.assert_allclose(found.frfs.values, first, rtol=2 * SINGLE_BINARY)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (b"b     1     2", b"b     1     1", "float format 1"),
        (b"b     1     2", b"b     3     2", "byte order 3"),
        (b"        77         1", b"        76         1", "1232 bytes of values, expected 1216"),
        (b"        77         1", b"9999999999         1", "1232 bytes of values, expected 159999999984"),
    ],
)
def test_a_damaged_binary_function_is_left_and_the_next_one_read(
    tmp_path: Path, old: bytes, new: bytes, reason: str
) -> None:
    whole = binary_by_hand("<f8")
    found = read(tmp_path, whole.replace(old, new, 1), whole.replace(b"   7   1", b"   8   1", 1))
    assert found.frfs is not None
    assert found.frfs.outputs == ("8.x",)
    assert reason in found.skipped[0].reason


def test_binary_values_that_look_like_the_end_of_a_data_set_are_read(tmp_path: Path) -> None:
    look_alike = np.frombuffer(b"    -1\n    -1\n    58\n    -1\n    ", "<f8")
    values = np.concatenate([np.ones(5), look_alike, np.ones(5)])
    kept = TimeSeries(
        np.column_stack([values, values]), 10.0, (Channel("a.x", "force", "N"), Channel("b.x", "velocity", "m/s"))
    )
    write_measured_uff(tmp_path / "a.uff", records=[kept], double=True)
    found = read_measured_uff(tmp_path / "a.uff")
    np.testing.assert_array_equal(found.records[0].values, kept.values)


def whole_file(path: Path, *, binary: bool) -> MeasuredFile:
    channels = (Channel("a.x", "force", "N"), Channel("b.x", "acceleration", "m/s²"))
    rng = np.random.default_rng(6)
    records = [TimeSeries(rng.normal(size=(40, 2)), 64.0, channels) for _ in range(3)]
    frfs = KUKA.frfs(np.linspace(5, 20, 31), noise=0.01)
    write_measured_uff(path, records=records, frfs=frfs, binary=binary, double=True)
    return read_measured_uff(path)


def in_it(found: MeasuredFile, whole: MeasuredFile) -> None:
    """All that was read is what the whole file has."""
    known = {(r.start_s, c.label, r.values[:, k].tobytes()) for r in whole.records for k, c in enumerate(r.channels)}
    for one in found.records:
        for k, channel in enumerate(one.channels):
            assert (one.start_s, channel.label, one.values[:, k].tobytes()) in known
    if found.frfs is not None and whole.frfs is not None:
        part = whole.frfs.select(outputs=found.frfs.outputs, inputs=found.frfs.inputs)
        np.testing.assert_array_equal(found.frfs.values, np.where(found.frfs.measured, part.values, 0))


@pytest.mark.parametrize("binary", [True, False])
def test_a_file_cut_off_anywhere_gives_what_is_whole_and_says_so(tmp_path: Path, binary: bool) -> None:
    whole = whole_file(tmp_path / "whole.uff", binary=binary)
    data = (tmp_path / "whole.uff").read_bytes()
    starts = [match.start() for match in re.finditer(rb"    -1\n    58", data)]
    for cut in range(len(data) - 2, 0, -len(data) // 150):
        # A function ends where the next begins; the last line end may be lost.
        complete = sum(start - 1 <= cut for start in starts[1:])
        if not complete:
            with pytest.raises(DataFileError):
                read(tmp_path, data[:cut])
            continue
        found = read(tmp_path, data[:cut])
        in_it(found, whole)
        assert sum(len(one.channels) for one in found.records) == min(complete, 6)
        responses = 0 if found.frfs is None else int(found.frfs.measured.sum())
        assert responses == (max(complete - 6, 0) + 1) // 2  # a coherence follows each
        if not data[:cut].rstrip(b" \n").endswith(b"    -1"):
            assert re.search("cut off|header lines|expected the line", found.skipped[-1].reason)


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 10**6), binary=st.booleans())
def test_no_flipped_bytes_make_anything_but_a_reading_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, seed: int, binary: bool
) -> None:
    folder = tmp_path_factory.mktemp("flipped")
    whole_file(folder / "whole.uff", binary=binary)
    data = bytearray((folder / "whole.uff").read_bytes())
    rng = random.Random(seed)
    for _ in range(rng.choice((1, 3, 30))):
        at = rng.randrange(len(data))
        data[at] = rng.choice((rng.randrange(256), 32, 10, 45, 49, 57))
        if rng.random() < 0.2:
            del data[at : at + rng.randrange(200)]
    with suppress(DataFileError):
        found = read(folder, bytes(data))
        assert found.frfs is None or np.isfinite(found.frfs.values).all()
        assert all("\n" not in str(left) for left in found.skipped)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty file"),
        (b" \n\n  \n", "empty file"),
        (b"Dear colleague,\nhere are the data.\n", r"line 1: found 'Dear colleague,'.*'    -1'"),
        (bytes(range(256)) * 9, "not a universal file"),
        (b"PK\x03\x04" + bytes(100), "not a universal file"),
        (b"    -1\n   151\nNONE\n    -1\n", "found only data sets 151"),
        (b"    -1\n    xx\n    -1\n", "not a universal file"),
        (by_hand()[:-7], "cut off within it"),
        (by_hand(edit={7: "7"}), r"line 2: found nothing that can be read \(data set 58"),
    ],
)
def test_a_file_of_which_nothing_can_be_read_is_one_error(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(DataFileError, match=message) as caught:
        read(tmp_path, content)
    assert str(caught.value).startswith(str(tmp_path / "damaged.uff"))
    assert "\n" not in str(caught.value)


def test_places_that_are_no_files_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "no.uff", tmp_path):
        with pytest.raises(DataFileError, match="expected a"):
            read_measured_uff(path)


def test_channels_of_different_length_in_one_record_are_named(tmp_path: Path) -> None:
    short = record(1, 2)
    short |= {"data": short["data"][:64], "x": short["x"][:64]}
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, FORCE), short, record(1, 3)))
    assert found.records[0].labels == ("force:1.x", "acceleration:1.z")
    assert "64 samples at 512 Hz from 0 s, where data set 1 of the same record has 128" in found.skipped[0].reason


def test_uneven_times_are_left_and_named(tmp_path: Path) -> None:
    times = np.cumsum(1 + 0.5 * np.sin(np.arange(128))) / 512
    uneven = record(1, 1, x=times) | {"abscissa_spacing": 0}
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, FORCE), uneven))
    assert found.records[0].labels == ("force:1.x",)
    assert "uneven steps" in found.skipped[0].reason


def test_samples_that_are_no_numbers_are_kept_in_records(tmp_path: Path) -> None:
    data = wave(1, 1, 12)
    data[5] = NAN
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, FORCE), record(1, 1, data=data)))
    assert found.skipped == ()
    assert np.flatnonzero(np.isnan(found.records[0]["acceleration:1.x"])).tolist() == [5]


def test_units_that_are_no_numbers_are_named_and_the_file_taken_for_si(tmp_path: Path) -> None:
    damaged = b"    -1\n   164\n         1\n mm N\n    -1\n"
    found = read(tmp_path, damaged, *three(tmp_path))
    assert (found.skipped[0].what, len(found.records)) == ("data set 164, units", 1)
    assert "'mm'" in found.skipped[0].reason


def test_exponents_of_fortran_and_numbers_without_a_blank_between_are_read(tmp_path: Path) -> None:
    first, second, third = three(tmp_path)
    glued = re.sub(rb"e([+-]\d\d)\n? +(?=-)", rb"D\1", second[1000:-7])
    found = read(tmp_path, first, second[:1000] + glued + b"\n    -1\n", third)
    assert glued.count(b"D") > 30
    assert found.skipped == ()
    np.testing.assert_allclose(found.records[0]["acceleration:1.x"], wave(1, 1, 12), atol=DOUBLE_TEXT)


def test_a_channel_that_is_in_one_record_twice_is_read_once(tmp_path: Path) -> None:
    channels = (Channel("a.x", "force", "N"), Channel("b.x", "acceleration", "m/s²"))
    write_measured_uff(tmp_path / "a.uff", records=[TimeSeries(np.ones((8, 2)), 64.0, channels)], binary=False)
    data = (tmp_path / "a.uff").read_bytes()
    third = data[data.rindex(b"    -1\n    58") :].replace(b"%-10s%10d" % (b"b", 2), b"%-10s%10d" % (b"b", 7))
    found = read(tmp_path, data, third)
    assert found.records[0].labels == ("force:a.x", "acceleration:b.x")
    assert found.skipped[0].reason.startswith("acceleration:b.x again, as in data set 5")
