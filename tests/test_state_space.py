"""The state space of a model: what it says, what other programs read, and what the command writes."""

from __future__ import annotations

import sys
from typing import Any

import control
import numpy as np
import pytest
import scipy.io
import scipy.signal

import armonic as am
from armonic.state_space import StateSpace
from command_line import files
from models import AXES, difference, oscillator, random_driven_robot, random_robot

FREQ_HZ = np.linspace(0.5, 50.0, 40)
MODELS = {
    "scompi": lambda: (am.linearize(am.load("scompi"), "c8"), "tool"),
    "kuka_kr90": lambda: (am.linearize(am.load("kuka_kr90"), "milling"), "sensor"),
    "random, driven": lambda: (am.linearize(random_driven_robot(5, 6), "bent"), "tip"),
    "random, state feedback": lambda: (am.linearize(random_driven_robot(7, 6, feedback=True), "bent"), "tip"),
    "random, moving": lambda: (am.linearize(random_robot(1, 5), "bent", velocity=[3.0, -2.0, 1.5, 4.0, -1.0]), "tip"),
}


@pytest.fixture(params=MODELS)
def posed(request: pytest.FixtureRequest) -> tuple[am.LinearModel, str]:
    return MODELS[request.param]()


def response(system: StateSpace, freq_hz: Any) -> Any:
    """C (iω − A)⁻¹ B + D."""
    s = 2j * np.pi * np.asarray(freq_hz)[:, None, None]
    return (
        system.C @ np.linalg.solve(s * np.eye(len(system.A)) - system.A, np.asarray(system.B, complex)[None]) + system.D
    )


def test_its_response_is_the_receptance_of_the_frame(posed):
    model, frame = posed
    system = model.state_space(frame=frame, inputs=AXES, outputs=("z", "x", "ry"), motors=False)
    expected = am.frf(model, None, FREQ_HZ, frame=frame, kind="receptance", outputs=("z", "x", "ry"), inputs=AXES)
    assert difference(response(system, FREQ_HZ), expected.values) < 1e-9


def test_motor_torques_and_positions_respond_as_the_explicit_form_says(posed):
    model, frame = posed
    system = model.state_space(frame=frame)
    rows = np.vstack([model.jacobian(frame)[:3], np.eye(len(model.coordinates))[model.links :]])
    expected = []
    for f in FREQ_HZ:
        s = 2j * np.pi * f
        Z = s**2 * model.mass + s * model.damping + model.stiffness + model.integral / s
        expected.append(rows @ np.linalg.solve(Z, rows.T))
    assert difference(response(system, FREQ_HZ), np.array(expected)) < 1e-9


def test_rows_and_columns_are_named():
    system = MODELS["random, driven"]()[0].state_space(frame="tip", inputs=("x",), outputs=("y", "rz"))
    model = MODELS["random, driven"]()[0]
    N, p = len(model.coordinates), len(model.loop.integrating)
    assert p > 0
    assert system.inputs == ("tip.x", *model.drives.names)
    assert system.outputs == ("tip.y", "tip.rz", *model.drives.names)
    assert system.states[: 2 * N] == (*model.coordinates, *(f"{name} rate" for name in model.coordinates))
    assert all(name.endswith(".motor integral") for name in system.states[2 * N :])
    assert system.A.shape == (2 * N + p, 2 * N + p)
    assert len(system.states) == 2 * N + p
    assert system.B.shape == (2 * N + p, len(system.inputs))
    assert system.C.shape == (len(system.outputs), 2 * N + p)
    assert not system.D.any()
    assert repr(system).startswith(f"StateSpace({2 * N + p} states, ")


def test_a_step_of_force_on_an_oscillator_is_the_textbook_one():
    mass, stiffness, damping = 2.0, 2e3, 8.0
    system = am.linearize(oscillator(mass, stiffness, damping), [0.0]).state_space(
        frame="mass_0", inputs=("x",), outputs=("x",)
    )
    t, x = scipy.signal.step((system.A, system.B, system.C, system.D), T=np.linspace(0, 1, 50))
    w, ratio = np.sqrt(stiffness / mass), damping / (2 * np.sqrt(stiffness * mass))
    wd = w * np.sqrt(1 - ratio**2)
    expected = (1 - np.exp(-ratio * w * t) * (np.cos(wd * t) + ratio * w / wd * np.sin(wd * t))) / stiffness
    np.testing.assert_allclose(np.squeeze(x), expected, rtol=0, atol=1e-9 / stiffness * 1e3)


