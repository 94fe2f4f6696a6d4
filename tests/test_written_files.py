"""Files we write: other programs read them, they come back as they were, and none is left half-written."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import pyuff
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import armonic as am
from armonic.errors import DataFileError, FrfError
from armonic.files import read_csv, read_frf, read_uff, write_csv, write_frf, write_uff
from armonic.response import KINDS, Frf, Kind
from frf_files import (
    EVEN_HZ,
    OUR_TEXT,
    UNEVEN_HZ,
    assert_same,
    measured,
    save,
)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("freq_hz", [EVEN_HZ, UNEVEN_HZ, np.linspace(10, 200, 152)], ids=["even", "uneven", "thirds"])
def test_what_we_write_pyuff_reads(tmp_path: Path, binary: bool, freq_hz: NDArray[np.float64]) -> None:
    frf = measured(freq_hz)
    write_uff(tmp_path / "a.uff", frf, node=42, binary=binary, name="KR90")
    header, stated, *functions = pyuff.UFF(str(tmp_path / "a.uff")).read_sets()
    assert (header["type"], header["model_name"]) == (151, "KR90")
    assert (stated["type"], stated["units_code"], stated["length"], stated["force"]) == (164, 1, 1.0, 1.0)
    assert len(functions) == 6
    for function in functions:
        assert (function["type"], function["func_type"], function["ord_data_type"]) == (58, 4, 6)
        assert (function["rsp_node"], function["ref_node"], function["binary"]) == (42, 42, int(binary))
        types = ("abscissa_spec_data_type", "ordinate_spec_data_type", "orddenom_spec_data_type")
        assert [function[key] for key in types] == [18, 12, 13]
        labels = ("abscissa_axis_units_lab", "ordinate_axis_units_lab", "orddenom_axis_units_lab")
        assert [function[key] for key in labels] == ["Hz", "m/s^2", "N"]
        assert function["num_pts"] == freq_hz.size
        if binary:
            assert function["n_bytes"] == freq_hz.size * 8 * (2 if function["abscissa_spacing"] else 3)
        np.testing.assert_allclose(function["x"], freq_hz, rtol=1e-9)
        expected = frf.values[:, function["rsp_dir"] - 1, (function["ref_dir"] - 1) // 2]
        np.testing.assert_allclose(function["data"], expected, rtol=0 if binary else OUR_TEXT)
    assert functions[0]["abscissa_spacing"] == (0 if freq_hz is UNEVEN_HZ else 1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("freq_hz", [EVEN_HZ, UNEVEN_HZ, np.array([3.0]), np.array([0.0, 1e-3, 5e4])])
def test_a_universal_file_comes_back_as_it_was(
    tmp_path: Path, kind: Kind, binary: bool, freq_hz: NDArray[np.float64]
) -> None:
    values = measured(freq_hz).values + 1e-3  # nowhere zero
    frf = Frf(freq_hz, values, kind, ("x", "y", "rz"), ("z", "ry"), "milling spindle")
    write_uff(tmp_path / "a.uff", frf, binary=binary)
    assert_same(read_uff(tmp_path / "a.uff"), frf, 0 if binary else OUR_TEXT)
    assert read_uff(tmp_path / "a.uff", frame="other").frame == "other"


def test_text_of_a_universal_file_stays_within_its_columns(tmp_path: Path) -> None:
    values = np.array([1.0, -1e-300j, -1e300 - 1e-99j])[:, None, None]
    frf = Frf(np.array([0.0, 1e-7, 123456.789012]), values, "mobility", ("x",), ("x",))
    write_uff(tmp_path / "a.uff", frf, name="long " * 50 + "\n    -1\n")
    assert max(map(len, (tmp_path / "a.uff").read_text("ascii").splitlines())) <= 80
    np.testing.assert_allclose(read_uff(tmp_path / "a.uff").values, values, rtol=OUR_TEXT)
    np.testing.assert_allclose(pyuff.UFF(str(tmp_path / "a.uff")).read_sets(2)["data"], values[:, 0, 0], rtol=OUR_TEXT)


@pytest.mark.parametrize(("frame", "noted"), [("tool tip", "tool tip"), ("Fräser", None), ("t" * 90, None)])
def test_the_frame_is_noted_in_a_universal_file_whole_or_not_at_all(
    tmp_path: Path, frame: str, noted: str | None
) -> None:
    write_uff(tmp_path / "a.uff", measured(frame=frame))
    assert read_uff(tmp_path / "a.uff").frame == noted


def test_frequencies_too_close_for_text_are_refused_and_kept_in_binary(tmp_path: Path) -> None:
    frf = measured(np.array([100.0, 100.00000000001, 100.5]))
    with pytest.raises(DataFileError, match="binary=True"):
        write_uff(tmp_path / "a.uff", frf)
    assert list(tmp_path.iterdir()) == []
    write_uff(tmp_path / "a.uff", frf, binary=True)
    np.testing.assert_array_equal(read_uff(tmp_path / "a.uff").freq_hz, frf.freq_hz)


def test_axes_and_nodes_without_a_place_in_the_format_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FrfError, match="found tip"):
        write_uff(tmp_path / "a.uff", Frf(EVEN_HZ, measured().values, "mobility", ("x", "y", "tip"), ("x", "z")))
    for node in (0, -1, 10**10):
        with pytest.raises(FrfError, match="node"):
            write_uff(tmp_path / "a.uff", measured(), node=node)
    assert list(tmp_path.iterdir()) == []


def test_the_written_table_is_plain(tmp_path: Path) -> None:
    values = np.array([[[1 + 2j, 0.1]], [[-1e-9j, 3e20]]])
    write_csv(tmp_path / "a.csv", Frf(np.array([0.5, 10.0]), values, "accelerance", ("y",), ("x", "y"), "sensor"))
    assert (tmp_path / "a.csv").read_bytes().decode() == (
        "# armonic frf kind=accelerance frame=sensor\n"
        "freq_hz,y/x re,y/x im,y/y re,y/y im\n"
        "0.5,1.0,2.0,0.1,0.0\n"
        "10.0,-0.0,-1e-09,3e+20,0.0\n"
    )


finite = st.floats(allow_nan=False, allow_infinity=False)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(
    freq_hz=st.lists(st.floats(0, 1e300), min_size=1, max_size=4, unique=True).map(sorted),
    numbers=st.lists(finite, min_size=16, max_size=16),
    kind=st.sampled_from(KINDS),
    frame=st.none() | st.just("tool tip"),
)
def test_a_table_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    freq_hz: list[float],
    numbers: list[float],
    kind: Kind,
    frame: str | None,
) -> None:
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    values = np.array(numbers).view(np.complex128).reshape(-1, 2, 1)[: len(freq_hz)]
    values = np.concatenate([values] * 2)[: len(freq_hz)]
    frf = Frf(np.array(freq_hz), values, kind, ("z", "tip"), ("x",), frame)
    write_csv(path, frf)
    assert_same(read_csv(path), frf, 0, freq_tolerance=0)


def test_labels_that_would_break_the_table_are_refused(tmp_path: Path) -> None:
    for label in ("a b", "a,b", "a/b", 'a"b', "a\n"):
        with pytest.raises(FrfError, match="without blanks"):
            write_csv(tmp_path / "a.csv", Frf([1.0], np.ones((1, 1, 1)), "mobility", (label,), ("x",)))  # type: ignore[arg-type]
    with pytest.raises(FrfError, match="one line"):
        write_csv(tmp_path / "a.csv", measured(frame="a\nb"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.uff", "a.unv", "a.uf58", "a.csv", "A.UFF"])
def test_the_ending_picks_the_format(tmp_path: Path, name: str) -> None:
    write_frf(tmp_path / name, measured())
    first = (tmp_path / name).read_bytes()[:6]
    assert first == (b"# armo" if name.endswith("csv") else b"    -1")
    assert_same(read_frf(str(tmp_path / name)), measured(), OUR_TEXT)
    assert read_frf(tmp_path / name, frame="flange").frame == "flange"


@pytest.mark.parametrize("name", ["a.xlsx", "a"])
def test_an_unknown_ending_is_an_error_that_lists_the_known_ones(tmp_path: Path, name: str) -> None:
    for use in (lambda: read_frf(tmp_path / name), lambda: write_frf(tmp_path / name, measured())):
        with pytest.raises(DataFileError, match=r"\.uff, \.unv, \.uf58, \.csv"):
            use()


@pytest.mark.parametrize("write", [write_uff, write_csv])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path, Frf], None]
) -> None:
    path = save(tmp_path / "a.uff", b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DataFileError, match=r"a\.uff: found a place that cannot be written \(No space left"):
        write(path, measured())
    assert [file.name for file in tmp_path.iterdir()] == ["a.uff"]
    assert path.read_bytes() == b"old"
    monkeypatch.undo()
    write(path, measured())
    assert [file.name for file in tmp_path.iterdir()] == ["a.uff"]
    assert path.stat().st_size > 1000


def test_a_place_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.uff").mkdir()
    for name in ("none/a.uff", "file/a.uff", "folder.uff", "bad\0name.uff"):
        with pytest.raises(DataFileError, match=r"expected (a folder that exists|the path of a file)"):
            write_uff(tmp_path / name, measured())
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder.uff"]


def test_nothing_is_printed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_frf(tmp_path / "a.uff", measured(), binary=True)
    read_frf(tmp_path / "a.uff")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.uff", "a.csv"])
def test_where_the_force_acted_comes_back(name: str, tmp_path: Path) -> None:
    values = np.ones((2, 1, 1), complex)
    across = Frf(np.array([1.0, 2.0]), values, "mobility", ("x",), ("y",), frame="tip", input_frame="elbow")
    write_frf(tmp_path / name, across)
    again = read_frf(tmp_path / name)
    assert (again.frame, again.input_frame) == ("tip", "elbow")


def test_a_force_at_a_place_that_a_file_cannot_name_is_not_forgotten(tmp_path: Path) -> None:
    across = Frf(np.array([1.0]), np.ones((1, 1, 1), complex), "mobility", ("x",), ("y",), "tip", "an elbow, left" * 9)
    for name in ("a.uff", "a.csv"):
        with pytest.raises(FrfError, match="input_frame"):
            write_frf(tmp_path / name, across)
        assert not (tmp_path / name).exists()


def test_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(DataFileError, match="a device or a pipe"):
        write_frf(tmp_path / "pipe.csv", Frf(np.array([1.0]), np.ones((1, 1, 1), complex), "mobility", ("x",), ("x",)))
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    with pytest.raises(DataFileError):
        write_frf(tmp_path / "loop.csv", Frf(np.array([1.0]), np.ones((1, 1, 1), complex), "mobility", ("x",), ("x",)))


def test_threads_may_save_one_file_at_once_and_nobody_finds_half_of_it(tmp_path: Path) -> None:
    robot = am.load("kuka_kr90")

    def work(_: int) -> bool:
        robot.save(tmp_path / "same.yaml")
        return am.load(tmp_path / "same.yaml").name == robot.name

    with ThreadPoolExecutor(6) as pool:
        assert all(pool.map(work, range(60)))
    assert [path.name for path in tmp_path.iterdir()] == ["same.yaml"]
