"""The robot file's schema: links, joints, springs, frames, postures and bushings, each checked by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    WrapValidator,
    field_validator,
    model_validator,
)

from armonic.description.document import Location
from armonic.description.fields import (
    DIRECTIONS,
    MOVES,
    TURNS,
    Axis,
    FieldError,
    Found,
    Matrix6,
    Name,
    Text,
    Vector3,
    Version,
    matrix6,
    measure,
    measured,
    vector,
)
from armonic.description.units import Dimension, shown

Length = Annotated[float, measure("length")]
Angle = Annotated[float, measure("angle")]
Inertia = Annotated[float, measure("inertia")]
Position = Annotated[Vector3, vector("length")]


class _Part(BaseModel):
    """A mapping of the file: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    what: ClassVar[str] = "a mapping"


class Motion(_Part):
    """One elementary motion: a displacement (x, y, z together) or a rotation about one axis."""

    what = "a motion such as {x: 350 mm} or {rx: 90 deg}"

    x: Length | None = None
    y: Length | None = None
    z: Length | None = None
    rx: Angle | None = None
    ry: Angle | None = None
    rz: Angle | None = None

    @model_validator(mode="after")
    def _is_elementary(self) -> Motion:
        given = [key for key in DIRECTIONS if getattr(self, key) is not None]
        if not given or (len(given) > 1 and any(key in ("rx", "ry", "rz") for key in given)):
            hint = "Motions are applied left to right: give each rotation its own entry."
            found = Found(f"the keys {', '.join(given)}" if given else "no key")
            raise FieldError(found, "any of x, y, z, or one of rx, ry, rz", hint)
        return self


class Joint(_Part):
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


class Spring(_Part):
    """The spring and damper of one coordinate, in SI, with the bounds of a fit."""

    what = "a mapping with `stiffness`, or the word free"

    stiffness: float
    damping: float = 0.0
    stiffness_bounds: tuple[float, float] | None = None
    damping_bounds: tuple[float, float] | None = None

    @field_validator("stiffness", "damping", mode="plain")
    @classmethod
    def _value(cls, value: object, info: ValidationInfo) -> float:
        result = _in_unit(value)
        if result < 0.0 or (result == 0.0 and info.field_name == "stiffness"):
            expected = "a positive number" if info.field_name == "stiffness" else "a number, 0 or larger"
            raise FieldError(_raw(value), expected)
        return result

    @field_validator("stiffness_bounds", "damping_bounds", mode="plain")
    @classmethod
    def _bounds(cls, value: object, info: ValidationInfo) -> tuple[float, float]:
        raw, dimension = value if isinstance(value, _InUnit) else (value, None)
        if not isinstance(raw, list | tuple) or len(raw) != 2:
            raise FieldError(raw, "a list [lowest, highest]")
        low, high = (_in_unit(_InUnit(v, dimension), (i,)) for i, v in enumerate(raw))
        if not 0.0 < low < high:
            raise FieldError(Found(f"[{low:g}, {high:g}]"), "two positive numbers, the smaller one first")
        inside = info.data.get(str(info.field_name).removesuffix("_bounds"))
        if inside is not None and not low <= inside <= high:
            raise FieldError(Found(f"[{low:g}, {high:g}]"), f"bounds that contain the value {inside:g}")
        return low, high


class _InUnit(NamedTuple):
    """A raw value of a spring with the dimension that its coordinate gives it."""

    raw: object
    dimension: Dimension | None


def _in_unit(value: object, at: Location = ()) -> float:
    raw, dimension = value if isinstance(value, _InUnit) else (value, None)
    return measured(raw, dimension, at)


def _raw(value: object) -> object:
    return value.raw if isinstance(value, _InUnit) else value


def _spring(value: object, handler: Callable[[object], Spring]) -> Spring | None:
    if isinstance(value, FieldError):
        raise value
    if value == "free":
        return None
    if not isinstance(value, dict):
        raise FieldError(value, Spring.what)
    return handler(value)


class InertiaTensor(_Part):
    """Tensor entries about the centre of mass in the link frame (the URDF sign: xy = -∫xy dm), kg m²."""

    what = "a mapping with xx, yy, zz, xy, xz, yz"

    xx: Inertia = 0.0
    yy: Inertia = 0.0
    zz: Inertia = 0.0
    xy: Inertia = 0.0
    xz: Inertia = 0.0
    yz: Inertia = 0.0

    def matrix(self) -> tuple[Vector3, Vector3, Vector3]:
        """The 3x3 tensor."""
        return (self.xx, self.xy, self.xz), (self.xy, self.yy, self.yz), (self.xz, self.yz, self.zz)


class Coordinate(NamedTuple):
    """One coordinate of a joint: its key, what it does, and its spring (None where locked or free)."""

    key: str
    kind: Literal["revolute", "prismatic"]
    axis: Vector3
    spring: Spring | None
    flexible: bool


class Link(_Part):
    """A rigid body with the joint that carries it."""

    what = "a link: a mapping with name, parent and joint"

    name: Name
    parent: Name
    placement: tuple[Motion, ...] = ()
    joint: Joint
    elasticity: dict[str, Annotated[Spring | None, WrapValidator(_spring)]] = Field(default_factory=dict)
    mass: Annotated[float, measure("mass")] = 0.0
    com: Position = (0.0, 0.0, 0.0)
    inertia: InertiaTensor = InertiaTensor()

    @field_validator("name", mode="after")
    @classmethod
    def _is_not_base(cls, value: str) -> str:
        if value == "base":
            raise FieldError(value, "another name", "`base` is the ground that the first link stands on.")
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

    @field_validator("mass", mode="after")
    @classmethod
    def _is_not_negative(cls, value: float) -> float:
        if value < 0.0:
            raise FieldError(value, "a mass, 0 or larger")
        return value

    @model_validator(mode="after")
    def _has_mass_if_inertia(self) -> Link:
        if self.mass == 0.0 and any(any(row) for row in self.inertia.matrix()):
            found = Found("an inertia without a mass")
            raise FieldError(found, "a positive mass, or no inertia", at=("inertia",))
        return self

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
            result.append(Coordinate(key, self.joint.kind(key), axis, spring, key in self.elasticity))
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
    return {
        name: _InUnit(value, damping if name.startswith("damping") else stiffness) for name, value in spring.items()
    }


class Frame(_Part):
    """A named frame fixed to a link, where sensors sit and wrenches act."""

    what = "a frame: a mapping with name, link and placement"

    name: Name
    link: Name
    placement: tuple[Motion, ...] = ()


class BushingEntry(_Part):
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


class RobotDescription(_Part):
    """A whole robot file, each entry checked by itself; `reading` checks the names against each other."""

    what = "a robot description that starts with `armonic: 1`"

    armonic: Version
    name: Text
    source: Text | None = None
    gravity: Annotated[Vector3, vector("acceleration")] = (0.0, 0.0, -9.81)
    links: tuple[Link, ...]
    frames: tuple[Frame, ...] = ()
    postures: dict[Name, tuple[Any, ...]] = Field(default_factory=dict)
    bushings: tuple[BushingEntry, ...] = ()

    @field_validator("links", mode="before")
    @classmethod
    def _is_not_empty(cls, value: object) -> object:
        # Not `min_length`: that also counts links with an error of their own as absent.
        if value == []:
            raise FieldError(Found("an empty list"), "at least one link")
        return value
