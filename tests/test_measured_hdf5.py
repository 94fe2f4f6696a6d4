"""HDF5 files of measured data come back bit for bit, others' are read, and nothing in one is followed or trusted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from armonic.comparison import ModeTable
from armonic.errors import DataFileError
from armonic.files.channel_map import ChannelMap
from armonic.files.hdf5_heap import sound_heaps
from armonic.files.hdf5_tree import INFLATION
from armonic.files.measured_file import Geometry, MeasuredFile
from armonic.files.measured_hdf5 import read_measured_hdf5, write_measured_hdf5
from armonic.frf_set import FrfSet
from armonic.series import Channel, TimeSeries
from measured_systems import KUKA

RANDOM = np.random.default_rng(5)
CHANNELS = (Channel("sensor.x", "force", "N"), Channel("sensor.z", "acceleration", "m/s²"))
LINES_HZ = np.arange(1, 101) * 0.25


def tap(seed: int, samples: int = 300) -> TimeSeries:
    values = np.random.default_rng(seed).normal(size=(samples, 2)) * [1e3, 1e-7]
    values[7, 1], values[8, 1] = np.nan, -np.inf
    return TimeSeries(values, 44100.1, CHANNELS, 0.2060000000000001, {"posture": "«ä» \ud800", "hit": str(seed)})


def frfs(**changes: Any) -> FrfSet:
    made = KUKA.frfs(LINES_HZ, noise=0.01, decay_rate=0.7)
    return replace(made, **({"notes": {"robot": "KUKA"}} | changes))


def full(path: Path) -> MeasuredFile:
    """A file of everything, and what it holds."""
    measured = np.array([[True, True, False], [True, False, True], [True, True, True]])
    shapes = RANDOM.normal(size=(2, 2)) + 1j * RANDOM.normal(size=(2, 2))
    held = MeasuredFile(
        str(path),
        (tap(1), tap(2, samples=200_000)),
        frfs(measured=measured),
        ModeTable(np.array([-1 + 60j, -2 + 70j]), shapes, ("sensor.x", "elbow.y")),
        Geometry(("sensor", "elbow"), RANDOM.normal(size=(2, 3)), ((0, 1),)),
    )
    write_measured_hdf5(path, records=held.records, frfs=held.frfs, modes=held.modes, geometry=held.geometry)
    return held


def same_record(a: TimeSeries, b: TimeSeries) -> None:
    assert (a.channels, a.sample_rate_hz, a.start_s, dict(a.notes)) == (
        b.channels, b.sample_rate_hz, b.start_s, dict(b.notes),
    )  # fmt: skip
    np.testing.assert_array_equal(a.values, b.values)


def same_frfs(a: FrfSet | None, b: FrfSet | None) -> None:
    assert a is not None
    assert b is not None
    for name in ("kind", "outputs", "inputs", "decay_rate", "notes"):
        assert getattr(a, name) == getattr(b, name), name
    for name in ("freq_hz", "values", "coherence", "averages", "measured"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


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
        assert json.loads(group["notes"][()]) == dict(held.records[1].notes)
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


# What others write.


def foreign(path: Path, **groups: dict[str, Any]) -> Path:
    """Groups of datasets; what begins with at_ is an attribute of its group."""
    with h5py.File(path, "w") as file:
        for name, content in groups.items():
            group = file.require_group("/" if name == "root" else name)
            for key, value in content.items():
                if key.startswith("at_"):
                    group.attrs[key[3:]] = value
                else:
                    group[key] = value
    return path


SAMPLES = RANDOM.normal(size=(40, 2))
TIMES = np.arange(40) / 256


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
        "frf": H.transpose(axes), "coherence": gamma2.transpose(axes), "freq": np.arange(1.0, 10), "at_kind": "mobility",
        "outputs": ["a.x", "b.y"], "inputs": ["x", "y", "z"],
    }  # fmt: skip
    read = read_measured_hdf5(foreign(tmp_path / "f.h5", data=content))
    assert read.frfs is not None
    assert (read.frfs.kind, read.frfs.outputs, read.frfs.inputs) == (
        "mobility", ("a.x", "b.y"), ("tip.x", "tip.y", "tip.z"),
    )  # fmt: skip
    np.testing.assert_array_equal(read.frfs.values, H)
    np.testing.assert_array_equal(read.frfs.coherence, gamma2)  # type: ignore[arg-type]


def matlab(path: Path, content: dict[str, Any]) -> Path:
    """A file as MATLAB's save(..., '-v7.3') makes it: 512 bytes ahead, arrays transposed, complex numbers in pairs."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            array = np.array(list(map(ord, value)), "u2")[None] if isinstance(value, str) else np.asarray(value)
            if array.dtype.kind == "c":
                pairs = np.empty(array.shape, [("real", "f8"), ("imag", "f8")])
                pairs["real"], pairs["imag"] = array.real, array.imag
                array = pairs
            data = file.create_dataset(name, data=array if isinstance(value, str) else array.T)
            data.attrs["MATLAB_class"] = np.bytes_("char" if isinstance(value, str) else "double")
        cell = file.create_dataset("cell", (1,), h5py.ref_dtype)
        cell[0] = file.create_dataset("#refs#/a", data=np.ones(9)).ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        empty = file.create_dataset("nothing", data=np.array([0, 3], "u8"))
        empty.attrs["MATLAB_empty"] = np.uint8(1)
    data_ = bytearray(path.read_bytes())
    data_[:128] = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    path.write_bytes(bytes(data_))
    return path


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


