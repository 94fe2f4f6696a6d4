"""`armonic tap`: a campaign rehearsed from the command line, its files and tables, and bad words in one line."""

from __future__ import annotations

import math
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic import cli
from armonic.files.measured_files import read_measured
from armonic.simulation import tap_test as rehearsing
from command_line import WIDTH, Armonic, files

KUKA = ("tap", "kuka_kr90", "--posture", "milling")
BRIEF = (*KUKA, "--record", "500ms", "--hits", "2")


@pytest.mark.parametrize(("ending", "step"), [("h5", 0.0), ("uff", 2**-24)])
def test_the_records_of_a_campaign_are_written_and_read_back(
    armonic: Armonic, tmp_path: Path, ending: str, step: float
) -> None:
    path = tmp_path / f"taps.{ending}"
    run = armonic(*BRIEF, "--softening", "1%", "--seed", "3", "-o", path)
    assert (run.code, run.err) == (0, "")
    assert f"Wrote {path}: 6 records." in run.out
    assert files(tmp_path) == [path.name]
    truth = rehearsing.tap_test(
        am.load("kuka_kr90"), "milling", record_s=0.5, hits=2, softening=0.01, seed=3, tilt_rad=math.radians(1.2)
    )
    found = read_measured(path)
    assert found.skipped == ()
    assert len(found.records) == 6
    for one, true in zip(found.records, truth.records, strict=True):
        assert one.labels == true.labels
        assert one.sample_rate_hz == pytest.approx(true.sample_rate_hz, rel=1e-6)
        # A universal file may hold single precision.
        assert (np.abs(one.values - true.values) <= step * np.abs(true.values).max(axis=0)).all()
    assert found.geometry is not None
    assert found.geometry.names == ("sensor",)
    np.testing.assert_allclose(found.geometry.positions, truth.geometry.positions, rtol=1e-6, atol=1e-9)


def test_people_see_hits_and_true_modes_in_80_columns_and_machines_the_same(armonic: Armonic) -> None:
    words = (*BRIEF, "--double-hits", "1", "--overloads", "1")
    run = armonic(*words)
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    for part in ("6 hits on sensor.x, sensor.y, sensor.z", "512 Hz", "double hit: ", "overload", "9.96", "23.85"):
        assert part in run.words
    data = armonic(*words, "--json").json
    assert (data["status"], data["records"], data["samples"], data["written"]) == ("complete", 6, 256, {})
    sorts = [hit["sort"] for hit in data["hits"]]
    assert (len(sorts), sorts.count("double"), sorts.count("overload")) == (6, 1, 1)
    assert all(hit["overloaded"] == (hit["sort"] == "overload") for hit in data["hits"])
    natural = [mode["natural_freq_hz"] for mode in data["modes"]]
    np.testing.assert_allclose(natural, am.modes(am.load("kuka_kr90"), "milling").natural_freq_hz, rtol=1e-12)


def test_what_is_typed_is_what_the_library_is_asked(armonic: Armonic, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}
    real = rehearsing.tap_test

    def watched(robot: am.Robot, posture: str, **options: Any) -> rehearsing.TapTest:
        asked.update(options, tool=robot.numbers("links.arm.mass")["links.arm.mass"])
        return real(robot, posture, **options)

    monkeypatch.setattr(rehearsing, "tap_test", watched)
    run = armonic(
        *KUKA, "--points", "arm.x, sensor.z", "--sensors", "sensor.z", "--hits", "1", "--peak", "0.3kN",
        "--spread", "0.1", "--pulse", "6ms", "--pulse-spread", "1%", "--tilt", "2deg", "--offset", "5mm",
        "--rate", "1kHz", "--record", "400ms", "--pretrigger", "50ms", "--together", "--noise", "0.01",
        "--force-noise", "200mN", "--bits", "16", "--force-range", "1kN", "--acceleration-range", "20",
        "--backlash", "arm.z=1e-9", "--set", "links.arm.mass=250", "--seed", "7",
    )  # fmt: skip
    assert (run.code, run.err) == (0, "")
    assert asked.pop("joints") == [am.Backlash(joint="arm.z", gap=1e-9)]
    expected = {
        "points": ["arm.x", "sensor.z"], "sensors": ["sensor.z"], "hits": 1, "force_n": 300.0, "spread": 0.1,
        "pulse_s": 0.006, "pulse_spread": 0.01, "tilt_rad": math.pi / 90, "offset_m": 0.005, "double_hits": 0,
        "overloads": 0, "softening": 0.0, "sample_rate_hz": 1000.0, "record_s": 0.4, "pretrigger_s": 0.05,
        "one_record_per_hit": False, "noise": 0.01, "force_noise_n": 0.2, "bits": 16, "force_range_n": 1000.0,
        "acceleration_range": 20.0, "seed": 7, "tool": 250.0,
    }  # fmt: skip
    assert asked.pop("progress") is None  # nobody would see it
    assert asked == {
        key: pytest.approx(value) if isinstance(value, float) else value for key, value in expected.items()
    }


