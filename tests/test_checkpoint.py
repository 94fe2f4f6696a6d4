"""A checkpoint gives back what it was given, and leaves every file alone that is not its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.updating import procedure
from armonic.updating.checkpoint import Checkpoint
from armonic.updating.genetic import Genetic
from armonic.updating.procedure import paper_procedure

STATE: dict[str, Any] = {"numbers": ["0x1.8p+1", "inf"], "count": 2**127 + 1, "inner": {"nothing": None, "yes": True}}
HINT = "Delete it, or give another name."


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "run.json"


def changed(file: Path, **changes: Any) -> None:
    file.write_text(json.dumps(json.loads(file.read_text("utf-8")) | changes), "utf-8")


def refused(file: Path, message: str, problem: str = "mine") -> None:
    """Asserts that this file is neither read, nor written, nor removed, and that one line says why."""
    before = file.read_bytes()
    for action in (Checkpoint.load, lambda c: c.save(STATE), Checkpoint.remove):
        with pytest.raises(am.UpdateError, match=message) as caught:
            action(Checkpoint(file, problem))
        error = caught.value
        assert error.where == f"checkpoint {file}"
        assert error.hint == HINT
        assert "\n" not in str(error)
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_what_was_saved_is_loaded_by_the_next_process(file: Path) -> None:
    Checkpoint(file, "mine").save(STATE)
    assert Checkpoint(file, "mine").load() == STATE
    content = json.loads(file.read_text("utf-8"))
    assert content["armonic"] == am.__version__
    assert content["problem"] == "mine"


def test_where_there_is_no_file_there_is_no_state_and_nothing_to_remove(file: Path) -> None:
    checkpoint = Checkpoint(file, "mine")
    assert checkpoint.load() is None
    checkpoint.remove()
    assert list(file.parent.iterdir()) == []


def test_a_later_state_replaces_an_earlier_one_and_is_removed_on_demand(file: Path) -> None:
    checkpoint = Checkpoint(file, "mine")
    for count in range(5):
        checkpoint.save({"count": count})
    assert Checkpoint(file, "mine").load() == {"count": 4}
    checkpoint.remove()
    assert list(file.parent.iterdir()) == []
    checkpoint.save(STATE)
    assert checkpoint.load() == STATE


def test_a_checkpoint_of_another_problem_is_refused(file: Path) -> None:
    Checkpoint(file, "theirs").save(STATE)
    refused(file, "found a checkpoint of another problem: robot, measurements, parameters")


@pytest.mark.parametrize("version", [2, 0, "1", None, True, [1]])
def test_another_format_is_refused_with_the_version_it_came_from(file: Path, version: object) -> None:
    Checkpoint(file, "mine").save(STATE)
    changed(file, armonic_checkpoint=version, armonic="9.9.9")
    refused(file, r"found a checkpoint of format .*, from Armonic 9\.9\.9, expected format 1\.")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.99])
def test_half_a_checkpoint_is_refused_as_damaged(file: Path, share: float) -> None:
    Checkpoint(file, "mine").save(STATE)
    text = file.read_bytes()
    file.write_bytes(text[: max(30, int(share * len(text)))])
    refused(file, "found a damaged checkpoint")


DAMAGES: dict[str, Any] = {
    "one digit": {"state": STATE | {"numbers": ["0x1.8p+2", "inf"]}},
    "the state": {"state": None},
    "a list": {"state": [1]},
    "the digest": {"state_sha256": "0" * 64},
    "no digest": {"state_sha256": None},
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_checkpoint_that_was_changed_is_refused_as_damaged(file: Path, damage: str) -> None:
    Checkpoint(file, "mine").save(STATE)
    changed(file, **DAMAGES[damage])
    refused(file, "found a damaged checkpoint")


OTHERS = {
    "a robot file": (b"armonic: 1\nname: three axes\n", "found no JSON"),
    "nothing": (b"", "found no JSON"),
    "bytes": (bytes(range(256)), "found no JSON"),
    "deep brackets": (b"[" * 100_000, "found no JSON"),
    "a long number": (b"1" * 10_000, "found no JSON"),
    "a list": (b"[1, 2]", "found a file of another kind"),
    "someone's JSON": (b'{"problem": "mine", "state": {}}', "found a file of another kind"),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_a_file_that_is_no_checkpoint_is_refused(file: Path, kind: str) -> None:
    content, message = OTHERS[kind]
    file.write_bytes(content)
    refused(file, message)


def test_a_file_that_came_in_between_two_states_is_not_overwritten(file: Path) -> None:
    checkpoint = Checkpoint(file, "mine")
    checkpoint.save(STATE)
    Checkpoint(file.with_name("other.json"), "theirs").save(STATE)
    file.with_name("other.json").replace(file)
    with pytest.raises(am.UpdateError, match="another problem"):
        checkpoint.save(STATE)
    Checkpoint(file, "theirs").load()


def test_a_file_that_was_deleted_between_two_states_is_made_again(file: Path) -> None:
    checkpoint = Checkpoint(file, "mine")
    checkpoint.save(STATE)
    file.unlink()
    checkpoint.save({"count": 1})
    assert Checkpoint(file, "mine").load() == {"count": 1}


def test_a_place_that_cannot_hold_a_checkpoint_is_refused_before_the_run(tmp_path: Path) -> None:
    for path, message in ((tmp_path / "no" / "run.json", "no such folder"), (tmp_path, "cannot be read")):
        with pytest.raises(am.UpdateError, match=message):
            Checkpoint(path, "mine").load()
    with pytest.raises(am.UpdateError, match="cannot be read"):
        Checkpoint(tmp_path / "a\0b", "mine").load()
    with pytest.raises(am.UpdateError, match="cannot be read"):
        Checkpoint(tmp_path / ("n" * 300), "mine").load()


def test_a_state_with_a_number_that_json_does_not_know_is_an_error_of_the_program(file: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        Checkpoint(file, "mine").save({"cost": float("nan")})
    assert not file.exists()


PROGRAM = """
import sys
import numpy as np
from armonic.updating.checkpoint import Checkpoint
from armonic.updating.genetic import Genetic
from armonic.updating import procedure
from armonic.updating.procedure import paper_procedure
from test_checkpoint import OPTIONS, START, valley
procedure.CHUNK = 60  # many boundaries, so that a run can be ended between any two
checkpoint = Checkpoint(sys.argv[1], "mine")
def save(state):
    checkpoint.save(state)
    print(state["evaluations"], flush=True)
