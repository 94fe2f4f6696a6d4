"""URDFs that the tests share: a good one with ways to spoil it, random ones, and the same robot in Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from armonic.robot import Robot
from trees import Array, random_body

GOOD = """\
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0 0 0"/>
      <mass value="2"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><mesh filename="package://arm/upper.stl"/></geometry></visual>
  </link>
  <link name="fore">
    <inertial>
      <mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 1" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/>
    <child link="fore"/>
    <axis xyz="0 1 0"/>
    <dynamics damping="0.5"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="fore"/>
    <child link="tip"/>
  </joint>
</robot>
"""

FILE = """\
armonic: 1
name: Arm on a URDF
urdf: arm.urdf
joints:
  shoulder:
    elasticity: {z: {stiffness: 1.0e5, damping: 10}, x: {stiffness: 2.0e5}}
  elbow:
    elasticity:
      y: {stiffness: 5.0e4, damping: 4, stiffness_bounds: [1.0e3, 1.0e6]}   # a guess
postures:
  bent: [30 deg, 40 deg]
frames:
  - {name: probe, link: tip, placement: [{z: 200 mm}]}
"""


def numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def random_urdf(seed: int) -> str:
    """A branching robot of 4 to 9 joints of every kind, in shuffled order; what moves has an inertia."""
    rng = np.random.default_rng(seed)
    parts = ['<link name="ground"/>']
    kinds = ["revolute", "continuous", "prismatic", "fixed", *rng.choice(["revolute", "prismatic", "fixed"], 5)]
    kinds = [str(kind) for kind in rng.permutation(kinds[: int(rng.integers(4, 10))])]
    for i, kind in enumerate(kinds):
        parent = "ground" if i == 0 else f"l{i - 1 if rng.random() < 0.7 else int(rng.integers(0, i))}"
        mass, com, tensor = random_body(rng)
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        entries = " ".join(f'{k}="{v!s}"' for k, v in zip(keys, tensor[np.triu_indices(3)], strict=True))
        inertial = (
            f'<inertial><origin xyz="{numbers(com)}" rpy="{numbers(rng.uniform(-3, 3, 3))}"/><mass value="{mass!r}"/>'
            f"<inertia {entries}/></inertial>"
        )
        has_body = kind != "fixed" or rng.random() < 0.5
        parts.append(f'<link name="l{i}">{inertial if has_body else ""}</link>')
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]) if rng.random() < 0.5 else rng.normal(size=3)
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{numbers(rng.uniform(-0.5, 0.5, 3))}" rpy="{numbers(rng.uniform(-3, 3, 3))}"/>'
            f'<axis xyz="{numbers(axis)}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="random {seed}">{"".join(rng.permutation(parts))}</robot>'


@dataclass(frozen=True)
class Oracle:
    """A URDF as Pinocchio reads it, asked in Armonic's order of coordinates.

    Attributes:
        model: of Pinocchio.
        joints: the URDF's joint of each of Armonic's coordinates.
    """

    model: pin.Model
    joints: list[str]

    @classmethod
    def of(cls, text: str, robot: Robot) -> Oracle:
        assert robot.urdf is not None
        return cls(pin.buildModelFromXML(text), list(robot.urdf.moving))

    def configuration(self, q: Array) -> Array:
        """Pinocchio's own vector: it takes a continuous joint as cosine and sine."""
        out = pin.neutral(self.model)
        for name, value in zip(self.joints, q, strict=True):
            joint = self.model.joints[self.model.getJointId(name)]
            out[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        return out

    @property
    def order(self) -> list[int]:
        """Pinocchio's index of every coordinate's velocity."""
        return [self.model.joints[self.model.getJointId(name)].idx_v for name in self.joints]

    def pose(self, q: Array, frame: str) -> Array:
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, self.configuration(q))
        return np.array(data.oMf[self.model.getFrameId(frame)].homogeneous)

    def mass_matrix(self, q: Array) -> Array:
        data = self.model.createData()
        upper = np.triu(pin.crba(self.model, data, self.configuration(q)))
        return (upper + np.triu(upper, 1).T)[np.ix_(self.order, self.order)]

    def gravity_torque(self, q: Array) -> Array:
        data = self.model.createData()
        return np.array(pin.computeGeneralizedGravity(self.model, data, self.configuration(q)))[self.order]
