"""Time series come back from their files; files of other programs are read; damaged ones are refused by place."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
import xarray as xr
from scipy.io import loadmat, savemat

from armonic.errors import DataFileError, SignalError
from armonic.files.series_files import read_series, write_series
from armonic.series import QUANTITIES, Channel, TimeSeries
from frf_files import units, write_sets

UNITS = {"force": "N", "acceleration": "m/s²", "motor_torque": "N·m", "signal": "", "motor_position": "rad"}
RATE, START = 44100.1, 0.2060000000000001  # neither has a short decimal step


def series(samples: int = 301, *, odd: bool = False) -> TimeSeries:
    """A channel of every quantity; `odd` adds names and notes that not every format has room for."""
    generator = np.random.default_rng(3)
    channels = [Channel(f"link_{k}.z", quantity, UNITS.get(quantity, "")) for k, quantity in enumerate(QUANTITIES)]
    if odd:
        channels += [Channel('Messstelle "ä", Achse (x)', "signal", "m/s² [rms]"), Channel("a:b", "power", "")]
    values = generator.normal(size=(samples, len(channels))) * 10.0 ** generator.integers(-12, 12, len(channels))
    return TimeSeries(values, RATE, tuple(channels), START, {"robot": "Scompi", "posture": "c8, «milled»"})


def same(a: TimeSeries, b: TimeSeries) -> None:
    assert (a.channels, a.sample_rate_hz, a.start_s) == (b.channels, b.sample_rate_hz, b.start_s)
    np.testing.assert_array_equal(a.values, b.values)


@pytest.mark.parametrize("name", ["s.csv", "s.mat", "s.zarr"])
def test_a_series_comes_back_bit_for_bit(tmp_path: Path, name: str) -> None:
    kept = series(odd=True)
    write_series(tmp_path / name, kept)
    again = read_series(tmp_path / name)
    same(again, kept)
    assert again.notes == kept.notes


@pytest.mark.parametrize("samples", [1, 2, 5])
@pytest.mark.parametrize("name", ["s.csv", "s.mat", "s.zarr", "s.uff"])
def test_even_a_few_samples_come_back(tmp_path: Path, name: str, samples: int) -> None:
    kept = series(samples).with_values(np.full((samples, len(QUANTITIES)), 0.5))
    write_series(tmp_path / name, kept)
    same(read_series(tmp_path / name), kept)


def test_universal_files_keep_13_digits_in_text_and_every_bit_in_binary(tmp_path: Path) -> None:
    kept = series()
    write_series(tmp_path / "t.uff", kept)
    write_series(tmp_path / "b.unv", kept, binary=True)
    same(read_series(tmp_path / "b.unv"), kept)
    again = read_series(tmp_path / "t.uff")
    assert (again.channels, again.sample_rate_hz, again.start_s) == (kept.channels, RATE, START)
    # One digit ahead of the point and 12 behind: half a unit of the last.
    np.testing.assert_allclose(again.values, kept.values, rtol=5.001e-13, atol=0)


@pytest.mark.parametrize("name", ["s.csv", "s.mat", "s.zarr", "s.uff"])
def test_values_that_are_not_finite_are_kept(tmp_path: Path, name: str) -> None:
    values = np.ones((4, 2))
    values[:, 0], values[2, 1], values[3, 1] = np.nan, np.inf, -np.inf
    kept = TimeSeries(values, 8.0, (Channel("a", "signal"), Channel("b", "force", "N")))
    write_series(tmp_path / name, kept)
    same(read_series(tmp_path / name), kept)


@pytest.mark.parametrize("binary", [False, True])
def test_another_library_reads_our_universal_file(tmp_path: Path, binary: bool) -> None:
    kept = series().select("acceleration", "force")
    write_series(tmp_path / "s.uff", kept, binary=binary)
    sets = [s for s in pyuff.UFF(str(tmp_path / "s.uff")).read_sets() if s["type"] == 58]
    assert [s["func_type"] for s in sets] == [1, 1]
    assert [s["ordinate_spec_data_type"] for s in sets] == [12, 13]  # acceleration, excitation force
    assert [s["rsp_dir"] for s in sets] == [3, 3]
    for k, found in enumerate(sets):
        np.testing.assert_allclose(found["data"], kept.values[:, k], rtol=1e-12)
        # A step of 11 columns: 1e-6 of it.
        np.testing.assert_allclose(np.diff(found["x"]), 1 / RATE, rtol=2e-6)


def foreign_uff(path: Path, first: tuple[dict[str, Any], ...] = (), **fields: Any) -> Path:
    """Time records of another library's writer: node 3, +x and -rz."""
    time = np.arange(64) / 256
    sets = list(first)
    for direction, number, unit in ((1, 12, "m/s^2"), (-6, 8, "rad")):
        record: dict[str, Any] = {
            "binary": 0, "func_type": 1, "rsp_node": 3, "rsp_dir": direction, "ref_node": 0, "ref_dir": 0,
            "data": np.sin(40 * direction * time), "x": time, "id1": "run", "rsp_ent_name": "NONE",
            "abscissa_spec_data_type": 17, "ordinate_spec_data_type": number, "ordinate_axis_units_lab": unit,
            "orddenom_spec_data_type": 0, "abscissa_spacing": 1, "abscissa_inc": 1 / 256, "abscissa_min": 0.0,
            "ord_data_type": 4, "num_pts": 64, "abscissa_axis_units_lab": "s",
        }  # fmt: skip
        sets.append(pyuff.prepare_58(**{**record, **fields}))
    return write_sets(path, sets)


