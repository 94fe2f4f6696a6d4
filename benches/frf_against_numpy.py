"""FRF of the KUKA model, with all 18 sensitivities, against NumPy's batched solve of the FRF alone.

Both run in this process, in turn, on one thread; printed are medians and the ratio.

    python benches/frf_against_numpy.py
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads

import numpy as np

import armonic as am
from armonic import _core
from armonic.synthesis import system
from timing import interleaved

LINES_HZ = 0.2 * np.arange(1, 153)


def main() -> None:
    model = am.linearize(am.load("kuka_kr90"), "milling")
    core = system(model, "sensor")
    s = 2j * np.pi * LINES_HZ
    spring, damper = model.spring[None], model.damper[None]
    J = np.ascontiguousarray(model.jacobian("sensor")[:3])
    M, C, K = model.mass, model.damping, model.stiffness

    def by_numpy():
        Z = (s**2)[:, None, None] * M + s[:, None, None] * C + K
        return J @ np.linalg.solve(Z, np.broadcast_to(J.T, (len(s), *J.T.shape)))

    def alone():
        return _core.responses([core], spring, damper, s)[0]

    def with_sensitivities():
        return _core.responses([core], spring, damper, s, sensitivities=True)

    difference = np.abs(alone()[0] - by_numpy()).max() / np.abs(by_numpy()).max()
    times = interleaved(by_numpy, alone, with_sensitivities, rounds=60, inner=20)
    print(f"n = 9, {len(s)} lines, 3x3 responses, 18 parameters; largest relative difference {difference:.1e}")
    for name, seconds in zip(
        ("NumPy, FRF alone", "Armonic, FRF alone", "Armonic, FRF and sensitivities"), times, strict=True
    ):
        print(f"{name:32s} {seconds * 1e6:8.1f} µs   {times[0] / seconds:6.1f} times NumPy's speed")


if __name__ == "__main__":
    main()
