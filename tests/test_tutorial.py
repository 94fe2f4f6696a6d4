"""The tutorial does what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What its blocks leave behind, run one after the other."""
    found: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("tutorial"))
        for code in re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), flags=re.DOTALL):
            exec(compile(code, "tutorial.md", "exec"), found)
        found["files"] = {path.name for path in Path.cwd().iterdir()}
    return found


def test_the_taps_give_the_modes_of_the_robot_and_a_model_that_has_them(names: dict[str, Any]) -> None:
    true = am.modes(am.load("kuka_kr90"), "milling")
    assert sum(not hit.used for hit in names["estimate"].hits) == 2
    found, updated = names["found"], am.modes(names["first"].robot, "milling")
    for modes in (found, updated):
        # "within 0.5 % and a tenth of their damping"
        np.testing.assert_allclose(modes.natural_freq_hz[:4], true.natural_freq_hz[:4], rtol=0.005)
        np.testing.assert_allclose(modes.damping_ratio[:4], true.damping_ratio[:4], rtol=0.1)


def test_the_fit_is_as_the_page_says(names: dict[str, Any]) -> None:
    fit = names["fit"]
    assert fit.status == "converged"
    assert fit.doubts == ()
    assert fit.noise == pytest.approx(0.01, rel=0.05)
    assert all(p.verdict in ("identified", "at bound") for p in fit.parameters if p.path.endswith("stiffness"))
    assert names["open_ones"]
    assert all(path.endswith("damping") for path in names["open_ones"])


def test_the_planned_measurements_narrow_the_intervals(names: dict[str, Any]) -> None:
    before, after = (
        np.array([p.deviation for p in names[fit].parameters if p.path.endswith("stiffness")])
        for fit in ("fit", "better")
    )
    assert (after < before).all()
    assert np.median(before / after) > 2


def test_the_updated_robot_and_the_report_are_written(names: dict[str, Any]) -> None:
    assert names["files"] == {"ema.html", "kuka_updated.yaml", "report.html"}
    assert isinstance(names["bands"], am.FrfBands)
