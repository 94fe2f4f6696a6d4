"""Which combinations of parameters the data determine, from stiff to sloppy, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.text import format_percent, format_si, listing, parameter_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.updating.parameters import Parameter
    from armonic.updating.result import Fit

    Array: TypeAlias = NDArray[np.float64]

UNSEEN = 1e-13
"""An eigenvalue of the information, scaled to a unit diagonal, below this is what rounding leaves of none."""
BLIND = 1e-9
"""A parameter with less than this share of the largest root of information is not seen at all."""
LEADING = 0.35
"""Parameters with less than this share of the largest weight are not named."""
NAMED = 4
ALONE = 0.9
"""A parameter with this share of a direction's square is the direction."""
NORMAL_95 = 1.959963984540054
KNOWN_FACTOR = 1.25
"""What lies within this factor is known, not open."""
OPEN_FACTOR = 1e4
"""What is open by more than this is open altogether."""
MUCH_BETTER = 4.0
"""A combination is worth a word if it is known so many times better than what it is made of."""
PLAIN = 1.5
"""A product or ratio stands for a direction if it is known at most so many times worse than the direction itself."""


@dataclass(frozen=True, eq=False)
class Direction:
    """One principal direction of what a fit knows.

    Attributes:
        deviation: standard deviation of x along it; infinite if the data do not see it.
        weights: the unit direction in x, (c,), its largest entry positive.
        words: which parameters it is made of, how far it is open, and what of them is known nevertheless.
    """

    deviation: float
    weights: Array
    words: str


def directions(fit: Fit) -> tuple[Direction, ...]:
    """The principal directions of a fit's information, from the best determined to the least.

    Stiff ones have a small deviation: whatever the parameters are, this combination of them is known. Along sloppy ones
    parameters may change together without the data noticing (Gutenkunst et al., *Universally sloppy parameter
    sensitivities in systems biology models*, PLoS Computational Biology 2007). Under equal weights; a fit that
    emphasizes peaks knows somewhat less.

    Args:
        fit: what `armonic.update` returned.
    """
    roots, seen, blind = _principal(np.asarray(fit.information, float))
    found = [*zip(roots, seen.T, strict=True), *((np.inf, column) for column in blind.T)]
    known = seen * roots
    told = []
    for deviation, weights in found:
        upright = weights * np.sign(weights[np.argmax(np.abs(weights))])
        words = _words(fit.coordinates, upright, float(deviation), known, blind)
        told.append(Direction(float(deviation), upright, words))
    return tuple(told)


def sloppy(found: Sequence[Direction]) -> tuple[Direction, ...]:
    """Those along which some parameter is open by more than a quarter, the sloppiest first.

    Args:
        found: from `directions`.
    """
    limit = np.log(KNOWN_FACTOR)
    return tuple(d for d in reversed(found) if NORMAL_95 * d.deviation * np.abs(d.weights).max() > limit)


def correlation(covariance: Array) -> Array:
    """Correlation coefficients, (c, c); not a number beside a parameter of infinite variance, one on the diagonal.

    Args:
        covariance: (c, c).
    """
    spread = np.sqrt(np.diag(covariance))
    usable = np.isfinite(spread) & (spread > 0)
    matrix = np.full(covariance.shape, np.nan)
    scale = spread[usable]
    matrix[np.ix_(usable, usable)] = covariance[np.ix_(usable, usable)] / scale / scale[:, None]
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(np.clip(matrix, -1.0, 1.0))


def _principal(information: Array) -> tuple[Array, Array, Array]:
    """Deviations (s,) and unit directions (c, s) of what the data see, and those that they do not, (c, c − s).

    Rounding is told apart in units in which each parameter is known equally well by itself. The singular values of a
    root hold twice the digits of eigenvalues. A parameter that nothing depends on is a direction of its own.
    """
    count = len(information)
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    some = np.flatnonzero(scale > BLIND * scale.max(initial=0.0))
    alone = np.eye(count)[:, np.setdiff1d(np.arange(count), some)]
    if not len(some):
        return np.zeros(0), np.zeros((count, 0)), alone
    values, vectors = np.linalg.eigh(information[np.ix_(some, some)] / scale[some] / scale[some, None])
    kept = values > UNSEEN
    root = np.sqrt(values[kept, None]) * vectors[:, kept].T * scale[some]
    _, sizes, right = np.linalg.svd(root)
    inner = np.eye(count)[:, some] @ right.T
    return 1 / sizes, inner[:, : len(sizes)], np.hstack([inner[:, len(sizes) :], alone])