@pytest.mark.parametrize("binary", [0, 1])
def test_time_records_of_another_library_are_read_with_their_directions_and_units(tmp_path: Path, binary: int) -> None:
    found = read_series(foreign_uff(tmp_path / "f.uff", binary=binary))
    assert found.channels == (
        Channel("node_3.x", "acceleration", "m/s²"),
        Channel("node_3.rz", "displacement", "rad"),
    )
    assert found.sample_rate_hz == 256
    time = np.arange(64) / 256
    # pyuff writes 12 digits; the second record runs along -rz, and so turns its sign.
    np.testing.assert_allclose(found.values, np.column_stack([np.sin(40 * time), np.sin(240 * time)]), atol=1e-11)


def test_a_universal_file_in_millimetres_is_read_in_metres_and_in_g_stays_in_g(tmp_path: Path) -> None:
    found = read_series(foreign_uff(tmp_path / "f.uff", (units(1000.0, 1.0),), ordinate_axis_units_lab="mm/s^2"))
    assert found.channels[0].unit == "m/s²"
    assert found["node_3.x"][1] == pytest.approx(np.sin(40 / 256) / 1000, abs=1e-12)
    found = read_series(foreign_uff(tmp_path / "f.uff", ordinate_axis_units_lab="g"))
    assert (found.channels[0].unit, found["node_3.x"][1]) == ("g", pytest.approx(np.sin(40 / 256), abs=1e-11))


def test_universal_records_of_different_length_or_rate_are_refused_with_both_names(tmp_path: Path) -> None:
    short = series(20).select("force")
    long = series(30).select("acceleration")
    write_series(tmp_path / "a.uff", short)
    write_series(tmp_path / "b.uff", long)
    both = (tmp_path / "a.uff").read_bytes() + (tmp_path / "b.uff").read_bytes()
    (tmp_path / "c.uff").write_bytes(both)
    with pytest.raises(DataFileError, match=r"acceleration:link_7.z of 30 samples .* expected 20 .*as force:link_10.z"):
        read_series(tmp_path / "c.uff")
    write_series(
        tmp_path / "b.uff", long.window(stop_s=START + 19 / RATE).with_values(np.ones((20, 1)), sample_rate_hz=9)
    )
    (tmp_path / "c.uff").write_bytes((tmp_path / "a.uff").read_bytes() + (tmp_path / "b.uff").read_bytes())
    with pytest.raises(DataFileError, match="at 9 Hz"):
        read_series(tmp_path / "c.uff")
    (tmp_path / "c.uff").write_bytes(2 * (tmp_path / "a.uff").read_bytes())
    with pytest.raises(DataFileError, match=r"line \d+: found force:link_10.z again"):
        read_series(tmp_path / "c.uff")


