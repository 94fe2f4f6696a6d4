"""A universal file of 200 MB read in bounded memory, beside pyuff in the same run: records in binary and in text, FRFs.

Each reading is a process of its own. Memory is the peak of the process less what it had before and less the arrays that
are returned; for pyuff, which returns dictionaries, the arrays in them. `--megabytes` takes another size.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np

from armonic.files.measured_uff import read_measured_uff
from armonic.files.measured_uff_writer import write_measured_uff
from armonic.frf_set import FrfSet
from armonic.series import Channel, TimeSeries

SAMPLES, SENSORS, LINES = 65536, 3, 4000


def write(folder: Path, kind: str, megabytes: float) -> Path:
    """Records of a tap test, a force and three responses each, or FRFs of many points; written in parts."""
    path, part = folder / f"{kind}.uff", folder / "part.uff"
    rng = np.random.default_rng(1)
    number = 0
    with path.open("wb") as whole:
        while whole.tell() < megabytes * 1e6:
            number += 1
            if kind == "frfs":
                shape = (LINES, SENSORS, 3)
                values = rng.normal(size=shape) + 1j * rng.normal(size=shape)
                outputs = [f"{number}.{axis}" for axis in "xyz"]
                frfs = FrfSet(np.arange(1, LINES + 1) / 8, values, "accelerance", outputs, ["1.x", "1.y", "1.z"])
                write_measured_uff(part, frfs=frfs)
            else:
                responses = [Channel(f"sensor.{axis}", "acceleration", "m/s²") for axis in "xyz"]
                channels = (Channel("sensor.x", "force", "N"), *responses)
                record = TimeSeries(rng.normal(size=(SAMPLES, len(channels))), 4096.0, channels)
                write_measured_uff(part, records=[record], binary=kind == "binary", double=True)
            whole.write(part.read_bytes())
    part.unlink()
    return path


def measure(reader: str, path: str) -> None:
    """Read a file, and print what it took as JSON."""
    told = 0

    def progress(share: float) -> None:
        nonlocal told
        told += 1

    if reader == "pyuff":
        import pyuff
    before = _memory("VmRSS")
    began = time.perf_counter()
    if reader == "pyuff":
        sets = pyuff.UFF(path).read_sets()
        took = time.perf_counter() - began
        arrays = sum(v.nbytes for s in sets for v in s.values() if isinstance(v, np.ndarray))
    else:
        found = read_measured_uff(path, progress=progress)
        took = time.perf_counter() - began
        assert not found.skipped
        arrays = sum(record.values.nbytes for record in found.records)
        arrays += found.frfs.values.nbytes if found.frfs is not None else 0
    extra = _memory("VmHWM") - before - arrays / 1e6
    print(json.dumps({"seconds": took, "extra": extra, "arrays": arrays / 1e6, "told": told}))


def _memory(name: str) -> float:
    """MB of this process, now (VmRSS) or at most (VmHWM); Linux only, for ru_maxrss counts the parent's as well."""
    status = Path("/proc/self/status").read_text()
    return float(status.split(f"{name}:")[1].split()[0]) * 1024 / 1e6


def run(reader: str, path: Path) -> dict[str, float]:
    """Measure in a process of its own."""
    command = [sys.executable, __file__, "--measure", reader, str(path)]
    found: dict[str, float] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=200.0)
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--kinds", nargs="+", default=["binary", "text", "frfs"])
    arguments = parser.parse_args()
    if arguments.measure:
        measure(*arguments.measure)
        return
    for kind in arguments.kinds:
        with tempfile.TemporaryDirectory() as folder:
            path = write(Path(folder), kind, arguments.megabytes)
            size = path.stat().st_size / 1e6
            own, other = run("armonic", path), run("pyuff", path)
        for name, found in (("armonic", own), ("pyuff", other)):
            print(
                f"{kind:7} {size:4.0f} MB  {name:8} {found['seconds']:6.2f} s  {size / found['seconds']:6.0f} MB/s"
                f"  arrays {found['arrays']:5.0f} MB, beyond them {found['extra']:5.0f} MB"
                + (f", progress told {found['told']:.0f} times" if name == "armonic" else "")
            )
        print(f"{'':17}{other['seconds'] / own['seconds']:.1f} times as fast")


if __name__ == "__main__":
    main()
