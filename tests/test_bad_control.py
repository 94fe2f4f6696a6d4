"""Driven robots asked for what they cannot give, loops that are unstable, and what the command says about both."""

from __future__ import annotations

import numpy as np
import pytest

import armonic as am
from closed_loops import driven_hinge, with_control
from command_line import WIDTH, Run
from models import random_driven_robot
from published import SCOMPI

WRENCH = [10.0, 0, 0, 0, 0, 0]


def rows(run: Run) -> list[list[str]]:
    """The words of the numbered lines of a table."""
    return [line.split() for line in run.out.splitlines() if line.strip()[:1].isdigit()]


# --- The library --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", ["tool", "World", None, 3])
def test_unknown_axes_of_a_wrench_are_refused_everywhere(axes):
    robot, load = am.load("scompi"), {"wrench": WRENCH, "wrench_axes": axes}
    message = f'wrench_axes: found {axes!r}, expected "world" or "frame"'
    for ask in (am.linearize, am.modes, am.gain_margins):
        with pytest.raises(am.PostureError, match=message):
            ask(robot, "c8", frame="tool", **load)
    with pytest.raises(am.PostureError, match=message):
        am.frf(robot, "c8", [1.0], frame="tool", **load)


def test_a_wrench_without_a_frame_is_refused_by_gain_margins_too():
    with pytest.raises(am.PostureError, match="frame: found nothing"):
        am.gain_margins(am.load("scompi"), "c8", wrench=WRENCH)
    with pytest.raises(am.PostureError, match="beside a linear model"):
        am.gain_margins(am.linearize(am.load("scompi"), "c8"), "c8")


def test_a_robot_without_drives_has_no_gain_margins():
    robot = am.load("kuka_kr90")
    assert am.gain_margins(robot, "milling") == ()
    model = am.linearize(robot, "milling")
    assert (model.links, len(model.loop), model.motor_position.size, model.motor_torque.size) == (9, 0, 0, 0)
    assert not model.integral.any()


@pytest.mark.parametrize(("name", "axes"), [("inputs", ("x", "w")), ("outputs", ("motor",))])
def test_unknown_axes_of_a_state_space_are_refused(name, axes):
    model = am.linearize(am.load("scompi"), "c8")
    with pytest.raises(am.FrfError, match=f"{name}: found '{axes[-1]}', expected axes among x y z"):
        model.state_space(frame="tool", **{name: axes})
    with pytest.raises(am.PostureError, match="'tol'"):
        model.state_space(frame="tol")


def test_a_fit_through_state_feedback_and_integrators_is_refused():
    fed = random_driven_robot(3, 6, feedback=True)
    assert fed.parameters("stiffness")
    assert fed.control.ki.any()
    H = am.frf(fed, "bent", np.linspace(5, 40, 30), frame="tip")
    with pytest.raises(am.ModelError, match="control: found state feedback from joint to joint beside integral gains"):
        am.update(fed, am.Measurement(H, posture="bent", frame="tip"))


@pytest.mark.parametrize("feedback", [False, True])
def test_springs_beside_drives_are_found_again_by_a_fit(feedback):
    true = random_driven_robot(3, 6, feedback=feedback)
    none = [0.0] * len(true.motors)
    true = with_control(true, ki=none, link_ki=none)
    start = true.with_values({path: 1.3 * value for path, value in true.parameters("stiffness").items()})
    H = am.frf(true, "bent", np.linspace(2, 60, 120), frame="tip")
    fit = am.update(start, am.Measurement(H, posture="bent", frame="tip"), parameters="stiffness")
    for path, value in true.parameters("stiffness").items():
        assert fit.robot.parameters(path)[path] == pytest.approx(value, rel=1e-6)


# --- The command --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", [0, 1])
def test_modes_of_scompi_prints_table_5(armonic, case):
    printed = SCOMPI.printed_table_5[case]
    run = armonic("modes", "scompi", "--posture", "c8", "--tool-mass", f"{SCOMPI.tool_mass[case]:g}")
    table = rows(run)
    assert [int(row[0]) for row in table] == list(range(1, 13))
    # Half of the last digit printed here, beside what the rounded tables of the paper leave open.
    freq_hz, damping = (np.array([float(row[k]) for row in table]) for k in (1, 3))
    np.testing.assert_allclose(freq_hz, printed.natural_freq_hz, rtol=(0.0004, 0.0025)[case], atol=0.005)
    np.testing.assert_allclose(damping, printed.damping_percent, rtol=(0.001, 0.0025)[case], atol=0.005)
    assert [row[4] for row in table[:5]] == ["link_3.z", "link_2.z", "link_4.z", "link_5.z", "link_6.z"]
    assert "Asymptotically stable" in run.words
    margins = [line.split() for line in run.out.splitlines() if ".motor " in line]
    assert [row[0] for row in margins] == [f"link_{i}.motor" for i in range(1, 7)]
    assert {row[2] for row in margins} == {"∞"}
    assert max(len(line) for line in run.out.splitlines()) <= WIDTH


def test_modes_as_json_holds_the_margins_and_the_load(armonic):
    words = ("modes", "scompi", "--posture", "c8", "--tool-mass", "4 kg", "--json")
    data = armonic(*words, "--wrench", "0,0,50,0,0,0", "--frame", "tool", "--wrench-axes", "frame").json
    assert (data["wrench_axes"], data["tool_mass"], data["frame"]) == ("frame", 4.0, "tool")
    margins = am.gain_margins(
        am.load("scompi").with_values({"tool.mass": 4}),
        "c8",
        wrench=[0, 0, 50, 0, 0, 0],
        frame="tool",
        wrench_axes="frame",
    )
    assert [m["motor"] for m in data["gain_margins"]] == [m.motor for m in margins]
    assert [m["lower"] for m in data["gain_margins"]] == [m.lower for m in margins]
    assert {m["upper"] for m in data["gain_margins"]} == {None}  # infinite
    assert len(data["coordinates"]) == 12
    world = armonic(*words, "--wrench", "0,0,50,0,0,0", "--frame", "tool").json
    assert world["wrench_axes"] == "world"
    assert world["modes"][0]["natural_freq_hz"] != data["modes"][0]["natural_freq_hz"]


def test_an_unstable_loop_is_said_to_be_so_without_margins(armonic, tmp_path):
    path = tmp_path / "robot.yaml"
    driven_hinge(inertia=4.0, control={"kp": 5e3, "ki": 5e4, "kd": 1}).save(path)
    run = armonic("modes", path, "--posture", "0.1")
    assert (run.code, run.err) == (0, "")
    assert "Unstable: some motion grows." in run.words
    assert ".motor" not in run.words.partition("Unstable")[2]
    (margin,) = armonic("modes", path, "--posture", "0.1", "--json").json["gain_margins"]
    assert margin == {"motor": "rod.motor", "upper": None, "lower": None, "freq_hz": None}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("scompi", "--posture", "c8", "--wrench-axes", "tool"),
            "--wrench-axes: found 'tool', expected one of world, frame",
        ),
        (("kuka_kr90", "--tool-mass", "4"), "--tool-mass: found a robot file without a tool"),
        (("scompi", "--posture", "c8", "--tool-mass", "-1"), "tool.mass: found -1"),
        (("scompi", "--posture", "c8", "--tool-mass", "4 m"), "tool.mass: found '4 m'"),
    ],
)
def test_modes_refuses(armonic, words, message):
    assert message in armonic("modes", *words).error
