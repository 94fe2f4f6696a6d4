"""Eigenvalues of matrix polynomials against LAPACK on the companion matrix, closed forms and identities."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import matrix_balance
from scipy.optimize import linear_sum_assignment

from armonic import _core
from trees import Array

Complex = NDArray[np.complex128]
EPS = np.finfo(float).eps


def solve(coefficients: Array) -> Complex:
    """The eigenvalues of one polynomial, which must have converged."""
    (found,), _, (converged,) = _core.polynomial_eigenvalues([np.ascontiguousarray(coefficients, dtype=float)])
    assert converged
    return found


def companion(coefficients: Array) -> Array:
    p, m, _ = coefficients.shape
    out = np.eye(m * p, k=-m)
    out[:m] = np.hstack(list(coefficients))
    return out


def distance(found: Complex, expected: Complex) -> Array:
    """|difference| of each number to its partner, every number having one."""
    apart = np.abs(found[:, None] - expected[None, :])
    return np.asarray(apart[linear_sum_assignment(apart)])


def matrix_at(coefficients: Array, z: complex) -> tuple[Complex, float]:
    """P(z) and Σ‖A_k‖|z|^(p−k), both divided by |z|^p where that is large."""
    p, m, _ = coefficients.shape
    powers = np.power(complex(z), np.arange(p, -1, -1) - (p if abs(z) > 1 else 0))
    terms = np.concatenate([np.eye(m)[None], -coefficients])
    return np.tensordot(powers, terms, 1), float(np.abs(powers) @ np.linalg.norm(terms, axis=(1, 2)))


def backward_error(coefficients: Array, poles: Complex) -> Array:
    at = [matrix_at(coefficients, z) for z in poles]
    return np.array([np.linalg.svd(value, compute_uv=False)[-1] / size for value, size in at])


def conditions(coefficients: Array) -> tuple[Complex, Array]:
    """LAPACK's eigenvalues of the companion matrix, and the condition number of each, 1 / |yᴴx|."""
    values, right = np.linalg.eig(companion(coefficients))
    left = np.linalg.inv(right)
    return values, np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0)


def random(seed: int, p: int, m: int, size: float = 1.0) -> Array:
    return size * np.random.default_rng(seed).normal(size=(p, m, m))


def scalar(roots: list[complex]) -> Array:
    return -np.real(np.poly(roots))[1:, None, None]


@cache
def autoregressions(noise: float) -> list[Array]:
    """Least-squares vector autoregressions of orders 2 to 40 of a decay with five modes in three channels.

    Without noise, every order beyond the fourth is determined by rounding only.
    """
    rng = np.random.default_rng(3)
    mu = np.exp([-0.004 + 0.08j, -0.02 + 0.31j, -0.01 + 0.7j, -0.05 + 1.4j, -0.3 + 2.3j])
    shapes = rng.normal(size=(5, 3)) + 0.2j * rng.normal(size=(5, 3))
    values = (mu ** np.arange(900)[:, None] @ shapes).real
    values += noise * values.std(axis=0) * rng.normal(size=values.shape)
    out = []
    for p in range(2, 41):
        past = np.hstack([values[p - j : len(values) - j] for j in range(1, p + 1)])
        solution = np.linalg.lstsq(past, values[p:], rcond=None)[0]
        out.append(np.ascontiguousarray(solution.reshape(p, 3, 3).transpose(0, 2, 1)))
    return out


# --- Against LAPACK -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [1, 2, 3, 5, 6, 7, 12])
@pytest.mark.parametrize("p", [1, 2, 3, 8, 20])
def test_every_eigenvalue_is_one_of_the_companion_matrix(m, p):
    coefficients = random(10 * p + m, p, m)
    values, condition = conditions(coefficients)
    # LAPACK's own error: rounding of the companion matrix, times what its worst eigenvalue makes of it.
    tolerance = 10 * EPS * condition.max() * np.linalg.norm(companion(coefficients), 2)
    assert distance(solve(coefficients), values).max() < tolerance


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e3, 1e6])
def test_small_and_large_coefficients_keep_their_relative_accuracy(size):
    coefficients = random(5, 6, 4)
    scales = size ** np.arange(1, 7)[:, None, None]
    # z = size·w turns one into the other; 1e-12 is the rounding of the scaled coefficients, times conditions.
    np.testing.assert_allclose(distance(solve(scales * coefficients) / size, solve(coefficients)), 0, atol=1e-12)


