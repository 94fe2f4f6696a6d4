"""A survey on disk: whatever ends a run, the next one goes on, and the finished store is that of a run left alone."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import armonic as am

PROGRAM = """
import sys
import numpy as np
import armonic as am
from armonic.surveying import running
running.POSTURES_PER_BLOCK = 500  # many blocks, so that a run can be ended between any two
def told(done, total):
    print(done, flush=True)
axes = {"link_2.z": np.linspace(-0.5, 0.5, 30), "link_3.z": np.linspace(1, 2, 40), "link_4.z": np.linspace(0, 1, 50)}
grid = am.Grid(axes, base="c8")
am.survey(am.load("scompi"), grid, store=sys.argv[1], shapes=True, threads=2, progress=told)
"""
COUNT = 30 * 40 * 50


def run(store: Path) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", PROGRAM, str(store)], stdout=subprocess.PIPE, text=True)


def opened(store: Path) -> xr.Dataset:
    return xr.open_zarr(store, consolidated=False, chunks=None)


def counts(process: subprocess.Popen[str]) -> list[int]:
    out, _ = process.communicate(timeout=120)
    return [int(line) for line in out.split()]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_survey_that_is_ended_again_and_again_becomes_the_one_left_alone(tmp_path: Path, how: signal.Signals) -> None:
    ended, alone = tmp_path / "ended.zarr", tmp_path / "alone.zarr"
    reached = 0
    for share in (0.1, 0.35, 0.7):
        process = run(ended)
        assert process.stdout is not None
        done = [int(process.stdout.readline())]
        assert done[0] >= reached  # it goes on, it does not begin again
        while done[-1] < share * COUNT:
            done.append(int(process.stdout.readline()))
        time.sleep(0.002 * 10 * share)  # somewhere in the next block
        process.send_signal(how)
        process.communicate(timeout=60)
        assert process.returncode != 0
        reached = int(opened(ended).surveyed)
        assert done[-1] <= reached < COUNT
    assert counts(run(ended))[0] == reached
    assert counts(run(alone))[-1] == COUNT
    one, other = opened(ended), opened(alone)
    assert set(one.variables) == set(other.variables)
    for name in one.variables:
        np.testing.assert_array_equal(one[name].values, other[name].values)
    assert {path.relative_to(ended) for path in ended.rglob("*")} == {
        path.relative_to(alone) for path in alone.rglob("*")
    }


def test_a_store_holds_what_memory_would(tmp_path: Path) -> None:
    robot, grid = am.load("scompi"), am.Grid({"link_2.z": [-0.2, 0, 0.3], "link_3.z": np.linspace(1, 2, 7)}, base="c8")
    stored, kept = am.survey(robot, grid, store=tmp_path / "map.zarr", shapes=True), am.survey(robot, grid, shapes=True)
    for name in kept.variables:
        np.testing.assert_array_equal(stored[name].values, kept[name].values)
    assert set(stored.coords) == set(kept.coords)
    assert int(stored.surveyed) == 21
    assert json.loads(stored.attrs["spec"]) == json.loads(kept.attrs["spec"])
    again = am.survey(robot, grid, store=tmp_path / "map.zarr", shapes=True)
    np.testing.assert_array_equal(again.pole.values, kept.pole.values)


def test_what_is_not_the_store_of_this_survey_is_refused_and_left_alone(tmp_path: Path) -> None:
    robot = am.load("scompi")
    am.survey(robot, "table", store=tmp_path / "map.zarr")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "thesis.txt").write_text("do not lose me")
    (tmp_path / "file").write_text("nor me")
    heavier = robot.with_values({"tool.mass": 4})
    for one, postures, where, said in (
        (heavier, "table", "map.zarr", "another robot"),
        (robot, "c8", "map.zarr", "another survey"),
        (robot, "table", "folder", "no map"),
        (robot, "table", "file", "no map"),
        (robot, "table", "no/such/folder", "no folder"),
    ):
        with pytest.raises(am.SurveyError, match=said):
            am.survey(one, postures, store=tmp_path / where)
    assert (tmp_path / "folder" / "thesis.txt").read_text() == "do not lose me"
    assert (tmp_path / "file").read_text() == "nor me"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder", "map.zarr"]


def test_a_map_too_large_for_the_disk_says_how_large_before_it_starts(tmp_path: Path) -> None:
    huge = am.Grid({f"link_{i}.z": np.linspace(0, 1, 9000) for i in (2, 3, 4)}, base="c8")
    with pytest.raises(am.SurveyError, match=r"729000000000 postures that needs .* GB"):
        am.survey(am.load("scompi"), huge, store=tmp_path / "map.zarr")
    assert list(tmp_path.iterdir()) == []


def test_memory_stays_bounded_while_a_map_streams(tmp_path: Path) -> None:
    code = (
        "import numpy as np, armonic as am\n"
        "axes = {'link_2.z': np.linspace(-0.5, 0.5, 500), 'link_3.z': np.linspace(1, 2, 600)}\n"
        f"am.survey(am.load('scompi'), am.Grid(axes, base='c8'), store={str(tmp_path / 'map.zarr')!r}, shapes=True)\n"
    )
    # By way of a small process, for Linux counts the memory of who started a process as its own.
    small = (
        "import resource, subprocess, sys\n"
        "subprocess.run([sys.executable, '-c', sys.argv[1]], check=True)\n"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    command = [sys.executable, "-c", small, code]
    peak = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    # 300 000 postures with shapes are 1.2 GB; ru_maxrss is in KiB.
    assert peak * 1024 < 1e9
