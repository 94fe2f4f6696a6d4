"""Measured modes that no robot has: what is kept of good ones, and how bad ones are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.updating.modal_data import ModalMeasurement, ModalResidual
from armonic.updating.parameters import choose
from models import slides, spring

GOOD: dict[str, Any] = {
    "posture": {},
    "natural_freq_hz": [10.0, 20.0],
    "damping_ratio": [0.01, 0.02],
    "shapes": [[1, 2, 3j], [0, 1, 0]],
    "frame": "mass_1",
}


def test_what_was_measured_is_kept_as_read_only_arrays() -> None:
    m = ModalMeasurement(**GOOD)
    assert len(m) == 2
    assert m.frame == ("mass_1",)
    assert m.label == "modes at posture"
    assert m.freq_deviation.tolist() == [0.005] * 2
    assert m.damping_deviation.tolist() == [0.1] * 2
    assert m.shape_deviation.tolist() == [0.05] * 2
    assert m.shapes.dtype == complex
    for array in (m.natural_freq_hz, m.damping_ratio, m.shapes, m.freq_deviation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert ModalMeasurement("milling", [3.0]).label == "modes at milling"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"natural_freq_hz": [10.0, 0.0]}, "natural_freq_hz: found 0"),
        ({"natural_freq_hz": [10.0, -2.0]}, "natural_freq_hz: found -2"),
        ({"natural_freq_hz": []}, "natural_freq_hz"),
        ({"natural_freq_hz": 10.0}, "natural_freq_hz: found shape"),
        ({"natural_freq_hz": [10.0, np.nan]}, "not finite"),
        ({"natural_freq_hz": [10.0, np.inf]}, "not finite"),
        ({"natural_freq_hz": [10.0, 20.0j]}, "of something else"),
        ({"natural_freq_hz": "fast"}, "of something else"),
        ({"natural_freq_hz": [[10.0], [20.0, 30.0]]}, "of something else"),
        ({"damping_ratio": [0.01]}, "damping_ratio: found shape"),
        ({"damping_ratio": 0.01}, "damping_ratio: found shape"),
        ({"damping_ratio": [0.01, 0.0]}, "damping_ratio: found 0"),
        ({"damping_ratio": [-0.01, 0.1]}, "damping_ratio: found -0.01"),
        ({"damping_ratio": [1.0, 2.0]}, "Percent are hundredths"),
        ({"damping_ratio": [np.nan, 0.1]}, "not finite"),
        ({"freq_deviation": 0.0}, "freq_deviation: found 0"),
        ({"freq_deviation": [0.1, 0.1, 0.1]}, "freq_deviation: found shape"),
        ({"damping_deviation": -1.0}, "damping_deviation: found -1"),
        ({"shape_deviation": np.nan}, "not finite"),
        ({"shapes": [[1, 2, 3]]}, r"shapes: found shape \(1, 3\), expected shape \(2, 3\)"),
        ({"shapes": [1, 2, 3]}, "shapes: found shape"),
        ({"shapes": [[1, 2], [3, 4]]}, r"expected shape \(2, 3\)"),
        ({"shapes": [[1, 2, np.nan], [1, 0, 0]]}, "zero or not finite"),
        ({"shapes": [[1, 2, 3], [0, 0, 0]]}, "zero or not finite"),
        ({"shapes": "round"}, "shapes: found a str"),
        ({"shapes": [[1], [2]], "outputs": "x"}, "only a scale"),
        ({"frame": ""}, "frame: found nothing"),
        ({"frame": ()}, "frame: found nothing"),
        ({"outputs": ("x", "q")}, "outputs: found 'q'"),
        ({"frame": 3}, "frame: found a int of something else"),
        ({"frame": None}, "frame: found a NoneType of something else"),
        ({"frame": ("mass_1", 3)}, "frame: found a tuple of something else"),
        ({"outputs": 5}, "outputs: found a int of something else"),
        ({"outputs": (1, 2)}, "outputs: found a tuple of something else"),
        ({"outputs": ()}, "outputs: found none"),
        ({"outputs": ("x", "x", "y")}, "each once"),
    ],
)
def test_nonsense_is_refused_in_one_clear_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(am.UpdateError, match=message) as caught:
        ModalMeasurement(**GOOD | change)
    assert "\n" not in str(caught.value)


def test_what_the_robot_lacks_is_refused() -> None:
    robot = slides([1.0, 2.0], [spring(1e4, 5.0), spring(2e4, 5.0)])
    chosen = choose(robot, am.linearize(robot, {}).impedances, "stiffness")
    with pytest.raises(am.UpdateError, match="mass_7") as caught:
        ModalResidual(robot, ModalMeasurement(**GOOD | {"frame": "mass_7"}), chosen)
    assert "mass_1" in str(caught.value)
    with pytest.raises(am.UpdateError, match="3 modes, expected at most the model's 2"):
        ModalResidual(robot, ModalMeasurement({}, [1.0, 2.0, 3.0]), chosen)
    with pytest.raises(am.PostureError, match="nowhere"):
        ModalResidual(robot, ModalMeasurement("nowhere", [1.0]), chosen)