def _words(parameters: Sequence[Parameter], weights: Array, deviation: float, roots: Array, blind: Array) -> str:
    size = np.abs(weights)
    order = np.argsort(-size, kind="stable")
    lead = parameters[order[0]]
    reach = NORMAL_95 * deviation * float(size[order[0]])
    if size[order[0]] ** 2 >= ALONE:
        return f"{_name(lead)} {_how_far(lead, reach, alone=True)}"
    named = [int(i) for i in order[:NAMED] if size[i] >= LEADING * size[order[0]]]
    logs = all(parameters[i].scale == "log" for i in named)
    if len(named) > 1 and NORMAL_95 * deviation < np.log(KNOWN_FACTOR) and logs:
        known = _known(parameters, weights, named, deviation, roots, blind)
        if known:
            return known
    along = [_name(parameters[i]) for i in named if weights[i] > 0]
    against = [_name(parameters[i]) for i in named if weights[i] < 0]
    far = _how_far(lead, reach, alone=False)
    if len(named) == 1:
        return f"{along[0]} with small parts of many others, {far}"
    if against:
        told = f"{listing(along)} {'trade' if len(along) > 1 else 'trades'} against {listing(against)}, {far}"
    else:
        told = f"{listing(along)} rise and fall together, {far}"
    nevertheless = _nevertheless(parameters, weights, named, reach, roots, blind) if len(named) == 2 and logs else ""
    return f"{told}{nevertheless}"


def _known(
    parameters: Sequence[Parameter], weights: Array, named: Sequence[int], deviation: float, roots: Array, blind: Array
) -> str:
    """A stiff direction: the product or ratio that is known, if it is one of two parameters, or else of what it is."""
    names = [_name(parameters[i]) for i in named]
    if len(named) > 2:
        return f"one combination of {listing(names)} is known to {_share(NORMAL_95 * deviation)}"
    a, b = named
    best = np.zeros(len(weights))
    best[a], best[b] = 1.0, weights[b] / weights[a]
    least = NORMAL_95 * deviation / abs(weights[a])
    what, reach = _combination(names, best, float(best[b]), PLAIN * least, roots, blind)
    return f"{what.replace('their', 'the')} is known to {_share(reach)}" if reach <= PLAIN * least else ""


def _nevertheless(
    parameters: Sequence[Parameter], weights: Array, pair: Sequence[int], reach: float, roots: Array, blind: Array
) -> str:
    """What is known of two parameters that are open: their product, their ratio, or one with an exponent."""
    a, b = pair
    names = [_name(parameters[i]) for i in pair]
    best = np.zeros(len(weights))
    best[a], best[b] = 1.0, -weights[a] / weights[b]  # across the direction, within the plane of the two
    good = min(reach, np.log(OPEN_FACTOR)) / MUCH_BETTER
    what, left = _combination(names, best, float(best[b]), good, roots, blind)
    what = what.partition(" of ")[0] if what.startswith("their") else what
    return f"; {what} is known to {_share(left)}" if left <= good else ""


def _combination(
    names: Sequence[str], best: Array, power: float, good: float, roots: Array, blind: Array
) -> tuple[str, float]:
    """The name of a product of two parameters, the second to a power, and half a 95 % interval of its logarithm.

    It is plain, without a power, if the power is one to two digits or the plain one is known well enough as well.
    """
    plain = np.sign(best)
    reach = _reach(plain, roots, blind)
    if reach > good and f"{abs(power):.2g}" == "1":
        reach = _reach(best, roots, blind)
    if reach <= good:
        return f"their {'product' if power > 0 else 'ratio'} of {listing([*names])}", reach
    return f"{names[0]} {'×' if power > 0 else '/'} {names[1]}^{abs(power):.2g}", _reach(best, roots, blind)


def _reach(combination: Array, roots: Array, blind: Array) -> float:
    """Half a 95 % interval of a combination of x; infinite if it changes along a direction that is not seen."""
    if blind.size and np.abs(combination @ blind).max() > 1e-6 * np.linalg.norm(combination):
        return float("inf")
    return NORMAL_95 * float(np.linalg.norm(combination @ roots))


def _share(reach: float) -> str:
    """How well a quantity is known whose logarithm is known to so much."""
    if reach < np.log(KNOWN_FACTOR):
        return format_percent(float(np.expm1(reach)), digits=2)
    return f"a factor of {format_si(float(np.exp(reach)), digits=2)}"


def _name(p: Parameter) -> str:
    return f"{parameter_name(p.path)}{f' ({len(p.paths)} tied)' if len(p.paths) > 1 else ''}"


def _how_far(p: Parameter, reach: float, *, alone: bool) -> str:
    if not np.isfinite(reach) or (p.scale == "log" and reach > np.log(OPEN_FACTOR)):
        return "is open: the data say nothing" if alone else "and the data do not see it"
    if p.scale == "linear":
        spread = f"± {format_si(reach * p.size, p.unit, digits=2)}"
        return f"is known to {spread}" if alone else f"within {spread}"
    if reach < np.log(KNOWN_FACTOR):
        return f"{'is known to' if alone else 'within'} {_share(reach)}"
    return f"{'is open by' if alone else 'by'} {_share(reach)} either way"
