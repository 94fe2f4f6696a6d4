"""A fit's intervals carried on: to frequency responses and modes in any posture, measured or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import ArmonicError, ModelError, UpdateError
from armonic.linear import linearize
from armonic.modal import modes
from armonic.synthesis import frf
from armonic.updating.information import Outlook
from armonic.updating.sensitivities import pole_slopes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.modal import Modes
    from armonic.response import Frf, Kind
    from armonic.updating.result import Fit
    from armonic.updating.tangent import Tangent

    Array: TypeAlias = NDArray[np.float64]
    Truths: TypeAlias = NDArray[np.bool_]

NORMAL_95 = 1.959963984540054
BLIND = 1e-18
"""Information on a parameter below this share of the largest is what rounding leaves of none."""
FARTHEST = 300.0
"""A logarithm beyond this is infinite to all purposes, and its exponential nearly so to the computer."""


@dataclass(frozen=True, eq=False)
class FrfBands:
    """A modelled response and the band that holds it with 95 % probability.

    Attributes:
        frf: the fitted model's response.
        low: lower end of the magnitude, (L, p, m), in the response's unit.
        high: upper end, (L, p, m).
        phase_deviation: 95 % half width of the phase, (L, p, m), rad.
        open: where the band is held by the bounds of the parameters rather than by the data, (L, p, m).
    """

    frf: Frf
    low: Array
    high: Array
    phase_deviation: Array
    open: Truths


@dataclass(frozen=True, eq=False)
class ModalIntervals:
    """The modes of a fitted robot with 95 % intervals.

    Attributes:
        modes: of the fitted robot.
        natural_freq_hz: (low, high) of each mode, (m, 2).
        damped_freq_hz: likewise; zero of real poles.
        damping_ratio: likewise, fractions.
        open: whether natural frequency and damping ratio of each mode are held by the bounds of the parameters rather
            than by the data, (m, 2).
    """

    modes: Modes
    natural_freq_hz: Array
    damped_freq_hz: Array
    damping_ratio: Array
    open: Truths


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is known of x for predictions.

    Attributes:
        covariance: of x, (c, c), finite: the data's, with every parameter within its bounds.
        bounds: information of those bounds, (c,).
        reach: half a 95 % interval in standard deviations.
    """

    covariance: Array
    bounds: Array
    reach: float = NORMAL_95

    def half(self, slopes: Array) -> tuple[Array, Truths]:
        """Half 95 % intervals (...) of what has these slopes (..., c), and whether they are open.

        With the information F of the data and P of the bounds the variance gᵀCg, C = (F + P)⁻¹, is the sum of gᵀCFCg
        and gᵀCPCg. Where the second is the larger one the data set no end.
        """
        root = slopes @ self.covariance
        variance = np.maximum((root * slopes).sum(axis=-1), 0.0)
        held = (root**2 * self.bounds).sum(axis=-1)
        return self.reach * np.sqrt(variance), np.asarray(held > 0.5 * variance)


def predictive_covariance(fit: Fit) -> Array:
    """Covariance of x for predictions, (c, c), finite: what the data leave open, the bounds still hold.

    Every parameter is taken to lie within its bounds with 95 % probability beside what the data say, as plans take it.
    Where the data leave parameters open one by one but know a combination of them, it is the information that says so;
    it is then taken to be as many times less certain as it is for the other parameters under the weights of the fit.

    Args:
        fit: what `armonic.update` returned.
    """
    return _prediction(fit).covariance


def _prediction(fit: Fit) -> Prediction:
    lower, upper = (np.array([p.coordinate(getattr(p, end)) for p in fit.coordinates]) for end in ("lower", "upper"))
    reach = student(fit)
    weak = (2 * (reach or NORMAL_95) / (upper - lower)) ** 2
    if reach is None:  # as many parameters as data: nothing tells the noise
        return Prediction(np.diag(1 / weak), weak)
    if not np.isfinite(fit.information).all():  # data without any noise at all
        return Prediction(np.zeros((len(weak), len(weak))), weak)
    told = np.diag(fit.information)
    some = np.flatnonzero(told > BLIND * told.max(initial=0.0))
    total = np.diag(weak)
    if len(some):
        inner = np.ix_(some, some)
        total[inner] += _precision(fit.covariance[inner], fit.information[inner], weak[some])
    return Prediction(_inverse(total), weak, reach)


def student(fit: Fit) -> float | None:
    """Half a 95 % interval in standard deviations, as the fit's own intervals have it; None if they have no end."""
    known = [(f.deviation, f, p) for f, p in zip(fit.parameters, fit.coordinates, strict=True) if f.deviation > 0]
    if not known:
        return NORMAL_95
    deviation, f, p = min(known, key=lambda entry: entry[0])
    if not np.isfinite(f.interval[1]):
        return None if deviation < 1 else NORMAL_95
    return abs(p.coordinate(f.interval[1]) - p.coordinate(f.value)) / deviation


