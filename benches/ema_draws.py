"""Known systems under 1 % of noise, a hundred draws through the whole analysis: modes found, false ones, errors."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from armonic.identification.ema import ema
from measured_systems import BAND, BATTERY, LINES_HZ, OUT_OF_BAND

NEAR = 0.01
"""A pole within this share of a true one is that mode."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100)
    draws = parser.parse_args().draws
    print(f"{draws} draws, 2000 lines of nine responses, noise of 1 % of the RMS of each")
    print(
        f"{'system':12s} {'method':6s} {'all found':>9s} {'false':>6s} {'worst df':>10s} {'worst dz of its value':>22s}"
    )
    for name, system in BATTERY.items():
        true = system.seen_poles
        for method in ("plscf", "lsce"):
            complete = false = 0
            worst = np.zeros(2)
            for seed in range(draws):
                frfs = system.frfs(LINES_HZ, noise=0.01, seed=seed)
                found = ema(frfs, method=method, band_hz=BAND if system is OUT_OF_BAND else None).poles
                apart = np.abs(found[:, None] / true - 1)
                hit = apart.min(axis=0) < NEAR
                complete += bool(hit.all())
                false += int((apart.min(axis=1) >= NEAR).sum())
                best = found[apart.argmin(axis=0)][hit]
                freq = np.abs(np.abs(best) / np.abs(true[hit]) - 1)
                ratio = (-best.real / np.abs(best)) / (-true[hit].real / np.abs(true[hit]))
                worst = np.maximum(worst, [freq.max(), np.abs(ratio - 1).max()])
            print(
                f"{name:12s} {method:6s} {complete:9d} {false:6d} {100 * worst[0]:9.4f}% {100 * worst[1]:21.2f}%",
                flush=True,
            )


if __name__ == "__main__":
    main()
