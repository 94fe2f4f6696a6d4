"""Small mappings of the robot file that others are made of: motions, Denavit-Hartenberg lines, inertia tensors."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import BaseModel, ConfigDict, model_validator

from armonic.description.fields import DIRECTIONS, FieldError, Found, Vector3, measure, not_negative, vector

Length = Annotated[float, measure("length")]
Angle = Annotated[float, measure("angle")]
Inertia = Annotated[float, measure("inertia")]
Mass = Annotated[float, not_negative("mass", "a mass, 0 or larger")]
Position = Annotated[Vector3, vector("length")]


class Part(BaseModel):
    """A mapping of the file: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    what: ClassVar[str] = "a mapping"


class Motion(Part):
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


class DenavitHartenberg(Part):
    """Standard Denavit-Hartenberg line: Rz(theta) Tz(d), the joint about or along z, Tx(a) Rx(alpha)."""

    what = "a mapping with theta, d, a, alpha"

    theta: Angle = 0.0
    d: Length = 0.0
    a: Length = 0.0
    alpha: Angle = 0.0

    @property
    def before(self) -> tuple[Motion, ...]:
        """The motions from the parent's frame to the joint's."""
        return Motion(rz=self.theta), Motion(z=self.d)

    @property
    def after(self) -> tuple[Motion, ...]:
        """The motions from the joint's frame, after its motion, to the link's."""
        return Motion(x=self.a), Motion(rx=self.alpha)


class InertiaTensor(Part):
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


def refuse_massless_inertia(mass: float, inertia: InertiaTensor) -> None:
    """No body has an inertia without a mass; a `FieldError` at `inertia`."""
    if mass == 0.0 and any(any(row) for row in inertia.matrix()):
        found = Found("an inertia without a mass")
        raise FieldError(found, "a positive mass, or no inertia", at=("inertia",))