def test_channels_in_units_of_their_own_leave_the_poles_alone():
    coefficients = random(6, 8, 6)
    units = 10.0 ** np.linspace(-6, 6, 6)
    mixed = coefficients * units[:, None] / units
    # Rounding of the mixed coefficients, times the conditions of poles near one.
    assert distance(solve(mixed), solve(coefficients)).max() < 1e-12
    poles = solve(mixed)
    shapes = _core.polynomial_shapes(mixed, poles)
    for z, shape in zip(poles, shapes, strict=True):
        value, size = matrix_at(coefficients, z)
        own = shape / units
        assert np.linalg.norm(value @ own) < 1e-13 * size * np.linalg.norm(own)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_poles_of_autoregressions_of_every_order_are_exact_for_coefficients_next_to_theirs(noise):
    orders = autoregressions(noise)
    found, _, converged = _core.polynomial_eigenvalues(orders)
    assert all(converged)
    for coefficients, poles in zip(orders, found, strict=True):
        assert len(poles) == coefficients.shape[0] * coefficients.shape[1]
        # The rounding of a sum of some forty terms.
        assert backward_error(coefficients, poles).max() < 5 * EPS


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_poles_of_autoregressions_are_those_of_the_companion_matrix(noise):
    orders = autoregressions(noise)
    for p in (2, 3, 5, 10, 20, 40):
        coefficients = orders[p - 2]
        values, condition = conditions(coefficients)
        found = _core.polynomial_eigenvalues(orders[: p - 1])[0][-1]
        tolerance = 10 * EPS * condition.max() * np.linalg.norm(companion(coefficients), 2)
        assert distance(found, values).max() < tolerance


def test_an_order_gives_the_same_poles_alone_as_after_its_neighbours():
    orders = autoregressions(0.01)
    together = _core.polynomial_eigenvalues(orders)[0]
    for p in (2, 9, 17, 33):
        # Two runs to rounding of poles with conditions up to a hundred.
        assert distance(together[p], solve(orders[p])).max() < 1e-12


def test_orders_may_skip_or_fall():
    orders = autoregressions(0.01)
    picked = [orders[i] for i in (30, 5, 18, 5, 0)]
    found, _, converged = _core.polynomial_eigenvalues(picked)
    assert all(converged)
    for coefficients, poles in zip(picked, found, strict=True):
        assert distance(poles, solve(coefficients)).max() < 1e-12  # two runs to rounding


def test_no_random_polynomial_in_a_thousand_loses_an_eigenvalue():
    rng = np.random.default_rng(8)
    for _ in range(1000):
        m, p = rng.integers(1, 7), rng.integers(1, 9)
        coefficients = rng.normal(size=(p, m, m)) * rng.choice([0.1, 1.0, 3.0])
        # Two eigenvalues of a random matrix that nearly meet lose half the digits, not more.
        assert distance(solve(coefficients), np.linalg.eigvals(companion(coefficients))).max() < 1e-7


