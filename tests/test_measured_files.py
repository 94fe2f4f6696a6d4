"""Measured data are read from every format as one thing, several files as one, and what cannot be used is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from armonic.comparison import ModeTable
from armonic.errors import DataFileError, SignalError
from armonic.files.channel_map import ChannelMap
from armonic.files.joined import joined
from armonic.files.measured_file import Geometry, MeasuredFile
from armonic.files.measured_files import read_measured, write_measured
from armonic.frf_set import FrfSet
from armonic.response import Kind
from armonic.series import Channel, TimeSeries
from frf_files import DOUBLE_TEXT, EVEN_HZ, SINGLE_BINARY, by_pyuff, oscillator
from hdf5_files import SAMPLES, TIMES, matlab
from measured_systems import KUKA

LINES_HZ = np.arange(1, 101) * 0.25
HIT = (Channel("sensor.x", "force", "N"), Channel("sensor.x", "acceleration", "m/s²"))


def tap(seed: int = 0, channels: tuple[Channel, ...] = HIT) -> TimeSeries:
    values = np.random.default_rng(seed).normal(size=(64, len(channels)))
    return TimeSeries(values, 512.0, channels, notes={"hit": str(seed)})


def frfs(kind: Kind = "accelerance", **changes: Any) -> FrfSet:
    return replace(KUKA.frfs(LINES_HZ, noise=0.01, kind=kind), **changes)


def same(a: FrfSet | None, b: FrfSet | None) -> None:
    assert a is not None
    assert b is not None
    assert (a.outputs, a.inputs, a.kind) == (b.outputs, b.inputs, b.kind)
    np.testing.assert_array_equal(a.freq_hz, b.freq_hz)
    np.testing.assert_array_equal(a.values, b.values)


@pytest.mark.parametrize("name", ["a.csv", "a.mat", "a.zarr", "a.h5", "A.HDF5", "a.txt"])
def test_one_record_comes_back_from_every_format(tmp_path: Path, name: str) -> None:
    write_measured(tmp_path / name, records=[tap()])
    shares: list[float] = []
    read = read_measured(tmp_path / name, sample_rate_hz=512, progress=shares.append)
    (record,) = read.records
    assert record.channels == HIT
    np.testing.assert_array_equal(record.values, tap().values)
    assert dict(record.notes) == {"hit": "0"}
    assert (read.remarks, read.skipped, shares[-1]) == ((), (), 1.0)
    assert shares == sorted(shares)
    with pytest.raises(DataFileError, match="expected 100 Hz, as sample_rate_hz says"):
        read_measured(tmp_path / name, sample_rate_hz=100)


@pytest.mark.parametrize("name", ["a.csv", "a.h5"])
def test_frfs_come_back_from_every_format(tmp_path: Path, name: str) -> None:
    kept = frfs()
    write_measured(tmp_path / name, frfs=kept)
    same(read_measured(tmp_path / name).frfs, kept)


def test_frfs_of_several_places_come_back_from_a_table(tmp_path: Path) -> None:
    kept = frfs(outputs=("elbow.x", "tip.y", "tip.rz"), inputs=("tip.x", "tip.y", "base.z"))
    write_measured(tmp_path / "a.csv", frfs=kept)
    read = read_measured(tmp_path / "a.csv")
    same(read.frfs, kept)
    assert read.remarks == (f"{tmp_path / 'a.csv'} has no coherence.",)


def test_a_table_of_one_frame_gets_its_place_and_its_coherence(tmp_path: Path) -> None:
    lines = "".join(f"{f},{1 / f},{f}\n" for f in (1.0, 2.0))
    (tmp_path / "a.csv").write_text(f"# armonic frf kind=mobility frame=flange\nfreq_hz,x/y re,x/y im\n{lines}")
    (tmp_path / "c.csv").write_text("freq_hz,x/y\n1.0,0.5\n2.0,0.25\n")
    read = read_measured(tmp_path / "a.csv", coherence=tmp_path / "c.csv")
    assert read.frfs is not None
    assert (read.frfs.outputs, read.frfs.inputs, read.frfs.kind) == (("flange.x",), ("flange.y",), "mobility")
    np.testing.assert_array_equal(read.frfs.values.ravel(), [1 + 1j, 0.5 + 2j])
    np.testing.assert_array_equal(read.frfs.coherence.ravel(), [0.5, 0.25])  # type: ignore[union-attr]
    assert read.remarks == ()
    write_measured(tmp_path / "r.csv", records=[tap()])
    with pytest.raises(DataFileError, match="found a time record and coherence="):
        read_measured(tmp_path / "r.csv", coherence=tmp_path / "c.csv")


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0)])
@pytest.mark.parametrize("freq", ["freq_hz", "f", "Frequency"])
def test_a_matlab_file_of_frfs_is_read_in_either_order(
    tmp_path: Path, axes: tuple[int, int, int], freq: str
) -> None:  # fmt: skip
    H = np.stack([np.stack([oscillator((o, i)) for i in (1, 2, 3)], -1) for o in (1, 2, 3)], 1)
    gamma2 = np.random.default_rng(1).uniform(size=H.shape)
    savemat(tmp_path / "a.mat", {"H": H.transpose(axes), freq: EVEN_HZ, "gamma2": gamma2.transpose(axes)})
    with pytest.raises(DataFileError, match=r"no word on what was measured, expected kind="):
        read_measured(tmp_path / "a.mat")
    read = read_measured(tmp_path / "a.mat", kind="accelerance")
    assert read.frfs is not None
    np.testing.assert_array_equal(read.frfs.values, H)
    np.testing.assert_array_equal(read.frfs.coherence, gamma2)  # type: ignore[arg-type]
    assert read.frfs.outputs == ("tip.x", "tip.y", "tip.z")
    assert read.remarks == ("Nothing says where H was measured: it is taken along tip.x, tip.y, tip.z.",)


def test_a_matlab_file_may_say_all_of_it_itself(tmp_path: Path) -> None:
    H = np.random.default_rng(2).normal(size=(12, 2)) * (1 + 1j)
    texts = {"outputs": ["a.x", "a.y"], "inputs": ["z"]}
    cells = {name: np.array([*words, None], object)[:-1] for name, words in texts.items()}
    content = {"frf": H, "freq": np.arange(12.0), "kind": "receptance", "note": "hello", **cells}
    savemat(tmp_path / "a.mat", content)
    read = read_measured(tmp_path / "a.mat")
    assert read.frfs is not None
    assert (read.frfs.kind, read.frfs.outputs, read.frfs.inputs) == ("receptance", ("a.x", "a.y"), ("tip.z",))
    np.testing.assert_array_equal(read.frfs.values[:, :, 0], H)
    one = read_measured(tmp_path / "a.mat", outputs="a.x", inputs=["a.x", "a.y"])
    assert one.frfs is not None
    np.testing.assert_array_equal(one.frfs.values[:, 0, :], H)


def test_a_matlab_file_of_version_7_3_is_known_by_its_first_bytes(tmp_path: Path) -> None:
    (record,) = read_measured(matlab(tmp_path / "a.mat", {"y": SAMPLES, "t": TIMES[:, None]})).records
    assert record.labels == ("signal:y_1", "signal:y_2")
    np.testing.assert_array_equal(record.values, SAMPLES)


def test_a_map_names_modes_and_points_too(tmp_path: Path) -> None:
    modes = ModeTable(np.array([-1 + 5j]), np.array([[1j, 2.0]]), ("7.x", "7.y"))
    write_measured(tmp_path / "a.h5", modes=modes, geometry=Geometry(("7", "8"), np.zeros((2, 3))))
    chosen = ChannelMap.of([{"node": 7, "place": "tip", "rotate": {"x": "y", "y": "-x"}}])
    read = read_measured(tmp_path / "a.h5", channels=chosen)
    assert read.geometry is not None
    assert read.geometry.names == ("tip", "8")
    assert read.modes is not None
    assert read.modes.coordinates == ("tip.y", "tip.x")
    np.testing.assert_array_equal(read.modes.shapes, [[1j, -2.0]])  # type: ignore[arg-type]


def test_lines_and_responses_without_numbers_are_left_out_and_told(tmp_path: Path) -> None:
    H = np.ones((10, 2, 2), complex)
    H[3, 0, 1], H[4, 1, 0] = np.nan, np.inf
    H[:, 1, 1] = np.nan
    savemat(tmp_path / "a.mat", {"H": H, "f": np.arange(10.0)})
    read = read_measured(tmp_path / "a.mat", kind="mobility", outputs=("a.x", "a.y"), inputs=("a.x", "a.y"))
    assert read.frfs is not None
    np.testing.assert_array_equal(read.frfs.freq_hz, [0, 1, 2, 5, 6, 7, 8, 9])
    np.testing.assert_array_equal(read.frfs.measured, [[True, True], [True, False]])
    assert [str(left) for left in read.skipped] == ["response a.y to a.y: 10 lines are not finite"]
    assert f"2 of 10 lines of {tmp_path / 'a.mat'} are left out" in read.remarks[-1]
    savemat(tmp_path / "a.mat", {"H": np.full((3, 1, 1), np.nan + 0j), "f": np.arange(3.0)})
    with pytest.raises(DataFileError, match="found no finite response"):
        read_measured(tmp_path / "a.mat", kind="mobility", outputs="a.x", inputs="a.x")


@pytest.mark.parametrize(
    ("content", "options", "said"),
    [
        ({"H": np.ones((4, 3, 3), complex), "f": np.arange(5.0)}, {}, r"found H 4x3x3 and 5 frequencies"),
        ({"H": np.ones((4, 3, 3), complex)}, {}, r"found H and no frequencies \(H 4x3x3\)"),
        ({"H": np.ones((4, 2, 3), complex), "f": np.arange(4.0)}, {}, r"found 2 outputs of H and no names"),
        ({"H": np.ones((4, 3, 3), complex), "G": np.ones(2) * 1j, "f": np.arange(4.0)}, {},
         r"found H 4x3x3, G 1x2, f 1x4, expected one complex array .*variable="),
        ({"H": np.ones((4, 3, 3), complex), "f": np.arange(4.0)[::-1]}, {"kind": "mobility"},
         r"freq_hz: found 2 Hz at index 1 after 3 Hz, expected strictly increasing"),
        ({"H": np.ones((4, 3, 3), complex), "f": np.arange(4.0)}, {"kind": "impedance"}, r"found the kind 'impedance'"),
        ({"H": np.ones((4, 3, 3), complex), "f": np.arange(4.0)}, {"freq_variable": "g"}, r"found no vector g"),
        ({"H": np.ones((4, 3, 3), complex), "f": np.arange(4.0)}, {"variable": "f"}, r"found .*expected|times"),
    ],
)  # fmt: skip
def test_a_matlab_file_that_leaves_the_choice_asks(
    tmp_path: Path, content: dict[str, Any], options: dict[str, Any], said: str
) -> None:
    savemat(tmp_path / "a.mat", content)
    with pytest.raises(DataFileError, match=said):
        read_measured(tmp_path / "a.mat", **options)


@pytest.mark.parametrize("name", ["a.mat", "a.h5", "a.csv", "a.zarr"])
def test_damaged_and_missing_files_are_refused_in_one_sentence(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataFileError, match=name):
        read_measured(tmp_path / name)
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(DataFileError, match=name):
        read_measured(tmp_path / name)
    (tmp_path / name).write_bytes(b"\x00\x01\x02 nothing of the kind \xff" * 20)
    with pytest.raises(DataFileError, match=name):
        read_measured(tmp_path / name)


def test_a_map_by_its_path_names_the_channels_and_tells_what_it_did_not_meet(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("time (s),Ch 1,Ch 2 (g)\n" + "".join(f"{k / 64},{k},{2 * k}\n" for k in range(9)))
    (tmp_path / "map.csv").write_text(
        "channel,place,axis,quantity,unit\nch 1,sensor,-z,force,kN\nCh 2,sensor,x,,\nCh 3,tip,x,,\n"
    )
    read = read_measured(tmp_path / "t.csv", channels=tmp_path / "map.csv")
    (record,) = read.records
    assert record.channels == (Channel("sensor.z", "force", "N"), Channel("sensor.x", "acceleration", "m/s²"))
    np.testing.assert_allclose(record["force"], -1000.0 * np.arange(9))
    converted, unmet = read.remarks
    assert converted == "acceleration:sensor.x was converted from g to m/s², by 9.80665."
    assert unmet.endswith("map.csv, line 4: nothing that was read is channel 'Ch 3'.")


def test_a_map_turns_the_nodes_of_a_universal_file(tmp_path: Path) -> None:
    path = by_pyuff(tmp_path / "a.uff", [(1, 1), (-2, 1), (3, 1)])
    chosen = ChannelMap.of([{"node": 7, "place": "tip", "rotate": {"x": "y", "y": "-x"}}])
    frfs = read_measured(path, channels=chosen).frfs
    assert frfs is not None
    found = {output: frfs.values[:, k, 0] for k, output in enumerate(frfs.outputs)}
    assert frfs.inputs == ("tip.y",)
    # The file has the response along -y of the node, which is x of the tip.
    for label, dof in {"tip.y": (1, 1), "tip.x": (-2, 1), "tip.z": (3, 1)}.items():
        expected = oscillator(dof)
        np.testing.assert_allclose(found[label], expected, atol=DOUBLE_TEXT * np.abs(expected).max())


def test_records_and_points_go_from_hdf5_to_a_universal_file_and_back(tmp_path: Path) -> None:
    points = Geometry(("sensor",), np.array([[1.0, 2.0, 3.0]]))
    write_measured(tmp_path / "a.uff", records=[tap(1), tap(2)], geometry=points)
    read = read_measured(tmp_path / "a.uff", sample_rate_hz=512)
    write_measured(tmp_path / "a.h5", records=read.records, geometry=read.geometry)
    again = read_measured(tmp_path / "a.h5")
    for record, kept in zip(again.records, (tap(1), tap(2)), strict=True):
        assert record.channels == HIT
        np.testing.assert_allclose(record.values, kept.values, rtol=SINGLE_BINARY)  # of single precision, or better
    assert again.geometry is not None
    np.testing.assert_array_equal(again.geometry.positions, points.positions)
    with pytest.raises(DataFileError, match="expected 100 Hz, as sample_rate_hz says"):
        read_measured(tmp_path / "a.uff", sample_rate_hz=100)


def test_a_map_met_by_one_of_several_files_is_met(tmp_path: Path) -> None:
    for name, channel in (("a.csv", "Ch 1"), ("b.csv", "Ch 2")):
        write_measured(tmp_path / name, records=[tap(channels=(Channel(channel, "force", "N"),))])
    chosen = ChannelMap.of([{"channel": f"Ch {k}", "place": "tip", "axis": "x"} for k in (1, 2)])
    read = read_measured([tmp_path / "a.csv", tmp_path / "b.csv"], channels=chosen)
    assert [r.labels for r in read.records] == [("force:tip.x",), ("force:tip.x",)]
    assert not any("nothing that was read" in remark for remark in read.remarks)
    assert len(chosen.unmet()) == 2  # the caller's own map is left as it was


def test_responses_without_a_force_are_read_and_told(tmp_path: Path) -> None:
    quiet = tap(channels=(Channel("tip.x", "acceleration", "m/s²"),))
    write_measured(tmp_path / "a.h5", records=[quiet])
    read = read_measured(tmp_path / "a.h5")
    assert len(read.records) == 1
    assert read.remarks == ("No record has a channel of force: frequency responses need one.",)
    write_measured(tmp_path / "a.h5", records=[tap(), quiet, tap()])
    (told,) = read_measured(tmp_path / "a.h5").remarks
    assert told.startswith("1 of 3 records have no channel of force (2)")


def test_records_of_several_files_follow_each_other_with_their_progress(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.h5", "b.csv", "c.mat")]
    write_measured(paths[0], records=[tap(1), tap(2)])
    write_measured(paths[1], records=[tap(3)])
    write_measured(paths[2], records=[tap(4)])
    shares: list[float] = []
    read = read_measured(paths, progress=shares.append)
    assert [r.notes["hit"] for r in read.records] == ["1", "2", "3", "4"]
    assert read.path == ", ".join(map(str, paths))
    assert shares == sorted(shares)
    assert (shares[0] > 0, shares[-1]) == (True, 1.0)


def test_frfs_of_a_roving_hammer_become_one_set(tmp_path: Path) -> None:
    whole = frfs()
    parts = [whole.select(inputs=label) for label in whole.inputs]
    for k, part in enumerate(parts):
        write_measured(tmp_path / f"{k}.h5", frfs=part)
    read = read_measured([tmp_path / f"{k}.h5" for k in range(3)])
    same(read.frfs, whole)
    assert read.frfs is not None
    np.testing.assert_array_equal(read.frfs.coherence, whole.coherence)  # type: ignore[arg-type]
    np.testing.assert_array_equal(read.frfs.averages, whole.averages)  # type: ignore[arg-type]
    two = read_measured([tmp_path / "0.h5", tmp_path / "2.h5"]).frfs
    assert two is not None
    assert two.inputs == (whole.inputs[0], whole.inputs[2])


def test_pairs_that_no_file_has_stay_unmeasured_and_kinds_are_brought_to_one(tmp_path: Path) -> None:
    whole = frfs("receptance", coherence=None, averages=None)
    write_measured(tmp_path / "a.h5", frfs=whole.select(outputs="*.x", inputs="*.x"))
    write_measured(tmp_path / "b.h5", frfs=whole.select(outputs="*.y", inputs="*.y").to("accelerance"))
    read = read_measured([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert read.frfs is not None
    np.testing.assert_array_equal(read.frfs.measured, np.eye(2, dtype=bool))
    assert read.frfs.kind == "accelerance"
    s = 2j * np.pi * LINES_HZ
    np.testing.assert_allclose(read.frfs.values[:, 0, 0], s**2 * whole.values[:, 0, 0], rtol=1e-14)  # roundings of s²
    assert any(text.endswith("were converted to accelerance.") for text in read.remarks)


def test_the_same_response_in_two_files_is_kept_once_and_told(tmp_path: Path) -> None:
    first, second = frfs().select(outputs="*.x"), frfs(values=2 * frfs().values)
    write_measured(tmp_path / "a.h5", frfs=first)
    write_measured(tmp_path / "b.h5", frfs=second)
    read = read_measured([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert read.frfs is not None
    np.testing.assert_array_equal(read.frfs.values[:, 0], first.values[:, 0])
    np.testing.assert_array_equal(read.frfs.values[:, 1:], second.values[:, 1:])
    assert len(read.skipped) == 3
    assert str(read.skipped[0]) == f"{tmp_path / 'b.h5'}: response tip.x to tip.x: that of {tmp_path / 'a.h5'} is kept"


def test_coherence_that_one_file_lacks_is_left_out_for_all_and_told(tmp_path: Path) -> None:
    write_measured(tmp_path / "a.h5", frfs=frfs().select(inputs="*.x"))
    write_measured(tmp_path / "b.h5", frfs=replace(frfs(), coherence=None).select(inputs="*.y"))
    read = read_measured([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert read.frfs is not None
    assert read.frfs.coherence is None
    assert any("b.h5 has no coherence: that of the other files is left out" in text for text in read.remarks)


def test_different_resolutions_are_refused_with_both_files(tmp_path: Path) -> None:
    write_measured(tmp_path / "a.h5", frfs=frfs().select(inputs="*.x"))
    write_measured(tmp_path / "b.h5", frfs=frfs().lines(np.arange(0, 100, 2)).select(inputs="*.y"))
    said = r"b.h5: found different resolutions: 50 lines .*step 0.5 Hz, expected 100 lines .*step 0.25 Hz, as in .*a.h5"
    with pytest.raises(DataFileError, match=said):
        read_measured([tmp_path / "a.h5", tmp_path / "b.h5"])
    write_measured(tmp_path / "b.h5", frfs=replace(frfs(), decay_rate=0.5).select(inputs="*.y"))
    with pytest.raises(DataFileError, match=r"b.h5: found an exponential window of 0.5/s, expected one of 0/s"):
        read_measured([tmp_path / "a.h5", tmp_path / "b.h5"])


def test_lines_that_differ_by_the_digits_of_a_file_are_the_same(tmp_path: Path) -> None:
    write_measured(tmp_path / "a.h5", frfs=frfs().select(inputs="*.x"))
    rounded = replace(frfs(), freq_hz=LINES_HZ * (1 + 3e-6)).select(inputs="*.y")  # six digits
    write_measured(tmp_path / "b.h5", frfs=rounded)
    read = read_measured([tmp_path / "a.h5", tmp_path / "b.h5"])
    assert read.frfs is not None
    np.testing.assert_array_equal(read.frfs.freq_hz, LINES_HZ)


def test_geometries_are_joined_by_the_names_of_points_and_modes_taken_once() -> None:
    modes = ModeTable(np.array([-1 + 5j]))
    a = Geometry(("1", "2"), np.array([[0.0, 0, 0], [1, 0, 0]]), ((0, 1),))
    b = Geometry(("2", "3"), np.array([[1.0, 0, 0], [2, 0, 0]]), ((0, 1),))
    c = Geometry(("3",), np.array([[2.0, 1, 0]]))
    whole = joined([MeasuredFile(n, modes=modes, geometry=g) for n, g in (("a", a), ("b", b), ("c", c))])
    assert whole.geometry is not None
    assert (whole.geometry.names, whole.geometry.lines) == (("1", "2", "3"), ((0, 1), (1, 2)))
    np.testing.assert_array_equal(whole.geometry.positions, [[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert whole.modes is modes
    assert [str(left) for left in whole.skipped] == [f"{n}: modes: those of a are kept" for n in "bc"]
    assert whole.remarks == ("c: point 3 lies elsewhere than in another file, whose place is kept.",)


def test_unknown_endings_and_options_are_refused_with_the_known_ones(tmp_path: Path) -> None:
    write_measured(tmp_path / "a.csv", records=[tap()])
    with pytest.raises(DataFileError, match=r"found the ending '.xyz', expected one of .uff, .unv"):
        read_measured(tmp_path / "a.xyz")
    with pytest.raises(DataFileError, match=r"found kindd=, expected one of .* for .csv. Did you mean kind\?"):
        read_measured(tmp_path / "a.csv", kindd="mobility")
    with pytest.raises(DataFileError, match=r"found variable=, expected one of .*kind, frame, coherence for .csv"):
        read_measured(tmp_path / "a.csv", variable="y")
    with pytest.raises(DataFileError, match="found no file, expected at least one"):
        read_measured([])
    with pytest.raises(DataFileError, match=r"found binary=, expected none for .h5"):
        write_measured(tmp_path / "a.h5", records=[tap()], binary=True)
    with pytest.raises(SignalError, match="sample_rate_hz"):
        read_measured(tmp_path / "a.csv", sample_rate_hz=-1)


def test_what_a_format_has_no_place_for_is_refused(tmp_path: Path) -> None:
    hint = "Write .h5 or .uff, which hold everything"
    with pytest.raises(DataFileError, match=rf"found 2 records, expected one record, for .mat. {hint}"):
        write_measured(tmp_path / "a.mat", records=[tap(), tap()])
    with pytest.raises(DataFileError, match=r"found records and frfs, expected one record, or FRFs alone, for .csv"):
        write_measured(tmp_path / "a.csv", records=[tap()], frfs=frfs())
    with pytest.raises(DataFileError, match=r"found frfs, expected one record, for \.zarr"):
        write_measured(tmp_path / "a.zarr", frfs=frfs())
    with pytest.raises(DataFileError, match="found nothing to write"):
        write_measured(tmp_path / "a.h5")
    with pytest.raises(DataFileError, match="found an exponential window"):
        write_measured(tmp_path / "a.csv", frfs=frfs(decay_rate=0.1))
    with pytest.raises(DataFileError, match="found pairs that were not measured"):
        write_measured(tmp_path / "a.csv", frfs=frfs(measured=np.eye(3, dtype=bool)))
    assert list(tmp_path.iterdir()) == []
