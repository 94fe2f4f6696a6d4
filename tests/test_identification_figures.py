"""Figures and the report of an identification show what was found, what was not, and by which numbers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

import armonic as am
from armonic.errors import DataFileError, SignalError
from armonic.identification.poles import ModelPoles
from armonic.identification.selection import SelectedMode
from armonic.identification.stabilization import Criteria, Stabilization, stabilize
from armonic.identification_report import render, write_identification_report
from armonic.plots.series import MAX_POINTS as MOST_SAMPLES
from armonic.plots.series import thinned, time_histories
from armonic.plots.stabilization import MAX_POINTS as MOST_POLES
from armonic.plots.stabilization import failed_criteria, stabilization_diagram
from armonic.series import Channel, TimeSeries
from identified import MOTORS, decay, flag, identification, rejected, scompi_modes
from identified import pole_of as pole
from pages import HOSTILE, Page, figures, outside

ROUNDING = 1e-12
"""Of a conversion of units and back."""


@pytest.fixture(scope="module")
def reference() -> am.Modes:
    return scompi_modes()


@pytest.fixture(scope="module")
def result(reference: am.Modes) -> Any:
    return identification(reference)


@pytest.fixture(scope="module")
def small(reference: am.Modes) -> Any:
    """With few false poles, for pages that are only read."""
    return identification(reference, false_per_order=2)


def changed(result: Any, **values: Any) -> Any:
    return SimpleNamespace(**vars(result) | values)


def moved(mode: SelectedMode, freq_hz: float, damping: float) -> SelectedMode:
    return replace(mode, natural_freq_hz=freq_hz, damping_ratio=damping, pole=pole(freq_hz, damping))


def traces(figure: go.Figure, name: str) -> Any:
    return next(trace for trace in figure.data if trace.name == name)


def words(page: Page) -> str:
    return " ".join(page.text.split()).replace("\N{NO-BREAK SPACE}", " ")


def two_orders(*changes: tuple[float, float, list[float]], criteria: Criteria | None = None) -> Stabilization:
    """Poles of 10, 20 ... Hz at 2 %; in the next order times these factors of frequency and damping, with shapes."""
    before = np.array([pole(10.0 * (k + 1), 0.02) for k in range(len(changes))])
    after = np.array([pole(10.0 * (k + 1) * f, 0.02 * z) for k, (f, z, _) in enumerate(changes)])
    first = np.tile([1.0 + 0j, 0.0], (len(changes), 1))
    shapes = np.array([shape for _, _, shape in changes], complex)
    return stabilize([ModelPoles(4, before, first), ModelPoles(5, after, shapes)], criteria)


def named(notes: go.Figure) -> str:
    return "; ".join(str(note.text) for note in notes.layout.annotations)


def test_every_pole_of_a_mode_stands_at_its_frequency_damping_and_order(result: Any) -> None:
    s = result.stabilization
    for what, values in (("frequency", s.natural_freq_hz), ("damping", 100 * s.damping_ratio)):
        figure = stabilization_diagram(s, result.modes, what=what)
        for number, mode in enumerate(result.modes, 1):
            drawn = traces(figure, f"mode {number}")
            np.testing.assert_allclose(drawn.x, values[mode.members], rtol=ROUNDING)
            np.testing.assert_array_equal(drawn.y, s.order[mode.members])


def test_what_a_pole_fails_is_named_under_the_pointer() -> None:
    alike, other = [1.0, 0.0], [0.0, 1.0]
    s = two_orders((1.0001, 1.001, alike), (1.02, 1.0, alike), (1.0, 1.5, alike), (1.0, 1.0, other))
    assert failed_criteria(s)[4:] == ["", "frequency", "damping", "MAC, OMAC"]
    assert {*failed_criteria(s)[:4]} == {"frequency, damping, MAC, OMAC"}  # nothing before the lowest order
    assert np.array_equal([not failed for failed in failed_criteria(s)], s.stable)
    drawn = traces(stabilization_diagram(s), "unstable")
    told = dict(zip(np.round(drawn.x[4:], 2).tolist(), drawn.text[4:], strict=True))
    assert told == {
        20.4: "MAC 1.0000<br>fails: frequency",
        30.0: "MAC 1.0000<br>fails: damping",
        40.0: "MAC 0.0000<br>fails: MAC, OMAC",
    }


def test_a_criterion_that_is_off_is_never_failed_and_a_range_is_one() -> None:
    far = (1.05, 2.0, [0.0, 1.0])
    off = Criteria(freq_tolerance=None, damping_tolerance=None, mac=None, omac=None)
    assert failed_criteria(two_orders(far, criteria=off)) == ["", ""]
    ranges = replace(off, damping_range=(0, 0.03), freq_range_hz=(1, 10.2))
    assert failed_criteria(two_orders(far, criteria=ranges)) == ["", "damping range, frequency range"]


def test_poles_that_grow_or_do_not_vibrate_are_not_drawn() -> None:
    poles = np.array([pole(10, 0.02), -30.0 + 0j, pole(12, -0.01), pole(500, 0.02)])
    s = stabilize([ModelPoles(p, poles, np.ones((4, 2), complex)) for p in (2, 3)])
    figure = stabilization_diagram(s, band_hz=(5, 100))
    drawn = np.concatenate([traces(figure, name).x for name in ("stable", "unstable")])
    np.testing.assert_allclose(drawn, [10.0, 10.0], rtol=ROUNDING)


def test_of_many_false_poles_a_part_is_drawn_and_it_is_said(result: Any) -> None:
    figure = stabilization_diagram(result.stabilization, result.modes)
    total = len(result.stabilization.order) - sum(len(mode.members) for mode in result.modes)
    # Random poles are stable by chance at most now and then.
    assert total - 100 < int(named(figure).split("5000 of ")[1].split()[0]) <= total
    assert len(traces(figure, "unstable").x) == MOST_POLES == 5000
    assert sum(len(trace.x) for trace in figure.data if str(trace.name).startswith("mode ")) == sum(
        mode.orders for mode in result.modes
    )


def test_lines_stand_at_the_means_and_at_the_modes_of_the_model(result: Any, reference: am.Modes) -> None:
    figure = stabilization_diagram(result.stabilization, result.modes, reference=reference)
    assert [line.x0 for line in figure.layout.shapes] == [mode.natural_freq_hz for mode in result.modes]
    dashed = [x for x in traces(figure, "reference").x if x is not None]
    np.testing.assert_array_equal(dashed, np.repeat(reference.natural_freq_hz, 2))
    assert figure.layout.xaxis.type == "log"  # 6.4 to 851 Hz
    low, high = figure.layout.xaxis.range
    assert 10**low < 6.36
    assert 10**high > 850.9
    for number, freq in enumerate(("6.369", "6.96", "9.88"), 1):
        assert f"{number}: {freq}" in named(figure)


def test_modes_of_the_model_that_do_not_vibrate_have_no_line(result: Any, reference: am.Modes) -> None:
    still: Any = SimpleNamespace(
        natural_freq_hz=reference.natural_freq_hz,
        damping_ratio=reference.damping_ratio,
        oscillatory=np.arange(12) != 11,
    )
    figure = stabilization_diagram(result.stabilization, result.modes, what="damping", reference=still)
    dashed = [x for x in traces(figure, "reference").x if x is not None]
    np.testing.assert_allclose(dashed, np.repeat(100 * reference.damping_ratio[:11], 2), rtol=ROUNDING)


def test_a_diagram_without_modes_or_without_stable_poles_is_drawn() -> None:
    for s in (two_orders((1.3, 1.0, [1.0, 0.0])), stabilize([ModelPoles(2, np.zeros(0, complex), np.zeros((0, 2)))])):
        low, high = stabilization_diagram(s).layout.xaxis.range
        assert low < high


@pytest.mark.parametrize("wrong", [{"what": "phase"}, {"band_hz": (20.0, 10.0)}])
def test_a_diagram_of_nothing_is_refused(result: Any, wrong: dict[str, Any]) -> None:
    with pytest.raises(SignalError):
        stabilization_diagram(result.stabilization, **wrong)


def test_motor_positions_are_drawn_in_degrees_and_torques_below_in_the_same_colours(reference: am.Modes) -> None:
    series = decay(reference)
    figure = time_histories(series)
    position, torque = (
        [trace for trace in figure.data if trace.name == "link_2.motor" and trace.yaxis == axis] for axis in ("y", "y2")
    )
    np.testing.assert_allclose(position[0].y, np.degrees(series["motor_position:link_2.motor"]), rtol=ROUNDING)
    np.testing.assert_array_equal(torque[0].y, series["motor_torque:link_2.motor"])
    np.testing.assert_allclose(position[0].x, 0.206 + np.arange(2795) / 1000, rtol=ROUNDING)
    assert position[0].line.color == torque[0].line.color
    assert (position[0].showlegend, torque[0].showlegend) == (True, False)
    assert (figure.layout.yaxis.title.text, figure.layout.yaxis2.title.text) == (
        "Motor position, °",
        "Motor torque, N·m",
    )
    assert figure.layout.yaxis.domain[0] > figure.layout.yaxis2.domain[1]


def test_each_channel_may_have_a_panel_of_its_own_and_lose_its_mean(reference: am.Modes) -> None:
    series = decay(reference).select("motor_position")
    figure = time_histories(series, by="channel", about="mean")
    assert [trace.yaxis for trace in figure.data] == ["y", "y2", "y3", "y4", "y5", "y6"]
    for trace in figure.data:
        assert abs(np.mean(trace.y)) < 1e-12  # degrees, of angles up to 57
    assert "link_6.motor: motor position, °" in named(figure)
    assert "each less its mean" in named(figure)


def test_a_long_run_is_thinned_without_losing_its_peaks() -> None:
    values = np.sin(np.arange(300_001) / 7)
    values[123_457], values[222_222] = 40.0, -30.0
    series = TimeSeries(values[:, None], 1e4, (Channel("tool.x", "acceleration", "m/s²"),))
    figure = time_histories(series)
    drawn = figure.data[0]
    assert len(drawn.x) <= MOST_SAMPLES
    assert drawn.y.max() == 40.0
    assert drawn.x[np.argmin(drawn.y)] == pytest.approx(22.2222, rel=ROUNDING)
    assert (drawn.x[0], drawn.x[-1]) == (0.0, 30.0)
    assert "4000 of 300001 samples" in named(figure)


def test_missing_samples_are_a_gap() -> None:
    values = np.ones(50_000)
    values[20_000:30_000] = np.nan
    kept = thinned(values)
    assert np.isnan(values[kept]).any()
    series = TimeSeries(np.where(np.arange(50_000) == 10, np.inf, values)[:, None], 1e3, (Channel("a", "force", "N"),))
    figure = time_histories(series, about="mean")
    assert all(np.isfinite(limit) for limit in figure.layout.yaxis.range)
    time_histories(series.with_values(np.full((5, 1), np.nan)))


@pytest.mark.parametrize("samples", [*range(1, 12), 399, 400, 401, 4001])
def test_thinning_keeps_both_ends_and_both_extremes(samples: int) -> None:
    values = np.random.default_rng(samples).normal(size=samples)
    kept = thinned(values, limit=10)
    assert {0, samples - 1, int(values.argmin()), int(values.argmax())} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)
    assert len(kept) <= 10


def test_a_window_and_a_choice_of_channels_are_drawn(reference: am.Modes) -> None:
    figure = time_histories(decay(reference), "motor_torque:link_1.motor", window_s=(0.5, 0.6))
    (trace,) = figure.data
    assert (len(trace.x), trace.x[0]) == (101, pytest.approx(0.5, rel=ROUNDING))
    with pytest.raises(SignalError):
        time_histories(decay(reference), "speed")


def test_the_report_stands_alone(small: Any, reference: am.Modes, tmp_path: Path) -> None:
    html = write_identification_report(small, tmp_path / "r.html", reference).read_text("utf-8")
    assert outside(html) == []
    page = Page(html)
    kinds = [drawn[0]["type"] for drawn in figures(page)]
    assert kinds == ["scatter", "scatter", "heatmap", "heatmap", "scatter"]
    assert "11 modes identified from 6 channels of 2795 samples at 1000 Hz by vector autoregression" in words(page)
    assert "model orders 2 to 100" in words(page)


def test_the_modes_stand_beside_those_of_the_model_with_differences(small: Any, reference: am.Modes) -> None:
    f, z = float(reference.natural_freq_hz[3]), float(reference.damping_ratio[3])
    off = moved(small.modes[3], 1.01 * f, z - 0.002)
    page = Page(render(changed(small, modes=(*small.modes[:3], off, *small.modes[4:])), reference))
    row = next(row for row in page.rows if len(row) == 13 and row[0] == "4")
    damped = 1.01 * f * np.sqrt(1 - (z - 0.002) ** 2)
    assert row[1].startswith(f"{1.01 * f:.3f}±")
    assert row[2] == f"{damped:.3f}"
    assert row[3].startswith(f"{100 * z - 0.2:.2f}±")
    assert row[4:6] == [str(off.orders), str(off.first_order)]
    assert row[7:] == ["4", f"{f:.3f}", "+1.000", f"{100 * z:.2f}", "−0.200", "1.000"]
    assert "Largest frequency difference1.0 %" in words(page)
    assert "Largest damping difference0.20 points" in words(page)


def test_modes_without_a_partner_are_said_on_either_side(small: Any, reference: am.Modes) -> None:
    told = words(Page(render(small, reference)))
    assert "11 pairs with the model. Of the model, mode 12 (850.81 Hz, 80.6 %) has no partner" in told
    extra, flags = moved(small.modes[0], 410.0, 0.01), (*small.harmonics, flag())
    page = Page(render(changed(small, modes=(*small.modes, extra), harmonics=flags), reference))
    assert "Identified mode 12 (410.00 Hz, 1.00 %) has no partner in the model." in words(page)
    table = [row for row in page.rows if len(row) == 13]
    assert [row[0] for row in table] == [*map(str, range(1, 13)), "–"]
    assert table[-2][7:] == ["–"] * 6
    assert table[-1][7:9] == ["12", "850.81"]


def test_a_mode_above_half_the_sampling_rate_is_called_one(small: Any) -> None:
    assert "half the sampling rate" not in words(Page(render(small)))
    fast = moved(small.modes[10], 845.7, 0.8099)
    page = Page(render(changed(small, modes=(*small.modes[:10], fast))))
    assert "Mode 11: natural frequency above half the sampling rate, 500.0 Hz." in words(page)


def test_without_a_model_there_is_none_in_the_report(small: Any) -> None:
    page = Page(render(small))
    assert len([row for row in page.rows if len(row) == 7]) == 11 + 11  # the modes and, as numbers, their shapes
    assert "Model" not in words(page).split("Stabilization")[0].replace("Model orders", "")
    assert len(figures(page)) == 4


def test_rejected_clusters_stand_with_their_reasons(small: Any) -> None:
    page = Page(render(small))
    assert ["12.740", "1.250", "31", "twice the pole of mode 1 (nonlinearity)"] in page.rows
    assert "2 clusters rejected" in words(page)
    assert "No cluster of poles was rejected." in words(Page(render(changed(small, rejected=()))))


def test_a_harmonic_raises_an_alarm(small: Any) -> None:
    flags = [flag("2 x 18.5 Hz of the spindle" if k == 6 else "") for k in range(11)]
    page = Page(render(changed(small, harmonics=tuple(flags))))
    assert "Mode 7 at 37.02 Hz may be no mode but a harmonic of the excitation: 2 x 18.5 Hz" in words(page)
    assert sum("alarm" in str(attributes.get("class")) for tag, attributes in page.tags if tag == "p") == 1


def test_where_no_mode_was_found_the_report_says_so(small: Any, reference: am.Modes) -> None:
    page = Page(render(changed(small, modes=(), harmonics=()), reference))
    assert "No modes were identified" in words(page)
    assert "no partner among those identified" in words(page)
    assert len(figures(page)) == 3


def test_how_it_was_made_can_be_done_again(small: Any, reference: am.Modes) -> None:
    page = Page(render(changed(small, method="ssi"), reference))
    told = words(page)
    assert "2795 at 1000.0 Hz, from 0.206 s" in told
    assert "freq_tolerance = 0.01, damping_tolerance = 0.05, mac = 0.9, damping_range = (0.0, 0.999)" in told
    assert "numbers of states 2 to 100" in told
    assert "impulse of 50 N over 6 ms" in told
    assert "Peeters" in told
    (row,) = (row for row in page.rows if len(row) == 5 and row[0] == "2")
    assert complex(float(row[1]), float(row[2])) == pytest.approx(small.modes[1].pole, rel=1e-8)  # nine digits


def test_names_from_files_stay_text(small: Any, reference: am.Modes) -> None:
    hostile = TimeSeries(
        small.series.values,
        1000.0,
        tuple(Channel(HOSTILE + name, "signal", HOSTILE) for name in MOTORS),
        notes={HOSTILE: HOSTILE, "robot": HOSTILE, "a": "b"},
    )
    plain = changed(small, rejected=small.rejected[:1])
    page = Page(render(changed(small, series=hostile, rejected=(rejected(5.0, 0.1, 3, HOSTILE),)), title=HOSTILE))
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in Page(render(plain)).tags]
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    assert page.text.count(HOSTILE) >= 5
    assert "<script" not in json.dumps(figures(page))
    assert "<img" not in json.dumps(figures(page))


def test_nothing_is_written_where_there_is_no_folder(small: Any, tmp_path: Path) -> None:
    with pytest.raises(DataFileError):
        write_identification_report(small, tmp_path / "missing" / "r.html")
    assert list(tmp_path.iterdir()) == []
