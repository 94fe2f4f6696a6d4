"""What report and terminal show of what the data determine: bands, directions, correlations, profiles, the record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic import cli, plots
from armonic.report import render
from command_line import MEASURED, START, WIDTH, Run
from pages import Page, figures, numbers

FREQ_HZ = np.linspace(5.0, 25.0, 41)
AXES = ("x", "z")


@pytest.fixture(scope="module")
def fit() -> am.Fit:
    """Four noisy responses of the three-axis robot that leave one damping all but open."""
    robot = am.load("huynh_3r")
    H = am.frf(robot, "milling", FREQ_HZ, frame="sensor", outputs=AXES, inputs=AXES)
    real, imaginary = np.random.default_rng(1).standard_normal((2, *H.values.shape))
    G = replace(H, values=H.values * np.exp(0.3 * (real + 1j * imaginary)))
    start = robot.with_values({path: 1.2 * value for path, value in robot.parameters().items()})
    return am.update(start, am.Measurement(G, "milling"), seed=7)


@pytest.fixture(scope="module")
def page(fit: am.Fit) -> Page:
    return Page(render(fit))


def rows_of(page: Page, width: int) -> list[list[str]]:
    return [row for row in page.rows if len(row) == width]


def test_the_bands_in_the_report_go_once_around_magnitude_and_phase(fit: am.Fit, page: Page) -> None:
    bands = am.frf_bands(fit, "milling", FREQ_HZ, outputs=AXES, inputs=AXES)
    drawn = {trace["yaxis"]: trace for trace in figures(page)[0] if trace["name"] == plots.BAND_NAME}
    after = {trace["yaxis"]: trace for trace in figures(page)[0] if trace["name"] == "after"}
    assert len(drawn) == 8
    for i in range(2):
        for j in range(2):
            pane = 2 * (2 * i + j) + 1
            magnitude = drawn[f"y{pane}" if pane > 1 else "y"]
            np.testing.assert_array_equal(numbers(magnitude["x"]), [*FREQ_HZ, *FREQ_HZ[::-1]])
            outline = [*bands.low[:, i, j], *bands.high[::-1, i, j]]
            np.testing.assert_allclose(numbers(magnitude["y"]), outline, rtol=1e-12)
            # The phase is torn into pieces; each goes there below the curve and back above it.
            x, y = (numbers(drawn[f"y{pane + 1}"][axis]) for axis in "xy")
            middle = {f: np.sort(y[x == f]) for f in FREQ_HZ}
            curve = dict(zip(*(numbers(after[f"y{pane + 1}"][axis]) for axis in "xy"), strict=True))
            for f, half in zip(FREQ_HZ, np.degrees(bands.phase_deviation[:, i, j]), strict=True):
                np.testing.assert_allclose(middle[f], [curve[f] - half, curve[f] + half], rtol=1e-9, atol=1e-9)


def test_bands_lie_under_the_curves_and_stand_in_the_legend_once(page: Page) -> None:
    traces = figures(page)[0]
    names = [trace["name"] for trace in traces]
    assert set(names[:8]) == {plots.BAND_NAME}
    assert plots.BAND_NAME not in names[8:]
    assert sum(trace.get("showlegend", True) for trace in traces[:8]) == 1


def test_the_report_says_in_words_what_is_open_and_what_is_known_best(fit: am.Fit, page: Page) -> None:
    found = am.directions(fit)
    words = " ".join(page.text.split())
    assert "What is open, least known first:" in words
    assert found[-1].words in words
    assert f"Best known: {found[0].words}." in words


def test_a_direction_is_drawn_with_its_reach_and_the_weights_of_all_parameters(fit: am.Fit) -> None:
    found = am.directions(fit)
    figure = plots.principal_directions(fit)
    _, dots, bars = figure.data
    *closed, last = dots.x
    np.testing.assert_allclose(closed, np.expm1([1.959964 * d.deviation for d in found[:-1]]), rtol=1e-6)
    assert last > 999  # an arrow at the edge
    assert list(figure.layout.xaxis2.ticktext)[:3] == [
        "carousel.z stiffness",
        "link_arm.z stiffness",
        "arm.z stiffness",
    ]
    count = len(found)
    heights = -np.reshape(bars.y, (count, count)) / 0.46
    order = [p.path for p in fit.coordinates]
    ordered = sorted(range(count), key=lambda i: (order[i].endswith("damping"), i))
    expected = np.array([d.weights[ordered] for d in found])
    np.testing.assert_allclose(heights, np.where(np.abs(expected) < 0.04, 0, expected), rtol=1e-12)
    np.testing.assert_array_equal(np.reshape(bars.base, (count, count))[:, 0], np.arange(count))


def test_directions_beyond_the_scale_end_in_an_arrow(fit: am.Fit) -> None:
    blind = replace(fit, information=np.diag([1e4] * 5 + [0.0]))
    figure = plots.principal_directions(blind)
    assert figure.data[1].marker.symbol[-1] == "triangle-right"
    assert figure.layout.yaxis.ticktext[-1] == "open"
    low, high = figure.layout.xaxis.range
    assert all(low < np.log10(x) < high for x in figure.data[1].x)


def test_correlations_are_drawn_by_quantity_and_open_ones_left_out(fit: am.Fit) -> None:
    covariance = fit.covariance.copy()
    covariance[1, :] = covariance[:, 1] = 0.0
    covariance[1, 1] = np.inf  # carousel.z damping
    figure = plots.correlation_matrix(replace(fit, covariance=covariance))
    (heat,) = figure.data
    labels = list(figure.layout.yaxis.ticktext)
    first, second = labels.index("carousel.z stiffness"), labels.index("link_arm.z stiffness")
    expected = fit.covariance[0, 2] / np.sqrt(fit.covariance[0, 0] * fit.covariance[2, 2])
    assert heat.z[first][second] == pytest.approx(expected)
    assert (heat.zmin, heat.zmax) == (-1, 1)
    blind = labels.index("carousel.z damping")
    assert np.isnan(np.delete(np.array(heat.z)[blind], blind)).all()
    assert heat.text[blind][first] == ""


def test_frac_of_every_response_stands_before_and_after(fit: am.Fit, page: Page) -> None:
    before, after = (am.frac(fit.measurements[0].frf, side[0]) for side in (fit.frf_before, fit.frf_after))
    found = [row for row in page.rows if len(row) == 2 and all("→" in cell for cell in row)]
    assert found == [[f"{before[a, b]:.3f} → {after[a, b]:.3f}" for b in range(2)] for a in range(2)]
    assert (after > before).all()


def test_modes_after_stand_with_half_their_intervals(fit: am.Fit, page: Page) -> None:
    found = am.modal_intervals(fit, "milling")
    rows = [row for row in rows_of(page, 9) if row[5] != "–"]
    assert len(rows) == len(found.modes) == 3
    for i, row in enumerate(rows):
        spread = float(row[5].split("± ")[1].split()[0]) / 100
        low, high = found.natural_freq_hz[i]
        assert spread == pytest.approx(np.sqrt(high / low) - 1, rel=0.05)  # two digits
        assert "±" in row[7] or "×/÷" in row[7]
        assert "±" not in row[0]


def test_the_run_s_record_is_in_the_report(fit: am.Fit, page: Page) -> None:
    rows = dict(row for row in page.rows if len(row) == 2 and "→" not in row[0])
    assert rows["seed"] == "7"
    assert rows["method"] == "continuation"
    assert rows["fingerprint"] == fit.record.fingerprint
    assert fit.record.robot_sha256 in rows["robot"]
    assert rows["measurement milling, sensor"] == f"SHA-256 {fit.record.measurements[0][1]}"
    assert f"NumPy {np.__version__}" in rows["versions"]


def test_profiles_are_shown_on_request_with_both_intervals(fit: am.Fit, page: Page) -> None:
    path = "links.arm.elasticity.z.damping"
    profile = am.profile(fit, path)
    shown = Page(render(fit, profiles=[profile]))
    assert "Profile likelihood" in shown.text
    assert "Profile likelihood" not in page.text
    (trace,) = plots.profile_curve(profile).data
    np.testing.assert_array_equal(trace.x, profile.values)
    np.testing.assert_array_equal(trace.y, profile.rise)
    assert len(figures(shown)) == len(figures(page)) + 1


def test_stages_with_a_cost_of_their_own_are_parted(fit: am.Fit) -> None:
    figure = plots.cost_history(fit)
    ends = np.cumsum([len(stage.history) for stage in fit.stages])[:-1]
    assert [shape.x0 for shape in figure.layout.shapes] == [end + 0.5 for end in ends]
    rungs = {f"σ {stage.sigma:.2g}" for stage in fit.stages if stage.sigma > 0}
    named = {note.text for note in figure.layout.annotations} & rungs
    assert named


def test_a_fit_to_modes_has_a_report_without_responses() -> None:
    robot = am.load("huynh_3r")
    modes = am.modes(robot, "milling")
    fit = am.update(robot, am.ModalMeasurement("milling", 1.01 * modes.natural_freq_hz, modes.damping_ratio))
    text = Page(render(fit)).text
    assert "Frequency responses" not in text
    assert "times the deviations that were stated" in text
    assert "What the data determine together" in text


def test_of_one_parameter_nothing_is_said_about_combinations(fit: am.Fit) -> None:
    one = am.update(fit.robot, fit.measurements, parameters="links.arm.elasticity.z.stiffness")
    assert "What the data determine together" not in Page(render(one)).text


def test_the_terminal_names_open_directions_and_half_intervals_of_modes_in_80_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    run = Run(cli.main(["update", START, MEASURED, "-o", str(tmp_path / "a.yaml")]), *capsys.readouterr())
    assert run.code == 0
    assert max(map(len, run.out.splitlines()[:-1])) <= WIDTH  # the last names a file
    assert "What the data leave open together" in run.words
    assert "link_arm.x damping is open" in run.words
    assert "± is half the 95 % interval" in run.words
    assert "* bounds of parameters hold it, not data." in run.words
    words = ["update", START, MEASURED, "-o", str(tmp_path / "b.yaml"), "--json"]
    data = Run(cli.main(words), *capsys.readouterr()).json
    assert len(data["directions"]) == 18
    assert data["directions"][0]["deviation"] < 1e-3
    assert set(data["directions"][0]["weights"]) == {p["path"] for p in data["parameters"]}
    (posture,) = data["postures"]
    for mode, interval in zip(posture["after"], posture["after_intervals"], strict=True):
        low, high = interval["natural_freq_hz"]
        assert low <= mode["natural_freq_hz"] <= high