def _precision(covariance: Array, information: Array, weak: Array) -> Array:
    """Information of the data as the fit weighted them, (s, s)."""
    spread = np.sqrt(np.diag(covariance))
    finite = np.isfinite(spread) & (spread > 0)
    if finite.all():
        unit = np.outer(spread, spread)
        return np.asarray(np.linalg.pinv(covariance / unit, hermitian=True) / unit)
    best = np.sqrt(np.diag(_inverse(information + np.diag(weak))))
    loss = float(np.max(spread[finite] / best[finite], initial=1.0))
    return np.asarray(information / loss**2)


def _inverse(matrix: Array) -> Array:
    """Of a positive definite matrix, by way of a unit diagonal."""
    size = np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)
    return np.asarray((inverse + inverse.T) / 2)


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

    var(Re ln H) = g C gᵀ with g = Re ∂ln H/∂x and C the covariance of the fit, the phase likewise with the imaginary
    part. Where the data leave a parameter open, its bounds hold the band (see `FrfBands.open`). A band speaks of the
    parameters alone, not of what the model may lack, and not of noise that a further measurement has.

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
        UpdateError: no frame.
        FrfError: lines or axes are not valid.
        PostureError: posture or frame do not fit the robot.
        ModelError: the model has no response on a line, or a law does not hold in that posture.
    """
    where = frame or next((m.frame for m in fit.measurements), None)
    if where is None:
        raise UpdateError("frame", found="nothing", expected=f"one of {', '.join(fit.start.frames)}")
    out, into = tuple(outputs), tuple(inputs)
    place = _place(fit, posture)
    H = frf(place[0].model, None, freq_hz, frame=where, kind=kind, outputs=out, inputs=into, input_frame=input_frame)
    _, D, _ = Outlook.seen(place, H.freq_hz, where, out, into, input_frame)
    known = _prediction(fit)
    (half, is_open), (turn, _) = (known.half(part) for part in (D.real, D.imag))
    size, factor = np.abs(H.values), np.exp(np.minimum(half, FARTHEST))
    return FrfBands(H, size / factor, size * factor, turn, is_open)


def modal_intervals(fit: Fit, posture: Posture) -> ModalIntervals:
    """Modes of a fitted robot in any posture with 95 % intervals, by linear propagation.

    ∂ln|λ| = Re(∂λ/λ), and with ζ = −Re λ/|λ|: ∂ζ = −Re ∂λ/|λ| − ζ ∂ln|λ|. Frequencies and damping ratios are
    propagated by their logarithms, so that no interval reaches below zero.

    Args:
        fit: what `armonic.update` returned.
        posture: a posture's name or joint coordinates; it need not have been measured.

    Raises:
        PostureError: the posture does not fit the robot.
        ModelError: a law does not hold in that posture.
    """
    at, chain = _place(fit, posture)
    found = modes(at.model)
    slopes = pole_slopes(at, found)[0] @ chain
    poles, ratio, pairs = found.poles[:, None], found.damping_ratio[:, None], found.oscillatory[:, None]
    zero = np.zeros_like(slopes.real)

    def over(numerator: Array, denominator: Array, where: Truths) -> Array:
        return np.divide(numerator, denominator, out=zero.copy(), where=where & (denominator != 0))

    natural = over((slopes * poles.conj()).real, np.abs(poles) ** 2, poles != 0)
    damped = over(slopes.imag, poles.imag, pairs)
    damping = over(-slopes.real - ratio * np.abs(poles) * natural, ratio * np.abs(poles), pairs)
    known = _prediction(fit)
    (wide, loose), (turning, _), (losing, lossy) = (known.half(part) for part in (natural, damped, damping))
    return ModalIntervals(
        modes=found,
        natural_freq_hz=_interval(found.natural_freq_hz, wide),
        damped_freq_hz=_interval(np.where(found.oscillatory, found.damped_freq_hz, 0.0), turning),
        damping_ratio=_interval(found.damping_ratio, losing),
        open=np.stack([loose, lossy], axis=-1),
    )


def intervals_after(fit: Fit, index: int) -> ModalIntervals | None:
    """Intervals of the modes `fit.after[index]`; None if its posture is not one of the measurements'.

    Args:
        fit: what `armonic.update` returned.
        index: among `fit.postures`.
    """
    everywhere: list[Posture] = [m.posture for m in fit.measurements]
    everywhere += [m.posture for m in fit.modal_measurements]
    for posture in everywhere:
        if linearize(fit.start, posture).posture == fit.postures[index]:
            try:
                found = modal_intervals(fit, posture)
            except ArmonicError:
                return None
            return found if len(found.modes) == len(fit.after[index]) else None
    return None


def _interval(values: Array, half: Array) -> Array:
    """(low, high) of values known to a logarithm, (m, 2); of negative ones, as the damping of what is unstable, too."""
    factor = np.exp(np.minimum(half, FARTHEST))
    return np.sort(np.stack([values / factor, values * factor], axis=-1), axis=-1)


def _place(fit: Fit, posture: Posture) -> tuple[Tangent, Array]:
    """The fitted model in a posture with its slopes, as its laws have it there.

    Raises:
        PostureError: the posture does not fit the robot.
        ModelError: the model cannot be built, or a law has no positive stiffness.
    """
    values = np.array([p.value for p in fit.parameters])
    try:
        return Outlook(fit.start, fit.coordinates, values).at(posture)
    except ArithmeticError as error:
        raise ModelError("law", found=str(error), expected="a posture where it holds") from None
