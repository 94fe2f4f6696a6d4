"""Measured modes as data of a fit: frequencies, damping and shapes, where no frequency response exists."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from armonic.errors import ModelError, PostureError, UpdateError
from armonic.modal import Modes, modes
from armonic.synthesis import AXES
from armonic.updating.dense import triangle_of
from armonic.updating.sensitivities import pole_slopes
from armonic.updating.tangent import Course, Tangent

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import LinearModel, Posture
    from armonic.robot import Robot
    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

BLURS = (0.3, 0.0)
"""Blurs of a fit from a bad start, one after the other. With all deviations at 30 % no kind of data overrules the
others while modes are still confused: from starts a factor of 3 off more fits find their way than under the
measurement's own deviations, or where frequencies alone are blurred."""
UNLIKELY = 1e12
"""Added to the cost of a pair with a pole that does not oscillate: such pairs are made where no others are left."""


@dataclass(frozen=True, eq=False)
class ModalMeasurement:
    """Measured modes and where they were taken.

    Args:
        posture: name of the robot's posture, or joint coordinates (rad, m).
        natural_freq_hz: frequencies, (m,), Hz, in any order: natural ones |λ|/2π, or damped ones Im λ/2π with `damped`.
        damping_ratio: fractions, (m,), above 0 and below 1, if known.
        shapes: of every mode the motion of the sensors, (m, frames · outputs), frame by frame; complex, or real as of
            normal modes. Any scale and phase will do: they are fitted.
        frame: of the sensors; one name or several.
        outputs: axes of each frame among x y z rx ry rz.
        freq_deviation: relative standard deviation of the frequencies, of all or of each (m,).
        damping_deviation: of the damping ratios, likewise.
        shape_deviation: of both parts of a shape's entries, as a share of their root mean square.
        damped: whether the frequencies are damped ones.
        label: a name for tables and figures.

    Raises:
        UpdateError: numbers that no modes have, or that do not fit each other.
    """

    posture: Posture
    natural_freq_hz: ArrayLike
    damping_ratio: ArrayLike | None = None
    shapes: ArrayLike | None = field(default=None, repr=False)
    frame: str | Sequence[str] = ()
    outputs: Sequence[str] = ("x", "y", "z")
    freq_deviation: ArrayLike = 0.005
    damping_deviation: ArrayLike = 0.1
    shape_deviation: ArrayLike = 0.05
    damped: bool = False
    label: str = ""

    def __post_init__(self) -> None:
        place = self.posture if isinstance(self.posture, str) else "posture"
        self._set(label=self.label or f"modes at {place}")
        if isinstance(self.frame, str):
            self._set(frame=(self.frame,))
        self._set(frame=self._names("frame"), outputs=self._names("outputs"))
        freq = self._numbers("natural_freq_hz", "positive frequencies in Hz")
        if not freq.size or (freq <= 0).any():
            raise self._fault("natural_freq_hz", f"{freq.min(initial=0):g}", "positive frequencies in Hz, at least one")
        self._set(natural_freq_hz=freq)
        if self.damping_ratio is not None:
            ratio = self._numbers("damping_ratio", "a fraction for every mode", len(self))
            wrong = ratio[(ratio <= 0) | (ratio >= 1)]
            if wrong.size:
                hint = "Percent are hundredths of it." if wrong.max() >= 1 else None
                raise self._fault("damping_ratio", f"{wrong[0]:g}", "fractions above 0 and below 1", hint)
            self._set(damping_ratio=ratio)
        for name in ("freq_deviation", "damping_deviation", "shape_deviation"):
            deviation = self._numbers(name, "a relative standard deviation, or one for every mode", len(self))
            if (deviation <= 0).any():
                raise self._fault(name, f"{deviation.min():g}", "positive relative standard deviations")
            self._set(**{name: deviation})
        if self.shapes is not None:
            self._set(shapes=self._checked_shapes())

    def __len__(self) -> int:
        """Number of modes."""
        return int(np.size(self.natural_freq_hz))

    def _set(self, **values: object) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _fault(self, name: str, found: str, expected: str, hint: str | None = None) -> UpdateError:
        return UpdateError(f"{self.label}: {name}", found=found, expected=expected, hint=hint)

    def _names(self, name: str) -> tuple[str, ...]:
        given: object = getattr(self, name)
        several = tuple(given) if isinstance(given, Iterable) else (given,)
        if not all(isinstance(each, str) for each in several):
            raise self._fault(name, f"a {type(given).__name__} of something else", "names")
        return tuple(each for each in several if each)

    def _numbers(self, name: str, expected: str, length: int | None = None) -> Array:
        """A field as a read-only row of finite numbers; of a given length, a single number is repeated."""
        given = getattr(self, name)
        try:
            values = np.array(given, np.float64) if np.isrealobj(given) else None
        except (TypeError, ValueError):
            values = None
        if values is None:
            raise self._fault(name, f"a {type(given).__name__} of something else", expected)
        if length is not None and values.ndim == 0 and name.endswith("deviation"):
            values = np.full(length, values)
        if values.ndim != 1 or (length is not None and len(values) != length):
            wanted = "a list of numbers" if length is None else f"{length} numbers, as there are frequencies"
            raise self._fault(name, f"shape {values.shape}", wanted)
        if not np.isfinite(values).all():
            raise self._fault(name, "a number that is not finite", expected)
        values.setflags(write=False)
        return values

    def _checked_shapes(self) -> Complex:
        try:
            shapes = np.array(self.shapes, np.complex128)
        except (TypeError, ValueError):
            raise self._fault("shapes", f"a {type(self.shapes).__name__} of something else", "numbers") from None
        unknown = [axis for axis in self.outputs if axis not in AXES]
        if unknown or not self.outputs or len(set(self.outputs)) < len(self.outputs):
            found = ", ".join(map(repr, unknown or self.outputs)) or "none"
            raise self._fault("outputs", found, f"axes among {' '.join(AXES)}, each once")
        if not self.frame:
            raise self._fault("frame", "nothing", "the robot frames the shapes were measured at")
        wanted = (len(self), len(self.frame) * len(self.outputs))
        if shapes.shape != wanted:
            raise self._fault("shapes", f"shape {shapes.shape}", f"shape {wanted}: modes, frames x outputs")
        if wanted[1] < 2:
            raise self._fault("shapes", "one number for each", "two or more: one number alone is only a scale")
        if not np.isfinite(shapes).all() or not shapes.any(axis=1).all():
            raise self._fault("shapes", "a shape that is zero or not finite", "finite shapes other than zero")
        shapes.setflags(write=False)
        return shapes


