"""`armonic simulate`: forces and laws as they are typed, files that hold the run, and what a run that fails leaves."""

from __future__ import annotations

import json
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic import cli
from armonic.cli import motions
from armonic.errors import ArmonicError
from armonic.simulation import running
from command_line import WIDTH, Armonic, files
from simulated import HIT, scompi

PAPER = ("simulate", "scompi", "--posture", "c8", "--impulse", "y0:50N:6ms", "--set", "tool.mass=4")
SHORT = ("simulate", "scompi", "--posture", "c8", "--duration", "20ms")

CART = """\
armonic: 1
name: cart
gravity: [0, 0, 0]
links:
  - {name: cart, parent: base, joint: {type: prismatic, axis: x}, elasticity: {tx: {stiffness: 2000, damping: 8}},
     mass: 2, com: [0, 0, 0], inertia: {xx: 1, yy: 1, zz: 1}}
frames:
  - {name: top, link: cart}
postures: {rest: [0]}
"""
MASS, DAMPING, STIFFNESS = 2.0, 8.0, 2000.0


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    folder = tmp_path / "robot"
    folder.mkdir()
    path = folder / "cart.yaml"
    path.write_text(CART, "utf-8")
    return path


def after_step(force: float, time_s: np.ndarray) -> np.ndarray:
    """Displacement of the cart under a force since zero: the textbook step response of one mass."""
    decay, turn = DAMPING / (2 * MASS), np.sqrt(STIFFNESS / MASS - (DAMPING / (2 * MASS)) ** 2)
    t = np.maximum(time_s, 0.0)
    ring = np.exp(-decay * t) * (np.cos(turn * t) + decay / turn * np.sin(turn * t))
    return np.asarray(force / STIFFNESS * (1 - ring))


