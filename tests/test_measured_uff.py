"""Universal files of measured data: what we write comes back, here and in pyuff; what pyuff writes is read."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import pyuff

from armonic.errors import DataFileError
from armonic.files import read_uff
from armonic.files.channel_map import ChannelMap
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


def test_millimetres_of_data_set_164_become_metres_and_kilonewtons_newtons(tmp_path: Path) -> None:
    scaled = units(1000.0, 1e-3)
    sets = [record(1, 1, (13, "kN")), record(1, 1, (12, "mm/s^2")), record(1, 4, (8, "rad")), record(1, 2, (8, ""))]
    found = read_measured_uff(save(tmp_path / "a.uff", scaled, *sets, frf((1, 1), (1, 1), units=("NONE", "NONE"))))
    (one,) = found.records
    assert [channel.unit for channel in one.channels] == ["N", "m/s²", "rad", "m"]
    factors = np.array([1e3, 1e-3, 1.0, 1e-3])
    true = np.column_stack([wave(1, 1, 13), wave(1, 1, 12), wave(1, 4, 8), wave(1, 2, 8)]) * factors
    np.testing.assert_allclose(one.values, true, rtol=0, atol=DOUBLE_TEXT * 1e3)
    assert found.frfs is not None
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], response(EVEN_HZ, 1, 1) * 1e-3 / 1e3, rtol=2 * DOUBLE_TEXT)
    assert found.remarks == ()


@pytest.mark.parametrize("first", [(), (units(1.0, 1.0, 1),)])
def test_g_beside_the_values_is_converted_and_said(tmp_path: Path, first: tuple[dict[str, object], ...]) -> None:
    sets = [record(1, 1, (13, "N")), record(1, 1, (12, "g")), frf((1, 1), (1, 1), units=("g/N", "NONE"), types=(12, 0))]
    found = read_measured_uff(save(tmp_path / "a.uff", *first, *sets))
    (one,) = found.records
    assert one.channels[1] == Channel("1.x", "acceleration", "m/s²")
    np.testing.assert_allclose(one["acceleration:1.x"], 9.80665 * wave(1, 1, 12), atol=10 * DOUBLE_TEXT)
    assert found.frfs is not None
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], 9.80665 * response(EVEN_HZ, 1, 1), rtol=2 * DOUBLE_TEXT)
    assert found.remarks == ("Acceleration was converted from g to m/s², by 9.80665.",)


def test_a_file_without_units_is_taken_for_si_and_that_is_said(tmp_path: Path) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, (13, "")), record(1, 1, (12, ""))))
    assert found.records[0].channels[1].unit == "m/s²"
    assert found.remarks == ("The file states no units (data set 164): numbers without any are taken for SI.",)


def test_units_that_contradict_each_other_leave_the_function_unless_a_map_tells_its_scale(tmp_path: Path) -> None:
    path = save(tmp_path / "a.uff", units(1000.0, 1.0), record(1, 1, FORCE), record(1, 1, (12, "g")))
    found = read_measured_uff(path)
    assert found.records[0].labels == ("force:1.x",)
    (left,) = found.skipped
    assert "acceleration" not in found.records[0].labels
    assert str(left).startswith("data set 3, line ")
    assert "labelled 'g', where a data set 164 says that 1 m/s² is 1000" in left.reason
    entry = {"node": 1, "direction": "x", "place": "sensor", "axis": "x", "quantity": "acceleration", "scale": 2.0}
    known = ChannelMap.of([entry])
    mapped = read_measured_uff(path, channels=known)
    assert mapped.skipped == ()
    np.testing.assert_allclose(mapped.records[0]["acceleration:sensor.x"], 2 * wave(1, 1, 12), atol=DOUBLE_TEXT * 2)


def test_an_unknown_unit_is_kept_and_said(tmp_path: Path) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", record(1, 1, FORCE), record(1, 1, (12, "V"))))
    assert found.records[0].channels[1].unit == "V"
    assert "Acceleration in V is not converted" in found.remarks[0]


def test_a_type_that_is_not_known_is_told_by_its_unit_or_left(tmp_path: Path) -> None:
    sets = [record(1, 1, (0, "N")), record(1, 1, (1, "m/s")), record(2, 1, (0, "V"))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.records[0].labels == ("force:1.x", "velocity:1.x")
    assert "data type 0 in V" in found.skipped[0].reason


MAP = [
    {"node": 1, "direction": "x", "place": "sensor", "axis": "-z", "quantity": "force"},
    {"node": 1, "direction": "x", "place": "sensor", "axis": "y", "quantity": "acceleration"},
    {"node": 2, "place": "tip", "rotate": {"x": "-z", "z": "x"}},
]


def test_a_map_turns_nodes_and_directions_into_places_and_axes_of_the_robot(tmp_path: Path) -> None:
    points = pyuff.prepare_15(node_nums=[1, 2], x=[0.0, 1.0], y=[0.0, 2.0], z=[0.0, 3.0])
    sets = (points, *tap(), frf((2, -3), (1, 1)), gamma((2, -3), (1, 1)))
    found = read_measured_uff(save(tmp_path / "a.uff", *sets), channels=ChannelMap.of(MAP))
    (one,) = found.records
    assert one.labels == ("force:sensor.z", "acceleration:sensor.y", "acceleration:tip.x")
    true = np.column_stack([-wave(1, 1, 13), wave(1, 1, 12), -wave(2, -3, 12)])
    np.testing.assert_allclose(one.values, true, atol=DOUBLE_TEXT)
    assert found.frfs is not None
    assert (found.frfs.outputs, found.frfs.inputs) == (("tip.x",), ("sensor.z",))
    # Both -z at the response and -x at the force turn: the file's -3 has one sign, the map's -z of the force another.
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], -response(EVEN_HZ, 3, 1), rtol=2 * DOUBLE_TEXT)
    assert found.frfs.coherence is not None
    assert found.geometry is not None
    assert found.geometry.names == ("sensor", "tip")


def test_a_strict_map_leaves_out_what_it_does_not_name(tmp_path: Path) -> None:
    sets = (*tap(), frf((2, -3), (1, 1)), frf((3, 1), (1, 1)))
    found = read_measured_uff(save(tmp_path / "a.uff", *sets), channels=ChannelMap.of(MAP, strict=True))
    assert found.frfs is not None
    assert found.frfs.outputs == ("tip.x",)
    alone = read_measured_uff(tmp_path / "a.uff", channels=ChannelMap.of(MAP[:2], strict=True))
    assert alone.records[0].labels == ("force:sensor.z", "acceleration:sensor.y")
    assert alone.frfs is None


def test_a_map_may_name_channels_as_the_program_that_recorded_them_did(tmp_path: Path) -> None:
    sets = [record(0, 0, FORCE, id1="Hammer", data=1 + TIME), record(0, 0, id1="Front left", data=2 + TIME)]
    entries = [("hammer", "x"), ("Front left", "-y")]
    channels = ChannelMap.of([{"channel": name, "place": "sensor", "axis": axis} for name, axis in entries])
    (one,) = read_measured_uff(save(tmp_path / "a.uff", *sets), channels=channels).records
    assert one.labels == ("force:sensor.x", "acceleration:sensor.y")
    np.testing.assert_allclose(one.values, np.column_stack([1 + TIME, -2 - TIME]), rtol=DOUBLE_TEXT)
    assert read_measured_uff(tmp_path / "a.uff").records[0].labels == ("force:Hammer", "acceleration:Front left")


def test_channels_mapped_twice_are_refused_in_records_and_responses(tmp_path: Path) -> None:
    twice = ChannelMap.of([{"node": k, "direction": "x", "place": "sensor", "axis": "x"} for k in (1, 2)])
    records = save(tmp_path / "a.uff", record(1, 1), record(2, 1))
    frfs = save(tmp_path / "b.uff", frf((1, 1), (3, 1)), frf((2, 1), (3, 1)))
    for path, quantity in ((records, "acceleration"), (frfs, "motion")):
        with pytest.raises(DataFileError, match=rf"both mapped onto {quantity}:sensor.x"):
            read_measured_uff(path, channels=twice)


def test_nodes_of_one_number_in_two_components_are_two_places(tmp_path: Path) -> None:
    sets = [frf((1, 1), (9, 1), rsp_ent_name="arm"), frf((1, 1), (9, 1), rsp_ent_name="base")]
    frfs = read_measured_uff(save(tmp_path / "a.uff", *sets)).frfs
    assert frfs is not None
    assert frfs.outputs == ("arm:1.x", "base:1.x")


def test_kinds_are_brought_to_one_and_that_is_said(tmp_path: Path) -> None:
    sets = [frf((1, 1), (1, 1)), frf((1, 2), (1, 1), types=(8, 13), units=("m", "N"))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    assert found.frfs.kind == "accelerance"
    np.testing.assert_allclose(found.frfs.values[:, 1, 0], response(EVEN_HZ, 2, 1), rtol=4 * DOUBLE_TEXT)
    assert "converted to accelerance, 1.y to 1.x among them" in found.remarks[0]


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
