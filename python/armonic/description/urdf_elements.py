"""The elements of a URDF one by one: bodies, placements and motions, under the keys of a robot file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from armonic.description.names import did_you_mean
from armonic.description.parts import Motion
from armonic.description.plain_xml import clipped, line_of, where
from armonic.description.tree import placement
from armonic.description.units import LARGEST, shown
from armonic.errors import RobotFileError

if TYPE_CHECKING:
    from lxml import etree

TYPES: Final = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
"""The joint types that are read, and what a robot file calls them."""

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_TENSOR: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_CHILDREN: Final = {
    "robot": ("link", "joint"),
    "link": ("inertial", "visual", "collision"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    "inertial": ("origin", "mass", "inertia"),
}


class ElementError(RobotFileError):
    """An error with the line that errors are sorted by."""

    line = 1


@dataclass(frozen=True, eq=False)
class LinkElement:
    """A `<link>`: its body under the keys of a robot file, empty without `<inertial>`."""

    name: str
    line: int
    body: dict[str, Any]
    element: etree._Element


@dataclass(frozen=True, eq=False)
class JointElement:
    """A `<joint>`: its `placement` and `joint` as in a robot file."""

    name: str
    line: int
    parent: str
    child: str
    motion: dict[str, Any]
    damped: bool
    element: etree._Element

    @property
    def moves(self) -> bool:
        """Whether it has a coordinate."""
        return bool(self.motion["joint"]["type"] != "fixed")


class Elements:
    """The links and joints of a URDF by name, and what is wrong with each by itself.

    Args:
        origin: what error messages call the file.
    """

    def __init__(self, origin: str) -> None:
        self.origin = origin
        self.name = ""
        self.links: dict[str, LinkElement] = {}
        self.joints: dict[str, JointElement] = {}
        self.faults: list[ElementError] = []

    def fault(self, element: etree._Element, found: str, expected: str, hint: str | None = None) -> ElementError:
        """An error at the line of an element, in its link or joint."""
        fault = ElementError(where(element, self.origin), found=found, expected=expected, hint=hint)
        fault.line = line_of(element)
        return fault

    def read(self, root: etree._Element) -> None:
        """Take in every link and joint below `<robot>`, or its error.

        Raises:
            ElementError: the root is no `<robot>`.
        """
        if root.tag != "robot":
            raise self.fault(root, f"the element <{clipped(str(root.tag))}>", "the element <robot> of a URDF")
        try:
            self.name = self._text(root, "name")
            self._refuse_misspelt(root)
        except ElementError as fault:
            self.faults.append(fault)
        for element in root.iterchildren("link", "joint"):
            try:
                if element.tag == "link":
                    link = self._link(element)
                    self.links[link.name] = link
                else:
                    joint = self._joint(element)
                    self.joints[joint.name] = joint
            except ElementError as fault:
                self.faults.append(fault)
        if not self.faults and not self.joints:
            self.faults.append(self.fault(root, "no joint", "at least one joint with the link that it carries"))

    def _link(self, element: etree._Element) -> LinkElement:
        name = self._new_name(element, self.links)
        self._refuse_misspelt(element)
        inertial = self._child(element, "inertial")
        body = {} if inertial is None else self._body(inertial)
        return LinkElement(name, line_of(element), body, element)

    def _body(self, inertial: etree._Element) -> dict[str, Any]:
        """Mass, centre of mass and tensor, turned from the axes of the inertial's origin into the link's."""
        self._refuse_misspelt(inertial)
        xyz, rpy = self._origin_of(inertial)
        (mass,) = self._numbers(self._needed(inertial, "mass"), "value", 1, "a positive mass in kg")
        if mass <= 0.0:
            hint = "A link without a mass has no <inertial>."
            raise self.fault(inertial, f"the mass {mass:g}", "a positive mass in kg", hint)
        element = self._needed(inertial, "inertia")
        self._refuse_attributes(element, _TENSOR)
        entries = [self._numbers(element, key, 1, "an inertia in kg m^2")[0] for key in _TENSOR]
        if any(rpy):
            xx, yy, zz, xy, xz, yz = entries
            R = placement(Motion(**motion) for motion in _turns(rpy))[:3, :3]
            tensor = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
            i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
            entries = (0.5 * (tensor + tensor.T))[i, j].tolist()
        inertia = {key[1:]: entry for key, entry in zip(_TENSOR, entries, strict=True)}
        return {"mass": mass, "com": list(xyz), "inertia": inertia}

    def _joint(self, element: etree._Element) -> JointElement:
        name = self._new_name(element, self.joints)
        self._refuse_misspelt(element)
        kind = self._text(element, "type")
        if kind not in TYPES:
            hint = did_you_mean(kind, TYPES)
            if kind in ("floating", "planar"):
                hint = "The root is the ground; what rests on springs is a fixed joint with elasticity."
            raise self.fault(element, f"a joint of type {shown(kind)}", f"one of {', '.join(TYPES)}", hint)
        mimic = self._child(element, "mimic")
        if mimic is not None:
            found = f"a joint that mimics {shown(mimic.get('joint', 'another'))}"
            hint = "Make it a fixed joint, or one of its own without <mimic>."
            raise self.fault(element, found, "a joint that moves by itself", hint)
        xyz, rpy = self._origin_of(element)
        how: dict[str, Any] = {"type": TYPES[kind]}
        if kind != "fixed":
            how["axis"] = self._axis(element)
        shift = [dict(zip("xyz", xyz, strict=True))] if any(xyz) else []
        dynamics = self._child(element, "dynamics")
        damping = 0.0 if dynamics is None else self._numbers(dynamics, "damping", 1, "a damping", (0.0,))[0]
        return JointElement(
            name=name,
            line=line_of(element),
            parent=self._text(self._needed(element, "parent"), "link"),
            child=self._text(self._needed(element, "child"), "link"),
            motion={"placement": [*shift, *_turns(rpy)], "joint": how},
            damped=damping != 0.0,
            element=element,
        )

    def _axis(self, joint: etree._Element) -> str | list[float]:
        """The axis: its letter where it is one of x, y, z, else a vector; x if there is none."""
        element = self._child(joint, "axis")
        if element is None:
            return "x"
        self._refuse_attributes(element, ("xyz",))
        axis = self._numbers(element, "xyz", 3, "an axis")
        if not any(axis):
            raise self.fault(element, "an axis of zeros", "a vector that is not zero")
        letters = [letter for letter, value in zip("xyz", axis, strict=True) if value]
        return letters[0] if len(letters) == 1 and max(axis) > 0.0 else axis

    def _origin_of(self, element: etree._Element) -> tuple[list[float], list[float]]:
        """Shift (m) and turns (rad) of an element's `<origin>`; zeros where it has none."""
        origin, zeros = self._child(element, "origin"), (0.0, 0.0, 0.0)
        if origin is None:
            return list(zeros), list(zeros)
        self._refuse_attributes(origin, ("xyz", "rpy"))
        xyz = self._numbers(origin, "xyz", 3, "x y z in m", zeros)
        return xyz, self._numbers(origin, "rpy", 3, "roll, pitch, yaw in rad", zeros)

    def _text(self, element: etree._Element, attribute: str) -> str:
        value = element.get(attribute)
        if value is None or not value.strip():
            found = f"no {attribute}" if value is None else f"the {attribute} {shown(value)}"
            raise self.fault(element, f"{found} in <{element.tag}>", f"the attribute {attribute}")
        return value

    def _new_name(self, element: etree._Element, taken: dict[str, Any]) -> str:
        name = self._text(element, "name")
        if name in taken:
            found = f"the {element.tag} {shown(name)} again"
            raise self.fault(element, found, f"it once (first on line {taken[name].line})")
        return name

    def _numbers(
        self, element: etree._Element, attribute: str, count: int, what: str, default: Iterable[float] | None = None
    ) -> list[float]:
        text = element.get(attribute)
        if text is None and default is not None:
            return list(default)
        words = self._text(element, attribute).split()
        values = [float(word) for word in words if _NUMBER.fullmatch(word)]
        if not len(values) == len(words) == count or any(abs(value) > LARGEST for value in values):
            expected = f"{what}: {'a number' if count == 1 else f'{count} numbers'}, finite and at most {LARGEST:g}"
            raise self.fault(element, f"{attribute}={shown(text)} in <{element.tag}>", expected)
        return values

    def _child(self, element: etree._Element, tag: str) -> etree._Element | None:
        found = list(element.iterchildren(tag))
        if len(found) > 1:
            raise self.fault(found[1], f"<{tag}> again", f"it once (first on line {line_of(found[0])})")
        return found[0] if found else None

    def _needed(self, element: etree._Element, tag: str) -> etree._Element:
        found = self._child(element, tag)
        if found is None:
            raise self.fault(element, f"no <{tag}> in <{element.tag}>", f"the element <{tag}>")
        return found

    def _refuse_attributes(self, element: etree._Element, known: tuple[str, ...]) -> None:
        for name in element.attrib:
            if name not in known and not str(name).startswith("{"):
                found = f"the attribute {shown(str(name))} of <{element.tag}>"
                raise self.fault(element, found, f"one of {', '.join(known)}")

    def _refuse_misspelt(self, element: etree._Element) -> None:
        """Refuse a child that is almost one of those that count: left out in silence, it would be missed."""
        known, seen = _CHILDREN[str(element.tag)], set[str]()
        for child in element.iterchildren():
            tag = str(child.tag)
            if tag not in known and tag not in seen and len(tag) < 16:
                seen.add(tag)
                near = difflib.get_close_matches(tag.lower(), known, n=1, cutoff=0.8)
                if near:
                    hint = f"Did you mean <{near[0]}>?"
                    raise self.fault(child, f"the element <{tag}>", f"one of {', '.join(known)}", hint)


def _turns(rpy: Iterable[float]) -> list[dict[str, float]]:
    """Roll, pitch, yaw about fixed axes, in motions whose axes go along: Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = rpy
    return [{key: angle} for key, angle in (("rz", yaw), ("ry", pitch), ("rx", roll)) if angle]
