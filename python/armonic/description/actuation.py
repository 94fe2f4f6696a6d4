"""The robot file's schema for what moves the joints: drives behind flexible shafts, and their control."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import Field, PlainValidator, field_validator

from armonic.description.fields import FieldError, InUnit, in_unit, measured, not_negative, positive, raw
from armonic.description.parts import Part
from armonic.description.units import Dimension

GAINS: Final[dict[str, Dimension]] = {
    "kp": "rotational stiffness",
    "ki": "integral gain",
    "kd": "rotational damping",
    "link_kp": "rotational stiffness",
    "link_ki": "integral gain",
    "link_kd": "rotational damping",
}
"""The gains of a motor and what they measure: a torque after the gear for an angle after the gear."""

Gain = float | tuple[float, ...]


def _gain(dimension: Dimension) -> PlainValidator:
    def one(value: object, at: tuple[int, ...] = ()) -> float:
        result = measured(value, dimension, at)
        if result < 0.0:
            raise FieldError(value, "a gain, 0 or larger", at=at)
        return result

    def read(value: object) -> Gain:
        if isinstance(value, list | tuple):
            return tuple(one(entry, (i,)) for i, entry in enumerate(value))
        return one(value)

    return PlainValidator(read)


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise FieldError(value, "true or false")
    return value


def _rows(value: object) -> tuple[tuple[object, ...], ...]:
    """A list of rows, still to be measured: which unit a column has depends on the joints."""
    expected = "a list of rows, one per motor"
    if not isinstance(value, list | tuple):
        raise FieldError(value, expected)
    for i, row in enumerate(value):
        if not isinstance(row, list | tuple):
            raise FieldError(row, "a row: a list of numbers", at=(i,))
    return tuple(tuple(row) for row in value)


Rows = Annotated[tuple[tuple[float, ...], ...], PlainValidator(_rows)]


class Drive(Part):
    """A motor with a gear behind a flexible shaft (Do et al. 2022, Appendix A), on the joint's own coordinate.

    Attributes:
        gear_ratio: N, turns of the rotor for one after the gear.
        rotor_inertia: kg m², of the rotor before the gear; after it there are N² times as many.
        shaft_stiffness: N m/rad, of the shaft after the gear.
        motor_damping: N m s/rad, on the motor's side, after the gear.
        joint_damping: N m s/rad or N s/m, on the link's side, of the joint's coordinate.
        radius: m, travel of a prismatic joint for one radian after the gear; 1 for a revolute joint.
    """

    what = "a mapping with gear_ratio, rotor_inertia and shaft_stiffness"

    gear_ratio: Annotated[float, positive(None)]
    rotor_inertia: Annotated[float, positive("inertia")]
    shaft_stiffness: Annotated[float, positive("rotational stiffness")]
    motor_damping: Annotated[float, not_negative("rotational damping")] = 0.0
    joint_damping: float = 0.0
    radius: Annotated[float | None, positive("length")] = None

    @field_validator("joint_damping", mode="plain")
    @classmethod
    def _is_not_negative(cls, value: object) -> float:
        result = in_unit(value)
        if result < 0.0:
            raise FieldError(raw(value), "a number, 0 or larger")
        return result


def with_dimension(drive: dict[str, object], *, turns: bool) -> dict[str, object]:
    """The raw mapping of a drive whose joint damping knows what it measures: that of the joint's coordinate."""
    if "joint_damping" not in drive:
        return drive
    dimension: Dimension = "rotational damping" if turns else "translational damping"
    return {**drive, "joint_damping": InUnit(drive["joint_damping"], dimension)}


class StateFeedback(Part):
    """Static feedback of all driven joints and motors to every motor.

    Attributes:
        position: (nm, 2 nm), N m per m or rad: columns are the driven joints' positions, then the motors'.
        velocity: likewise, N m s per m or rad.
    """

    what = "a mapping with position and velocity"

    position: Rows = ()
    velocity: Rows = ()

    @property
    def given(self) -> list[str]:
        """Which of them the file has; the others are zero."""
        return [name for name in type(self).model_fields if name in self.model_fields_set]


class ControlEntry(Part):
    """The control law of the motors: Do et al. 2022, Eq. 2, with further gains.

    A gain is one number for all motors, or one per motor in the order of the links.

    Attributes:
        kp: N m/rad after the gear, on the motor's position; ki its integral, kd its velocity.
        link_kp: likewise on the joint's position over its radius; link_ki its integral, link_kd its velocity.
        feedforward: whether the motors carry gravity and wrench of the desired posture.
        state_feedback: matrices over all joints and motors.
    """

    what = "a mapping with kp, ki, kd"

    kp: Annotated[Gain, _gain(GAINS["kp"])] = 0.0
    ki: Annotated[Gain, _gain(GAINS["ki"])] = 0.0
    kd: Annotated[Gain, _gain(GAINS["kd"])] = 0.0
    link_kp: Annotated[Gain, _gain(GAINS["link_kp"])] = 0.0
    link_ki: Annotated[Gain, _gain(GAINS["link_ki"])] = 0.0
    link_kd: Annotated[Gain, _gain(GAINS["link_kd"])] = 0.0
    feedforward: Annotated[bool, PlainValidator(_flag)] = True
    state_feedback: StateFeedback = Field(default_factory=StateFeedback)