@pytest.mark.parametrize("ending", ["zarr", "uff", "csv", "mat"])
def test_the_run_of_the_paper_is_written_in_every_format(armonic: Armonic, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"run.{ending}"
    run = armonic(*PAPER, "--duration", "0.3s", "-o", path)
    assert (run.code, run.err) == (0, "")
    assert f"Wrote {path}: 57 channels." in run.out
    assert files(tmp_path) == [path.name]
    truth = am.simulate(scompi(1), "c8", HIT, duration_s=0.3).series
    written = am.read_series(path)
    assert written.labels == truth.labels
    # 13 digits in the text of a universal file; the others keep every bit.
    scale = np.abs(truth.values).max(axis=0)
    assert (np.abs(written.values - truth.values) <= (1e-12 if ending == "uff" else 0.0) * scale).all()
    if ending != "uff":  # which has no place for notes
        assert "--impulse y0:50N:6ms" in written.notes["simulated"]
        robot = am.Robot.from_yaml(written.notes["robot_yaml"])
        assert robot.numbers("tool.mass") == {"tool.mass": 4.0}
        assert written.notes["posture"] == "c8"


@pytest.mark.parametrize("more", [(), ("--linear",)])
def test_a_step_moves_a_cart_on_a_spring_as_in_the_textbook(
    armonic: Armonic, cart: Path, tmp_path: Path, more: tuple[str, ...]
) -> None:
    path = tmp_path / "run.zarr"
    run = armonic(
        "simulate", cart, "--duration", "1s", "--step", "x0:10N@100ms", "--rate", "0.5 kHz", "-o", path, *more
    )
    assert (run.code, run.err) == (0, "")
    series = am.read_series(path)
    assert (len(series), series.sample_rate_hz) == (501, 500.0)
    expected = after_step(10.0, series.time_s - 0.1)
    # Steps with a tolerance of 1e-10 against an amplitude of 9 mm.
    np.testing.assert_allclose(series["displacement:top.x0"], expected, atol=1e-10)


def test_a_force_of_a_file_acts_as_it_was_measured(armonic: Armonic, cart: Path, tmp_path: Path) -> None:
    force, path = tmp_path / "tap.csv", tmp_path / "run.csv"
    channels = (am.Channel("hammer", "force", "N"), am.Channel("other", "signal", ""))
    table = np.column_stack([np.full(501, 5.0), np.zeros(501)])
    am.write_series(force, am.TimeSeries(table, 1000.0, channels))
    for name in ("", "#hammer", "#force:hammer"):
        words = ("simulate", cart, "--duration", "0.5s", "--force-file", f"{force}{name}:x", "-o", path, "--force")
        assert armonic(*words).code == 0
        series = am.read_series(path)
        np.testing.assert_allclose(series["displacement:top.x0"], after_step(5.0, series.time_s), atol=1e-10)
    longer = ("simulate", cart, "--duration", "1s", "--force-file", f"{force}:x", "-o", path, "--force")
    refused = armonic(*longer).error
    assert "ends at 0.5 s" in refused
    assert "--force-ends" in refused
    assert armonic(*longer, "--force-ends").code == 0
    series = am.read_series(path)
    expected = after_step(5.0, series.time_s) - after_step(5.0, series.time_s - 0.5)
    # The last of the samples that straight lines join ends the force at once.
    np.testing.assert_allclose(series["displacement:top.x0"], expected, atol=1e-10)


@pytest.mark.parametrize(
    ("option", "text", "expected"),
    [
        ("--impulse", "y0:50N:6ms", am.Impulse(axis="y0", force=50.0, duration_s=0.006)),
        ("--impulse", "rz:1.5kN m:0.01@50ms", am.Impulse(axis="rz", force=1500.0, duration_s=0.01, start_s=0.05)),
        ("--impulse", " x : -5e1 : 6 ms @ 0 ", am.Impulse(axis="x", force=-50.0, duration_s=0.006, start_s=0.0)),
        ("--hammer", "z:0.8kN:2ms", am.HammerPulse(axis="z", force=800.0, duration_s=0.002)),
        ("--step", "z0:-100N@1s", am.Step(axis="z0", force=-100.0, start_s=1.0)),
        ("--sine", "x:20:6000rpm", am.Sine(axis="x", force=20.0, freq_hz=100.0)),
        ("--sweep", "x:20N:5-100Hz", am.Sweep(axis="x", force=20.0, from_hz=5.0, to_hz=100.0)),
        ("--sweep", "x:2N:1e-1-1e2:log@1", am.Sweep(
            axis="x", force=2.0, from_hz=0.1, to_hz=100.0, logarithmic=True, start_s=1.0)),
        ("--sweep", "x:2N:2kHz-50Hz", am.Sweep(axis="x", force=2.0, from_hz=2000.0, to_hz=50.0)),
        ("--noise", "y:5N:2Hz-200Hz", am.BandNoise(axis="y", rms=5.0, low_hz=2.0, high_hz=200.0, seed=7)),
    ],
)  # fmt: skip
def test_a_force_is_what_was_typed(option: str, text: str, expected: am.Excitation) -> None:
    (found,) = motions.excitations([(option, text)], None, 7)
    numbers = {key: value for key, value in vars(found).items() if isinstance(value, float)}
    assert numbers == pytest.approx({key: getattr(expected, key) for key in numbers}, rel=1e-15)
    others = vars(found).keys() - numbers.keys()
    assert type(found) is type(expected)
    assert all(getattr(found, key) == getattr(expected, key) for key in others)


def test_two_noises_are_independent_and_the_seed_says_which(cart: Path) -> None:
    typed = [("--noise", "x:1N:1Hz-50Hz")] * 2
    first, second = (np.array(e.waveform(10.0)[2]) for e in motions.excitations(typed, None, 0))
    again = np.array(motions.excitations(typed, None, 0)[0].waveform(10.0)[2])
    assert (first == again).all()
    # Of 980 independent values the correlation has a deviation of 0.03.
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.15


def test_laws_of_joints_take_the_units_of_shaft_and_joint() -> None:
    robot = am.load("scompi")  # its first joint slides, its motors turn
    laws = motions.joint_laws(
        robot, ["link_2=2kN m/rad³"], ["link_2=1arcmin", "link_1=1e-4 rad"], ["link_1=20N", "link_1=3N m@motor"]
    )
    expected = [
        am.Hardening(joint="link_2", cubic=2000.0),
        am.Backlash(joint="link_2", gap=np.pi / 10800),
        am.Backlash(joint="link_1", gap=1e-4),
        am.Coulomb(joint="link_1", torque=20.0),
        am.Coulomb(joint="link_1", torque=3.0, at="motor"),
    ]
    assert laws == expected


def test_what_stands_in_a_file_is_what_encoders_and_noise_leave(armonic: Armonic, tmp_path: Path) -> None:
    words = (*PAPER, "--duration", "2s", "-o")
    assert armonic(*words, tmp_path / "true.zarr").code == 0
    sensors = ("--sensor", "motor_position:20bit", "--sensor", "acceleration:0.5%", "--seed", "3")
    assert armonic(*words, tmp_path / "seen.zarr", *sensors).code == 0
    true, seen = (am.read_series(tmp_path / name) for name in ("true.zarr", "seen.zarr"))
    # The encoders turn with the rotors, ahead of the gears.
    ratios = np.array(list(am.load("scompi").numbers("links.*.drive.gear_ratio").values()))
    steps = 2 * np.pi / 2**20 / ratios
    counts = seen.select("motor_position").values / steps
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)  # 1e8 steps at most, in 16 digits
    off = np.abs(seen.select("motor_position").values - true.select("motor_position").values) / steps
    assert off.max() <= 0.5 + 1e-6
    noise = (seen.select("acceleration").values - true.select("acceleration").values).std(axis=0)
    # Of 2001 samples a standard deviation is known to 1.6 %.
    np.testing.assert_allclose(noise / true.select("acceleration").values.std(axis=0), 0.005, rtol=0.08)
    assert (seen.select("joint_velocity").values == true.select("joint_velocity").values).all()
    assert seen.notes["sensors"] == "motor_position:20bit; acceleration:0.5%"
    again = tmp_path / "again.zarr"
    assert armonic(*words, again, *sensors).code == 0
    assert (am.read_series(again).values == seen.values).all()


