"""Makes the example records of a tap test on the KUKA KR90.

    python examples/make_taps.py [folder]

Fifteen hits of a soft hammer at the sensor, five along each axis, on the catalog's kuka_kr90 (Huynh et al. 2021,
Table 5, column "From [34]") with joints that soften a little; one hit rebounds and one is too hard.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import armonic as am
from armonic import examples
from armonic.files.measured_uff_writer import write_measured_uff
from armonic.simulation.tap_test import TapTest, tap_test

NAME = "taps.uff"
SEED = 1
SOFTENING = 0.008
"""Modes come out lower by 0.2 % at most, and coherence falls to 0.94 at resonances."""
BITS = 16
"""Of the converter: steps so wide that processors agree on the samples."""


def rehearse() -> TapTest:
    """The campaign: 8 s at 512 Hz per hit, a resolution of 0.125 Hz."""
    return tap_test(
        am.load("kuka_kr90"),
        "milling",
        hits=5,
        force_n=200.0,
        pulse_s=0.01,
        softening=SOFTENING,
        double_hits=1,
        overloads=1,
        sample_rate_hz=512.0,
        record_s=8.0,
        noise=1e-3,
        bits=BITS,
        seed=SEED,
    )


def make(folder: Path) -> None:
    """Write taps.uff into a folder."""
    test = rehearse()
    path = folder / NAME
    write_measured_uff(path, records=test.records, geometry=test.geometry, title="Tap test of a KUKA KR90")
    # The writer notes when it wrote; here that would only be a difference.
    path.write_bytes(re.sub(rb"\d\d-[A-Z][a-z]{2}-\d\d \d\d:\d\d:\d\d", b"01-Jan-21 00:00:00", path.read_bytes()))


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(examples.__file__).parent)
