"""Stabilization: every pole of every model order beside its partner of the order before, and which of them hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.identification.poles import damping_ratio, natural_freq_hz
from armonic.identification.shape_criteria import (
    STANDSTILL,
    mac_rows,
    mean_phase_deviation_deg,
    modal_phase_collinearity,
    omac_rows,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.identification.poles import ModelPoles

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Indices: TypeAlias = NDArray[np.intp]

BLOCK = 32
"""Poles that are compared at once with all of the order before."""


@dataclass(frozen=True)
class Criteria:
    """What a pole must fulfil to count as stable; None switches a criterion off.

    Phase collinearity and phase deviation are off: a drive under control damps a robot far from proportionally, so that
    true modes are complex.

    Args:
        freq_tolerance: largest change of the natural frequency against the partner, as a share of the larger one.
        damping_tolerance: largest change of the damping ratio, likewise.
        mac: least modal assurance criterion with the partner.
        omac: least order modal assurance criterion with the partner.
        mpc: least modal phase collinearity.
        mpd_deg: largest mean phase deviation, in degrees.
        damping_range: damping ratios that are believed, ends excluded.
        freq_range_hz: natural frequencies that are looked at, ends included.

    Raises:
        SignalError: a limit is not a number, is negative, or can be met by no pole.
    """

    freq_tolerance: float | None = 0.01
    damping_tolerance: float | None = 0.05
    mac: float | None = 0.95
    omac: float | None = 0.9
    mpc: float | None = None
    mpd_deg: float | None = None
    damping_range: tuple[float, float] | None = (0.0, 0.999)
    freq_range_hz: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, least, most in (
            ("freq_tolerance", 0.0, np.inf),
            ("damping_tolerance", 0.0, np.inf),
            ("mac", 0.0, 1.0),
            ("omac", 0.0, 1.0),
            ("mpc", 0.0, 1.0),
            ("mpd_deg", 0.0, 90.0),
        ):
            value = getattr(self, name)
            if not (value is None or least <= value <= most):
                expected = f"a number from {least:g} to {most:g}, or None" if np.isfinite(most) else "one of at least 0"
                raise SignalError(f"Criteria.{name}", found=repr(value), expected=expected)
        for name in ("damping_range", "freq_range_hz"):
            value = getattr(self, name)
            if not (value is None or (len(value) == 2 and value[0] < value[1])):
                raise SignalError(
                    f"Criteria.{name}", found=repr(value), expected="(low, high) with low < high, or None"
                )


@dataclass(frozen=True, eq=False, repr=False)
class Stabilization:
    """All P poles of all model orders, one after another, with what was measured of each; arrays are read-only.

    Changes and assurance criteria compare a pole with its partner: the pole of the order before that is nearest by
    |λ − λ'| / |λ| + 1 − MAC. They are NaN in the first order.

    Attributes:
        orders: the model orders, ascending.
        order: model order of each pole, (P,).
        pole: λ, (P,), rad/s.
        natural_freq_hz: |λ| / 2π, (P,).
        damping_ratio: −Re λ / |λ|, (P,), a fraction.
        shape: by rows, (P, m); NaN where none was computed.
        partner: index of the partner, (P,); −1 where there is none.
        freq_change: |f − f'| / max(f, f'), (P,).
        damping_change: |ζ − ζ'| / max(|ζ|, |ζ'|), (P,).
        mac: with the partner, (P,).
        omac: with the partner, (P,); see `shape_criteria.omac_rows`.
        mpc: modal phase collinearity, (P,).
        mpd_deg: mean phase deviation, (P,), degrees.
        freq_std_hz: standard deviation of the frequency as the method states it, (P,); NaN where it does not.
        damping_std: that of the damping ratio, (P,).
        stable: whether the pole meets all criteria, (P,); never without a partner.
        criteria: the ones used.
    """

    orders: tuple[int, ...]
    order: Indices
    pole: Complex
    natural_freq_hz: Array
    damping_ratio: Array
    shape: Complex
    partner: Indices
    freq_change: Array
    damping_change: Array
    mac: Array
    omac: Array
    mpc: Array
    mpd_deg: Array
    freq_std_hz: Array
    damping_std: Array
    stable: NDArray[np.bool_]
    criteria: Criteria

    def __len__(self) -> int:
        """Number of poles."""
        return len(self.pole)

    def __repr__(self) -> str:
        """Orders, poles, and how many of them are stable, in one line."""
        span = f"orders {self.orders[0]} to {self.orders[-1]}"
        return f"Stabilization({span}, {len(self)} poles, {int(self.stable.sum())} stable)"


def stabilize(models: Sequence[ModelPoles], criteria: Criteria | None = None) -> Stabilization:
    """Compares every pole with the order before and says which are stable (Reynders, Houbrechts & De Roeck 2012).

    These are the single-mode criteria that Do et al. 2022, section 4.3, draw their stabilization diagrams with. Poles
    may come from any method. A pole without a shape counts as unlike every other in shape, so it is never stable while
    a criterion on shapes is on.

    Args:
        models: poles of each model order, orders ascending, all over the same channels.
        criteria: limits; their defaults if not given.

    Raises:
        SignalError: no models, orders that do not ascend, arrays that do not fit each other, or a pole that is not
            finite.
    """
    limits = criteria or Criteria()
    _check(models)
    pole = np.concatenate([model.poles for model in models]).astype(np.complex128)
    shape = np.concatenate([model.shapes for model in models]).astype(np.complex128)
    starts = np.concatenate([[0], np.cumsum([len(model.poles) for model in models])]).astype(np.intp)
    partner, unit = np.full(len(pole), -1, np.intp), _unit(shape)
    for first, middle, last in zip(starts, starts[1:], starts[2:], strict=False):
        if first < middle < last:
            nearest = _nearest(pole[middle:last], unit[middle:last], pole[first:middle], unit[first:middle])
            partner[middle:last] = first + nearest
    freq, damping = natural_freq_hz(pole), damping_ratio(pole)
    paired = partner >= 0
    own, other = np.flatnonzero(paired), partner[paired]
    columns = {
        "freq_change": _change(freq[own], freq[other]),
        "damping_change": _change(damping[own], damping[other]),
        "mac": mac_rows(shape[own], shape[other]),
        "omac": omac_rows(pole[own], shape[own], pole[other], shape[other]),
    }
    measured = {name: _spread(values, own, len(pole)) for name, values in columns.items()}
    measured |= {"mpc": modal_phase_collinearity(shape), "mpd_deg": mean_phase_deviation_deg(shape)}
    result = Stabilization(
        orders=tuple(int(model.order) for model in models),
        order=np.repeat([model.order for model in models], np.diff(starts)).astype(np.intp),
        pole=pole,
        natural_freq_hz=freq,
        damping_ratio=damping,
        shape=shape,
        partner=partner,
        freq_std_hz=_stated([(model.freq_std_hz, len(model.poles)) for model in models]),
        damping_std=_stated([(model.damping_std, len(model.poles)) for model in models]),
        stable=paired & _meets(limits, freq, damping, measured),
        criteria=limits,
        **measured,
    )
    for value in vars(result).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return result


def _check(models: Sequence[ModelPoles]) -> None:
    if not models:
        raise SignalError("models", found="none", expected="the poles of at least one model order")
    channels = models[0].shapes.shape[-1]
    for i, model in enumerate(models):
        where, k = f"models[{i}] (order {model.order})", len(model.poles)
        if i and model.order <= models[i - 1].order:
            raise SignalError(where, found=f"after order {models[i - 1].order}", expected="ascending model orders")
        if model.shapes.shape != (k, channels):
            found = f"shapes {model.shapes.shape} of {k} poles"
            raise SignalError(where, found=found, expected=f"shapes ({k}, {channels})")
        for name in ("freq_std_hz", "damping_std"):
            stated = getattr(model, name)
            if stated is not None and stated.shape != (k,):
                raise SignalError(f"{where}.{name}", found=f"shape {stated.shape}", expected=f"shape ({k},), or None")
        if not np.isfinite(model.poles).all():
            worst = int(np.argmin(np.isfinite(model.poles)))
            raise SignalError(where, found=f"pole {worst} not finite", expected="finite poles in rad/s")


def _nearest(poles: Complex, units: Complex, before: Complex, units_before: Complex) -> Indices:
    """Index of the nearest pole of the order before, by |λ − λ'| / |λ| + 1 − MAC, for shapes of unit length or zero."""
    nearest = np.empty(len(poles), np.intp)
    size = np.maximum(np.abs(poles), STANDSTILL)
    own, other = np.hstack([units.real, units.imag]), np.hstack([units_before.real, units_before.imag])
    turned = np.hstack([units_before.imag, -units_before.real])
    # Blocks of rows, worked on in place, stay in the cache and below what BLAS splits over threads: twice as fast.
    for start in range(0, len(poles), BLOCK):
        rows = slice(start, start + BLOCK)
        distance = _squared(np.subtract.outer(poles.real[rows], before.real))
        distance += _squared(np.subtract.outer(poles.imag[rows], before.imag))
        np.sqrt(distance, out=distance)
        distance /= size[rows, None]
        for side in (other, turned):
            distance -= _squared(own[rows] @ side.T)
        nearest[rows] = np.argmin(distance, axis=1)
    return nearest


