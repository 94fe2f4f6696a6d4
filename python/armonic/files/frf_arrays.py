"""Which of the named arrays of a file are frequency responses, and what is left of them where they hold no numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armonic.errors import DataFileError, FrfError
from armonic.files.cells import AXES
from armonic.files.measured_file import Skipped
from armonic.files.named_arrays import Stored, listing, vector
from armonic.files.uff_reader import shown
from armonic.frf_set import FrfSet
from armonic.response import KINDS, Kind

LINES = ("freq_hz", "freq", "frequency", "frequencies", "frequency_hz", "freqs", "f", "f_hz", "hz")
"""What frequencies are called."""
COHERENCES = ("coherence", "coh", "gamma2", "gamma_2", "g2")
"""What a coherence is called."""
_MOST_GONE = 0.5
"""A response with more lines than this share not finite is left out; otherwise the lines are, for all."""


class Found(NamedTuple):
    """Frequency responses, with what was left out of them and what should be known."""

    frfs: FrfSet
    skipped: tuple[Skipped, ...]
    remarks: tuple[str, ...]


def holds_frfs(arrays: Mapping[str, Stored], variable: str | None = None) -> bool:
    """Whether complex numbers are among some arrays, or are what is asked for."""
    asked = [arrays[variable]] if variable in arrays and variable is not None else list(arrays.values())
    return any(a.kind == "c" and a.size > 1 for a in asked)


def found_frfs(
    path: str | Path,
    arrays: Mapping[str, Stored],
    *,
    texts: Mapping[str, Sequence[str]],
    variable: str | None = None,
    freq_variable: str | None = None,
    kind: str | None = None,
    outputs: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
) -> Found:
    """The frequency responses among some arrays: complex (lines, outputs, inputs) or (outputs, inputs, lines).

    A matrix (lines, n) holds n responses to one force, or one response to n if `outputs` is one. A real array of the
    same shape that is called coherence is taken along.

    Args:
        path: the file, for errors.
        arrays: by name.
        texts: by name; `kind`, `outputs` and `inputs` are looked for.
        variable: the complex array, where there are several.
        freq_variable: the frequencies in Hz, where they are called otherwise than freq_hz, freq or f.
        kind: what is divided by the force, if the file does not say.
        outputs: degrees of freedom of the responses, PLACE.AXIS or an axis at the tip, if the file does not say.
        inputs: those of the forces.

    Raises:
        DataFileError: the arrays do not say which of them hold what, or hold no responses.
    """
    name = _complex(path, arrays, variable)
    real = {n: a for n, a in arrays.items() if a.kind in "fiu" and a.size}
    lines_name = vector(path, real, freq_variable, LINES, "freq_variable")
    if lines_name is None:
        hint = "Name the frequencies in Hz with freq_variable=."
        found = f"{name} and no frequencies ({listing(arrays)})"
        raise DataFileError(str(path), found=found, expected="a vector freq_hz", hint=hint)
    freq_hz = real[lines_name].numbers().ravel()
    said = (_labels(texts, "outputs", outputs), _labels(texts, "inputs", inputs))
    values = _cube(path, name, np.asarray(arrays[name].read(), np.complex128), freq_hz.size, said)
    remarks: list[str] = []
    responses, forces = _dofs(path, name, values.shape[1:], said, remarks)
    coherence = next((a for n, a in real.items() if n.lower() in COHERENCES and a.shape == arrays[name].shape), None)
    gamma2 = None
    if coherence is None:
        remarks.append(f"{path} has no coherence.")
    else:
        gamma2 = _cube(path, "coherence", coherence.numbers(), freq_hz.size, said)
    chosen = kind or next((t[0] for n in ("kind", "frf_kind") if (t := texts.get(n))), None)
    if chosen not in KINDS:
        found = "no word on what was measured" if chosen is None else f"the kind {shown(str(chosen))}"
        raise DataFileError(str(path), found=found, expected=f"kind= as one of {', '.join(KINDS)}")
    return finite_frfs(path, freq_hz, values, chosen, responses, forces, gamma2, remarks)


def finite_frfs(
    path: str | Path,
    freq_hz: NDArray[np.float64],
    values: NDArray[Any],
    kind: Kind,
    outputs: tuple[str, ...],
    inputs: tuple[str, ...],
    coherence: NDArray[np.float64] | None,
    remarks: Sequence[str] = (),
) -> Found:
    """A set of responses, without lines and pairs that hold no numbers.

    Args:
        path: the file, for errors.
        freq_hz: (L,) Hz.
        values: (L, outputs, inputs), perhaps not all finite.
        kind: of all.
        outputs: degrees of freedom of the responses.
        inputs: those of the forces.
        coherence: of the same shape, or None.
        remarks: what is known already.

    Raises:
        DataFileError: nothing is left, or the arrays make no set.
    """
    good = np.isfinite(values) if coherence is None else np.isfinite(values) & np.isfinite(coherence)
    measured = good.mean(axis=0) >= _MOST_GONE
    skipped = tuple(
        Skipped(0, 0, f"response {outputs[i]} to {inputs[j]}", f"{int((~good[:, i, j]).sum())} lines are not finite")
        for i, j in np.argwhere(~measured)
    )
    if not measured.any():
        raise DataFileError(str(path), found="no finite response", expected="one at least")
    kept = good[:, measured].all(axis=1)
    told = list(remarks)
    if not kept.all():
        i, j = next((i, j) for i, j in np.argwhere(measured) if not good[:, i, j].all())
        told.append(
            f"{int((~kept).sum())} of {kept.size} lines of {path} are left out, where a response is not finite "
            f"({outputs[i]} to {inputs[j]} first, at {freq_hz[int(np.argmin(good[:, i, j]))]:g} Hz)."
        )
    if not kept.any():
        raise DataFileError(str(path), found="no line where all responses are finite", expected="one at least")
    try:
        frfs = FrfSet(
            freq_hz[kept],
            np.where(measured, values, 0)[kept],
            kind,
            outputs,
            inputs,
            coherence=None if coherence is None else np.where(measured, coherence, 0.0)[kept],
            measured=measured,
        )
    except FrfError as error:
        raise DataFileError(
            f"{path}: {error.where}", found=error.found, expected=error.expected, hint=error.hint
        ) from error
    return Found(frfs, skipped, tuple(told))


def _complex(path: str | Path, arrays: Mapping[str, Stored], wanted: str | None) -> str:
    chosen = [wanted] if wanted is not None else [n for n, a in arrays.items() if a.kind == "c" and a.size > 1]
    if len(chosen) != 1 or chosen[0] not in arrays or arrays[chosen[0]].kind != "c":
        hint = "Name it with variable=."
        raise DataFileError(str(path), found=listing(arrays), expected="one complex array of responses", hint=hint)
    return chosen[0]


def _cube(
    path: str | Path, name: str, array: NDArray[Any], lines: int,
    said: tuple[tuple[str, ...] | None, tuple[str, ...] | None],
) -> NDArray[Any]:  # fmt: skip
    """An array as (lines, outputs, inputs)."""
    given = array.shape
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim == 2:
        array = array if array.shape[0] == lines else array.T
        to_many = said[0] is not None and len(said[0]) == 1 and array.shape[1] > 1
        array = array[:, None, :] if to_many else array[:, :, None]
    elif array.ndim == 3 and array.shape[0] != lines:
        array = np.moveaxis(array, 2, 0)
    if array.ndim != 3 or array.shape[0] != lines:
        found = f"{name} {'x'.join(map(str, given))} and {lines} frequencies"
        raise DataFileError(str(path), found=found, expected="lines x outputs x inputs, or outputs x inputs x lines")
    return array


def _labels(texts: Mapping[str, Sequence[str]], name: str, given: Sequence[str] | None) -> tuple[str, ...] | None:
    listed = (given,) if isinstance(given, str) else given if given is not None else texts.get(name)
    if not listed:
        return None
    return tuple(f"tip.{word.lower()}" if word.lower() in AXES else word for word in map(str, listed))


def _dofs(
    path: str | Path,
    name: str,
    shape: tuple[int, ...],
    said: tuple[tuple[str, ...] | None, tuple[str, ...] | None],
    remarks: list[str],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The labels of outputs and inputs; x y z at the tip of a 3x3 matrix that says nothing."""
    axes = ("tip.x", "tip.y", "tip.z")
    if said == (None, None) and shape == (3, 3):
        remarks.append(f"Nothing says where {name} was measured: it is taken along {', '.join(axes)}.")
        said = axes, axes
    for option, count, labels in zip(("outputs", "inputs"), shape, said, strict=True):
        if labels is None or len(labels) != count:
            found = f"{count} {option} of {name} and " + ("no names" if labels is None else f"{len(labels)} names")
            expected = f"as many degrees of freedom with {option}=, such as sensor.x"
            raise DataFileError(str(path), found=found, expected=expected)
    return said[0] or (), said[1] or ()
