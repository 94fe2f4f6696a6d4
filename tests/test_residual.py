"""The residual that the core reduces is that of Huynh et al. 2021, Eq. 22: against plain NumPy, written out here."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from armonic import _core

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Both sides solve Z x = b with a condition number below 1e3, so each is good to about 1e-13 of its largest terms.
EQUAL = 1e-12


@dataclass(frozen=True)
class Case:
    """A linear system with r spring-dampers in random directions, and responses that were "measured" on it."""

    mass: Array
    damping: Array
    stiffness: Array
    directions: Array
    outputs: Array
    inputs: Array
    s: Complex
    measured: Complex
    weights: Array

    @property
    def target(self) -> tuple[_core.LinearSystem, Complex, Complex, Array]:
        system = _core.LinearSystem(
            mass=self.mass,
            damping=self.damping,
            stiffness=self.stiffness,
            directions=self.directions,
            outputs=self.outputs,
            inputs=self.inputs,
        )
        return system, self.s, self.measured, self.weights

    def rows(self, spring: Array, damper: Array) -> tuple[Array, Array]:
        """Residual (N,) and Jacobian (N, 2r) by the logarithms of all springs, then all dampers; one line at a time."""
        B, residual, jacobian = self.directions, [], []
        for s, measured, weight in zip(self.s, self.measured, self.weights, strict=True):
            Z = s**2 * self.mass + s * self.damping + self.stiffness + B.T @ np.diag(spring + s * damper) @ B
            inverse = np.linalg.inv(Z)
            H = self.outputs @ inverse @ self.inputs.T
            left, right = self.outputs @ inverse @ B.T, B @ inverse @ self.inputs.T
            by_impedance = -np.einsum("ar,rb->abr", left, right) / H[:, :, None]
            gradient = np.concatenate([by_impedance * spring, by_impedance * s * damper], axis=2)
            root = np.sqrt(weight)
            size, turn = np.log(np.abs(H) / np.abs(measured)), np.angle(H / measured)
            residual += [root * size, root * turn]
            jacobian += [root[..., None] * gradient.real, root[..., None] * gradient.imag]
        return np.ravel(residual), np.reshape(jacobian, (-1, 2 * len(spring)))


def symmetric(rng: np.random.Generator, n: int, *, least: float) -> Array:
    square = rng.normal(size=(n, n))
    return square @ square.T / n + least * np.eye(n)


def case(seed: int, *, n: int = 5, r: int = 4, shape: tuple[int, int] = (3, 3), lines: int = 40) -> Case:
    rng = np.random.default_rng([seed, n, r, *shape, lines])
    # Any phase, so that differences beyond half a turn have to be wrapped.
    measured = rng.lognormal(size=(lines, *shape)) * np.exp(1j * rng.uniform(-np.pi, np.pi, (lines, *shape)))
    return Case(
        mass=symmetric(rng, n, least=1.0),
        damping=symmetric(rng, n, least=0.5),
        stiffness=symmetric(rng, n, least=1.0),
        directions=rng.normal(size=(r, n)),
        outputs=rng.normal(size=(shape[0], n)),
        inputs=rng.normal(size=(shape[1], n)),
        s=2j * np.pi * np.sort(rng.uniform(0.05, 0.6, lines)),
        measured=measured,
        weights=rng.uniform(0.1, 80.0, (lines, *shape)),
    )


def impedances(r: int, seed: int = 0) -> tuple[Array, Array]:
    return tuple(np.random.default_rng([seed, r]).uniform(0.5, 3.0, (2, 1, r)))


def reduced(cases: Sequence[Case], free: Sequence[int]) -> Array:
    spring, damper = impedances(len(cases[0].directions))
    return _core.Problem([c.target for c in cases]).reduce(spring, damper, free)


def written_out(cases: Sequence[Case], free: Sequence[int]) -> Array:
    """[J r] with all its rows."""
    spring, damper = impedances(len(cases[0].directions))
    parts = [c.rows(spring[0], damper[0]) for c in cases]
    return np.column_stack([np.vstack([J for _, J in parts])[:, free], np.concatenate([r for r, _ in parts])])


def assert_same_products(triangle: Array, rows: Array) -> None:
    """RᵀR = [J r]ᵀ[J r], each entry relative to the lengths of the two columns it belongs to."""
    assert np.array_equal(triangle, np.triu(triangle))
    expected = rows.T @ rows
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(triangle.T @ triangle - expected) / scale).max() < EQUAL


@pytest.mark.parametrize("shape", [(3, 3), (1, 1), (2, 3), (3, 1), (6, 3)])
@pytest.mark.parametrize(("n", "r"), [(1, 1), (5, 4), (9, 9), (6, 8)])
def test_the_triangle_stands_for_all_rows_of_residual_and_jacobian(n: int, r: int, shape: tuple[int, int]) -> None:
    c = case(1, n=n, r=r, shape=shape)
    everything = list(range(2 * r))
    assert_same_products(reduced([c], everything), written_out([c], everything))


@pytest.mark.parametrize("free", [[], [0], [7], [3, 0, 5], [6, 6]])
def test_the_triangle_has_the_columns_that_were_asked_for_in_that_order(free: list[int]) -> None:
    assert_same_products(reduced([case(2)], free), written_out([case(2)], free))


def test_any_number_of_lines_is_reduced_whole() -> None:
    for lines in range(1, 71):
        c = case(3, n=3, r=2, shape=(2, 1), lines=lines)
        assert_same_products(reduced([c], [0, 1, 2, 3]), written_out([c], [0, 1, 2, 3]))


@pytest.mark.parametrize("lines", [127, 128, 129, 1000])
def test_long_measurements_are_reduced_whole(lines: int) -> None:
    c = case(4, lines=lines)
    assert_same_products(reduced([c], [1, 4]), written_out([c], [1, 4]))


def test_several_measurements_of_different_shape_and_length_add_up() -> None:
    several = [case(5), case(6, shape=(1, 2), lines=7), case(7, n=3, shape=(2, 2), lines=70)]
    assert_same_products(reduced(several, list(range(8))), written_out(several, list(range(8))))


def test_the_cost_is_the_double_sum_of_equation_22() -> None:
    c = case(8)
    spring, damper = impedances(4)
    cost = 0.0
    for k, s in enumerate(c.s):
        Z = s**2 * c.mass + s * c.damping + c.stiffness
        for b, z in zip(c.directions, spring[0] + s * damper[0], strict=True):
            Z = Z + z * np.outer(b, b)
        H = c.outputs @ np.linalg.solve(Z, c.inputs.T)
        for i in range(3):
            for j in range(3):
                difference = np.log(H[i, j]) - np.log(c.measured[k, i, j])
                turns = round(difference.imag / (2 * np.pi))
                difference -= 2j * np.pi * turns
                cost += c.weights[k, i, j] * (difference.conjugate() * difference).real
    assert np.sum(reduced([c], [0, 5])[:, -1] ** 2) == pytest.approx(cost, rel=EQUAL)


def test_the_jacobian_is_the_slope_of_the_residual() -> None:
    # The written-out Jacobian itself against central differences of the written-out residual: an error of h² = 1e-10
    # times the third derivative, and of 1e-16 / h from rounding.
    c, h = case(9), 1e-5
    spring, damper = (values[0] for values in impedances(4))
    residual, jacobian = c.rows(spring, damper)
    steps = np.exp(h * np.eye(8))
    ends = [
        [c.rows(*(np.concatenate([spring, damper]) * factor).reshape(2, -1))[0] for factor in (step, 1 / step)]
        for step in steps
    ]
    slopes = np.column_stack([(up - down) / (2 * h) for up, down in ends])
    assert residual.shape == (len(slopes),)
    np.testing.assert_allclose(jacobian, slopes, atol=1e-8 * np.abs(jacobian).max())


def test_costs_of_many_sets_are_those_of_one_at_a_time() -> None:
    problem = _core.Problem([case(10).target, case(11, lines=130).target])
    spring, damper = (np.random.default_rng(i).uniform(0.5, 3.0, (25, 4)) for i in (0, 1))
    singly = [np.sum(problem.reduce(k[None], d[None], [])[:, -1] ** 2) for k, d in zip(spring, damper, strict=True)]
    assert np.array_equal(problem.costs(spring, damper), singly)


def test_a_weight_of_zero_leaves_a_value_out_whatever_it_holds() -> None:
    c = case(12)
    measured, weights = c.measured.copy(), c.weights.copy()
    weights[5], weights[7, 0, 1], measured[7, 0, 1] = 0.0, 0.0, 0.0
    spring, damper = impedances(4)
    triangle = _core.Problem([(c.target[0], c.s, measured, weights)]).reduce(spring, damper, [0, 6])
    measured[weights == 0] = 1.0
    kept = Case(**{**vars(c), "measured": measured, "weights": weights})
    assert_same_products(triangle, written_out([kept], [0, 6]))
    shorter = Case(
        **{**vars(kept), **{name: np.delete(vars(kept)[name], 5, 0) for name in ("s", "measured", "weights")}}
    )
    assert_same_products(triangle, written_out([shorter], [0, 6]))


@pytest.mark.parametrize("weights", ["peaks", "uniform"])
def test_the_cost_does_not_depend_on_the_kind_of_response(weights: str) -> None:
    robot = am.load("huynh_3r")
    start = robot.with_values({path: 1.2 * value for path, value in robot.parameters().items()})
    H = am.frf(robot, "milling", np.arange(1, 151) / 5, frame="sensor")
    costs = [
        am.update(start, am.Measurement(H.to(kind), "milling", weights=weights), max_evaluations=1).cost
        for kind in ("receptance", "mobility", "accelerance")
    ]
    # The power of iω is multiplied in and divided out again: a few roundings per value.
    np.testing.assert_allclose(costs, costs[0], rtol=1e-12)


SCRIPT = """
import hashlib, sys
sys.path.insert(0, sys.argv[1])
from test_residual import many_tasks
print(hashlib.sha256(many_tasks()).hexdigest())
"""


def many_tasks() -> bytes:
    """Results of a problem that is shared out in several pieces."""
    problem = _core.Problem([case(13, lines=700).target, case(14, lines=333).target])
    spring, damper = impedances(4)
    return problem.reduce(spring, damper, list(range(8))).tobytes() + problem.costs(spring, damper).tobytes()


@pytest.mark.parametrize("threads", ["1", "2", "7"])
def test_results_are_the_same_bit_for_bit_on_any_number_of_threads(threads: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(Path(__file__).parent)],
        env={**os.environ, "RAYON_NUM_THREADS": threads},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == hashlib.sha256(many_tasks()).hexdigest()


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("measured", 0.0, "zero"),
        ("measured", np.nan, "finite"),
        ("measured", np.inf, "finite"),
        ("weights", -1e-300, "zero or more"),
        ("weights", np.nan, "finite"),
        ("weights", np.inf, "finite"),
        ("s", np.nan, "finite"),
    ],
)
def test_a_bad_number_is_refused(field: str, value: float, message: str) -> None:
    arrays = {name: vars(case(15))[name].copy() for name in ("s", "measured", "weights")}
    arrays[field].flat[-1] = value
    with pytest.raises(ValueError, match=message):
        _core.Problem([(case(15).target[0], arrays["s"], arrays["measured"], arrays["weights"])])


@pytest.mark.parametrize(
    ("s", "measured", "weights"),
    [
        (np.ones(3, complex), np.ones((4, 3, 3), complex), np.ones((4, 3, 3))),
        (np.ones(4, complex), np.ones((4, 3, 2), complex), np.ones((4, 3, 3))),
        (np.ones(4, complex), np.ones((4, 3, 3), complex), np.ones((4, 9))),
        (np.ones(0, complex), np.ones((0, 3, 3), complex), np.ones((0, 3, 3))),
    ],
)
def test_arrays_that_do_not_fit_are_refused(s: Complex, measured: Complex, weights: Array) -> None:
    with pytest.raises(ValueError, match=r"needed|expected"):
        _core.Problem([(case(16).target[0], s, measured, weights)])


def test_a_problem_needs_a_target_and_one_list_of_impedances() -> None:
    with pytest.raises(ValueError, match="targets"):
        _core.Problem([])
    with pytest.raises(ValueError, match="impedances"):
        _core.Problem([case(17, r=4).target, case(17, r=3).target])


def test_parameters_that_are_not_there_are_refused() -> None:
    problem = _core.Problem([case(18).target])
    spring, damper = impedances(4)
    with pytest.raises(ValueError, match="8"):
        problem.reduce(spring, damper, [8])
    with pytest.raises(ValueError, match="stiffness"):
        problem.reduce(np.vstack([spring, spring]), np.vstack([damper, damper]), [0])
    with pytest.raises(ValueError, match=r"shape|length|needed|expected"):
        problem.reduce(spring[:, :3], damper[:, :3], [0])
    with pytest.raises(ValueError, match="finite"):
        problem.reduce(spring * np.nan, damper, [0])


def one_mass(*, outputs: float) -> _core.LinearSystem:
    """1 kg on a spring, without damping."""
    one, zero = np.ones((1, 1)), np.zeros((1, 1))
    return _core.LinearSystem(mass=one, damping=zero, stiffness=zero, directions=one, outputs=outputs * one, inputs=one)


@pytest.mark.parametrize(("outputs", "message"), [(1.0, "singular|dynamic stiffness"), (0.0, "zero")])
def test_a_model_without_an_answer_is_an_error_and_no_nan(outputs: float, message: str) -> None:
    # At ω = 2 a spring of 4 N/m cancels the inertia; an output that does not move has no logarithm.
    s = np.array([1j, 2j if outputs else 3j])
    problem = _core.Problem([(one_mass(outputs=outputs), s, np.ones((2, 1, 1), complex), np.ones((2, 1, 1)))])
    with pytest.raises(ArithmeticError, match=message):
        problem.reduce(np.array([[4.0]]), np.array([[0.0]]), [0])
