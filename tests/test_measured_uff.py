"""Universal files of measured data: what we write comes back, here and in pyuff; what pyuff writes is read."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import pyuff

from armonic.errors import DataFileError
from armonic.files import read_uff
from armonic.files.measured_file import Geometry
from armonic.files.measured_files import read_measured, write_measured
from armonic.files.measured_uff import read_measured_uff
from armonic.files.measured_uff_writer import write_measured_uff
from armonic.frf_set import FrfSet
from armonic.series import Channel, TimeSeries
from frf_files import DOUBLE_TEXT, OUR_TEXT, SINGLE_BINARY, SINGLE_TEXT, binary_by_hand, oscillator, units
from measured_systems import KUKA
from uff_files import (
    EVEN_HZ,
    FORCE,
    RATE,
    TIME,
    UNEVEN_HZ,
    coherence,
    frf,
    gamma,
    record,
    response,
    save,
    tap,
    wave,
)

GEOMETRY = Geometry(
    ("sensor", "12", "tip"),
    np.array([[0.1, -0.25, 1.5], [0, 0, 0.125], [-2, 3e-3, 1]]),
    ((0, 1), (1, 2), (0, 2)),
)


def campaign(hits: int = 3) -> tuple[TimeSeries, ...]:
    """A roving hammer: the channel of the force changes from record to record."""
    rng = np.random.default_rng(4)
    watched = (Channel("sensor.x", "acceleration", "m/s²"), Channel("tip.rz", "velocity", "rad/s"))
    return tuple(
        TimeSeries(
            rng.normal(size=(200 + k, 3)) * [100, 1, 1e-3],
            44100.1,
            (Channel(f"sensor.{axis}", "force", "N"), *watched),
            0.2060000000000001 * k,
            {"robot": "KUKA", "hit": f"{axis}, «härter»"},
        )
        for k, axis in zip(range(hits), "xyz", strict=False)
    )


def same(found: TimeSeries, kept: TimeSeries, tolerance: float = 0.0) -> None:
    assert (found.channels, found.sample_rate_hz, found.start_s) == (kept.channels, kept.sample_rate_hz, kept.start_s)
    assert found.notes == kept.notes
    np.testing.assert_allclose(found.values, kept.values, rtol=tolerance, atol=0)


def nine(**changes: object) -> FrfSet:
    return KUKA.frfs(0.125 * np.arange(1, 161), noise=0.01, **changes)


def at_two_places() -> FrfSet:
    """Hit at one place, watched at two; two of the six pairs were not measured."""
    frfs = nine()
    measured = np.array([[True, True, False], [True, True, True], [False, True, True]])
    return FrfSet(
        frfs.freq_hz, frfs.values, "accelerance", ("sensor.x", "tip.z", "tip.rx"), ("tip.x", "tip.y", "12.z"),
        coherence=frfs.coherence, averages=np.array([[3, 4, 0], [5, 5, 5], [0, 2, 1]]), measured=measured,
        decay_rate=1 / 3, notes={"file": "a.h5", "robot": "Kräftig"},
    )  # fmt: skip


@pytest.mark.parametrize(("binary", "tolerance"), [(True, 0.0), (False, OUR_TEXT)])
def test_records_come_back_with_names_notes_rate_and_start(tmp_path: Path, binary: bool, tolerance: float) -> None:
    kept = campaign()
    write_measured_uff(tmp_path / "a.uff", records=kept, binary=binary, double=True)
    found = read_measured_uff(tmp_path / "a.uff")
    assert (found.skipped, found.remarks, found.frfs, found.modes) == ((), (), None, None)
    assert len(found.records) == 3
    for one, other in zip(found.records, kept, strict=True):
        same(one, other, tolerance)


def test_records_take_half_the_room_in_single_precision(tmp_path: Path) -> None:
    kept = campaign()
    write_measured_uff(tmp_path / "a.uff", records=kept)
    write_measured_uff(tmp_path / "b.uff", records=kept, double=True)
    single, double = ((tmp_path / name).stat().st_size for name in ("a.uff", "b.uff"))
    assert double - single == 4 * sum(record.values.size for record in kept)
    for one, other in zip(read_measured_uff(tmp_path / "a.uff").records, kept, strict=True):
        same(one, other, 2.0**-24)  # half a unit in the last of 24 bits


@pytest.mark.parametrize(("binary", "tolerance"), [(True, 0.0), (False, OUR_TEXT)])
def test_frequency_responses_come_back_with_coherence_averages_and_window(
    tmp_path: Path, binary: bool, tolerance: float
) -> None:
    kept = at_two_places()
    write_measured_uff(tmp_path / "a.uff", frfs=kept, binary=binary)
    found = read_measured_uff(tmp_path / "a.uff")
    assert (found.skipped, found.remarks) == ((), ())
    frfs = found.frfs
    assert frfs is not None
    assert (frfs.kind, frfs.outputs, frfs.inputs) == (kept.kind, kept.outputs, kept.inputs)
    assert (frfs.decay_rate, frfs.notes) == (kept.decay_rate, kept.notes)
    np.testing.assert_array_equal(frfs.freq_hz, kept.freq_hz)  # steps of an eighth are exact
    np.testing.assert_array_equal(frfs.measured, kept.measured)
    np.testing.assert_array_equal(frfs.averages, kept.averages)
    for part in ("real", "imag"):
        np.testing.assert_allclose(getattr(frfs.values, part), getattr(kept.values, part), rtol=tolerance)
    np.testing.assert_allclose(frfs.coherence, kept.coherence, rtol=tolerance)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_uneven_lines_and_every_kind_come_back(tmp_path: Path, binary: bool, kind: str) -> None:
    kept = KUKA.frfs(UNEVEN_HZ, noise=0.01, kind=kind)
    write_measured_uff(tmp_path / "a.uff", frfs=kept, binary=binary)
    frfs = read_measured_uff(tmp_path / "a.uff").frfs
    assert frfs is not None
    assert frfs.kind == kind
    np.testing.assert_array_equal(frfs.freq_hz, kept.freq_hz)
    np.testing.assert_allclose(frfs.values, kept.values, rtol=2 * OUR_TEXT)
    np.testing.assert_allclose(frfs.coherence, kept.coherence, rtol=OUR_TEXT)


@pytest.mark.parametrize("ending", ["uff", "unv", "uf58"])
def test_one_file_holds_everything(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"all.{ending}"
    write_measured(path, records=campaign(), frfs=nine(), geometry=GEOMETRY)
    found = read_measured(path)
    assert (len(found.records), found.skipped) == (3, ())
    assert found.frfs is not None
    assert found.frfs.outputs == ("tip.x", "tip.y", "tip.z")
    assert found.geometry is not None
    assert (found.geometry.names, set(found.geometry.lines)) == (GEOMETRY.names, set(GEOMETRY.lines))
    np.testing.assert_allclose(found.geometry.positions, GEOMETRY.positions, rtol=1e-6)  # seven digits in 12 columns


def test_the_matrix_at_the_sensor_is_read_by_the_reader_of_matrices_too(tmp_path: Path) -> None:
    kept = nine()
    write_measured_uff(tmp_path / "a.uff", frfs=kept)
    frf_ = read_uff(tmp_path / "a.uff")
    assert (frf_.frame, frf_.outputs, frf_.inputs) == ("tip", ("x", "y", "z"), ("x", "y", "z"))
    np.testing.assert_array_equal(frf_.values, kept.values)


@pytest.mark.parametrize("binary", [True, False])
def test_pyuff_reads_our_records_and_responses(tmp_path: Path, binary: bool) -> None:
    records, frfs = campaign(), at_two_places()
    write_measured_uff(tmp_path / "a.uff", records=records, frfs=frfs, binary=binary, double=True, title="Taps")
    file = pyuff.UFF(str(tmp_path / "a.uff"))
    sets = file.read_sets()
    assert [s["type"] for s in sets[:2]] == [151, 164]
    assert (sets[0]["model_name"], sets[1]["length"], sets[1]["force"]) == ("Taps", 1.0, 1.0)
    functions = [s for s in sets if s["type"] == 58]
    assert [s["func_type"] for s in functions] == [1] * 9 + [4, 6] * 7
    for k, function in enumerate(functions[:9]):
        series, column = records[k // 3], k % 3
        np.testing.assert_allclose(function["data"], series.values[:, column], rtol=OUR_TEXT)
        assert function["ver_num"] == k // 3 + 1
        told = (function["ordinate_spec_data_type"], function["rsp_dir"])
        assert told == [(13, k // 3 + 1), (12, 1), (11, 6)][column]
    pairs = [(i, j) for i in range(3) for j in range(3) if frfs.measured[i, j]]
    for (i, j), function, gamma_ in zip(pairs, functions[9::2], functions[10::2], strict=True):
        np.testing.assert_allclose(function["data"], frfs.values[:, i, j], rtol=2 * OUR_TEXT)
        np.testing.assert_allclose(gamma_["data"], frfs.coherence[:, i, j], rtol=OUR_TEXT)
        np.testing.assert_allclose(function["x"], frfs.freq_hz, rtol=1e-12)
        assert (function["ordinate_spec_data_type"], function["orddenom_spec_data_type"]) == (12, 13)
        assert function["ref_node"] == {"tip.x": 2, "tip.y": 2, "12.z": 12}[frfs.inputs[j]]  # a number stays its node


@pytest.mark.parametrize(("binary", "double"), [(0, False), (0, True), (1, True)])  # pyuff's binary is always double
def test_records_of_pyuff_are_read_with_directions_and_signs(tmp_path: Path, binary: int, double: bool) -> None:
    sets = [s for hit in range(2) for s in tap(hit, binary=binary)]
    sets = [s | {"ord_data_type": 4 if double else 2} for s in sets]
    found = read_measured_uff(save(tmp_path / "a.uff", units(1, 1, 1), *sets, double=double))
    assert (found.skipped, found.remarks) == ((), ())
    assert len(found.records) == 2  # the force comes again with the second hit
    for hit, one in enumerate(found.records):
        assert one.labels == ("force:1.x", "acceleration:1.x", "acceleration:2.z")
        assert [channel.unit for channel in one.channels] == ["N", "m/s²", "m/s²"]
        assert one.sample_rate_hz == RATE  # of a step of 1.95313e-03 s
        true = np.column_stack([wave(1, 1, 13, hit), wave(1, 1, 12, hit), -wave(2, -3, 12, hit)])
        np.testing.assert_allclose(one.values, true, atol=DOUBLE_TEXT if double else SINGLE_TEXT)


@pytest.mark.parametrize(("binary", "double"), [(0, False), (0, True), (1, True)])  # pyuff's binary is always double
@pytest.mark.parametrize("even", [True, False])
def test_responses_and_coherences_of_pyuff_are_read(tmp_path: Path, binary: int, even: bool, double: bool) -> None:
    f = EVEN_HZ if even else UNEVEN_HZ
    pairs = [((5, 1), (7, 3)), ((5, -2), (7, 3)), ((7, 3), (7, 3))]
    kinds = {"even": even, "binary": binary}
    sets = [frf(*p, f, **kinds, ord_data_type=6 if double else 5) for p in pairs]
    sets += [gamma(*p, f, **kinds, ord_data_type=4 if double else 2) for p in reversed(pairs)]
    found = read_measured_uff(save(tmp_path / "a.uff", units(1, 1, 1), *sets, double=double))
    assert (found.skipped, found.remarks) == ((), ())
    assert found.frfs is not None
    assert (found.frfs.outputs, found.frfs.inputs) == (("5.x", "5.y", "7.z"), ("7.z",))
    np.testing.assert_allclose(found.frfs.freq_hz, f, rtol=SINGLE_TEXT)
    true = np.column_stack([response(f, 1, 3), response(f, 2, 3), response(f, 3, 3)])
    tolerance = DOUBLE_TEXT if double else SINGLE_TEXT
    for part in ("real", "imag"):
        np.testing.assert_allclose(getattr(found.frfs.values[:, :, 0], part), getattr(true, part), rtol=tolerance)
    assert found.frfs.coherence is not None
    true_coherence = np.column_stack([coherence(f, k, 3) for k in (1, 2, 3)])
    np.testing.assert_allclose(found.frfs.coherence[:, :, 0], true_coherence, rtol=tolerance)


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_of_single_precision_and_of_either_byte_order_is_read(tmp_path: Path, order: str) -> None:
    one = binary_by_hand(f"{order}f4")
    (tmp_path / "a.uff").write_bytes(one + one.replace(b"   7   1", b"   8   1", 1))
    found = read_measured_uff(tmp_path / "a.uff")
    assert found.skipped == ()
    assert found.frfs is not None
    assert found.frfs.outputs == ("7.x", "8.x")
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], oscillator((1, 1)), rtol=2 * SINGLE_BINARY)


def numbered(field: str, numbers: list[int]) -> list[dict[str, object]]:
    """Two hits whose channels do not repeat: a roving hammer and a roving sensor at once."""
    sets = [record(1, 1, FORCE), record(3, 1), record(1, 2, FORCE, hit=1), record(4, 1, hit=1)]
    return [s | {field: number} for s, number in zip(sets, numbers, strict=True)]


@pytest.mark.parametrize("field", ["func_id", "ver_num", "load_case_id"])
def test_records_are_told_apart_by_the_numbers_that_a_file_gives_them(tmp_path: Path, field: str) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", *numbered(field, [1, 1, 2, 2])))
    assert [one.labels for one in found.records] == [
        ("force:1.x", "acceleration:3.x"), ("force:1.y", "acceleration:4.x"),
    ]  # fmt: skip


def test_records_are_put_together_though_their_channels_do_not_follow_each_other(tmp_path: Path) -> None:
    first, second = tap(0, ver_num=1), tap(1, ver_num=2)
    sets = [s for pair in zip(first, second, strict=True) for s in pair]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert [len(one.channels) for one in found.records] == [3, 3]
    np.testing.assert_allclose(found.records[1]["force:1.x"], wave(1, 1, 13, 1), atol=DOUBLE_TEXT)


def test_numbers_that_count_functions_make_no_records_of_one_channel(tmp_path: Path) -> None:
    sets = [s | {"func_id": k} for k, s in enumerate([*tap(0), *tap(1)], 1)]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert [len(one.channels) for one in found.records] == [3, 3]


def test_two_files_of_ours_one_after_the_other_are_one(tmp_path: Path) -> None:
    one, two = campaign(2), campaign(3)
    write_measured_uff(tmp_path / "a.uff", records=one, double=True)
    write_measured_uff(tmp_path / "b.uff", records=two, double=True)
    (tmp_path / "c.uff").write_bytes((tmp_path / "a.uff").read_bytes() + (tmp_path / "b.uff").read_bytes())
    found = read_measured_uff(tmp_path / "c.uff")
    assert [len(record_) for record_ in found.records] == [200, 201, 200, 201, 202]


def test_the_share_that_is_read_is_told_and_never_goes_back(tmp_path: Path) -> None:
    write_measured_uff(tmp_path / "a.uff", records=campaign(), frfs=nine(), binary=False)
    told: list[float] = []
    read_measured_uff(tmp_path / "a.uff", progress=told.append)
    assert told == sorted(told)
    assert len(told) > 5
    assert (told[0] >= 0, told[-1]) == (True, 1.0)


@pytest.mark.parametrize("binary", [True, False])
def test_reading_takes_little_memory_beyond_the_records(tmp_path: Path, binary: bool) -> None:
    rng = np.random.default_rng(0)
    channels = (Channel("a.x", "force", "N"), Channel("a.x", "acceleration", "m/s²"))
    kept = [TimeSeries(rng.normal(size=(20000, 2)), 4096.0, channels) for _ in range(30)]
    write_measured_uff(tmp_path / "a.uff", records=kept, binary=binary, double=True)
    tracemalloc.start()
    found = read_measured_uff(tmp_path / "a.uff")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    arrays = sum(one.values.nbytes for one in found.records)
    assert arrays == 30 * 20000 * 2 * 8
    # A piece of 1 MiB a few times over, as bytes and as numbers, and one record as its file has it.
    assert peak < arrays + 6 * (1 << 20)


def test_what_has_no_place_in_the_format_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.uff"
    radial = FrfSet(EVEN_HZ, np.ones((64, 1, 1)), "accelerance", ("tip.r",), ("tip.x",))
    with pytest.raises(DataFileError, match=r"found tip.r, expected axes among x, y"):
        write_measured_uff(path, frfs=radial)
    long = TimeSeries(np.ones((4, 1)), 1.0, (Channel("a" * 90 + ".x", "force", "N"),))
    with pytest.raises(DataFileError, match="the name of force:aaa"):
        write_measured_uff(path, records=[long])
    with pytest.raises(DataFileError, match="cannot be written"):
        write_measured_uff(tmp_path / "no" / "a.uff", records=campaign())
    assert list(tmp_path.iterdir()) == []


def test_names_that_are_no_ascii_come_back_with_the_responses(tmp_path: Path) -> None:
    kept = FrfSet(EVEN_HZ, np.ones((64, 1, 1)), "accelerance", ("Spitze, «oben».z",), ("3.x",))
    write_measured_uff(tmp_path / "a.uff", frfs=kept)
    frfs = read_measured_uff(tmp_path / "a.uff").frfs
    assert frfs is not None
    assert (frfs.outputs, frfs.inputs) == (kept.outputs, kept.inputs)


def test_the_roundest_rate_that_a_step_allows_is_taken(tmp_path: Path) -> None:
    for rate in (512.0, 25600.0, 3.7, 48000.0):
        path = save(tmp_path / "a.uff", record(1, 1, FORCE, x=TIME * RATE / rate))
        assert read_measured_uff(path).records[0].sample_rate_hz == rate


def test_files_of_ours_put_together_are_one_though_their_nodes_have_other_numbers(tmp_path: Path) -> None:
    whole = nine()
    x, y = whole.select(inputs="tip.x"), whole.select(inputs="tip.y")
    write_measured_uff(tmp_path / "a.uff", frfs=x)
    write_measured_uff(tmp_path / "b.uff", frfs=y, geometry=GEOMETRY)  # in which the tip is the third node
    (tmp_path / "c.uff").write_bytes((tmp_path / "a.uff").read_bytes() + (tmp_path / "b.uff").read_bytes())
    found = read_measured_uff(tmp_path / "c.uff")
    assert found.skipped == ()
    assert found.frfs is not None
    np.testing.assert_array_equal(found.frfs.values, whole.values[:, :, :2])


def test_line_ends_of_windows_and_an_end_of_file_of_dos_change_nothing(tmp_path: Path) -> None:
    write_measured_uff(tmp_path / "a.uff", records=campaign(), frfs=nine(), geometry=GEOMETRY, binary=False)
    data = (tmp_path / "a.uff").read_bytes()
    (tmp_path / "b.uff").write_bytes(b"\xef\xbb\xbf" + data.replace(b"\n", b"\r\n") + b"\x1a\x00\x00")
    one, two = (read_measured_uff(tmp_path / name) for name in ("a.uff", "b.uff"))
    assert two.skipped == ()
    for first, second in zip(one.records, two.records, strict=True):
        same(second, first)
    assert one.frfs is not None
    assert two.frfs is not None
    np.testing.assert_array_equal(one.frfs.values, two.frfs.values)
    assert two.geometry is not None
    assert two.geometry.names == GEOMETRY.names
