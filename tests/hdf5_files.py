"""HDF5 files of known content, ours and of others; used by the tests of such files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from armonic.comparison import ModeTable
from armonic.files.measured_file import Geometry, MeasuredFile
from armonic.files.measured_hdf5 import write_measured_hdf5
from armonic.frf_set import FrfSet
from armonic.series import Channel, TimeSeries
from measured_systems import KUKA

RANDOM = np.random.default_rng(5)
SAMPLES = RANDOM.normal(size=(40, 2))
TIMES = np.arange(40) / 256
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
