"""What makes a survey impossible is said in one line, before anything is computed, and harms nothing."""

from __future__ import annotations

import errno
import gc
import os
import shutil
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.surveying import chunks, running
from models import robot_of, spring

FINE = {"link_2.z": (0.0, 1.0)}
# postures, further arguments, what is named, part of what was found
FAULTS = {
    "path": ("tabel", {}, "posture", "'tabel'"),
    "posture": (["c1", "c9x"], {}, "posture", "'c9x'"),
    "coordinate": ({"link_9.z": 0.0}, {}, "posture", "'link_9.z'"),
    "nan": (np.full((3, 6), np.nan), {}, "postures, row 0", "not finite"),
    "one nan": ([0, 0, 0, np.nan, 0, 0], {}, "link_4.z", "nan"),
    "nan in a list": ([[0, 0, 0, 0, 0, 0], [0, 0, np.inf, 0, 0, 0]], {}, "link_3.z", "inf"),
    "width": (np.zeros((4, 5)), {}, "posture", "5 values"),
    "width of a list": ([[0] * 7] * 2, {}, "posture", "7 values"),
    "width of one": ([0] * 5, {}, "posture", "0"),
    "no width": (np.zeros((4, 0)), {}, "posture", "0 values"),
    "nothing": ([], {}, "postures", "an empty list"),
    "no rows": (np.zeros((0, 6)), {}, "postures", "an empty list"),
    "a cube": (np.zeros((2, 6, 2)), {}, "postures", "2 x 6 x 2"),
    "none": (None, {}, "postures", "NoneType"),
    "number": (7, {}, "postures", "int"),
    "object": (object(), {}, "postures", "object"),
    "texts": (np.array([["a"] * 6] * 2), {}, "link_1.tz", "'a'"),
    "complex": (np.zeros((2, 6), complex), {}, "link_1.tz", "0j"),
    "unit": (["10 kg", 0, 0, 0, 0, 0], {}, "link_1.tz", "10 kg"),
    "grid name": (am.Grid({"link_9.z": [0, 1]}), {}, "grid", "'link_9.z'"),
    "grid empty": (am.Grid({}), {}, "grid", "{}"),
    "grid no values": (am.Grid({"link_2.z": []}), {}, "grid, link_2.z", "[]"),
    "grid nan": (am.Grid({"link_2.z": [0, np.nan]}), {}, "grid, link_2.z", "nan"),
    "grid number": (am.Grid({"link_2.z": 1.0}), {}, "grid, link_2.z", "1.0"),
    "grid table": (am.Grid({"link_2.z": [[0, 1]]}), {}, "grid, link_2.z", "[[0, 1]]"),
    "grid ragged": (am.Grid({"link_2.z": [[0, 1], [0]]}), {}, "grid, link_2.z", "[[0, 1], [0]]"),
    "grid list": (am.Grid([0, 1]), {}, "grid", "[0, 1]"),
    "grid of nothing": (am.Grid(None), {}, "grid", "None"),
    "grid base": (am.Grid({"link_2.z": [0, 1]}, base="c9x"), {}, "posture", "'c9x'"),
    "sample kind": (am.Sample(FINE, 10, kind="halton"), {}, "sample", "'halton'"),
    "sample none": (am.Sample(FINE, 0), {}, "sample", "count of 0"),
    "sample half": (am.Sample(FINE, 10.5), {}, "sample", "count of 10.5"),
    "sample bool": (am.Sample(FINE, True), {}, "sample", "count of True"),
    "sample too many": (am.Sample(FINE, 10**9), {}, "sample", "count of 1000000000"),
    "sample empty": (am.Sample({}, 10), {}, "sample", "{}"),
    "sample list": (am.Sample([1], 10), {}, "sample", "[1]"),
    "sample name": (am.Sample({"link_9.z": (0, 1)}, 10), {}, "sample", "'link_9.z'"),
    "sample turned": (am.Sample({"link_2.z": (1, 0)}, 10), {}, "sample, link_2.z", "(1, 0)"),
    "sample one end": (am.Sample({"link_2.z": (1,)}, 10), {}, "sample, link_2.z", "(1,)"),
    "sample number": (am.Sample({"link_2.z": 1.0}, 10), {}, "sample, link_2.z", "1.0"),
    "sample text": (am.Sample({"link_2.z": ("a", "b")}, 10), {}, "sample, link_2.z", "'a'"),
    "sample endless": (am.Sample({"link_2.z": (0, np.inf)}, 10), {}, "sample, link_2.z", "inf"),
    "sample seed": (am.Sample(FINE, 10, seed=-1), {}, "sample", "seed -1"),
    "sample seed text": (am.Sample(FINE, 10, seed="x"), {}, "sample", "seed 'x'"),
    "sample base": (am.Sample(FINE, 10, base=[1]), {}, "posture", "1 values"),
    "sweep path": ("c8", {"sweep": {"control.kq": [1, 2]}}, "parameters", "'control.kq'"),
    "sweep lengths": ("c8", {"sweep": {"control.kp": [1, 2], "control.kd": [1, 2, 3]}}, "sweep", "3 values"),
    "sweep empty": ("c8", {"sweep": {"control.kp": []}}, "sweep, control.kp", "[]"),
    "sweep number": ("c8", {"sweep": {"control.kp": 3.0}}, "sweep, control.kp", "3.0"),
    "sweep nan": ("c8", {"sweep": {"control.kp": [1, np.nan]}}, "sweep, control.kp", "nan"),
    "sweep list": ("c8", {"sweep": [1]}, "sweep", "[1]"),
    "sweep text": ("c8", {"sweep": "control.kp"}, "sweep", "'control.kp'"),
    "sweep key": ("c8", {"sweep": {3: [1, 2]}}, "sweep", "{3: [1, 2]}"),
    "sweep from no integral": ("c8", {"sweep": {"control.ki": [0, 1, 2]}}, "control.ki", "zero among values"),
    "sweep negative mass": ("table", {"sweep": {"tool.mass": [0, 1, -1, 2]}}, "tool.mass", "-1"),
    "sweep no inertia": ("table", {"sweep": {"links.link_2.drive.rotor_inertia": [1e-4, 0]}}, "rotor_inertia", "0"),
    "no threads": ("table", {"threads": 0}, "threads", "0"),
    "negative threads": ("table", {"threads": -1}, "threads", "-1"),
    "half a thread": ("table", {"threads": 2.5}, "threads", "2.5"),
    "too many threads": ("table", {"threads": 10**6}, "threads", "1000000"),
    "threads yes": ("table", {"threads": True}, "threads", "True"),
    "wrench without frame": ("table", {"wrench": [1.0] * 6}, "frame", "nothing"),
    "frame without wrench": ("table", {"frame": "link_6"}, "frame", "without a wrench"),
    "short wrench": ("table", {"wrench": [1.0] * 3, "frame": "link_6"}, "wrench", "[1.0, 1.0, 1.0]"),
    "wrench nan": ("table", {"wrench": [np.nan] * 6, "frame": "link_6"}, "wrench", "nan"),
    "wrench frame": ("table", {"wrench": [1.0] * 6, "frame": "link_7"}, "frame", "'link_7'"),
    "wrench axes": (
        "table",
        {"wrench": [1.0] * 6, "frame": "link_6", "wrench_axes": "tool"},
        "wrench_axes",
        "'tool'",
    ),
    "client": ("table", {"client": 5}, "client", "5"),
}


