"""Series of odd names, notes, values and times come back from their files too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armonic.errors import DataFileError, SignalError
from armonic.files.series_files import read_series, write_series
from armonic.series import Channel, TimeSeries

FORCE = Channel("tool.x", "force", "N")


@pytest.mark.parametrize("name", ["a;b", "a;b,c", 'x "y"; z', ";", "#;"])
def test_a_name_with_a_semicolon_comes_back_from_a_table(tmp_path: Path, name: str) -> None:
    kept = TimeSeries([[1.5, 2.0], [3.0, 4.0]], 2.0, (Channel(name, "signal", "a;b"), FORCE))
    write_series(tmp_path / "s.csv", kept)
    again = read_series(tmp_path / "s.csv")
    assert again.channels == kept.channels
    np.testing.assert_array_equal(again.values, kept.values)


WIDE = (-1e300, -1.7976931348623157e308, -5e-324, -2.5e-100, -9.9999999999999e99, -1e100, -9.9999999999999e-100)


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf, 1.0, -1.0])
@pytest.mark.parametrize("places", [1, 4, 7])
def test_numbers_of_long_exponents_beside_others_come_back_from_universal_text(
    tmp_path: Path, odd: float, places: int
) -> None:
    values = np.array([number for wide in WIDE for number in (odd, wide, wide, odd, -wide)] + places * [odd])
    kept = TimeSeries(values[:, None], 8.0, (FORCE,))
    write_series(tmp_path / "s.uff", kept)
    again = read_series(tmp_path / "s.uff")["force"]
    # One digit ahead of the point and 11 behind: half a unit of the last. 5e-324 is the smallest of all.
    np.testing.assert_allclose(again, values, rtol=5.001e-12, atol=0)
    text = [line for line in (tmp_path / "s.uff").read_text().splitlines() if "e" in line and len(line) % 20 == 0]
    assert all(line[k] == " " for line in text[-9:] for k in range(0, len(line), 20))


@pytest.mark.parametrize("file", ["s.csv", "s.mat", "s.zarr", "s.uff"])
@pytest.mark.parametrize(
    ("rate", "start"), [(1e6, 1.7e9), (44100.1, 1.7e9), (3e6, -1.7e9), (1e9, 1.7e9), (1e-3, 1e15), (7.0, -3.0)]
)
def test_a_clock_of_coarse_numbers_does_not_hinder_reading(
    tmp_path: Path, file: str, rate: float, start: float
) -> None:
    kept = TimeSeries(np.arange(90.0)[:, None], rate, (FORCE,), start)  # 1e9 Hz: many times alike
    write_series(tmp_path / file, kept)
    again = read_series(tmp_path / file)
    assert (again.sample_rate_hz, again.start_s) == (rate, start)
    np.testing.assert_array_equal(again.values, kept.values)
    with pytest.raises(DataFileError, match="expected 5 Hz, as sample_rate_hz says"):
        read_series(tmp_path / file, sample_rate_hz=5)


def test_times_that_contradict_the_rate_of_our_own_table_are_still_refused(tmp_path: Path) -> None:
    kept = TimeSeries(np.arange(90.0)[:, None], 1e6, (FORCE,), 1.7e9)
    write_series(tmp_path / "s.csv", kept)
    text = (tmp_path / "s.csv").read_text("utf-8").replace('"sample_rate_hz": 1000000.0', '"sample_rate_hz": 900000.0')
    (tmp_path / "s.csv").write_text(text, "utf-8")
    with pytest.raises(DataFileError, match=r"sampling rate of 900000 Hz|uneven steps"):
        read_series(tmp_path / "s.csv")


@pytest.mark.parametrize("file", ["s.csv", "s.mat", "s.zarr"])
def test_half_a_character_in_a_note_comes_back(tmp_path: Path, file: str) -> None:
    notes = {"from \udcff": "caf\udce9 é 😀 \\udce9 \ud800"}
    write_series(tmp_path / file, TimeSeries([[1.0], [2.0]], 1.0, (FORCE,), notes=notes))
    assert read_series(tmp_path / file).notes == notes


def test_half_a_character_in_a_label_is_refused_when_the_channel_is_made() -> None:
    with pytest.raises(SignalError, match=r"Channel.name: found 'a\\udce9', expected text in one line"):
        Channel("a\udce9", "signal")
    with pytest.raises(SignalError, match=r"Channel.unit"):
        Channel("a", "signal", "\ud800")
