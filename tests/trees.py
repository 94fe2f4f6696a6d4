"""Random kinematic trees with physically valid masses, for tests that compare or check identities."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armonic import _core

Array = NDArray[np.float64]
Body = tuple[float, Array, Array]
MASSLESS: Body = (0.0, np.zeros(3), np.zeros((3, 3)))


@dataclass(frozen=True)
class Tree:
    """The table of nodes that `_core.Mechanism` takes, open so that another library can be built from it."""

    parents: list[int]
    placements: Array
    kinds: list[str]
    axes: Array
    masses: Array
    coms: Array
    inertias: Array
    frame_nodes: list[int]
    frame_placements: Array
    gravity: Array

    @property
    def n(self) -> int:
        return sum(kind != "fixed" for kind in self.kinds)

    @property
    def coordinate_of(self) -> list[int | None]:
        """The coordinate of every node, numbered in node order."""
        numbers = iter(range(self.n))
        return [None if kind == "fixed" else next(numbers) for kind in self.kinds]

    def mechanism(self) -> _core.Mechanism:
        return _core.Mechanism(**vars(self))

    def with_com_frames(self) -> Tree:
        """The same tree whose frame i lies at the centre of mass of node i, along the node's axes."""
        placements = np.tile(np.eye(4), (len(self.parents), 1, 1))
        placements[:, :3, 3] = self.coms
        return replace(self, frame_nodes=list(range(len(self.parents))), frame_placements=placements)


def random_rotation(rng: np.random.Generator) -> Array:
    matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return matrix * np.sign(np.linalg.det(matrix))


def random_placement(rng: np.random.Generator) -> Array:
    placement = np.eye(4)
    placement[:3, :3] = random_rotation(rng)
    placement[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    return placement


def random_body(rng: np.random.Generator) -> Body:
    """Mass, centre of mass and tensor about it of eight point masses: any such body can exist."""
    weights = rng.uniform(0.5, 2.0, 8)
    points = rng.uniform(-0.3, 0.3, (8, 3)) + rng.uniform(-0.3, 0.3, 3)
    com = weights @ points / weights.sum()
    arms = points - com
    tensor = np.einsum("i,ij,ij->", weights, arms, arms) * np.eye(3) - (arms.T * weights) @ arms
    return float(weights.sum()), com, tensor


def _random_moves(rng: np.random.Generator, left: int) -> list[str]:
    """Kinds of the coordinates of one link: none to four of them, at most three alike."""
    count = min(int(rng.integers(0, 5)), left)
    turns = int(rng.integers(max(0, count - 3), min(3, count) + 1))
    kinds = ["revolute"] * turns + ["prismatic"] * (count - turns)
    return [kinds[i] for i in rng.permutation(count)]


def random_tree(seed: int, *, n: int, floating: bool = False) -> Tree:
    """A branching tree of links, each moved by none to four coordinates (a chain of nodes) or welded on.

    Args:
        seed: of the random numbers.
        n: number of coordinates.
        floating: whether the first link moves freely: its six coordinates come first and carry all others.
    """
    rng = np.random.default_rng(seed)
    nodes: list[tuple[int, str, Array, Array, Body]] = []

    def add(*node: Any) -> int:
        nodes.append(node)
        return len(nodes) - 1

    left = n
    ends = [] if floating else [-1]  # the nodes that links may hang on
    while left > 0:
        if ends:
            # Three of four links continue the last one, the others branch off anywhere.
            node = ends[-1] if rng.random() < 0.75 else int(rng.choice(ends))
            moves = _random_moves(rng, left)
        else:
            node, moves = -1, ["prismatic"] * 3 + ["revolute"] * 3
        left -= len(moves)
        directions = {kind: iter(random_rotation(rng)) for kind in ("revolute", "prismatic")}
        for position, kind in enumerate(moves):
            # Bent away from right angles, yet independent: the mass matrix stays well conditioned.
            axis = next(directions[kind]) + rng.uniform(-0.2, 0.2, 3)
            placed = position == 0 or rng.random() < 0.2
            place = random_placement(rng) if placed else np.eye(4)
            # The masses of a link sit on its last node, now and then on an inner one too.
            body = random_body(rng) if position == len(moves) - 1 or rng.random() < 0.1 else MASSLESS
            node = add(node, kind, axis / np.linalg.norm(axis), place, body)
        if not moves or rng.random() < 0.2:
            node = add(node, "fixed", np.zeros(3), random_placement(rng), random_body(rng))
        ends.append(node)

    parents, kinds, axes, placements, bodies = zip(*nodes, strict=True)
    masses, coms, tensors = zip(*bodies, strict=True)
    frame_nodes = [-1, len(nodes) - 1, *(int(i) for i in rng.integers(0, len(nodes), 2))]
    return Tree(
        parents=list(parents),
        placements=np.array(placements),
        kinds=list(kinds),
        axes=np.array(axes),
        masses=np.array(masses),
        coms=np.array(coms),
        inertias=np.array(tensors),
        frame_nodes=frame_nodes,
        frame_placements=np.array([random_placement(rng) for _ in frame_nodes]),
        gravity=rng.uniform(-10.0, 10.0, 3),
    )


def random_state(seed: int, n: int, *, count: int = 3) -> list[Array]:
    """`count` vectors (coordinates, velocities, accelerations, …) of n numbers."""
    rng = np.random.default_rng([seed, n])
    return [rng.uniform(-2.0, 2.0, n) for _ in range(count)]


def relative_difference(found: Array, expected: Array) -> float:
    """Largest deviation over the largest expected entry.

    Entries below 1e-3 count as 1e-3: where all cancels (no Coriolis forces if nothing turns), rounding is
    left.
    """
    assert found.shape == expected.shape
    return float(np.abs(found - expected).max() / max(np.abs(expected).max(), 1e-3))
