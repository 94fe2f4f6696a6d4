"""Compiles a robot description into the arrays of a mechanism: one node per coordinate, parents first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from armonic.description.drives import Array, Control, Drives, compile_control, compile_drives, frozen
from armonic.description.names import joint_values, links_in_order, moving_links
from armonic.description.parts import Motion
from armonic.description.paths import Paths, spread
from armonic.description.schema import Coordinate, Link, RobotDescription, Tool


@dataclass(frozen=True)
class Bushing:
    """A 6x6 spring-damper between two frames, in the axes of the first one.

    Rows and columns: displacement along x, y, z (m), then rotation about x, y, z (rad).

    Attributes:
        name: its name in the file.
        frame_a: the frame whose axes it uses.
        frame_b: the other frame.
        stiffness: (6, 6), N/m, N/rad = N, N m/rad.
        damping: (6, 6), N s/m, N s, N m s/rad.
        rest: (n,) the posture in which it carries no load; None: the posture a model is linearized at.
    """

    name: str
    frame_a: str
    frame_b: str
    stiffness: Array
    damping: Array
    rest: Array | None


@dataclass(frozen=True)
class Tree:
    """A robot as arrays, SI. Node i hangs on an earlier node; a joint of k coordinates is a chain of k nodes.

    Attributes:
        parents: index of each node's parent, -1 for the base.
        placements: (N, 4, 4), parent node's frame to node's frame before its motion.
        kinds: "fixed", "revolute" or "prismatic"; each node that moves is one coordinate.
        axes: (N, 3) unit axis of the motion in the node's frame; zero for fixed nodes.
        masses: (N,) kg; a link's inertia sits on the last node of its joint.
        coms: (N, 3) m, centre of mass in the node's frame; the tool is part of the body that carries it.
        inertias: (N, 3, 3) kg m², tensor about the centre of mass in the node's frame.
        frames: "base", every link, every frame of the file.
        frame_nodes: the node each frame is fixed to, -1 for the base.
        frame_placements: (F, 4, 4), node's frame to frame.
        coordinates: (n) names "link.key".
        joint_coordinates: the joints' own among them.
        joint_indices: their indices.
        flexible: (n,) whether a linear model keeps the coordinate.
        stiffness: (n,) N m/rad or N/m, of the elasticity; 0 where locked, free or driven.
        damping: (n,) N m s/rad or N s/m, likewise.
        postures: (n,) values by name, virtual coordinates zero.
        paths: (P, n) postures by name, computed at first use.
        bushings: the bushings of the file.
        drives: the motors, if any.
        control: their gains.
    """

    parents: tuple[int, ...]
    placements: Array
    kinds: tuple[str, ...]
    axes: Array
    masses: Array
    coms: Array
    inertias: Array
    frames: tuple[str, ...]
    frame_nodes: tuple[int, ...]
    frame_placements: Array
    coordinates: tuple[str, ...]
    joint_coordinates: tuple[str, ...]
    joint_indices: tuple[int, ...]
    flexible: NDArray[np.bool_]
    stiffness: Array
    damping: Array
    postures: dict[str, Array]
    paths: Mapping[str, Array]
    bushings: tuple[Bushing, ...]
    drives: Drives
    control: Control


def compile_tree(description: RobotDescription) -> Tree:
    """Lay a description out as arrays; the arrays cannot be written to.

    Args:
        description: a checked description (see `reading.read_description`).

    Returns:
        The tree.
    """
    nodes: list[tuple[int, Array, Coordinate | None, Link | None]] = []
    coordinates: list[tuple[str, Coordinate]] = []
    own: list[int] = []
    # The last node of a link's joint, and where the link's frame lies in it: the tree has no nodes for Tx(a) Rx(alpha).
    last = {"base": (-1, np.eye(4))}
    links = links_in_order(description)
    for link in links:
        parent, start = last[link.parent]
        start = start @ placement(link.before)
        chain: tuple[Coordinate | None, ...] = link.coordinates or (None,)
        for i, coordinate in enumerate(chain):
            nodes.append((parent, start, coordinate, link if i == len(chain) - 1 else None))
            parent, start = len(nodes) - 1, np.eye(4)
            if coordinate is not None:
                if coordinate.key == link.joint.own:
                    own.append(len(coordinates))
                coordinates.append((f"{link.name}.{coordinate.key}", coordinate))
        last[link.name] = parent, placement(link.after)

    frames = [(name, *place) for name, place in last.items()]
    for frame in description.frames:
        node, start = last[frame.link]
        frames.append((frame.name, node, start @ placement(frame.placement)))
    names = tuple(name for name, _ in coordinates)
    springs = [(c.spring.stiffness, c.spring.damping) if c.spring else (0.0, 0.0) for _, c in coordinates]
    values = np.array(springs).reshape(-1, 2)
    flexible = np.array([c.flexible for _, c in coordinates], dtype=np.bool_)
    flexible.setflags(write=False)
    bodies = [_MASSLESS if link is None else _body(link, last[link.name][1]) for _, _, _, link in nodes]
    if description.tool is not None:
        carrier, start = next((node, start) for name, node, start in frames if name == description.tool.frame)
        bodies[carrier] = _joined(bodies[carrier], _body(description.tool, start))
    masses, coms, inertias = zip(*bodies, strict=True)
    postures = {name: spread(posture, own, len(names)) for name, posture in description.postures.items()}
    drives = compile_drives(links, names)
    return Tree(
        parents=tuple(parent for parent, _, _, _ in nodes),
        placements=frozen([start for _, start, _, _ in nodes]),
        kinds=tuple("fixed" if c is None else c.kind for _, _, c, _ in nodes),
        axes=frozen([(0.0, 0.0, 0.0) if c is None else c.axis for _, _, c, _ in nodes]),
        masses=frozen(masses),
        coms=frozen(coms),
        inertias=frozen(inertias),
        frames=tuple(name for name, _, _ in frames),
        frame_nodes=tuple(node for _, node, _ in frames),
        frame_placements=frozen([start for _, _, start in frames]),
        coordinates=names,
        joint_coordinates=tuple(names[i] for i in own),
        joint_indices=tuple(own),
        flexible=flexible,
        stiffness=frozen(values[:, 0]),
        damping=frozen(values[:, 1]),
        postures=postures,
        paths=Paths(description.paths, postures, own, len(names)),
        bushings=_bushings(description, postures, own, len(names)),
        drives=drives,
        control=compile_control(description.control, len(drives.names)),
    )


def placement(motions: Iterable[Motion]) -> Array:
    """The transform (4, 4) of elementary motions applied left to right, each in the moved frame."""
    T = np.eye(4)
    for motion in motions:
        step = np.eye(4)
        step[:3, 3] = [motion.x or 0.0, motion.y or 0.0, motion.z or 0.0]
        for i, angle in enumerate((motion.rx, motion.ry, motion.rz)):
            if angle is not None:
                # A turn about axis i takes axis j towards axis k, in cyclic order.
                j, k = (i + 1) % 3, (i + 2) % 3
                step[j, j] = step[k, k] = np.cos(angle)
                step[k, j] = np.sin(angle)
                step[j, k] = -step[k, j]
        T = T @ step
    return T


_Body = tuple[float, Array, Array]
_MASSLESS: Final[_Body] = (0.0, np.zeros(3), np.zeros((3, 3)))


def _body(part: Link | Tool, place: Array) -> _Body:
    """Mass, centre of mass and tensor about it in the axes of a node, of a part whose frame lies at `place` in it."""
    com, tensor = np.array(part.com), np.array(part.inertia.matrix())
    turn, origin = place[:3, :3], place[:3, 3]
    if np.array_equal(turn, np.eye(3)):
        return part.mass, com + origin, tensor
    tensor = turn @ tensor @ turn.T
    return part.mass, turn @ com + origin, (tensor + tensor.T) / 2


def _joined(one: _Body, other: _Body) -> _Body:
    """Two bodies as one, by the parallel axis theorem."""
    if other[0] == 0.0:
        return one
    mass = one[0] + other[0]
    com = (one[0] * one[1] + other[0] * other[1]) / mass
    tensor = one[2] + other[2]
    for part, centre, _ in (one, other):
        arm = centre - com
        tensor = tensor + part * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return mass, com, tensor


def _bushings(description: RobotDescription, postures: dict[str, Array], own: list[int], n: int) -> tuple[Bushing, ...]:
    moving = moving_links(description)
    result = []
    for entry in description.bushings:
        rest = None
        if isinstance(entry.rest, str):
            rest = postures[entry.rest]
        elif entry.rest is not None:
            rest = spread(joint_values(entry.rest, moving), own, n)
        result.append(
            Bushing(
                name=entry.name,
                frame_a=entry.between[0],
                frame_b=entry.between[1],
                stiffness=frozen(entry.stiffness),
                damping=frozen(entry.damping),
                rest=rest,
            )
        )
    return tuple(result)