def test_ctrl_c_ends_a_campaign_and_keeps_the_records_that_are_complete(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, main = rehearsing.tap_test, threading.main_thread().ident
    assert main is not None

    def hurried(*given: Any, **named: Any) -> rehearsing.TapTest:
        def stop(done: int, _: int) -> None:
            if done == 3:
                signal.pthread_kill(main, signal.SIGINT)

        return real(*given, **named | {"progress": stop})

    monkeypatch.setattr(rehearsing, "tap_test", hurried)
    path = tmp_path / "taps.h5"
    run = armonic(*KUKA, "--hits", "200", "--record", "1s", "-o", path)
    assert run.code == cli.INTERRUPTED
    assert run.err.startswith("interrupted: the first 3 records were taken and written to ")
    assert len(read_measured(path).records) == 3
    assert files(tmp_path) == ["taps.h5"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--points", "sensor"), "--points: found 'sensor', expected PLACE.AXIS"),
        (("--points", "senso.x"), "Did you mean sensor?"),
        (("--sensors", "sensor.x,sensor.x"), "--sensors: found sensor.x twice"),
        (("--hits", "0"), "--hits: found 0"),
        (("--peak", "200Nm"), "Nm measures a moment"),
        (("--peak", "0"), "--peak: found 0.0"),
        (("--softening", "50%"), "--softening: found 0.5, expected a finite number of at least 0 and at most 0.03"),
        (("--overloads", "9"), "no more than the 6 hits together"),
        (("--record", "1h"), "--record: found '1h'"),
        (("--record", "1e6"), "--record: found 1e+06 s"),
        (("--pretrigger", "1s"), "--pretrigger: found 1.0"),
        (("--rate", "0"), "--rate: found 0.0"),
        (("--bits", "99"), "--bits: found 99"),
        (("--noise", "-1"), "--noise: found -1.0"),
        (("--seed", "-1"), "--seed: found -1"),
        (("--hardening", "nose=1"), "--hardening: found 'nose'"),
        (("--set", "links.arm.mas=4"), "Did you mean links.arm.mass?"),
        (("-o", "taps.csv"), "found the ending '.csv', expected one of .uff"),
        (("-o", "no/taps.uff"), "no folder"),
    ],
)
def test_every_bad_word_gets_one_clear_line(
    armonic: Armonic, empty_folder: Path, words: tuple[str, ...], said: str
) -> None:
    more = () if "-o" in words else ("-o", "taps.h5")
    assert said in armonic(*BRIEF, *words, *more).error
    assert files(empty_folder) == []


def test_springs_of_a_robot_on_drives_are_not_said_to_soften(armonic: Armonic) -> None:
    refused = armonic("tap", "scompi", "--posture", "c8", "--softening", "1%").error
    assert "--softening: found Scompi, where no spring stands beside the drives" in refused
    assert "--hardening or --backlash" in refused


def test_what_cannot_be_written_loses_no_table_and_no_file_is_replaced_unasked(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "taps.h5"
    path.write_text("kept", "utf-8")
    assert "--force" in armonic(*BRIEF, "-o", path).error
    assert path.read_text("utf-8") == "kept"

    def full(path: Path, **parts: Any) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("armonic.files.measured_files.write_measured", full)
    run = armonic(*BRIEF, "-o", path, "--force")
    assert "No space left" in run.error
    assert "9.96" in run.words
    assert "Wrote" not in run.out


def test_help_of_tap_stands_in_sections_of_80_columns(armonic: Armonic) -> None:
    run = armonic("tap", "--help")
    assert (run.code, run.err) == (0, "")
    assert max(map(len, run.out.splitlines())) <= WIDTH
    headings = [line for line in run.out.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert headings == [
        "Arguments:", "Options:", "What is hit and watched:", "The hammer:", "What the robot is:", "What is measured:"
    ]  # fmt: skip