def test_xarray_opens_our_folder(tmp_path: Path) -> None:
    kept = series()
    write_series(tmp_path / "s.zarr", kept)
    found = xr.open_zarr(tmp_path / "s.zarr", consolidated=False)
    assert found["values"].dims == ("time", "channel")
    assert tuple(found["channel"].values) == kept.labels
    np.testing.assert_array_equal(found["time"].values, kept.time_s)
    np.testing.assert_array_equal(found["values"].sel(channel="force:link_10.z").values, kept["force"])


def test_matlab_finds_plain_variables(tmp_path: Path) -> None:
    kept = series()
    write_series(tmp_path / "s.mat", kept)
    found = loadmat(tmp_path / "s.mat")
    np.testing.assert_array_equal(found["values"], kept.values)
    np.testing.assert_array_equal(found["t"].ravel(), kept.time_s)
    assert found["names"].shape == (len(QUANTITIES), 1)
    assert found["names"][9, 0].item() == "link_9.z"


FOREIGN = np.arange(24.0).reshape(12, 2)
TIME = np.arange(12) / 200


@pytest.mark.parametrize(
    "content",
    [
        {"t": TIME, "y": FOREIGN},
        {"Time": TIME[:, None], "y": FOREIGN.T},
        {"fs": 200.0, "y": FOREIGN},
        {"dt": 0.005, "y": FOREIGN, "comment": "a word"},
    ],
)
def test_a_foreign_matlab_file_is_read_by_the_usual_names(tmp_path: Path, content: dict[str, Any]) -> None:
    savemat(tmp_path / "f.mat", content)
    found = read_series(tmp_path / "f.mat")
    assert (found.labels, found.sample_rate_hz) == (("signal:y_1", "signal:y_2"), 200)
    np.testing.assert_array_equal(found.values, FOREIGN)


def test_vectors_of_a_foreign_matlab_file_become_channels(tmp_path: Path) -> None:
    savemat(tmp_path / "f.mat", {"t": TIME, "acc": FOREIGN[:, 0], "enc": FOREIGN[:, 1]})
    assert read_series(tmp_path / "f.mat").labels == ("signal:acc", "signal:enc")


def test_a_foreign_matlab_file_with_two_matrices_asks_which(tmp_path: Path) -> None:
    savemat(tmp_path / "f.mat", {"clock": TIME, "u": FOREIGN, "y": 2 * FOREIGN})
    with pytest.raises(DataFileError, match=r"found clock 1x12, u 12x2, y 12x2, expected one matrix .* variable="):
        read_series(tmp_path / "f.mat", sample_rate_hz=200)
    found = read_series(tmp_path / "f.mat", variable="y", time_variable="clock")
    assert (found["y_2"][1], found.sample_rate_hz) == (6, 200)


def test_loading_a_matlab_file_with_objects_runs_nothing_and_reads_the_numbers(tmp_path: Path) -> None:
    struct = {"f": np.array(["__import__('os').abort()"], dtype=object), "g": 1}
    savemat(tmp_path / "f.mat", {"t": TIME, "y": FOREIGN, "s": struct})
    assert len(read_series(tmp_path / "f.mat")) == 12


