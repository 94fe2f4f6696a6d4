"""The bounded descent ends where SciPy's does, for any residual, and keeps to bounds, limits and priors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares, lsq_linear

from armonic import _core
from armonic.updating.descent import Descent, descend
from test_residual import Case, case, one_mass

Array = NDArray[np.float64]

R = 4
WIDE = np.full(2 * R, 5.0)
TRUTH = np.log(np.random.default_rng(77).uniform(0.5, 3.0, 2 * R))
# Two bounded solvers that stop at a relative change of 1e-12 of the cost know x to the root of that.
SAME_X, SAME_COST = 1e-5, 1e-9


def response(c: Case, x: Array) -> NDArray[np.complex128]:
    spring, damper = np.exp(x).reshape(2, -1)
    B = c.directions
    Z = [s**2 * c.mass + s * c.damping + c.stiffness + B.T @ np.diag(spring + s * damper) @ B for s in c.s]
    return np.array([c.outputs @ np.linalg.solve(z, c.inputs.T) for z in Z])


def noisy(seed: int, noise: float = 0.05, **shape: Any) -> Case:
    """Responses of the truth with noise, so that there is a minimum that is not zero."""
    c = case(seed, r=R, **shape)
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *c.measured.shape))
    return replace(c, measured=response(c, TRUTH) * (1 + noise * (real + 1j * imaginary)))


def by_scipy(
    c: Case,
    start: Array,
    lower: Array,
    upper: Array,
    *,
    groups: list[list[int]] | None = None,
    priors: list[tuple[int, float, float]] | None = None,
) -> OptimizeResult:
    """The minimum of the written-out residual; x has one entry per group of equal parameters."""
    groups = groups or [[i] for i in range(2 * R)]

    def rows(x: Array) -> tuple[Array, Array]:
        theta = TRUTH.copy()
        for value, group in zip(x, groups, strict=True):
            theta[group] = value
        r, J = c.rows(*np.exp(theta).reshape(2, -1))
        J = np.column_stack([J[:, group].sum(axis=1) for group in groups])
        for i, mean, weight in priors or []:
            r, J = np.append(r, weight * (x[i] - mean)), np.vstack([J, weight * np.eye(len(x))[i]])
        return r, J

    inside = np.clip(start, lower + 1e-9, upper - 1e-9)
    tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-13}
    return least_squares(lambda x: rows(x)[0], inside, jac=lambda x: rows(x)[1], bounds=(lower, upper), **tight)


def by_core(problem: _core.Problem, start: Array, lower: Array, upper: Array, **options: Any) -> Descent:
    """All parameters not in `free` stay at the truth."""
    spring, damper = np.exp(TRUTH).reshape(2, 1, -1)
    free = options.pop("free", [[i] for i in range(2 * R)])
    rest = {"priors": [], "tolerance": 1e-12, "evaluations": 300, "radius": 1.0, "watch": None} | options
    return Descent(*problem.descend(spring, damper, free, start, lower, upper, **rest))


def by_python(problem: _core.Problem, start: Array, lower: Array, upper: Array, **options: Any) -> Descent:
    def triangle(x: Array) -> Array:
        spring, damper = np.exp(x).reshape(2, 1, -1)
        return problem.reduce(spring, damper, list(range(2 * R)))

    rest = {"tolerance": 1e-12, "evaluations": 300, "watch": None} | options
    return descend(triangle, start, lower, upper, **rest)


Solver = Callable[..., Descent]
BOTH = pytest.mark.parametrize("solver", [by_core, by_python])


def problem_of(*cases: Case, **options: Any) -> _core.Problem:
    return _core.Problem([c.target for c in cases], **options)


def off(seed: int, size: float = 0.4) -> Array:
    return TRUTH + size * np.random.default_rng([seed, 9]).uniform(-1, 1, 2 * R)


@BOTH
@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_is_that_of_scipy(solver: Solver, seed: int) -> None:
    c = noisy(seed)
    found, expected = solver(problem_of(c), off(seed), -WIDE, WIDE), by_scipy(c, off(seed), -WIDE, WIDE)
    assert found.ending == "converged"
    assert found.cost == pytest.approx(2 * expected.cost, rel=SAME_COST)
    np.testing.assert_allclose(found.x, expected.x, atol=SAME_X)
    assert len(found.history) <= expected.nfev + 5


@BOTH
@pytest.mark.parametrize("seed", range(4))
def test_at_active_bounds_the_minimum_is_that_of_scipy_and_lies_on_them(solver: Solver, seed: int) -> None:
    c, rng = noisy(10 + seed), np.random.default_rng(seed)
    free = by_scipy(c, TRUTH, -WIDE, WIDE).x
    lower, upper = -WIDE, WIDE.copy()
    pushed = rng.permutation(2 * R)[:3]
    upper[pushed[:2]], lower[pushed[2]] = free[pushed[:2]] - 0.3, free[pushed[2]] + 0.3
    start = np.clip(off(seed), lower + 0.05, upper - 0.05)
    found, expected = solver(problem_of(c), start, lower, upper), by_scipy(c, start, lower, upper)
    assert found.cost == pytest.approx(2 * expected.cost, rel=1e-7)  # SciPy comes near to a bound, but not onto it
    np.testing.assert_allclose(found.x, expected.x, atol=1e-3)
    assert found.cost <= 2 * expected.cost * (1 + SAME_COST)
    on_bound = (found.x == lower) | (found.x == upper)
    assert on_bound[np.isclose(expected.x, lower, atol=1e-5) | np.isclose(expected.x, upper, atol=1e-5)].all()
    assert on_bound.sum() >= 2


@BOTH
def test_a_linear_problem_within_bounds_has_the_minimum_of_its_normal_equations(solver: Solver) -> None:
    # Around the truth, with noise small enough that logarithms are straight: against an active-set solver.
    c = noisy(20, noise=1e-6)
    r, J = c.rows(*np.exp(TRUTH).reshape(2, -1))
    upper = TRUTH + 1e-7 * np.random.default_rng(1).uniform(-1, 3, 2 * R)
    lower = upper - 4e-7
    start = np.clip(TRUTH, lower, upper)
    expected = lsq_linear(J, -r, (lower - TRUTH, upper - TRUTH), tol=1e-14).x
    found = solver(problem_of(c), start, lower, upper, tolerance=1e-15)
    np.testing.assert_allclose(found.x - TRUTH, expected, atol=1e-10)


@pytest.mark.parametrize("side", [1.0, -1.0])
@BOTH
def test_a_start_beyond_its_bounds_is_put_on_them_and_may_leave_them(solver: Solver, side: float) -> None:
    c, wide = noisy(21), np.full(2 * R, 0.7)
    lower, upper = TRUTH - wide, TRUTH + wide
    far = solver(problem_of(c), TRUTH + 3 * side * wide, lower, upper, evaluations=1)
    assert np.array_equal(far.x, upper if side > 0 else lower)
    expected = by_scipy(c, TRUTH, lower, upper)
    found = solver(problem_of(c), TRUTH + 3 * side * wide, lower, upper)
    assert found.cost == pytest.approx(2 * expected.cost, rel=SAME_COST)


def test_no_evaluation_of_the_model_leaves_the_bounds() -> None:
    c, seen = noisy(22), list[Array]()
    problem = problem_of(c)
    lower, upper = TRUTH - 0.2, TRUTH + 0.6

    def triangle(x: Array) -> Array:
        seen.append(x)
        return problem.reduce(*np.exp(x).reshape(2, 1, -1), list(range(2 * R)))

    descend(triangle, upper, lower, upper, tolerance=1e-12, evaluations=50, watch=None)
    assert len(seen) > 3
    assert all(((lower <= x) & (x <= upper)).all() for x in seen)


@BOTH
@pytest.mark.parametrize("limit", [1, 2, 5])
def test_the_limit_of_evaluations_is_kept(solver: Solver, limit: int) -> None:
    found = solver(problem_of(noisy(23)), off(23), -WIDE, WIDE, evaluations=limit)
    assert (found.ending, len(found.history)) == ("limit", limit)
    assert (np.diff(found.history) <= 0).all()
    c = noisy(23)
    assert found.cost == pytest.approx(np.sum(c.rows(*np.exp(found.x).reshape(2, -1))[0] ** 2), rel=1e-11)
    assert found.history[-1] == found.price


@BOTH
def test_the_history_falls_and_ends_at_the_cost(solver: Solver) -> None:
    found = solver(problem_of(noisy(24)), off(24), -WIDE, WIDE)
    assert (np.diff(found.history) <= 0).all()
    assert found.history[-1] == pytest.approx(found.cost, rel=1e-12)
    assert found.history[-1] < found.history[0]


@BOTH
def test_every_evaluation_is_told_and_an_interrupt_keeps_the_best_so_far(solver: Solver) -> None:
    told: list[tuple[int, float]] = []

    def watch(count: int, cost: float) -> None:
        told.append((count, cost))
        if len(told) == 4:
            raise KeyboardInterrupt

    found = solver(problem_of(noisy(25)), off(25), -WIDE, WIDE, watch=watch)
    assert found.ending == "interrupted"
    assert np.isfinite(found.cost)
    assert len(told) == 4
    assert [count for count, _ in told] == sorted({count for count, _ in told})


@BOTH
def test_an_error_of_the_watcher_comes_out(solver: Solver) -> None:
    def watch(count: int, cost: float) -> None:
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        solver(problem_of(noisy(26)), off(26), -WIDE, WIDE, watch=watch)


@pytest.mark.parametrize("weight", [1e-3, 1.0, 30.0, 1e4])
def test_priors_pull_as_rows_of_the_residual_do(weight: float) -> None:
    c = noisy(27)
    priors = [(0, TRUTH[0] + 0.5, weight), (5, TRUTH[5] - 0.2, weight), (0, TRUTH[0], 2.0)]
    found = by_core(problem_of(c), off(27), -WIDE, WIDE, priors=priors)
    expected = by_scipy(c, off(27), -WIDE, WIDE, priors=priors)
    assert found.cost == pytest.approx(2 * expected.cost, rel=SAME_COST)
    np.testing.assert_allclose(found.x, expected.x, atol=SAME_X)


def test_parameters_that_are_not_free_stay_and_the_others_find_their_minimum() -> None:
    c, free = noisy(28), [2, 7, 4]
    found = by_core(problem_of(c), off(28)[free], -WIDE[free], WIDE[free], free=free)
    expected = by_scipy(c, off(28)[free], -WIDE[free], WIDE[free], groups=[[i] for i in free])
    np.testing.assert_allclose(found.x, expected.x, atol=SAME_X)


def blind(seed: int) -> Case:
    """The second spring and damper act on nothing."""
    c = noisy(seed)
    c = replace(c, directions=c.directions * np.array([1.0, 0.0, 1.0, 1.0])[:, None])
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *c.measured.shape))
    return replace(c, measured=response(c, TRUTH) * (1 + 0.05 * (real + 1j * imaginary)))


@BOTH
def test_what_the_data_do_not_see_stays_where_it_started_and_does_no_harm(solver: Solver) -> None:
    c, start = blind(29), off(29)
    found = solver(problem_of(c), start, -WIDE, WIDE)
    assert found.x[[1, 5]].tolist() == start[[1, 5]].tolist()
    seen = [0, 2, 3, 4, 6, 7]
    expected = by_scipy(c, start[seen], -WIDE[seen], WIDE[seen], groups=[[i] for i in seen])
    np.testing.assert_allclose(found.x[seen], expected.x, atol=SAME_X)
    assert found.ending == "converged"
    assert len(found.history) < 30


@BOTH
def test_two_that_only_trade_against_each_other_do_not_slow_the_descent(solver: Solver) -> None:
    # The first two springs in one place: the data see their sum. SciPy's trust region crawls here.
    c = noisy(30)
    B = c.directions.copy()
    B[1] = B[0]
    c = replace(c, directions=B)
    real, imaginary = np.random.default_rng(30).standard_normal((2, *c.measured.shape))
    c = replace(c, measured=response(c, TRUTH) * (1 + 0.05 * (real + 1j * imaginary)))
    found = solver(problem_of(c), off(30), -WIDE, WIDE)
    assert found.ending == "converged"
    assert len(found.history) < 40
    gradient = c.rows(*np.exp(found.x).reshape(2, -1))[1].T @ c.rows(*np.exp(found.x).reshape(2, -1))[0]
    assert np.abs(gradient).max() < 1e-4 * found.cost


def test_columns_of_tied_parameters_are_the_sums_of_their_columns() -> None:
    c = case(31, r=R)
    spring, damper = np.full((1, R), 1.3), np.full((1, R), 0.7)
    r, J = c.rows(spring[0], damper[0])
    groups: list[Any] = [[0, 2, 3], 5, [4, 7], [1]]
    columns = [J[:, [0, 2, 3]].sum(axis=1), J[:, 5], J[:, [4, 7]].sum(axis=1), J[:, 1]]
    rows = np.column_stack([*columns, r])
    triangle = problem_of(c).reduce(spring, damper, groups)
    scale = np.sqrt(np.outer(*[np.sum(rows**2, axis=0)] * 2))
    assert (np.abs(triangle.T @ triangle - rows.T @ rows) / scale).max() < 1e-12


def test_tied_parameters_are_fitted_as_one() -> None:
    c = noisy(32)
    groups = [[0, 2, 3], [5], [4, 7], [1]]
    start, wide = np.array([0.1, -0.2, 0.3, 0.2]), np.full(4, 5.0)
    found = by_core(problem_of(c), start, -wide, wide, free=groups)
    expected = by_scipy(c, start, -wide, wide, groups=groups)
    assert found.cost == pytest.approx(2 * expected.cost, rel=SAME_COST)
    np.testing.assert_allclose(found.x, expected.x, atol=SAME_X)


def relative_rows(c: Case, x: Array) -> tuple[Array, Array]:
    """√W (H − H_m)/H_m, real over imaginary parts, and its slopes by x, from central differences of the response."""
    root, h = np.sqrt(c.weights), 1e-5
    r = root * (response(c, x) - c.measured) / c.measured
    slopes = []
    for i in range(len(x)):
        step = h * np.eye(len(x))[i]
        slopes.append(root * (response(c, x + step) - response(c, x - step)) / (2 * h * c.measured))
    J = np.stack([s.ravel() for s in slopes], axis=1)
    return np.concatenate([r.ravel().real, r.ravel().imag]), np.concatenate([J.real, J.imag])


@pytest.mark.parametrize("shape", [(3, 3), (1, 2)])
def test_the_relative_residual_is_the_one_written_out(shape: tuple[int, int]) -> None:
    c = case(33, r=R, shape=shape)
    r, J = relative_rows(c, TRUTH)
    rows = np.column_stack([J, r])
    spring, damper = np.exp(TRUTH).reshape(2, 1, -1)
    problem = problem_of(c, relative=True)
    triangle = problem.reduce(spring, damper, list(range(2 * R)))
    scale = np.sqrt(np.outer(*[np.sum(rows**2, axis=0)] * 2))
    # Central differences: h² = 1e-10 of the third derivative.
    assert (np.abs(triangle.T @ triangle - rows.T @ rows) / scale).max() < 1e-8
    assert problem.costs(spring, damper)[0] == pytest.approx(np.sum(r**2), rel=1e-12)


def test_prices_are_told_beside_the_cost_and_the_best_of_them_is_kept() -> None:
    c = noisy(34, noise=0.3)
    prices = np.random.default_rng(34).uniform(0, 1, c.weights.shape) ** 8
    problem = problem_of(c, prices=[prices])
    spring, damper = np.exp(off(34)).reshape(2, 1, -1)
    priced = replace(c, weights=prices)
    first = by_core(problem, off(34), -WIDE, WIDE, evaluations=1)
    assert first.price == pytest.approx(np.sum(priced.rows(spring[0], damper[0])[0] ** 2), rel=1e-12)
    found = by_core(problem, off(34), -WIDE, WIDE)
    by_cost, at_best = (np.sum(priced.rows(*np.exp(x).reshape(2, -1))[0] ** 2) for x in (found.x, found.best))
    assert found.price == pytest.approx(at_best, rel=1e-11)
    assert found.history[-1] == found.price <= by_cost * (1 + 1e-11)
    expected = by_scipy(c, off(34), -WIDE, WIDE)
    np.testing.assert_allclose(found.x, expected.x, atol=SAME_X)  # the descent goes by the cost all the same


def test_costs_are_infinite_where_the_model_has_no_answer_and_right_elsewhere() -> None:
    # 1 kg at ω = 2: a spring of 4 N/m cancels its inertia; beside it |H| = 1/|k − 4|, measured as 1.
    s = np.array([2j])
    problem = _core.Problem([(one_mass(outputs=1.0), s, np.ones((1, 1, 1), complex), np.ones((1, 1, 1)))])
    springs = np.array([[4.0], [6.0], [4.0], [5.0], [3.0]])
    costs = problem.costs(springs, np.zeros_like(springs))
    assert np.isinf(costs[[0, 2]]).all()
    # ln(1/2)², 0, and π² for the change of sign.
    np.testing.assert_allclose(costs[[1, 3, 4]], [np.log(2) ** 2, 0, np.pi**2], rtol=1e-12, atol=1e-25)


def test_a_descent_that_begins_nowhere_ends_there_and_one_that_crosses_nowhere_goes_on() -> None:
    def triangle(x: Array) -> Array:
        if x[0] > 2:
            raise ArithmeticError("nowhere")
        return np.array([[1.0, np.exp(-x[0]) + x[0] - 1.9], [0.0, 0.0]])  # its slope is wrong, so it steps too far

    wide = np.array([10.0])
    nowhere = descend(triangle, np.array([3.0]), -wide, wide, tolerance=1e-10, evaluations=9, watch=None)
    assert (len(nowhere.history), np.isfinite(nowhere.cost)) == (1, False)

    def steep(x: Array) -> Array:
        if x[0] > 2:
            raise ArithmeticError("nowhere")
        return np.array([[0.1, x[0] - 1.9], [0.0, 0.0]])  # ten times too flat: the first step is ten times too long

    found = descend(steep, np.array([1.0]), -wide, wide, tolerance=1e-10, evaluations=200, watch=None)
    assert found.x[0] == pytest.approx(1.9, abs=0.05)
    assert np.isfinite(found.cost)


def test_a_curved_valley_is_followed_to_its_end() -> None:
    # Rosenbrock: 10 (y − x²) and 1 − x; its only minimum is zero at (1, 1).
    def triangle(x: Array) -> Array:
        J = np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
        return np.vstack([np.column_stack([J, r]), np.zeros(3)])

    start, wide = np.array([-1.2, 1.0]), np.full(2, 10.0)
    found = descend(triangle, start, -wide, wide, tolerance=1e-12, evaluations=100, watch=None)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-10)
    low = descend(triangle, start, -wide, np.array([0.5, 10.0]), tolerance=1e-12, evaluations=100, watch=None)
    np.testing.assert_allclose(low.x, [0.5, 0.25], atol=1e-9)  # along y = x² to the bound


def test_a_prior_of_a_parameter_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="parameter of a prior"):
        by_core(problem_of(noisy(35)), off(35), -WIDE, WIDE, priors=[(8, 0.0, 1.0)])


def test_bounds_and_starts_of_another_length_are_refused() -> None:
    problem = problem_of(noisy(36))
    for lengths in ((7, 8, 8), (8, 7, 8), (8, 8, 7)):
        with pytest.raises(ValueError, match=r"start|lower|upper"):
            by_core(problem, *(np.zeros(n) for n in lengths))
