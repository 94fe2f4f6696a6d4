"""Modes followed through a stretch of systems: by continuation in the core, by LAPACK where that fails.

A mode is a slot of two poles: a conjugate pair, or two real poles where the pair has met on the real axis; of an odd
number of poles one slot holds a single real one. Slots keep their order, whatever their poles do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from armonic import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.modal import Modes
    from armonic.surveying.systems import Field, Systems
    from armonic.surveying.walk import Indices

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

CONTINUATION, DENSE = 0, 1
ONE = 1e-8
"""Poles closer than this share of their size have no shapes of their own, only a common plane of them."""
FIRST_WINDOW = 8
"""After a fall-back so many systems are tried at first, so that a stretch of failures costs little."""


@dataclass
class State:
    """Modes at one place: poles (m, 2), the second NaN where a slot has one; shapes (m, 2, N), shares (m, 2, n).

    The next place is matched with `known`, (m, 2, N): the shapes, or where poles are equal the last before they were.
    """

    poles: Complex
    shapes: Complex
    shares: Array
    known: Complex

    @property
    def real(self) -> NDArray[np.bool_]:
        """(m,) whether a slot holds real poles."""
        return np.asarray(self.poles[:, 0].imag == 0)


@dataclass
class Stretch:
    """Modes along a stretch of P systems.

    Attributes:
        poles: (P, m, 2), rad/s; of a pair Im > 0 first, of two real poles the one further right.
        shapes: (P, m, N) of the first pole of each slot, scaled to uᴴMu = 1.
        shares: (P, m, n) of each coordinate's springs in the elastic energy.
        mac: (P, m) with the shape before, one at the first; in continuation the least over the parts of a step.
        residual: (P,) the largest over all modes as a share of what is tolerated; NaN from the dense solver.
        method: (P,) `CONTINUATION` or `DENSE`.
    """

    poles: Complex
    shapes: Complex
    shares: NDArray[np.float32]
    mac: Array
    residual: Array
    method: NDArray[np.int8]


def distinct(found: Modes) -> bool:
    """Whether every pole that swings differs from the others, so that its shape is known."""
    poles = found.poles[found.oscillatory]
    return bool((apart(poles[:, None], poles)[np.tril_indices(len(poles), -1)] >= ONE).all())


def follow(
    field: Field, systems: Systems, places: Indices, first: Modes, known: Complex | None = None, *, shares: bool = True
) -> Stretch:
    """All modes at every one of P places, sorted by natural frequency at the first and kept in order from there.

    With `known` the order at the first place is that of these poles.

    Args:
        field: where the dense solver finds the systems.
        systems: the systems at those places.
        places: the places, neighbours following each other, (P,).
        first: modes at the first of them.
        known: the same poles in slots, (m, 2).
        shares: whether energy shares are wanted; without, there are none of any coordinate.

    Raises:
        ModelError: some system has no modes (singular mass matrix).
    """
    count, n = len(places), systems.mass.shape[-1] if shares else 0
    state = _sorted_slots(first, n) if known is None else _slots_of(known, first, n)
    m, _, N = state.shapes.shape
    out = Stretch(
        poles=np.empty((count, m, 2), complex),
        shapes=np.empty((count, m, N), complex),
        shares=np.empty((count, m, n), np.float32),
        mac=np.ones((count, m)),
        residual=np.full(count, np.nan),
        method=np.full(count, DENSE, np.int8),
    )
    _put(out, 0, state)
    here, window = 0, count
    symmetric = field.symmetric
    while True:
        if symmetric:
            stop = min(count, here + 1 + window)
            here, state = _continued(systems[here:stop], field.places, state, out, here)
            if here + 1 == stop and stop < count:
                window *= 2
                continue
        here += 1
        if here >= count:
            return out
        window = FIRST_WINDOW
        state, out.mac[here] = _matched(field.dense(int(places[here])), state)
        _put(out, here, state)


def _put(out: Stretch, i: int, state: State) -> None:
    out.poles[i], out.shapes[i], out.shares[i] = state.poles, state.shapes[:, 0], state.shares[:, 0]


def _continued(systems: Systems, places: list[int], state: State, out: Stretch, here: int) -> tuple[int, State]:
    """Follow the modes at `here` through the systems that begin there; the last place reached, and its modes.

    The modes at `here` are polished first; where even that fails they stay as they are.
    """
    there = ~np.isnan(state.poles) & (np.arange(2) < np.where(state.real, 2, 1)[:, None])
    slot, which = np.nonzero(there)
    poles, shapes, shares, residual, mac = _core.follow(
        systems.mass,
        systems.damping,
        systems.stiffness,
        systems.drives,
        places,
        systems.springs if state.shares.shape[2] else systems.springs[:0],
        state.poles[there],
        np.ascontiguousarray(state.shapes[there][:, : systems.mass.shape[-1]]),
    )
    reached = len(poles)
    if reached == 0:
        return here, state
    rows = slice(here, here + reached)
    out.residual[rows] = residual
    out.method[here + 1 : here + reached] = CONTINUATION
    if here == 0:
        out.method[0] = CONTINUATION
    # Without real pairs every slot has one track, and the arrays of the core serve as they are.
    own = slice(None) if not state.real.any() else np.flatnonzero(which == 0)
    out.poles[rows, :, 0] = poles[:, own]
    if reached == len(out.poles):
        out.shapes, out.shares = shapes[:, own], shares[:, own]
    else:
        out.shapes[rows], out.shares[rows] = shapes[:, own], shares[:, own]
    out.mac[here + 1 : here + reached] = mac[1:, own]
    out.poles[rows, :, 1] = out.poles[rows, :, 0].conj()
    out.poles[rows, state.real, 1] = np.nan
    for track in np.flatnonzero(which == 1):
        k, partner = slot[track], poles[:, track]
        ahead = partner.real > out.poles[rows, k, 0].real
        out.poles[rows, k, 1] = np.where(ahead, out.poles[rows, k, 0], partner)
        out.poles[rows, k, 0] = np.where(ahead, partner, out.poles[rows, k, 0])
        out.shapes[rows, k] = np.where(ahead[:, None], shapes[:, track], out.shapes[rows, k])
        out.shares[rows, k] = np.where(ahead[:, None], shares[:, track], out.shares[rows, k])
    last = _empty(len(state.poles), state.shapes.shape[2], state.shares.shape[2])
    last.poles[there], last.shapes[there], last.shares[there] = poles[-1], shapes[-1], shares[-1]
    last.poles[~state.real, 1] = last.poles[~state.real, 0].conj()
    _rightmost_first(last)
    last.known = last.shapes
    return here + reached - 1, last


def _rightmost_first(state: State) -> None:
    turned = state.real & (state.poles[:, 1].real > state.poles[:, 0].real)
    state.poles[turned] = state.poles[turned, ::-1]
    state.shapes[turned] = state.shapes[turned, ::-1]
    state.shares[turned] = state.shares[turned, ::-1]


@dataclass(frozen=True)
class _Found:
    """Poles of the dense solver with their shapes (k, N) and shares (k, n)."""

    poles: Complex
    shapes: Complex
    shares: Array


def _split(found: Modes, n: int) -> tuple[_Found, _Found]:
    """Poles above the real axis, and those on it from slow to fast."""
    real = np.flatnonzero(~found.oscillatory)
    real = real[np.argsort(np.abs(found.poles[real]), kind="stable")]
    parts = (np.flatnonzero(found.oscillatory), real)
    return tuple(_Found(found.poles[i], found.shapes.T[i], found.participation.T[i, :n]) for i in parts)  # type: ignore[return-value]


def _empty(m: int, N: int, n: int) -> State:
    shapes = np.zeros((m, 2, N), complex)
    return State(np.full((m, 2), np.nan + 0j), shapes, np.zeros((m, 2, n)), shapes)


def _fill(state: State, slot: Any, which: Any, found: _Found, chosen: Any) -> None:
    state.poles[slot, which] = found.poles[chosen]
    state.shapes[slot, which] = found.shapes[chosen]
    state.shares[slot, which] = found.shares[chosen]


def _sorted_slots(found: Modes, n: int) -> State:
    """Slots sorted by natural frequency; real poles whose shapes are most alike share a slot, two by two."""
    pairs, reals = _split(found, n)
    k, r = len(pairs.poles), len(reals.poles)
    state = _empty(k + (r + 1) // 2, found.shapes.shape[0], n)
    _fill(state, np.arange(k), 0, pairs, np.arange(k))
    state.poles[:k, 1] = pairs.poles.conj()
    chosen = _couples(_alike(reals.shapes, found.mass, reals.shapes))
    _fill(state, k + np.arange(r) // 2, np.arange(r) % 2, reals, chosen)
    _rightmost_first(state)
    order = np.argsort(np.abs(state.poles[:, 0]), kind="stable")
    return State(state.poles[order], state.shapes[order], state.shares[order], state.shapes[order])


def _slots_of(known: Complex, found: Modes, n: int) -> State:
    """The modes in the slots of poles (m, 2) that are known to be the same."""
    before = _empty(len(known), found.shapes.shape[0], n)
    before.poles = known
    state, _ = _matched(found, before)
    state.known = state.shapes
    return state


def _couples(alike: Array) -> list[int]:
    """An order of r real poles in which neighbours two by two are the most alike; if equally so, from the slowest.

    The poles of an oscillator that is damped too much to swing have one shape.
    """
    rest, order = list(range(len(alike))), list[int]()
    likeness = np.round(np.triu(alike, 1), 6)
    while len(rest) > 1:
        i, j = divmod(int(np.argmax(likeness[np.ix_(rest, rest)])), len(rest))
        order += [rest[i], rest[max(j, i + 1)]]
        rest = [k for k in rest if k not in order]
    return order + rest


def _matched(found: Modes, before: State) -> tuple[State, Array]:
    """Modes of the dense solver in the slots that they continue: pairs first, real poles in the slots that are left.

    With them comes the modal assurance criterion with the shapes before, (m,).
    """
    m, n = len(before.poles), before.shares.shape[2]
    pairs, reals = _split(found, n)
    state = _empty(m, before.shapes.shape[2], n)
    # A slot of real poles meets the axis half way between them.
    middle = np.where(before.real, np.nanmean(before.poles, axis=1), before.poles[:, 0])
    alike = _alike(before.known, found.mass, pairs.shapes).max(axis=1)
    # Of equal poles any shapes in their plane may have been found.
    alike = alike @ (apart(pairs.poles[:, None], pairs.poles) < ONE)
    cost = apart(middle[:, None], pairs.poles) + 0.5 * (1.0 - alike)
    slots, chosen = linear_sum_assignment(cost)
    _fill(state, slots, 0, pairs, chosen)
    state.poles[slots, 1] = pairs.poles[chosen].conj()
    left = np.setdiff1d(np.arange(m), slots)
    if left.size:
        slot, which = np.repeat(left, 2), np.tile([0, 1], left.size)
        wanted = np.where(before.real[slot], before.poles[slot, which], before.poles[slot, 0].real)
        alike = _alike(before.known, found.mass, reals.shapes)[slot, np.where(before.real[slot], which, 0)]
        # A slot with one pole wants nothing in its second place.
        cost = np.where(np.isnan(wanted)[:, None], 2.0, apart(wanted[:, None], reals.poles) + 0.5 * (1.0 - alike))
        places, chosen = linear_sum_assignment(cost)
        _fill(state, slot[places], which[places], reals, chosen)
        for k in left[np.isnan(state.poles[left, 0])]:
            for values in (state.poles, state.shapes, state.shares):
                values[k] = values[k, ::-1].copy()
    _rightmost_first(state)
    same = apart(state.poles[:, :1], state.poles[:, 0]) < ONE
    likeness = (_alike(before.known, found.mass, state.shapes[:, 0])[:, 0] * same).sum(axis=1)
    state.known = np.where((same.sum(axis=1) > 1)[:, None, None], before.known, state.shapes)
    return state, np.minimum(likeness, 1.0)


def _alike(shapes: Complex, mass: Array, others: Complex) -> Array:
    """Modal assurance criterion of shapes (..., N) with others (k, N) of length one, (..., k)."""
    momenta = shapes.conj() @ mass
    size = np.sum(momenta * shapes, axis=-1).real
    return np.asarray(np.abs(momenta @ others.T) ** 2 / np.where(size > 0, size, 1.0)[..., None])


def apart(a: Complex, b: Complex) -> Array:
    """Distance of poles relative to their size, between 0 and 1."""
    size = np.abs(a) + np.abs(b)
    return np.asarray(np.abs(a - b) / np.where(size > 0, size, 1.0))
