"""The report of an experimental modal analysis says what was found, how sure it is, and what was not used."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armonic as am
from analysed import SEEN, analysis, at_lines, estimated, hit, kuka, measured, rejected
from armonic.ema_report import render, write_ema_report
from armonic.errors import DataFileError
from armonic.files.measured_file import Geometry
from armonic.frf_set import FrfSet
from armonic.identification.ema import EmaResult
from armonic.identification.modal_model import ModalModel
from armonic.identification.modal_scaling import modal_scaling
from measured_systems import KUKA
from pages import HOSTILE, Page, figures, numbers, outside


@pytest.fixture(scope="module")
def known() -> tuple[am.Robot, am.LinearModel, am.Modes]:
    return kuka()


@pytest.fixture(scope="module")
def result(known: Any) -> EmaResult:
    _, model, modes = known
    return analysis(measured(model), modes.poles[:SEEN])


def words(page: Page) -> str:
    return " ".join(page.text.split()).replace("\N{NO-BREAK SPACE}", " ")


def alarms(page: Page) -> int:
    return sum("alarm" in str(attributes.get("class")) for tag, attributes in page.tags if tag == "p")


def some_modes(result: EmaResult, kept: list[int]) -> EmaResult:
    """The same with these modes alone, as if the others had not been found."""
    model = replace(result.model, poles=result.poles[kept], residues=result.model.residues[kept])
    modes = tuple(result.modes[k] for k in kept)
    return replace(result, model=model, modes=modes, scaling=modal_scaling(model), refinement=None)


def test_the_report_stands_alone_and_plays_nothing_by_itself(result: EmaResult, known: Any, tmp_path: Path) -> None:
    robot, _, modes = known
    path = write_ema_report(result, tmp_path / "r.html", reference=modes, robot=robot, estimate=estimated(result.frfs))
    html = path.read_text("utf-8")
    assert outside(html) == []
    kinds = [drawn[0]["type"] for drawn in figures(Page(html))]
    # Responses, two diagrams, indicators, circles, two rows of stills, two in motion, two matrices.
    assert kinds == ["scatter"] * 7 + ["scatter3d"] * 2 + ["heatmap"] * 2
    scripts = "".join(Page(html).scripts[1:])
    assert scripts.count("Plotly.addFrames") == 2
    assert "Plotly.animate" not in scripts
    assert len(html) < 7_000_000  # of which 4.8 million are plotly itself


def test_the_lead_says_what_was_found_in_what(result: EmaResult) -> None:
    told = words(Page(render(result)))
    assert (
        "4 modes identified from 9 responses of 401 lines, 5.00 to 30.0 Hz, by polyreference least-squares complex"
        " frequency (pLSCF) of orders 2 to 31, refined by a fit of maximum likelihood: natural frequencies 9.96 to"
        " 23.85 Hz" in told
    )


def test_modes_stand_with_their_deviations_beside_those_of_the_model(result: EmaResult, known: Any) -> None:
    robot, _, modes = known
    page = Page(render(result, reference=modes, robot=robot))
    rows = [row for row in page.rows if len(row) == 12]
    assert [row[0] for row in rows] == ["1", "2", "3", "4"]
    for k, row in enumerate(rows):
        f, z = result.natural_freq_hz[k], result.damping_ratio[k]
        natural, deviation = row[1].split("±")
        assert float(natural) == pytest.approx(f, rel=1e-4)  # five digits
        assert float(deviation.removesuffix(" Hz")) == pytest.approx(result.freq_std_hz[k], rel=0.05)  # two digits
        assert float(row[2]) == pytest.approx(f * np.sqrt(1 - z**2), rel=1e-4)
        assert float(row[3].split("±")[0]) == pytest.approx(100 * z, rel=1e-3)  # four digits
        assert float(row[7]) == pytest.approx(modes.natural_freq_hz[k], rel=1e-4)
        difference = 100 * (f / modes.natural_freq_hz[k] - 1)
        assert float(row[8].replace("−", "-")) == pytest.approx(difference, abs=6e-4)  # three decimals
        assert float(row[11]) > 0.99  # 1 % noise
    assert "4 pairs with the model. None within the band is left without a partner." in words(page)


def test_modes_of_the_model_in_the_band_that_were_not_found_are_said(result: EmaResult, known: Any) -> None:
    _, _, modes = known
    fewer = some_modes(result, [0, 1, 3])
    page = Page(render(fewer, reference=modes))
    told = words(page)
    assert "3 pairs with the model. Of the model within the band, mode 3 (18.717 Hz, 0.585 %) has no partner" in told
    assert "55.5" not in told  # the fifth lies above what was measured
    assert ["–"] * 6 + ["3", "18.717", "–", "0.5850", "–", "–"] in page.rows


def test_complexity_mass_and_modal_a_are_those_of_the_residues(result: EmaResult) -> None:
    page = Page(render(result))
    rows = [row for row in page.rows if len(row) == 9]
    assert len(rows) == 4
    for k, row in enumerate(rows):
        # R = ψψᵀ / a for a single mode: with |ψ| = 1 and a real mode, |a| = 1 / ‖R‖ and the mass |a| / 2ω.
        a = 1 / np.linalg.norm(result.model.residues[k])
        size, angle = row[7].split(" ∠ ")
        assert float(size) == pytest.approx(a, rel=0.01)  # of noise of 1 %
        assert float(row[6]) == pytest.approx(a / (2 * result.poles[k].imag), rel=0.01)
        assert abs(float(angle.removesuffix("°")) - 90) < 2
        assert float(row[2]) > 0.999
    assert "Modal mass (kg for translations) and modal A are those of shapes of unit length." in words(page)


def test_shapes_without_a_driving_point_have_no_scale_and_the_report_says_why(known: Any) -> None:
    _, model, modes = known
    whole = measured(model)
    part = whole.select(outputs=["sensor.x", "sensor.z"], inputs=["sensor.y"])
    page = Page(render(analysis(part, modes.poles[:SEEN])))
    assert "No mode has a scale: no degree of freedom is both watched and hit." in words(page)
    rows = [row for row in page.rows if len(row) == 9]
    assert {(row[6], row[7]) for row in rows} == {("–", "–")}


def test_every_response_has_its_frac_and_poor_ones_raise_an_alarm(result: EmaResult) -> None:
    page = Page(render(result))
    for i, axis in enumerate("xyz"):
        assert [f"sensor.{axis}", *(f"{result.frac[i, j]:.4f}" for j in range(3))] in page.rows
    assert alarms(page) == 0
    poor = result.frac.copy()
    poor[0, 1], poor[2, 2] = 0.42, 0.813
    page = Page(render(replace(result, frac=poor)))
    assert alarms(page) == 1
    assert "describe poorly: sensor.x to sensor.y (FRAC 0.42) and sensor.z to sensor.z (FRAC 0.81)." in words(page)


def test_the_synthesis_is_drawn_over_the_measurement(result: EmaResult) -> None:
    drawn = figures(Page(render(result)))[0]
    curve = next(t for t in drawn if t["name"] == "synthesized" and isinstance(t["y"], dict))
    exact = at_lines(result.model, result.frfs)[:, 0, 0]
    np.testing.assert_allclose(numbers(curve["y"]), np.abs(exact), rtol=1e-6)  # in single precision


def test_what_an_exponential_window_does_is_said_and_drawn() -> None:
    frfs = KUKA.frfs(np.arange(80, 481) / 16, noise=0.01, decay_rate=2.0)
    page = Page(render(analysis(frfs, KUKA.poles)))
    assert "exponential window of 2.000 1/s; the damping that it adds is taken off the modes" in words(page)
    assert "Fladung" in words(page)
    drawn = figures(page)[0]
    named = [t["name"] for t in drawn if isinstance(t.get("y"), dict)]
    assert named.count("synthesized, same window") == named.count("synthesized") == 18
    one, other = (
        next(t for t in drawn if t["name"] == name and isinstance(t["y"], dict))
        for name in ("synthesized, same window", "measured")
    )
    # The model with the same window meets the peaks; noise is 1 % of the RMS, far less at a peak.
    assert numbers(one["y"]).max() == pytest.approx(numbers(other["y"]).max(), rel=0.01)


def test_hits_stand_with_the_reason_why_one_was_not_used(result: EmaResult) -> None:
    page = Page(render(result, estimate=estimated(result.frfs)))
    rows = [row for row in page.rows if len(row) == 8 and row[3].startswith("sensor.")]
    assert len(rows) == 15
    assert rows[3] == [
        "4", "4", "3.100", "sensor.x", "−212", "6.00", "not used", "a second hit 43 ms after the first, 18 % as hard",
    ]  # fmt: skip
    assert [row[6] for row in rows].count("used") == 14
    assert "Lines above 80 Hz were left out: there the force is too weak." in words(page)
    assert "Hits" not in words(Page(render(result)))


def test_rejected_clusters_stand_with_their_reasons(result: EmaResult) -> None:
    assert ["14.200", "2.000", "9", "held in 9 of 30 orders only"] in Page(render(result)).rows
    assert "No cluster of poles was rejected." in words(Page(render(replace(result, rejected=()))))


def test_where_no_mode_was_found_the_report_says_so(result: EmaResult, known: Any) -> None:
    robot, _, modes = known
    page = Page(render(replace(some_modes(result, []), frac=np.full((3, 3), np.nan)), reference=modes, robot=robot))
    assert "No modes were identified from 9 responses" in words(page)
    assert "0 pairs with the model. Of the model within the band, mode 1 (9.9620 Hz, 1.08 %), mode 2" in words(page)
    assert alarms(page) == 1
    assert len(figures(page)) == 4


def test_residues_of_more_than_one_mode_raise_an_alarm(result: EmaResult) -> None:
    residues = result.model.residues.copy()
    residues[1] = np.eye(3) * residues[1, 2, 2]
    mixed = ModalModel(result.poles, residues, result.model.outputs, result.model.inputs)
    page = Page(render(replace(result, scaling=modal_scaling(mixed))))
    # The best matrix of rank one leaves two of three equal singular values: √2 of the first.
    assert "Mode 2 at 11.070 Hz: its residues are hardly those of a single mode, which leaves 140 %" in words(page)


def test_without_a_robot_shapes_are_a_table(result: EmaResult, known: Any) -> None:
    page = Page(render(result))
    assert "have no position (no robot was given)" in words(page)
    assert len(figures(page)) == 6
    other = am.load("scompi")
    assert f"they are no frames of {other.name}" in words(Page(render(result, robot=other, posture="c8")))
    largest = np.argmax(np.abs(result.modes[0].shape))
    row = next(row for row in page.rows if len(row) == 4 and row[0] == "1" and "∠" in row[1])
    assert row[1 + largest] == "1.000 ∠ 0°"


def test_measured_points_may_have_their_places_by_a_geometry(result: EmaResult) -> None:
    geometry = Geometry(("sensor",), np.array([[2.2, 0.0, 0.5]]))
    page = Page(render(result, geometry=geometry))
    assert [drawn[0]["type"] for drawn in figures(page)].count("scatter3d") == 1
    assert "have no position" not in words(page)


def test_a_model_without_the_robot_is_compared_by_its_poles(result: EmaResult, known: Any) -> None:
    _, _, modes = known
    page = Page(render(result, reference=modes))
    assert "4 pairs with the model." in words(page)
    assert {row[11] for row in page.rows if len(row) == 12} == {"–"}
    assert "MAC with the model" not in words(page)


def test_how_it_was_made_can_be_done_again(result: EmaResult) -> None:
    page = Page(render(result))
    told = words(page)
    assert "freq_tolerance = 0.01, damping_tolerance = 0.05, mac = 0.95" in told
    assert "accelerance, 9 responses of 401 lines, 5.00 to 30.0 Hz" in told
    for name in ("Huynh", "PolyMAX", "Allemang", "Bendat", "Shih", "Williams", "Heylen"):
        assert name in told
    assert "820194" not in told
    assert "820194" in words(Page(render(replace(result, method="lsce"))))
    row = next(row for row in page.rows if len(row) == 5 and row[0] == "2")
    assert complex(float(row[1]), float(row[2])) == pytest.approx(complex(result.poles[1]), rel=1e-8)  # nine digits


def test_names_from_files_stay_text(result: EmaResult, known: Any) -> None:
    robot, *_ = known
    labels = tuple(f"{HOSTILE}.{axis}" for axis in "xyz")
    frfs = result.frfs
    named = replace(frfs, outputs=labels, inputs=labels, notes={HOSTILE: HOSTILE, "robot": HOSTILE, "file": HOSTILE})
    model = replace(result.model, outputs=labels, inputs=labels)
    estimate = SimpleNamespace(frfs=named, hits=(hit(0, HOSTILE, 3.0, HOSTILE),), remarks=(HOSTILE,))
    hostile = replace(
        result, frfs=named, measured=named, model=model, scaling=modal_scaling(model), channels=labels,
        rejected=(rejected(5.0, 0.1, 3, HOSTILE),),
    )  # fmt: skip
    plain = replace(result, frfs=replace(frfs, notes={"a": "b", "robot": "c", "file": "d"}))
    html = render(hostile, estimate=estimate, title=HOSTILE)
    page, usual = (
        Page(html),
        Page(render(plain, estimate=SimpleNamespace(frfs=frfs, hits=(hit(0, "a", 3.0, "b"),), remarks=("c",)))),
    )
    assert [tag for tag, _ in page.tags] == [tag for tag, _ in usual.tags]
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)
    assert page.text.count(HOSTILE) >= 8
    assert "<script" not in json.dumps(figures(page))
    assert "<img" not in json.dumps(figures(page))
    assert robot.name not in page.text


def test_nothing_is_written_where_there_is_no_folder(result: EmaResult, tmp_path: Path) -> None:
    with pytest.raises(DataFileError):
        write_ema_report(result, tmp_path / "missing" / "r.html")
    assert list(tmp_path.iterdir()) == []


def test_a_long_measurement_makes_no_large_page(known: Any) -> None:
    _, model, modes = known
    lines = np.linspace(5.0, 30.0, 20_001)
    frfs: FrfSet = measured(model, lines_hz=lines)
    html = render(analysis(frfs, modes.poles[:SEEN], orders=10))
    assert len(html) < 8_000_000  # of which 4.8 million are plotly itself
