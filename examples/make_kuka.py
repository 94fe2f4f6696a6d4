"""Makes the example measurement of the KUKA KR90 and keeps the true values beside it.

    python examples/make_kuka.py [folder]

The accelerance matrix at the sensor, synthesized from the catalog's kuka_kr90 (Huynh et al. 2021, Table 5,
column "From [34]"), with 1 % noise. The same files come out byte for byte on every machine.
"""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import armonic as am
from armonic import catalog, examples
from armonic.files import write_uff

SEED = 2021
NOISE = 0.01
"""Standard deviation of the relative error's real and imaginary part: 1 % in size, 0.01 rad in phase."""
DIGITS = 7
"""Kept of every number: more than the noise leaves, and few enough that processors agree on all of them."""


def make(folder: Path) -> None:
    """Write kuka_milling.uff and kuka_true.yaml into a folder."""
    freq_hz = np.arange(1, 151) / 5
    H = am.frf(am.load("kuka_kr90"), "milling", freq_hz, frame="sensor")
    real, imaginary = np.random.default_rng(SEED).standard_normal((2, *H.values.shape))
    noisy = H.values * (1 + NOISE * (real + 1j * imaginary))
    rounded = [np.array([float(f"{x:.{DIGITS - 1}e}") for x in part.flat]) for part in (noisy.real, noisy.imag)]
    values = (rounded[0] + 1j * rounded[1]).reshape(noisy.shape)

    path = folder / examples.MEASURED
    write_uff(path, replace(H, values=values), name="KUKA KR90 with 1 % noise")
    # The writer notes when it wrote; here that would only be a difference.
    path.write_bytes(re.sub(rb"\d\d-[A-Z][a-z]{2}-\d\d \d\d:\d\d:\d\d", b"01-Jan-21 00:00:00", path.read_bytes()))
    (folder / examples.TRUE).write_bytes(catalog.read("kuka_kr90").encode())


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(examples.__file__).parent)
