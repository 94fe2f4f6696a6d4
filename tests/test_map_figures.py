"""What figures of surveys promise: the survey's own numbers, one curve per mode and case, events where they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

import armonic as am
import modal_maps
from armonic import plots
from armonic.errors import SurveyError
from pages import HOSTILE

# Values are drawn as they are, or through one factor of 100 or 180/π.
ROUNDING = 1e-12
MODES = 7

DRAWN: dict[str, tuple[Callable[..., Any], float]] = {
    "natural_freq_hz": (plots.frequency_map, 1.0),
    "damping_ratio": (plots.damping_map, 100.0),
}


def curves(figure: Any) -> dict[str, Any]:
    """Traces of modes by name."""
    named = [trace for trace in figure.data if (trace.name or "").startswith("mode ")]
    found = {trace.name.replace("\N{NO-BREAK SPACE}", " "): trace for trace in named}
    return found


def events(figure: Any, name: str) -> set[tuple[int, float, float]]:
    """Mode, x and y of every mark of a kind that is not the key in the legend."""
    return {
        (int(mode), float(x), float(y))
        for trace in figure.data
        if trace.name == name and trace.customdata is not None
        for mode, x, y in zip(trace.customdata, trace.x, trace.y, strict=True)
    }


@pytest.mark.parametrize("variable", DRAWN)
def test_each_mode_has_one_curve_per_case_with_the_numbers_of_the_survey(variable: str) -> None:
    draw, factor = DRAWN[variable]
    ds = modal_maps.path()
    drawn = curves(draw(ds))
    assert len(drawn) == 2 * MODES
    for mode in range(1, MODES + 1):
        for mass in (0.0, 4.0):
            trace = drawn[f"mode {mode}, tool.mass = {mass:.0f} kg"]
            expected = factor * ds[variable].sel({"mode": mode, "tool.mass": mass}).values
            np.testing.assert_array_equal(trace.x, ds.posture)
            np.testing.assert_allclose(trace.y, expected, rtol=ROUNDING)
            assert trace.line.dash == {0.0: "solid", 4.0: "dash"}[mass]


def test_a_mode_keeps_its_colour_in_every_case_and_figure() -> None:
    ds = modal_maps.path()
    colours: dict[str, set[str]] = {}
    for draw, _ in DRAWN.values():
        for name, trace in curves(draw(ds)).items():
            colours.setdefault(name.split(",")[0], set()).add(trace.line.color)
    assert all(len(own) == 1 for own in colours.values())
    assert len(set().union(*colours.values())) == MODES


def test_modes_share_a_panel_where_their_bands_lie_close() -> None:
    # 5.5 to 7.6 Hz, 17 to 23 Hz, 51 to 65 Hz, 851 Hz.
    drawn = curves(plots.frequency_map(modal_maps.path(masses=())))
    panels = [drawn[f"mode {mode}"].yaxis for mode in range(1, MODES + 1)]
    assert panels[0] == panels[1] != panels[2] == panels[3] != panels[4] == panels[5] != panels[6]
    assert len(set(panels)) == 4
    damping = curves(plots.damping_map(modal_maps.path(masses=())))
    assert [damping[f"mode {mode}"].yaxis for mode in range(1, MODES + 1)] == panels


@pytest.mark.parametrize("draw", [plots.frequency_map, plots.damping_map, plots.campbell])
def test_every_curve_is_in_view_and_numbered_beside_its_end(draw: Callable[..., Any]) -> None:
    figure = draw(modal_maps.path(masses=()))
    layout = figure.layout
    for trace in curves(figure).values():
        axis = layout[trace.yaxis.replace("y", "yaxis")]
        low, high = (10**end for end in axis.range) if axis.type == "log" else axis.range
        assert low < trace.y.min() <= trace.y.max() < high
        numbers = [a for a in layout.annotations if a.text == trace.name.removeprefix("mode ")]
        (label,) = (a for a in numbers if a.yref == f"{trace.yaxis} domain")
        place = np.interp(trace.y[-1], [low, high], [0, 1]) if axis.type != "log" else None
        if place is not None:
            assert label.y == pytest.approx(place, abs=0.1)
    domains = [end for name in layout.to_plotly_json() if "axis" in name for end in layout[name].domain or ()]
    assert min(domains) >= 0
    assert max(domains) <= 1


def test_a_nearly_constant_mode_is_drawn_flat() -> None:
    figure = plots.frequency_map(modal_maps.path(masses=()))
    (low, high) = figure.layout[curves(figure)["mode 7"].yaxis.replace("y", "yaxis")].range
    # Mode 7 moves by 0.4 of 850 Hz, which fills less than a twentieth of one per cent.
    assert high - low > 8


@pytest.mark.parametrize("variable", DRAWN)
def test_crossings_and_veerings_are_marked_where_the_survey_flags_them(variable: str) -> None:
    draw, factor = DRAWN[variable]
    ds = modal_maps.path(41)
    figure = draw(ds)
    for code, name, modes, at in ((1, "crossing", (3, 4), 10), (2, "veering", (5, 6), 30)):
        flagged = {(int(k) + 1, int(place)) for _, place, k in np.argwhere(ds.event.values == code)}
        assert flagged == {(mode, at) for mode in modes}
        values = factor * ds[variable].sel(mode=list(modes)).isel(posture=at).values
        expected = {(mode, float(at), values[case, k]) for k, mode in enumerate(modes) for case in (0, 1)}
        assert events(figure, name) == expected
    assert [trace.name for trace in figure.data if trace.showlegend][-2:] == ["crossing", "veering"]
    assert not events(draw(ds.assign(event=xr.zeros_like(ds.event))), "crossing")


@pytest.mark.parametrize("count", [2000, 2001, 5000, 123_457])
def test_long_curves_are_thinned_and_keep_their_extremes_and_ends(count: int) -> None:
    ds = modal_maps.path(count, masses=())
    f = ds.natural_freq_hz.values.copy()
    f[count // 3, 0], f[count // 2, 1] = 3.0, 9.0  # spikes of one posture
    ds["natural_freq_hz"] = (("posture", "mode"), f)
    figure = plots.frequency_map(ds)
    for name, trace in curves(figure).items():
        own = f[:, int(name.removeprefix("mode ")) - 1]
        at = trace.x.astype(int)
        assert len(at) <= 2000
        np.testing.assert_array_equal(trace.y, own[at])
        assert (at[0], at[-1]) == (0, count - 1)
        assert (np.diff(at) >= 0).all()
        assert (trace.y.min(), trace.y.max()) == (own.min(), own.max())
    said = any(f"of {count} points" in annotation.text for annotation in figure.layout.annotations)
    assert said == (count > 2000)
    assert len(events(figure, "veering")) == 2


def test_of_many_events_some_are_marked_and_the_figure_says_so() -> None:
    ds = modal_maps.path(3000, masses=())
    ds["event"] = xr.full_like(ds.event, 1)
    figure = plots.frequency_map(ds)
    assert 100 < len(events(figure, "crossing")) <= 400
    assert any(f"of {3000 * MODES} marks of crossing" in a.text for a in figure.layout.annotations)


def test_of_many_cases_four_are_drawn_and_the_figure_says_so() -> None:
    figure = plots.frequency_map(modal_maps.path(masses=np.linspace(0, 8, 9).tolist()))
    assert len(curves(figure)) == 4 * MODES
    assert {trace.line.dash for trace in curves(figure).values()} == {"solid", "dash", "dot", "dashdot"}
    assert any("4 of 9 cases" in annotation.text for annotation in figure.layout.annotations)


def test_unstable_stretches_are_shaded() -> None:
    ds = modal_maps.path()
    ds["stability"].loc[{"tool.mass": 4.0, "posture": slice(10, 13)}] = -1
    shapes = plots.damping_map(ds).layout.shapes
    assert {(shape.x0, shape.x1) for shape in shapes} == {(9.5, 13.5)}
    assert len(shapes) == 4  # one per panel
    assert not plots.damping_map(modal_maps.path()).layout.shapes


def test_chosen_modes_alone_are_drawn() -> None:
    assert sorted(curves(plots.frequency_map(modal_maps.path(masses=()), modes=[6, 2]))) == ["mode 2", "mode 6"]


def test_a_sweep_has_frequency_beside_damping_over_its_parameter() -> None:
    ds = modal_maps.sweep()
    figure = plots.campbell(ds, modes=[1, 2])
    by_axis = {(trace.name, trace.yaxis): trace for trace in figure.data if trace.name}
    assert len(by_axis) == 4
    for mode in (1, 2):
        frequency, damping = by_axis[f"mode {mode}", "y"], by_axis[f"mode {mode}", "y2"]
        np.testing.assert_array_equal(frequency.x, ds["control.kp"])
        np.testing.assert_array_equal(frequency.y, ds.natural_freq_hz.sel(mode=mode))
        np.testing.assert_allclose(damping.y, 100 * ds.damping_ratio.sel(mode=mode), rtol=ROUNDING)
    title = figure.layout.xaxis.title.text
    assert title.startswith("control.kp, N·m/rad")
    assert "control.kd from 19.01 to 52.05 N·m·s/rad" in title  # 0.425 √2000 and √15000
    marked = plots.campbell(ds)
    assert {mode for mode, _, _ in events(marked, "crossing")} == {3, 4}
    assert {mode for mode, _, _ in events(marked, "veering")} == {5, 6}


def test_the_faster_of_two_real_poles_is_dotted() -> None:
    ds = modal_maps.sweep(11).sel(mode=[1])
    ds["pole"].values[5:, 0], ds["partner"].values[5:, 0] = -20.0, -80.0
    ds["natural_freq_hz"].values[5:, 0] = 20 / (2 * np.pi)
    figure = plots.campbell(ds)
    (faster,) = (trace for trace in figure.data if "faster" in (trace.name or ""))
    assert faster.line.dash == "dot"
    np.testing.assert_allclose(faster.y[5:], 80 / (2 * np.pi), rtol=ROUNDING)
    assert np.isnan(faster.y[:5]).all()
    assert not any("faster" in (trace.name or "") for trace in plots.campbell(modal_maps.sweep()).data)


def test_the_gain_sweep_of_scompi_draws_the_printed_ends_of_figure_5() -> None:
    kp = np.linspace(2000, 15000, 27)
    ds = am.survey(am.load("scompi"), "c1", sweep={"control.kp": kp, "control.kd": 0.425 * np.sqrt(kp)})
    traces = [trace for trace in plots.campbell(ds, modes=[1, 2]).data if trace.name == "mode 1"]
    frequency, damping = (np.asarray(trace.y) for trace in traces)
    # Do et al. 2022, section 4.2, to its last printed digit.
    np.testing.assert_allclose(frequency[[0, -1]], [2.39, 6.51], atol=0.006)
    np.testing.assert_allclose(damping[[0, -1]], [9.44, 7.85], atol=0.01)


def test_a_heat_map_holds_the_slice_with_angles_in_degrees() -> None:
    ds = modal_maps.grid((21, 11))
    heat, lines = plots.heat_map(ds, 5).data[:2]
    assert (heat.type, lines.type) == ("heatmap", "contour")
    np.testing.assert_allclose(heat.x, np.degrees(ds["one.z"]), rtol=ROUNDING)
    np.testing.assert_allclose(heat.y, np.degrees(ds["two.z"]), rtol=ROUNDING)
    np.testing.assert_array_equal(heat.z, ds.natural_freq_hz.sel(mode=5).values.T)
    np.testing.assert_array_equal(lines.z, heat.z)
    turned = plots.heat_map(ds, 5, x="two.z", variable="damping_ratio").data[0]
    np.testing.assert_allclose(turned.z, 100 * ds.damping_ratio.sel(mode=5).values, rtol=ROUNDING)
    np.testing.assert_allclose(turned.y, np.degrees(ds["one.z"]), rtol=ROUNDING)


def test_a_heat_map_marks_where_modes_meet() -> None:
    ds = modal_maps.grid((21, 21))
    dots = {trace.name: trace for trace in plots.heat_map(ds, 5).data if trace.type == "scatter"}
    assert set(dots) == {"veering"}
    rows, columns = np.nonzero(ds.event.sel(mode=5).values.T)
    assert rows.size > 5
    np.testing.assert_allclose(dots["veering"].x, np.degrees(ds["one.z"].values[columns]), rtol=ROUNDING)
    np.testing.assert_allclose(dots["veering"].y, np.degrees(ds["two.z"].values[rows]), rtol=ROUNDING)


def test_a_large_heat_map_is_thinned_and_says_so() -> None:
    ds = modal_maps.grid((900, 40))
    figure = plots.heat_map(ds, 1)
    heat = figure.data[0]
    assert heat.z.shape == (40, 250)
    np.testing.assert_allclose([heat.x[0], heat.x[-1]], np.degrees([-0.5, 0.5]), rtol=ROUNDING)
    assert figure.layout.xaxis.title.text == "one.z, ° (250 of 900 drawn)"
    assert figure.layout.yaxis.title.text == "two.z, °"


def test_a_slice_of_three_joints_is_drawn_and_the_whole_refused() -> None:
    ds = modal_maps.grid((6, 5, 4))
    heat = plots.heat_map(ds.isel({"three.z": 2}), 1).data[0]
    np.testing.assert_array_equal(heat.z, ds.natural_freq_hz.values[:, :, 2, 0].T)
    with pytest.raises(SurveyError, match=r"three\.z \(4\).*a slice over two.*ds\.isel\(\{'three\.z': 2\}\)"):
        plots.heat_map(ds, 1)
    with pytest.raises(SurveyError, match=r"ds\.isel\(\{'two\.z': 2\}\)"):
        plots.heat_map(ds, 1, x="one.z", y="three.z")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mode": 8}, "mode 8.*from 1 to 7"),
        ({"mode": 1, "x": "posture"}, "posture.*one.z, two.z"),
        ({"mode": 1, "x": "one.z", "y": "one.z"}, "two different"),
        ({"mode": 1, "variable": "pole"}, "natural_freq_hz"),
        ({"mode": 1, "variable": "speed"}, "natural_freq_hz"),
    ],
)
def test_a_heat_map_refuses_what_is_not_there(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(SurveyError, match=words):
        plots.heat_map(modal_maps.grid(), **arguments)


def test_figures_refuse_surveys_of_other_dims() -> None:
    with pytest.raises(SurveyError, match="frequency_map"):
        plots.heat_map(modal_maps.sweep(), 1)
    for draw in (plots.frequency_map, plots.damping_map, plots.campbell):
        with pytest.raises(SurveyError, match="heat_map"):
            draw(modal_maps.grid())
        with pytest.raises(SurveyError, match="mode 9"):
            draw(modal_maps.path(), modes=[1, 9])
        with pytest.raises(SurveyError, match="mode numbers"):
            draw(modal_maps.path(), modes=[])
        with pytest.raises(SurveyError, match=r"ds\.isel\(posture=\[0\]\)"):
            draw(modal_maps.path(masses=()).isel(posture=0))
    with pytest.raises(SurveyError, match="over postures"):
        plots.sample_map(modal_maps.grid())
    with pytest.raises(SurveyError, match="no joint that moves"):
        plots.sample_map(modal_maps.sample().drop_vars(["one.z", "two.z"]))


@pytest.mark.parametrize("thing", [None, 3, [1.0], xr.Dataset(), xr.Dataset({"natural_freq_hz": ("posture", [1.0])})])
def test_what_is_no_survey_is_refused(thing: Any) -> None:
    for draw in (plots.frequency_map, plots.campbell, plots.sample_map, lambda ds: plots.heat_map(ds, 1)):
        with pytest.raises(SurveyError, match="a dataset from"):
            draw(thing)


def test_a_sample_has_a_dot_per_posture_over_each_joint() -> None:
    ds = modal_maps.sample()
    figure = plots.sample_map(ds)
    assert len(figure.data) == 2 * MODES
    columns: dict[str, list[Any]] = {}
    for trace in figure.data:
        columns.setdefault(trace.name, []).append(trace)
    for mode in range(1, MODES + 1):
        for joint, trace in zip(("one.z", "two.z"), columns[f"mode {mode}"], strict=True):
            np.testing.assert_allclose(trace.x, np.degrees(ds[joint]), rtol=ROUNDING)
            np.testing.assert_array_equal(trace.y, ds.natural_freq_hz.sel(mode=mode))
    assert any("64 postures" in annotation.text for annotation in figure.layout.annotations)


def test_a_large_sample_is_thinned_and_says_so() -> None:
    figure = plots.sample_map(modal_maps.sample(5000))
    assert sum(len(trace.x) for trace in figure.data) <= 12_000
    assert any("of 5000 postures drawn" in annotation.text for annotation in figure.layout.annotations)


def test_names_from_files_stay_text() -> None:
    swept = modal_maps.path()
    swept = swept.rename({"tool.mass": f"links.{HOSTILE}.mass", "one.z": f"{HOSTILE}.z"})
    gain = modal_maps.sweep().rename({"control.kp": f"control.kp.{HOSTILE}", "control.kd": f"control.kd.{HOSTILE}"})
    grid = modal_maps.grid().rename({"one.z": f"{HOSTILE}.z"})
    sample = modal_maps.sample().rename({"one.z": f"{HOSTILE}.z"})
    for figure in (
        plots.frequency_map(swept),
        plots.campbell(gain),
        plots.heat_map(grid, 1),
        plots.sample_map(sample),
    ):
        text = str(figure.to_dict())
        assert "<img" not in text
        assert "<script" not in text
        assert "&lt;" in text