@pytest.mark.parametrize(
    ("text", "labels", "rate"),
    [
        ("t,a (m/s^2),force:tool.x (N)\n0,1,2\n0.5,3,4\n", ("acceleration:a", "force:tool.x"), 2),
        ("Time [ms];a;b [N]\n0;1,5;2\n500;3,5;4\n", ("signal:a", "force:b"), 2),
        ("# a comment\ntime_s\tx y\n0\t1\n0.5\tnan\n", ("signal:x y",), 2),
        ("timestamp,a,b\r\n10,1,2\r\n10.5,3,4\r\n", ("signal:a", "signal:b"), 2),
    ],
)
def test_tables_of_other_programs_are_read(tmp_path: Path, text: str, labels: tuple[str, ...], rate: float) -> None:
    (tmp_path / "f.csv").write_bytes(text.encode())
    found = read_series(tmp_path / "f.csv")
    assert (found.labels, found.sample_rate_hz, len(found)) == (labels, rate, 2)


def test_a_table_of_numbers_alone_is_read_if_the_rate_is_given(tmp_path: Path) -> None:
    (tmp_path / "f.csv").write_text("1,2\n3,4\n5,6\n")
    with pytest.raises(DataFileError, match=r"no times and no sampling rate.* Say it with sample_rate_hz="):
        read_series(tmp_path / "f.csv")
    found = read_series(tmp_path / "f.csv", sample_rate_hz=50)
    assert (found.labels, found.sample_rate_hz, found["column_2"].tolist()) == (
        ("signal:column_1", "signal:column_2"), 50, [2, 4, 6],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "an empty file"),
        ("t,a\n", "a header and no sample"),
        ("t,a\n0,1\n1,2", "line 3: found the end of the file within the line"),
        ("t,a\n0,1\n1\n", "line 3: found 1 values, expected 2"),
        ("t,a\n0,1\n1,x\n", "line 3: found 'x' for a, expected a number"),
        ("t,a\n0,1\n1,\n", "line 3: .*Write nan where a value is missing"),
        ("t,a\n0,1\n1,2\n1,3\n", "line 4: found 1 s at index 2 after 1 s, expected times that increase"),
        ("t,a\n0,1\n1,2\nnan,3\n", "line 4: found nan at index 2"),
        ("t,a\n0,1\n1,2\n3,3\n4,3\n5,3\n", "line 4: found uneven steps"),
        ("t,a\n0,1\n", "two samples or more"),
        ("t\n0\n1\n", "times alone"),
        ("t,a,a\n0,1,1\n1,2,2\n", "signal:a twice"),
        ('# armonic series {"sample_rate_hz": 9}\nt,a\n0,1\n1,2\n', "expected a comment such as"),
        (
            '# armonic series {"sample_rate_hz": 9.0, "start_s": 0.0, "samples": 3, "notes": {}}\n'
            "time (s),force:a (N)\n0,1\n1,2\n2,2\n",
            "times that say 1 Hz and a sampling rate of 9 Hz",
        ),
    ],
)
def test_a_damaged_table_is_refused_by_its_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(DataFileError, match=message):
        read_series(tmp_path / "f.csv")


@pytest.mark.parametrize("name", ["s.csv", "s.mat", "s.zarr", "s.uff"])
def test_a_rate_that_contradicts_the_file_is_refused(tmp_path: Path, name: str) -> None:
    write_series(tmp_path / name, series())
    with pytest.raises(DataFileError, match=r"found a sampling rate of 44100.1 Hz, expected 1000 Hz"):
        read_series(tmp_path / name, sample_rate_hz=1000)
    assert read_series(tmp_path / name, sample_rate_hz=44100).sample_rate_hz == RATE
    with pytest.raises(SignalError, match="sample_rate_hz"):
        read_series(tmp_path / name, sample_rate_hz=-1)


@pytest.mark.parametrize("name", ["s.csv", "s.mat", "s.uff"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.7, 0.999])
def test_a_truncated_file_is_refused(tmp_path: Path, name: str, share: float) -> None:
    write_series(tmp_path / name, series(50))
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(share * len(data))].rstrip(b"\n"))
    with pytest.raises(DataFileError):
        read_series(tmp_path / name)


