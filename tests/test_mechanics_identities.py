"""The mechanics obeys its own laws: identities between independent algorithms, checked on random trees.

Differences are central at three steps, extrapolated (Richardson), so that their truncation, of sixth order in
a step of 0.02, stays near 1e-10 of the differentiated quantity and their rounding below it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from armonic import _core
from trees import Array, Tree, random_body, random_state, random_tree, relative_difference

SEEDS = range(12)
Wrenches = list[tuple[int, list[float]]]


@pytest.fixture(params=SEEDS)
def tree(request: pytest.FixtureRequest) -> Tree:
    return random_tree(500 + request.param, n=3 + request.param % 10)


@pytest.fixture
def state(tree: Tree) -> list[Array]:
    return random_state(len(tree.parents), tree.n)


def wrenches_on(tree: Tree) -> Wrenches:
    rng = np.random.default_rng(tree.n)
    return [(frame, list(rng.uniform(-50.0, 50.0, 6))) for frame in range(len(tree.frame_nodes))]


def derivative(function: Callable[[Array], Array], at: Array, step: float = 0.02) -> Array:
    """Derivatives of a function by every entry of its argument, along the last axis."""

    def central(h: float) -> Array:
        moves = h * np.eye(len(at))
        return np.stack([(function(at + m) - function(at - m)) / (2 * h) for m in moves], axis=-1)

    first, second, third = (central(step / 2**k) for k in range(3))
    first, second = (4 * second - first) / 3, (4 * third - second) / 3
    return (16 * second - first) / 15


def random_symmetric(rng: np.random.Generator, scale: float) -> Array:
    """A full positive definite 6x6 matrix."""
    root = rng.normal(size=(6, 6))
    return scale * (root @ root.T + np.eye(6))


def bushing_between(
    mechanism: _core.Mechanism, frames: tuple[int, int], *, seed: int = 0, rest: Array | None = None
) -> tuple[_core.Bushing, Array, Array]:
    rng = np.random.default_rng(seed)
    stiffness, damping = random_symmetric(rng, 100.0), random_symmetric(rng, 5.0)
    rest = np.zeros(mechanism.n) if rest is None else rest
    bushing = _core.Bushing(mechanism, *frames, stiffness=stiffness, damping=damping, rest=rest)
    return bushing, stiffness, damping


def deformation(mechanism: _core.Mechanism, frames: tuple[int, int], rest: Array, q: Array) -> Array:
    """Shift over twice the vector part of the turn's quaternion, in the axes of frame a, from poses alone.

    The vector part of the quaternion of R is vee(R - Rᵀ) / (4 w) with 2 w = sqrt(1 + trace R).
    """

    def relative(at: Array) -> Array:
        return np.linalg.inv(mechanism.pose(at, frames[0])) @ mechanism.pose(at, frames[1])

    now, before = relative(q), relative(rest)
    turn = now[:3, :3] @ before[:3, :3].T
    odd = turn - turn.T
    vee = np.array([odd[2, 1], odd[0, 2], odd[1, 0]])
    return np.concatenate([now[:3, 3] - before[:3, 3], vee / np.sqrt(1.0 + np.trace(turn))])


# --- Poses and Jacobians ------------------------------------------------------------------------------------


def test_jacobian_columns_are_the_rates_of_the_pose(tree, state):
    mechanism, (q, _, _) = tree.mechanism(), state
    for frame in range(len(tree.frame_nodes)):
        pose, slope = mechanism.pose(q, frame), derivative(lambda x, f=frame: mechanism.pose(x, f), q)
        spin = np.einsum("ijc,kj->ikc", slope[:3, :3], pose[:3, :3])
        expected = np.vstack([slope[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
        assert relative_difference(mechanism.jacobian(q, frame), expected) < 1e-8


def test_jacobian_in_own_axes_is_the_world_one_turned(tree, state):
    mechanism, (q, _, _) = tree.mechanism(), state
    for frame in range(len(tree.frame_nodes)):
        turn = np.kron(np.eye(2), mechanism.pose(q, frame)[:3, :3].T)
        found = mechanism.jacobian(q, frame, own_axes=True)
        # Rounding only.
        assert relative_difference(found, turn @ mechanism.jacobian(q, frame)) < 1e-13


# --- Mass, energy, power ------------------------------------------------------------------------------------


def test_mass_matrix_is_inverse_dynamics_column_by_column(tree, state):
    mechanism, (q, _, _) = tree.mechanism(), state
    rest, gravity = np.zeros(tree.n), mechanism.gravity_torque(q)
    columns = [mechanism.inverse_dynamics(q, rest, e) - gravity for e in np.eye(tree.n)]
    # Rounding of two recursions, with the gravity torque subtracted.
    assert relative_difference(mechanism.mass_matrix(q), np.array(columns).T) < 1e-12


def test_mass_matrix_sums_the_kinetic_energy_of_the_bodies(tree, state):
    mechanism, (q, _, _) = tree.with_com_frames().mechanism(), state
    expected = np.zeros((tree.n, tree.n))
    for body, (mass, tensor) in enumerate(zip(tree.masses, tree.inertias, strict=True)):
        J = mechanism.jacobian(q, body, own_axes=True)
        expected += mass * J[:3].T @ J[:3] + J[3:].T @ tensor @ J[3:]
    found = mechanism.mass_matrix(q)
    assert relative_difference(found, expected) < 1e-12  # rounding only
    assert (found == found.T).all()
    assert np.linalg.eigvalsh(found).min() > 0


def test_forward_dynamics_inverts_inverse_dynamics(tree, state):
    mechanism, (q, qd, qdd), wrenches = tree.mechanism(), state, wrenches_on(tree)
    tau = mechanism.inverse_dynamics(q, qd, qdd, wrenches=wrenches)
    found = mechanism.forward_dynamics(q, qd, tau, wrenches=wrenches)
    # Rounding times the condition number of the mass matrix, below 1e5 here.
    assert relative_difference(found, qdd) < 1e-9


def test_inverse_dynamics_is_the_sum_of_its_parts(tree, state):
    mechanism, (q, qd, qdd), wrenches = tree.mechanism(), state, wrenches_on(tree)
    expected = mechanism.mass_matrix(q) @ qdd + mechanism.bias(q, qd) + mechanism.gravity_torque(q)
    for frame, wrench in wrenches:
        expected -= mechanism.jacobian(q, frame).T @ wrench
    found = mechanism.inverse_dynamics(q, qd, qdd, wrenches=wrenches)
    assert relative_difference(found, expected) < 1e-12  # rounding only


def test_gravity_torque_is_the_gradient_of_the_potential_energy(tree, state):
    mechanism, (q, _, _) = tree.with_com_frames().mechanism(), state

    def potential(q: Array) -> Array:
        heights = [mechanism.pose(q, body)[:3, 3] @ tree.gravity for body in range(len(tree.masses))]
        return -tree.masses @ heights

    assert relative_difference(mechanism.gravity_torque(q), derivative(potential, q)) < 1e-8


def test_bias_does_the_work_that_changes_the_kinetic_energy(tree, state):
    mechanism, (q, qd, _) = tree.mechanism(), state
    # q̇ᵀ (Ṁ − 2 C) q̇ = 0, with Ṁ along the motion.
    change = derivative(lambda t: mechanism.mass_matrix(q + t[0] * qd), np.zeros(1), step=0.01)[..., 0]
    power = qd @ mechanism.bias(q, qd)
    assert abs(power - 0.5 * qd @ change @ qd) < 1e-8 * np.abs(change).max() * (qd @ qd)


def test_bias_holds_the_christoffel_symbols_of_the_mass_matrix(tree, state):
    mechanism, (q, qd, _) = tree.mechanism(), state
    slope = derivative(mechanism.mass_matrix, q)  # [i, j, k] = ∂M_ij/∂q_k
    expected = np.einsum("ijk,j,k->i", slope, qd, qd) - 0.5 * np.einsum("jki,j,k->i", slope, qd, qd)
    assert relative_difference(mechanism.bias(q, qd), expected) < 1e-8


def test_bias_is_quadratic_in_the_velocity(tree, state):
    mechanism, (q, qd, _) = tree.mechanism(), state
    expected = 9.0 * mechanism.bias(q, qd)
    assert relative_difference(mechanism.bias(q, -3.0 * qd), expected) < 1e-12  # rounding only


# --- Tangent matrices ---------------------------------------------------------------------------------------


def test_tangent_matrices_are_the_derivatives_of_inverse_dynamics_and_bushing_forces(tree, state):
    mechanism, (q, qd, qdd), wrenches = tree.mechanism(), state, wrenches_on(tree)
    bushings = [bushing_between(mechanism, frames, seed=i)[0] for i, frames in enumerate([(0, 1), (2, 3), (1, 3)])]

    def forces(q: Array, qd: Array, qdd: Array) -> Array:
        tau = mechanism.inverse_dynamics(q, qd, qdd, wrenches=wrenches)
        return tau + sum(bushing.force(mechanism, q, qd) for bushing in bushings)

    mass, damping, stiffness = mechanism.linearize(q, qd, qdd, wrenches=wrenches, bushings=bushings)
    # A bushing deformed by almost a half turn bends sharply, hence the smaller step for the stiffness.
    # By the rates the forces are linear and quadratic, so that only rounding is left.
    assert relative_difference(mass, derivative(lambda x: forces(q, qd, x), qdd)) < 1e-9
    assert relative_difference(damping, derivative(lambda x: forces(q, x, qdd), qd)) < 1e-9
    assert relative_difference(stiffness, derivative(lambda x: forces(x, qd, qdd), q, step=4e-3)) < 1e-8


def test_tangent_stiffness_at_rest_is_symmetric_under_gravity_and_forces(tree, state):
    mechanism, (q, _, _), rest = tree.mechanism(), state, np.zeros(tree.n)
    forces = [(frame, [*wrench[:3], 0.0, 0.0, 0.0]) for frame, wrench in wrenches_on(tree)]
    bushings = [bushing_between(mechanism, frames)[0] for frames in [(0, 1), (2, 3)]]
    stiffness = mechanism.linearize(q, rest, rest, wrenches=forces, bushings=bushings)[2]
    # All of them have a potential; a moment fixed in world axes has none. Rounding only.
    assert relative_difference(stiffness, stiffness.T) < 1e-12


def test_linearize_of_a_robot_at_rest_without_loads_has_no_damping(tree, state):
    mechanism, (q, _, _), rest = tree.mechanism(), state, np.zeros(tree.n)
    mass, damping, _ = mechanism.linearize(q, rest, rest)
    assert (mass == mechanism.mass_matrix(q)).all()
    assert not damping.any()


# --- Bushings -----------------------------------------------------------------------------------------------


def test_bushing_force_is_the_gradient_of_its_energy(tree, state):
    mechanism, (q, qd, _) = tree.mechanism(), state
    frames, rest = (2, 1), q + 0.3 * qd
    bushing, stiffness, _ = bushing_between(mechanism, frames, rest=rest)

    def energy(q: Array) -> Array:
        e = deformation(mechanism, frames, rest, q)
        return 0.5 * e @ stiffness @ e

    found = bushing.force(mechanism, q, np.zeros(tree.n))
    assert relative_difference(found, derivative(energy, q, step=4e-3)) < 1e-8


def test_bushing_directions_are_the_rates_of_its_deformation(tree, state):
    mechanism, (q, qd, _) = tree.mechanism(), state
    frames, rest = (1, 0), q + 0.3 * qd
    bushing, _, damping = bushing_between(mechanism, frames, rest=rest)
    expected = derivative(lambda x: deformation(mechanism, frames, rest, x), q, step=4e-3)
    assert relative_difference(bushing.directions(mechanism, q), expected) < 1e-8
    # The damper takes ėᵀ D ė out of the motion.
    drag = bushing.force(mechanism, q, qd) - bushing.force(mechanism, q, np.zeros(tree.n))
    rate = expected @ qd
    assert qd @ drag == pytest.approx(rate @ damping @ rate, rel=1e-7, abs=1e-9)


def test_bushing_is_unloaded_at_its_rest(tree, state):
    mechanism, (q, _, _) = tree.mechanism(), state
    bushing, stiffness, _ = bushing_between(mechanism, (0, 1), rest=q)
    force = bushing.force(mechanism, q, np.zeros(tree.n))
    # Rounding of the relative pose, times the stiffness.
    assert np.abs(force).max() < 1e-13 * np.abs(stiffness).max()


def test_bushing_within_one_link_exerts_nothing(tree, state):
    q, qd, qdd = state
    last = len(tree.parents) - 1
    mechanism = replace(tree, frame_nodes=[-1, last, last, 0]).mechanism()
    bushing, _, _ = bushing_between(mechanism, (1, 2))
    assert not bushing.force(mechanism, q, qd).any()
    with_it = mechanism.linearize(q, qd, qdd, bushings=[bushing])
    assert (with_it == mechanism.linearize(q, qd, qdd)).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_bushing_reacts_where_it_acts(seed):
    # The first six coordinates move everything as one rigid body: forces between two parts do no work on it.
    tree = random_tree(800 + seed, n=12, floating=True)
    tree = replace(tree, frame_nodes=[-1, len(tree.parents) - 1, 6, 5])
    mechanism, (q, qd, rest) = tree.mechanism(), random_state(seed, 12)
    for frames in [(1, 2), (2, 3), (3, 1)]:
        bushing, _, _ = bushing_between(mechanism, frames, rest=rest)
        force = bushing.force(mechanism, q, qd)
        # Rounding only.
        assert np.abs(force[:6]).max() <= 1e-12 * np.abs(force).max()
    to_ground, _, _ = bushing_between(mechanism, (0, 1), rest=rest)
    assert np.abs(to_ground.force(mechanism, q, qd)[:6]).max() > 1.0


def test_bushing_between_two_sliders_is_the_textbook_spring_and_damper():
    # Two masses on the x axis: force k (x₂ − x₁) + d (v₂ − v₁) on both, with opposite signs.
    mechanism = _core.Mechanism(
        parents=[-1, -1],
        placements=np.tile(np.eye(4), (2, 1, 1)),
        kinds=["prismatic", "prismatic"],
        axes=np.array([[1.0, 0.0, 0.0]] * 2),
        masses=np.array([2.0, 3.0]),
        coms=np.zeros((2, 3)),
        inertias=np.zeros((2, 3, 3)),
        frame_nodes=[0, 1, -1],
        frame_placements=np.tile(np.eye(4), (3, 1, 1)),
        gravity=[0.0, 0.0, -9.81],
    )
    k, d = 100.0, 7.0
    only_x = np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    pair, ground = (
        _core.Bushing(mechanism, *frames, stiffness=k * only_x, damping=d * only_x, rest=np.zeros(2))
        for frames in [(0, 1), (2, 0)]
    )
    q, qd, rest = np.array([0.25, 0.75]), np.array([-1.0, 3.0]), np.zeros(2)
    assert pair.force(mechanism, q, qd).tolist() == [-(k * 0.5 + d * 4.0), k * 0.5 + d * 4.0]
    assert ground.force(mechanism, q, qd).tolist() == [k * 0.25 - d * 1.0, 0.0]
    mass, damping, stiffness = mechanism.linearize(q, qd, rest, bushings=[pair, ground])
    assert mass.tolist() == [[2.0, 0.0], [0.0, 3.0]]
    assert damping.tolist() == [[2 * d, -d], [-d, d]]
    assert stiffness.tolist() == [[2 * k, -k], [-k, k]]


# --- Batches ------------------------------------------------------------------------------------------------


def test_batches_equal_single_calls(tree):
    mechanism, wrenches = tree.mechanism(), wrenches_on(tree)
    bushings = [bushing_between(mechanism, (0, 1))[0]]
    q, qd, other = np.random.default_rng(tree.n).uniform(-2.0, 2.0, (3, 5, tree.n))
    functions: list[Callable[[Array, Array, Array], Array]] = [
        lambda q, qd, x: mechanism.pose(q, 1),
        lambda q, qd, x: mechanism.jacobian(q, 1),
        lambda q, qd, x: mechanism.jacobian(q, 1, own_axes=True),
        lambda q, qd, x: mechanism.mass_matrix(q),
        lambda q, qd, x: mechanism.gravity_torque(q),
        lambda q, qd, x: mechanism.bias(q, qd),
        lambda q, qd, x: mechanism.inverse_dynamics(q, qd, x, wrenches=wrenches),
        lambda q, qd, x: mechanism.forward_dynamics(q, qd, x, wrenches=wrenches),
        lambda q, qd, x: mechanism.linearize(q, qd, x, wrenches=wrenches, bushings=bushings),
    ]
    for function in functions:
        single = np.array([function(*row) for row in zip(q, qd, other, strict=True)])
        # The same arithmetic on the same numbers: equal to the last bit, whatever the memory layout.
        assert np.array_equal(function(q, qd, other), single)
        assert np.array_equal(function(*(np.asfortranarray(x) for x in (q, qd, other))), single)
        assert np.array_equal(function(q[::-2], qd[::-2], other[::-2]), single[::-2])
        assert np.array_equal(function(q[:1], qd[:1], other[:1]), single[:1])
        assert function(q[:0], qd[:0], other[:0]).shape == (0, *single.shape[1:])


def test_a_welded_chain_weighs_what_one_body_weighs():
    # A slider carrying three welded bodies: mass and weight are sums, whatever the placements.
    rng = np.random.default_rng(7)
    masses = np.array([0.0, *(random_body(rng)[0] for _ in range(3))])
    tree = random_tree(1, n=3)
    mechanism = _core.Mechanism(
        parents=[-1, 0, 1, 1],
        placements=np.stack([np.eye(4), *(tree.frame_placements[:3])]),
        kinds=["prismatic", "fixed", "fixed", "fixed"],
        axes=np.array([[0.0, 0.0, 1.0]] + [[0.0, 0.0, 0.0]] * 3),
        masses=masses,
        coms=rng.uniform(-1.0, 1.0, (4, 3)),
        inertias=np.zeros((4, 3, 3)),
        frame_nodes=[],
        frame_placements=np.zeros((0, 4, 4)),
        gravity=[0.0, 0.0, -9.81],
    )
    q = np.array([0.3])
    assert mechanism.mass_matrix(q)[0, 0] == pytest.approx(masses.sum(), rel=1e-14)  # rounding only
    assert mechanism.gravity_torque(q)[0] == pytest.approx(9.81 * masses.sum(), rel=1e-14)
