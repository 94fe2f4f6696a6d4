"""The task of a fit: measurements, models and parameters, and the residuals that its stages work with."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import UpdateError
from armonic.linear import LinearModel
from armonic.synthesis import system
from armonic.updating.residuals import Anchors, CoreResidual, JointResidual, LawResidual, Scaled
from armonic.updating.smoothing import smoothed, thinned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.robot import Robot
    from armonic.updating.measurement import Measurement
    from armonic.updating.modal_data import ModalMeasurement
    from armonic.updating.parameters import Parameter
    from armonic.updating.residuals import Descending, Residual

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Task:
    """What is fitted to what.

    Attributes:
        robot: holds every number that is not fitted.
        measurements: frequency responses.
        models: the robot at each of them.
        modal: measured modes.
        parameters: the c coordinates.
        anchors: priors.
        relative: whether the cost is of (H_s − H)/H instead of ln H_s − ln H.
    """

    robot: Robot
    measurements: tuple[Measurement, ...]
    models: tuple[LinearModel, ...]
    modal: tuple[ModalMeasurement, ...]
    parameters: tuple[Parameter, ...]
    anchors: Anchors = field(default_factory=Anchors)
    relative: bool = False

    def __post_init__(self) -> None:
        lawful = any(p.law is not None for p in self.parameters)
        if lawful and (self.modal or not self._impedances_alone):
            raise UpdateError(
                "laws",
                found="laws beside measured modes, masses or other numbers",
                expected="stiffness, damping and frequency responses only",
            )

    @property
    def start(self) -> Array:
        """Where x starts, (c,)."""
        return np.array([p.coordinate(p.start) for p in self.parameters])

    @property
    def box(self) -> tuple[Array, Array]:
        """Bounds of x, (c,) each."""
        lower, upper = ([p.coordinate(getattr(p, end)) for p in self.parameters] for end in ("lower", "upper"))
        return np.array(lower), np.array(upper)

    @property
    def in_core(self) -> bool:
        """Whether the core has the whole residual: responses, stiffness and damping alone."""
        return not self.modal and self._impedances_alone and all(p.law is None for p in self.parameters)

    @property
    def _impedances_alone(self) -> bool:
        return all(p.is_impedance or not p.paths for p in self.parameters)

    def values(self, x: Array) -> Array:
        """SI values at x, (c,)."""
        return np.array([p.value(v) for p, v in zip(self.parameters, x, strict=True)])

    def residual(
        self,
        weights: Sequence[Array],
        *,
        sigma: float = 0.0,
        prices: Sequence[Array] | None = None,
        anchored: float = 1.0,
        relative: bool = False,
        blur: float = 0.0,
    ) -> Descending:
        """The residual of all measurements under some weights.

        Args:
            weights: of every value, one array per measurement.
            sigma: compare at s = σ + iω.
            prices: weights of a second cost, told beside the first where the core can.
            anchored: by which modes and priors, whose deviations are known, count beside responses, whose are not.
            relative: (H_s − H)/H instead of ln H_s − ln H.
            blur: relative standard deviation that is added to those of measured modes.

        Raises:
            UpdateError: responses that are not of ordinary size.
        """
        anchors = Anchors(
            self.anchors.indices, self.anchors.means, self.anchors.deviations, anchored * self.anchors.scale
        )
        lawful = any(p.law is not None for p in self.parameters)
        if self.in_core:
            problem = self._problem(range(len(self.models)), weights, sigma, prices or weights, relative=relative)
            return CoreResidual(problem, self._theta, self.parameters, anchors)
        parts: list[Residual] = []
        if lawful:
            for k, model in enumerate(self.models):
                problem = self._problem([k], weights, sigma, weights, relative=relative)
                parts.append(LawResidual(problem, self._theta, self.parameters, model))
        elif self.measurements:
            parts.append(self._dense(weights, sigma, relative=relative))
        if self.modal:
            from armonic.updating.modal_data import ModalResidual

            parts.append(Scaled(ModalResidual(self.robot, self.modal, self.parameters, blur=blur), anchored))
        return JointResidual(parts, anchors)

    @property
    def _theta(self) -> Array:
        return np.concatenate([self.models[0].spring, self.models[0].damper])

    @cached_property
    def bare(self) -> Task:
        """The same task without modes and priors."""
        task = replace(self, modal=(), anchors=Anchors())
        task.__dict__.update({name: self.__dict__[name] for name in ("_systems", "_on_axis") if name in self.__dict__})
        return task

    @cached_property
    def _systems(self) -> tuple[_core.LinearSystem, ...]:
        return tuple(
            system(model, m.frame, m.frf.outputs, m.frf.inputs, input_frame=m.frf.input_frame)
            for m, model in zip(self.measurements, self.models, strict=True)
        )

    @cached_property
    def _on_axis(self) -> tuple[tuple[Complex, Complex, Complex, NDArray[np.intp]], ...]:
        """For each measurement s, receptance and mobility of its lines, and which lines those are.

        The factor (iω)^p of the kind cancels in a log difference, so receptances are compared.
        """
        found = []
        for m in self.measurements:
            power = {"receptance": 0, "mobility": 1, "accelerance": 2}[m.frf.kind]
            points = np.asarray(2j * np.pi * m.frf.freq_hz, np.complex128)
            kept = np.flatnonzero((points != 0) | (power == 0))
            points, values = points[kept], m.frf.values[kept]
            s = points[:, None, None]
            found.append((points, np.asarray(values / s**power), np.asarray(s ** (1 - power) * values), kept))
        return tuple(found)

    def _points(self, k: int, weight: Array, sigma: float) -> tuple[Complex, Complex, NDArray[np.intp]]:
        """Where a measurement is compared, its receptances there, and which of its lines those are."""
        points, receptance, mobility, kept = self._on_axis[k]
        if sigma == 0:
            return points, receptance, kept
        freq_hz = self.measurements[k].frf.freq_hz[kept]
        few = thinned(freq_hz, sigma)
        mobility = smoothed(freq_hz, mobility, sigma, weight[kept] > 0, few)
        points = points[few] + sigma
        return points, np.asarray(mobility / points[:, None, None]), kept[few]

    def _problem(
        self,
        which: Sequence[int] | range,
        weights: Sequence[Array],
        sigma: float,
        prices: Sequence[Array],
        *,
        relative: bool,
    ) -> _core.Problem:
        targets, told = [], []
        for k in which:
            points, values, kept = self._points(k, weights[k], sigma)
            targets.append((self._systems[k], points, values, weights[k][kept]))
            told.append(prices[k][kept])
        try:
            return _core.Problem(targets, prices=told, relative=relative)
        except ValueError as error:
            raise UpdateError(
                "measurements", found=str(error), expected="responses of ordinary size, in SI units"
            ) from None

    def _dense(self, weights: Sequence[Array], sigma: float, *, relative: bool) -> Residual:
        from armonic.updating.dense import DenseResidual

        compared = [self._points(k, weights[k], sigma) for k in range(len(self.measurements))]
        return DenseResidual(
            self.robot,
            self.measurements,
            self.parameters,
            weights=[weight[kept] for weight, (_, _, kept) in zip(weights, compared, strict=True)],
            points=[points for points, _, _ in compared],
            measured=[values for _, values, _ in compared],
            relative=relative,
        )