@cache
def coarse_autoregressions() -> list[Array]:
    """Likewise: a noisy decay in two channels, and one of a few steps that comes to rest.

    Its rest is rounding, not quite zero, from sample 20 on. From order 20 on it follows itself, zᵖ = z^(p−1), but for
    rounding.
    """
    rng = np.random.default_rng(4)
    mu = np.exp([-0.004 + 0.08j, -0.02 + 0.31j, -0.01 + 0.7j])
    shapes = rng.normal(size=(3, 2)) + 0.2j * rng.normal(size=(3, 2))
    values = (mu ** np.arange(900)[:, None] @ shapes).real
    values += 0.01 * values.std(axis=0) * rng.normal(size=values.shape)
    steps = np.where(np.arange(900) < 20, rng.integers(-2, 3, 900), 1e-11)
    values = np.column_stack([values / np.linalg.norm(values, axis=0), steps / np.linalg.norm(steps)])
    out = []
    for p in range(2, 41):
        past = np.hstack([values[p - j : len(values) - j] for j in range(1, p + 1)])
        held = np.vstack([past, EPS * np.eye(3 * p)])
        solution = np.linalg.lstsq(held, np.vstack([values[p:], np.zeros((3 * p, 3))]), rcond=None)[0]
        out.append(np.ascontiguousarray(solution.reshape(p, 3, 3).transpose(0, 2, 1)))
    return out


def test_every_order_of_coarse_data_converges_to_all_of_its_poles():
    orders = coarse_autoregressions()
    found, _, converged = _core.polynomial_eigenvalues(orders)
    assert all(converged)
    for coefficients, poles in zip(orders, found, strict=True):
        # A pole that is missing, or only near, is worth 1e-5 or more; the rest is the rounding of some hundred terms.
        assert abs(poles.sum() - np.trace(coefficients[0])) < 1e-11 * np.abs(poles).sum()
        balanced, _ = matrix_balance(companion(coefficients))
        values, right = np.linalg.eig(balanced)
        condition = np.linalg.norm(np.linalg.inv(right), axis=1) * np.linalg.norm(right, axis=0)
        apart = np.abs(poles[:, None] - values)
        own, partner = linear_sum_assignment(apart)
        # LAPACK's rounding of the balanced matrix, times the condition of each eigenvalue.
        assert (apart[own, partner] < 10 * EPS * condition[partner] * np.linalg.norm(balanced, 2)).all()


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("small", [1e-17, 1e-30])
def test_a_channel_that_follows_itself_faintly_has_its_poles_on_their_ring(small, turned):
    p = 40
    coefficients = np.zeros((p, 3, 3))
    coefficients[:, :2, :2] = inner = random(11, p, 2, 0.3)
    coefficients[:, :2, 2] = random(12, p, 2)[:, 0]
    coefficients[-1, 2, 2] = small
    ring = small ** (1 / p) * np.exp(2j * np.pi * np.arange(p) / p)  # zᵖ = small
    poles = solve(coefficients.transpose(0, 2, 1) if turned else coefficients)
    # Both parts are well conditioned, once rows and columns are of like size.
    assert distance(poles, np.concatenate([solve(inner), ring])).max() < 1e-13


# --- Closed forms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 3, 7, 20])
def test_one_channel_has_the_roots_of_its_polynomial(degree):
    coefficients = random(degree, degree, 1)
    roots = np.roots(np.concatenate([[1.0], -coefficients[:, 0, 0]]))
    assert distance(solve(coefficients), roots).max() < 1e-12  # numpy's rounding, times conditions of random roots


@pytest.mark.parametrize("root", [0.5, -3.0, 1e-5, 1e5])
def test_a_first_order_of_one_channel_is_its_coefficient(root):
    np.testing.assert_allclose(solve(np.array([[[root]]])), [root], rtol=EPS)  # the rounding of 1/z


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_roots_of_unity_stand_on_the_unit_circle(sign):
    coefficients = np.zeros((8, 1, 1))
    coefficients[-1] = sign
    angles = 2 * np.pi * (np.arange(8) + (0 if sign > 0 else 0.5)) / 8
    assert distance(solve(coefficients), np.exp(1j * angles)).max() < 4 * EPS


def test_a_symmetric_matrix_has_real_eigenvalues_only():
    matrix = random(2, 1, 8)[0]
    found = solve((matrix + matrix.T)[None])
    assert not found.imag.any()
    np.testing.assert_allclose(np.sort(found.real), np.linalg.eigvalsh(matrix + matrix.T), atol=1e-14)