class ModalResidual:
    """Differences of measured and modelled modes over their standard deviations, and their slopes.

    Of every measured mode: ln f; ln ζ, if it was measured; and of its shape φ the part that no multiple of the model's
    shape ψ reaches, φ/|φ| − α ψ with the best complex α, whose square is 1 − MAC. Measured modes are paired with those
    of the model so that the sum of squares is least. The cost thus is continuous where pairs change, and where the
    fit is right the pairs are.

    Args:
        robot: holds all other numbers.
        measurements: measured modes, in one or more postures.
        parameters: the c coordinates.
        blur: a relative standard deviation that is added to all of the measurement's own; 0 is the fit proper. It evens
            out what frequencies, damping and shapes weigh, as a start far off needs (see `BLURS`).

    Raises:
        UpdateError: a frame that the robot lacks, or more measured modes than the model has.
        PostureError: a posture does not fit the robot.
        ModelError: the model cannot be built.
    """

    def __init__(
        self,
        robot: Robot,
        measurements: ModalMeasurement | Sequence[ModalMeasurement],
        parameters: Sequence[Parameter],
        *,
        blur: float = 0.0,
    ) -> None:
        measurements = [measurements] if isinstance(measurements, ModalMeasurement) else list(measurements)
        self.measurements, self.parameters, self.blur = tuple(measurements), tuple(parameters), blur
        self._course = Course(robot, [m.posture for m in measurements], parameters)
        start = np.array([p.coordinate(p.start) for p in parameters])
        for m, model in zip(measurements, self._course.models(start), strict=True):
            try:
                _watched(m, model)
            except PostureError as error:
                raise UpdateError(
                    f"{m.label}: frame", found=error.found, expected=error.expected, hint=error.hint
                ) from None
            poles = modes(model)
            usable = np.count_nonzero(poles.oscillatory if m.damped else poles.poles != 0)
            if len(m) > usable:
                raise UpdateError(
                    f"{m.label}: natural_freq_hz", found=f"{len(m)} modes", expected=f"at most the model's {usable}"
                )

    def rows(self, x: Array) -> tuple[Array, Array]:
        """Slopes J, (R, c), and residuals r, (R,), each over its standard deviation.

        Raises:
            ArithmeticError: the model has too few modes there, or one without damping where it was measured.
        """
        parts = []
        for m, at in zip(self.measurements, self._course.tangents(x), strict=True):
            found = _modes(at.model)
            pairs = self._pairs(m, at.model, found)
            poles, shapes = pole_slopes(at, found)
            parts.append(self._rows(m, at, found, pairs, poles, shapes))
        J, r = (np.concatenate(side) for side in zip(*parts, strict=True))
        if not (np.isfinite(r).all() and np.isfinite(J).all()):
            raise ArithmeticError("a mode without damping, or two at one pole")
        return J, r

    def triangle(self, x: Array) -> Array:
        """Upper triangle R with RᵀR = [J r]ᵀ[J r], (c+1, c+1).

        Raises:
            ArithmeticError: as `rows`.
        """
        return triangle_of(*self.rows(x))

    def costs(self, X: Array) -> Array:
        """Sum of squares at each of many points, (P, c) to (P,); infinite where the model has no answer."""
        return np.array([self._cost(x) for x in np.asarray(X, float)])

    def pairs(self, x: Array) -> list[NDArray[np.intp]]:
        """Which of the model's modes each measured one is paired with, (m,), one array per measurement.

        Raises:
            ArithmeticError: as `rows`.
        """
        models = self._course.models(x)
        return [self._pairs(m, model, _modes(model)) for m, model in zip(self.measurements, models, strict=True)]

    def _cost(self, x: Array) -> float:
        try:
            total = 0.0
            for m, model in zip(self.measurements, self._course.models(x), strict=True):
                found = _modes(model)
                squares = self._squares(m, model, found)
                total += float(squares[np.arange(len(m)), self._pairs(m, model, found)].sum())
        except ArithmeticError:
            return np.inf
        return total if np.isfinite(total) else np.inf

    def _pairs(self, m: ModalMeasurement, model: LinearModel, found: Modes) -> NDArray[np.intp]:
        squares = self._squares(m, model, found)
        squares = np.where(found.oscillatory, squares, squares + UNLIKELY)
        squares = np.where(np.isfinite(squares), squares, 1e3 * UNLIKELY)
        if squares.shape[0] > squares.shape[1]:
            raise ArithmeticError("more measured modes than the model has")
        return np.asarray(linear_sum_assignment(squares)[1])

    def _squares(self, m: ModalMeasurement, model: LinearModel, found: Modes) -> Array:
        """What every pair of a measured mode and one of the model would cost, (m, modes)."""
        freq, damping = (np.hypot(np.asarray(own), self.blur) for own in (m.freq_deviation, m.damping_deviation))
        with np.errstate(divide="ignore", invalid="ignore"):
            out = (np.log(_frequency(m, found) / _column(m.natural_freq_hz)) / freq[:, None]) ** 2
            if m.damping_ratio is not None:
                out = out + (np.log(found.damping_ratio / _column(m.damping_ratio)) / damping[:, None]) ** 2
        if m.shapes is not None:
            out = out + _unlike(*self._unit(m), _watched(m, model) @ found.shapes)
        return np.where(np.isnan(out), np.inf, out)

    def _rows(
        self, m: ModalMeasurement, at: Tangent, found: Modes, pairs: NDArray[np.intp], poles: Complex, shapes: Complex
    ) -> tuple[Array, Array]:
        freq, damping = (np.hypot(np.asarray(own), self.blur) for own in (m.freq_deviation, m.damping_deviation))
        pole, moved = found.poles[pairs, None], poles[pairs]
        with np.errstate(divide="ignore", invalid="ignore"):
            growth = (moved / pole).real
            r = [np.log(_frequency(m, found)[pairs] / np.asarray(m.natural_freq_hz)) / freq]
            J = [(moved.imag / pole.imag if m.damped else growth) / freq[:, None]]
            if m.damping_ratio is not None:
                r.append(np.log(found.damping_ratio[pairs] / np.asarray(m.damping_ratio)) / damping)
                J.append((moved.real / pole.real - growth) / damping[:, None])
        if m.shapes is not None:
            seen = _watched(m, at.model)
            psi = (seen @ found.shapes[:, pairs]).T
            slopes = np.einsum("kn,nmc->mkc", seen, shapes[:, pairs])
            slopes += np.einsum("ckn,nm->mkc", _watched_slopes(m, at), found.shapes[:, pairs])
            rows, residual = _apart(*self._unit(m), psi, slopes)
            J += [rows.real, rows.imag]
            r += [residual.real, residual.imag]
        return np.concatenate(J), np.concatenate(r)

    def _unit(self, m: ModalMeasurement) -> tuple[Complex, Array]:
        """Measured shapes of length one, (m, K), and the standard deviation of their entries, (m, 1)."""
        shapes = np.asarray(m.shapes)
        shapes = shapes / np.abs(shapes).max(axis=1, keepdims=True)  # squares of any scale fit into a number
        deviation = np.hypot(np.asarray(m.shape_deviation), self.blur) / np.sqrt(shapes.shape[1])
        return shapes / np.linalg.norm(shapes, axis=1, keepdims=True), deviation[:, None]


