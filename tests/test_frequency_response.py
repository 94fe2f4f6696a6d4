"""Frequency responses of robots: against dense algebra, closed forms, and the laws that every such response obeys."""

from __future__ import annotations

import numpy as np
import pytest

import armonic as am
from armonic.errors import FrfError, ModelError, PostureError
from models import (
    AXES,
    G,
    dense_response,
    difference,
    oscillator,
    random_robot,
    robot_of,
    rows_of,
    slides,
    spring,
)

FREQ_HZ = np.linspace(0.5, 60.0, 60)
# Both sides solve a system whose condition number is below 1e5 (stiffnesses within a decade, resonances damped).
ROUNDING = 1e-10


def kuka() -> am.Robot:
    return am.load("kuka_kr90")


ROBOTS = {
    "kuka_kr90": lambda: (kuka(), "milling", "sensor"),
    "huynh_3r": lambda: (am.load("huynh_3r"), "milling", "sensor"),
    "five random joints": lambda: (random_robot(1, 5), "bent", "tip"),
    "ten random joints": lambda: (random_robot(2, 10), "bent", "mid"),
}


# --- Against dense algebra ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerance_is_the_dense_solution_times_minus_omega_squared(name):
    robot, posture, frame = ROBOTS[name]()
    model = am.linearize(robot, posture)
    rows = rows_of(model, frame)
    expected = -((2 * np.pi * FREQ_HZ[:, None, None]) ** 2) * dense_response(model, FREQ_HZ, rows, rows)
    found = am.frf(robot, posture, FREQ_HZ, frame=frame)
    assert (found.kind, found.outputs, found.inputs, found.frame) == ("accelerance", AXES[:3], AXES[:3], frame)
    assert difference(found.values, expected) < ROUNDING


