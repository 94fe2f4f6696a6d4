"""What is known of a parameter before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from armonic.errors import UpdateError
from armonic.updating.parameters import numbers_of
from armonic.updating.residuals import Anchors

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from armonic.robot import Robot
    from armonic.updating.parameters import Parameter

SUREST = 1e-6
"""No prior is surer than this share: beside it the data would count as rounding."""


@dataclass(frozen=True)
class Prior:
    """An expected value and how sure it is.

    Attributes:
        deviation: relative standard deviation: of ln(value), or of numbers that may be negative the standard deviation
            itself, SI.
        value: expected, SI; that of the robot if not given.
    """

    deviation: float
    value: float | None = None


def anchors_of(robot: Robot, chosen: Sequence[Parameter], priors: Mapping[str, Prior | float]) -> Anchors:
    """Priors as rows of a fit.

    Args:
        robot: holds the numbers.
        chosen: what is fitted.
        priors: by path or pattern; a number is a relative standard deviation about the robot's value.

    Raises:
        UpdateError: a prior of what is not fitted, or of no positive deviation, or a value that the scale lacks.
    """
    place = {path: i for i, p in enumerate(chosen) for path in p.paths}
    found: dict[int, tuple[float, float]] = {}
    for pattern, given in priors.items():
        prior = Prior(float(given)) if _is_number(given) else given  # type: ignore[arg-type]
        if not isinstance(prior, Prior) or not _is_number(prior.deviation) or not 0 < prior.deviation < np.inf:
            raise UpdateError(
                f"prior of {pattern}",
                found=repr(given),
                expected="a positive standard deviation, or Prior(deviation, value)",
            )
        if prior.value is not None and not (_is_number(prior.value) and np.isfinite(prior.value)):
            raise UpdateError(f"prior of {pattern}", found=repr(prior.value), expected="a finite value, or none")
        for path in numbers_of(robot, pattern, "priors"):
            if path not in place:
                raise UpdateError(
                    f"prior of {path}",
                    found="a number that is not fitted",
                    expected="one that is",
                    hint="Add it to `parameters`.",
                )
            p = chosen[place[path]]
            mean = p.start if prior.value is None else prior.value  # of numbers that are tied, one start for all
            if p.scale == "log" and not 0 < mean < np.inf:
                raise UpdateError(f"prior of {path}", found=f"{mean:g}", expected="a positive value")
            if prior.deviation < SUREST * p.size:
                raise UpdateError(
                    f"prior of {path}",
                    found=f"a standard deviation of {prior.deviation:g}",
                    expected=f"at least {SUREST * p.size:g}",
                    hint="What is known so well is better held.",
                )
            found[place[path]] = (p.coordinate(mean), prior.deviation / p.size)
    return Anchors(
        tuple(found), tuple(mean for mean, _ in found.values()), tuple(deviation for _, deviation in found.values())
    )


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
