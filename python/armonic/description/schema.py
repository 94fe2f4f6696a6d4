"""The robot file's schema: links, joints, springs, frames, tool, postures and bushings, each checked by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import Field, PlainValidator, ValidationInfo, WrapValidator, field_validator, model_validator

from armonic.description.actuation import ControlEntry, Drive, with_dimension
from armonic.description.fields import (
    MOVES,
    TURNS,
    Axis,
    FieldError,
    Found,
    InUnit,
    Matrix6,
    Name,
    Text,
    Vector3,
    Version,
    in_unit,
    matrix6,
    raw,
    vector,
)
from armonic.description.parts import (
    DenavitHartenberg,
    InertiaTensor,
    Mass,
    Motion,
    Part,
    Position,
    refuse_massless_inertia,
)
from armonic.description.units import Dimension, shown


class Joint(Part):
    """What moves a link against its parent, about or along an axis of the joint frame."""

    what = "a joint such as {type: revolute, axis: z}"

    type: Literal["revolute", "prismatic", "fixed"]
    axis: Axis | None = None

    @model_validator(mode="after")
    def _has_axis_if_it_moves(self) -> Joint:
        if self.type == "fixed" and self.axis is not None:
            raise FieldError(Found("an axis on a fixed joint"), "no axis", at=("axis",))
        if self.type != "fixed" and self.axis is None:
            raise FieldError(Found("no axis"), f"the axis of the {self.type} joint: x, y, z or a vector")
        return self

    @property
    def own(self) -> str | None:
        """The key of the joint's own coordinate: "z", "tz", "joint" for a free vector, None if fixed."""
        if isinstance(self.axis, str):
            return self.axis if self.type == "revolute" else f"t{self.axis}"
        return None if self.axis is None else "joint"

    def kind(self, key: str) -> Literal["revolute", "prismatic"]:
        """Whether the coordinate under a key turns or moves."""
        turns = key in TURNS or (key == "joint" and self.type == "revolute")
        return "revolute" if turns else "prismatic"


class Spring(Part):
    """The spring and damper of one coordinate, in SI, with the bounds of a fit."""

    what = "a mapping with `stiffness`, or the word free"

    stiffness: float
    damping: float = 0.0
    stiffness_bounds: tuple[float, float] | None = None
    damping_bounds: tuple[float, float] | None = None

    @field_validator("stiffness", "damping", mode="plain")
    @classmethod
    def _value(cls, value: object, info: ValidationInfo) -> float:
        result = in_unit(value)
        if result < 0.0 or (result == 0.0 and info.field_name == "stiffness"):
            expected = "a positive number" if info.field_name == "stiffness" else "a number, 0 or larger"
            raise FieldError(raw(value), expected)
        return result

    @field_validator("stiffness_bounds", "damping_bounds", mode="plain")
    @classmethod
    def _bounds(cls, value: object, info: ValidationInfo) -> tuple[float, float]:
        pair, dimension = value if isinstance(value, InUnit) else (value, None)
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            raise FieldError(pair, "a list [lowest, highest]")
        low, high = (in_unit(InUnit(v, dimension), (i,)) for i, v in enumerate(pair))
        if not 0.0 < low < high:
            raise FieldError(Found(f"[{low:g}, {high:g}]"), "two positive numbers, the smaller one first")
        inside = info.data.get(str(info.field_name).removesuffix("_bounds"))
        if inside is not None and not low <= inside <= high:
            raise FieldError(Found(f"[{low:g}, {high:g}]"), f"bounds that contain the value {inside:g}")
        return low, high


def _spring(value: object, handler: Callable[[object], Spring]) -> Spring | None:
    if isinstance(value, FieldError):
        raise value
    if value == "free":
        return None
    if not isinstance(value, dict):
        raise FieldError(value, Spring.what)
    return handler(value)


class Coordinate(NamedTuple):
    """One coordinate of a joint: its key, what it does, its spring (None if locked, free or driven)."""

    key: str
    kind: Literal["revolute", "prismatic"]
    axis: Vector3
    spring: Spring | None
    flexible: bool


