"""What the report of a survey promises: its ranges and events, figures by its dims, nothing from the network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import armonic as am
import modal_maps
from armonic import map_summary
from armonic.errors import DataFileError, SurveyError
from armonic.map_report import render, write_map_report
from armonic.map_summary import summarize
from pages import HOSTILE, Page, figures, numbers, outside

ROUNDING = 1e-12


def words(page: Page) -> str:
    return " ".join(page.text.split())


def rows(page: Page, cells: int) -> list[list[str]]:
    return [[cell.replace("\N{NO-BREAK SPACE}", " ") for cell in row] for row in page.rows if len(row) == cells]


def kinds(page: Page) -> list[str]:
    """What each figure is made of, by its first trace."""
    return [str(traces[0]["type"]) for traces in figures(page)]


@pytest.fixture(scope="module")
def arms() -> am.Robot:
    return am.Robot.from_yaml(modal_maps.ROBOT)


@pytest.fixture(scope="module")
def surveyed(arms: am.Robot) -> xr.Dataset:
    """The two arms along a path, for two masses of the second."""
    return am.survey(arms, np.linspace([0.0, 0.5], [1.0, 2.0], 21), sweep={"links.two.mass": [10.0, 14.0]})


def test_the_report_stands_alone(tmp_path: Path) -> None:
    html = am.write_map_report(modal_maps.path(), tmp_path / "m.html").read_text("utf-8")
    assert outside(html) == []
    assert [len(script) > 1_000_000 for script in Page(html).scripts].count(True) == 1


def test_ranges_of_every_mode_stand_with_their_places() -> None:
    page = Page(render(modal_maps.path(41)))
    table = rows(page, 9)
    assert [row[0] for row in table] == [str(mode) for mode in range(1, 8)]
    s = np.linspace(0, 1, 41)
    for mode in range(7):
        light, heavy = (modal_maps.natural_hz(s, mass)[:, mode] for mass in (0.0, 4.0))
        assert table[mode][1] == f"{min(light.min(), heavy.min()):.2f}"
        assert table[mode][3] == f"{max(light.max(), heavy.max()):.2f}"
    # 6.0 Hz less 8 % at the start with the tool; 7.0 % to 8.0 % along the path.
    assert table[0][1:3] == ["5.52", "posture 0, tool.mass = 4 kg"]
    assert (table[0][5], table[0][7:9]) == ("7.00", ["8.00", "posture 40, tool.mass = 0 kg"])
    assert "from 5.52 to 851.00 Hz" in words(page)
    assert "from 1.25 % to 80.0 %" in words(page)


def test_every_place_is_named_by_its_joints_in_degrees() -> None:
    first = rows(Page(render(modal_maps.grid((5, 4)))), 9)[0]
    assert first[2] == "one.z = −28.65°, two.z = −28.65°"  # 0.5 rad


def test_crossings_and_veerings_are_listed() -> None:
    page = Page(render(modal_maps.path(41, masses=())))
    assert rows(page, 4) == [
        ["crossing", "3 and 4", "20.00", "posture 10"],
        ["veering", "5 and 6", "60.00", "posture 30"],
    ]
    assert "1 crossing and 1 veering" in words(page)
    still = modal_maps.path()
    assert "No modes cross or veer." in words(Page(render(still.assign(event=xr.zeros_like(still.event)))))


def test_many_events_are_counted_by_the_modes_that_meet() -> None:
    page = Page(render(modal_maps.grid((41, 41))))
    found = rows(page, 4)
    assert [row[:2] for row in found] == [["crossing, 21 places", "3 and 4"], ["veering, 21 places", "5 and 6"]]
    assert found[0][3].startswith("first at one.z = −28.65°")
    assert "21 crossings and 21 veerings" in words(page)


def test_events_at_one_place_are_told_apart_by_frequency() -> None:
    ds = modal_maps.path(41, masses=())
    event = xr.zeros_like(ds.event)
    event[10, [2, 3, 4]] = 1  # 20, 20 and 57 Hz: the last one alone
    summary = summarize(ds.assign(event=event))
    assert {(found.modes, found.count) for found in summary.pairs} == {((3, 4), 1), ((5,), 1)}
    assert "5 and another" in [row[1] for row in rows(Page(render(ds.assign(event=event))), 4)]


def test_the_verdict_on_stability_is_said_and_instability_raises_an_alarm() -> None:
    def alarms(page: Page) -> int:
        return sum("alarm" in str(attributes.get("class")) for tag, attributes in page.tags if tag == "p")

    ds = modal_maps.path()
    page = Page(render(ds))
    assert "asymptotically stable everywhere" in words(page)
    assert alarms(page) == 0
    ds["stability"].values[1, 17:20] = -1
    page = Page(render(ds))
    assert "unstable at 3 of 100 places. First at posture 17, tool.mass = 4 kg." in words(page)
    assert alarms(page) == 1
    ds["stability"].values[1, 17:20] = 0
    page = Page(render(ds))
    assert "marginally stable at 3 of 100 places" in words(page)


def test_the_report_says_how_the_modes_were_computed() -> None:
    ds = modal_maps.path()
    ds["method"].values[0, :7] = 1
    ds["residual"].values[1, 3] = 0.25
    text = words(Page(render(ds)))
    assert "Of 100 places, 93 by continuation from a neighbour and 7 by the dense solver." in text
    assert "Residual: 0.25." in text


def test_real_poles_are_named() -> None:
    ds = modal_maps.path(masses=())
    ds["damped_freq_hz"].values[:, 6] = 0
    ds["damped_freq_hz"].values[:25, 0] = 0
    assert "real, so that nothing vibrates, in mode 1 (50 % of the places) and mode 7 (everywhere)" in words(
        Page(render(ds))
    )


@pytest.mark.parametrize(
    ("ds", "drawn"),
    [
        (modal_maps.path(masses=()), ["scatter3d", "scatter", "scatter"]),
        (modal_maps.path(), ["scatter3d", "scatter", "scatter"]),
        (modal_maps.path(masses=[0, 1, 2, 3, 4]), ["scatter3d", "scatter", "scatter", "scatter"]),
        (modal_maps.sweep(), ["scatter"]),
        (modal_maps.grid((9,)), ["scatter", "scatter"]),
        (modal_maps.grid((9, 8)), ["heatmap"] * 6),
        (modal_maps.grid((9, 8, 7)), ["heatmap"] * 6),
        (modal_maps.sample(), ["scatter"]),
        (modal_maps.path(1), ["scatter3d", "scatter", "scatter"]),
    ],
)
def test_figures_follow_the_dims(ds: xr.Dataset, drawn: list[str]) -> None:
    # The numbers are not those of the robot in the dataset, so no shapes are drawn.
    assert kinds(Page(render(ds))) == drawn


def test_frequencies_in_the_report_are_those_of_the_survey() -> None:
    ds = modal_maps.path(masses=())
    _, frequency, damping = figures(Page(render(ds)))
    for drawn, values in ((frequency, ds.natural_freq_hz), (damping, 100 * ds.damping_ratio)):
        traces = {trace["name"]: trace for trace in drawn if trace.get("name", "").startswith("mode ")}
        for mode in range(1, 8):
            np.testing.assert_allclose(numbers(traces[f"mode {mode}"]["y"]), values.sel(mode=mode), rtol=ROUNDING)


def test_a_slice_of_a_grid_lies_in_the_middle_and_the_report_says_where() -> None:
    ds = modal_maps.grid((9, 8, 7))
    page = Page(render(ds))
    assert "A slice at three.z = 0°." in words(page).replace("\N{NO-BREAK SPACE}", " ")
    z = figures(page)[0][0]["z"]
    middle = ds.natural_freq_hz.sel({"mode": 1}).isel({"three.z": 3}).values.T
    np.testing.assert_array_equal(numbers(z).reshape(middle.shape), middle)


def test_shapes_are_drawn_where_the_robot_has_the_modes_of_the_survey(surveyed: xr.Dataset, arms: am.Robot) -> None:
    page = Page(render(surveyed))
    assert kinds(page) == ["scatter3d", "scatter", "scatter", "scatterpolar"]
    assert "Mode shapes at posture 0, links.two.mass = 10 kg" in page.text.replace("\N{NO-BREAK SPACE}", " ")
    arrows = [t for t in figures(page)[3] if t.get("hoverinfo") != "skip"]
    shapes = am.modes(arms, [0.0, 0.5]).shapes
    for trace in arrows:
        mode, k = int(trace["subplot"].removeprefix("polar") or 1) - 1, ["one.z", "two.z"].index(trace["name"])
        assert trace["r"][1] == pytest.approx(abs(shapes[k, mode]) / np.abs(shapes[:, mode]).max(), rel=1e-9)
    wrong = surveyed.assign(pole=1.01 * surveyed.pole, partner=1.01 * surveyed.partner)
    assert "scatterpolar" not in kinds(Page(render(wrong)))


def test_shapes_of_a_sweep_are_those_of_its_first_and_last_robot(arms: am.Robot) -> None:
    ds = am.survey(arms, "start", sweep={"links.two.mass": np.linspace(10, 20, 6)})
    page = Page(render(ds))
    assert kinds(page) == ["scatter", "scatterpolar", "scatterpolar"]
    last = am.modes(arms.with_values({"links.two.mass": 20.0}), "start")
    assert f"{last.natural_freq_hz[0]:.2f} Hz" in json.dumps(Page(render(ds)).scripts[-1])


def test_modes_under_a_wrench_are_found_again(arms: am.Robot) -> None:
    load: dict[str, Any] = {"wrench": [0, 400, 0, 0, 0, 0], "frame": "tip", "wrench_axes": "frame"}
    ds = am.survey(arms, np.linspace([0.0, 0.5], [1.0, 2.0], 5), **load)
    assert "scatterpolar" in kinds(Page(render(ds)))


def test_another_robot_is_refused(surveyed: xr.Dataset, arms: am.Robot) -> None:
    render(surveyed, robot=arms)
    with pytest.raises(SurveyError, match="two arms"):
        render(surveyed, robot=arms.with_values({"links.two.mass": 11.0}))


def test_without_the_text_of_the_robot_what_needs_none_is_drawn() -> None:
    ds = modal_maps.path()
    for text in ("", "robot: [", "armonic: 1\nurdf: elsewhere.urdf\n"):
        page = Page(render(ds.assign_attrs(robot_file=text)))
        assert kinds(page) == ["scatter", "scatter"]
        assert "two arms" in page.text
    assert kinds(Page(render(ds.assign_attrs({}).drop_attrs()))) == ["scatter", "scatter"]


def test_where_the_map_is_from_stands_in_it() -> None:
    ds = modal_maps.path().assign_attrs(spec=json.dumps({"sweep": {"tool.mass": [0.0] * 40}, "modes": 7}))
    page = Page(render(ds, title="Cell 7"))
    assert modal_maps.ROBOT in page.text
    assert ["sweep", '{"tool.mass": [0.0, 0.0, …, 0.0] (40 values)}'] in page.rows
    assert ["modes", "7"] in page.rows
    assert "Cell 7" in page.text
    assert am.__version__ in page.text
    for paper in ("Do, V.-H. Vu, Z. Liu", "Allemang", "du Bois"):
        assert paper in page.text


def test_names_from_files_stay_text() -> None:
    plain = modal_maps.path()
    file = modal_maps.ROBOT.replace("name: two arms", f"name: {json.dumps(HOSTILE)}") + f"# {HOSTILE}\n"
    spec = json.dumps({"sweep": {f"links.{HOSTILE}": [0, 4]}})
    hostile = plain.rename({"tool.mass": f"links.{HOSTILE}", "one.z": f"{HOSTILE}.z"})
    hostile = hostile.assign_attrs(robot=HOSTILE, robot_file=file, armonic=HOSTILE, spec=spec)
    hostile["residual"].attrs["long_name"] = HOSTILE
    page = Page(render(hostile, title=HOSTILE))
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in Page(render(plain)).tags]
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    assert page.text.count(HOSTILE) >= 5
    assert "7*7" in page.text
    # Plotly would take tags in its texts for its own.
    assert "<script" not in json.dumps(figures(page))
    assert "<img" not in json.dumps(figures(page))


def test_a_survey_read_in_pieces_has_the_same_summary(monkeypatch: pytest.MonkeyPatch) -> None:
    for ds in (modal_maps.path(), modal_maps.grid((9, 8, 7)), modal_maps.sweep()):
        ds["stability"].values.flat[5] = -1
        whole = summarize(ds)
        with monkeypatch.context() as patch:
            patch.setattr("armonic.plots.dataset.BLOCK", 100)
            pieces = summarize(ds)
        assert pieces == whole
    assert map_summary.CLOSE > 1


def test_a_long_path_is_thinned_for_drawing_but_not_in_tables() -> None:
    ds = modal_maps.path(50_000, masses=())
    ds["natural_freq_hz"].values[31_415, 0] = 4.25
    page = Page(render(ds))
    assert rows(page, 9)[0][1:3] == ["4.25", "posture 31415"]
    assert len(page.text) + sum(map(len, page.scripts[1:])) < 6_000_000
    assert "2000 of 50000 points per curve" in page.scripts[2] + page.scripts[3]


def test_a_report_is_made_of_a_stored_survey(arms: am.Robot, tmp_path: Path) -> None:
    path = np.linspace([0.0, 0.5], [1.0, 2.0], 21)
    stored = am.survey(arms, path, store=tmp_path / "m.zarr")
    again = xr.open_zarr(tmp_path / "m.zarr", consolidated=False, chunks=None)
    assert rows(Page(render(again)), 9) == rows(Page(render(stored)), 9) == rows(Page(render(am.survey(arms, path))), 9)


def test_the_printed_ranges_of_section_4_2_are_in_the_report() -> None:
    page = Page(render(am.survey(am.load("scompi"), "table", sweep={"tool.mass": [0, 4]})))
    assert "from 5.13 to 851.14 Hz, damping ratios from 1.25 % to 80.6 %" in words(page)  # Do et al. 2022
    assert kinds(page) == ["scatter3d", "scatter", "scatter", "scatterpolar"]
    for traces in figures(page)[1:3]:
        assert sum(trace.get("name", "").startswith("mode ") for trace in traces) == 2 * 12


@pytest.mark.parametrize("thing", [None, xr.Dataset(), modal_maps.path(masses=()).isel(posture=0)])
def test_what_is_no_survey_is_refused_and_nothing_written(thing: Any, tmp_path: Path) -> None:
    with pytest.raises(SurveyError):
        write_map_report(thing, tmp_path / "m.html")
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_written_where_there_is_no_folder(tmp_path: Path) -> None:
    with pytest.raises(DataFileError):
        write_map_report(modal_maps.sweep(), tmp_path / "missing" / "m.html")
    assert list(tmp_path.iterdir()) == []