def test_real_poles_of_a_decay_are_found_as_real_numbers():
    roots = [0.95, 0.6, 0.3, -0.2, -0.7, -1.4]
    found = solve(scalar(roots))
    assert not found.imag.any()
    # Coefficients to rounding move roots this close together by some hundred times as much.
    np.testing.assert_allclose(np.sort(found.real), np.sort(roots), atol=1e-13)


def test_poles_that_two_equal_structures_share_are_found_twice():
    one = random(4, 5, 3)
    both = np.stack([np.kron(np.eye(2), a) for a in one])
    # Each is a double eigenvalue without a chain: as well conditioned as a simple one.
    assert distance(solve(both), np.repeat(solve(one), 2)).max() < 1e-13


def test_double_poles_of_one_order_do_not_stay_together_in_the_next():
    orders = [np.stack([np.kron(np.eye(2), a) for a in random(p, p, 3)]) for p in range(1, 9)]
    found, _, converged = _core.polynomial_eigenvalues(orders)
    assert all(converged)
    for p, poles in enumerate(found, 1):
        assert distance(poles, np.repeat(solve(random(p, p, 3)), 2)).max() < 1e-13  # as above


def test_zeros_of_one_order_do_not_hide_the_poles_of_the_next():
    first = np.array([[[0.0, 0.5], [0.0, 0.0]]])  # a chain of two zeros
    both = np.concatenate([first, np.diag([-0.5, 0.0])[None]])
    found = _core.polynomial_eigenvalues([first, both])[0][1]
    root = np.sqrt(0.5)
    # The zeros are a chain of two, which loses half the digits.
    assert distance(found, np.array([0, 0, 1j * root, -1j * root])).max() < 10 * np.sqrt(EPS)


def test_six_equal_channels_have_every_root_six_times():
    recursion = np.array([1.2, -0.5, 0.3])
    roots = np.roots([1.0, *-recursion])
    found = solve(recursion[:, None, None] * np.eye(6))
    assert distance(found, np.repeat(roots, 6)).max() < 1e-13  # semi-simple: no digits lost


def test_a_chain_of_equal_poles_is_found_to_rounding_of_the_coefficients_or_reported():
    coefficients = scalar([0.9] * 6)
    (found,), _, (converged,) = _core.polynomial_eigenvalues([coefficients])
    assert not converged  # the sum of the roots does not confirm them
    assert backward_error(coefficients, found).max() < 5 * EPS
    # A chain of six spreads like the sixth root of rounding, 2.5e-3.
    assert np.abs(found - 0.9).max() < 10 * EPS ** (1 / 6)


def test_coefficients_of_zero_at_the_end_are_eigenvalues_of_zero():
    inner = random(7, 3, 3)
    found = solve(np.concatenate([inner, np.zeros((2, 3, 3))]))
    np.testing.assert_array_equal(found[:6], 0)
    assert distance(found[6:], solve(inner)).max() < 1e-14
    np.testing.assert_array_equal(solve(np.zeros((3, 2, 2))), 0)


# --- What every set obeys -----------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [1, 4, 6])
def test_eigenvalues_come_by_rising_angle_each_beside_its_exact_conjugate(m):
    found = solve(random(m, 7, m))
    np.testing.assert_array_equal(np.sort_complex(found), np.sort_complex(found.conj()))
    angles = np.abs(np.angle(found))
    assert (np.diff(angles) >= 0).all()
    upper = np.flatnonzero(found.imag > 0)
    np.testing.assert_array_equal(found[upper + 1], found[upper].conj())