MOTIONS = {
    "moving": {"velocity": [3.0, -2.0, 1.5, 4.0, -1.0]},
    "accelerating": {"velocity": [1.0, 2.0, 0.5, -1.0, 1.0], "acceleration": [9.0, -20.0, 5.0, 3.0, 8.0]},
    "under a moment": {"wrench": [300.0, -200.0, 100.0, 2e4, -1e4, 3e4], "frame": "tip"},
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_robot_whose_matrices_are_not_symmetric_agrees_with_the_dense_solution(motion):
    model = am.linearize(random_robot(1, 5), "bent", **MOTIONS[motion])
    oddness = [np.abs(a - a.T).max() for a in (model.damping, model.stiffness)]
    assert max(oddness) > 1.0  # or the test would be about nothing
    rows = rows_of(model, "tip", AXES)
    found = am.frf(model, None, FREQ_HZ, frame="tip", kind="receptance", outputs=AXES, inputs=AXES)
    expected = dense_response(model, FREQ_HZ, rows, rows)
    assert difference(found.values, expected) < ROUNDING
    assert difference(found.values, expected.swapaxes(1, 2)) > 1e-3  # not reciprocal


def test_a_wrench_given_to_frf_acts_at_its_frame():
    robot, wrench = random_robot(1, 5), MOTIONS["under a moment"]["wrench"]
    model = am.linearize(robot, "bent", wrench=wrench, frame="tip")
    found = am.frf(robot, "bent", FREQ_HZ, frame="tip", wrench=wrench)
    np.testing.assert_array_equal(found.values, am.frf(model, None, FREQ_HZ, frame="tip").values)


@pytest.mark.parametrize("outputs", [("x",), ("rz", "y"), ("z", "x", "ry", "rx")])
@pytest.mark.parametrize("inputs", [("ry",), ("z", "rx"), AXES])
def test_any_axes_of_two_frames_agree_with_the_dense_solution(outputs, inputs):
    robot = random_robot(3, 6)
    model = am.linearize(robot, "bent")
    found = am.frf(
        robot, "bent", FREQ_HZ, frame="tip", input_frame="mid", kind="receptance", outputs=outputs, inputs=inputs
    )
    assert (found.outputs, found.inputs) == (outputs, inputs)
    expected = dense_response(model, FREQ_HZ, rows_of(model, "tip", outputs), rows_of(model, "mid", inputs))
    assert difference(found.values, expected) < ROUNDING


# --- Closed forms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_one_mass_on_a_spring_has_the_textbook_response(kind):
    mass, stiffness, damping = 2.0, 2e4, 30.0
    w = 2 * np.pi * FREQ_HZ
    expected = {
        "receptance": 1 / (stiffness - mass * w**2 + 1j * w * damping),
        "mobility": 1 / (damping + 1j * (w * mass - stiffness / w)),
        "accelerance": 1 / (mass - stiffness / w**2 - 1j * damping / w),
    }[kind]
    found = am.frf(
        oscillator(mass, stiffness, damping), None, FREQ_HZ, frame="mass_0", kind=kind, outputs="x", inputs="x"
    )
    np.testing.assert_allclose(found.values[:, 0, 0], expected, rtol=1e-12)  # a handful of roundings


def test_a_moment_turns_a_hinge_and_moves_its_tip_sideways():
    inertia, stiffness, damping, arm = 3.0, 4e4, 20.0, 0.7
    link = {
        "name": "disc",
        "parent": "base",
        "placement": [{"rx": "90 deg"}],
        "joint": {"type": "revolute", "axis": "z"},
        "elasticity": {"z": spring(stiffness, damping)},
        "mass": 1.0,
        "inertia": {"xx": 1, "yy": 1, "zz": inertia},
    }
    # The tip's y points along the disc's -x: what moves the tip along the disc's y moves it along its own x.
    tip = {"name": "tip", "link": "disc", "placement": [{"x": arm}, {"rz": "90 deg"}]}
    robot = robot_of([link], frames=[tip])
    found = am.frf(robot, [0.4], FREQ_HZ, frame="tip", kind="receptance", outputs=AXES, inputs=AXES).values
    s = 2j * np.pi * FREQ_HZ
    turn = 1 / (s**2 * inertia + s * damping + stiffness)
    row = np.array([arm, 0, 0, 0, 0, 1.0])
    np.testing.assert_allclose(
        found, turn[:, None, None] * np.outer(row, row), rtol=1e-12, atol=1e-15 * abs(turn).max()
    )


def test_without_motion_the_response_is_the_deflection_under_a_small_force():
    # The force is applied for good: gravity and springs find a new balance, and the pose tells where.
    robot = kuka()
    sensor, before = robot.frame_index("sensor"), am.linearize(robot, "milling", equilibrium="static")
    compliance = am.frf(before, None, [0.0], frame="sensor", kind="receptance").values[0]
    assert not compliance.imag.any()
    pose = robot.mechanism.pose(before.q, sensor)
    for j, force in enumerate(np.eye(3)):
        ends = []
        for newton in (-1.0, 1.0):
            wrench = [*(newton * pose[:3, :3] @ force), 0, 0, 0]
            after = am.linearize(robot, "milling", wrench=wrench, frame="sensor", equilibrium="static")
            ends.append(robot.mechanism.pose(after.q, sensor)[:3, 3])
        moved = pose[:3, :3].T @ (ends[1] - ends[0]) / 2
        # Poses of about 1 m round to 1e-16, against some 1e-6 m/N; a central difference leaves terms of third order.
        assert np.abs(moved - compliance[:, j]).max() < 1e-8 * np.abs(compliance).max()


def test_at_low_frequency_the_response_tends_to_the_static_compliance():
    robot = kuka()
    model = am.linearize(robot, "milling")
    rows = rows_of(model, "sensor")
    static = rows @ np.linalg.solve(model.stiffness, rows.T)
    at_zero, low = am.frf(robot, "milling", [0.0, 0.01], frame="sensor", kind="receptance").values
    np.testing.assert_allclose(at_zero, static, rtol=0, atol=1e-12 * np.abs(static).max())
    # The first mode, at 10 Hz, raises it by (0.01 / 10)².
    assert 1e-8 < np.abs(low - static).max() / np.abs(static).max() < 1e-5


def test_at_high_frequency_the_accelerance_tends_to_the_inverse_mass():
    robot = kuka().with_values(dict.fromkeys(kuka().parameters("damping"), 0.0))
    model = am.linearize(robot, "milling")
    rows = rows_of(model, "sensor")
    free = rows @ np.linalg.solve(model.mass, rows.T)
    found = am.frf(robot, "milling", [1e5], frame="sensor").values[0]
    # The last mode, at 112 Hz, changes it by about (112 / 1e5)².
    np.testing.assert_allclose(found, free, rtol=0, atol=1e-5 * np.abs(free).max())


# --- Laws ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_kinds_differ_by_i_omega(name):
    robot, posture, frame = ROBOTS[name]()
    x, v, a = (
        am.frf(robot, posture, FREQ_HZ, frame=frame, kind=kind).values
        for kind in ("receptance", "mobility", "accelerance")
    )
    s = 2j * np.pi * FREQ_HZ[:, None, None]
    np.testing.assert_allclose(v, s * x, rtol=1e-13)
    np.testing.assert_allclose(a, s * v, rtol=1e-13)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_at_rest_is_reciprocal(name):
    robot, posture, frame = ROBOTS[name]()
    here = am.frf(robot, posture, FREQ_HZ, frame=frame, outputs=AXES, inputs=AXES).values
    assert difference(here, here.swapaxes(1, 2)) < 1e-12  # rounding


def test_hitting_there_and_watching_here_is_watching_there_and_hitting_here():
    robot = random_robot(4, 7)
    there = am.frf(robot, "bent", FREQ_HZ, frame="tip", input_frame="mid", outputs=AXES, inputs=AXES).values
    here = am.frf(robot, "bent", FREQ_HZ, frame="mid", input_frame="tip", outputs=AXES, inputs=AXES).values
    assert difference(here, there.swapaxes(1, 2)) < ROUNDING


@pytest.mark.parametrize("name", ROBOTS)
def test_the_modes_add_up_to_the_response(name):
    robot, posture, frame = ROBOTS[name]()
    model = am.linearize(robot, posture)
    modes = am.modes(model)
    assert modes.oscillatory.all()
    rows, s = rows_of(model, frame), 2j * np.pi * FREQ_HZ
    expected = np.zeros((len(FREQ_HZ), 3, 3), complex)
    for pole, u in zip(modes.poles, modes.shapes.T, strict=True):
        # Z is symmetric: the residue of its inverse at a pole is u uᵀ / (uᵀ Z'(λ) u).
        residue = np.outer(rows @ u, rows @ u) / (u @ (2 * pole * model.mass + model.damping) @ u)
        for p, r in ((pole, residue), (pole.conj(), residue.conj())):
            expected += r / (s - p)[:, None, None]
    found = am.frf(robot, posture, FREQ_HZ, frame=frame, kind="receptance").values
    assert difference(found, expected) < 1e-8  # residues cancel by some orders between resonances


# --- Undamped robots ----------------------------------------------------------------------------------------


def undamped_pair(detuning: float) -> tuple[am.Robot, float]:
    """Two slides in a row, and a frequency at which the first entry of Z, k1 - ω² (m1 + m2), all but cancels."""
    m1, m2, k1, k2 = 3.0, 2.0, 7e4, 5e4
    return slides([m1, m2], [spring(k1), spring(k2)]), np.sqrt(k1 / (m1 + m2)) * (1 + detuning) / (2 * np.pi)


@pytest.mark.parametrize("detuning", [0.0, *(sign * 10.0**-p for p in range(3, 16) for sign in (1, -1))])
def test_an_undamped_line_where_an_inner_pivot_cancels_is_as_accurate_as_any(detuning):
    robot, freq_hz = undamped_pair(detuning)
    found = am.frf(robot, None, [freq_hz], frame="mass_1", kind="receptance", outputs="x", inputs="x").values[0, 0, 0]
    # In absolute positions: Z = [[k1 + k2 - w² m1, -k2], [-k2, k2 - w² m2]].
    w2 = (2 * np.pi * freq_hz) ** 2
    a, b, c = 12e4 - w2 * 3.0, -5e4, 5e4 - w2 * 2.0
    assert found == pytest.approx(a / (a * c - b * b), rel=1e-9)


def test_a_line_exactly_on_an_undamped_resonance_is_refused():
    # 1 kg, and a spring whose number is ω² to the last bit.
    robot = oscillator(1.0, (2 * np.pi) * (2 * np.pi))
    with pytest.raises(ModelError, match="undamped resonance"):
        am.frf(robot, None, [0.5, 1.0, 1.5], frame="mass_0", outputs="x", inputs="x")
    beside = am.frf(robot, None, [0.5, 1.5], frame="mass_0", outputs="x", inputs="x").values[:, 0, 0]
    np.testing.assert_allclose(beside, np.array([-0.25, -2.25]) / (1 - np.array([0.25, 2.25])), rtol=1e-13)


def test_a_rigid_body_has_no_response_to_a_constant_force():
    robot = slides([2.0], ["free"])
    with pytest.raises(ModelError, match="resonance"):
        am.frf(robot, None, [0.0, 1.0], frame="mass_0", outputs="x", inputs="x")
    found = am.frf(robot, None, [1.0, 2.0], frame="mass_0", outputs="x", inputs="x").values
    np.testing.assert_allclose(found, 0.5, rtol=1e-14)  # Newton: a = F / m


# --- Batches ------------------------------------------------------------------------------------------------


def test_many_postures_at_once_are_the_same_as_one_by_one():
    robot = kuka()
    models = [am.linearize(robot, [0.1 * i, 1.2 - 0.2 * i, -1.7 + 0.3 * i]) for i in range(7)]
    together = am.responses(models, FREQ_HZ, frame="sensor")
    alone = [am.responses([model], FREQ_HZ, frame="sensor")[0] for model in models]
    np.testing.assert_array_equal(together, np.array(alone))
    np.testing.assert_array_equal(alone[3], am.frf(models[3], None, FREQ_HZ, frame="sensor", kind="receptance").values)


def test_many_impedance_sets_at_once_are_the_same_as_robots_one_by_one():
    robot, rng = kuka(), np.random.default_rng(5)
    model = am.linearize(robot, "milling")
    spring, damper = (v * rng.uniform(0.5, 2.0, (6, 9)) for v in (model.spring, model.damper))
    together = am.responses([model], FREQ_HZ, frame="sensor", spring=spring, damper=damper)
    for case in range(6):
        values = {f"{path}.stiffness": k for path, k in zip(model.impedances, spring[case], strict=True)}
        values |= {f"{path}.damping": d for path, d in zip(model.impedances, damper[case], strict=True)}
        changed = am.frf(robot.with_values(values), "milling", FREQ_HZ, frame="sensor", kind="receptance")
        assert difference(together[case], changed.values) < 1e-12  # the file takes the numbers as they are


def test_impedances_left_out_are_the_models_own():
    model = am.linearize(kuka(), "milling")
    spring, damper = model.spring * [[1.0], [1.1]], model.damper * [[1.0], [1.2], [1.4]]
    both = am.responses([model], FREQ_HZ, frame="sensor", spring=spring, damper=np.tile(model.damper, (2, 1)))
    np.testing.assert_array_equal(am.responses([model], FREQ_HZ, frame="sensor", spring=spring), both)
    assert am.responses([model], FREQ_HZ, frame="sensor", damper=damper).shape == (3, len(FREQ_HZ), 3, 3)
    assert am.responses([model], FREQ_HZ, frame="sensor", damper=damper[1]).shape == (1, len(FREQ_HZ), 3, 3)


# --- What is refused ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", [("x", "w"), ("tx",), (), ("X",), ("rx", "r")])
@pytest.mark.parametrize("side", ["outputs", "inputs"])
def test_an_unknown_axis_is_refused_by_name(side, axes):
    with pytest.raises(FrfError, match=side):
        am.frf(kuka(), "milling", FREQ_HZ, frame="sensor", **{side: axes})
    with pytest.raises(FrfError, match=rf"{side}.*x y z rx ry rz"):
        am.responses([am.linearize(kuka(), "milling")], FREQ_HZ, frame="sensor", **{side: axes})


@pytest.mark.parametrize("frames", [{"frame": "senser"}, {"frame": "sensor", "input_frame": "senser"}])
def test_an_unknown_frame_is_refused_with_the_nearest_one(frames):
    with pytest.raises(PostureError, match=r"'senser'.*sensor"):
        am.frf(kuka(), "milling", FREQ_HZ, **frames)


@pytest.mark.parametrize(
    "freq_hz", [[], [[1.0]], 5.0, [1.0, 1.0], [2.0, 1.0], [-1.0], [np.nan], [1.0, np.inf], ["ten"], "1:30:0.2", None]
)
def test_lines_that_are_no_frequencies_are_refused(freq_hz):
    with pytest.raises(FrfError, match="freq_hz"):
        am.frf(kuka(), "milling", freq_hz, frame="sensor")


@pytest.mark.parametrize(
    "impedances",
    [{"spring": np.ones((2, 8))}, {"damper": np.ones(3)}, {"spring": np.full((1, 9), np.nan)}, {"spring": "stiff"}],
)
def test_impedances_that_do_not_fit_are_refused(impedances):
    with pytest.raises(FrfError, match="responses"):
        am.responses([am.linearize(kuka(), "milling")], FREQ_HZ, frame="sensor", **impedances)


@pytest.mark.parametrize(
    "extra", [{"wrench": [0, 0, -50.0, 0, 0, 0]}, {"equilibrium": "static"}, {"posture": "milling"}], ids=str
)
def test_a_linear_model_takes_no_second_operating_point(extra):
    model = am.linearize(kuka(), "milling")
    with pytest.raises(PostureError, match="linear model"):
        am.frf(model, **({"posture": None, "freq_hz": FREQ_HZ, "frame": "sensor"} | extra))


def test_gravity_changes_the_response_of_a_pendulum_as_it_changes_its_frequency():
    # 2 kg hang 0.5 m below a hinge of 20 N m/rad: gravity adds m g l.
    link = {
        "name": "rod",
        "parent": "base",
        "joint": {"type": "revolute", "axis": "y"},
        "elasticity": {"y": spring(20.0)},
        "mass": 2.0,
        "com": [0, 0, -0.5],
    }
    found = am.frf(robot_of([link]), None, [0.0], frame="rod", kind="receptance", outputs=["ry"], inputs=["ry"])
    assert found.values[0, 0, 0] == pytest.approx(1 / (20.0 + 2.0 * G * 0.5), rel=1e-14)