end = paper_procedure(
    valley, START, START / 10, START * 10, options=OPTIONS, seed=3, limit=10**6, state=checkpoint.load(), save=save
)
print(end.status)
"""
START = np.array([2e6, 8e2, 30.0, 4.0, 1e-3, 7.0])
OPTIONS = Genetic(population=20, generations=10, rounds=3, simplex_iterations=400, tolerance=0)


def valley(values: np.ndarray) -> np.ndarray:
    x = values * np.array([0.5, 2, 3, 0.7, 1.3, 0.4]) / START
    return np.asarray(((1 - x[:, :-1]) ** 2 + 100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2).sum(axis=1))


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_run_that_is_ended_again_and_again_becomes_the_one_left_alone(
    file: Path, how: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(procedure, "CHUNK", 60)
    bounds = (START / 10, START * 10)
    alone = paper_procedure(valley, START, *bounds, options=OPTIONS, seed=3, limit=10**6)
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    for share in (0.05, 0.4, 0.8):
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(file)], stdout=subprocess.PIPE, text=True, env=environment
        )
        assert process.stdout is not None
        for line in process.stdout:
            if line.strip().isdigit() and int(line) >= share * alone.evaluations:
                break
        process.send_signal(how)
        process.stdout.read()
        process.stdout.close()
        process.wait(timeout=60)
    checkpoint = Checkpoint(file, "mine")
    state = checkpoint.load()
    assert state is not None
    assert state["evaluations"] >= 0.8 * alone.evaluations
    end = paper_procedure(valley, START, *bounds, options=OPTIONS, seed=3, limit=10**6, state=state)
    assert end.values.tobytes() == alone.values.tobytes()
    assert end.history.tobytes() == alone.history.tobytes()
    assert (end.cost, end.evaluations, end.stages) == (alone.cost, alone.evaluations, alone.stages)
