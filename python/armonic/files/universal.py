"""Universal files, as a matrix of frequency responses at one sensor."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from armonic.errors import DataFileError, FrfError
from armonic.files.cells import AXES, Cell, matrix, read_bytes, remapping
from armonic.files.uff_reader import Function, parse
from armonic.files.uff_writer import encode
from armonic.response import Frf, Kind
from armonic.writing import write_whole

_KINDS: dict[int, Kind] = {8: "receptance", 11: "mobility", 12: "accelerance"}  # by type of the response
_TYPES = {kind: number for number, kind in _KINDS.items()}
_FORCE = 13
_PER_TIME = {"receptance": "", "mobility": "/s", "accelerance": "/s^2"}
_NODE_MAX = 10**10 - 1  # ten columns
_FRAME_NOTE = "sensor frame: "
_FORCE_NOTE = ", force at: "
_GRAVITIES = {"g", "gn", "mg"}
_LENGTHS = {"mm", "cm", "um", "µm", "nm", "in", "inch", "ft"}
_FORCES = {"lbf", "lb", "kn", "mn", "dan", "kgf"}


def read_uff(
    path: str | Path,
    *,
    frame: str | None = None,
    kind: Kind | None = None,
    axes: Mapping[str, str] | None = None,
    outputs: str | Sequence[str] | None = None,
    inputs: str | Sequence[str] | None = None,
    response_node: int | None = None,
    reference_node: int | None = None,
    scale: float | None = None,
) -> Frf:
    """Read the FRFs (data sets 58 or 58b of function type 4) of a universal file as one matrix.

    Directions ±1 to ±6 become axes x, y, z, rx, ry, rz of the sensor frame; a negative one turns the sign.
    Values are converted to SI with the factors of data set 164, if the file has one, and are SI otherwise;
    where the unit labels contradict that, `scale` must tell.

    Args:
        path: the file.
        frame: the sensor frame of the robot at which was measured; default: as noted by `write_uff`.
        kind: overrides what the file says of the response and the reference.
        axes: from an axis of the file to the axis of the sensor frame it lies along, as {"x": "-z", "z": "x"}
            for a sensor that was mounted otherwise; it applies to responses and forces, and axes not
            named stay. Rotations are axes of their own: "rx", "ry", "rz".
        outputs: read only these axes of the response (of the sensor frame), in this order.
        inputs: read only these axes of the force.
        response_node: the node of the response, where the file has several.
        reference_node: the node of the force, where the file has several.
        scale: factor from the values of the file to SI, instead of the units that the file states.

    Raises:
        DataFileError: the file is not a universal file, is damaged, or does not hold one whole FRF matrix.
        FrfError: `axes` or `scale` does not make sense.
    """
    if scale is not None and not (np.isfinite(scale) and scale > 0):
        raise FrfError("scale", found=repr(scale), expected="a positive number")
    remap = remapping(axes)
    functions, ignored = parse(read_bytes(path), str(path))
    if not functions:
        raise DataFileError(
            str(path),
            found=f"only data sets {', '.join(ignored)}" if ignored else "no data set",
            expected="frequency responses: data sets 58 of function type 4",
        )
    functions = at_node(path, functions, "response", response_node)
    functions = at_node(path, functions, "reference", reference_node)
    cells = []
    for function in functions:
        place = f"{path}, line {function.line}"
        output, sign = axis_of(place, "response", function.response[1])
        force, force_sign = axis_of(place, "reference", function.reference[1])
        factor = (_si_factor(place, function, output, force) if scale is None else scale) * sign * force_sign
        (output, sign), (force, force_sign) = remap[output], remap[force]
        with np.errstate(all="ignore"):  # an overflow is caught by the check for finite values
            values = function.values * (factor * sign * force_sign)
        cells.append(Cell(place, output, force, function.freq_hz, values))
    cells.sort(key=lambda cell: (AXES.index(cell.output), AXES.index(cell.input)))
    note = functions[0].note
    if frame is None and note.startswith(_FRAME_NOTE):
        frame = note.removeprefix(_FRAME_NOTE).partition(_FORCE_NOTE)[0]
    frf = matrix(path, cells, _kind(path, functions) if kind is None else kind, frame, outputs, inputs)
    return replace(frf, input_frame=note.partition(_FORCE_NOTE)[2] or None)


def write_uff(
    path: str | Path, frf: Frf, *, node: int = 1, binary: bool = False, name: str = "Frequency response"
) -> None:
    """Write a universal file in SI units, one data set 58 per entry of the matrix, in double precision.

    Text keeps 13 digits of the values and about 10 of the frequencies; binary keeps every bit of the values,
    and of the frequencies unless they are evenly spaced.

    Args:
        path: the file; an existing one is replaced, once all is written.
        frf: what to write; its axes must be among x, y, z, rx, ry, rz.
        node: the number of the node at which response and force are said to be.
        binary: write data sets 58b, smaller and exact, instead of text.
        name: a title, for other programs to show.

    Raises:
        DataFileError: the file cannot be written, or its frequencies cannot be told apart in text.
        FrfError: an axis has no direction code, the node no place in its columns, or a force elsewhere no short name.
    """
    for where, labels in (("Frf.outputs", frf.outputs), ("Frf.inputs", frf.inputs)):
        if unknown := [label for label in labels if label not in AXES]:
            raise FrfError(where, found=", ".join(unknown), expected=f"some of {', '.join(AXES)} for a universal file")
    if not 0 < node <= _NODE_MAX:
        raise FrfError("node", found=repr(node), expected=f"1 to {_NODE_MAX}")
    note = _frame_note(frf)
    functions = [
        Function(
            freq_hz=frf.freq_hz,
            values=frf.values[:, i, j],
            response=(node, AXES.index(output) + 1),
            reference=(node if frf.input_frame in (None, frf.frame) else node + 1, AXES.index(force) + 1),
            response_type=_TYPES[frf.kind],
            reference_type=_FORCE,
            response_unit=("rad" if output in AXES[3:] else "m") + _PER_TIME[frf.kind],
            reference_unit="N m" if force in AXES[3:] else "N",
            title=f"{name} {output}/{force}",
            note=note,
        )
        for i, output in enumerate(frf.outputs)
        for j, force in enumerate(frf.inputs)
    ]
    write_whole(path, encode(functions, binary=binary, title=name))


def _frame_note(frf: Frf) -> str:
    """An ID line that names the frames, or nothing where the sensor's name alone would not come back whole.

    Raises:
        FrfError: the force acted elsewhere, and the line cannot say where.
    """
    elsewhere = frf.input_frame not in (None, frf.frame)
    note = f"{_FRAME_NOTE}{frf.frame}" + (f"{_FORCE_NOTE}{frf.input_frame}" if elsewhere else "")
    whole = bool(frf.frame) and note.isascii() and note == " ".join(note.split()) and len(note) <= 80
    if elsewhere and not whole:
        expected = "names of both frames, in ASCII and together below 60 characters"
        raise FrfError("Frf.input_frame", found=f"{frf.frame!r} and {frf.input_frame!r}", expected=expected)
    return note if whole else ""


def at_node(
    path: str | Path, functions: list[Function], end: Literal["response", "reference"], wanted: int | None
) -> list[Function]:
    """The functions with response or reference at the wanted node, by default the only one."""
    nodes = [(function.response if end == "response" else function.reference)[0] for function in functions]
    listed = ", ".join(map(str, sorted(set(nodes))))
    if wanted is None and len(set(nodes)) > 1:
        hint = f"Pick one with {end}_node=."
        raise DataFileError(str(path), found=f"{end} nodes {listed}", expected=f"one {end} node", hint=hint)
    if wanted is not None and wanted not in nodes:
        raise DataFileError(str(path), found=f"{end} nodes {listed}", expected=f"node {wanted}, as asked for")
    return [function for function, node in zip(functions, nodes, strict=True) if wanted in (None, node)]


def _kind(path: str | Path, functions: list[Function]) -> Kind:
    found: dict[Kind, int] = {}
    for function in functions:
        types = function.response_type, function.reference_type
        if types[0] not in _KINDS or types[1] != _FORCE:
            raise DataFileError(
                f"{path}, line {function.line}",
                found=f"a response of data type {types[0]} per reference of data type {types[1]}",
                expected="8 (displacement), 11 (velocity) or 12 (acceleration) per 13 (force)",
                hint="If you know what was measured, say so with kind=.",
            )
        found.setdefault(_KINDS[types[0]], function.line)
    if len(found) > 1:
        listed = ", ".join(f"{kind} (line {line})" for kind, line in found.items())
        raise DataFileError(str(path), found=listed, expected="functions of one kind")
    return next(iter(found))


def axis_of(place: str, end: str, direction: int) -> tuple[str, float]:
    """Axis and sign of a direction code.

    Raises:
        DataFileError: it is none.
    """
    if not 1 <= abs(direction) <= len(AXES):
        scalar = " (scalar)" if direction == 0 else ""
        raise DataFileError(
            place,
            found=f"{end} direction {direction}{scalar}",
            expected="±1 to ±6, for ±x, ±y, ±z and rotations about them",
        )
    return AXES[abs(direction) - 1], 1.0 if direction > 0 else -1.0


def _si_factor(place: str, function: Function, output: str, force: str) -> float:
    """The factor from the units that the file states to SI; where it contradicts itself, an error."""
    units = function.units
    hint = "Say what the values are with scale=: 1.0 if they are SI, 9.80665 if they are in g, 0.001 if in mm."
    if units.code == 1 and (abs(units.length - 1) > 1e-6 or abs(units.force - 1) > 1e-6):
        found = f"units code 1 (SI) with factors {units.length:g} for length and {units.force:g} for force"
        raise DataFileError(place, found=found, expected="factors of 1 for SI (data set 164)", hint=hint)
    length, newton = _unit(function.response_unit), _unit(function.reference_unit)
    if length in _GRAVITIES or (length in _LENGTHS and units.length == 1):
        raise DataFileError(place, found=f"values labelled {function.response_unit!r}", expected="SI", hint=hint)
    if newton in _FORCES and units.force == 1:
        raise DataFileError(place, found=f"forces labelled {function.reference_unit!r}", expected="N", hint=hint)
    per_response = 1.0 if output in AXES[3:] else units.length
    per_force = units.force * (units.length if force in AXES[3:] else 1.0)
    return per_force / per_response


def _unit(label: str) -> str:
    """The first unit of a label such as "(mm/s^2)/N"."""
    match = re.match(r"\W*([a-zµ]+)", label.lower())
    return match[1] if match else ""
