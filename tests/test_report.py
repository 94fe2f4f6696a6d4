"""What the report and its figures promise: the whole fit, nothing but the fit, nothing from the network."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic import plots
from armonic.errors import DataFileError, FrfError
from armonic.report import render
from armonic.updating import Fit, FittedParameter, Parameter
from pages import HOSTILE, Page, figures, numbers, outside

# Degrees and magnitudes go through one conversion each way, of a few rounded operations.
ROUNDING = 1e-12
FREQ_HZ = np.linspace(5.0, 25.0, 41)


@pytest.fixture(scope="module")
def fit() -> Fit:
    """Two measurements in two postures, three by three and one by one, of a robot that starts elsewhere."""
    robot = am.load("huynh_3r")
    start = robot.with_values({path: 1.3 * value for path, value in robot.parameters().items()})
    full = am.frf(robot, "milling", FREQ_HZ, frame="sensor")
    single = am.frf(robot, [0.2, 1.0, -1.4], FREQ_HZ, frame="sensor", kind="receptance").select(outputs="x", inputs="z")
    return am.update(start, [am.Measurement(full, "milling"), am.Measurement(single, [0.2, 1.0, -1.4])])


def parameter(path: str = "links.arm.elasticity.z.stiffness", **changes: Any) -> FittedParameter:
    values: dict[str, Any] = {"unit": "N m/rad", "start": 1e6, "value": 2e6, "lower": 5e5, "upper": 8e6}
    values |= {"interval": (1.9e6, 2.1e6), "verdict": "identified"}
    return FittedParameter(path, **(values | changes))


def of(fit: Fit, parameters: tuple[FittedParameter, ...], **changes: Any) -> Fit:
    """The fit as one of other parameters, each known by itself to a hundredth."""
    count = len(parameters)
    coordinates = tuple(Parameter(p.path, (p.path,), p.unit, p.start, p.lower, p.upper) for p in parameters)
    known = {"covariance": 1e-4 * np.eye(count), "information": 1e4 * np.eye(count)}
    return replace(fit, parameters=parameters, coordinates=coordinates, **known, **changes)


OPEN = (0.0, np.inf)
FOUR = (
    parameter("links.a.elasticity.z.stiffness"),
    parameter("links.b.elasticity.z.stiffness", interval=(1e6, 4e6), verdict="weak"),
    parameter("links.c.elasticity.z.stiffness", interval=OPEN, verdict="not identifiable"),
    parameter("links.d.elasticity.z.stiffness", value=8e6, interval=(6e6, np.inf), verdict="at bound"),
)


def test_the_report_loads_nothing_from_outside(fit: Fit, tmp_path: Path) -> None:
    html = am.write_report(fit, tmp_path / "r.html").read_text("utf-8")
    assert outside(html) == []


def test_the_report_carries_plotly_once(fit: Fit) -> None:
    scripts = Page(render(fit)).scripts
    assert [len(script) > 1_000_000 for script in scripts].count(True) == 1
    assert len(scripts[0]) > 1_000_000


def test_every_response_in_the_report_is_the_one_given(fit: Fit) -> None:
    drawn = figures(Page(render(fit)))
    for k, measurement in enumerate(fit.measurements):
        given = {"measured": measurement.frf, "before": fit.frf_before[k], "after": fit.frf_after[k]}
        traces = {(trace["name"], trace["yaxis"]): trace for trace in drawn[k]}
        columns = len(measurement.frf.inputs)
        bands = [trace for trace in drawn[k] if trace["name"] == plots.BAND_NAME]
        assert len(bands) == 2 * len(measurement.frf.outputs) * columns
        assert len(traces) - len(bands) == 3 * len(bands)
        for (name, frf), i, j in product(given.items(), range(len(measurement.frf.outputs)), range(columns)):
            pane = 2 * (i * columns + j) + 1
            magnitude = traces[name, f"y{pane}" if pane > 1 else "y"]
            phase = traces[name, f"y{pane + 1}"]
            turned = numbers(phase["y"])
            kept = np.isfinite(turned)
            response = numbers(magnitude["y"]) * np.exp(1j * np.radians(turned[kept]))
            np.testing.assert_array_equal(numbers(magnitude["x"]), frf.freq_hz)
            np.testing.assert_array_equal(numbers(phase["x"])[kept], frf.freq_hz)
            np.testing.assert_allclose(response, frf.values[:, i, j], rtol=ROUNDING)


def test_the_report_says_how_the_fit_went(fit: Fit) -> None:
    fit = of(fit, FOUR, cost=0.25, start_cost=1250.0, evaluations=34, duration_s=200.0)
    text = " ".join(Page(render(fit, title="Cell 7")).text.split())
    assert "Cell 7" in text
    assert "The cost fell from 1250 to 0.2500 in 34 evaluations and 3 min 20 s." in text
    assert "Of 4 parameters, 1 is identified, 1 is weakly determined, 1 is not identifiable" in text
    assert "Huynh" in text
    assert "Eq. 22" in text
    assert am.__version__ in text


@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("interrupted", "The fit was interrupted"),
        ("limit", "before it converged"),
        ("converged", "converged."),
    ],
)
def test_the_report_says_how_the_fit_ended(fit: Fit, status: Any, words: str) -> None:
    page = Page(render(replace(fit, status=status)))
    assert words in page.text
    alarmed = any("alarm" in str(attributes.get("class")) for tag, attributes in page.tags if tag == "p")
    assert alarmed == (status != "converged")


def test_every_verdict_is_shown_with_its_interval(fit: Fit) -> None:
    rows = {row[0]: row for row in Page(render(of(fit, FOUR))).rows if row}
    shown = [rows[p.path][4:] for p in FOUR]
    assert shown == [
        ["1.900e6 … 2.100e6", "500.0e3 … 8.000e6", "identified"],
        ["1.000e6 … 4.000e6", "500.0e3 … 8.000e6", "weak"],
        ["open", "500.0e3 … 8.000e6", "not identifiable"],
        ["6.000e6 … open", "500.0e3 … 8.000e6", "at bound"],
    ]
    legend = [trace.name for trace in plots.parameter_intervals(replace(fit, parameters=FOUR)).data]
    assert set(legend) == {"bounds", "start", "identified", "weak", "not identifiable", "at bound"}


def test_intervals_are_drawn_to_scale_and_open_ends_as_arrows(fit: Fit) -> None:
    figure = plots.parameter_intervals(replace(fit, parameters=FOUR))
    dots = {trace.name: trace for trace in figure.data if trace.error_x.array is not None}
    assert [dots[p.verdict].y[0] for p in FOUR] == [0, 1, 2, 3]
    reach = [(1 - dots[v].error_x.arrayminus[0], 1 + dots[v].error_x.array[0]) for v in ("identified", "weak")]
    np.testing.assert_allclose(reach, [(0.95, 1.05), (0.5, 2.0)], rtol=ROUNDING)
    arrows = {(t.marker.symbol, y) for t in figure.data if "triangle" in str(t.marker.symbol) for y in t.y}
    assert arrows == {("triangle-left", 2), ("triangle-right", 2), ("triangle-right", 3)}
    low, high = 10 ** np.array(figure.layout.xaxis.range)
    assert all(low < x < high for trace in figure.data for x in trace.x if np.isfinite(x))


def test_stiffness_and_damping_share_rows_in_two_panels(fit: Fit) -> None:
    figure = plots.parameter_intervals(fit)
    assert list(figure.layout.yaxis.ticktext) == ["carousel.z", "link_arm.z", "arm.z"]
    assert {trace.xaxis for trace in figure.data} == {"x", "x2"}
    legend = [trace.name for trace in figure.data if trace.showlegend]
    assert len(legend) == len(set(legend))


def test_parameters_with_one_short_name_keep_their_own_rows(fit: Fit) -> None:
    clash = (parameter("links.m.elasticity.x.stiffness"), parameter("bushings.m.stiffness.x"))
    figure = plots.parameter_intervals(replace(fit, parameters=clash))
    assert list(figure.layout.yaxis.ticktext) == [p.path for p in clash]


def named(fit: Fit, name: str) -> Fit:
    """The fit with one name for all that has one in the user's files."""
    robot = am.Robot.from_yaml(fit.start.to_yaml().replace("name: ", f"name: {json.dumps(name)} #", 1))
    frf = fit.measurements[1].frf
    odd = replace(frf, outputs=(name,))
    measurement = am.Measurement(frf, [0.2, 1.0, -1.4], label=name)
    object.__setattr__(measurement, "frf", odd)
    return of(
        replace(fit, record=replace(fit.record, robot=name, measurements=((name, "0" * 64),), options={name: name})),
        (parameter(f"links.{name}.elasticity.z.stiffness"), *fit.parameters[1:]),
        start=robot,
        measurements=(fit.measurements[0], measurement),
        frf_before=(fit.frf_before[0], odd),
        frf_after=(fit.frf_after[0], odd),
        postures=(name, "b"),
        message=name,
    )


