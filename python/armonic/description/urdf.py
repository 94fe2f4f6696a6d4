"""URDF in: its links and joints, checked against each other, as the links of a robot file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from armonic.description.names import did_you_mean, listed
from armonic.description.plain_xml import clipped, parse
from armonic.description.reading import SUGGESTIONS, in_one
from armonic.description.units import shown
from armonic.description.urdf_elements import ElementError, Elements, JointElement, LinkElement
from armonic.errors import RobotFileError

GROUND: Final = ("base", "world")
"""Names of a root link that is the robot file's `base`."""


@dataclass(frozen=True, eq=False)
class Urdf:
    """A URDF that was read.

    Attributes:
        path: its file; absolute.
        origin: what error messages call it.
        content: its text.
        name: of the robot.
        links: the links as plain data of a robot file, in the order of the joints but parents first.
        joints: for each link the name of the URDF's joint that carries it; None for a root link on `base`.
        moving: those of them that move, which a posture gives values for.
        damped: the joints with a damping in `<dynamics>`, which is not used.
        lines: for each link the lines of its `<joint>` and `<link>`.
    """

    path: Path
    origin: str
    content: bytes
    name: str
    links: tuple[dict[str, Any], ...]
    joints: tuple[str | None, ...]
    moving: tuple[str, ...]
    damped: tuple[str, ...]
    lines: tuple[tuple[int, int], ...]

    def where(self, link: int, key: object = None) -> str:
        """File, line and name of what gives a link its entry under a key."""
        joint, (joint_line, link_line) = self.joints[link], self.lines[link]
        if joint is None or key in ("name", "mass", "com", "inertia"):
            return f"{self.origin}, line {link_line}, link {self.links[link]['name']}"
        return f"{self.origin}, line {joint_line}, joint {clipped(joint)}"


def read_urdf(content: bytes, path: Path, origin: str) -> Urdf:
    """Read a URDF: links, joints and inertias. Nothing else of it is used, and no other file is opened.

    Joints are revolute, continuous, prismatic or fixed. Limits and damping are left out. The root link is the
    ground: it is `base` if it is called base or world, else a link fixed to `base`. Names become names of a
    robot file, with _ for what these cannot hold; a link called base that is not the root is `urdf_base`.

    Args:
        content: its text, in UTF-8.
        path: its file, for reference only.
        origin: what error messages call it.

    Raises:
        RobotFileError: the first error, with the line; it has the others as `errors`. Among them: mimic,
            floating and planar joints, closed loops, several roots, a moving joint that carries no inertia.
    """
    elements = Elements(origin)
    elements.read(parse(content, origin))
    faults = elements.faults or list(_tree_faults(elements))
    names: dict[str, str] = {}
    if not faults:
        names, faults = _names(elements)
    joints = [] if faults else _in_order(elements)
    faults = faults or list(_body_faults(elements, joints))
    if faults:
        raise _in_one(faults)
    root = elements.links[joints[0].parent]
    links: list[dict[str, Any]] = []
    carriers: list[str | None] = []
    lines = []
    if names[root.name] != "base":
        links.append({"name": names[root.name], "parent": "base", "joint": {"type": "fixed"}, **root.body})
        carriers.append(None)
        lines.append((root.line, root.line))
    for joint in joints:
        link = elements.links[joint.child]
        links.append({"name": names[joint.child], "parent": names[joint.parent], **joint.motion, **link.body})
        carriers.append(joint.name)
        lines.append((joint.line, link.line))
    return Urdf(
        path=path,
        origin=origin,
        content=content,
        name=elements.name,
        links=tuple(links),
        joints=tuple(carriers),
        moving=tuple(joint.name for joint in joints if joint.moves),
        damped=tuple(joint.name for joint in joints if joint.damped),
        lines=tuple(lines),
    )