# --- Other programs -----------------------------------------------------------------------------------------


def test_python_control_sees_the_same_poles_and_responses(posed):
    model, frame = posed
    system = model.state_space(frame=frame)
    other = system.to_control()
    modes = am.modes(model)
    poles = np.concatenate([modes.poles, modes.poles[modes.oscillatory].conj()])
    gaps = np.abs(other.poles()[:, None] - poles).min(axis=1)
    assert (gaps < 1e-9 * np.abs(poles).max()).all()
    found = other(2j * np.pi * FREQ_HZ[7])
    np.testing.assert_allclose(found, response(system, FREQ_HZ[7:8])[0], rtol=0, atol=1e-9 * np.abs(found).max())
    assert other.input_labels == [name.replace(".", "_") for name in system.inputs]
    assert isinstance(other, control.StateSpace)


def test_without_python_control_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    system = MODELS["scompi"]()[0].state_space(frame="tool")
    with pytest.raises(am.ModelError, match=r"no python-control.*pip install control"):
        system.to_control()


def test_a_matlab_file_holds_matrices_and_names(posed, tmp_path):
    model, frame = posed
    system = model.state_space(frame=frame)
    path = tmp_path / "model.mat"
    system.save_mat(path)
    assert files(tmp_path) == ["model.mat"]
    data = scipy.io.loadmat(path, chars_as_strings=True)
    for name in "ABCD":
        np.testing.assert_array_equal(data[name], getattr(system, name))
    for name in ("states", "inputs", "outputs"):
        cells = data[name]
        assert cells.shape == (len(getattr(system, name)), 1)
        assert tuple(str(cell[0]) for cell in cells[:, 0]) == getattr(system, name)
    assert str(data["origin"][0]) == system.origin


def test_a_matlab_file_that_cannot_be_written_is_refused(tmp_path):
    system = MODELS["scompi"]()[0].state_space(frame="tool")
    with pytest.raises(am.DataFileError, match="folder"):
        system.save_mat(tmp_path / "nowhere" / "model.mat")


# --- The command --------------------------------------------------------------------------------------------


def test_export_writes_what_the_library_computes(armonic, tmp_path):
    path = tmp_path / "model.mat"
    words = ("export", "scompi", "--posture", "c8", "--frame", "tool", "--tool-mass", "4", "-o", path)
    run = armonic(*words, "--inputs", "z", "--outputs", "x,ry")
    assert (run.code, run.err) == (0, "")
    assert run.out == (f"Wrote {path}: A, B, C, D of Scompi, posture c8, frame tool: 24 states, 7 inputs, 8 outputs.\n")
    model = am.linearize(am.load("scompi").with_values({"tool.mass": 4.0}), "c8")
    expected = model.state_space(frame="tool", inputs=("z",), outputs=("x", "ry"))
    data = scipy.io.loadmat(path)
    for name in "ABCD":
        np.testing.assert_array_equal(data[name], getattr(expected, name))
    again = armonic(*words)
    assert "a file that exists" in again.error
    told = armonic(*words, "--force", "--json").json
    assert (told["written"], told["inputs"][:2], len(told["states"])) == (str(path), ["tool.x", "tool.y"], 24)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("scompi", "--posture", "c8", "-o", "model.txt"), "-o: found model.txt, expected a name that ends in .mat"),
        (("scompi", "-o", "model.mat"), "--posture: found no posture"),
        (("scompi", "--posture", "c8", "--frame", "tol", "-o", "model.mat"), "'tol'"),
        (("scompi", "--posture", "c8", "--inputs", "w", "-o", "model.mat"), "--inputs: found 'w'"),
        (("kuka_kr90", "--tool-mass", "4", "-o", "model.mat"), "--tool-mass: found a robot file without a tool"),
        (("scompi", "--posture", "c8", "--tool-mass", "-4", "-o", "model.mat"), "tool.mass: found -4"),
        (("scompi", "--posture", "c8", "--tool-mass", "heavy", "-o", "model.mat"), "tool.mass: found 'heavy'"),
        (("scompi", "--posture", "c8"), "Missing option '-o'"),
    ],
)
def test_export_refuses(armonic, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    assert message in armonic("export", *words).error
    assert files(tmp_path) == []
