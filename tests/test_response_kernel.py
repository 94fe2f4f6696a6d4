"""The compiled response kernel against dense algebra: every size, every number of lines, sensitivities, lost pivots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic import _core
from armonic.synthesis import system
from models import (
    AXES,
    Complex,
    difference,
    dynamic_stiffness,
    oscillator,
    random_positive,
    random_robot,
    rows_of,
    system_of,
)
from trees import Array

# Condition numbers stay below 1e4 (matrices of some tens each, damped); two eliminations round differently.
ROUNDING = 1e-11


@dataclass(frozen=True)
class Case:
    """Matrices, impedances and Jacobian rows of one linear system."""

    mass: Array
    damping: Array
    stiffness: Array
    directions: Array
    spring: Array
    damper: Array
    out: Array
    into: Array

    @property
    def system(self) -> Any:
        return system_of(self.mass, self.damping, self.stiffness, self.directions, self.out, self.into)

    def inverse(self, s: Complex, spring: Array | None = None, damper: Array | None = None) -> Complex:
        """Z⁻¹ with the impedances, (L, n, n)."""
        k, d = self.spring if spring is None else spring, self.damper if damper is None else damper
        b = self.directions
        stiffness, damping = self.stiffness + b.T @ (k[:, None] * b), self.damping + b.T @ (d[:, None] * b)
        return np.linalg.inv(dynamic_stiffness(s, self.mass, damping, stiffness))

    def response(self, s: Complex, **impedances: Array) -> Complex:
        return self.out @ self.inverse(s, **impedances) @ self.into.T

    def by_core(self, s: Complex, *, sensitivities: bool = False) -> tuple[Complex, Complex | None]:
        values, slopes = _core.responses(
            [self.system], self.spring[None], self.damper[None], s, sensitivities=sensitivities
        )
        return values[0], None if slopes is None else slopes[0]


def random_case(n: int, *, seed: int = 0, outputs: int = 3, inputs: int = 3, same: bool = False) -> Case:
    """Symmetric, with an impedance on every coordinate and two on combinations of coordinates."""
    rng = np.random.default_rng([seed, n])
    out = rng.normal(size=(outputs, n))
    return Case(
        mass=random_positive(rng, n),
        damping=0.1 * random_positive(rng, n),
        stiffness=10.0 * random_positive(rng, n),
        directions=np.vstack([np.eye(n), rng.normal(size=(2, n))]),
        spring=rng.uniform(1.0, 20.0, n + 2),
        damper=rng.uniform(0.01, 0.2, n + 2),
        out=out,
        into=out if same else rng.normal(size=(inputs, n)),
    )


def without_symmetry(case: Case) -> Case:
    """As of a robot that moves, or is under a moment."""
    rng = np.random.default_rng(99)
    n = len(case.mass)
    damping, stiffness = (
        a + scale * rng.normal(size=(n, n)) for a, scale in ((case.damping, 0.1), (case.stiffness, 3))
    )
    return replace(case, damping=damping, stiffness=stiffness)


LINES = 1j * np.linspace(0.1, 12.0, 29)
# Anywhere in the plane: left and right half, real, and both sides of the real axis.
PLANE = np.array([0.3 + 2j, -0.2 + 5j, -1.5 - 4j, 2.0, -0.7, 1e-3 + 1e-3j, 30 - 2j, 0.0])


@pytest.mark.parametrize("points", [LINES, PLANE], ids=["imaginary axis", "plane"])
@pytest.mark.parametrize("symmetric", [True, False], ids=["symmetric", "general"])
@pytest.mark.parametrize("n", [*range(1, 13), 17, 24])
def test_every_size_agrees_with_dense_algebra(n, symmetric, points):
    case = random_case(n) if symmetric else without_symmetry(random_case(n))
    assert difference(case.by_core(points)[0], case.response(points)) < ROUNDING


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 31, 32, 33])
@pytest.mark.parametrize("symmetric", [True, False], ids=["symmetric", "general"])
def test_every_number_of_lines_agrees_with_dense_algebra(count, symmetric):
    # Lines go through the processor in groups of up to 16; whatever is left over must not differ.
    case = random_case(5, same=True) if symmetric else without_symmetry(random_case(5, same=True))
    s = 1j * np.linspace(0.1, 12.0, count)
    values, slopes = case.by_core(s, sensitivities=True)
    assert difference(values, case.response(s)) < ROUNDING
    assert difference(slopes, closed_form(case, s)) < ROUNDING


def test_no_lines_give_no_values():
    values, slopes = random_case(3).by_core(np.zeros(0, complex), sensitivities=True)
    assert values.shape == (0, 3, 3)
    assert slopes.shape == (0, 3, 3, 10)


@pytest.mark.parametrize("outputs", [1, 2, 3, 4, 6, 7])
@pytest.mark.parametrize("inputs", [1, 2, 3, 5, 6, 8])
def test_every_number_of_outputs_and_inputs_agrees_with_dense_algebra(outputs, inputs):
    for case in (random_case(6, outputs=outputs, inputs=inputs), random_case(6, outputs=outputs, same=True)):
        values, slopes = case.by_core(LINES, sensitivities=True)
        assert difference(values, case.response(LINES)) < ROUNDING
        assert difference(slopes, closed_form(case, LINES)) < ROUNDING


def test_conjugate_points_give_conjugate_responses():
    case = random_case(7)
    assert difference(case.by_core(PLANE.conj())[0], case.by_core(PLANE)[0].conj()) < 1e-14


# --- Sensitivities ------------------------------------------------------------------------------------------


def closed_form(case: Case, s: Complex) -> Complex:
    """∂H/∂k_r = -(J_out Z⁻¹ b_r)(b_rᵀ Z⁻¹ J_inᵀ), and s times that for ∂H/∂d_r; (L, p, m, 2r)."""
    Z = case.inverse(s)
    at_outputs, at_inputs = case.out @ Z @ case.directions.T, case.directions @ Z @ case.into.T
    by_spring = -np.einsum("lar,lrb->labr", at_outputs, at_inputs)
    return np.concatenate([by_spring, s[:, None, None, None] * by_spring], axis=-1)


CASES = {
    "one frame": random_case(6, same=True),
    "two frames": random_case(6, outputs=2),
    "one frame, general": without_symmetry(random_case(6, same=True)),
    "two frames, general": without_symmetry(random_case(6, outputs=2)),
}


@pytest.mark.parametrize("points", [LINES, PLANE], ids=["imaginary axis", "plane"])
@pytest.mark.parametrize("name", CASES)
def test_sensitivities_agree_with_the_closed_form(name, points):
    case = CASES[name]
    values, slopes = case.by_core(points, sensitivities=True)
    assert difference(slopes, closed_form(case, points)) < ROUNDING
    np.testing.assert_array_equal(values, case.by_core(points)[0])  # asking for more changes nothing


@pytest.mark.parametrize("name", CASES)
def test_sensitivities_agree_with_differences_of_dense_responses(name):
    case = CASES[name]
    slopes = case.by_core(LINES, sensitivities=True)[1]
    count = len(case.spring)
    for r in range(2 * count):
        which, at = ("spring", r) if r < count else ("damper", r - count)
        own = getattr(case, which)
        h = 5e-4 * own[at]
        ahead = [case.response(LINES, **{which: own + k * h * np.eye(count)[at]}) for k in (-3, -2, -1, 1, 2, 3)]
        weights = np.array([-1, 9, -45, 45, -9, 1]) / (60 * h)
        expected = np.tensordot(weights, np.array(ahead), 1)
        # Sixth order in a step of 0.05 %: rounding leaves 1e-13 / 5e-4, truncation no more.
        scale = np.abs(expected).max()
        assert np.abs(slopes[..., r] - expected).max() < 1e-8 * scale


def test_a_bushing_is_a_direction_like_any_other():
    bushing = {"name": "rope", "between": ["base", "tip"], "stiffness": [3e4] * 3 + [2e3] * 3, "damping": [20.0] * 6}
    model = am.linearize(random_robot(6, 6, bushings=[bushing]), "bent")
    rows, s = rows_of(model, "tip", AXES), 2j * np.pi * np.linspace(1.0, 60.0, 21)
    case = Case(
        mass=model.mass,
        damping=model.free_damping,
        stiffness=model.free_stiffness,
        directions=model.directions,
        spring=model.spring,
        damper=model.damper,
        out=rows,
        into=rows,
    )
    assert (np.count_nonzero(model.directions, axis=1) > 1).sum() == 6  # those of the bushing couple coordinates
    systems = [system(model, "tip", AXES, AXES)]
    values, slopes = _core.responses(systems, model.spring[None], model.damper[None], s, sensitivities=True)
    assert difference(values[0], case.response(s)) < 1e-10
    assert difference(slopes[0], closed_form(case, s)) < 1e-10


# --- Batches ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sensitivities", [False, True])
def test_batches_are_the_same_as_one_by_one(sensitivities):
    cases = [random_case(5, seed=seed, same=True) for seed in range(6)]
    systems = [case.system for case in cases]
    springs, dampers = np.array([c.spring for c in cases]), np.array([c.damper for c in cases])

    def run(systems: list[Any], springs: Array, dampers: Array) -> list[Complex]:
        found = _core.responses(systems, springs, dampers, LINES, sensitivities=sensitivities)
        return [array for array in found if array is not None]

    batches = {
        "both": (run(systems, springs, dampers), lambda i: (systems[i : i + 1], i)),
        "one system": (run(systems[:1], springs, dampers), lambda i: (systems[:1], i)),
        "one set of impedances": (run(systems, springs[:1], dampers[:1]), lambda i: (systems[i : i + 1], 0)),
    }
    for together, pick in batches.values():
        for i in range(6):
            one, at = pick(i)
            alone = run(one, springs[at : at + 1], dampers[at : at + 1])
            for many, single in zip(together, alone, strict=True):
                np.testing.assert_array_equal(many[i], single[0])


def test_batches_that_do_not_fit_are_refused():
    cases = [random_case(n, seed=n) for n in (4, 5)]
    one, other = cases
    springs, dampers = (np.tile(v, (3, 1)) for v in (one.spring, one.damper))
    for systems in ([], [one.system] * 2, [one.system, one.system, other.system]):
        with pytest.raises(ValueError, match="system"):
            _core.responses(systems, springs, dampers, LINES)


# --- Lost pivots --------------------------------------------------------------------------------------------


def undamped(stiffness: Array, mass: Array) -> Case:
    n = len(mass)
    none = np.zeros((n, n))
    return Case(mass, none, stiffness, np.zeros((0, n)), np.zeros(0), np.zeros(0), np.eye(n), np.eye(n))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("power", [0, *range(3, 16)])
def test_an_undamped_line_where_a_leading_minor_cancels_is_accurate(order, power):
    # Elimination without exchanges divides by ratios of leading minors of Z, and this one is next to zero.
    for seed in range(20):
        rng = np.random.default_rng([order, seed])
        mass, stiffness = random_positive(rng, 6), random_positive(rng, 6)
        corner = np.linalg.solve(mass[:order, :order], stiffness[:order, :order])
        w = np.sqrt(np.linalg.eigvals(corner).real[0]) * (1 + (10.0**-power if power else 0.0))
        case = undamped(stiffness, mass)
        s = np.array([1j * w])
        assert difference(case.by_core(s)[0], case.response(s)) < 1e-9


@pytest.mark.parametrize("share", [1e-7, 9e-7, 2e-6, 4e-6, 1e-5, 1e-4, 1e-3])
def test_two_pivots_that_all_but_cancel_one_after_the_other_do_no_harm(share):
    # At ω = 1, Z is this matrix: both first pivots are `share`, the second as what is left of the terms that the first
    # made large. Each is small beside k + ω² m alone.
    root = np.sqrt(share)
    Z = np.array([[share, root, 1.0], [root, 1.0 + share, 0.3], [1.0, 0.3, 0.5]])
    case, s = undamped(Z + np.eye(3), np.eye(3)), np.array([1j])
    assert np.linalg.cond(case.inverse(s)[0]) < 20
    assert difference(case.by_core(s)[0], case.response(s)) < 1e-9


@pytest.mark.parametrize("entry", [0.0, 1e-16, 1e-12, 1e-8])
def test_a_stiffness_entry_that_is_small_beside_its_row_does_no_harm(entry):
    # A balanced free link: gravity gives it no stiffness of its own, and couples it to the next one.
    case = undamped(np.array([[entry, 1.0], [1.0, 1.0]]), np.eye(2))
    s = np.array([0.0j])
    assert difference(case.by_core(s)[0], case.response(s)) < 1e-9


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 11, 16, 17])
def test_a_singular_line_is_refused_by_its_index(count):
    w = np.arange(1.0, count + 1.0)
    for line in range(count):
        case = undamped(np.array([[w[line] ** 2]]), np.eye(1))
        with pytest.raises(ArithmeticError, match=rf"singular at line {line}:"):
            case.by_core(1j * w)


def test_an_oscillator_in_a_robot_file_reaches_the_kernel_unchanged():
    model = am.linearize(oscillator(2.0, 50.0, 3.0), {})
    found = _core.responses([system(model, "mass_0", ("x",), ("x",))], model.spring[None], model.damper[None], LINES)[0]
    np.testing.assert_allclose(found[0, :, 0, 0], 1 / (2.0 * LINES**2 + 3.0 * LINES + 50.0), rtol=1e-13)
