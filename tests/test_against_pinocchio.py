"""The core against Pinocchio, an independent rigid-body library, on random trees.

Every quantity agrees to 1e-9 of its largest entry. Both sides round in double precision (1e-16) over sums of
some hundred terms that partly cancel; forward dynamics also loses the condition number of the mass matrix,
which is below 1e5 here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from armonic import _core
from trees import Array, Tree, random_state, random_tree, relative_difference

TOLERANCE = 1e-9
# Three trees of every size from 3 to 12 coordinates.
SEEDS = range(30)


@dataclass(frozen=True)
class Pair:
    """One tree in both libraries, and a random state in Armonic's order of coordinates."""

    tree: Tree
    mechanism: _core.Mechanism
    model: pin.Model
    data: pin.Data
    frames: list[int]
    order: Array  # Pinocchio's index of every coordinate
    q: Array
    qd: Array
    qdd: Array

    def there(self, vector: Array) -> Array:
        """A vector of coordinates in Pinocchio's order."""
        out = np.empty_like(vector)
        out[self.order] = vector
        return out

    def back(self, values: Array) -> Array:
        """A vector or square matrix over the coordinates in Armonic's order."""
        return values[np.ix_(*[self.order] * values.ndim)]

    @property
    def state(self) -> tuple[Array, Array, Array]:
        return self.there(self.q), self.there(self.qd), self.there(self.qdd)


def pinocchio_model(tree: Tree) -> tuple[pin.Model, list[int], Array]:
    """The same tree in Pinocchio: model, index of every frame, index of every coordinate.

    Pinocchio wants the joints of a subtree side by side, so it gets them depth first. Fixed nodes become part
    of the body that carries them.
    """
    model = pin.Model()
    model.gravity.linear = tree.gravity
    carriers: dict[int, tuple[int, pin.SE3]] = {-1: (0, pin.SE3.Identity())}
    order = np.zeros(tree.n, dtype=int)
    waiting = [i for i, parent in enumerate(tree.parents) if parent == -1]
    while waiting:
        node = waiting.pop()
        waiting += [i for i, parent in enumerate(tree.parents) if parent == node]
        joint, placement = carriers[tree.parents[node]]
        placement = placement * pin.SE3(tree.placements[node])
        coordinate = tree.coordinate_of[node]
        if coordinate is not None:
            revolute = tree.kinds[node] == "revolute"
            motion = pin.JointModelRevoluteUnaligned if revolute else pin.JointModelPrismaticUnaligned
            joint = model.addJoint(joint, motion(tree.axes[node]), placement, f"node {node}")
            placement = pin.SE3.Identity()
            order[coordinate] = model.joints[joint].idx_v
        body = pin.Inertia(tree.masses[node], tree.coms[node], tree.inertias[node])
        model.appendBodyToJoint(joint, body, placement)
        carriers[node] = (joint, placement)
    frames = []
    for i, node in enumerate(tree.frame_nodes):
        joint, placement = carriers[node]
        placement = placement * pin.SE3(tree.frame_placements[i])
        frames.append(model.addFrame(pin.Frame(f"frame {i}", joint, 0, placement, pin.FrameType.OP_FRAME)))
    return model, frames, order


@cache
def built(seed: int) -> Pair:
    tree = random_tree(seed, n=3 + seed % 10)
    model, frames, order = pinocchio_model(tree)
    q, qd, qdd = random_state(seed, tree.n)
    return Pair(tree, tree.mechanism(), model, model.createData(), frames, order, q, qd, qdd)


@pytest.fixture(params=SEEDS)
def pair(request: pytest.FixtureRequest) -> Pair:
    return built(request.param)


def random_wrenches(pair: Pair) -> list[tuple[int, list[float]]]:
    """A wrench on every frame, the one on the base included; frames may share a body."""
    rng = np.random.default_rng(pair.tree.n)
    return [(frame, list(rng.uniform(-50.0, 50.0, 6))) for frame in range(len(pair.frames))]


def joint_forces(pair: Pair, wrenches: list[tuple[int, list[float]]]) -> list[pin.Force]:
    """The wrenches as Pinocchio takes them: summed per joint, in its axes about its origin."""
    q, _, _ = pair.state
    pin.framesForwardKinematics(pair.model, pair.data, q)
    forces = [pin.Force.Zero() for _ in range(pair.model.njoints)]
    for frame, wrench in wrenches:
        index = pair.frames[frame]
        at = pin.SE3(np.eye(3), pair.data.oMf[index].translation)
        joint = pair.model.frames[index].parentJoint
        forces[joint] += pair.data.oMi[joint].actInv(at.act(pin.Force(np.array(wrench))))
    return forces


def test_random_trees_cover_every_kind_of_mechanism():
    trees = [built(seed).tree for seed in SEEDS]
    assert {tree.n for tree in trees} == set(range(3, 13))
    assert {kind for tree in trees for kind in tree.kinds} == {"fixed", "revolute", "prismatic"}
    branches = [len(tree.parents) - len(set(tree.parents)) for tree in trees]
    assert sum(count > 0 for count in branches) >= 10
    massless = [sum(tree.masses == 0.0) for tree in trees]
    assert sum(count > 0 for count in massless) >= 20
    assert max(np.linalg.cond(built(seed).mechanism.mass_matrix(built(seed).q)) for seed in SEEDS) < 1e5
    # Numbered across branches, not depth first.
    assert sum(bool((np.diff(built(seed).order) != 1).any()) for seed in SEEDS) >= 5


