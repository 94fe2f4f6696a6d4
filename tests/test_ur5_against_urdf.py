"""A real robot, its URDF rewritten by hand as a robot file, moves as Pinocchio reads it in the URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from armonic.robot import Robot, load
from trees import Array, random_state, relative_difference

DATA = Path(__file__).parent / "data"
# Both sides round in double precision; the numbers of the two files are equal to the last digit.
TOLERANCE = 1e-9
FRAMES = {
    "shoulder": "shoulder",
    "upper_arm": "upper_arm",
    "forearm": "forearm",
    "wrist_1": "wrist_1_link",
    "wrist_2": "wrist_2_link",
    "wrist_3": "wrist_3_link",
    "ee_link": "ee_link",
    "spindle": "spindle",
}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load(DATA / "ur5.yaml")


@pytest.fixture(scope="module")
def model() -> pin.Model:
    return pin.buildModelFromUrdf(str(DATA / "ur5.urdf"))


@pytest.fixture(params=range(5))
def state(request: pytest.FixtureRequest) -> list[Array]:
    return random_state(request.param, 6)


def test_the_six_joints_are_the_coordinates(robot):
    assert robot.coordinates == robot.joint_coordinates
    assert [name.split(".")[0] for name in robot.coordinates] == list(FRAMES)[:6]
    assert robot.mechanism.n == 6


def test_the_flange_stands_where_the_dimensions_put_it(robot):
    # Stretched along x: 425 + 392.25 mm; aside: 135.85 - 119.7 + 93 + 82.3; in height: 89.159 - 94.65.
    flange = robot.mechanism.pose(robot.posture("zero"), robot.frame_index("ee_link"))
    assert flange[:3, 3] == pytest.approx([0.81725, 0.19145, -0.005491], abs=1e-12)  # rounding only


@pytest.mark.parametrize("frame", FRAMES)
def test_frames_match_the_urdf(robot, model, state, frame):
    q, data, index = state[0], model.createData(), model.getFrameId(FRAMES[frame])
    pin.framesForwardKinematics(model, data, q)
    expected = data.oMf[index].homogeneous
    ours = robot.frame_index(frame)
    assert relative_difference(robot.mechanism.pose(q, ours), expected) < TOLERANCE
    expected = pin.computeFrameJacobian(model, data, q, index, pin.LOCAL)
    assert relative_difference(robot.mechanism.jacobian(q, ours, own_axes=True), expected) < TOLERANCE


def test_dynamics_match_the_urdf(robot, model, state):
    q, qd, qdd = state
    data, mechanism = model.createData(), robot.mechanism
    upper = np.triu(pin.crba(model, data, q))
    assert relative_difference(mechanism.mass_matrix(q), upper + np.triu(upper, 1).T) < TOLERANCE
    gravity = pin.computeGeneralizedGravity(model, data, q).copy()
    assert relative_difference(mechanism.gravity_torque(q), gravity) < TOLERANCE
    bias = pin.nonLinearEffects(model, data, q, qd) - gravity
    assert relative_difference(mechanism.bias(q, qd), bias) < TOLERANCE
    tau = pin.rnea(model, data, q, qd, qdd)
    assert relative_difference(mechanism.inverse_dynamics(q, qd, qdd), tau) < TOLERANCE
    assert relative_difference(mechanism.forward_dynamics(q, qd, tau), qdd) < TOLERANCE


def test_tangent_matrices_match_the_urdf(robot, model, state):
    data = model.createData()  # Pinocchio's results are views of it
    by_position, by_velocity, _ = pin.computeRNEADerivatives(model, data, *state)
    _, damping, stiffness = robot.mechanism.linearize(*state)
    assert relative_difference(damping, by_velocity) < TOLERANCE
    assert relative_difference(stiffness, by_position) < TOLERANCE
