"""Nothing in an HDF5 file is followed or trusted: links, sizes, formats, heaps; damage is told or found by checksum."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from armonic.errors import DataFileError
from armonic.files.hdf5_heap import sound_heaps
from armonic.files.measured_hdf5 import read_measured_hdf5, write_measured_hdf5
from hdf5_files import SAMPLES, TIMES, foreign, frfs, full, same_frfs, same_record, tap


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
        bomb = file.create_dataset("bomb", (1 << 20,), "f8", chunks=(1 << 20,), compression=9)
        bomb.id.write_direct_chunk((0,), b"0123456789")
    reasons = {item.what: item.reason for item in read_measured_hdf5(path).skipped}
    assert reasons.pop("huge") == "8.0 GB, more than 4"
    assert reasons.pop("empty") == "40 of 40 chunks missing"
    assert reasons.pop("some") == "38 of 40 chunks missing"
    assert reasons.pop("unwritten") == "0 bytes stored of 32000"
    assert reasons == {"bomb": "10 bytes that unpack to 8388608"}  # deflate makes 1032 of one at most


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
from armonic.errors import ArmonicError
from armonic.files.measured_hdf5 import read_measured_hdf5

def content(path):
    read = read_measured_hdf5(path)
    found = {f"record {k}": (r.values.tobytes(), r.channels, r.sample_rate_hz, r.start_s, dict(r.notes))
             for k, r in enumerate(read.records)}
    if read.frfs is not None:
        f = read.frfs
        found["frfs"] = (f.values.tobytes(), f.freq_hz.tobytes(), f.coherence is None or f.coherence.tobytes(),
                         f.kind, f.outputs, f.inputs, f.decay_rate)
    return found, bool(read.skipped)

whole, draft, tries = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
source, generator = whole.read_bytes(), random.Random(1)
held, counts = content(whole)[0], {"as it was": 0, "left out": 0, "refused": 0, "wrong": 0}
for _ in range(tries):
    damaged = bytearray(source)
    for _ in range(generator.randint(1, 4)):
        damaged[generator.randrange(len(damaged))] = generator.choice([0, 255, generator.randrange(256)])
    draft.write_bytes(bytes(damaged))
    try:
        found, skipped = content(draft)
    except ArmonicError:
        counts["refused"] += 1
        continue
    right = [value for value in found.values() if value in held.values()]  # a lost record moves the next one up
    counts["wrong" if len(right) < len(found) else "left out" if skipped else "as it was"] += 1
print(*counts.values())
"""


def fuzzed(source: Path, draft: Path, tries: int) -> list[int]:
    """How many damaged copies were read as they were, in part, not at all, or wrong; by a process that must return."""
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", FUZZ, source, draft, str(tries)],
        capture_output=True, text=True, check=False, timeout=120, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    return [int(word) for word in run.stdout.split()]


def test_damaged_bytes_of_our_own_file_are_noticed_and_never_read_as_numbers(tmp_path: Path) -> None:
    write_measured_hdf5(tmp_path / "a.h5", records=(tap(1, 60), tap(2, 60)), frfs=frfs())
    _, left_out, refused, wrong = fuzzed(tmp_path / "a.h5", tmp_path / "f.h5", 250)
    assert wrong == 0
    assert left_out + refused > 200  # nearly every byte is under a checksum


def test_damaged_bytes_of_a_foreign_file_never_bring_the_process_down(tmp_path: Path) -> None:
    hit = {"t": TIMES, "y": SAMPLES, "channels": ["sensor.x", "tip.z"], "at_units": ["N", "g"], "at_note": "hello"}
    H = np.ones((9, 1, 1), complex)
    data = {"H": H, "freq": np.arange(9.0), "outputs": ["a.x"], "inputs": ["a.x"], "at_kind": "mobility"}
    assert sum(fuzzed(foreign(tmp_path / "f.h5", hit=hit, data=data), tmp_path / "d.h5", 300)) == 300


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