def _column(values: ArrayLike | None) -> Array:
    return np.asarray(values, float)[:, None]


def _modes(model: LinearModel) -> Modes:
    try:
        return modes(model)
    except ModelError as error:
        raise ArithmeticError(str(error)) from None


def _frequency(m: ModalMeasurement, found: Modes) -> Array:
    return found.damped_freq_hz if m.damped else found.natural_freq_hz


def _watched(m: ModalMeasurement, model: LinearModel) -> Array:
    """Rows of the Jacobians where shapes were measured, (frames · outputs, N)."""
    rows = [AXES.index(axis) for axis in m.outputs]
    return np.concatenate([np.zeros((0, len(model.coordinates))), *(model.jacobian(name)[rows] for name in m.frame)])


def _watched_slopes(m: ModalMeasurement, at: Tangent) -> Array:
    """Their slopes, (c, frames · outputs, N)."""
    rows = [AXES.index(axis) for axis in m.outputs]
    return np.concatenate([at.jacobian(name)[:, rows] for name in m.frame], axis=1)


def _unlike(phi: Complex, deviation: Array, psi: Complex) -> Array:
    """1 − MAC over the variance, of every measured shape and every one of a model (K, modes)."""
    size = np.sum(np.abs(psi) ** 2, axis=0)
    alike = np.divide(np.abs(phi.conj() @ psi) ** 2, size, out=np.zeros((len(phi), len(size))), where=size > 0)
    return np.asarray(np.maximum(1 - alike, 0) / deviation**2)


def _apart(phi: Complex, deviation: Array, psi: Complex, slopes: Complex) -> tuple[Complex, Complex]:
    """Rows αψ − φ of paired shapes, (m·K, c) and (m·K,), with α = ψᴴφ/ψᴴψ and its slope.

    A shape of the model that is zero at the sensors reaches nothing, wherever it moves.
    """
    size = np.sum(np.abs(psi) ** 2, axis=1, keepdims=True)
    size = np.where(size > 0, size, np.inf)
    scale = np.sum(psi.conj() * phi, axis=1, keepdims=True) / size
    by_scale = np.einsum("mkc,mk->mc", slopes.conj(), phi)
    by_scale = by_scale - 2 * scale * np.einsum("mk,mkc->mc", psi.conj(), slopes).real
    J = scale[..., None] * slopes + psi[..., None] * (by_scale / size)[:, None]
    J, r = J / deviation[..., None], (scale * psi - phi) / deviation
    return J.reshape(-1, J.shape[2]), r.ravel()