def _squared(values: Array) -> Array:
    """The squares, in place."""
    values *= values
    return values


def _unit(shapes: Complex) -> Complex:
    """Shapes by rows at unit length; zero where one is not known, which makes its MAC zero."""
    known = np.where(np.isfinite(shapes).all(axis=1, keepdims=True), shapes, 0.0)
    length = np.linalg.norm(known, axis=1, keepdims=True)
    return np.asarray(np.divide(known, length, out=np.zeros_like(known), where=length > 0))


def _change(a: Array, b: Array) -> Array:
    size = np.maximum(np.abs(a), np.abs(b))
    return np.divide(np.abs(a - b), size, out=np.zeros(size.shape), where=size > 0)


def _spread(values: Array, where: Indices, length: int) -> Array:
    """The values at their places, NaN elsewhere."""
    whole = np.full(length, np.nan)
    whole[where] = values
    return whole


def _stated(parts: list[tuple[Array | None, int]]) -> Array:
    return np.concatenate([np.full(count, np.nan) if part is None else part for part, count in parts])


def _meets(limits: Criteria, freq: Array, damping: Array, measured: dict[str, Array]) -> NDArray[np.bool_]:
    """Which poles meet every criterion that is on; a value that is not known meets none."""
    ok = np.ones(len(freq), bool)
    for name, limit in (("freq_change", limits.freq_tolerance), ("damping_change", limits.damping_tolerance),
                        ("mpd_deg", limits.mpd_deg)):  # fmt: skip
        if limit is not None:
            ok &= measured[name] <= limit
    for name, limit in (("mac", limits.mac), ("omac", limits.omac), ("mpc", limits.mpc)):
        if limit is not None:
            ok &= measured[name] >= limit
    if limits.damping_range is not None:
        ok &= (damping > limits.damping_range[0]) & (damping < limits.damping_range[1])
    if limits.freq_range_hz is not None:
        ok &= (freq >= limits.freq_range_hz[0]) & (freq <= limits.freq_range_hz[1])
    return ok
