"""`armonic map` and closed loops in `armonic modes`: printed tables come out, stores go on, bad words are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import armonic as am
from armonic import cli
from command_line import WIDTH, Armonic, files

pytestmark = pytest.mark.usefixtures("empty_folder")


def test_map_of_the_table_has_the_ranges_of_section_4_2(armonic: Armonic, tmp_path: Path) -> None:
    words = ("map", "scompi", "--path", "table", "--tool-mass", "4", "-o", "map.zarr", "--report", "map.html")
    run = armonic(*words)
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    stored = xr.open_zarr(tmp_path / "map.zarr", consolidated=False, chunks=None)
    assert dict(stored.natural_freq_hz.sizes) == {"tool.mass": 2, "posture": 50, "mode": 12}
    ends = [float(end) for end in (stored.natural_freq_hz.min(), stored.natural_freq_hz.max())]
    ratios = [100 * float(end) for end in (stored.damping_ratio.min(), stored.damping_ratio.max())]
    # Do et al. 2022, section 4.2, to its last printed digit.
    np.testing.assert_allclose(ends, [5.13, 851.14], atol=0.006)
    np.testing.assert_allclose(ratios, [1.25, 80.61], atol=0.006)
    assert (tmp_path / "map.html").stat().st_size > 1_000_000
    assert files(tmp_path) == ["map.html", "map.zarr"]
    again = armonic(*words, "--force", "--json").json
    assert again["dims"] == {"tool.mass": 2, "posture": 50}
    assert (again["unstable"], again["dense"]) == (0, 0)


def test_gain_sweep_of_figure_5(armonic: Armonic) -> None:
    kp = np.linspace(2000, 15000, 14)
    kd = ",".join(str(v) for v in 0.425 * np.sqrt(kp))
    sweep = ("--sweep", "control.kp=2000:15000:14", "--sweep", f"control.kd={kd}")
    first = armonic("map", "scompi", "--posture", "c1", *sweep, "--json").json["modes"][0]
    np.testing.assert_allclose(first["natural_freq_hz"], [2.39, 6.51], atol=0.006)
    np.testing.assert_allclose(np.multiply(first["damping_ratio"], 100), [7.85, 9.44], atol=0.01)


def test_grid_sample_and_typed_path_have_the_sizes_asked_for(armonic: Armonic, tmp_path: Path) -> None:
    grid = ("--grid", "link_2.z=-30deg:30deg:4", "--grid", "link_3.z=1.2,1.4,1.6", "--posture", "c8")
    assert armonic("map", "scompi", *grid, "--json").json["dims"] == {"link_2.z": 4, "link_3.z": 3}
    sample = ("--sample", "link_2.z=-30deg:30deg", "--count", "9", "--posture", "c8")
    assert armonic("map", "scompi", *sample, "--json").json["dims"] == {"posture": 9}
    path = ("--path", "c1..c8..c50", "--points", "21", "-o", "path.zarr", "--shapes", "--no-participation")
    assert armonic("map", "scompi", *path, "--json").json["dims"] == {"posture": 21}
    stored = xr.open_zarr(tmp_path / "path.zarr", consolidated=False, chunks=None)
    assert "participation" not in stored
    at_c8 = am.modes(am.load("scompi"), "c8")
    np.testing.assert_allclose(
        np.sort(stored.natural_freq_hz.isel(posture=10).values), at_c8.natural_freq_hz, rtol=1e-9
    )


def test_modes_of_scompi_fit_80_columns_and_show_margins(armonic: Armonic) -> None:
    run = armonic("modes", "scompi", "--posture", "c8")
    assert run.code == 0
    assert max(map(len, run.out.splitlines())) <= WIDTH
    # Table 5, case 1: lowest and highest mode to the printed hundredth.
    for printed in ("6.37", "850.81", "7.67", "80.58"):
        assert printed in run.out
    assert "link_6.motor" in run.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "one of --path, --grid and --sample"),
        (("--path", "table", "--grid", "link_2.z=0:1:3"), "found --path and --grid"),
        (("--path", "tabel"), "two or more postures"),
        (("--path", "c1..c9"), "c9"),
        (("--path", "table", "--points", "9"), "--points"),
        (("--path", "table", "--posture", "c1"), "beside a path"),
        (("--grid", "link_9.z=0:1:3"), "link_9.z"),
        (("--grid", "link_2.z=0:1"), "lo:hi:n"),
        (("--grid", "link_2.z=0:1:0"), "lo:hi:n"),
        (("--grid", "link_2.z=0:1 furlong:3"), "furlong"),
        (("--grid", "link_2.z"), "NAME=range"),
        (("--grid", "link_2.z=0:1:3", "--grid", "link_2.z=0:1:3"), "twice"),
        (("--sample", "link_2.z=1:0"), "lo <= hi"),
        (("--sample", "link_2.z=0:1", "--count", "0"), "1 to"),
        (("--path", "table", "--sweep", "control.kq=0:1:3"), "control.kq"),
        (("--path", "table", "--sweep", "control.kp=a,b"), "a number in SI"),
        (("--path", "table", "--sweep", "control.kp=1:2:3", "--sweep", "control.kd=1:2:4"), "same number of each"),
        (("--path", "table", "--sweep", "tool.mass=0,1", "--tool-mass", "4"), "sweep tool.mass itself"),
        (("--path", "table", "--tool-mass", "-1"), "tool.mass"),
        (("--path", "table", "--threads", "0"), "threads"),
        (("--path", "table", "--frame", "tool"), "without a wrench"),
        (("--path", "table", "--scheduler", "nowhere"), "nowhere"),
        (("--path", "table", "--report", "no/where.html"), "no folder"),
        (("--path", "table", "-o", "no/where.zarr"), "no folder"),
        (("--grid", "link_2.z=0:1:100000", "--grid", "link_3.z=0:1:100000", "-o", "big.zarr"), "10000000000 postures"),
        (("--grid", "link_2.z=0:1:100000", "--grid", "link_3.z=0:1:100000"), "10000000000 postures"),
    ],
)
def test_map_refuses(armonic: Armonic, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    run = armonic("map", "scompi", *words)
    assert said in run.error
    assert run.out == ""
    assert files(tmp_path) == []


def test_a_store_of_another_survey_or_robot_is_refused_and_stays(armonic: Armonic, tmp_path: Path) -> None:
    assert armonic("map", "scompi", "--path", "table", "-o", "map.zarr").code == 0
    before = {path: path.read_bytes() for path in (tmp_path / "map.zarr").rglob("*") if path.is_file()}
    assert (
        "other participation"
        in armonic("map", "scompi", "--path", "table", "-o", "map.zarr", "--no-participation").error
    )
    changed = am.load("scompi").with_values({"control.kp": 14000})
    changed.save(tmp_path / "other.yaml")
    assert "another robot" in armonic("map", "other.yaml", "--path", "table", "-o", "map.zarr").error
    after = {path: path.read_bytes() for path in (tmp_path / "map.zarr").rglob("*") if path.is_file()}
    assert after == before


def test_an_unstable_loop_is_told_not_refused(armonic: Armonic, tmp_path: Path) -> None:
    text = am.load("scompi").to_yaml().replace("kp: 15000,", "kp: 15000, link_kd: 4000,")
    assert "link_kd" in text
    (tmp_path / "wild.yaml").write_text(text, "utf-8")
    assert "Unstable" in armonic("modes", "wild.yaml", "--posture", "c8").words
    data = armonic("map", "wild.yaml", "--path", "table", "--json").json
    assert data["unstable"] == 50
    assert json.dumps(data["modes"])  # numbers, as of any other loop


def test_an_interrupted_map_says_what_was_kept(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from armonic.surveying import running

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(running, "_in_order", stop)
        run = armonic("map", "scompi", "--path", "table", "-o", "map.zarr")
    assert run.code == cli.INTERRUPTED
    assert "map.zarr keeps what was done" in run.err
    assert armonic("map", "scompi", "--path", "table", "-o", "map.zarr").code == 0


def test_a_path_that_stays_in_one_posture_gets_its_report(armonic: Armonic, tmp_path: Path) -> None:
    assert armonic("map", "scompi", "--path", "c8..c8", "--points", "7", "--report", "same.html").code == 0
    assert (tmp_path / "same.html").exists()