def test_names_from_files_stay_text(fit: Fit) -> None:
    hostile = named(fit, HOSTILE)
    frf = hostile.measurements[1].frf
    page, plain = Page(render(hostile)), Page(render(named(fit, "plain")))
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in plain.tags]
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    assert page.text.count(HOSTILE) >= 5
    assert "7*7" in page.text
    # Plotly would take tags in its texts for its own.
    assert "<script" not in json.dumps(figures(page))
    for figure in (
        plots.frf_matrix({HOSTILE: frf}),
        plots.correlation_matrix(hostile),
        plots.principal_directions(hostile),
        plots.profile_curve(am.Profile(HOSTILE, np.array([1.0, 2.0]), np.array([0.0, 5.0]), 3.8, (0.5, 1.8), HOSTILE)),
        plots.mac_matrix([[1.0]], [HOSTILE], [HOSTILE], row_title=HOSTILE),
        plots.parameter_intervals(hostile),
    ):
        assert "<img" not in str(figure.to_dict())
        assert "<script" not in str(figure.to_dict())


def test_half_a_character_does_not_stop_the_report(fit: Fit, tmp_path: Path) -> None:
    am.write_report(fit, tmp_path / "r.html", title="a\ud800b")
    assert "a?b" in (tmp_path / "r.html").read_text("utf-8")


