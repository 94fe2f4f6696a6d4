"""What report, figures and terminal show of stages, starts, measured modes, ties, laws and numbers without a sign."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

import armonic as am
from armonic import plots
from armonic.cli.results import fit_data, fit_tables
from armonic.cli.terminal import plain
from armonic.report import render
from armonic.updating.stages import StageEnd
from pages import Page, figures

FREQ_HZ = np.linspace(5.0, 25.0, 41)
ELSEWHERE = [0.2, 1.0, -1.4]
STIFFNESS, DAMPING = "links.arm.elasticity.z.stiffness", "links.arm.elasticity.z.damping"
TIED = ["links.carousel.elasticity.z.damping", "links.link_arm.elasticity.z.damping"]


@pytest.fixture(scope="module")
def robot() -> am.Robot:
    return am.load("huynh_3r")


@pytest.fixture(scope="module")
def start(robot: am.Robot) -> am.Robot:
    return robot.with_values({path: 1.2 * value for path, value in robot.parameters().items()})


def noisy(robot: am.Robot, posture: str | list[float] = "milling") -> am.Measurement:
    H = am.frf(robot, posture, FREQ_HZ, frame="sensor")
    real, imaginary = np.random.default_rng(1).standard_normal((2, *H.values.shape))
    return am.Measurement(replace(H, values=H.values * np.exp(0.02 * (real + 1j * imaginary))), posture)


@pytest.fixture(scope="module")
def signed(robot: am.Robot, start: am.Robot) -> am.Fit:
    """A fit of stiffness, damping and a centre of mass, of which two coordinates are nearly zero."""
    return am.update(start, noisy(robot), parameters=["elasticity", "links.arm.mass", "links.arm.com.*"])


@pytest.fixture(scope="module")
def tied(robot: am.Robot, start: am.Robot) -> am.Fit:
    return am.update(start, noisy(robot), ties=[TIED], starts=3, seed=3)


@pytest.fixture(scope="module")
def lawful(robot: am.Robot, start: am.Robot) -> am.Fit:
    measured = [noisy(robot), noisy(robot, ELSEWHERE)]
    return am.update(start, measured, laws={STIFFNESS: am.Law("torque")})


@pytest.fixture(scope="module")
def modal(robot: am.Robot, start: am.Robot) -> am.Fit:
    """To the modes of the robot itself, in another order than the model's, of which one frequency is 1 % too high."""
    found = am.modes(robot, "milling")
    order, factor = [2, 0, 1], np.array([1.01, 1.0, 1.0])
    measured = am.ModalMeasurement("milling", found.natural_freq_hz[order] * factor, found.damping_ratio[order])
    return am.update(start, measured)


def words(page: Page) -> str:
    return " ".join(page.text.split())


def row_of(page: Page, path: str) -> list[str]:
    return next(row for row in page.rows if row and row[0].startswith(path))


def printed(fit: am.Fit) -> str:
    console = Console(width=80, force_terminal=False, color_system=None)
    with console.capture() as capture:
        for part in fit_tables(fit, fit.postures):
            console.print(part, markup=False, highlight=False)
    return capture.get()


def test_every_stage_is_a_curve_of_its_own_under_its_name(tied: am.Fit) -> None:
    drawn: dict[int, tuple[float, str, str]] = {}
    for trace in plots.cost_history(tied).data:
        for x, y, name in zip(trace.x, trace.y, trace.customdata, strict=True):
            if math.isfinite(x):
                drawn[int(x)] = (y, name, trace.line.color)
    expected = [(float(cost), stage.name) for stage in tied.stages for cost in stage.history]
    assert [drawn[n + 1][:2] for n in range(len(expected))] == expected
    own, asked = ({colour for _, name, colour in drawn.values() if ("σ" in name) == rung} for rung in (True, False))
    assert len(own) == len(asked) == 1
    assert own != asked
    gaps = sum(math.isnan(x) for trace in plots.cost_history(tied).data for x in trace.x)
    assert gaps == len(tied.stages) - 2  # two traces, and none after the last stage of each


