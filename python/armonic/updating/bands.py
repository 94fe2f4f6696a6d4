"""A fit's intervals carried on: to frequency responses and modes in any posture, measured or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import UpdateError
from armonic.synthesis import frf
from armonic.updating.sensitivities import frf_sensitivities, pole_sensitivities

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.modal import Modes
    from armonic.response import Frf, Kind
    from armonic.updating.parameters import Parameter
    from armonic.updating.result import Fit

    Array: TypeAlias = NDArray[np.float64]

NORMAL_95 = 1.959963984540054


@dataclass(frozen=True, eq=False)
class FrfBands:
    """A modelled response and the band that holds it with 95 % probability.

    Attributes:
        frf: the fitted model's response.
        low: lower end of the magnitude, (L, p, m), in the response's unit.
        high: upper end, (L, p, m).
        phase_deviation: 95 % half width of the phase, (L, p, m), rad.
    """

    frf: Frf
    low: Array
    high: Array
    phase_deviation: Array


@dataclass(frozen=True, eq=False)
class ModalIntervals:
    """The modes of a fitted robot with 95 % intervals.

    Attributes:
        modes: of the fitted robot.
        natural_freq_hz: (low, high) of each mode, (m, 2).
        damped_freq_hz: likewise; zero of real poles.
        damping_ratio: likewise, fractions.
    """

    modes: Modes
    natural_freq_hz: Array
    damped_freq_hz: Array
    damping_ratio: Array


def predictive_covariance(fit: Fit) -> Array:
    """Covariance of x for predictions, (c, c), finite: what the data leave open, the bounds still hold.

    Every parameter is taken to lie within its bounds with 95 % probability beside what the data say. Where the data
    leave parameters open one by one but know a combination of them, it is the information that says so.

    Args:
        fit: what `armonic.update` returned.
    """
    lower, upper = (np.array([p.coordinate(getattr(p, end)) for p in fit.coordinates]) for end in ("lower", "upper"))
    weak = np.diag((2 * NORMAL_95 / (upper - lower)) ** 2)
    finite = np.isfinite(np.diag(fit.covariance)).all()
    scale = np.sqrt(np.diag(fit.covariance)) if finite else np.ones(len(weak))
    if finite and scale.min() > 0:
        unit = np.outer(scale, scale)
        information = np.linalg.pinv(fit.covariance / unit, hermitian=True) / unit
    else:
        information = fit.information
    total = information + weak
    size = np.sqrt(np.diag(total))
    covariance: Array = np.linalg.inv(total / np.outer(size, size)) / np.outer(size, size)
    return (covariance + covariance.T) / 2


def frf_bands(
    fit: Fit,
    posture: Posture,
    freq_hz: ArrayLike,
    *,
    frame: str | None = None,
    kind: Kind = "accelerance",
    outputs: Iterable[str] = ("x", "y", "z"),
    inputs: Iterable[str] = ("x", "y", "z"),
    input_frame: str | None = None,
) -> FrfBands:
    """95 % bands of a fitted robot's responses in any posture, by linear propagation in ln H.

    var(Re ln H) = g C gᵀ with g = Re ∂ln H/∂x, the phase likewise with the imaginary part.

    Args:
        fit: what `armonic.update` returned.
        posture: a posture's name or joint coordinates; it need not have been measured.
        freq_hz: lines, (L,), Hz.
        frame: where; that of the first measurement if not given.
        kind: receptance, mobility or accelerance.
        outputs: response axes.
        inputs: force axes.
        input_frame: where the force acts, if elsewhere.

    Raises:
        UpdateError: no frame, or a fit with laws.
        PostureError: posture or frame do not fit the robot.
    """
    _refuse_laws(fit)
    where = frame or next((m.frame for m in fit.measurements), None)
    if where is None:
        raise UpdateError("frame", found="nothing", expected=f"one of {', '.join(fit.start.frames)}")
    axes = tuple(outputs), tuple(inputs)
    options = {"frame": where, "outputs": axes[0], "inputs": axes[1], "input_frame": input_frame}
    H = frf(fit.robot, posture, freq_hz, kind=kind, **options)  # type: ignore[arg-type]
    _, D = frf_sensitivities(fit.robot, posture, H.freq_hz, fit.coordinates, **options)  # type: ignore[arg-type]
    C = predictive_covariance(fit)
    half, turn = (NORMAL_95 * np.sqrt(_variance(part, C)) for part in (D.real, D.imag))
    size = np.abs(H.values)
    return FrfBands(H, size * np.exp(-half), size * np.exp(half), turn)


def modal_intervals(fit: Fit, posture: Posture) -> ModalIntervals:
    """Modes of a fitted robot in any posture with 95 % intervals, by linear propagation.

    ∂ln|λ| = Re(∂λ/λ), and with ζ = −Re λ/|λ|: ∂ζ = −Re ∂λ/|λ| − ζ ∂ln|λ|. Frequencies and damping ratios are
    propagated by their logarithms, so that no interval reaches below zero.

    Args:
        fit: what `armonic.update` returned.
        posture: a posture's name or joint coordinates; it need not have been measured.

    Raises:
        UpdateError: a fit with laws.
        PostureError: the posture does not fit the robot.
    """
    _refuse_laws(fit)
    found, slopes = pole_sensitivities(fit.robot, posture, fit.coordinates)
    C = predictive_covariance(fit)
    poles = found.poles[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        natural = np.nan_to_num((slopes / poles).real)
        damped = np.where(found.oscillatory[:, None], np.nan_to_num(slopes.imag / poles.imag), 0.0)
        ratio = found.damping_ratio[:, None]
        damping = np.nan_to_num((-slopes.real / np.abs(poles) - ratio * natural) / ratio)
    damping[~found.oscillatory] = 0.0
    return ModalIntervals(
        found,
        _interval(found.natural_freq_hz, natural, C),
        _interval(np.where(found.oscillatory, found.damped_freq_hz, 0.0), damped, C),
        _interval(found.damping_ratio, damping, C),
    )


def _interval(values: Array, slopes: Array, C: Array) -> Array:
    half = NORMAL_95 * np.sqrt(_variance(slopes, C))
    return np.stack([values * np.exp(-half), values * np.exp(half)], axis=-1)


def _variance(slopes: Array, C: Array) -> Array:
    variance: Array = np.einsum("...i,ij,...j->...", slopes, C, slopes)
    return np.maximum(variance, 0.0)


def _refuse_laws(fit: Fit) -> None:
    parameters: Sequence[Parameter] = fit.coordinates
    if any(p.law is not None for p in parameters):
        raise UpdateError(
            "fit",
            found="a law over postures",
            expected="a fit without laws",
            hint="Take fit.robot_in(posture) for the values there.",
        )