def test_a_converter_has_a_range_and_an_encoder_an_angle(armonic: Armonic, tmp_path: Path) -> None:
    path = tmp_path / "run.zarr"
    assert armonic(*PAPER, "--duration", "0.3s", "-o", path, "--sensor", "acceleration:12bit/4").code == 0
    seen = am.read_series(path).select("acceleration").values
    assert seen.min() == -2.0  # the blow is over 4 m/s²
    assert np.ptp(np.round(seen * 1024) - seen * 1024) == 0.0
    refused = armonic(*SHORT, "--sensor", "acceleration:20bit").error
    assert "bits of a turn" in refused
    assert "16bit/200" in refused


def test_people_see_peaks_energy_and_pace_in_80_columns_and_machines_the_same(armonic: Armonic) -> None:
    run = armonic(*PAPER, "--duration", "0.5s")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    for words in (
        "Scompi, posture c8",
        "501 samples at 1000 Hz",
        "times real time",
        "work of the forces",
        "of them taken",
    ):
        assert words in run.words
    data = armonic(*PAPER, "--duration", "0.5s", "--json").json
    assert (data["status"], data["method"], data["samples"], data["written"]) == ("complete", "explicit", 501, {})
    peak = {(p["quantity"], p["unit"]): p for p in data["peaks"]}
    assert peak["force", "N"] | {"quantity": ""} == {
        "quantity": "", "unit": "N", "channel": "tool.y0", "change": 50.0, "value": 50.0, "time_s": 0.2
    }  # fmt: skip
    energy = data["energy_j"]
    balance = energy["work of forces"] + energy["work of motors"] - energy["dissipated"] - energy["held"]
    assert abs(balance) <= energy["unaccounted"] * 1.01 < 1e-9


