"""Universal files of other programs, by pyuff's writer: records, frequency responses, coherences, modes and points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyuff
from numpy.typing import NDArray

from frf_files import write_sets

RATE, SAMPLES = 512.0, 128
TIME = np.arange(SAMPLES) / RATE
EVEN_HZ = 0.5 * np.arange(1, 65)
UNEVEN_HZ = np.round(np.geomspace(0.5, 32.0, 64), 3)  # five digits, as E13.5 keeps them
NAN = 8.75e88
ACCELERATION, FORCE = (12, "m/s^2"), (13, "N")


def wave(node: int, direction: int, kind: int, hit: int = 0) -> NDArray[np.float64]:
    """A signal that tells where it is from; along a negative direction it has the other sign."""
    return np.sign(direction) * np.sin(2 * np.pi * (node + 3 * abs(direction) + hit) * TIME + kind)


def record(
    node: int, direction: int, what: tuple[int, str] = ACCELERATION, *, hit: int = 0, **fields: Any
) -> dict[str, Any]:
    """A time response as pyuff takes it."""
    data = fields.pop("data", wave(node, direction, what[0], hit))
    return pyuff.prepare_58(
        binary=fields.pop("binary", 0), func_type=1, rsp_node=node, rsp_dir=direction, ref_node=0, ref_dir=0,
        data=data, x=fields.pop("x", TIME),
        id1="record", rsp_ent_name="NONE", abscissa_spec_data_type=17, ordinate_spec_data_type=what[0],
        orddenom_spec_data_type=0, abscissa_spacing=1, ordinate_axis_units_lab=what[1] or "NONE",
        abscissa_axis_units_lab="s",
    ) | {"ord_data_type": 4} | fields  # fmt: skip


def tap(hit: int = 0, **fields: Any) -> list[dict[str, Any]]:
    """A hit at node 1 along x, and what nodes 1 and 2 did."""
    what = ((1, 1, FORCE), (1, 1, ACCELERATION), (2, -3, ACCELERATION))
    return [record(node, code, kind, hit=hit, **fields) for node, code, kind in what]


def response(freq_hz: NDArray[np.float64], output: int, force: int, kind: int = 12) -> NDArray[np.complex128]:
    """Of an oscillator of 12 Hz, in closed form; a negative direction turns its sign."""
    s = 2j * np.pi * freq_hz
    power = {8: 0, 11: 1, 12: 2}[kind]
    H = (1 + 0.1 * abs(output) + 0.01 * abs(force)) * s**power / (s**2 + 3 * s + (2 * np.pi * 12) ** 2)
    return np.asarray(np.sign(output) * np.sign(force) * H)


def coherence(freq_hz: NDArray[np.float64], output: int, force: int) -> NDArray[np.float64]:
    return 1 - 0.01 * abs(output) - 0.001 * abs(force) - freq_hz / 1000


def frf(
    output: tuple[int, int],
    force: tuple[int, int],
    freq_hz: NDArray[np.float64] = EVEN_HZ,
    *,
    types: tuple[int, int] = (12, 13),
    units: tuple[str, str] = ("m/s^2", "N"),
    even: bool = True,
    **fields: Any,
) -> dict[str, Any]:
    """A frequency response as pyuff takes it."""
    data = fields.pop("data", response(freq_hz, output[1], force[1], types[0]))
    return pyuff.prepare_58(
        binary=fields.pop("binary", 0), func_type=4, rsp_node=output[0], rsp_dir=output[1], ref_node=force[0],
        ref_dir=force[1], data=data, x=freq_hz,
        id1="frf", rsp_ent_name="NONE", ref_ent_name="NONE", abscissa_spacing=int(even), abscissa_spec_data_type=18,
        ordinate_spec_data_type=types[0], orddenom_spec_data_type=types[1], ordinate_axis_units_lab=units[0],
        orddenom_axis_units_lab=units[1],
    ) | {"ord_data_type": 6} | fields  # fmt: skip


def gamma(
    output: tuple[int, int], force: tuple[int, int], freq_hz: NDArray[np.float64] = EVEN_HZ, **fields: Any
) -> dict[str, Any]:
    """A coherence as pyuff takes it."""
    data = fields.pop("data", coherence(freq_hz, output[1], force[1]))
    return frf(output, force, freq_hz, types=(8, 0), units=("NONE", "NONE"), data=data, **fields) | {
        "func_type": 6, "ordinate_spec_data_type": 0, "ord_data_type": fields.get("ord_data_type", 4),
    }  # fmt: skip


def save(path: Path, *sets: dict[str, Any], double: bool = True) -> Path:
    """The data sets as a file; `NAN` in text becomes NaN, of which pyuff makes zeros."""
    write_sets(path, list(sets), force_double=double)
    path.write_bytes(path.read_bytes().replace(b" 8.75000000000e+88", b"NaN".rjust(18)))
    return path