def test_a_history_of_very_many_evaluations_is_drawn_by_where_it_fell(tied: am.Fit) -> None:
    rng = np.random.default_rng(5)
    falls = np.sort(rng.choice(np.arange(1, 100_000), 700, replace=False))
    history = np.ones(100_000)
    history[falls] = 0.99
    history = np.cumprod(history)
    halves = history[:60_000], history[60_000:]
    stages = tuple(StageEnd(name, 0.0, part) for name, part in zip(("genetic", "simplex"), halves, strict=True))
    (trace,) = plots.cost_history(replace(tied, cost_history=history, stages=stages)).data
    x, y = (np.array(side)[np.isfinite(trace.x)] for side in (trace.x, trace.y))
    assert len(x) < 1000
    # Steps through these points are the history itself, evaluation by evaluation.
    at = np.searchsorted(x, np.arange(1, 100_001), side="right") - 1
    np.testing.assert_array_equal(y[at], history)


def test_even_a_history_that_falls_all_the_time_is_drawn_by_some_thousand_points(tied: am.Fit) -> None:
    history = np.geomspace(1e6, 1.0, 100_000)
    figure = plots.cost_history(replace(tied, cost_history=history, stages=(StageEnd("cost", 0.0, history),)))
    (trace,) = figure.data
    assert len(trace.x) <= 4000
    assert (trace.x[0], trace.y[0], trace.x[-1], trace.y[-1]) == (1, 1e6, 100_000, 1.0)


def test_numbers_that_may_be_negative_stand_between_their_bounds(signed: am.Fit) -> None:
    chosen = [p for p in signed.parameters if p.path.startswith("links.arm.com")]
    figure = plots.bounded_intervals(signed)
    assert list(figure.layout.yaxis.ticktext) == ["arm.com.x", "arm.com.y", "arm.com.z"]
    dots = {trace.y[k]: (trace, k) for trace in figure.data if trace.error_x.array for k in range(len(trace.y))}
    for row, p in enumerate(chosen):
        trace, k = dots[row]
        width = p.upper - p.lower
        reach = [trace.x[k] - trace.error_x.arrayminus[k], trace.x[k] + trace.error_x.array[k]]
        assert trace.name == p.verdict
        np.testing.assert_allclose(p.lower + width * np.array(trace.x[k]), p.value, rtol=1e-9)
        np.testing.assert_allclose(p.lower + width * np.array(reach), p.interval, rtol=1e-9)
    assert not any("com" in label for label in plots.parameter_intervals(signed).layout.yaxis.ticktext)


def test_an_open_interval_of_such_a_number_ends_in_arrows(signed: am.Fit) -> None:
    blind = tuple(
        replace(p, interval=(-np.inf, np.inf), verdict="not identifiable") if p.scale == "linear" else p
        for p in signed.parameters
    )
    figure = plots.bounded_intervals(replace(signed, parameters=blind))
    arrows = [trace.marker.symbol for trace in figure.data if "triangle" in str(trace.marker.symbol)]
    assert arrows == ["triangle-left", "triangle-right"]
    low, high = figure.layout.xaxis.range
    assert all(low < x < high for trace in figure.data for x in trace.x if math.isfinite(x))
    assert [note.text for note in figure.layout.annotations] == ["open"] * 3


def test_a_profile_of_such_a_number_has_ends_below_zero(signed: am.Fit) -> None:
    path = "links.arm.com.z"
    found = am.profile(signed, path)
    assert found.interval[1] < 0
    told = words(Page(render(signed, profiles=[found]))).partition(f"{path}: ")[2]
    assert told.startswith("95 % interval -0.0")
    assert "open" not in told[:90]


def test_labels_of_three_panels_side_by_side_keep_apart(signed: am.Fit) -> None:
    layout = plots.parameter_intervals(signed).layout
    for axis in (layout.xaxis, layout.xaxis2, layout.xaxis3):
        shown = [math.log10(tick) for tick in axis.tickvals if axis.range[0] < math.log10(tick) < axis.range[1]]
        pixels = 1080 * (axis.domain[1] - axis.domain[0]) * 0.9 / (axis.range[1] - axis.range[0])
        assert len(shown) > 1
        assert pixels * np.diff(shown).min() > 45  # "× 0.001" at eleven pixels


def test_the_report_has_both_figures_of_intervals(signed: am.Fit, tied: am.Fit) -> None:
    both, one = (Page(render(fit)) for fit in (signed, tied))
    assert len(figures(both)) == len(figures(one)) + 1
    assert "may be zero or negative" in words(both)
    assert "may be zero or negative" not in words(one)


