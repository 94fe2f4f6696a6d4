"""The record of a run: what went in, with which versions, so that its result can be traced and made again."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

import armonic

if TYPE_CHECKING:
    from armonic.robot import Robot
    from armonic.updating.parameters import Parameter


@dataclass(frozen=True)
class Record:
    """Where a fit comes from.

    Attributes:
        armonic: version.
        started: ISO time, UTC.
        seed: of all chance.
        method: how it was fitted.
        options: of the method, plain values.
        robot: its name.
        robot_sha256: of its file's text, and of the URDF's if it starts from one.
        measurements: label and SHA-256 of each: lines, values, kind, axes, frames, posture, weights.
        parameters: what was fitted.
        fingerprint: SHA-256 over all that the result depends on: robot, measurements, parameters with their bounds,
            method, options, seed; not of time, versions and labels.
        python: version.
        numpy: version.
        scipy: version.
    """

    armonic: str
    started: str
    seed: int
    method: str
    options: dict[str, Any]
    robot: str
    robot_sha256: str
    measurements: tuple[tuple[str, str], ...]
    parameters: tuple[str, ...]
    fingerprint: str
    python: str
    numpy: str
    scipy: str

    def as_dict(self) -> dict[str, Any]:
        """The record as plain data that JSON knows."""
        plain: dict[str, Any] = _plain(asdict(self))
        return plain


def record_of(
    robot: Robot,
    measurements: Sequence[Any],
    parameters: Sequence[Parameter],
    method: str,
    seed: int,
    options: object,
) -> Record:
    """The record of a run that starts now.

    Args:
        robot: as the run gets it.
        measurements: what is fitted, `Measurement` or other dataclasses.
        parameters: what may change.
        method: its name.
        seed: of all chance.
        options: a mapping, or a dataclass such as `Genetic`.

    Returns:
        The record.
    """
    urdf = b"" if robot.urdf is None else robot.urdf.content
    text = robot.to_yaml().encode()
    robot_sha256 = hashlib.sha256(hashlib.sha256(text).digest() + urdf if urdf else text).hexdigest()
    digests = [_sha256(_measured(robot, m)) for m in measurements]
    plain = _plain(options)
    problem = {
        "robot": robot_sha256,
        "measurements": digests,
        "parameters": list(parameters),
        "method": method,
        "options": plain,
        "seed": seed,
    }
    return Record(
        armonic=armonic.__version__,
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        seed=int(seed),
        method=method,
        options=plain,
        robot=robot.name,
        robot_sha256=robot_sha256,
        measurements=tuple((str(m.label), digest) for m, digest in zip(measurements, digests, strict=True)),
        parameters=tuple(p.path for p in parameters),
        fingerprint=_sha256(problem),
        python=platform.python_version(),
        numpy=np.__version__,
        scipy=scipy.__version__,
    )


def _measured(robot: Robot, measurement: Any) -> object:
    """What a fit sees of a measurement: weights as numbers, whatever they were given as, and no label."""
    content = {f.name: getattr(measurement, f.name) for f in fields(measurement) if f.name != "label"}
    if "weights" in content and hasattr(measurement, "line_weights"):
        content["weights"] = measurement.line_weights()
    if "posture" in content:
        content["posture"] = robot.posture(content["posture"])
    return content


def _sha256(value: object) -> str:
    """Digest of a value's canonical form, the same on every machine."""
    return hashlib.sha256(json.dumps(_canonical(value), sort_keys=True).encode()).hexdigest()


def _canonical(value: object) -> object:
    """Nested lists, dicts and texts: arrays by the digest of their bytes (little endian), floats with every digit.

    Raises:
        TypeError: a value of a kind that has no such form.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return ["float", value.hex()]
    if isinstance(value, complex):
        return ["complex", value.real.hex(), value.imag.hex()]
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biufc":
            raise TypeError(f"an array of {value.dtype} has no digest")
        little = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
        return ["array", little.dtype.str, list(value.shape), hashlib.sha256(little.tobytes()).hexdigest()]
    if is_dataclass(value) and not isinstance(value, type):
        return [type(value).__name__, {f.name: _canonical(getattr(value, f.name)) for f in fields(value)}]
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items()}
    if isinstance(value, Sequence):
        return [_canonical(item) for item in value]
    raise TypeError(f"a {type(value).__name__} has no digest")


def _plain(value: object) -> Any:
    """What JSON knows: numbers, texts, lists and dicts; what is not finite as text."""
    if isinstance(value, np.generic):
        value = value.item()
    if is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value if value is None or isinstance(value, bool | int | float | str) else repr(value)
