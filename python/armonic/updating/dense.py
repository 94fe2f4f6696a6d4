"""The residual of a fit, and its slopes, where parameters are more than the stiffness and damping of impedances.

What the core's residual is to those, this is to masses, centres of mass, inertia, gains, shafts and placements: the
matrices of the model themselves change, so every evaluation linearizes the robot anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import ModelError, UpdateError
from armonic.response import KINDS
from armonic.updating.sensitivities import receptances
from armonic.updating.tangent import Course, Tangent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.robot import Robot
    from armonic.updating.measurement import Measurement
    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Points: TypeAlias = NDArray[np.complexfloating[Any, Any]]


def measured_receptances(m: Measurement) -> Complex:
    """A measurement's values over (iω)^p of their kind, (L, p, m); zero at 0 Hz where the kind holds nothing there."""
    power = KINDS.index(m.frf.kind)
    factor = (2j * np.pi * m.frf.freq_hz) ** power
    safe = np.where(factor == 0, 1, factor)
    return np.asarray(np.where(factor == 0, 0, 1 / safe)[:, None, None] * m.frf.values)


class DenseResidual:
    """Σ W |ln H_s − ln H|² over measurements, its rows and their slopes in any numbers of the description.

    The phase difference is taken to its principal value (Huynh et al. 2021, Eq. 22). The factor (iω)^p of the kind
    cancels, so receptances are compared.

    Args:
        robot: holds all other numbers.
        measurements: what was measured.
        parameters: the c coordinates.
        weights: of every value, (L, p, m) for each measurement; values without weight are left out.
        points: where to compare, complex s (L,) for each measurement; s = 2πi f of its lines if not given.
        measured: receptances at those points, (L, p, m) for each; those of the measurement if not given.
        relative: whether the residual is (H_s − H)/H.

    Raises:
        UpdateError: arrays that do not fit, or a weighted value that is zero or not finite.
        PostureError: a posture or frame does not fit the robot.
        ModelError: a model cannot be built.
    """

    def __init__(
        self,
        robot: Robot,
        measurements: Sequence[Measurement],
        parameters: Sequence[Parameter],
        *,
        weights: Sequence[Array],
        points: Sequence[Points] | None = None,
        measured: Sequence[Complex] | None = None,
        relative: bool = False,
    ) -> None:
        points = [m.frf.freq_hz * 2j * np.pi for m in measurements] if points is None else points
        measured = [measured_receptances(m) for m in measurements] if measured is None else measured
        counts = {"measurements": len(measurements), "weights": len(weights), "points": len(points)}
        counts["measured"] = len(measured)
        if len(set(counts.values())) > 1:
            found = ", ".join(f"{count} {name}" for name, count in counts.items())
            raise UpdateError("residual", found=found, expected="one of each per measurement")
        self.parameters, self.relative = tuple(parameters), relative
        self._targets = [_target(*each) for each in zip(measurements, points, measured, weights, strict=True)]
        self._course = Course(robot, [m.posture for m in measurements], parameters)

    def rows(self, x: Array) -> tuple[Array, Array]:
        """Slopes J, (R, c), and residuals r, (R,), times the roots of the weights; all real parts, then all imaginary.

        Raises:
            ArithmeticError: the model has no answer there, or a response without a logarithm.
        """
        J, r = [], []
        for target, at in zip(self._targets, self._course.tangents(x), strict=True):
            H, slopes = _responses(target, at, slopes=True)
            root, ratio = np.sqrt(target.weights), H / target.values
            r.append(root * self._deviation(ratio))
            J.append((root / (target.values if self.relative else H))[:, None] * slopes)
        joined, residual = np.concatenate(J), np.concatenate(r)
        if not (np.isfinite(residual).all() and np.isfinite(joined).all()):
            raise ArithmeticError("response is zero or infinite")
        return np.concatenate([joined.real, joined.imag]), np.concatenate([residual.real, residual.imag])

    def triangle(self, x: Array) -> Array:
        """Upper triangle R with RᵀR = [J r]ᵀ[J r], (c+1, c+1).

        Raises:
            ArithmeticError: as `rows`.
        """
        return triangle_of(*self.rows(x))

    def costs(self, X: Array) -> Array:
        """Sum of squares at each of many points, (P, c) to (P,); infinite where the model has no answer."""
        return np.array([self._cost(x) for x in np.asarray(X, float)])

    def _cost(self, x: Array) -> float:
        total = 0.0
        try:
            for target, model in zip(self._targets, self._course.models(x), strict=True):
                H, _ = _responses(target, Tangent.still(model), slopes=False)
                total += float(target.weights @ np.abs(self._deviation(H / target.values)) ** 2)
        except ArithmeticError:
            return np.inf
        return total if np.isfinite(total) else np.inf

    def _deviation(self, ratio: Complex) -> Complex:
        if self.relative:
            return ratio - 1
        if (ratio == 0).any():
            raise ArithmeticError("response is zero")
        return np.asarray(np.log(ratio))


def triangle_of(J: Array, r: Array) -> Array:
    """Upper triangle R with RᵀR = [J r]ᵀ[J r], (c+1, c+1), also of fewer rows than that."""
    R = np.asarray(np.linalg.qr(np.column_stack([J, r]), mode="r"))
    return np.vstack([R, np.zeros((max(R.shape[1] - len(R), 0), R.shape[1]))])


@dataclass(frozen=True, eq=False)
class _Target:
    """A measurement's weighted values: `used` picks them, flat, from the whole of the lines `points`."""

    measurement: Measurement
    points: Complex
    used: NDArray[np.bool_]
    values: Complex
    weights: Array


def _target(m: Measurement, points: Points, values: Complex, weights: Array) -> _Target:
    s = np.asarray(points, np.complex128)
    values, weights = np.asarray(values, np.complex128), np.asarray(weights, float)
    shape = (s.size, *m.frf.values.shape[1:])
    if s.ndim != 1 or values.shape != shape or weights.shape != shape:
        raise UpdateError(
            m.label,
            found=f"points {s.shape}, responses {values.shape} and weights {weights.shape}",
            expected="(L,), (L, outputs, inputs) and the same",
        )
    if not (np.isfinite(weights).all() and (weights >= 0).all()):
        raise UpdateError(f"{m.label}: weights", found="a negative or non-finite number", expected="zero or more")
    used = weights > 0
    bad = used & ((values == 0) | ~np.isfinite(values))
    if bad.any():
        at = s[int(np.argwhere(bad)[0, 0])]
        raise UpdateError(
            f"{m.label}: s = {at:.4g} rad/s",
            found="a response that is zero or not finite",
            expected="values whose logarithm exists, or no weight",
        )
    kept = used.any(axis=(1, 2))
    return _Target(m, s[kept], used[kept], values[used], weights[used])


def _responses(target: _Target, at: Tangent, *, slopes: bool) -> tuple[Complex, Complex]:
    """The weighted values of the model, (R,), and their slopes, (R, c).

    Raises:
        ArithmeticError: a singular dynamic stiffness.
    """
    m = target.measurement
    try:
        H, by = receptances(at, target.points, m.frame, m.frf.outputs, m.frf.inputs, m.frf.input_frame, slopes=slopes)
    except ModelError as error:
        raise ArithmeticError(str(error)) from None
    return H[target.used], by[target.used]