def test_eigenvalues_add_up_to_the_trace_and_multiply_to_the_determinant():
    coefficients = random(9, 12, 6)
    found = solve(coefficients)
    assert found.sum().real == pytest.approx(np.trace(coefficients[0]), abs=1e-12)  # 72 numbers of order one
    size = np.log(np.abs(found)).sum()
    assert size == pytest.approx(np.linalg.slogdet(coefficients[-1])[1], abs=1e-11)  # likewise, of logarithms


@pytest.mark.parametrize("m", [1, 2, 6, 12])
def test_shapes_are_unit_vectors_that_the_polynomial_takes_to_zero(m):
    coefficients = random(m, 9, m)
    poles = solve(coefficients)
    shapes = _core.polynomial_shapes(coefficients, poles)
    np.testing.assert_allclose(np.linalg.norm(shapes, axis=1), 1, rtol=1e-14)
    largest = shapes[np.arange(len(shapes)), np.abs(shapes).argmax(axis=1)]
    assert (largest.real > 0).all()
    np.testing.assert_allclose(largest.imag, 0, atol=4 * EPS)
    for z, shape in zip(poles, shapes, strict=True):
        value, size = matrix_at(coefficients, z)
        assert np.linalg.norm(value @ shape) < 10 * EPS * size


def test_shapes_are_the_ends_of_the_companion_matrix_vectors():
    coefficients = autoregressions(0.01)[10]
    values, vectors = np.linalg.eig(companion(coefficients))
    expected = vectors[-3:].T / np.linalg.norm(vectors[-3:], axis=0)[:, None]
    alike = np.abs((expected.conj() * _core.polynomial_shapes(coefficients, values)).sum(axis=1))
    np.testing.assert_allclose(alike, 1, atol=1e-12)  # a cosine: the square of an angle of 1e-6 at most


def test_the_backward_error_is_the_smallest_singular_value():
    coefficients = random(1, 5, 4)
    rng = np.random.default_rng(2)
    points = rng.normal(size=40) + 1j * rng.normal(size=40)  # anywhere, inside and outside the unit circle
    expected = backward_error(coefficients, points)
    # Inverse iteration comes from above, and is not at its end where two singular values are alike.
    found = _core.polynomial_backward_errors(coefficients, points)
    assert (found >= expected * (1 - 1e-12)).all()
    assert (found <= expected * 2).all()
    near = solve(coefficients) * (1 + 1e-6)
    expected = backward_error(coefficients, near)
    np.testing.assert_allclose(_core.polynomial_backward_errors(coefficients, near), expected, rtol=1e-6)


# --- Cost and refusals --------------------------------------------------------------------------------------


def test_an_order_takes_about_fifteen_sweeps():
    _, sweeps, _ = _core.polynomial_eigenvalues(autoregressions(0.01))
    assert np.mean(sweeps) < 20  # quadratic convergence from the order before
    assert max(sweeps) < 60


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        (np.zeros((2, 3, 2)), r"coefficients: found an array of shape \[2, 3, 2\], expected \(any, 2, 2\)"),
        (np.zeros((3, 3)), r"coefficients: found an array of shape \[3, 3\]"),
        (np.zeros((0, 3, 3)), "coefficients: found 0 values, expected 9"),
        (np.full((1, 2, 2), np.nan), "coefficients: found NaN, expected finite numbers"),
    ],
)
def test_what_is_no_polynomial_is_refused(coefficients, message):
    with pytest.raises(ValueError, match=message):
        _core.polynomial_eigenvalues([coefficients])
    with pytest.raises(ValueError, match=message):
        _core.polynomial_shapes(coefficients, np.ones(1, dtype=complex))
    with pytest.raises(ValueError, match=message):
        _core.polynomial_backward_errors(coefficients, np.ones(1, dtype=complex))


def test_orders_of_different_channels_are_refused():
    with pytest.raises(ValueError, match=r"expected \(any, 2, 2\)"):
        _core.polynomial_eigenvalues([np.ones((1, 2, 2)), np.ones((1, 3, 3))])


def test_no_orders_give_no_poles():
    assert _core.polynomial_eigenvalues([]) == ([], [], [])
