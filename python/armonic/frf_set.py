"""Measured frequency responses between many points, with what is known of their quality."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.response import KINDS, Frf, Kind, is_settled, lines_in_band

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]


def split_label(label: str) -> tuple[str, str]:
    """Place and axis of a degree of freedom: ("sensor", "x") of "sensor.x"; the place may hold dots itself.

    Raises:
        FrfError: it is not of that form.
    """
    place, dot, axis = str(label).rpartition(".")
    if not (place and dot and axis):
        raise FrfError("label", found=repr(label), expected="PLACE.AXIS, such as sensor.x")
    return place, axis


@dataclass(frozen=True, eq=False, repr=False)
class FrfSet:
    """Frequency responses from every input to every output, at one place or many; immutable.

    Unlike an `Frf`, which is the matrix at one sensor frame, a set has its degrees of freedom by name, "sensor.x", may
    lack some of its pairs, and carries coherences. Arrays are copied in C order and made read-only, unless they are so
    already.

    Args:
        freq_hz: (L,) frequencies in Hz, not negative, strictly increasing.
        values: (L, outputs, inputs), response per force in SI units; zero where a pair was not measured.
        kind: what is divided by the force.
        outputs: degrees of freedom of the responses, PLACE.AXIS each.
        inputs: those of the forces.
        coherence: γ² of each value, (L, outputs, inputs), 0 to 1; None if not known. With several forces at once it is
            the multiple coherence, the same for all of them.
        averages: how many hits or blocks each pair was averaged over, (outputs, inputs), 0 where not measured; None if
            not known.
        measured: which pairs were measured, (outputs, inputs); all if not given.
        decay_rate: a in 1/s of an exponential window e^(−at) on responses and forces alike: the lines then lie at
            s = iω + a, beside the imaginary axis, where every pole seems damped by a more (Fladung and Rost 1997).
        notes: text by name, such as file, robot, posture.

    Raises:
        FrfError: shapes, labels or kind do not fit, or a number is not finite or impossible.
    """

    freq_hz: Array
    values: Complex
    kind: Kind
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    coherence: Array | None = None
    averages: NDArray[np.int64] | None = None
    measured: NDArray[np.bool_] = field(default_factory=lambda: np.ones((0, 0), bool))
    decay_rate: float = 0.0
    notes: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("outputs", "inputs"):
            self._set(name, tuple(getattr(self, name)))
        # The matrix of one sensor checks lines, labels, kind and values alike.
        plain = Frf(self.freq_hz, self.values, self.kind, self.outputs, self.inputs)
        for label in (*self.outputs, *self.inputs):
            split_label(label)
        self._set("freq_hz", plain.freq_hz)
        pairs = (len(self.outputs), len(self.inputs))
        measured = np.array(self.measured if np.size(self.measured) else np.ones(pairs), bool)
        if measured.shape != pairs or not measured.any():
            raise FrfError("FrfSet.measured", found=f"shape {measured.shape}", expected=f"{pairs}, one pair at least")
        values = plain.values  # checked, of its own and read-only
        if values[:, ~measured].any():
            values = np.where(measured, values, 0)
        self._freeze("measured", measured)
        self._freeze("values", values)
        if self.coherence is not None:
            self._freeze("coherence", self._checked_coherence(values.shape))
        if self.averages is not None:
            averages = np.array(self.averages, np.int64)
            if averages.shape != pairs or (averages < 0).any():
                raise FrfError("FrfSet.averages", found=f"shape {averages.shape}", expected=f"counts of shape {pairs}")
            self._freeze("averages", np.where(measured, averages, 0))
        if not (np.isfinite(self.decay_rate) and self.decay_rate >= 0):
            raise FrfError("FrfSet.decay_rate", found=repr(self.decay_rate), expected="a rate in 1/s, 0 for no window")
        self._set("notes", MappingProxyType(dict(self.notes)))

    def _checked_coherence(self, shape: tuple[int, ...]) -> Array:
        coherence = np.asarray(self.coherence, np.float64)
        if coherence.shape != shape:
            raise FrfError("FrfSet.coherence", found=f"shape {coherence.shape}", expected=f"shape {shape}")
        settled = is_settled(coherence, np.float64) and not coherence[:, ~self.measured].any()
        if settled and coherence.min() >= 0 and coherence.max() <= 1:  # which no NaN is
            return coherence
        coherence = np.array(coherence, order="C")
        coherence[:, ~self.measured] = 0.0
        if not (np.isfinite(coherence).all() and (coherence >= -1e-9).all() and (coherence <= 1 + 1e-9).all()):
            raise FrfError("FrfSet.coherence", found="numbers that are none", expected="coherences from 0 to 1")
        return np.clip(coherence, 0.0, 1.0, out=coherence)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _freeze(self, name: str, array: NDArray[Any]) -> None:
        array.setflags(write=False)
        self._set(name, array)

    @classmethod
    def from_frf(
        cls, frf: Frf, *, coherence: ArrayLike | None = None, notes: Mapping[str, str] | None = None
    ) -> FrfSet:
        """The matrix of one sensor frame as a set; the place is its frame, or "tip" if it knows none.

        Args:
            frf: the matrix.
            coherence: (L,) or (L, outputs, inputs).
            notes: text by name.

        Raises:
            FrfError: the coherence does not fit.
        """
        place = frf.frame or "tip"
        hit = frf.input_frame or place
        if coherence is not None:
            given = np.asarray(coherence, np.float64)
            given = given[:, None, None] if given.ndim == 1 else given
            try:
                coherence = np.broadcast_to(given, frf.values.shape)
            except ValueError:
                found = f"shape {given.shape}"
                raise FrfError("coherence", found=found, expected=f"shape {frf.values.shape}") from None
        return cls(
            frf.freq_hz,
            frf.values,
            frf.kind,
            tuple(f"{place}.{axis}" for axis in frf.outputs),
            tuple(f"{hit}.{axis}" for axis in frf.inputs),
            coherence=None if coherence is None else np.asarray(coherence),
            notes=notes or {},
        )

    def __repr__(self) -> str:
        """Lines, points and pairs in one line."""
        f, pairs = self.freq_hz, int(self.measured.sum())
        return (
            f"FrfSet({self.kind}, {f.size} lines {f[0]:g} to {f[-1]:g} Hz, {pairs} of "
            f"{len(self.outputs)}x{len(self.inputs)} responses at {', '.join(self.places)})"
        )

    @property
    def places(self) -> tuple[str, ...]:
        """Names of all places, those of responses first."""
        return tuple(dict.fromkeys(split_label(label)[0] for label in (*self.outputs, *self.inputs)))

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the places with both responses and forces."""
        ends = [{split_label(label)[0] for label in side} for side in (self.outputs, self.inputs)]
        return tuple(place for place in self.places if place in ends[0] & ends[1])

    @property
    def s(self) -> Complex:
        """Where the lines lie in the plane of Laplace, (L,), rad/s: iω, or beside it with an exponential window."""
        return np.asarray(2j * np.pi * self.freq_hz + self.decay_rate, np.complex128)

    @property
    def complete(self) -> bool:
        """Whether every pair was measured."""
        return bool(self.measured.all())

    def to(self, kind: Kind) -> FrfSet:
        """The same responses as another kind, by a factor s^p.

        Raises:
            FrfError: the kind is unknown, or a line at s = 0 would be divided by zero.
        """
        if kind not in KINDS:
            raise FrfError("kind", found=repr(kind), expected=f"one of {', '.join(KINDS)}")
        power = KINDS.index(kind) - KINDS.index(self.kind)
        if power < 0 and self.s[0] == 0:
            raise FrfError(
                "FrfSet.freq_hz",
                found=f"a line at 0 Hz, where {self.kind} does not determine {kind}",
                expected="frequencies above 0 Hz",
                hint="Take a band that begins above it.",
            )
        if power == 0:
            return self
        return replace(self, values=self.values * (self.s**power)[:, None, None], kind=kind)

    def band(self, low_hz: float, high_hz: float) -> FrfSet:
        """The lines from `low_hz` to `high_hz`, both included.

        Raises:
            FrfError: there is none.
        """
        return self.lines(lines_in_band(self.freq_hz, low_hz, high_hz))

    def lines(self, indices: ArrayLike) -> FrfSet:
        """The lines with these indices."""
        chosen = np.asarray(indices)
        coherence = None if self.coherence is None else self.coherence[chosen]
        return replace(self, freq_hz=self.freq_hz[chosen], values=self.values[chosen], coherence=coherence)

    def select(
        self, *, outputs: str | Sequence[str] | None = None, inputs: str | Sequence[str] | None = None
    ) -> FrfSet:
        """Responses of some degrees of freedom, by labels, places or shell patterns; the order of the set is kept.

        Raises:
            FrfError: a pattern meets none.
        """
        return self._part(_matching("outputs", outputs, self.outputs), _matching("inputs", inputs, self.inputs))

    def _part(self, rows: list[int], columns: list[int]) -> FrfSet:
        pair = np.ix_(rows, columns)
        return replace(
            self,
            values=self.values[:, rows][:, :, columns],
            outputs=tuple(self.outputs[i] for i in rows),
            inputs=tuple(self.inputs[i] for i in columns),
            coherence=None if self.coherence is None else self.coherence[:, rows][:, :, columns],
            averages=None if self.averages is None else self.averages[pair],
            measured=self.measured[pair],
        )

    def matrix(self, place: str | None = None, *, as_measured: bool = False) -> tuple[Frf, Array | None]:
        """The matrix of one place, driven where it is watched, and its coherence; axes in the order x y z rx ry rz.

        Args:
            place: by default the only one with both responses and forces.
            as_measured: take lines beside the imaginary axis as if they lay on it, for figures.

        Raises:
            FrfError: there is no such place, none or several to choose from, a pair was not measured, or the lines lie
                beside the imaginary axis.
        """
        both = self.driven
        if place is None and len(both) != 1:
            found = f"responses and forces together at {', '.join(both) or 'no place'}"
            raise FrfError("place", found=found, expected="one place", hint="Name one.")
        place = both[0] if place is None else place
        if place not in both:
            raise FrfError("place", found=repr(place), expected=f"one of {', '.join(both) or 'none'}")
        if self.decay_rate and not as_measured:
            raise FrfError(
                "FrfSet.decay_rate",
                found=f"an exponential window of {self.decay_rate:g}/s",
                expected="lines on the imaginary axis",
                hint="Identify modes and synthesize: they come out without the window.",
            )
        part = self._part(
            *(
                [k for k, label in enumerate(side) if split_label(label)[0] == place]
                for side in (self.outputs, self.inputs)
            )
        )
        order = ["x", "y", "z", "rx", "ry", "rz"]
        rows, columns = (
            sorted(range(len(labels)), key=lambda k: order.index(a) if (a := split_label(labels[k])[1]) in order else 9)
            for labels in (part.outputs, part.inputs)
        )
        if not part.complete:
            i, j = (int(k) for k in np.argwhere(~part.measured)[0])
            found = f"no response {part.outputs[i]} to {part.inputs[j]}"
            raise FrfError("FrfSet.measured", found=found, expected=f"every pair at {place}")
        values = part.values[:, rows][:, :, columns]
        outputs = tuple(split_label(part.outputs[i])[1] for i in rows)
        inputs = tuple(split_label(part.inputs[i])[1] for i in columns)
        coherence = None if part.coherence is None else part.coherence[:, rows][:, :, columns]
        return Frf(part.freq_hz, values, part.kind, outputs, inputs, place), coherence


def _matching(where: str, wanted: str | Sequence[str] | None, present: tuple[str, ...]) -> list[int]:
    if wanted is None:
        return list(range(len(present)))
    patterns = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    found: set[int] = set()
    for pattern in patterns:
        # A name is itself before it is a pattern: places may have brackets.
        hits = {k for k, label in enumerate(present) if pattern in (label, split_label(label)[0])}
        hits = hits or {k for k, label in enumerate(present) if fnmatchcase(label, pattern)}
        if not hits:
            raise FrfError(where, found=repr(pattern), expected=f"some of {', '.join(present)}")
        found |= hits
    return sorted(found)