# What is left alone.


def test_links_and_data_elsewhere_are_left_with_a_reason_and_the_rest_is_read(tmp_path: Path) -> None:
    secret = np.full((40, 2), 7.0)
    foreign(tmp_path / "other.h5", root={"secret": secret})
    secret.tofile(tmp_path / "raw.bin")
    path = foreign(tmp_path / "f.h5", good={"t": TIMES, "y": SAMPLES})
    with h5py.File(path, "a") as file:
        file["outside"] = h5py.ExternalLink("other.h5", "/secret")
        file["alias"] = h5py.SoftLink("/good/y")
        virtual = h5py.VirtualLayout((40, 2), "f8")
        virtual[:] = h5py.VirtualSource(tmp_path / "other.h5", "secret", (40, 2))
        file.create_virtual_dataset("virtual", virtual)
        file.create_dataset("raw", (40, 2), "f8", external=[(str(tmp_path / "raw.bin"), 0, 640)])
        file["good/again"] = file["good"]
        file["pointer"] = np.array([file["good"].ref], h5py.ref_dtype)
    read = read_measured_hdf5(path)
    (record,) = read.records
    np.testing.assert_array_equal(record.values, SAMPLES)
    reasons = {item.what: item.reason for item in read.skipped}
    assert reasons.pop("pointer") == "data that are neither numbers nor text"
    assert reasons == {
        "outside": "an external link, which is not followed",
        "alias": "a link, which is not followed",
        "virtual": "a virtual dataset, whose data are in other files",
        "raw": "data stored in another file",
        "good/again": "a group that was met before",
    }


def test_a_filter_of_a_plugin_is_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "f.h5"
    with h5py.File(path, "w") as file:
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_chunk((40, 2))
        plan.set_filter(32015, h5py.h5z.FLAG_OPTIONAL, (3,))  # Zstandard, which is not there: stored as it is
        made = h5py.h5d.create(file.id, b"y", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((40, 2)), plan)
        h5py.Dataset(made)[...] = SAMPLES
        file["t"] = TIMES
    with pytest.raises(DataFileError, match=r"expected one matrix of samples|filter 32015"):
        read_measured_hdf5(path)


def test_a_dataset_is_measured_before_it_is_read(tmp_path: Path) -> None:
    path = foreign(tmp_path / "f.h5", good={"t": TIMES, "y": SAMPLES})
    with h5py.File(path, "a") as file:
        file.create_dataset("huge", (1 << 20, 1 << 10), "f8", chunks=(1 << 10, 1 << 10))
        file.create_dataset("empty", (4000,), "f8", chunks=(100,))
        sparse = file.create_dataset("some", (4000,), "f8", chunks=(100,))
        sparse[:200] = 1
        file.create_dataset("unwritten", (4000,), "f8")
        file.create_dataset("bomb", data=np.zeros(1 << 22, "u1"), chunks=(1 << 22,), compression=9)
    reasons = {item.what: item.reason for item in read_measured_hdf5(path).skipped}
    assert reasons.pop("huge") == "8.0 GB, more than 4"
    assert reasons.pop("empty") == "40 of 40 chunks missing"
    assert reasons.pop("some") == "38 of 40 chunks missing"
    assert reasons.pop("unwritten") == "0 bytes stored of 32000"
    assert INFLATION > 1032  # of deflate: what it can make of a byte
    assert set(reasons) <= {"bomb"}  # 4 MB of zeros are no bomb; that group has no record, which says so


def test_numbers_of_a_strange_format_are_not_converted(tmp_path: Path) -> None:
    path = foreign(tmp_path / "f.h5", good={"t": TIMES, "y": SAMPLES})
    with h5py.File(path, "a") as file:
        strange = h5py.h5t.IEEE_F64LE.copy()
        strange.set_ebias(1000)
        made = h5py.h5d.create(file.id, b"strange", strange, h5py.h5s.create_simple((5,)))
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ones(5))
        pairs = np.zeros(
            5, np.dtype({"names": ["r", "i"], "formats": ["f8", "f8"], "offsets": [0, 16], "itemsize": 24})
        )
        file["loose"] = pairs
    read = read_measured_hdf5(path)
    assert {item.what for item in read.skipped} == {"strange", "loose"}
    assert len(read.records) == 1


