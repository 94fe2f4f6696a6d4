"""A modal model: poles, residues and what lies outside the band, and the frequency responses that they make."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet, split_label
from armonic.identification.poles import damping_ratio, natural_freq_hz
from armonic.response import KINDS, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Mask: TypeAlias = NDArray[np.bool_]

Side = Literal["average", "upper", "lower"]
SWEEPS, POLISH, ARRIVED = 30, 20, 1e-14
"""Alternations towards a matrix of rank one, most steps after them, and a step that is rounding."""


def _none() -> Complex:
    return np.zeros(0, np.complex128)


@dataclass(frozen=True, eq=False, repr=False)
class ModalModel:
    """Receptance by its modes (Heylen, Lammens and Sas 1998; Ewins 2000); immutable.

        H(s) = Σ_r R_r / (s − λ_r) + conj R_r / (s − conj λ_r) + (the same over background poles) + lower / s² + upper

    Background poles are modes outside the band: they are fitted as the others are, but only their tails were seen.

    Args:
        poles: λ, (m,), rad/s, Im λ > 0.
        residues: R, (m, outputs, inputs), of the receptance whatever kind was measured; zero where not measured.
        outputs: degrees of freedom of the responses, PLACE.AXIS each.
        inputs: those of the forces.
        lower: what modes far below leave, (outputs, inputs), real; zero if not given.
        upper: what modes far above leave, (outputs, inputs), real; zero if not given.
        background_poles: (b,), rad/s.
        background_residues: (b, outputs, inputs).
        measured: which pairs were measured, (outputs, inputs); all if not given.

    Raises:
        FrfError: shapes or labels do not fit, or a number is not finite.
        SignalError: a pole without oscillation.
    """

    poles: Complex
    residues: Complex
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    lower: Array = field(default_factory=lambda: np.zeros((0, 0)))
    upper: Array = field(default_factory=lambda: np.zeros((0, 0)))
    background_poles: Complex = field(default_factory=_none)
    background_residues: Complex = field(default_factory=_none)
    measured: Mask = field(default_factory=lambda: np.ones((0, 0), bool))

    def __post_init__(self) -> None:
        for name in ("outputs", "inputs"):
            labels = tuple(getattr(self, name))
            for label in labels:
                split_label(label)
            if not labels or len(set(labels)) < len(labels):
                raise FrfError(f"ModalModel.{name}", found=repr(labels), expected="different labels, one at least")
            object.__setattr__(self, name, labels)
        pairs = (len(self.outputs), len(self.inputs))
        measured = np.array(self.measured if np.size(self.measured) else np.ones(pairs), bool)
        if measured.shape != pairs:
            raise FrfError("ModalModel.measured", found=f"shape {measured.shape}", expected=f"shape {pairs}")
        self._freeze("measured", measured)
        for name in ("poles", "background_poles"):
            self._freeze(name, checked_poles(f"ModalModel.{name}", getattr(self, name)))
        for name, shape, kind in (
            ("residues", (len(self.poles), *pairs), np.complex128),
            ("background_residues", (len(self.background_poles), *pairs), np.complex128),
            ("lower", pairs, np.float64),
            ("upper", pairs, np.float64),
        ):
            given = getattr(self, name)
            array = np.array(given, kind) if np.size(given) else np.zeros(shape, kind)
            if array.shape != shape:
                raise FrfError(f"ModalModel.{name}", found=f"shape {array.shape}", expected=f"shape {shape}")
            if not np.isfinite(array).all():
                raise FrfError(f"ModalModel.{name}", found="a number that is none", expected="finite numbers")
            self._freeze(name, np.where(measured, array, 0))

    def _freeze(self, name: str, array: NDArray[Any]) -> None:
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.poles)

    def __repr__(self) -> str:
        """Modes and pairs in one line."""
        beside = f" and {len(self.background_poles)} outside the band" if len(self.background_poles) else ""
        return (
            f"ModalModel({len(self)} modes{beside}, {int(self.measured.sum())} of "
            f"{len(self.outputs)}x{len(self.inputs)} responses)"
        )

    @property
    def natural_freq_hz(self) -> Array:
        """|λ| / 2π of each mode, (m,)."""
        return natural_freq_hz(self.poles)

    @property
    def damping_ratio(self) -> Array:
        """−Re λ / |λ| of each mode, (m,), a fraction."""
        return damping_ratio(self.poles)

    def receptance(self, s: ArrayLike, *, residuals: bool = True, modes: Sequence[int] | None = None) -> Complex:
        """Receptance at points of the Laplace plane, (L, outputs, inputs), m/N.

        Args:
            s: (L,), rad/s; iω on the imaginary axis.
            residuals: with background poles and lower and upper residuals.
            modes: which modes; all if not given.

        Raises:
            FrfError: s = 0, where the lower residual has no value.
        """
        return self._values(np.asarray(s, np.complex128).ravel(), 0, residuals, modes)

    def frfs(
        self,
        freq_hz: ArrayLike,
        kind: Kind = "accelerance",
        *,
        residuals: bool = True,
        modes: Sequence[int] | None = None,
    ) -> FrfSet:
        """Synthesized frequency responses, on the imaginary axis whatever window the measured ones had.

        Args:
            freq_hz: (L,) lines, Hz.
            kind: what is divided by the force.
            residuals: with background poles and lower and upper residuals.
            modes: which modes; all if not given.

        Raises:
            FrfError: lines or kind make no sense, or a line at 0 Hz where the lower residual has no value.
        """
        if kind not in KINDS:
            raise FrfError("kind", found=repr(kind), expected=f"one of {', '.join(KINDS)}")
        lines = np.asarray(freq_hz, np.float64)
        values = self._values(
            np.asarray(2j * np.pi * lines.ravel(), np.complex128), KINDS.index(kind), residuals, modes
        )
        return FrfSet(lines, values, kind, self.outputs, self.inputs, measured=self.measured)

    def _values(self, s: Complex, power: int, residuals: bool, modes: Sequence[int] | None) -> Complex:
        chosen = np.arange(len(self)) if modes is None else np.asarray(modes, np.intp).ravel()
        if chosen.size and not ((-len(self) <= chosen) & (chosen < len(self))).all():
            raise FrfError("modes", found=repr(modes), expected=f"indices below {len(self)}")
        poles, residues = self.poles[chosen], self.residues[chosen]
        if residuals:
            poles = np.concatenate([poles, self.background_poles])
            residues = np.concatenate([residues, self.background_residues])
        flat = residues.reshape(len(poles), self.measured.size)
        away = s[:, None] - poles
        if not away.all():
            raise FrfError("s", found="a pole", expected="points where the response is finite")
        H = (1 / away) @ flat + (1 / (s[:, None] - poles.conj())) @ flat.conj()
        H *= (s**power)[:, None]
        if residuals:
            H += (s**power)[:, None] * self.upper.ravel()
            if self.lower.any():
                if power < 2 and not s.all():
                    raise FrfError(
                        "freq_hz",
                        found=f"0 Hz, where the lower residual has no {KINDS[power]}",
                        expected="frequencies above 0 Hz",
                        hint="Leave that line out.",
                    )
                H += (s ** float(power - 2))[:, None] * self.lower.ravel()
        return np.asarray(H.reshape(len(s), len(self.outputs), len(self.inputs)))

    def symmetrized(self, how: Side = "average") -> ModalModel:
        """The model made reciprocal: the response of a to a force at b is that of b to a force at a (Maxwell, Betti).

        Pairs of which only one was measured are mirrored from it; pairs whose mirror has no place in the matrix stay.

        Args:
            how: "average" takes the mean of both; "upper" and "lower" take that triangle of the matrix, in the order of
                the outputs, then of those inputs that are no outputs.

        Raises:
            FrfError: `how` is unknown.
        """
        if how not in get_args(Side):
            raise FrfError("how", found=repr(how), expected=f"one of {', '.join(get_args(Side))}")
        dofs = union(self.outputs, self.inputs)
        row = np.array([dofs.index(label) for label in self.outputs])[:, None]
        column = np.array([dofs.index(label) for label in self.inputs])[None, :]
        to_row = np.array([self.outputs.index(x) if x in self.outputs else -1 for x in self.inputs])[None, :]
        to_column = np.array([self.inputs.index(x) if x in self.inputs else -1 for x in self.outputs])[:, None]
        mirrored = (to_row >= 0) & (to_column >= 0)
        there = mirrored & self.measured[to_row, to_column]
        # Weight of a pair's own value; the rest is that of its mirror.
        own = np.full(self.measured.shape, 0.5)
        if how != "average":
            kept = row < column if how == "upper" else row > column
            own = np.where(kept | (row == column), 1.0, 0.0)
        own = np.where(there, np.where(self.measured, own, 0.0), 1.0)

        def made(array: Any) -> Any:
            return own * array + (1 - own) * array[..., to_row, to_column]

        return replace(
            self,
            residues=made(self.residues),
            background_residues=made(self.background_residues),
            lower=made(self.lower),
            upper=made(self.upper),
            measured=self.measured | there,
        )

    def factors(self) -> tuple[Complex, Complex]:
        """Shapes over the outputs, (m, outputs), and participations of the inputs, (m, inputs), with R ≈ ψ Lᵀ.

        The best of rank one in the sense of least squares over the measured pairs; ψ has unit length.
        """
        return rank_one_factors(self.residues, self.measured)

    def rank_one(self) -> ModalModel:
        """The same with every residue matrix replaced by the nearest of rank one, as a single mode has it."""
        shapes, participations = self.factors()
        return replace(self, residues=np.where(self.measured, shapes[:, :, None] * participations[:, None, :], 0))


def union(outputs: Sequence[str], inputs: Sequence[str]) -> tuple[str, ...]:
    """Every degree of freedom once: the outputs, then those inputs that are no outputs."""
    return tuple(dict.fromkeys((*outputs, *inputs)))


def checked_poles(where: str, poles: ArrayLike) -> Complex:
    """The poles as an array of their own.

    Raises:
        SignalError: they are no vector of finite numbers with Im λ > 0, or one comes twice.
    """
    expected = "a vector of poles in rad/s, finite, Im λ > 0"
    try:
        array = np.array(poles, np.complex128)
    except (TypeError, ValueError) as error:
        raise SignalError(where, found=f"{type(poles).__name__} ({error})", expected=expected) from None
    if array.ndim != 1:
        raise SignalError(where, found=f"shape {array.shape}", expected=expected)
    wrong = ~(np.isfinite(array) & (array.imag > 0))
    if wrong.any():
        raise SignalError(where, found=f"{array[np.argmax(wrong)]:.6g}", expected=expected)
    near = np.abs(array[:, None] - array) <= 1e-9 * np.abs(array)
    twice = np.argwhere(np.triu(near, 1))
    if len(twice):
        found = f"{array[twice[0][0]]:.6g} twice"
        raise SignalError(where, found=found, expected="every pole once", hint="Leave one of them out.")
    return array


def rank_one_factors(matrices: Complex, measured: Mask) -> tuple[Complex, Complex]:
    """Vectors x of unit length and y with A ≈ x yᵀ over the measured entries of each matrix, in least squares.

    By the singular value decomposition where all are measured; else from it by alternating least squares, then Gauss
    and Newton's method.

    Args:
        matrices: (m, rows, columns).
        measured: (rows, columns).

    Returns:
        x, (m, rows), and y, (m, columns).
    """
    A = np.where(measured, matrices, 0)
    U, sizes, Vh = np.linalg.svd(A, full_matrices=False)
    x, y = U[:, :, 0], sizes[:, :1] * Vh[:, 0, :]
    if measured.all():
        return x, y
    seen = measured.astype(np.float64)
    # The first singular vectors are zero where no measured pair joins a column to theirs.
    size = np.abs(y)
    y = np.where(size > ARRIVED * size.max(axis=1, keepdims=True), y, size.mean(axis=1, keepdims=True))
    for _ in range(SWEEPS):
        x = _quotient(np.einsum("moi,mi->mo", A, y.conj()), np.abs(y) ** 2 @ seen.T)
        x = _quotient(x, np.linalg.norm(x, axis=1, keepdims=True))
        y = _quotient(np.einsum("moi,mo->mi", A, x.conj()), np.abs(x) ** 2 @ seen)
    row, column = np.nonzero(measured)
    k, count = np.arange(len(row)), len(measured)
    slope = np.zeros((len(row), sum(measured.shape)), np.complex128)
    for r, matrix in enumerate(A):
        both = np.concatenate([x[r], y[r]])
        level = np.sqrt(np.linalg.norm(y[r]))  # rows and columns alike, for the step of least length
        both = both * np.repeat([level, 1 / level if level > 0 else 0], measured.shape)
        for _ in range(POLISH):
            slope[k, row], slope[k, count + column] = both[count + column], both[row]
            step = np.linalg.lstsq(slope, matrix[row, column] - both[row] * both[count + column])[0]
            both = both + step
            if np.linalg.norm(step) <= ARRIVED * np.linalg.norm(both):
                break
        length = np.linalg.norm(both[:count])
        x[r], y[r] = both[:count] / (length or 1.0), both[count:] * length
    return x, y


def _quotient(above: Complex, below: Array) -> Complex:
    return np.asarray(np.divide(above, below, out=np.zeros_like(above), where=below > 0))