class Link(Part):
    """A rigid body with the joint that carries it."""

    what = "a link: a mapping with name, parent and joint"

    name: Name
    parent: Name
    placement: tuple[Motion, ...] = ()
    dh: DenavitHartenberg | None = None
    joint: Joint
    elasticity: dict[str, Annotated[Spring | None, WrapValidator(_spring)]] = Field(default_factory=dict)
    drive: Drive | None = None
    mass: Mass = 0.0
    com: Position = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = InertiaTensor()

    @model_validator(mode="before")
    @classmethod
    def _dh_turns_about_z(cls, value: object) -> object:
        """A Denavit-Hartenberg link has the joint axis z, which need not be said."""
        if not isinstance(value, dict) or "dh" not in value:
            return value
        joint = value.get("joint")
        if isinstance(joint, dict) and "axis" not in joint and joint.get("type") in ("revolute", "prismatic"):
            return {**value, "joint": {**joint, "axis": "z"}}
        return value

    @field_validator("name", mode="after")
    @classmethod
    def _is_not_base(cls, value: str) -> str:
        if value == "base":
            raise FieldError(value, "another name", "`base` is the ground that the first link stands on.")
        return value

    @field_validator("dh", "drive", mode="before")
    @classmethod
    def _is_a_mapping(cls, value: object, info: ValidationInfo) -> object:
        # None stands for a key that is left out, but a key without a value is a slip.
        if value is None:
            part: type[Part] = DenavitHartenberg if info.field_name == "dh" else Drive
            raise FieldError(value, part.what)
        return value

    @field_validator("elasticity", mode="before")
    @classmethod
    def _fits_joint(cls, value: object, info: ValidationInfo) -> object:
        """Give every spring the dimension of its coordinate, or an error if the joint has no such one."""
        joint = info.data.get("joint")
        if not isinstance(value, dict):
            return value
        if not isinstance(joint, Joint):
            return {}  # the joint's own error is told; what its springs measure is unknown
        return {key: _error_of_key(key, joint) or _with_dimension(key, spring, joint) for key, spring in value.items()}

    @field_validator("drive", mode="before")
    @classmethod
    def _drives_joint(cls, value: object, info: ValidationInfo) -> object:
        joint = info.data.get("joint")
        if not isinstance(value, dict) or not isinstance(joint, Joint):
            return value
        if joint.own is None:
            raise FieldError(Found("a drive on a fixed joint"), "no drive, or a joint that moves")
        if joint.type == "revolute" and "radius" in value:
            hint = "Motor and joint turn by the same angle after the gear."
            raise FieldError(Found("a radius on a revolute joint"), "no radius", hint, ("radius",))
        if joint.type == "prismatic" and "radius" not in value:
            expected = "the key radius: the travel for one radian after the gear"
            raise FieldError(Found("no radius"), expected)
        return with_dimension(value, turns=joint.type == "revolute")

    @model_validator(mode="after")
    def _parts_fit(self) -> Link:
        refuse_massless_inertia(self.mass, self.inertia)
        if self.dh is not None and "placement" in self.model_fields_set:
            raise FieldError(Found("a placement beside dh"), "one of them", at=("placement",))
        if self.dh is not None and self.joint.axis not in (None, "z"):
            raise FieldError(self.joint.axis, "the axis z, as dh has it", at=("joint", "axis"))
        own = self.joint.own
        if self.drive is not None and own in self.elasticity:
            hint = "The drive's shaft is the spring of the joint's own coordinate."
            raise FieldError(Found("elasticity of the driven coordinate"), "no such key", hint, ("elasticity", own))
        return self

    @property
    def before(self) -> tuple[Motion, ...]:
        """The motions from the parent's frame to the joint's."""
        return self.placement if self.dh is None else self.dh.before

    @property
    def after(self) -> tuple[Motion, ...]:
        """The motions from the joint's frame after its motion to the link's."""
        return () if self.dh is None else self.dh.after

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The joint's own coordinate first, then the virtual ones in the order x, y, z, tx, ty, tz."""
        own = self.joint.own
        virtual = [key for key in (*TURNS, *MOVES) if key in self.elasticity and key != own]
        result = []
        for key in ([own] if own else []) + virtual:
            axis = self.joint.axis if key == "joint" else {**TURNS, **MOVES}[key]
            assert isinstance(axis, tuple)
            spring = self.elasticity.get(key)
            flexible = key in self.elasticity or (key == own and self.drive is not None)
            result.append(Coordinate(key, self.joint.kind(key), axis, spring, flexible))
        return tuple(result)


def _error_of_key(key: str, joint: Joint) -> FieldError | None:
    known = (*TURNS, *MOVES, *(["joint"] if joint.own == "joint" else []))
    if key not in known:
        hint = None
        if key == "joint" and joint.own is not None:
            hint = f"The coordinate of this joint is called {joint.own}."
        return FieldError(Found(f"the axis key {shown(key)}"), f"one of {', '.join(known)}", hint)
    if joint.own == "joint" and key != "joint" and joint.kind(key) == joint.kind("joint"):
        assert isinstance(joint.axis, tuple)
        along = math.fsum(a * b for a, b in zip(joint.axis, {**TURNS, **MOVES}[key], strict=True))
        if abs(along) > 1.0 - 1e-12:
            return FieldError(Found(f"{key} along the joint's own axis"), "the key joint for that axis")
    return None