def test_a_table_of_ours_cut_off_between_two_lines_is_refused(tmp_path: Path) -> None:
    write_series(tmp_path / "s.csv", series(50))
    lines = (tmp_path / "s.csv").read_text("utf-8").splitlines(keepends=True)
    (tmp_path / "s.csv").write_text("".join(lines[:-3]), "utf-8")
    with pytest.raises(DataFileError, match="found 47 samples, expected 50, as its comment says"):
        read_series(tmp_path / "s.csv")


def test_a_folder_that_lost_a_chunk_is_refused_instead_of_read_with_gaps(tmp_path: Path) -> None:
    kept = TimeSeries(np.ones((300_000, 1)), 1.0, (Channel("a", "force", "N"),))
    write_series(tmp_path / "s.zarr", kept)
    (tmp_path / "s.zarr" / "values" / "c" / "1" / "0").unlink()
    with pytest.raises(DataFileError, match="1 of 3 chunks missing"):
        read_series(tmp_path / "s.zarr")
    shutil.rmtree(tmp_path / "s.zarr" / "values")
    with pytest.raises(DataFileError, match="a damaged folder"):
        read_series(tmp_path / "s.zarr")


def test_a_folder_is_replaced_only_if_it_holds_a_time_series(tmp_path: Path) -> None:
    write_series(tmp_path / "s.zarr", series(4))
    write_series(tmp_path / "s.zarr", series(9))
    assert len(read_series(tmp_path / "s.zarr")) == 9
    (tmp_path / "o.zarr").mkdir()
    (tmp_path / "o.zarr" / "precious").write_text("x")
    with pytest.raises(DataFileError, match="something else there"):
        write_series(tmp_path / "o.zarr", series(4))
    xr.Dataset({"a": ("x", [1.0])}).to_zarr(tmp_path / "x.zarr", consolidated=False)
    with pytest.raises(DataFileError, match="something else there"):
        write_series(tmp_path / "x.zarr", series(4))
    with pytest.raises(DataFileError, match="a Zarr group of something else"):
        read_series(tmp_path / "x.zarr")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["o.zarr", "s.zarr", "x.zarr"]  # and no drafts


@pytest.mark.parametrize("name", ["s.csv", "s.mat", "s.zarr", "s.uff"])
def test_what_cannot_be_read_or_written_says_so(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataFileError):
        read_series(tmp_path / name)
    with pytest.raises(DataFileError, match="a folder that exists"):
        write_series(tmp_path / "nowhere" / name, series(4))
    with pytest.raises(SignalError, match="wrong="):
        read_series(tmp_path / name, wrong=1)
    with pytest.raises(SignalError, match="wrong="):
        write_series(tmp_path / name, series(4), wrong=1)
    with pytest.raises(DataFileError, match=r"expected one of \.zarr, \.uff"):
        read_series(tmp_path / "s.dat")
    assert not list(tmp_path.iterdir())


def test_a_name_that_a_universal_file_has_no_room_for_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match="Write it as CSV, MATLAB or Zarr"):
        write_series(tmp_path / "s.uff", series(4, odd=True))
    with pytest.raises(DataFileError, match="units without a blank and a bracket"):
        write_series(tmp_path / "s.csv", TimeSeries(np.ones((2, 1)), 1, (Channel("a", "force", "N (peak)"),)))
    assert not list(tmp_path.iterdir())


def test_matlab_files_of_version_7_3_name_the_way_out(tmp_path: Path) -> None:
    (tmp_path / "f.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    with pytest.raises(DataFileError, match="'-v7'"):
        read_series(tmp_path / "f.mat")


def test_universal_files_without_time_records_say_what_they_hold() -> None:
    frf = Path(__file__).parents[1] / "python" / "armonic" / "examples" / "kuka_milling.uff"
    with pytest.raises(DataFileError, match=r"of 58 of function type 4 \(FRF\).*expected time records"):
        read_series(frf)
