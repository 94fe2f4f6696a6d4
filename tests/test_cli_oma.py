"""`armonic oma`: modes of a file beside those of the robot that it notes, what is written, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import signal

import armonic as am
from armonic import cli
from armonic.files.modal_table import read_modal_table
from command_line import WIDTH, Armonic, files
from published import SCOMPI

ORDERS = ("--orders", "2:14")
PRINTED = SCOMPI.printed_table_5[1]


@pytest.fixture(scope="module")
def blow(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of Do et al. 2022, section 4.3, case 2, as `armonic simulate` writes it."""
    path = tmp_path_factory.mktemp("runs") / "run.zarr"
    words = ("simulate", "scompi", "--posture", "c8", "--set", "tool.mass=4", "--impulse", "y0:50N:6ms")
    assert cli.main([*words, "--duration", "3s", "-o", str(path)]) == 0
    return path


@pytest.fixture
def spinning(tmp_path: Path) -> Path:
    """Two channels of a mode at 12 Hz that noise drives, and of a spindle at 50 Hz whose speed wavers a little."""
    rng, rate = np.random.default_rng(0), 200.0
    pole = np.exp(2 * np.pi * 12.0 / rate * (-0.02 + 1j * np.sqrt(1 - 0.02**2)))
    mode = signal.lfilter([1.0], np.poly([pole, np.conj(pole)]).real, rng.normal(size=20000))
    # Phase that wanders by 0.012 rad a sample widens the line as a damping of 0.012² · rate / 2 / (2π 50 Hz) would,
    # 0.005 %.
    turn = 20 * np.sin(2 * np.pi * 50.0 * np.arange(20000) / rate + np.cumsum(0.012 * rng.normal(size=20000)))
    values = np.column_stack([mode + turn, -0.6 * mode + 0.8 * turn]) + 0.1 * rng.normal(size=(20000, 2))
    path = tmp_path / "spinning.csv"
    channels = (am.Channel("tool.x0", "acceleration", "m/s²"), am.Channel("tool.y0", "acceleration", "m/s²"))
    am.write_series(path, am.TimeSeries(values, rate, channels))
    return path


def pairs(data: dict[str, Any]) -> list[dict[str, Any]]:
    """The modes that have a partner in the model."""
    return [mode for mode in data["modes"] if mode["model"] is not None]


def test_table_5_stands_beside_its_analytic_column_without_a_word_on_the_robot(armonic: Armonic, blow: Path) -> None:
    data = armonic("oma", blow, "--channels", "motor_position", *ORDERS, "--json").json
    assert data["window"] == "decay"
    assert data["start_s"] == pytest.approx(0.206, abs=1e-12)
    assert data["reference"]["posture"] == "c8"
    found = {mode["model"]["mode"]: mode for mode in pairs(data)}
    assert set(found) >= set(range(1, 12))
    for number in range(1, 12):
        f, damping = PRINTED.natural_freq_hz[number - 1], PRINTED.damping_percent[number - 1] / 100
        # The printed columns, themselves results of an identification in part, are 0.22 % off in mode 11.
        for column in (found[number], found[number]["model"]):
            assert column["natural_freq_hz"] == pytest.approx(f, rel=3e-3)
            assert column["damping_ratio"] == pytest.approx(damping, abs=1e-3)
        difference = found[number]["natural_freq_hz"] / found[number]["model"]["natural_freq_hz"] - 1
        assert found[number]["model"]["freq_difference"] == pytest.approx(difference, abs=1e-12)
        assert abs(difference) < 2e-3


