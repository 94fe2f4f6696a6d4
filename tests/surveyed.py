"""What a survey is held against: the eigenvalues of the explicit state matrix, by LAPACK, pole by pole."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

import armonic as am
from trees import Array


def poles_of(survey: xr.Dataset) -> NDArray[np.complex128]:
    """All poles, both of each slot, (places, 2 m)."""
    both = np.concatenate([survey.pole.values, survey.partner.values], axis=-1)
    return both.reshape(-1, both.shape[-1])


def deviation(found: NDArray[np.complex128], expected: NDArray[np.complex128]) -> float:
    """Largest relative distance of poles paired one to one; none may be missing, none be there twice."""
    found = found[~np.isnan(found)]
    assert len(found) == len(expected)
    apart = np.abs(found[:, None] - expected) / np.abs(expected)
    return float(apart[linear_sum_assignment(apart)].max())


def by_lapack(robot: am.Robot, q: Any, **load: Any) -> NDArray[np.complex128]:
    """Eigenvalues of the state matrix at a posture."""
    return np.asarray(np.linalg.eigvals(am.linearize(robot, q, **load).state_matrix()), complex)


def worst(robot: am.Robot, postures: Array, survey: xr.Dataset, **load: Any) -> float:
    """Largest deviation over all postures."""
    found = poles_of(survey)
    assert len(found) == len(postures)
    return max(deviation(f, by_lapack(robot, q, **load)) for f, q in zip(found, postures, strict=True))


def smooth(robot: am.Robot, count: int, *, seed: int = 0, size: float = 1.0) -> Array:
    """A closed path of a few random waves in every coordinate."""
    rng, n = np.random.default_rng(seed), len(robot.coordinates)
    t = np.linspace(0, 2 * np.pi, count)[:, None]
    waves = (size / k * rng.normal(size=n) * np.sin(k * t + rng.uniform(0, 6, n)) for k in (1, 2, 3))
    return np.asarray(sum(waves), float)