@pytest.mark.parametrize(("postures", "rest", "where", "found"), FAULTS.values(), ids=FAULTS)
def test_bad_surveys_are_refused_in_one_line(postures, rest, where, found, monkeypatch, tmp_path):
    monkeypatch.setattr(running, "compute", None)  # nothing is computed
    with pytest.raises(am.ArmonicError) as refusal:
        am.survey(am.load("scompi"), postures, store=tmp_path / "map.zarr", **rest)
    assert where in refusal.value.where
    assert found in refusal.value.found
    assert "\n" not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("through", "points", "found"),
    [
        (["c1"], 5, "1 postures and 5 points"),
        (["c1", "c8"], 1, "2 postures and 1 points"),
        (["c1", "c8"], -3, "-3 points"),
        (["c1", "c8"], 5.5, "5.5 points"),
        (["c1", "c8"], 10**15, "points"),
        (["c1", "c9x"], 5, "'c9x'"),
        ("c1", 5, "1 postures"),
        ([], 5, "0 postures"),
    ],
)
def test_bad_paths_are_refused(through, points, found):
    with pytest.raises(am.ArmonicError) as refusal:
        am.path(am.load("scompi"), through, points)
    assert found in refusal.value.found


def test_a_grid_too_large_says_how_large():
    axes = {f"link_{i}.z": np.linspace(0, 1, 1000) for i in (2, 3, 4, 5, 6)}
    with pytest.raises(am.SurveyError, match=r"1000 x 1000 x 1000 x 1000 x 1000 = 1e\+15 postures"):
        am.survey(am.load("scompi"), am.Grid(axes))
    fewer = am.Grid({name: axes[name] for name in list(axes)[:3]})
    # 12 modes: two poles, three numbers, mac, event and shares of six springs, and six bytes a posture.
    size = 1e9 * (12 * (2 * 16 + 3 * 8 + 4 + 1 + 6 * 4) + 6)
    with pytest.raises(am.SurveyError, match="1000000000 postures") as refusal:
        am.survey(am.load("scompi"), fewer)
    assert f"which need {size / 1e9:.3g} GB" in refusal.value.found
    assert "store" in (refusal.value.hint or "")


