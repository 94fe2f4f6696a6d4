"""What figures of mode shapes and robots promise: phases and magnitudes, and frames where kinematics puts them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
import modal_maps
from armonic import plots
from armonic.errors import PostureError, SurveyError
from pages import HOSTILE

# Values are drawn as they are, or through one factor of 180/π.
ROUNDING = 1e-12
SHAPES = np.array([[1.0, 0.002j], [-0.5j, 2.0], [0.1 + 0.1j, 0.0], [0.001 * math.sqrt(0.5), -1.0]])


def two_modes(coordinates: tuple[str, ...]) -> am.Modes:
    """Two modes over four coordinates with known shapes."""
    own = am.modes(am.load("huynh_3r"), "milling")
    return replace(
        own,
        coordinates=coordinates,
        poles=own.poles[:2],
        natural_freq_hz=np.array([6.369, 58.4]),
        damped_freq_hz=np.array([6.35, 58.3]),
        damping_ratio=np.array([0.0767, 0.02982]),
        oscillatory=np.array([True, False]),
        shapes=SHAPES,
    )


def test_arrows_show_phase_and_relative_size_of_a_shape() -> None:
    names = ("a.z", "b.z", "a.motor", "b.motor")
    figure = plots.mode_shapes(two_modes(names))
    arrows = {(trace.subplot, trace.name): trace for trace in figure.data if trace.hoverinfo != "skip"}
    assert len(arrows) == len(names) * 2
    for mode, polar in enumerate(("polar", "polar2")):
        for k, name in enumerate(names):
            trace, entry = arrows[polar, name], SHAPES[k, mode]
            size = abs(entry) / np.abs(SHAPES[:, mode]).max()
            if size < 1e-3:  # beyond the three decades that are drawn
                assert trace.r == (None, None)
                continue
            assert trace.r[1] == pytest.approx(size, rel=ROUNDING)
            assert trace.theta == pytest.approx((np.degrees(np.angle(entry)),) * 2, rel=ROUNDING)
            assert "arrow" in trace.marker.symbol
        assert figure.layout[polar].radialaxis.type == "log"
    headings = [a.text for a in figure.layout.annotations]
    assert headings == ["<b>1</b>  6.37 Hz, 7.67 %", "<b>2</b>  58.40 Hz, real pole"]


def test_motors_are_dotted_in_the_colour_of_what_they_drive() -> None:
    figure = plots.mode_shapes(two_modes(("a.z", "b.tx", "b.motor", "a.motor")))
    lines = {trace.name: trace.line for trace in figure.data if trace.hoverinfo != "skip"}
    assert lines["a.motor"].color == lines["a.z"].color != lines["b.motor"].color == lines["b.tx"].color
    assert {name: line.dash for name, line in lines.items()} == {
        "a.z": "solid", "b.tx": "solid", "a.motor": "dot", "b.motor": "dot",
    }  # fmt: skip
    assert [trace.name for trace in figure.data if trace.hoverinfo == "skip"] == ["a.z", "b.tx", "motors"]
    without = plots.mode_shapes(two_modes(("a.z", "b.z", "c.z", "d.z")))
    assert "motors" not in [trace.name for trace in without.data]


def test_modes_are_shown_by_the_numbers_they_have_in_a_survey() -> None:
    names = ("a.z", "b.z", "c.z", "d.z")
    assert plots.mode_shapes(two_modes(names), numbers=[9, 4]).layout.annotations[0].text.startswith("<b>4</b>  58.40")
    assert len(plots.mode_shapes(two_modes(names), select=[2]).layout.annotations) == 1
    for wrong in ({"select": [3]}, {"select": []}, {"select": [0]}, {"numbers": [1]}):
        with pytest.raises(SurveyError):
            plots.mode_shapes(two_modes(names), **wrong)


def test_shapes_of_scompi_have_an_arrow_for_each_link_and_motor() -> None:
    modes = am.modes(am.load("scompi"), "c8")
    traces = [trace for trace in plots.mode_shapes(modes).data if trace.hoverinfo != "skip"]
    assert len(traces) == 12 * 12
    assert {trace.name for trace in traces} == set(modes.coordinates)


@pytest.fixture(scope="module")
def arms() -> am.Robot:
    return am.Robot.from_yaml(modal_maps.ROBOT)


def planar(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Origins of base, one, two and tip of the planar arms of 0.6 m and 0.5 m, (P, 4, 2)."""
    zero = np.zeros(len(q))
    elbow = 0.6 * np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=-1)
    tip = elbow + 0.5 * np.stack([np.cos(q.sum(axis=1)), np.sin(q.sum(axis=1))], axis=-1)
    base = np.stack([zero, zero], axis=-1)
    return np.stack([base, base, elbow, tip], axis=1)


def test_a_skeleton_joins_the_origins_of_the_link_frames(arms: am.Robot) -> None:
    q = np.stack([np.linspace(-0.5, 0.5, 21), np.linspace(1.0, -1.0, 21)], axis=-1)
    figure = plots.skeleton(arms, q, shown=3)
    drawn = {trace.name: trace for trace in figure.data if trace.name}
    assert {"posture 0", "posture 10", "posture 20", "path of tip", "tip"} == set(drawn)
    origins = planar(q)
    for place in (0, 10, 20):
        trace = drawn[f"posture {place}"]
        points = np.stack([trace.x, trace.y], axis=-1).reshape(-1, 3, 2)[:, :2]  # pairs, with gaps between
        pairs = [(0, 1), (1, 2), (2, 3)]
        np.testing.assert_allclose(points, [origins[place][list(pair)] for pair in pairs], atol=1e-12)
        assert np.nanmax(np.abs(trace.z)) == 0
    trail = drawn["path of tip"]
    np.testing.assert_allclose(np.stack([trail.x, trail.y], axis=-1), origins[:, 3], atol=1e-12)


def test_a_skeleton_stands_upright_against_gravity() -> None:
    camera = plots.skeleton(am.load("scompi"), ["c1", "c8"]).layout.scene.camera
    assert (camera.up.x, camera.up.y, camera.up.z) == (1, 0, 0)  # gravity is along -x0


def test_a_skeleton_takes_names_and_joint_coordinates_and_refuses_others(arms: am.Robot) -> None:
    names = [trace.name for trace in plots.skeleton(arms, ["start", [0.1, 0.2]]).data]
    assert names[:2] == ["posture start", "posture 1"]
    for wrong in ("start", [], np.zeros(2), np.zeros((2, 5)), [0.1, 0.2], ["nowhere"], 3):
        with pytest.raises(PostureError):
            plots.skeleton(arms, wrong)  # type: ignore[arg-type]
    with pytest.raises(PostureError, match="at least one"):
        plots.skeleton(arms, ["start"], shown=0)
    with pytest.raises(PostureError, match="one for each of 1"):
        plots.skeleton(arms, ["start"], names=["a", "b"])


def test_names_from_files_stay_text(arms: am.Robot) -> None:
    for figure in (
        plots.mode_shapes(two_modes((f"{HOSTILE}.z", "b.z", f"{HOSTILE}.motor", "b.motor"))),
        plots.skeleton(arms, ["start", [0.0, 1.0]], names=[HOSTILE, "b"]),
    ):
        text = str(figure.to_dict())
        assert "<img" not in text
        assert "<script" not in text
        assert "&lt;" in text
