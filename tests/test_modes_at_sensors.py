"""Modes of a model as sensors see them."""

from __future__ import annotations

import numpy as np
import pytest

import armonic as am
from analysed import kuka
from armonic.comparison_at import modes_at
from armonic.errors import ModelError, PostureError


def test_a_shape_at_a_sensor_is_how_its_pose_changes() -> None:
    robot, model, modes = kuka()
    axes = ("x", "y", "z", "rx", "ry", "rz")
    table = modes_at(model, modes, [f"sensor.{axis}" for axis in axes])
    frame, step = robot.frame_index("sensor"), 1e-5
    for k in range(4):
        u = modes.shapes[:, k].real
        poses = robot.mechanism.pose(model.q + step * np.array([[-1.0], [1.0]]) * u, frame)
        rest = robot.mechanism.pose(model.q[None], frame)[0, :3, :3]
        moved = rest.T @ (poses[1] - poses[0])[:3, 3] / (2 * step)
        turned = rest.T @ (poses[1] - poses[0])[:3, :3] / (2 * step)
        own = [*moved, turned[2, 1], turned[0, 2], turned[1, 0]]
        np.testing.assert_allclose(table.shapes[k].real, own, atol=1e-8)  # of the difference's step, squared
    np.testing.assert_array_equal(table.poles, modes.poles)


def test_modes_at_sensors_pair_with_those_of_the_model_they_come_from() -> None:
    _, model, modes = kuka()
    table = modes_at(model, modes, ["sensor.x", "sensor.y", "sensor.z"])
    pairs = am.compare(table, modes_at(model, modes, ["sensor.x", "arm.z", "sensor.z"])).pairs
    assert [(pair.index_a, pair.index_b) for pair in pairs] == [(k, k) for k in range(9)]
    assert all(pair.mac == pytest.approx(1.0, rel=1e-9) for pair in pairs)


def test_a_place_the_robot_does_not_have_has_no_modes() -> None:
    _, model, modes = kuka()
    with pytest.raises(PostureError):
        modes_at(model, modes, ["spindle.x"])
    with pytest.raises(ModelError):
        modes_at(model, modes, ["sensor.q"])
    with pytest.raises(ModelError):
        modes_at(model, am.modes(am.load("scompi"), "c8"), ["sensor.x"])
