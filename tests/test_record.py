"""The record of a run says where a result comes from; its fingerprint changes with all that the result depends on."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.updating.genetic import Genetic
from armonic.updating.parameters import Parameter, choose
from armonic.updating.record import Record, record_of

ROBOT = am.load("huynh_3r")
H = am.frf(ROBOT, "milling", np.arange(1, 31) / 1, frame="sensor")
DATA = am.Measurement(H, "milling", label="tap test")
STIFFNESS = "links.arm.elasticity.z.stiffness"


def parameters(robot: am.Robot = ROBOT, pattern: str = "elasticity", **bounds: Any) -> tuple[Parameter, ...]:
    return choose(robot, am.linearize(robot, "milling").impedances, pattern, bounds.get("bounds"))


CHOSEN = parameters()


def record(**changes: Any) -> Record:
    given = {
        "robot": ROBOT, "measurements": [DATA], "parameters": CHOSEN, "method": "genetic", "seed": 7,
        "options": Genetic(),
    }  # fmt: skip
    return record_of(**(given | changes))


def test_the_record_says_what_went_in_and_with_which_versions() -> None:
    before = datetime.now(UTC).replace(microsecond=0)
    made = record()
    assert (made.armonic, made.python) == (am.__version__, platform.python_version())
    assert (made.numpy, made.scipy) == (version("numpy"), version("scipy"))
    assert (made.method, made.seed, made.robot) == ("genetic", 7, ROBOT.name)
    assert made.robot_sha256 == hashlib.sha256(ROBOT.to_yaml().encode()).hexdigest()
    assert made.parameters == tuple(ROBOT.parameters("elasticity"))
    assert [label for label, _ in made.measurements] == ["tap test"]
    assert made.options["population"] == 100
    started = datetime.fromisoformat(made.started)
    assert started.utcoffset() is not None
    assert before <= started <= datetime.now(UTC)


def test_the_record_is_plain_data_and_does_not_change() -> None:
    made = record(options={"tolerance": np.float64(1e-9), "ladder": (40, np.int64(5)), "limit": np.inf, "to": None})
    read = json.loads(json.dumps(made.as_dict(), allow_nan=False))
    assert read == made.as_dict()
    assert read["options"] == {"tolerance": 1e-9, "ladder": [40, 5], "limit": "inf", "to": None}
    assert set(read) == set(Record.__dataclass_fields__)
    with pytest.raises(FrozenInstanceError):
        made.seed = 8  # type: ignore[misc]


def test_every_digest_has_64_digits() -> None:
    made = record()
    for digest in (made.fingerprint, made.robot_sha256, *(digest for _, digest in made.measurements)):
        assert re.fullmatch("[0-9a-f]{64}", digest)


SAME: dict[str, Callable[[], dict[str, Any]]] = {
    "the same again": dict,
    "another label": lambda: {"measurements": [replace(DATA, label="Tuesday")]},
    "weights as numbers": lambda: {"measurements": [replace(DATA, weights=DATA.line_weights())]},
    "the posture as numbers": lambda: {"measurements": [replace(DATA, posture=ROBOT.posture("milling").tolist())]},
    "the robot through its text": lambda: {"robot": am.Robot.from_yaml(ROBOT.to_yaml())},
    "options as a dict": lambda: {"options": record().options},
    "a NumPy seed": lambda: {"seed": np.int64(7)},
}


@pytest.mark.parametrize("case", SAME)
def test_what_the_result_does_not_depend_on_leaves_the_fingerprint_as_it_is(case: str) -> None:
    assert record(**SAME[case]()).fingerprint == record().fingerprint


def nudged(values: np.ndarray) -> np.ndarray:
    out = values.copy()
    out.flat[-1] = np.nextafter(out.flat[-1].real, np.inf) + 1j * out.flat[-1].imag
    return out


def moved(**changes: Any) -> dict[str, Any]:
    return {"measurements": [replace(DATA, **changes)]}


OTHER: dict[str, Callable[[], dict[str, Any]]] = {
    "a number of the robot": lambda: {"robot": ROBOT.with_values({"links.arm.mass": 222.66})},
    "the last bit of a response": lambda: moved(frf=replace(H, values=nudged(H.values))),
    "a line": lambda: moved(frf=replace(H, freq_hz=H.freq_hz + 1e-9)),
    "the kind": lambda: moved(frf=replace(H, kind="mobility")),
    "an output": lambda: moved(frf=replace(H, outputs=("x", "z", "y"))),
    "an input": lambda: moved(frf=replace(H, inputs=("x", "z", "y"))),
    "where the force acts": lambda: moved(frf=replace(H, input_frame="arm")),
    "the sensor's frame": lambda: moved(frame="arm"),
    "the posture": lambda: moved(posture=[0.0, 1.0, -1.0]),
    "the weights": lambda: moved(weights="uniform"),
    "one measurement more": lambda: {"measurements": [DATA, DATA]},
    "fewer parameters": lambda: {"parameters": parameters(pattern="stiffness")},
    "their order": lambda: {"parameters": CHOSEN[::-1]},
    "bounds": lambda: {"parameters": parameters(bounds={STIFFNESS: (1e6, 2e6)})},
    "the method": lambda: {"method": "continuation"},
    "the seed": lambda: {"seed": 8},
    "an option": lambda: {"options": Genetic(tolerance=2e-6)},
}


@pytest.mark.parametrize("case", OTHER)
def test_what_the_result_depends_on_changes_the_fingerprint(case: str) -> None:
    assert record(**OTHER[case]()).fingerprint != record().fingerprint


def test_no_two_of_these_problems_share_a_fingerprint() -> None:
    assert len({record(**change()).fingerprint for change in OTHER.values()}) == len(OTHER)


def test_another_process_finds_the_same_fingerprint() -> None:
    # Nothing depends on the hash seed of the process or on addresses in memory.
    code = "from test_record import record; print(record().fingerprint)"
    folder = Path(__file__).parent
    again = subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, text=True)
    assert again.stdout.strip() == record().fingerprint


def test_what_has_no_digest_is_not_passed_over() -> None:
    with pytest.raises(TypeError, match="has no digest"):
        record(parameters=[replace(CHOSEN[0], law=object())])  # type: ignore[arg-type]