def test_a_page_shows_every_quantity(armonic: Armonic, tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    run = armonic(*PAPER, "--duration", "0.1s", "--plot", page)
    assert f"Wrote {page}" in run.out
    text = page.read_text("utf-8")
    assert text.lstrip().lower().startswith("<!doctype html>")
    for heading in ("Motor position", "Joint velocity", "Shaft torque", "Acceleration", "Force", "Energy"):
        assert f"<h2>{heading}</h2>" in text
    assert files(tmp_path) == ["run.html"]


LOST = (*SHORT[:-1], "2s", "--impulse", "y0:50N:6ms@10ms", "--control-rate", "50Hz", "--delay", "20ms")
"""Gains that a computer as slow as this makes unstable."""


def test_a_run_that_leaves_all_bounds_keeps_what_was_computed(armonic: Armonic, tmp_path: Path) -> None:
    path = tmp_path / "run.zarr"
    run = armonic(*LOST, "-o", path)
    assert "beyond all bounds at " in run.error
    assert "gains, rate and delay" in run.error
    assert f"Wrote {path}" in run.out
    written = am.read_series(path)
    assert 10 < len(written) < 2001
    assert np.isfinite(written.values).all()
    said = json.loads(armonic(*LOST, "--json").out)
    assert said["status"] == "failed"
    assert said["samples"] == len(written)
    assert f"error: {said['error']['message']}" == run.error


def test_ctrl_c_ends_a_run_and_keeps_what_was_computed(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, main = running.simulate, threading.main_thread().ident
    assert main is not None

    def hurried(*given: Any, **named: Any) -> am.Run:
        threading.Timer(0.5, signal.pthread_kill, (main, signal.SIGINT)).start()
        return real(*given, **named)

    monkeypatch.setattr(running, "simulate", hurried)
    path = tmp_path / "run.zarr"
    run = armonic(*PAPER, "--duration", "1e5 s", "--rate", "10", "-o", path)  # an hour and more of work
    assert run.code == cli.INTERRUPTED
    assert run.err.startswith("interrupted: the first ")
    assert str(path) in run.err
    assert 2 < len(am.read_series(path)) < 1e5
    assert files(tmp_path) == ["run.zarr"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--impulse", "q:50N:6ms"), "found 'q', expected x, y, z"),
        (("--impulse", "y0:50N"), "AXIS:FORCE:DURATION"),
        (("--impulse", "y0:50Nm:6ms"), "Nm measures a moment"),
        (("--impulse", "y0:50N:0"), "duration 0.0"),
        (("--impulse", "y0:50N:6Hz"), "Hz measures a frequency"),
        (("--impulse", "y0:fifty:6ms"), "found 'fifty'"),
        (("--impulse", "y0:nan:6ms"), "found 'nan'"),
        (("--impulse", "y0:50N:6ms@"), "--impulse"),
        (("--sine", "x:1:1-2"), "found '1-2'"),
        (("--sweep", "x:1N:1-2kHz"), "a unit at both ends"),
        (("--sweep", "x:1N:5"), "FROM-TO"),
        (("--sweep", "x:1N:0-2Hz:log"), "found from 0.0"),
        (("--sweep", "x:1N:1-2Hz:lin"), "[:log]"),
        (("--noise", "x:1N:200-2Hz"), "above 200"),
        (("--noise", "x:1N:1000Hz-1000.1Hz"), "Widen the band"),
        (("--force-file", "none.csv:y0"), "none.csv"),
        (("--force-file", "none.csv"), "FILE[#CHANNEL]:AXIS"),
        (("--at", "nose"), "--at: found 'nose'"),
        (("--frames", "tool,nose"), "--frames: found 'nose'"),
        (("--rate", "1x"), "--rate: found '1x'"),
        (("--rate", "0"), "--rate: found 0"),
        (("--tolerance", "1"), "--tolerance"),
        (("--method", "euler"), "--method"),
        (("--delay", "1ms"), "--control-rate as well"),
        (("--control-rate", "-1"), "--control-rate"),
        (("--control-rate", "1kHz", "--encoder-bits", "99"), "--encoder-bits: found 99"),
        (("--linear", "--hardening", "link_2=1e5"), "--hardening beside it"),
        (("--linear", "--method", "implicit"), "--method beside it"),
        (("--hardening", "nolink=1"), "--hardening: found 'nolink'"),
        (("--hardening", "link_2"), "JOINT=VALUE"),
        (("--backlash", "link_2=-1"), "gap -1.0"),
        (("--backlash", "link_2=1mm"), "mm measures a length"),
        (("--friction", "link_2=1@gear"), "[@motor]"),
        (("--friction", "link_1=3N m"), "N m measures a moment"),
        (("--sensor", "motor_position:20"), "BITSbit"),
        (("--sensor", "motor_positio:20bit"), "Did you mean motor_position?"),
        (("--sensor", "motor_position:99bit"), "bits 99"),
        (("--sensor", "motor_position:1%", "--sensor", "motor_position:2%"), "twice"),
        (("--set", "tool.mass"), "PATH=VALUE"),
        (("--set", "tool.mas=4"), "Did you mean tool.mass?"),
        (("--set", "tool.mass=-4"), "--set tool.mass=-4"),
        (("--seed", "-1"), "--seed"),
        (("--wrench", "1,2"), "--wrench"),
        (("--duration", "3 h"), "--duration: found '3 h'"),
        (("-o", "x.xyz"), "'.xyz'"),
        (("-o", "no/x.csv"), "no folder"),
    ],
)
def test_every_bad_word_gets_one_clear_line(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    more = () if "-o" in words else ("-o", "run.zarr")
    assert said in armonic(*SHORT, *words, *more).error
    assert files(tmp_path) == []


def test_no_file_is_replaced_unasked_and_no_folder_of_others_ever(armonic: Armonic, tmp_path: Path) -> None:
    path, foreign = tmp_path / "run.zarr", tmp_path / "photos.zarr"
    assert armonic(*SHORT, "-o", path).code == 0
    assert "--force" in armonic(*SHORT, "-o", path).error
    assert armonic(*SHORT, "-o", path, "--force").code == 0
    foreign.mkdir()
    (foreign / "holiday.txt").write_text("sea", "utf-8")
    assert "something else" in armonic(*SHORT, "-o", foreign, "--force").error
    assert files(foreign) == ["holiday.txt"]
    (tmp_path / "force.csv").write_text("kept", "utf-8")
    assert "already uses" in armonic(*SHORT, "-o", tmp_path / "r.csv", "--plot", tmp_path / "r.csv").error
    assert files(tmp_path) == ["force.csv", "photos.zarr", "run.zarr"]


def test_what_cannot_be_written_loses_no_table(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, series: am.TimeSeries) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("armonic.files.series_files.write_series", full)
    run = armonic(*SHORT, "-o", tmp_path / "run.csv")
    assert "No space left" in run.error
    assert "times real time" in run.words
    assert "Wrote" not in run.out


def test_help_of_simulate_stands_in_sections_of_80_columns(armonic: Armonic) -> None:
    run = armonic("simulate", "--help")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    headings = [line for line in run.out.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == [
        "Arguments:", "Options:", "What acts:", "What the robot is:", "How it is computed:", "What is measured:"
    ]  # fmt: skip


def test_every_error_of_a_typed_word_is_one_of_armonic() -> None:
    for text in ("", ":", "::", "x:::", "@", "x:1N:1ms@@", "x:1e999:1ms", "\x00"):
        for option in ("--impulse", "--step", "--sweep", "--noise"):
            with pytest.raises(ArmonicError):
                motions.excitations([(option, text)], None, 0)
        with pytest.raises(ArmonicError):
            motions.sensors([text])