def _with_dimension(key: str, spring: object, joint: Joint) -> object:
    if not isinstance(spring, dict):
        return spring
    turns = joint.kind(key) == "revolute"
    stiffness: Dimension = "rotational stiffness" if turns else "translational stiffness"
    damping: Dimension = "rotational damping" if turns else "translational damping"
    return {name: InUnit(value, damping if name.startswith("damping") else stiffness) for name, value in spring.items()}


class Frame(Part):
    """A named frame fixed to a link, where sensors sit and wrenches act."""

    what = "a frame: a mapping with name, link and placement"

    name: Name
    link: Name
    placement: tuple[Motion, ...] = ()


class BushingEntry(Part):
    """A 6x6 spring-damper between two frames, in the axes of the first."""

    what = "a bushing: a mapping with name, between and stiffness"

    name: Name
    between: tuple[Name, Name]
    stiffness: Annotated[
        Matrix6,
        matrix6("translational stiffness", "rotational stiffness", "coupling stiffness", nonzero=True),
    ]
    damping: Annotated[
        Matrix6,
        matrix6("translational damping", "rotational damping", "coupling damping", nonzero=False),
    ] = ((0.0,) * 6,) * 6
    rest: Any = None

    @field_validator("between", mode="before")
    @classmethod
    def _two_frames(cls, value: object) -> object:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise FieldError(value, "a list of two frames")
        if value[0] == value[1]:
            raise FieldError(Found(f"{shown(value[0])} twice"), "two different frames")
        return value

    @field_validator("rest", mode="after")
    @classmethod
    def _posture(cls, value: object) -> object:
        if not isinstance(value, str | list | tuple):
            raise FieldError(value, "the name of a posture or a list of joint coordinates")
        return value


class Tool(Part):
    """A body fixed to a frame, in the axes of that frame; its inertia is about its centre of mass."""

    what = "a tool: a mapping with frame and mass"

    frame: Name
    mass: Mass = 0.0
    com: Position = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = InertiaTensor()

    @model_validator(mode="after")
    def _has_mass_if_inertia(self) -> Tool:
        refuse_massless_inertia(self.mass, self.inertia)
        return self


MAX_POINTS: Final = 1_000_000


def _points(value: object) -> int:
    if type(value) is not int or not 2 <= value <= MAX_POINTS:
        raise FieldError(value, f"a whole number from 2 to {MAX_POINTS}")
    return value


class PathEntry(Part):
    """Postures evenly spaced along straight stretches between waypoints, both ends included."""

    what = "a path: a mapping with through and points"

    through: tuple[Any, ...]
    points: Annotated[int, PlainValidator(_points)] = 50

    @field_validator("through", mode="after")
    @classmethod
    def _leads_somewhere(cls, value: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(value) < 2:
            raise FieldError(value, "at least two waypoints: names of postures, or lists of joint values")
        for i, waypoint in enumerate(value):
            if not isinstance(waypoint, str | list | tuple):
                raise FieldError(waypoint, "the name of a posture or a list of joint coordinates", at=(i,))
        return value


class RobotDescription(Part):
    """A whole robot file, each entry checked by itself; `reading` checks the names against each other."""

    what = "a robot description that starts with `armonic: 1`"

    armonic: Version
    name: Text
    source: Text | None = None
    gravity: Annotated[Vector3, vector("acceleration")] = (0.0, 0.0, -9.81)
    urdf: Text | None = None
    joints: dict[str, Any] = Field(default_factory=dict)
    links: tuple[Link, ...]
    frames: tuple[Frame, ...] = ()
    postures: dict[Name, tuple[Any, ...]] = Field(default_factory=dict)
    paths: dict[Name, PathEntry] = Field(default_factory=dict)
    bushings: tuple[BushingEntry, ...] = ()
    tool: Tool | None = None
    control: ControlEntry | None = None

    @field_validator("tool", "control", mode="before")
    @classmethod
    def _is_a_mapping(cls, value: object, info: ValidationInfo) -> object:
        if value is None:
            part: type[Part] = Tool if info.field_name == "tool" else ControlEntry
            raise FieldError(value, part.what)
        return value

    @field_validator("joints", mode="before")
    @classmethod
    def _belongs_to_a_urdf(cls, value: object) -> object:
        # Beside a URDF they have gone into the links before the data come here.
        raise FieldError(Found("joints without a urdf"), "links, or the key urdf")

    @field_validator("links", mode="before")
    @classmethod
    def _is_not_empty(cls, value: object) -> object:
        # Not `min_length`: that also counts links with an error of their own as absent.
        if value == []:
            raise FieldError(Found("an empty list"), "at least one link")
        return value
