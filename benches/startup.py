"""What Armonic adds to the start of a process: whole processes, run in turn.

python benches/startup.py [rounds]
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from timing import interleaved

COMMANDS = {
    "import numpy": [sys.executable, "-c", "import numpy"],
    "import armonic": [sys.executable, "-c", "import armonic"],
    "load a robot": [sys.executable, "-c", "import armonic; armonic.load('kuka_kr90')"],
    "armonic modes": [str(Path(sys.executable).parent / "armonic"), "modes", "kuka_kr90", "--posture", "milling"],
}


def process(command: list[str]) -> Callable[[], object]:
    return lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    times = interleaved(*map(process, COMMANDS.values()), rounds=rounds)
    print(f"whole processes, medians of {rounds}")
    for name, seconds in zip(COMMANDS, times, strict=True):
        print(f"{name:16s} {seconds:7.3f} s  {seconds - times[0]:+7.3f} s to NumPy")


if __name__ == "__main__":
    main()