def test_a_map_that_does_not_fit_on_the_disk_is_refused_before_it_starts(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**6, 10**6 - 1000, 1000))
    with pytest.raises(am.SurveyError, match=r"50 postures that needs 5.13e-05 GB.* 1e-06 GB that are free"):
        am.survey(am.load("scompi"), "table", store=tmp_path / "map.zarr")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_becomes_full_is_named_and_the_survey_goes_on_later(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "POSTURES_PER_BLOCK", 16)
    monkeypatch.setattr(running, "FEWEST_PER_BLOCK", 1)
    robot, store, written = am.load("scompi"), tmp_path / "map.zarr", []
    write = chunks.write

    def full(path, values):
        written.append(path)
        if len(written) > 25:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, values)

    monkeypatch.setattr(chunks, "write", full)
    with pytest.raises(am.SurveyError, match=r"No space left on device.* goes on where it stopped"):
        am.survey(robot, "table", store=store, threads=1)
    monkeypatch.setattr(chunks, "write", write)
    done: list[int] = []
    found = am.survey(robot, "table", store=store, threads=1, progress=lambda now, _: done.append(now))
    assert 0 < done[0] < 50
    np.testing.assert_array_equal(found.pole, am.survey(robot, "table").pole)


def test_a_folder_that_may_not_be_written_is_refused(tmp_path, monkeypatch):
    def denied(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "rename", denied)  # a mode of the folder would not stop an administrator
    with pytest.raises(am.SurveyError, match="Permission denied"):
        am.survey(am.load("scompi"), "table", store=tmp_path / "map.zarr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("address", ["nonsense", "", "tcp://", "x://127.0.0.1:9", "tcp://127.0.0.1:9"])
def test_a_wrong_address_is_one_error_time_after_time(address, monkeypatch):
    monkeypatch.setattr(running, "CONNECTED_WITHIN", "500ms")
    for _ in range(2):
        with pytest.raises(am.SurveyError, match="no scheduler") as refusal:
            am.survey(am.load("scompi"), "table", client=address)
        assert "\n" not in str(refusal.value)
        del refusal
        gc.collect()  # nothing half made is left, which would wait for itself


def test_robots_that_have_no_modes_are_refused():
    rod = {"name": "a", "parent": "base", "joint": {"type": "revolute", "axis": "z"}, "mass": 1}
    with pytest.raises(am.ModelError, match="no coordinate with elasticity or drive"):
        am.survey(robot_of([rod]), [0])
    light = {"name": "b", "parent": "a", "joint": {"type": "revolute", "axis": "x"}, "mass": 0}
    held = [link | {"elasticity": {link["joint"]["axis"]: spring(1.0)}} for link in (rod, light)]
    with pytest.raises(am.ModelError, match="not positive definite"):
        am.survey(robot_of(held), [0, 0])
