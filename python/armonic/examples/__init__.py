"""The example that ships: measured FRFs of the KUKA KR90, the robot file of the start, and the true values.

The measurement is synthetic: `examples/make_kuka.py` in the repository makes it from the catalog's kuka_kr90.
"""

from __future__ import annotations

from importlib.resources import files

MEASURED = "kuka_milling.uff"
"""3x3 accelerance at `sensor` in posture `milling`, 0.2 to 30 Hz, with noise."""
START = "kuka_start.yaml"
"""The robot before the fit, with bounds."""
TRUE = "kuka_true.yaml"
"""The robot that the measurement was synthesized from."""

TAPS = "taps.uff"
"""Time records of fifteen taps at `sensor` of the simulated catalog robot, a double hit and an overload among them;
`examples/make_taps.py` in the repository makes it."""


def read(name: str) -> bytes:
    """The content of an example file.

    Args:
        name: `MEASURED`, `START`, `TRUE` or `TAPS`.

    Raises:
        KeyError: there is no such example.
    """
    if name not in (MEASURED, START, TRUE, TAPS):
        raise KeyError(name)
    return files(__name__).joinpath(name).read_bytes()
