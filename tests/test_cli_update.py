"""`armonic update`: what it reads and fits, and that nothing is lost or half-written when something fails."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import armonic as am
from armonic.cli import fitting
from command_line import MEASURED, START, TRUE, Armonic, Run, files

PATTERN = "links.arm.elasticity.z.*"  # the two parameters that the example determines best


def test_update_recovers_the_true_values_and_writes_robot_and_report(armonic: Armonic, tmp_path: Path) -> None:
    robot, report = tmp_path / "new.yaml", tmp_path / "r.html"
    data = armonic("update", TRUE, MEASURED, "-o", robot, "--report", report, "--parameters", PATTERN, "--json").json
    assert data["status"] == "converged"
    assert data["written"] == {"robot": str(robot), "report": str(report)}
    stiffness, damping = data["parameters"]
    for parameter, true in ((stiffness, 2.8e6), (damping, 200.0)):
        low, high = parameter["interval"]
        # Twice a 95 % interval holds the true value with a probability of 99.99 %.
        assert abs(np.log(parameter["value"] / true)) < np.log(high / low)
        assert parameter["verdict"] == "identified"
    assert am.load(robot).parameters(PATTERN) == pytest.approx({p["path"]: p["value"] for p in data["parameters"]})
    assert report.read_text("utf-8").lstrip().lower().startswith("<!doctype html>")
    assert files(tmp_path) == ["new.yaml", "r.html"]


def test_update_takes_several_files_each_with_its_posture_and_the_options_of_reading(
    armonic: Armonic, tmp_path: Path
) -> None:
    second, new = tmp_path / "second.csv", tmp_path / "new.yaml"
    armonic("frf", TRUE, "--posture", "0.5,1,-1", "-o", second, "--freq", "1:30:0.5")
    data = armonic(
        *("update", TRUE, MEASURED, second, "-o", new, "--json", "--parameters", PATTERN),
        *("--posture", "milling", "--posture", "0.5,1,-1", "--frame", "sensor", "--band", "5:28"),
        *("--symmetrize", "average", "--weights", "uniform", "--bounds", f"{PATTERN}=1:1e9"),
    ).json  # fmt: skip
    assert [entry["posture"] for entry in data["postures"]] == ["milling", "0.5,1,-1"]
    assert [p["bounds"] for p in data["parameters"]] == [[1, 1e9]] * 2


def test_update_without_options_takes_frame_and_posture_from_file_and_robot(armonic: Armonic, tmp_path: Path) -> None:
    run = armonic("update", TRUE, MEASURED, "-o", tmp_path / "new.yaml", "--parameters", PATTERN)
    assert (run.code, run.err) == (0, "")
    assert "The fit converged." in run.words
    assert "Modes in posture milling" in run.words
    assert files(tmp_path) == ["new.yaml"]


@contextmanager
def interrupting() -> Iterator[Callable[[am.Progress], None]]:
    """In place of the progress bar: Ctrl-C at the third evaluation."""

    def interrupt(now: am.Progress) -> None:
        if now.evaluations == 3:
            raise KeyboardInterrupt

    yield interrupt


def test_ctrl_c_in_a_fit_keeps_the_best_so_far(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fitting, "fit_progress", interrupting)
    robot, report = tmp_path / "new.yaml", tmp_path / "r.html"
    run = armonic("update", START, MEASURED, "-o", robot, "--report", report)
    assert run.code == 130
    assert run.err == "interrupted: the best of 3 evaluations was kept and written\n"
    assert "The fit was interrupted" in run.words
    assert am.load(robot).parameters() != am.load(START).parameters()
    assert files(tmp_path) == ["new.yaml", "r.html"]


def test_a_signal_without_a_terminal_keeps_the_best_and_says_how_to_go_on(tmp_path: Path) -> None:
    words = ("update", START, MEASURED, "-o", "new.yaml", "--force", "--method", "genetic", "--checkpoint", "run.json")
    process = subprocess.Popen(
        [sys.executable, "-m", "armonic", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        text=True,
        encoding="utf-8",
        env=os.environ | {"PYTHONIOENCODING": "utf-8"},
    )
    while not (tmp_path / "run.json").exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "The fit was interrupted" in " ".join(out.split())
    assert err.endswith(" was kept and written; the same command goes on from run.json\n")
    assert err.count("\n") == 1
    assert files(tmp_path) == ["new.yaml", "run.json"]


def test_ctrl_c_before_the_fit_writes_nothing(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("armonic.cli.arguments.open_robot", interrupt)
    assert armonic("update", START, MEASURED, "-o", tmp_path / "new.yaml") == Run(130, "", "")
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("failure", "said"),
    [
        (OSError(28, "No space left on device"), "No space left on device"),
        (am.DataFileError("r.html", found="a closed door", expected="an open one"), "a closed door"),
    ],
)
def test_a_report_that_fails_loses_neither_tables_nor_robot(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: Exception, said: str
) -> None:
    def fail(fit: am.Fit, path: Path) -> None:
        raise failure

    monkeypatch.setattr("armonic.report.write_report", fail)
    robot, report = tmp_path / "new.yaml", tmp_path / "r.html"
    words = ("update", TRUE, MEASURED, "--parameters", PATTERN, "-o", robot, "--report", report, "--force")
    run = armonic(*words)
    assert said in run.error
    assert f"--report {report}" in run.error
    assert f"safe in {robot}" in run.error
    assert "The fit converged." in run.words
    assert f"Wrote {robot}." in run.out
    assert files(tmp_path) == ["new.yaml"]

    run = armonic(*words, "--json")
    assert said in run.error
    data = json.loads(run.out)
    assert data["written"] == {"robot": str(robot)}
    assert f"error: {data['error']['message']}" == run.error
    assert am.load(robot).parameters(PATTERN) == {p["path"]: p["value"] for p in data["parameters"]}


def test_an_error_in_the_report_that_nobody_foresaw_loses_nothing_either(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(fit: am.Fit, path: Path) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("armonic.report.write_report", fail)
    robot = tmp_path / "new.yaml"
    words = ("--parameters", PATTERN, "-o", robot, "--report", tmp_path / "r.html", "--force")
    for more in ((), ("--json",)):
        with pytest.raises(ZeroDivisionError):
            armonic("update", TRUE, MEASURED, *words, *more)
        out = capsys.readouterr().out
        assert files(tmp_path) == ["new.yaml"]
        assert (json.loads(out)["written"] == {"robot": str(robot)}) if more else (f"Wrote {robot}." in out)


def test_a_robot_that_cannot_be_written_leaves_the_tables_and_no_report(
    armonic: Armonic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(robot: am.Robot, path: Path) -> None:
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(am.Robot, "save", fail)
    words = ("--parameters", PATTERN, "-o", tmp_path / "new.yaml", "--report", tmp_path / "r.html")
    run = armonic("update", TRUE, MEASURED, *words)
    assert "new.yaml: No space left" in run.error
    assert "The fit converged." in run.words
    assert "Wrote" not in run.out
    assert files(tmp_path) == []


def test_tables_that_nobody_reads_lose_no_robot(tmp_path: Path) -> None:
    words = ("update", TRUE, MEASURED, "--parameters", PATTERN, "-o", "new.yaml")
    process = subprocess.Popen(
        [sys.executable, "-m", "armonic", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path
    )
    assert process.stdout is not None
    process.stdout.close()  # as `| head` does
    process.communicate(timeout=60)
    assert files(tmp_path) == ["new.yaml"]


def with_holes(path: Path) -> Path:
    """The example's diagonal and z/x without noise, as a file that has no other responses."""
    frf = am.frf(am.load(TRUE), "milling", 0.2 * np.arange(1, 151), frame="sensor")
    am.write_frf(path, frf)
    comment, header, *rows = (line.split(",") for line in path.read_text("utf-8").splitlines())
    kept = [k for k, name in enumerate(header) if name.split()[0] in ("freq_hz", "x/x", "y/y", "z/z", "z/x")]
    lines = [",".join(comment), *(",".join(row[k] for k in kept) for row in (header, *rows))]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def test_single_responses_of_a_file_with_holes_can_be_fitted(armonic: Armonic, tmp_path: Path) -> None:
    measured, robot, report = with_holes(tmp_path / "m.csv"), tmp_path / "new.yaml", tmp_path / "r.html"
    start = tmp_path / "start.yaml"
    am.load(TRUE).with_values({"links.arm.elasticity.z.stiffness": 2e6}).save(start)
    words = ("update", start, measured, "-o", robot, "--parameters", PATTERN)
    refused = armonic(*words).error
    assert "found no response x/y" in refused
    assert "--responses x/x,y/y" in refused
    assert "outputs=" not in refused

    run = armonic(*words, "--responses", "x/x, y/y,z/z,z/x", "--report", report)
    assert (run.code, run.err) == (0, "")
    assert run.out.count("Modes in posture") == 1
    # Without noise the minimum is the truth; the solver stops at 1e-10 of the cost.
    assert am.load(robot).parameters(PATTERN) == pytest.approx(am.load(TRUE).parameters(PATTERN), rel=1e-6)
    assert report.exists()
    assert "found no response y/x" in armonic(*words, "--force", "--responses", "y/x").error


def test_responses_of_a_whole_file_are_those_that_a_selection_holds(armonic: Armonic, tmp_path: Path) -> None:
    words = ("update", TRUE, MEASURED, "-o", tmp_path / "new.yaml", "--parameters", PATTERN, "--json", "--force")
    matrix = armonic(*words, "--outputs", "xz", "--inputs", "z", "--band", "5:28").json
    single = armonic(*words, "--responses", "x/z,z/z", "--band", "5:28").json
    # The same sum of squares, in another order.
    assert single["start_cost"] == pytest.approx(matrix["start_cost"], rel=1e-12)
    assert len(single["postures"]) == 1


def test_doubts_about_a_fit_are_told(armonic: Armonic, tmp_path: Path) -> None:
    words = ("update", TRUE, MEASURED, "-o", tmp_path / "new.yaml", "--parameters", PATTERN, "--force")
    assert "Warning" not in armonic(*words).out
    assert armonic(*words, "--json").json["doubts"] == []
    wrong = (*words, "--scale", "9.80665")  # a file in SI, taken for one in g
    doubts = armonic(*wrong, "--json").json["doubts"]
    assert doubts
    assert all(f"Warning: {doubt}" in armonic(*wrong).words for doubt in doubts)