def test_people_see_both_columns_and_what_has_no_partner_in_80_columns(
    armonic: Armonic, blow: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = armonic("oma", blow, *ORDERS, "--band", "0:60", "--report", "oma.html", "-o", "modes.csv")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    for words in ("run.zarr (Scompi)", "the decay, 0.206 to 3 s", "modes of the model in posture c8", "MAC"):
        assert words in run.words
    assert "mode 12 (850.58 Hz, 80.6 %) have no partner" in run.words
    assert "5.9634" in run.words
    assert "Wrote modes.csv and oma.html: open the report in a browser." in run.out
    assert (tmp_path / "oma.html").read_text("utf-8").lstrip().lower().startswith("<!doctype html>")
    assert files(tmp_path) == ["modes.csv", "oma.html"]
    alone = armonic("oma", blow, *ORDERS, "--no-reference")
    assert "model" not in alone.words
    assert max(map(len, alone.out.splitlines())) <= WIDTH


def test_the_modes_written_are_those_that_update_reads(armonic: Armonic, blow: Path, tmp_path: Path) -> None:
    table, exact = tmp_path / "modes.csv", tmp_path / "modes.json"
    data = armonic("oma", blow, *ORDERS, "-o", table, "--json").json
    assert data["written"] == {"modes": str(table)}
    read = read_modal_table(table)
    assert not read.damped
    assert read.damping_ratio is not None
    assert read.freq_deviation is not None
    assert list(read.freq_hz) == [mode["natural_freq_hz"] for mode in data["modes"]]
    assert list(read.damping_ratio) == [mode["damping_ratio"] for mode in data["modes"]]
    assert (read.freq_deviation > 0).all()
    assert armonic("oma", blow, *ORDERS, "-o", exact).code == 0
    assert json.loads(exact.read_text("utf-8"))["modes"] == data["modes"]


def test_a_file_that_notes_no_robot_is_told_which_one(armonic: Armonic, blow: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.uff"
    am.write_series(bare, am.read_series(blow))  # has no place for notes
    assert armonic("oma", bare, *ORDERS, "--json").json["reference"] is None
    model = ("--robot", "scompi", "--posture", "c8")
    heavy = armonic("oma", bare, *ORDERS, *model, "--set", "tool.mass=4", "--json").json
    empty = armonic("oma", bare, *ORDERS, *model, "--json").json
    first = [data["modes"][0]["model"]["natural_freq_hz"] for data in (heavy, empty)]
    expected = [SCOMPI.printed_table_5[case].natural_freq_hz[0] for case in (1, 0)]
    assert first == pytest.approx(expected, abs=6e-5)  # four printed decimals
    assert "--robot ROBOT as well" in armonic("oma", bare, *ORDERS, "--posture", "c8").error


def test_numbers_may_be_set_on_the_robot_that_the_file_notes(armonic: Armonic, blow: Path) -> None:
    data = armonic("oma", blow, *ORDERS, "--set", "tool.mass=0", "--posture", "c8", "--json").json
    assert data["modes"][0]["model"]["natural_freq_hz"] == pytest.approx(6.3692, abs=6e-5)


def test_a_noted_robot_that_cannot_be_read_leaves_the_modes(armonic: Armonic, blow: Path, tmp_path: Path) -> None:
    series, odd = am.read_series(blow), tmp_path / "odd.mat"
    notes = {"robot": "Odd", "robot_yaml": "armonic: 99", "posture": "c8"}
    changed = am.TimeSeries(series.values, series.sample_rate_hz, series.channels, series.start_s, notes)
    am.write_series(odd, changed)
    run = armonic("oma", odd, *ORDERS)
    assert (run.code, run.err) == (0, "")
    assert "Warning: no modes of a model: the robot that the file notes" in run.words
    assert "identified" in run.words
    assert armonic("oma", odd, *ORDERS, "--set", "tool.mass=1").error


def test_a_static_start_is_compared_with_the_modes_there(armonic: Armonic, tmp_path: Path) -> None:
    path = tmp_path / "loaded.zarr"
    load = ("--wrench", "0,0,-2000,0,0,0", "--at", "sensor", "--static", "--impulse", "z0:500N:4ms")
    assert armonic("simulate", "kuka_kr90", "--duration", "1s", *load, "-o", path).code == 0
    robot = am.load("kuka_kr90")
    model = am.linearize(robot, "milling", wrench=[0, 0, -2000, 0, 0, 0], frame="sensor", equilibrium="static")
    words = ("oma", path, "--channels", "acceleration", "--orders", "2:30", "--window", "0.204:", "--json")
    data = armonic(*words).json
    known = {mode["model"]["natural_freq_hz"] for mode in pairs(data)}
    assert known
    assert all(np.isclose(f, am.modes(model).natural_freq_hz, rtol=1e-9).any() for f in known)


def test_the_other_method_and_the_other_selection_find_the_first_modes_too(armonic: Armonic, blow: Path) -> None:
    grid = ("--selection", "grid", "--resolution", "0.1Hz:0.1%", "--repeats", "8")
    for words in (("--method", "ssi", "--orders", "2:40"), (*ORDERS, *grid)):
        modes = armonic("oma", blow, *words, "--json").json["modes"]
        first = modes[0]
        assert first["natural_freq_hz"] == pytest.approx(PRINTED.natural_freq_hz[0], rel=1e-3)
        assert first["damping_ratio"] == pytest.approx(PRINTED.damping_percent[0] / 100, abs=1e-3)


def test_the_samples_taken_are_those_asked_for(armonic: Armonic, blow: Path) -> None:
    words = ("oma", blow, "--orders", "2:12", "--json")
    data = armonic(*words, "--window", "300ms:1.3 s", "--decimate", "2", "--channels", "link_1.motor,link_3.motor").json
    # A name is of every quantity that the motor has.
    assert all(label.partition(":")[2] in ("link_1.motor", "link_3.motor") for label in data["channels"])
    assert (data["samples"], data["sample_rate_hz"], data["start_s"]) == (501, 500.0, pytest.approx(0.3))
    later = armonic(*words, "--window", ":1", "--detrend", "linear", "--orders", "4:12:4").json
    assert (later["samples"], later["start_s"], later["orders"]) == (1001, 0.0, [4, 12])
    assert armonic(*words, "--window", "all").json["samples"] == 3001
    inside = armonic(*words, "--band", "5Hz:0.01kHz").json["modes"]
    assert inside
    assert all(5 <= mode["natural_freq_hz"] <= 10 for mode in inside)


def test_a_harmonic_is_told_and_is_no_mode_to_fit(armonic: Armonic, spinning: Path, tmp_path: Path) -> None:
    table = tmp_path / "modes.csv"
    words = ("oma", spinning, "--orders", "4:20", "--spindle", "3000rpm")
    run = armonic(*words, "-o", table)
    assert "may be no mode but a harmonic" in run.words
    assert max(len(line) for line in run.out.splitlines() if not line.startswith("Wrote")) <= WIDTH
    modes = armonic(*words, "--json").json["modes"]
    told = [mode["natural_freq_hz"] for mode in modes if mode["harmonic"]]
    assert told == pytest.approx([50.0], abs=0.05)
    assert "left out as a harmonic" in table.read_text("utf-8")
    kept = read_modal_table(table).freq_hz
    # 100 s of a mode damped by 2 %: its frequency is known to about 0.02 Hz.
    assert np.abs(kept - 12.0).min() < 0.1
    assert np.abs(kept - 50.0).min() > 1.0


def test_a_file_without_a_rate_is_told_one(armonic: Armonic, tmp_path: Path) -> None:
    path = tmp_path / "bare.csv"
    t = np.arange(2000) / 500
    rows = np.exp(-1.5 * t) * np.cos(2 * np.pi * 20 * t)
    path.write_text(
        "a,b\n" + "\n".join(f"{x:.9g},{y:.9g}" for x, y in zip(rows, np.roll(rows, 7), strict=True)) + "\n", "utf-8"
    )
    assert "--rate" in armonic("oma", path, "--orders", "2:8").error
    run = armonic("oma", path, "--orders", "2:8", "--rate", "0.5kHz", "--detrend", "none", "--json").json
    assert run["sample_rate_hz"] == 500.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--channels", "motor_positio"), "Did you mean motor_position?"),
        (("--channels", "a,"), "--channels"),
        (("--channels", "energy"), "Leave the channel out"),
        (("--orders", "9:2"), "the lowest order first"),
        (("--orders", "2"), "LOW:HIGH"),
        (("--orders", "0:5"), "--orders 0:5: found '0'"),
        (("--orders", "2:900"), "--orders: found order 900"),
        (("--orders", "two:5"), "found 'two'"),
        (("--method", "era"), "one of auto, var, ssi"),
        (("--window", "x"), "START:STOP"),
        (("--window", "2:1"), "a start before the stop"),
        (("--window", "9:10"), "--window: found no sample"),
        (("--window", "noon:"), "found 'noon'"),
        (("--band", "25:5"), "the lower end first"),
        (("--band", "5"), "LOW:HIGH"),
        (("--detrend", "x"), "--detrend"),
        (("--decimate", "0"), "--decimate"),
        (("--decimate", "500"), "--decimate: found 2795 samples"),
        (("--rate", "500"), "as --rate says"),
        (("--rate", "fast"), "--rate: found 'fast'"),
        (("--variable", "x"), "a .mat file"),
        (("--selection", "best"), "cluster, grid"),
        (("--resolution", "0.1Hz:0.1%"), "--selection grid"),
        (("--selection", "grid", "--resolution", "0.1"), "FREQ:DAMPING"),
        (("--selection", "grid", "--resolution", "0:0"), "--resolution"),
        (("--selection", "grid", "--repeats", "99"), "--repeats: found 99"),
        (("--spindle", "0"), "a speed above 0"),
        (("--block-rows", "9"), "beside --method ssi"),
        (("--robot", "nobody"), "nobody"),
        (("--robot", "scompi"), "--posture"),
        (("--robot", "scompi", "--posture", "c9"), "Did you mean c8?"),
        (("--no-reference", "--robot", "scompi"), "one of them"),
        (("--set", "tool.mas=1"), "Did you mean tool.mass?"),
        (("-o", "x.txt"), ".csv or .json"),
        (("-o", "no/x.csv"), "no folder"),
        (("-o", "x.csv", "--report", "x.csv"), "already uses"),
    ],
)
def test_every_bad_word_gets_one_clear_line(
    armonic: Armonic,
    blow: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    more = () if "-o" in words else ("-o", "modes.csv")
    assert said in armonic("oma", blow, "--orders", "2:6", *words, *more).error
    assert files(tmp_path) == []


@pytest.mark.parametrize("name", ["none.zarr", "none.csv", "photo.jpg", "photo"])
def test_a_file_that_is_no_series_gets_one_clear_line(armonic: Armonic, tmp_path: Path, name: str) -> None:
    assert name in armonic("oma", tmp_path / name).error


def test_ctrl_c_writes_nothing(armonic: Armonic, blow: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*given: Any, **named: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("armonic.identification.oma.stabilize", stop)
    run = armonic("oma", blow, "--orders", "2:6", "-o", tmp_path / "m.csv", "--report", tmp_path / "r.html")
    assert (run.code, run.out) == (cli.INTERRUPTED, "")
    assert run.err == "interrupted: nothing was written\n"
    assert files(tmp_path) == []


def test_a_report_that_fails_loses_neither_modes_nor_tables(
    armonic: Armonic, blow: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*given: Any, **named: Any) -> None:
        raise OSError(28, "No space left on device", "r.html")

    monkeypatch.setattr("armonic.identification_report.write_identification_report", full)
    table = tmp_path / "m.csv"
    words = ("oma", blow, "--orders", "2:8", "-o", table, "--report", tmp_path / "r.html", "--force")
    run = armonic(*words)
    assert "No space left" in run.error
    assert "5.963" in run.words
    assert f"Wrote {table}." in run.out
    assert files(tmp_path) == ["m.csv"]
    run = armonic(*words, "--json")
    data = json.loads(run.out)
    assert data["written"] == {"modes": str(table)}
    assert f"error: {data['error']['message']}" == run.error


def test_help_of_oma_stands_in_sections_of_80_columns(armonic: Armonic) -> None:
    run = armonic("oma", "--help")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    headings = [line for line in run.out.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == ["Arguments:", "Options:", "What is read:", "How it is identified:", "The model beside it:"]
    listed = armonic("--help").out.partition("Commands:")[2]
    assert "..." not in listed
    assert {"simulate", "oma"} <= {line.split()[0] for line in listed.splitlines() if line.strip()}