def test_frame_poses_match_pinocchio(pair):
    pin.framesForwardKinematics(pair.model, pair.data, pair.there(pair.q))
    for frame, index in enumerate(pair.frames):
        expected = pair.data.oMf[index].homogeneous
        assert relative_difference(pair.mechanism.pose(pair.q, frame), expected) < TOLERANCE


@pytest.mark.parametrize(
    ("own_axes", "reference"), [(False, pin.LOCAL_WORLD_ALIGNED), (True, pin.LOCAL)], ids=["world", "own"]
)
def test_frame_jacobians_match_pinocchio(pair, own_axes, reference):
    for frame, index in enumerate(pair.frames):
        expected = pin.computeFrameJacobian(pair.model, pair.data, pair.there(pair.q), index, reference)
        expected = expected[:, pair.order]
        found = pair.mechanism.jacobian(pair.q, frame, own_axes=own_axes)
        assert relative_difference(found, expected) < TOLERANCE


def test_mass_matrix_matches_pinocchio(pair):
    upper = np.triu(pin.crba(pair.model, pair.data, pair.there(pair.q)))
    expected = pair.back(upper + np.triu(upper, 1).T)
    assert relative_difference(pair.mechanism.mass_matrix(pair.q), expected) < TOLERANCE


def test_gravity_torque_matches_pinocchio(pair):
    expected = pair.back(pin.computeGeneralizedGravity(pair.model, pair.data, pair.there(pair.q)))
    assert relative_difference(pair.mechanism.gravity_torque(pair.q), expected) < TOLERANCE


def test_bias_matches_pinocchio(pair):
    q, qd, _ = pair.state
    gravity = pin.computeGeneralizedGravity(pair.model, pair.data, q).copy()
    expected = pair.back(pin.nonLinearEffects(pair.model, pair.data, q, qd) - gravity)
    assert relative_difference(pair.mechanism.bias(pair.q, pair.qd), expected) < TOLERANCE


def test_inverse_dynamics_with_wrenches_matches_pinocchio(pair):
    wrenches = random_wrenches(pair)
    expected = pair.back(pin.rnea(pair.model, pair.data, *pair.state, joint_forces(pair, wrenches)))
    found = pair.mechanism.inverse_dynamics(pair.q, pair.qd, pair.qdd, wrenches=wrenches)
    assert relative_difference(found, expected) < TOLERANCE


def test_forward_dynamics_with_wrenches_matches_pinocchio(pair):
    wrenches = random_wrenches(pair)
    (tau,) = random_state(99, pair.tree.n, count=1)
    q, qd, _ = pair.state
    expected = pin.aba(pair.model, pair.data, q, qd, pair.there(tau), joint_forces(pair, wrenches))
    found = pair.mechanism.forward_dynamics(pair.q, pair.qd, tau, wrenches=wrenches)
    assert relative_difference(found, pair.back(expected)) < TOLERANCE


def test_tangent_matrices_match_pinocchio(pair):
    by_position, by_velocity, _ = pin.computeRNEADerivatives(pair.model, pair.data, *pair.state)
    mass = pin.crba(pair.model, pair.data, pair.there(pair.q), pin.Convention.WORLD)
    mass = np.triu(mass) + np.triu(mass, 1).T
    found = pair.mechanism.linearize(pair.q, pair.qd, pair.qdd)
    assert relative_difference(found[0], pair.back(mass)) < TOLERANCE
    assert relative_difference(found[1], pair.back(by_velocity)) < TOLERANCE
    assert relative_difference(found[2], pair.back(by_position)) < TOLERANCE


def test_gravity_stiffness_at_rest_matches_pinocchio(pair):
    expected = pin.computeGeneralizedGravityDerivatives(pair.model, pair.data, pair.there(pair.q))
    rest = np.zeros(pair.tree.n)
    found = pair.mechanism.linearize(pair.q, rest, rest)
    assert not found[1].any()
    assert relative_difference(found[2], pair.back(expected)) < TOLERANCE


def test_wrench_stiffness_matches_differences_of_pinocchio_jacobians(pair):
    # Central differences at three steps, extrapolated (Richardson): the truncation is of sixth order, about
    # 0.02^6 = 6e-11 of the wrench, the rounding 1e-16 / 0.005 = 2e-14 of it.
    rest = np.zeros(pair.tree.n)
    alone = pair.mechanism.linearize(pair.q, rest, rest)
    for frame, wrench in random_wrenches(pair):
        if pair.tree.frame_nodes[frame] == -1:
            continue

        def forces(q, frame=frame, wrench=wrench):
            J = pin.computeFrameJacobian(
                pair.model, pair.data, pair.there(q), pair.frames[frame], pin.LOCAL_WORLD_ALIGNED
            )
            return J[:, pair.order].T @ wrench

        def difference(step, forces=forces):
            steps = step * np.eye(pair.tree.n)
            return np.array([forces(pair.q + h) - forces(pair.q - h) for h in steps]).T / (2 * step)

        coarse, middle, fine = (difference(h) for h in (0.02, 0.01, 0.005))
        coarse, middle = (4 * middle - coarse) / 3, (4 * fine - middle) / 3
        expected = -(16 * middle - coarse) / 15
        found = pair.mechanism.linearize(pair.q, rest, rest, wrenches=[(frame, wrench)]) - alone
        assert not found[:2].any()
        assert np.abs(found[2] - expected).max() < TOLERANCE * np.abs(wrench).max()
