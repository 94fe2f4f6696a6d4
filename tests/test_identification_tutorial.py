"""The page on simulation and identification does what it says, from the impulse to Table 5 of Do, Vu, Liu 2022."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am

PAGE = Path(__file__).parents[1] / "docs" / "identification.md"
PRINTED = [6.4191, 6.9191, 9.9191, 12.7170, 13.1191, 25.6191, 37.0197, 58.4191, 58.8191, 94.4191, 183.2191]
"""OMA, case 1, of Table 5: what the paper identified itself."""


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What its blocks leave behind, run one after the other."""
    found: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("identification"))
        for code in re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), flags=re.DOTALL):
            exec(compile(code, "identification.md", "exec"), found)
        found["files"] = {path.name for path in Path.cwd().iterdir()}
        found["read"] = am.read_series("run.zarr")
    return found


def test_every_mode_of_table_5_is_found_and_nothing_else(names: dict[str, Any]) -> None:
    table = names["table"]
    assert [pair.index_b for pair in table.pairs] == list(range(12))
    assert table.only_a == table.only_b == ()


def test_modes_1_to_11_agree_within_the_words_of_the_page(names: dict[str, Any]) -> None:
    for pair in names["table"].pairs[:11]:
        assert abs(pair.freq_difference) < 5e-5
        assert abs(pair.damping_difference) < 1e-4
    # The paper's own identification is off by up to 0.8 %.
    assert names["result"].natural_freq_hz[:11] == pytest.approx(PRINTED, rel=0.01)


def test_the_twelfth_mode_is_found_within_1_percent(names: dict[str, Any]) -> None:
    assert abs(names["table"].pairs[11].freq_difference) < 0.01


def test_case_2_of_the_paper_likewise() -> None:
    robot = am.load("scompi").with_values({"tool.mass": 4.0})
    run = am.simulate(robot, "c8", am.Impulse(axis="y0", force=50, duration_s=0.006), duration_s=3)
    table = am.compare(am.oma(run.series), am.modes(robot, "c8"))
    assert [pair.index_b for pair in table.pairs] == list(range(12))
    assert table.only_a == ()
    # Twenty times closer than the paper's own identification came; mode 11 is 4e-5 off by nonlinearity.
    assert np.abs([pair.freq_difference for pair in table.pairs[:11]]).max() < 5e-4
    assert np.abs([pair.damping_difference for pair in table.pairs[:11]]).max() < 5e-4
    assert abs(table.pairs[11].freq_difference) < 0.01


def test_what_is_rejected_is_named_as_a_combination(names: dict[str, Any]) -> None:
    assert len(names["result"].rejected) > 5
    assert any("twice the pole" in group.reason for group in names["result"].rejected)


def test_sensors_leave_nine_modes_and_nothing_false(names: dict[str, Any]) -> None:
    analytic = names["analytic"]
    for series in (names["coarse"], names["noisy"]):
        table = am.compare(am.oma(series, channels="motor_position"), analytic)
        assert table.only_a == ()
        assert len(table.pairs) >= 9


def test_the_tip_shows_eight_modes_at_least(names: dict[str, Any]) -> None:
    table = am.compare(names["tip"], names["analytic"])
    # Closer than the 0.8 % by which the paper's own identification misses the analytic values.
    good = [pair for pair in table.pairs if abs(pair.freq_difference) < 5e-3]
    assert len(good) >= 8


def test_run_and_report_are_written(names: dict[str, Any]) -> None:
    assert {"run.zarr", "oma.html"} <= names["files"]
    assert np.array_equal(names["read"].values, names["run"].series.values)
    assert names["read"].notes["posture"] == "c8"