def test_the_report_tells_how_every_start_ended(tied: am.Fit, signed: am.Fit) -> None:
    ends = (10.0, 10.05, np.inf)
    told = words(Page(render(replace(tied, starts=ends))))
    assert "2 of 3 starts ended within 1 % of the lowest cost. Final costs, in order: 10.00, 10.05, no end." in told
    many = replace(tied, starts=(*[1.0] * 60, *[5.0] * 40))
    assert "60 of 100 starts ended within 1 % of the lowest cost, 1.000; the median is 1.000." in words(
        Page(render(many))
    )
    assert "starts ended" not in words(Page(render(replace(signed, starts=(1.0,)))))


def test_measured_modes_stand_beside_those_of_the_model_before_and_after(
    modal: am.Fit, robot: am.Robot, start: am.Robot
) -> None:
    page = Page(render(modal))
    rows = [row for row in page.rows if len(row) == 9 and "±" in row[1]]
    true, before, after = (am.modes(model, "milling") for model in (robot, start, modal.robot))
    assert len(rows) == 3
    for number, (row, mode) in enumerate(zip(rows, (2, 0, 1), strict=True), start=1):
        measured = true.natural_freq_hz[mode] * (1.01 if mode == 2 else 1.0)
        assert row[0] == str(number)
        assert row[1] == f"{measured:.2f} ± 0.50 %"
        assert row[2:4] == [f"{side.natural_freq_hz[mode]:.2f}" for side in (before, after)]
        off = 100 * (after.natural_freq_hz[mode] / measured - 1)
        assert float(row[4].removesuffix(" %").replace("−", "-")) == pytest.approx(off, abs=0.006)
        assert row[5] == f"{100 * true.damping_ratio[mode]:.2f} ± 10 %"
        assert row[6:8] == [f"{100 * side.damping_ratio[mode]:.2f}" for side in (before, after)]


def test_a_fit_of_responses_has_no_table_of_measured_modes(tied: am.Fit, modal: am.Fit) -> None:
    assert "Measured modes" in words(Page(render(modal)))
    assert "Measured modes" not in words(Page(render(tied)))


def test_the_report_says_what_the_cost_is(tied: am.Fit, modal: am.Fit) -> None:
    assert "squared log differences between model and measurement" in words(Page(render(tied)))
    assert "over their stated deviations; the best so far" in words(Page(render(modal)))
    relative = replace(tied, task=replace(tied.task, relative=True))
    assert "squared relative differences" in words(Page(render(relative)))


def test_ties_and_laws_stand_in_the_parameter_table(tied: am.Fit, lawful: am.Fit) -> None:
    assert row_of(Page(render(tied)), TIED[0])[0] == f"{TIED[0]}tied to it: {TIED[1]}"
    page = Page(render(lawful))
    assert row_of(page, f"{STIFFNESS}where")[0] == f"{STIFFNESS}where the static torque on its joint is zero"
    slope = row_of(page, f"{STIFFNESS} per torque")
    assert slope[0].endswith("slope of the above over the static torque on its joint")
    assert slope[1] == "N·m/rad per N·m"


def test_the_terminal_names_ties_and_laws_in_80_columns(tied: am.Fit, lawful: am.Fit) -> None:
    for fit, told in (
        (tied, "carousel.z damping is tied to link_arm.z damping."),
        (lawful, "arm.z stiffness follows a law; the table has it where the static torque on its joint is zero."),
    ):
        out = printed(fit)
        assert told in " ".join(out.split())
        assert max(map(len, out.splitlines())) <= 80


def test_data_for_machines_hold_correlations_laws_ties_and_starts(tied: am.Fit, lawful: am.Fit) -> None:
    data = plain(fit_data(tied, tied.postures))
    spread = np.sqrt(np.diag(tied.covariance))
    np.testing.assert_allclose(data["correlation"], tied.covariance / np.outer(spread, spread), rtol=1e-12, atol=1e-12)
    assert data["starts"] == list(tied.starts)
    assert next(p["tied"] for p in data["parameters"] if p["path"] == TIED[0]) == TIED
    laws = {p["path"]: p["law"] for p in plain(fit_data(lawful, lawful.postures))["parameters"]}
    assert laws[STIFFNESS] == laws[f"{STIFFNESS} per torque"] == "torque"
    assert laws[DAMPING] is None


def test_what_the_data_leave_open_is_null_among_the_correlations(tied: am.Fit) -> None:
    covariance = tied.covariance.copy()
    covariance[0, :] = covariance[:, 0] = 0.0
    covariance[0, 0] = np.inf
    data = plain(fit_data(replace(tied, covariance=covariance), tied.postures))
    assert data["correlation"][0] == [1.0] + [None] * (len(tied.parameters) - 1)
