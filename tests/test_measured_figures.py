"""Figures of measured responses and of shapes on the robot show what was measured, at its place and in its size."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from analysed import kuka
from armonic.comparison import ModeTable
from armonic.comparison_at import modes_at
from armonic.errors import FrfError, SignalError
from armonic.files.measured_file import Geometry
from armonic.frf_set import FrfSet
from armonic.identification.poles import ModelPoles
from armonic.identification.stabilization import stabilize
from armonic.plots.indicators import mode_indicators
from armonic.plots.measured import frf_with_coherence
from armonic.plots.motion import shape_animation, shape_stills
from armonic.plots.moving import moving
from armonic.plots.nyquist import LEAST_LINES, around, nyquist
from armonic.plots.stabilization import stabilization_diagram
from armonic.plots.wireframe import eye, picture_axes, robot_wireframe
from measured_systems import KUKA
from pages import HOSTILE

SINGLE = 1e-6
"""Curves are drawn in single precision."""
LINES_HZ = np.arange(80, 481) / 16


def traces(figure: go.Figure, name: str) -> list[Any]:
    """Those with data: what only stands for a curve in the legend has none."""
    return [trace for trace in figure.data if trace.name == name and trace.x is not None and len(trace.x) > 1]


def said(figure: go.Figure) -> str:
    return "; ".join(str(note.text) for note in figure.layout.annotations)


def many(places: int) -> FrfSet:
    """Responses of so many places to forces at all of them, none measured twice alike."""
    labels = tuple(f"p{k}.z" for k in range(places))
    H = np.random.default_rng(0).normal(size=(20, places, places)) + 1j
    return FrfSet(np.arange(1.0, 21.0), H, "mobility", labels, labels)


def spring(mass: float, damper: float, stiffness: float, freq_hz: Any) -> FrfSet:
    s = 2j * np.pi * freq_hz
    H = s / (mass * s**2 + damper * s + stiffness)
    return FrfSet(freq_hz, H[:, None, None], "mobility", ("tip.z",), ("tip.z",))


def test_magnitude_phase_and_coherence_of_every_pair_are_drawn() -> None:
    frfs = KUKA.frfs(LINES_HZ, noise=0.01)
    drawn = traces(frf_with_coherence(frfs), "measured")
    assert len(drawn) == 27
    for k in range(9):
        size, phase, quality = drawn[3 * k : 3 * k + 3]
        i, j = divmod(k, 3)
        np.testing.assert_allclose(size.x, LINES_HZ, rtol=SINGLE)
        np.testing.assert_allclose(size.y, np.abs(frfs.values[:, i, j]), rtol=SINGLE)
        there = ~np.isnan(phase.y)
        turned = np.exp(1j * np.radians(phase.y[there].astype(float)))
        np.testing.assert_allclose(
            turned, np.exp(1j * np.angle(frfs.values[:, i, j])), atol=1e-6
        )  # of up to 225 degrees
        np.testing.assert_allclose(quality.y, frfs.coherence[:, i, j], rtol=SINGLE)


def test_without_coherence_there_is_no_pane_for_it() -> None:
    figure = frf_with_coherence(KUKA.frfs(LINES_HZ))
    assert len(traces(figure, "measured")) == 18
    assert "γ²" not in json.dumps(figure.to_plotly_json()["layout"], default=str)


def test_the_measurement_lies_thin_and_black_over_what_was_synthesized_and_fitted() -> None:
    frfs = KUKA.frfs(LINES_HZ, noise=0.01)
    exact = KUKA.frfs(LINES_HZ)
    figure = frf_with_coherence(frfs, others={"synthesized": exact, "fitted": exact, "before": exact})
    order = [trace.name for trace in figure.data if trace.x is not None and len(trace.x) > 1][:8:2]
    assert order == ["before", "fitted", "synthesized", "measured"]
    thin, dotted, thick = (traces(figure, name)[0].line for name in ("measured", "synthesized", "fitted"))
    assert (thin.color, dotted.dash) == ("#000000", "dot")
    assert thin.width < dotted.width < thick.width
    legend = sorted((t for t in figure.data if t.showlegend is not False), key=lambda t: t.legendrank)
    assert [t.name for t in legend] == ["measured", "synthesized", "fitted", "before"]


def test_what_is_drawn_along_is_of_the_same_kind() -> None:
    frfs = KUKA.frfs(LINES_HZ)
    figure = frf_with_coherence(frfs, others={"synthesized": KUKA.frfs(LINES_HZ, kind="receptance")})
    for one, other in zip(traces(figure, "measured"), traces(figure, "synthesized"), strict=True):
        np.testing.assert_allclose(one.y, other.y, rtol=1e-5, equal_nan=True)  # s² and back, in single precision


def test_a_pair_that_was_not_measured_has_no_cell() -> None:
    frfs = KUKA.frfs(LINES_HZ)
    seen = np.ones((3, 3), bool)
    seen[0, 1] = False
    figure = frf_with_coherence(replace(frfs, measured=seen))
    assert len(traces(figure, "measured")) == 16
    assert "tip.x</b>, force <b>tip.y" not in said(figure)


def test_of_many_responses_the_driving_points_come_first_and_the_rest_is_said() -> None:
    figure = frf_with_coherence(many(5), most=6)
    cells = [str(note.text) for note in figure.layout.annotations if "force" in str(note.text)]
    assert cells[:5] == [f"<b>p{k}.z</b>, force <b>p{k}.z</b>" for k in range(5)]
    assert len(cells) == 6
    assert "6 of 25 measured responses drawn" in said(figure)


def test_a_response_to_a_moment_is_called_one() -> None:
    H = np.ones((3, 1, 1), complex)
    figure = frf_with_coherence(FrfSet([1.0, 2.0, 3.0], H, "receptance", ("tip.rx",), ("tip.ry",)))
    assert "rotation <b>tip.rx</b>, moment <b>tip.ry</b>" in said(figure)
    assert figure.layout.yaxis.title.text == "|H|, rad/(N·m)"


def test_noise_around_180_degrees_does_not_tear_a_phase_apart() -> None:
    noise = np.random.default_rng(0).normal(size=200)
    H = -np.exp(0.1j * noise)
    frfs = FrfSet(np.arange(1.0, 201.0), H[:, None, None], "receptance", ("a.x",), ("a.x",))
    phase = traces(frf_with_coherence(frfs), "measured")[1]
    assert len(phase.y) == 200  # a tear would add a gap
    assert np.ptp(phase.y) < 60


def test_a_long_response_keeps_its_peak() -> None:
    f = np.arange(1, 40_001) / 1000.0
    H = np.ones(40_000, complex)
    H[12_345] = 80.0
    frfs = FrfSet(f, H[:, None, None], "receptance", ("a.x",), ("a.x",))
    size = traces(frf_with_coherence(frfs), "measured")[0]
    assert len(size.x) <= 2400
    assert size.x[np.argmax(size.y)] == pytest.approx(12.346, rel=SINGLE)
    assert size.y.max() == 80.0


@pytest.mark.parametrize(
    "wrong", [{"pairs": [("tip.x", "tip.q")]}, {"pairs": []}, {"most": 0}, {"pairs": [("x", "tip.x")]}]
)
def test_a_response_that_is_not_there_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(FrfError):
        frf_with_coherence(KUKA.frfs(LINES_HZ), **wrong)


def test_names_of_measured_points_stay_text() -> None:
    labels = (f"{HOSTILE}.x",)
    frfs = FrfSet(LINES_HZ, KUKA.frfs(LINES_HZ).values[:, :1, :1], "accelerance", labels, labels)
    others = {HOSTILE: frfs}
    page = frf_with_coherence(frfs, others=others).to_json() + nyquist(frfs, KUKA.poles[:1]).to_json()
    geometry = Geometry((HOSTILE,), np.zeros((1, 3)))
    page += shape_stills(
        None, None, ModeTable(KUKA.poles[:1], np.ones((1, 1)) + 0j, labels), geometry=geometry
    ).to_json()
    assert "<script" not in page
    assert "<img" not in page


def test_the_mobility_of_one_viscous_mode_is_drawn_as_its_circle() -> None:
    mass, damper = 2.0, 5.0
    pole = -damper / (2 * mass) + 1j * np.sqrt(3e4 / mass - (damper / (2 * mass)) ** 2)
    frfs = spring(mass, damper, 3e4, np.arange(1, 4001) / 100)
    (dots,) = traces(nyquist(frfs, [pole]), "measured")
    z = dots.x.astype(float) + 1j * dots.y.astype(float)
    np.testing.assert_allclose(np.abs(z - 1 / (2 * damper)), 1 / (2 * damper), rtol=1e-5)  # in single precision
    # Real and imaginary part of a half-power point are alike, and so far outside the lines go.
    assert abs(np.angle(z)).max() > np.radians(80)


def test_the_ring_stands_on_the_line_nearest_to_the_mode() -> None:
    frfs = KUKA.frfs(LINES_HZ)
    figure = nyquist(frfs, KUKA.poles, pairs=[("tip.x", "tip.y")])
    rings = [t for t in figure.data if t.name == "line nearest to the mode"]
    at = [float(ring.customdata[0]) for ring in rings]
    expected = [LINES_HZ[np.argmin(abs(LINES_HZ - f))] for f in KUKA.poles.imag / 2 / np.pi]
    np.testing.assert_allclose(at, expected, rtol=SINGLE)


def test_lines_of_a_circle_end_halfway_to_the_next_mode_and_are_five_at_least() -> None:
    fine, coarse = KUKA.frfs(np.arange(1, 3001) / 100), KUKA.frfs(np.arange(1.0, 31.0))
    poles = KUKA.poles
    for mode in range(4):
        f = fine.freq_hz[around(fine, poles, mode)]
        centre = poles[mode].imag / 2 / np.pi
        reach = 8 * -poles[mode].real / 2 / np.pi
        assert np.abs(f - centre).max() <= reach
        assert len(around(coarse, poles, mode)) >= LEAST_LINES
    first = fine.freq_hz[around(fine, poles, 0)]
    assert first.max() <= 10.5  # halfway between 10 and 11 Hz


def test_a_windowed_measurement_and_its_model_lie_on_one_curve() -> None:
    from armonic.identification.modal_model import ModalModel

    frfs = KUKA.frfs(LINES_HZ, decay_rate=2.0)
    model = ModalModel(KUKA.poles, KUKA.residues, KUKA.outputs, KUKA.inputs)
    figure = nyquist(frfs, KUKA.poles, model=model, pairs=[("tip.x", "tip.x")])
    for dots, curve in zip(traces(figure, "measured"), traces(figure, "synthesized"), strict=True):
        z, model_z = (t.x.astype(float) + 1j * t.y.astype(float) for t in (dots, curve))
        apart = np.abs(z[:, None] - model_z).min(axis=1).max()
        assert apart < np.abs(np.diff(model_z)).max()  # nearer than its points are to one another


@pytest.mark.parametrize("wrong", [{"pairs": [("tip.x", "tip.q")]}, {"pairs": []}, {"kind": "speed"}])
def test_a_circle_of_nothing_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(FrfError):
        nyquist(KUKA.frfs(LINES_HZ), KUKA.poles, **wrong)
    with pytest.raises(FrfError):
        nyquist(KUKA.frfs(LINES_HZ), [])


def test_the_complex_mode_indicator_is_drawn_as_the_singular_values() -> None:
    frfs = KUKA.frfs(LINES_HZ)
    figure = mode_indicators(frfs, [10.0, 11.0, 19.2, 23.7, 99.0])
    drawn = [traces(figure, name)[0].y for name in ("first", "second", "third")]
    expected = np.linalg.svd(frfs.values, compute_uv=False)
    # The smallest of a matrix is known to rounding of the largest.
    np.testing.assert_allclose(np.column_stack(drawn), expected, rtol=SINGLE, atol=1e-12 * expected.max())
    assert [line.x0 for line in figure.layout.shapes] == [10.0, 10.0, 11.0, 11.0, 19.2, 19.2, 23.7, 23.7]


def test_the_multivariate_mode_indicator_dips_at_real_modes_and_nowhere_else() -> None:
    f = np.arange(400, 2401) / 80
    dips = traces(mode_indicators(KUKA.frfs(f)), "first")[1].y
    modes = [int(np.argmin(abs(f - at))) for at in (10.0, 11.0, 19.2, 23.7)]
    assert dips[modes].max() < 0.1
    assert dips[abs(f - 21.5) < 1].min() > 0.5  # between modes the response is in phase or opposition with the force


def test_with_one_response_to_many_forces_the_indicator_still_dips_at_modes_alone() -> None:
    frfs = KUKA.frfs(LINES_HZ, kind="receptance").select(outputs=["tip.y"])
    drawn = traces(mode_indicators(frfs), "first")[1].y
    H = frfs.values[:, 0, :]
    in_phase = (H.real**2).sum(axis=1) / (np.abs(H) ** 2).sum(axis=1)  # of a single column nothing is left to choose
    np.testing.assert_allclose(drawn, in_phase, rtol=SINGLE, atol=1e-9)  # rounding of the eigenvalues


def test_indicators_leave_out_a_line_at_zero() -> None:
    exact = KUKA.frfs(np.arange(0.0, 31.0))
    (first, *_) = traces(mode_indicators(exact), "first")
    assert (first.x[0], len(first.x)) == (1.0, 30)


def test_behind_the_stabilization_stands_the_sum_of_the_responses() -> None:
    frfs = KUKA.frfs(LINES_HZ)
    poles = stabilize([ModelPoles(p, KUKA.poles, KUKA.shapes + 0j) for p in (2, 3)])
    (curve,) = traces(stabilization_diagram(poles, frfs=frfs), "sum of |H|")
    size = np.abs(frfs.values)
    expected = (size / np.sqrt((size**2).mean(axis=0))).sum(axis=(1, 2))
    np.testing.assert_allclose(curve.y, expected, rtol=1e-12)  # the sum in another order
    assert not traces(stabilization_diagram(poles, what="damping", frfs=frfs), "sum of |H|")


def test_links_keep_their_length_however_far_a_mode_swings() -> None:
    robot, model, modes = kuka()
    motion = moving(robot, "milling", modes, select=[1, 2, 3, 4], share=0.3)
    frame = robot_wireframe(robot, model.q)
    for a, b in frame.lines:
        length = np.linalg.norm(motion.paths[:, :, a] - motion.paths[:, :, b], axis=-1)
        np.testing.assert_allclose(length, np.linalg.norm(frame.points[a] - frame.points[b]), atol=1e-12)


def test_the_largest_deflection_is_the_share_of_the_size_that_was_asked_for() -> None:
    robot, _, modes = kuka()
    motion = moving(robot, "milling", modes, select=[1, 2, 3, 4], share=0.001)
    moved = np.linalg.norm(motion.paths - motion.frame.points, axis=-1).max(axis=(1, 2))
    np.testing.assert_allclose(moved, 0.001 * motion.frame.size, rtol=2e-3)  # of second order in the share


def test_the_whole_robot_and_its_measured_tip_move_alike() -> None:
    robot, model, modes = kuka()
    table = modes_at(model, modes, ["sensor.x", "sensor.y", "sensor.z"])
    whole = moving(robot, "milling", modes, select=[2, 4], share=1e-4)
    tip = moving(robot, "milling", table, select=[2, 4], share=1e-4)
    rest = whole.frame.points[-1]
    for k in range(2):
        a, b = whole.paths[k, 0, -1] - rest, tip.paths[k, 0, 0] - rest
        alike = abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b)
        assert alike == pytest.approx(1.0, abs=1e-6)  # of second order in the share


def test_a_real_shape_swings_along_a_line_and_a_complex_one_round_an_ellipse() -> None:
    geometry = Geometry(("p", "q"), np.array([[0.0, 0, 0], [2.0, 0, 0]]), ((0, 1),))
    labels = ("p.x", "p.y", "q.x", "q.y")
    shapes = np.array([[0, 1.0, 0, 0.5], [1, 1j, 0, 0.5j]], complex)
    motion = moving(None, None, ModeTable(KUKA.poles[:2], shapes, labels), geometry=geometry, share=0.1, phases=8)
    line, circle = motion.paths - motion.frame.points
    turn = 2 * np.pi * np.arange(8) / 8
    np.testing.assert_allclose(line[:, 0], 0.2 * np.outer(np.cos(turn), [0, 1, 0]), atol=1e-15)
    np.testing.assert_allclose(line[:, 1], 0.5 * line[:, 0], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(circle[:, 0], axis=-1), 0.2, rtol=1e-12)
    assert np.linalg.matrix_rank(circle[:, 0], tol=1e-9) == 2
    assert motion.frame.lines == ((0, 1),)


def test_displacements_are_along_the_axes_of_the_frame() -> None:
    robot, model, _ = kuka()
    shape = ModeTable(KUKA.poles[:1], np.array([[0.0, 1.0, 0.0]], complex), ("sensor.x", "sensor.y", "sensor.z"))
    motion = moving(robot, "milling", shape, phases=4)
    axis = robot.mechanism.pose(model.q[None], robot.frame_index("sensor"))[0, :3, 1]
    moved = motion.paths[0, 0, 0] - motion.frame.points[0]
    np.testing.assert_allclose(moved, 0.1 * motion.backdrop.size * axis, atol=1e-12)  # rounding of metres


def test_every_mode_has_a_button_that_plays_its_own_pictures() -> None:
    robot, _, modes = kuka()
    figure = shape_animation(robot, "milling", modes, select=[1, 3], steps=12)
    assert [frame.name for frame in figure.frames] == [f"{mode}.{step}" for mode in (1, 3) for step in range(12)]
    *play, stop = figure.layout.updatemenus[0].buttons
    assert [button.label[:4] for button in play] == ["▶ 1:", "▶ 3:"]
    for button, mode in zip(play, (1, 3), strict=True):
        assert set(button.args[0]) == {f"{mode}.{step}" for step in range(12)}
        assert button.args[1]["frame"]["redraw"]  # without it nothing moves in three dimensions
    assert list(stop.args[0]) == [None]


def test_half_a_cycle_later_a_point_is_on_the_other_side() -> None:
    geometry = Geometry(("p",), np.array([[1.0, 2, 3]]))
    table = ModeTable(KUKA.poles[:1], np.array([[1.0, 0.3j]]), ("p.x", "p.z"))
    figure = shape_animation(None, None, table, geometry=geometry, steps=8)
    for step in range(4):
        here, there = (np.array([figure.frames[s].data[1][axis][0] for axis in "xyz"]) for s in (step, step + 4))
        np.testing.assert_allclose((here + there) / 2, [1, 2, 3], rtol=SINGLE)


def test_points_without_a_position_are_named() -> None:
    robot, *_ = kuka()
    table = ModeTable(KUKA.poles[:1], np.array([[1.0, 0.3]], complex), ("sensor.x", "table_3.z"))
    for draw in (shape_stills, shape_animation):
        assert "without a position or a known motion, not drawn: table_3" in said(draw(robot, "milling", table))


def test_a_point_whose_motion_is_not_known_is_left_out() -> None:
    robot, *_ = kuka()
    table = ModeTable(KUKA.poles[:1], np.array([[1.0, np.nan]], complex), ("sensor.x", "arm.z"))
    motion = moving(robot, "milling", table)
    assert motion.frame.names == ("sensor",)
    assert motion.missing == ("arm",)


def test_a_still_has_both_extremes_of_each_mode_in_one_scale() -> None:
    robot, _, modes = kuka()
    figure = shape_stills(robot, "milling", modes, select=[1, 2])
    for name in ("at rest", "one extreme", "the other"):
        assert len([trace for trace in figure.data if trace.name == name]) == 2
    for axis in ("xaxis", "yaxis"):
        assert figure.layout[axis].range == figure.layout[f"{axis}2"].range
    across, up = (np.ptp(figure.layout[axis].range) for axis in ("xaxis", "yaxis"))
    wide, high = (np.ptp(figure.layout[axis].domain) for axis in ("xaxis", "yaxis"))
    # Metres per pixel are the same along both.
    assert across / (wide * figure.layout.width) == pytest.approx(up / (high * figure.layout.height), rel=0.01)


def test_a_robot_is_seen_upright_and_reaching_to_the_right() -> None:
    robot, model, _ = kuka()
    frame = robot_wireframe(robot, model.q)
    right, above = picture_axes(eye(frame.points, frame.up), frame.up)
    assert above @ frame.up > 0.7
    assert (frame.points[-1] - frame.points[0]) @ right > 0
    standing = np.array([[0.0, 0, 0], [0, 0, 1.0]])  # one above the other, from nowhere in particular
    assert np.linalg.norm(eye(standing, np.array([0.0, 0, 1.0]))) == pytest.approx(1.0, rel=1e-12)


def test_modes_that_cannot_be_drawn_are_refused() -> None:
    robot, _, modes = kuka()
    elsewhere = ModeTable(KUKA.poles[:1], np.ones((1, 1)) + 0j, ("table.x",))
    unknown = ModeTable(KUKA.poles[:1], np.full((1, 1), np.nan) + 0j, ("sensor.x",))
    for wrong in ((robot, elsewhere), (robot, unknown), (None, modes), (robot, [(10.0, 0.01)])):
        with pytest.raises(SignalError):
            shape_stills(wrong[0], None, wrong[1])
    for select in ([], [0], [99]):
        with pytest.raises(SignalError):
            shape_animation(robot, "milling", modes, select=select)
