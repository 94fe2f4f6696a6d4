"""Poles of 60 model orders from nine frequency responses, against sdypy-EMA's LSCF on the same ones.

Data: 3x3 accelerances of the KUKA's four modes, 2 000 lines up to 30 Hz, 1 % noise. sdypy-EMA fits one scalar
denominator of order 2, 4 … 120 to all nine; so does Armonic's common denominator. Its polyreference fits denominator
matrices of order 1 … 60 to three references, which have 3, 6 … 180 poles. Armonic's times include mode shapes in the
band; selection is `stabilize` and `select_modes`. All in one process, in turn, on one thread; ratios are of medians.

    python benches/lscf_against_sdypy.py [ROUNDS]
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before NumPy loads its threads

import numpy as np
from sdypy import EMA

from armonic.frf_set import FrfSet
from armonic.identification.clustering import select_modes
from armonic.identification.complex_exponential import complex_exponential
from armonic.identification.polyreference import polyreference_lscf
from armonic.identification.stabilization import stabilize
from timing import interleaved

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from measured_systems import KUKA, LINES_HZ

ORDERS = 60


def sdypy(frfs: FrfSet) -> EMA.Model:
    """The model with its poles; it drops the last line that it is given, so one more is."""
    zero = np.zeros((1, 9), complex)
    values = np.vstack([zero, frfs.values.reshape(-1, 9), zero])
    freq = np.append(0.0, np.append(frfs.freq_hz, frfs.freq_hz[-1] + frfs.freq_hz[0]))
    model = EMA.Model(values.T, freq, lower=0, upper=freq[-1], pol_order_high=ORDERS, frf_form="accelerance")
    model.get_poles(method="lscf", show_progress=False)
    return model


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    frfs = KUKA.frfs(LINES_HZ, noise=0.01, seed=0)

    def common():
        return polyreference_lscf(frfs, orders=range(2, 2 * ORDERS + 1, 2), references="none")

    def polyreference():
        return polyreference_lscf(frfs, orders=(1, ORDERS))

    def selected():
        return select_modes(stabilize(polyreference()))

    def exponential():
        return select_modes(stabilize(complex_exponential(frfs, orders=(1, ORDERS))))

    tasks = {
        "sdypy-EMA LSCF, poles": (lambda: sdypy(frfs), "common denominator, 2 to 120"),
        "Armonic pLSCF, poles and shapes": (common, "common denominator, 2 to 120"),
        "Armonic pLSCF, poles and shapes ": (polyreference, "3 references, 3 to 180"),
        "Armonic pLSCF, with selection": (selected, "3 references, 3 to 180"),
        "Armonic LSCE, with selection": (exponential, "3 references, 3 to 180"),
    }
    times = interleaved(*(task for task, _ in tasks.values()), rounds=rounds)
    print(f"{len(LINES_HZ)} lines, 3x3 responses, {ORDERS} orders, medians of {rounds} rounds")
    for (name, (_, what)), seconds in zip(tasks.items(), times, strict=True):
        print(f"{name:34s}{what:31s}{seconds:8.3f} s{times[0] / seconds:8.1f} times")
    for mode in selected().modes:
        print(mode)


if __name__ == "__main__":
    main()
