"""Which combinations of parameters the data determine, from stiff to sloppy, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.text import split_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from armonic.updating.parameters import Parameter
    from armonic.updating.result import Fit

    Array: TypeAlias = NDArray[np.float64]

UNSEEN = 1e-18
"""An eigenvalue of the information below this share of the largest is what rounding leaves of none."""
LEADING = 0.35
"""Parameters with less than this share of the largest weight are not named."""
NAMED = 3
ALONE = 0.9
"""A parameter with this share of a direction's square is the direction."""
NORMAL_95 = 1.96
OPEN_FACTOR = 1e4


@dataclass(frozen=True, eq=False)
class Direction:
    """One principal direction of what a fit knows.

    Attributes:
        deviation: standard deviation of x along it; infinite if the data do not see it.
        weights: the unit direction in x, (c,), its largest entry positive.
        words: which parameters it is made of, and how far it is open.
    """

    deviation: float
    weights: Array
    words: str


def directions(fit: Fit) -> tuple[Direction, ...]:
    """The principal directions of a fit's information, from the best determined to the least.

    Stiff ones have a small deviation: whatever the parameters are, this combination of them is known. Along sloppy ones
    parameters may change together without the data noticing (Gutenkunst et al. 2007).

    Args:
        fit: what `armonic.update` returned.
    """
    values, vectors = np.linalg.eigh(fit.information)
    order = np.argsort(values)[::-1]
    largest = values[order[0]] if len(values) else 0.0
    found = []
    for i in order:
        seen = values[i] > UNSEEN * largest and values[i] > 0
        deviation = float(1 / np.sqrt(values[i])) if seen else np.inf
        weights = vectors[:, i] * np.sign(vectors[np.argmax(np.abs(vectors[:, i])), i])
        found.append(Direction(deviation, weights, _words(fit.coordinates, weights, deviation)))
    return tuple(found)


def correlation(covariance: Array) -> Array:
    """Correlation coefficients, (c, c); not a number beside a parameter of infinite variance, one on the diagonal.

    Args:
        covariance: (c, c).
    """
    spread = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = covariance / np.outer(spread, spread)
    blind = ~np.isfinite(spread)
    matrix[blind] = np.nan
    matrix[:, blind] = np.nan
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(np.clip(matrix, -1.0, 1.0))


def _words(parameters: Sequence[Parameter], weights: Array, deviation: float) -> str:
    size = np.abs(weights)
    order = np.argsort(size)[::-1]
    weights = weights * np.sign(weights[order[0]])
    names = [_name(p) for p in parameters]
    first = names[order[0]]
    reach = NORMAL_95 * deviation * size[order[0]]
    if size[order[0]] ** 2 >= ALONE:
        return f"{first} {_how_far(parameters[order[0]], reach, one=True)}"
    others = [i for i in order[1 : NAMED + 1] if size[i] >= LEADING * size[order[0]]]
    against = [names[i] for i in others if weights[i] < 0]
    along = [names[i] for i in others if weights[i] > 0]
    subject = _list([first, *along])
    if against:
        verb = "trade" if along else "trades"
        return f"{subject} {verb} against {_list(against)}, {_how_far(parameters[order[0]], reach, one=False)}"
    if along:
        return f"{subject} rise together, {_how_far(parameters[order[0]], reach, one=False)}"
    return f"mostly {first}, {_how_far(parameters[order[0]], reach, one=False)}"


def _name(p: Parameter) -> str:
    name, quantity = split_path(p.path)
    tied = " (tied)" if len(p.paths) > 1 else ""
    return f"{name} {quantity}".strip() + tied


def _list(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _how_far(p: Parameter, reach: float, *, one: bool) -> str:
    if not np.isfinite(reach) or (p.scale == "log" and reach > np.log(OPEN_FACTOR)):
        return "is open: the data say nothing" if one else "and the data say nothing about it"
    if p.scale == "linear":
        return f"{'is known to' if one else 'within'} ± {reach * p.size:.3g} {p.unit}".strip()
    if reach < np.log(1.3):
        return f"{'is known to' if one else 'within'} {100 * np.expm1(reach):.2g} %"
    return f"{'is open by' if one else 'by'} a factor of {np.exp(reach):.2g} either way"