def test_nothing_is_written_where_there_is_no_folder(fit: Fit, tmp_path: Path) -> None:
    with pytest.raises(DataFileError):
        am.write_report(fit, tmp_path / "missing" / "r.html")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_the_old_report(fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.html"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DataFileError, match="No space left"):
        am.write_report(fit, path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_modes_are_paired_by_shape_not_by_rank(fit: Fit) -> None:
    turned = fit.before[0]
    order = [2, 0, 1]
    before = replace(
        turned,
        natural_freq_hz=np.array([11.0, 12.0, 13.0]),
        damped_freq_hz=np.array([10.0, 11.0, 12.0]),
        shapes=turned.shapes[:, order],
    )
    after = replace(turned, natural_freq_hz=np.array([21.0, 22.0, 23.0]))
    cross = np.eye(3)[order]
    page = Page(render(replace(fit, before=(before,), after=(after,), mac=(cross,), postures=("milling",))))
    pairs = [(row[0], row[4], row[5]) for row in page.rows if len(row) == 9]
    assert pairs == [("12.00", "1.00", "21.00"), ("13.00", "1.00", "22.00"), ("11.00", "1.00", "23.00")]


def test_real_poles_are_called_so_and_modes_without_partner_are_kept(fit: Fit) -> None:
    full = fit.before[0]
    two = replace(
        full,
        natural_freq_hz=np.array([21.0, 22.0]),
        damped_freq_hz=np.array([0.0, 22.0]),
        damping_ratio=np.array([1.0, 0.01]),
        oscillatory=np.array([False, True]),
        poles=full.poles[:2],
        shapes=full.shapes[:, :2],
        participation=full.participation[:, :2],
    )
    page = Page(render(replace(fit, before=(full,), after=(two,), mac=(np.eye(3)[:, :2],), postures=("milling",))))
    rows = [row for row in page.rows if len(row) == 9]
    assert len(rows) == 3
    assert rows[0][6:8] == ["real pole", "100"]
    assert rows[2][4:8] == ["–"] * 4


def test_an_unstable_robot_raises_an_alarm(fit: Fit) -> None:
    unstable = tuple(replace(modes, stability="unstable") for modes in fit.after)
    assert "unstable in this posture" in Page(render(replace(fit, after=unstable))).text


def test_mac_matrix_runs_from_zero_to_one_and_keeps_equal_labels_apart() -> None:
    figure = plots.mac_matrix([[0.5, 0.1], [0.2, 0.004]], ["9.0 Hz", "9.0 Hz"], ["8.0 Hz", "8.0 Hz"])
    (heat,) = figure.data
    assert (heat.zmin, heat.zmax) == (0, 1)
    np.testing.assert_array_equal(heat.z, [[0.5, 0.1], [0.2, 0.004]])
    assert [list(row) for row in heat.text] == [["0.50", "0.10"], ["0.20", "0"]]
    assert list(figure.layout.yaxis.ticktext) == ["9.0 Hz", "9.0 Hz"]
    assert list(figure.layout.yaxis.tickvals) == [0, 1]
    with pytest.raises(FrfError):
        plots.mac_matrix([[1.0]], ["a", "b"], ["c"])


def test_the_cost_history_survives_an_exact_fit(fit: Fit) -> None:
    for history in ([12.0, 3.0, 0.0], [0.0], [5.0], []):
        (trace,) = plots.cost_history(replace(fit, cost_history=np.array(history))).data
        assert list(trace.x) == list(range(1, len(history) + 1))
        np.testing.assert_array_equal(trace.y, [cost if cost > 0 else np.nan for cost in history])


def test_noise_around_half_a_turn_does_not_tear_the_phase() -> None:
    wobble = np.exp(1j * (np.pi + 0.05 * np.sin(np.arange(60))))
    measured = am.Frf(np.arange(1.0, 61.0), wobble[:, None, None], "accelerance", ("x",), ("x",))
    model = replace(measured, values=np.full((60, 1, 1), -1.0 - 1e-9j))
    traces = plots.frf_matrix({"measured": measured, "after": model}).data
    phases = [trace.y for trace in traces if trace.yaxis == "y2"]
    assert all(len(phase) == 60 for phase in phases)
    assert np.ptp(np.concatenate(phases)) < 6.0  # twice 0.05 rad


def test_a_phase_that_turns_on_and_on_stays_in_its_pane() -> None:
    turning = np.exp(-0.5j * np.arange(100.0))
    frf = am.Frf(np.arange(1.0, 101.0), turning[:, None, None], "mobility", ("x",), ("x",))
    phase = next(trace for trace in plots.frf_matrix({"a": frf}).data if trace.yaxis == "y2")
    kept = np.isfinite(phase.y)
    assert np.abs(phase.y[kept]).max() <= 225
    # One tear per turn and no other jump: 99 steps of 0.5 rad are 7.9 turns.
    assert 7 <= np.count_nonzero(~kept) <= 8
    np.testing.assert_allclose(np.exp(1j * np.radians(phase.y[kept])), turning, rtol=ROUNDING)


def test_responses_of_different_axes_are_not_drawn_over_each_other(fit: Fit) -> None:
    full, single = (measurement.frf for measurement in fit.measurements)
    with pytest.raises(FrfError, match="axes"):
        plots.frf_matrix({"measured": full, "after": single})
    with pytest.raises(FrfError):
        plots.frf_matrix({})


def test_a_single_line_is_drawn_as_a_dot(fit: Fit) -> None:
    line = fit.measurements[1].frf.band(10.0, 10.2)
    assert line.freq_hz.size == 1
    assert {trace.mode for trace in plots.frf_matrix({"measured": line}).data} == {"markers"}


def test_what_speaks_against_the_fit_stands_at_the_top(fit: Fit) -> None:
    doubtful = Page(render(replace(fit, doubts=("The model does not explain these data.",))))
    assert "The model does not explain these data." in doubtful.text
    assert "does not explain" not in Page(render(fit)).text
    assert doubtful.text.index("does not explain") < doubtful.text.index("Frequency responses")


@pytest.mark.parametrize("count", range(1, 7))
def test_a_matrix_of_any_width_is_drawn_within_the_picture(count: int) -> None:
    axes = ("x", "y", "z", "rx", "ry", "rz")[:count]
    frf = am.Frf(np.array([1.0, 2.0]), np.ones((2, 1, count), complex), "receptance", ("x",), axes)
    layout = plots.frf_matrix({"measured": frf}).to_dict()["layout"]
    ends = [end for name, axis in layout.items() if "axis" in name and "domain" in axis for end in axis["domain"]]
    assert len(ends) == 8 * count
    assert min(ends) >= 0
    assert max(ends) <= 1
