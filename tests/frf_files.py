"""Measurement files of a known response, written by pyuff and by hand; used by the tests of files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyuff
from numpy.typing import NDArray

from armonic.response import Frf

EVEN_HZ = np.linspace(2.0, 40.0, 77)  # steps of 0.5 Hz, exact in every format
UNEVEN_HZ = np.geomspace(2.0, 40.0, 77)
TYPES = {"receptance": 8, "mobility": 11, "accelerance": 12}

# Digits that survive: %13.5e keeps 6, %20.11e (pyuff) 12, %20.12e (ours) 13, binary single 24 bits.
SINGLE_TEXT, DOUBLE_TEXT, OUR_TEXT, SINGLE_BINARY = 6e-6, 6e-12, 6e-13, 6e-8

Dof = tuple[int, int]


def oscillator(dof: Dof, freq_hz: NDArray[np.float64] = EVEN_HZ) -> NDArray[np.complex128]:
    """Accelerance of two masses between springs (a closed 2x2 inverse) by signed direction; not symmetric."""
    w = 2 * np.pi * freq_hz
    s = 1j * w
    a, b, c = 8e4 + 40 * s - 3 * w**2, -3e4 - 10 * s, 5e4 + 25 * s - 2 * w**2
    adjugate = {(1, 1): c, (1, 2): -b, (2, 1): -b, (2, 2): a}
    output, force = abs(dof[0]), abs(dof[1])
    entry = adjugate[1 + output % 2, 1 + force % 2] * (1 + 0.1 * output + 0.01 * force) / (a * c - b * b)
    return np.asarray(np.sign(dof[0]) * np.sign(dof[1]) * -(w**2) * entry)


def by_pyuff(
    path: Path,
    dofs: list[Dof],
    *,
    freq_hz: NDArray[np.float64] = EVEN_HZ,
    even: bool = True,
    binary: bool = False,
    double: bool = True,
    types: tuple[int, int] = (12, 13),
    first: tuple[dict[str, Any], ...] = (),
    **fields: Any,
) -> Path:
    """A universal file from the other library's writer; `fields` override those of every function."""
    sets = list(first)
    for dof in dofs:
        function = pyuff.prepare_58(
            binary=int(binary),
            func_type=4,
            rsp_node=7,
            rsp_dir=dof[0],
            ref_node=7,
            ref_dir=dof[1],
            data=oscillator(dof, freq_hz),
            x=freq_hz,
            id1="hammer test",
            rsp_ent_name="TCP",
            ref_ent_name="TCP",
            abscissa_spacing=int(even),
            abscissa_spec_data_type=18,
            ordinate_spec_data_type=types[0],
            orddenom_spec_data_type=types[1],
        )
        sets.append(function | {"ord_data_type": 6 if double else 5} | fields)
    return write_sets(path, sets, force_double=double)


def write_sets(path: Path, sets: list[dict[str, Any]], *, force_double: bool = True) -> Path:
    path.unlink(missing_ok=True)  # "overwrite" of pyuff loses the header of binary sets
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff leaves binary files to the garbage collector
        pyuff.UFF(str(path)).write_sets(sets, force_double=force_double)
    return path


def units(length: float, force: float, code: int = 9) -> dict[str, Any]:
    return {
        "type": 164,
        "units_code": code,
        "length": length,
        "force": force,
        "temp": 1.0,
        "temp_offset": 0.0,
    }


def by_hand(
    dof: Dof = (1, 1),
    *,
    data: bytes | None = None,
    freq_hz: NDArray[np.float64] = EVEN_HZ,
    storage: int = 6,
    even: bool = True,
    binary: str = "",
    count: int | None = None,
    end: str = "\n",
    edit: dict[int, str] | None = None,
) -> bytes:
    """One data set 58 written out by the columns of the format; `edit` replaces header lines (1 to 11)."""
    values = oscillator(dof, freq_hz)
    count = freq_hz.size if count is None else count
    if data is None:
        data = "".join(f"{v.real:20.12E}{v.imag:20.12E}{end}" for v in values).encode()
    start, step = (freq_hz[0], freq_hz[1] - freq_hz[0]) if even else (0.0, 0.0)
    none = f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {'NONE':20}"
    header = [
        *("NONE",) * 5,
        f"{4:5d}{0:10d}{0:5d}{0:10d} {'NONE':10}{7:10d}{dof[0]:4d} {'NONE':10}{7:10d}{dof[1]:4d}",
        f"{storage:10d}{count:10d}{even:10d}{start:13.5E}{step:13.5E}{0.0:13.5E}",
        *(f"{number:10d}{none[10:]}" for number in (18, 12, 13)),
        none,
    ]
    for number, text in (edit or {}).items():
        header[number - 1] = text
    head = end.join(["    -1", f"    58{binary}", *header, ""]).encode("latin-1")
    return head + data + f"    -1{end}".encode()


def binary_id(size: int, order: int = 1, floats: int = 2, lines: int = 11) -> str:
    return f"b{order:6d}{floats:6d}{lines:12d}{size:12d}{0:6d}{0:6d}{0:12d}{0:12d}"


def binary_by_hand(item: str, *, freq_hz: NDArray[np.float64] = EVEN_HZ, even: bool = True, x: str = "") -> bytes:
    values = oscillator((1, 1), freq_hz)
    layout = ([] if even else [("x", x or item)]) + [("re", item), ("im", item)]
    rows = np.zeros(freq_hz.size, dtype=layout)
    rows["re"], rows["im"] = values.real, values.imag
    if not even:
        rows["x"] = freq_hz
    data = rows.tobytes()
    order = 1 if item[0] == "<" else 2
    storage = 5 if item[1] == "4" or item[2] == "4" else 6
    return by_hand(
        data=data, freq_hz=freq_hz, storage=storage, even=even, binary=binary_id(len(data), order), dof=(1, 1)
    )


def save(path: Path, *sets: bytes) -> Path:
    path.write_bytes(b"".join(sets))
    return path


def measured(freq_hz: NDArray[np.float64] = EVEN_HZ, frame: str | None = "sensor") -> Frf:
    """Three outputs and two inputs, in an order that is not the alphabet's."""
    outputs, inputs = ("x", "y", "z"), ("x", "z")
    code = {"x": 1, "y": 2, "z": 3}
    values = np.array([[oscillator((code[o], code[i]), freq_hz) for i in inputs] for o in outputs])
    return Frf(freq_hz, np.moveaxis(values, 2, 0), "accelerance", outputs, inputs, frame)


def assert_same(a: Frf, b: Frf, tolerance: float, *, freq_tolerance: float = 1e-9) -> None:
    assert (a.kind, a.outputs, a.inputs, a.frame) == (b.kind, b.outputs, b.inputs, b.frame)
    np.testing.assert_allclose(a.freq_hz, b.freq_hz, rtol=freq_tolerance, atol=0)
    # Per part, since a small imaginary part keeps its own digits.
    np.testing.assert_allclose(a.values.real, b.values.real, rtol=tolerance, atol=0)
    np.testing.assert_allclose(a.values.imag, b.values.imag, rtol=tolerance, atol=0)


BINARY = binary_by_hand("<f8")

TABLE = """\
# armonic frf kind=receptance frame=tool tip
# measured on a Monday
freq_hz,x/y re,x/y im,z/y re,z/y im
1.5,1,-2e-3,.5,+4
2,0.25,0,-1.,1E2
"""
