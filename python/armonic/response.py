"""The frequency response function (FRF) of a robot at a sensor frame, measured or computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeGuard, get_args

import numpy as np
from numpy.typing import NDArray

from armonic.errors import FrfError

Kind = Literal["receptance", "mobility", "accelerance"]
"""Displacement, velocity or acceleration per force: m/N, m/s/N, m/s²/N (rad and N·m for a rotation)."""

KINDS: tuple[Kind, ...] = get_args(Kind)
"""Every kind, ordered by the power of iω that leads from receptance to it."""


@dataclass(frozen=True, eq=False, repr=False)
class Frf:
    """A matrix of frequency responses over one set of frequency lines; immutable.

    Arrays are copied in C order and made read-only, unless they are so already. Two instances are equal only if they
    are the same object.

    Args:
        freq_hz: (L,) frequencies in Hz, finite, not negative, strictly increasing.
        values: (L, outputs, inputs) complex response per force in SI units, `values[line, output, input]`.
        kind: what is divided by the force.
        outputs: the axes of the sensor frame along which the response is taken, such as ("x", "y", "z").
        inputs: the axes of the sensor frame along which the force acts.
        frame: the name of the sensor frame, if known.
        input_frame: the name of the frame where the force acts, if it is another one.

    Raises:
        FrfError: shapes, labels or kind do not fit, a number is not finite, or frequencies do not increase.
    """

    freq_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    kind: Kind
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    frame: str | None = None
    input_frame: str | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise FrfError("Frf.kind", found=repr(self.kind), expected=f"one of {', '.join(KINDS)}")
        for name in ("frame", "input_frame"):
            frame = getattr(self, name)
            if not (frame is None or isinstance(frame, str)):
                raise FrfError(f"Frf.{name}", found=repr(frame), expected="the name of a frame, or None")
        _set(self, "freq_hz", _read_only("Frf.freq_hz", self.freq_hz, np.float64))
        _set(self, "values", _read_only("Frf.values", self.values, np.complex128))
        _set(self, "outputs", _labels("Frf.outputs", self.outputs))
        _set(self, "inputs", _labels("Frf.inputs", self.inputs))
        self._check_frequencies()
        self._check_values()

    def _check_frequencies(self) -> None:
        f, where = self.freq_hz, "Frf.freq_hz"
        if f.ndim != 1 or f.size == 0:
            raise FrfError(where, found=f"shape {f.shape}", expected="shape (L,) with at least one line")
        if not np.isfinite(f).all():
            line = int(np.argmin(np.isfinite(f)))
            raise FrfError(where, found=f"{f[line]} at index {line}", expected="finite frequencies in Hz")
        if f[0] < 0:
            raise FrfError(where, found=f"{f[0]:g} Hz at index 0", expected="frequencies of at least 0 Hz")
        rising = f[1:] > f[:-1]
        if not rising.all():
            line = int(np.argmin(rising)) + 1
            raise FrfError(
                where,
                found=f"{f[line]:.9g} Hz at index {line} after {f[line - 1]:.9g} Hz",
                expected="strictly increasing frequencies",
            )

    def _check_values(self) -> None:
        shape = (self.freq_hz.size, len(self.outputs), len(self.inputs))
        if self.values.shape != shape:
            raise FrfError(
                "Frf.values",
                found=f"shape {self.values.shape}",
                expected=f"shape {shape}: lines, outputs, inputs",
            )
        finite = np.isfinite(self.values)
        if not finite.all():
            line, i, j = (int(k) for k in np.unravel_index(np.argmin(finite), shape))
            cell = f"{self.outputs[i]}/{self.inputs[j]}"
            raise FrfError(
                "Frf.values",
                found=f"{self.values[line, i, j]} at {self.freq_hz[line]:.9g} Hz in {cell}",
                expected="finite numbers",
            )

    def __repr__(self) -> str:
        frame = "" if self.frame is None else f", frame {self.frame!r}"
        return (
            f"Frf({self.kind}, {self.freq_hz.size} lines {self.freq_hz[0]:g} to {self.freq_hz[-1]:g} Hz, "
            f"outputs {' '.join(self.outputs)}, inputs {' '.join(self.inputs)}{frame})"
        )

    @property
    def magnitude(self) -> NDArray[np.float64]:
        """(L, outputs, inputs) absolute value, in the unit of the kind."""
        return np.abs(self.values)

    @property
    def phase_rad(self) -> NDArray[np.float64]:
        """(L, outputs, inputs) phase in radians, in (-π, π]."""
        return np.angle(self.values)

    def to(self, kind: Kind) -> Frf:
        """The same response as another kind: a factor of (2πi f)^p, p from -2 to 2.

        Args:
            kind: the wanted kind.

        Raises:
            FrfError: the kind is unknown, or the line f = 0 would be divided by zero.
        """
        if kind not in KINDS:
            raise FrfError("kind", found=repr(kind), expected=f"one of {', '.join(KINDS)}")
        power = KINDS.index(kind) - KINDS.index(self.kind)
        if power == 0:
            return self
        if power < 0 and self.freq_hz[0] == 0:
            raise FrfError(
                "Frf.freq_hz",
                found=f"a line at 0 Hz, where {self.kind} does not determine {kind}",
                expected="frequencies above 0 Hz",
                hint="Drop that line first, with frf.band(frf.freq_hz[1], frf.freq_hz[-1]).",
            )
        quarter_turns = (1, 1j, -1, -1j)[power % 4]  # i^p kept exact, apart from ω^p
        with np.errstate(all="ignore"):  # an overflow is caught by the check for finite values
            factor = quarter_turns * (2 * np.pi * self.freq_hz) ** float(power)
            return replace(self, values=self.values * factor[:, None, None], kind=kind)

    def symmetrized(self, how: Literal["average", "upper", "lower"] = "average") -> Frf:
        """The response made reciprocal, H = Hᵀ, as Maxwell and Betti demand of a passive structure.

        Args:
            how: "average" takes the mean of H and Hᵀ; "upper", "lower" mirror that triangle onto the other.

        Raises:
            FrfError: outputs and inputs are not the same axes of one frame in the same order, or `how` is unknown.
        """
        if self.outputs != self.inputs:
            raise FrfError(
                "Frf.inputs",
                found=" ".join(self.inputs),
                expected=f"the outputs: {' '.join(self.outputs)}",
                hint="Take the axes that both share, with frf.select(outputs=..., inputs=...).",
            )
        if self.input_frame not in (None, self.frame):
            raise FrfError(
                "Frf.input_frame",
                found=f"a force at {self.input_frame!r} and a response at {self.frame!r}",
                expected="both at one frame, for only such a matrix is symmetric",
            )
        H, Ht = self.values, self.values.swapaxes(1, 2)
        if how == "average":
            return replace(self, values=0.5 * H + 0.5 * Ht)
        above = np.triu(np.ones(H.shape[1:], dtype=bool))
        if how == "upper":
            return replace(self, values=np.where(above, H, Ht))
        if how == "lower":
            return replace(self, values=np.where(above, Ht, H))
        raise FrfError("how", found=repr(how), expected="one of average, upper, lower")

    def band(self, low_hz: float, high_hz: float) -> Frf:
        """The lines from `low_hz` to `high_hz`, both included.

        Raises:
            FrfError: there is no line in that band.
        """
        kept = lines_in_band(self.freq_hz, low_hz, high_hz)
        return replace(self, freq_hz=self.freq_hz[kept], values=self.values[kept])

    def select(self, *, outputs: str | Sequence[str] | None = None, inputs: str | Sequence[str] | None = None) -> Frf:
        """The rows and columns of the named axes, in the order given.

        Args:
            outputs: one axis or several; None keeps all.
            inputs: one axis or several; None keeps all.

        Raises:
            FrfError: an axis is not there, or is named twice.
        """
        rows, out = _pick("outputs", outputs, self.outputs)
        columns, into = _pick("inputs", inputs, self.inputs)
        return replace(self, values=self.values[:, rows][:, :, columns], outputs=out, inputs=into)


def lines_in_band(freq_hz: NDArray[np.float64], low_hz: float, high_hz: float) -> NDArray[np.intp]:
    """Indices of the lines from `low_hz` to `high_hz`, both included.

    Raises:
        FrfError: there is none.
    """
    slack = 1e-9 * freq_hz  # a line read from a file may lie beside its number by rounding
    kept = np.flatnonzero((freq_hz >= low_hz - slack) & (freq_hz <= high_hz + slack))
    if not kept.size:
        raise FrfError(
            "band",
            found=f"no line from {low_hz:g} to {high_hz:g} Hz",
            expected=f"a band that meets {freq_hz[0]:g} to {freq_hz[-1]:g} Hz",
        )
    return kept


def _set(frf: Frf, field: str, value: object) -> None:
    object.__setattr__(frf, field, value)


def is_settled(data: Any, dtype: type[np.generic]) -> TypeGuard[NDArray[Any]]:
    """Whether data is an array in C order that owns its memory and is read-only: nothing is gained by a copy."""
    return (
        isinstance(data, np.ndarray)
        and data.dtype == dtype
        and data.base is None
        and data.flags.c_contiguous
        and not data.flags.writeable
    )


def _read_only(where: str, data: Any, dtype: type[np.generic]) -> NDArray[Any]:
    try:
        if dtype is np.float64 and np.iscomplexobj(data):
            raise TypeError("complex numbers")
        array = data if is_settled(data, dtype) else np.array(data, dtype=dtype, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        expected = f"an array of {'real' if dtype is np.float64 else 'complex'} numbers"
        raise FrfError(where, found=f"{type(data).__name__} ({error})", expected=expected) from error
    array.setflags(write=False)
    return array


def _labels(where: str, labels: Sequence[str]) -> tuple[str, ...]:
    expected = "a tuple of different axis names such as ('x', 'y', 'z')"
    if isinstance(labels, str) or not isinstance(labels, Sequence):
        raise FrfError(where, found=repr(labels), expected=expected)
    found = tuple(labels)
    if not found or not all(isinstance(label, str) and label for label in found) or len(set(found)) < len(found):
        raise FrfError(where, found=repr(found), expected=expected)
    return found


def _pick(
    where: str, wanted: str | Sequence[str] | None, present: tuple[str, ...]
) -> tuple[list[int], tuple[str, ...]]:
    if wanted is None:
        return list(range(len(present))), present
    labels = _labels(where, (wanted,) if isinstance(wanted, str) else wanted)
    missing = [label for label in labels if label not in present]
    if missing:
        raise FrfError(where, found=", ".join(missing), expected=f"some of {', '.join(present)}")
    return [present.index(label) for label in labels], labels