def _tree_faults(elements: Elements) -> Iterator[ElementError]:
    """What keeps links and joints from being one tree."""
    yield from (faults := list(_reference_faults(elements)))
    if faults:
        return  # of which roots and cycles would only be consequences
    links, carried = elements.links, {joint.child: joint for joint in elements.joints.values()}
    roots = [link for name, link in links.items() if name not in carried]
    if len(roots) > 1:
        found = f"several root links: {listed([clipped(link.name) for link in roots])}"
        yield elements.fault(roots[1].element, found, "one link that no joint carries")
    ends = {link.name for link in roots}
    for name in links:
        chain: dict[str, None] = {}
        while name in carried and name not in ends and name not in chain:
            chain[name] = None
            name = carried[name].parent
        if name in chain:
            parents = list(chain)
            cycle = [clipped(one) for one in (*parents[parents.index(name) :], name)]
            found = f"a cycle of parents: {listed(cycle, ' -> ')}"
            yield elements.fault(carried[name].element, found, "parents that lead to one root link")
        ends.update(chain)


def _reference_faults(elements: Elements) -> Iterator[ElementError]:
    """Joints between links that are not there, or to a link that already hangs on another."""
    links, carried, unknown = elements.links, dict[str, JointElement](), 0
    for joint in elements.joints.values():
        for role, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                unknown += 1
                hint = did_you_mean(name, links) if unknown <= SUGGESTIONS else None
                yield elements.fault(joint.element, f"the {role} {shown(name)}", "the name of a link", hint)
        if joint.child in carried:
            first = clipped(carried[joint.child].name)
            found = f"a second joint that carries the link {shown(joint.child)} (the first is {first})"
            hint = "Armonic has no closed loops: cut the loop open at one joint."
            yield elements.fault(joint.element, found, "a tree: each link hangs on one joint", hint)
        carried.setdefault(joint.child, joint)


def _names(elements: Elements) -> tuple[dict[str, str], list[ElementError]]:
    """A name for each link that a robot file can hold, and the links that would share one."""
    children = {joint.child for joint in elements.joints.values()}
    taken: dict[str, LinkElement] = {}
    names, faults = {}, []
    for link in elements.links.values():
        name = re.sub(r"[^A-Za-z0-9_-]", "_", link.name)
        name = name if re.match(r"[A-Za-z_]", name) else f"_{name}"
        if link.name not in children and link.name in GROUND:
            name = "base"
        elif name == "base":
            name = "urdf_base"
        if name in taken:
            both = f"{shown(taken[name].name)} and {shown(link.name)}"
            found = f"the link names {both}, which are both {clipped(name)} in a robot file"
            faults.append(elements.fault(link.element, found, "names that differ in letters, digits, _ or -"))
        taken[name] = link
        names[link.name] = name
    return names, faults


def _in_order(elements: Elements) -> list[JointElement]:
    """The joints of a tree in the order of the file, but each after the one that carries its parent."""
    carried = {joint.child: joint for joint in elements.joints.values()}
    done: dict[str, JointElement] = {}
    for joint in elements.joints.values():
        branch = []
        link = joint.child
        while link in carried and link not in done:
            branch.append(carried[link])
            link = carried[link].parent
        done.update((one.child, one) for one in reversed(branch))
    return list(done.values())


def _body_faults(elements: Elements, joints: list[JointElement]) -> Iterator[ElementError]:
    """Moving joints that carry no inertia, neither in their link nor in one that is fixed to it."""
    heavy = {name for name, link in elements.links.items() if link.body}
    for joint in reversed(joints):
        if not joint.moves and joint.child in heavy:
            heavy.add(joint.parent)
    for joint in joints:
        if joint.moves and joint.child not in heavy:
            found = f"no <inertial>, though the joint {clipped(joint.name)} moves this link"
            expected = "its mass and inertia, or those of a link fixed to it"
            yield elements.fault(elements.links[joint.child].element, found, expected)


def _in_one(faults: list[ElementError]) -> RobotFileError:
    """The first error of the file, with all of them in its order."""
    ordered = sorted(faults, key=lambda fault: fault.line)
    errors = [RobotFileError(f.where, found=f.found, expected=f.expected, hint=f.hint) for f in ordered]
    return in_one(errors)