# Damage.


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "found an empty file"),
        (b"freq_hz,x/x re\n", "found a file of another kind"),
        (b"\x89HDF\r\n\x1a\n" + bytes(90), "found a damaged HDF5 file"),
    ],
)
def test_what_is_no_hdf5_file_says_so(tmp_path: Path, data: bytes, said: str) -> None:
    (tmp_path / "a.h5").write_bytes(data)
    with pytest.raises(DataFileError, match=said):
        read_measured_hdf5(tmp_path / "a.h5")
    with pytest.raises(DataFileError, match="found a directory"):
        read_measured_hdf5(tmp_path)
    with pytest.raises(DataFileError, match="found no file there"):
        read_measured_hdf5(tmp_path / "b.h5")
    foreign(tmp_path / "c.h5", root={"word": "hello"})
    with pytest.raises(DataFileError, match="found no array of numbers"):
        read_measured_hdf5(tmp_path / "c.h5")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.9999])
def test_a_truncated_file_is_refused(tmp_path: Path, share: float) -> None:
    full(tmp_path / "a.h5")
    data = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "a.h5").write_bytes(data[: int(share * len(data))])
    with pytest.raises(DataFileError, match=r"found a damaged HDF5 file .*expected a whole one. Copy it again"):
        read_measured_hdf5(tmp_path / "a.h5")


def test_one_damaged_record_is_left_and_the_others_are_read(tmp_path: Path) -> None:
    held = full(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        place = file["records/0001/values"].id.get_chunk_info(1).byte_offset
    data = bytearray((tmp_path / "a.h5").read_bytes())
    data[place + 1000] ^= 0xFF
    (tmp_path / "a.h5").write_bytes(bytes(data))
    again = read_measured_hdf5(tmp_path / "a.h5")
    (record,) = again.records
    same_record(record, held.records[0])
    same_frfs(again.frfs, held.frfs)
    (left,) = again.skipped
    assert left.what == "records/0001"
    assert "damaged" in left.reason


FUZZ = """
import random, sys
from pathlib import Path
from armonic.errors import DataFileError, ArmonicError
from armonic.files.measured_hdf5 import read_measured_hdf5
source, draft, seed, tries, most = Path(sys.argv[1]).read_bytes(), Path(sys.argv[2]), *map(int, sys.argv[3:])
generator, silent = random.Random(seed), 0
for _ in range(tries):
    damaged = bytearray(source)
    for _ in range(generator.randint(1, 4)):
        damaged[generator.randrange(most or len(damaged))] = generator.choice([0, 255, generator.randrange(256)])
    draft.write_bytes(bytes(damaged))
    try:
        silent += not read_measured_hdf5(draft).skipped
    except ArmonicError:
        pass
print(silent)
"""


def fuzzed(source: Path, draft: Path, tries: int, most: int = 0) -> int:
    """How many damaged copies of a file were read without a word; in a process of its own, which must come back."""
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", FUZZ, source, draft, "1", str(tries), str(most)],
        capture_output=True, text=True, check=False, timeout=120, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    return int(run.stdout)


def test_damaged_bytes_of_our_own_file_are_noticed_by_checksum(tmp_path: Path) -> None:
    write_measured_hdf5(tmp_path / "a.h5", records=(tap(1, 60), tap(2, 60)), frfs=frfs())
    # Gaps between objects, a third of so small a file, have no checksum and no meaning.
    assert fuzzed(tmp_path / "a.h5", tmp_path / "f.h5", 300) < 100


def test_damaged_bytes_of_a_foreign_file_never_bring_the_process_down(tmp_path: Path) -> None:
    hit = {"t": TIMES, "y": SAMPLES, "channels": ["sensor.x", "tip.z"], "at_units": ["N", "g"], "at_note": "hello"}
    H = np.ones((9, 1, 1), complex)
    data = {"H": H, "freq": np.arange(9.0), "outputs": ["a.x"], "inputs": ["a.x"], "at_kind": "mobility"}
    fuzzed(foreign(tmp_path / "f.h5", hit=hit, data=data), tmp_path / "d.h5", 400)


def test_a_text_that_claims_to_be_longer_than_it_is_is_not_asked_for(tmp_path: Path) -> None:
    path = foreign(tmp_path / "f.h5", root={"t": TIMES, "y": SAMPLES, "at_note": "hello"})
    assert sound_heaps(path)
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL").to_bytes(8, "little")
    data[data.index(heap) - 1] = 0xFF  # the top byte of its length: 4 GB
    path.write_bytes(bytes(data))
    assert not sound_heaps(path)
    read = read_measured_hdf5(path)
    assert [(item.what, item.reason) for item in read.skipped] == [("texts", "their heap is damaged")]
    assert len(read.records) == 1


def test_a_heap_that_leads_in_circles_is_noticed(tmp_path: Path) -> None:
    path = foreign(tmp_path / "f.h5", root={"t": TIMES, "y": SAMPLES, "at_note": "hello"})
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL")
    data[heap + 16 : heap + 32] = bytes(16)  # free space of no size, ahead of everything
    path.write_bytes(bytes(data))
    assert not sound_heaps(path)
    assert len(read_measured_hdf5(path).records) == 1
