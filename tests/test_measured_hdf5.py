"""HDF5 files of measured data come back bit for bit, and those of others are read as they are meant."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from armonic.comparison import ModeTable
from armonic.errors import DataFileError
from armonic.files.channel_map import ChannelMap
from armonic.files.measured_hdf5 import read_measured_hdf5, write_measured_hdf5
from armonic.series import Channel
from hdf5_files import RANDOM, SAMPLES, TIMES, foreign, frfs, full, matlab, same_frfs, same_record, tap


def test_everything_measured_comes_back_bit_for_bit(tmp_path: Path) -> None:
    held = full(tmp_path / "a.h5")
    shares: list[float] = []
    again = read_measured_hdf5(tmp_path / "a.h5", progress=shares.append)
    assert len(again.records) == 2
    for found, kept in zip(again.records, held.records, strict=True):
        same_record(found, kept)
    same_frfs(again.frfs, held.frfs)
    assert again.modes is not None
    assert held.modes is not None
    np.testing.assert_array_equal(again.modes.poles, held.modes.poles)
    np.testing.assert_array_equal(again.modes.shapes, held.modes.shapes)  # type: ignore[arg-type]
    assert again.modes.coordinates == held.modes.coordinates
    assert again.geometry is not None
    assert held.geometry is not None
    np.testing.assert_array_equal(again.geometry.positions, held.geometry.positions)
    assert (again.geometry.names, again.geometry.lines) == (held.geometry.names, held.geometry.lines)
    assert (again.skipped, again.remarks) == ((), ())
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_what_is_not_known_stays_unknown(tmp_path: Path) -> None:
    plain = frfs(coherence=None, averages=None, decay_rate=0.0, notes={})
    write_measured_hdf5(tmp_path / "a.h5", frfs=plain, modes=ModeTable(np.array([-1 + 3j])))
    again = read_measured_hdf5(tmp_path / "a.h5")
    same_frfs(again.frfs, plain)
    assert again.modes is not None
    assert again.modes.shapes is None
    assert again.remarks == (f"{tmp_path / 'a.h5'} has no coherence.",)


def test_the_same_data_make_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.h5", "b.h5"):
        write_measured_hdf5(tmp_path / name, records=(tap(1),), frfs=frfs())
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_h5py_alone_finds_the_layout_that_is_documented(tmp_path: Path) -> None:
    held = full(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert file.attrs["armonic_measured"] == 1
        group = file["records/0001"]
        np.testing.assert_array_equal(group["values"], held.records[1].values)
        assert [text.decode() for text in group["units"]] == ["N", "m/s²"]
        assert group.attrs["sample_rate_hz"] == 44100.1
        assert group.attrs["kind"] == b"record"
        assert json.loads(group["notes"][0]) == dict(held.records[1].notes)
        assert held.frfs is not None
        np.testing.assert_array_equal(file["frfs/values"], held.frfs.values)
        assert file["frfs"].attrs["frf_kind"] == b"accelerance"


def test_nothing_to_write_is_refused_and_so_is_a_place_without_a_folder(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match="found nothing to write"):
        write_measured_hdf5(tmp_path / "a.h5")
    with pytest.raises(DataFileError, match="cannot be written"):
        write_measured_hdf5(tmp_path / "none" / "a.h5", records=(tap(1),))


def test_a_later_layout_asks_for_an_update(tmp_path: Path) -> None:
    full(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.attrs["armonic_measured"] = 2
    with pytest.raises(DataFileError, match=r"version 1\. Update Armonic"):
        read_measured_hdf5(tmp_path / "a.h5")


def test_another_rate_than_is_asked_for_is_refused(tmp_path: Path) -> None:
    write_measured_hdf5(tmp_path / "a.h5", records=(tap(1),))
    with pytest.raises(DataFileError, match=r"44100\.1 Hz, expected 512 Hz"):
        read_measured_hdf5(tmp_path / "a.h5", sample_rate_hz=512)


@pytest.mark.parametrize(
    "content",
    [
        {"time": TIMES, "values": SAMPLES},
        {"Time": TIMES[:, None], "values": SAMPLES.T},
        {"values": SAMPLES, "fs": 256.0},
        {"values": SAMPLES, "at_sample_rate": 256},
        {"values": SAMPLES, "at_dt": 1 / 256},
        {"t": TIMES, "values_1": SAMPLES[:, 0], "values_2": SAMPLES[:, 1]},
        {"time": TIMES.astype(">f8"), "values": SAMPLES.astype(">f8")},
    ],
)
def test_a_matrix_and_times_or_a_rate_are_a_record(tmp_path: Path, content: dict[str, Any]) -> None:
    (record,) = read_measured_hdf5(foreign(tmp_path / "f.h5", root=content)).records
    assert record.sample_rate_hz == 256
    assert record.labels == ("signal:values_1", "signal:values_2")
    np.testing.assert_array_equal(record.values, SAMPLES)


def test_every_group_is_a_record_with_its_own_names_and_units(tmp_path: Path) -> None:
    hit = {"t": TIMES, "y": SAMPLES, "channels": ["sensor.x", "tip:-Z"], "at_units": ["N", "g"]}
    broken = {"y": SAMPLES, "at_units": ["N", "g"]}
    read = read_measured_hdf5(foreign(tmp_path / "f.h5", hit_1=hit, hit_2=hit, calibration=broken))
    assert len(read.records) == 2
    assert read.records[0].channels == (Channel("sensor.x", "force", "N"), Channel("tip.z", "acceleration", "m/s²"))
    np.testing.assert_allclose(read.records[0].values, SAMPLES * [1, -9.80665], rtol=1e-15)  # one rounding
    (left,) = read.skipped
    assert (left.what, "no times and no sampling rate" in left.reason) == ("calibration", True)
    (remark,) = read.remarks
    assert "acceleration:tip.z was converted from g" in remark
    named = read_measured_hdf5(tmp_path / "f.h5", variable="calibration/y", sample_rate_hz=100.0)
    assert [r.sample_rate_hz for r in named.records] == [100]


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0)])
def test_complex_numbers_and_frequencies_are_frfs(tmp_path: Path, axes: tuple[int, int, int]) -> None:
    H = RANDOM.normal(size=(9, 2, 3)) + 1j * RANDOM.normal(size=(9, 2, 3))
    gamma2 = RANDOM.uniform(size=H.shape)
    content = {
        "frf": H.transpose(axes), "coherence": gamma2.transpose(axes), "freq": np.arange(1.0, 10),
        "at_kind": "mobility",
        "outputs": ["a.x", "b.y"], "inputs": ["x", "y", "z"],
    }  # fmt: skip
    read = read_measured_hdf5(foreign(tmp_path / "f.h5", data=content))
    assert read.frfs is not None
    assert (read.frfs.kind, read.frfs.outputs, read.frfs.inputs) == (
        "mobility", ("a.x", "b.y"), ("tip.x", "tip.y", "tip.z"),
    )  # fmt: skip
    np.testing.assert_array_equal(read.frfs.values, H)
    np.testing.assert_array_equal(read.frfs.coherence, gamma2)  # type: ignore[arg-type]


def test_a_matlab_file_of_version_7_3_lies_transposed(tmp_path: Path) -> None:
    H = RANDOM.normal(size=(3, 3, 20)) + 1j * RANDOM.normal(size=(3, 3, 20))
    H[1, 2, 4] = complex(1, np.inf)
    path = matlab(tmp_path / "m.mat", {"H": H, "f": np.arange(1.0, 21)[:, None], "kind": "receptance"})
    read = read_measured_hdf5(path)
    assert read.frfs is not None
    assert (read.frfs.kind, read.frfs.outputs) == ("receptance", ("tip.x", "tip.y", "tip.z"))
    kept = np.arange(20) != 4
    np.testing.assert_array_equal(read.frfs.values, np.moveaxis(H, 2, 0)[kept])
    assert "1 of 20 lines" in " ".join(read.remarks)
    assert "tip.y to tip.z first, at 5 Hz" in " ".join(read.remarks)
    assert read.skipped == ()
    path = matlab(tmp_path / "r.mat", {"y": SAMPLES, "fs": np.array([[256.0]])})
    np.testing.assert_array_equal(read_measured_hdf5(path).records[0].values, SAMPLES)


def test_a_file_that_leaves_the_choice_asks(tmp_path: Path) -> None:
    path = foreign(tmp_path / "f.h5", root={"a": SAMPLES, "b": SAMPLES, "t": TIMES})
    with pytest.raises(DataFileError, match=r"found a 40x2, b 40x2, t 40, expected one matrix .*variable="):
        read_measured_hdf5(path)
    np.testing.assert_array_equal(read_measured_hdf5(path, variable="b").records[0].values, SAMPLES)
    with pytest.raises(DataFileError, match=r"found no array c \(a 40x2, b 40x2, t 40\)"):
        read_measured_hdf5(path, variable="c")
    H = np.ones((5, 1, 1), complex)
    path = foreign(tmp_path / "g.h5", root={"H": H, "lines": np.arange(5.0), "outputs": ["a.x"], "inputs": ["a.x"]})
    with pytest.raises(DataFileError, match=r"found H and no frequencies .* freq_variable="):
        read_measured_hdf5(path)
    with pytest.raises(DataFileError, match=r"no word on what was measured, expected kind= as one of receptance"):
        read_measured_hdf5(path, freq_variable="lines")
    read = read_measured_hdf5(path, freq_variable="lines", kind="accelerance")
    assert read.frfs is not None
    with pytest.raises(DataFileError, match=r"found 1 outputs of H and 2 names"):
        read_measured_hdf5(path, freq_variable="lines", kind="accelerance", outputs=("a.x", "a.y"))


def test_a_map_names_the_channels_of_a_file(tmp_path: Path) -> None:
    path = foreign(tmp_path / "f.h5", root={"t": TIMES, "y": SAMPLES})
    chosen = ChannelMap.of([
        {"channel": "y_1", "place": "sensor", "axis": "-z", "quantity": "force", "unit": "kN"},
        {"channel": "y_2", "place": "sensor", "axis": "x", "quantity": "acceleration", "unit": "m/s²"},
    ])  # fmt: skip
    (record,) = read_measured_hdf5(path, channels=chosen).records
    assert record.channels == (Channel("sensor.z", "force", "N"), Channel("sensor.x", "acceleration", "m/s²"))
    np.testing.assert_array_equal(record.values, SAMPLES * [-1000, 1])
