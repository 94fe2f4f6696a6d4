"""Slopes of responses and poles: against closed forms, identities, and extrapolated differences of whole models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.updating.parameters import Parameter, choose
from armonic.updating.sensitivities import frf_sensitivities, mode_sensitivities, pole_sensitivities
from closed_loops import with_control
from models import Complex, oscillator, random_driven_robot, random_robot, robot_of, slides, spring

LINES = np.linspace(2.0, 90.0, 12)
# Central differences of a function with a scale of one, extrapolated twice, are good to about 1e-11 of it; resonances
# between the lines make that scale smaller, by their damping.
DIFFERENCES = 1e-6


def parameters_of(robot: am.Robot, *patterns: str, **options: Any) -> tuple[Parameter, ...]:
    posture = next(iter(robot.postures), {})
    return choose(robot, am.linearize(robot, posture).impedances, patterns, **options)


def moved(robot: am.Robot, p: Parameter, step: float) -> am.Robot:
    """The robot with one coordinate of a fit moved."""
    x = p.coordinate(robot.numbers()[p.path])
    return robot.with_values(dict.fromkeys(p.paths, p.value(x + step)))


def extrapolated(f: Callable[[float], Complex], step: float) -> Complex:
    """f'(0) by central differences at three steps and Richardson's extrapolation, of order six."""
    first = [(f(h) - f(-h)) / (2 * h) for h in (step, step / 2, step / 4)]
    second = [(4 * b - a) / 3 for a, b in pairwise(first)]
    return np.asarray((16 * second[1] - second[0]) / 15)


def assert_slopes_are_differences(robot: am.Robot, chosen: Sequence[Parameter], frame: str, posture: Any) -> None:
    H, D = frf_sensitivities(robot, posture, LINES, chosen, frame=frame)
    found, slopes = pole_sensitivities(robot, posture, chosen)
    size = np.abs(D).max()

    def response(robot: am.Robot) -> Complex:
        return am.frf(robot, posture, LINES, frame=frame, kind="receptance").values

    np.testing.assert_allclose(H, response(robot), rtol=1e-11)
    for i, p in enumerate(chosen):
        by_frf = extrapolated(lambda h, p=p: np.log(response(moved(robot, p, h)) / H), 1e-3)
        np.testing.assert_allclose(D[..., i], by_frf, atol=DIFFERENCES * size, err_msg=p.path)
        by_poles = extrapolated(lambda h, p=p: nearest(found, am.modes(moved(robot, p, h), posture)), 1e-3)
        scale = DIFFERENCES * np.abs(found.poles)
        assert (np.abs(slopes[:, i] - by_poles) <= scale).all(), p.path


def nearest(found: am.Modes, others: am.Modes) -> Complex:
    """The others' poles in the order of those found."""
    return others.poles[np.argmin(np.abs(found.poles[:, None] - others.poles), axis=1)]


def test_slopes_of_an_oscillator_are_those_of_its_formula() -> None:
    m, k, d = 2.0, 8e3, 30.0
    robot = oscillator(m, k, d)
    chosen = parameters_of(robot, "links.mass_0.*stiffness", "links.mass_0.*damping", "links.mass_0.mass")
    assert [p.path.rpartition(".")[2] for p in chosen] == ["stiffness", "damping", "mass"]
    H, D = frf_sensitivities(robot, {}, LINES, chosen, frame="mass_0", outputs=("x",), inputs=("x",))
    s = 2j * np.pi * LINES
    Z = m * s**2 + d * s + k
    np.testing.assert_allclose(H[:, 0, 0], 1 / Z, rtol=1e-13)
    np.testing.assert_allclose(D[:, 0, 0], -np.column_stack([k / Z, d * s / Z, m * s**2 / Z]), rtol=1e-12)
    found, slopes = pole_sensitivities(robot, {}, chosen)
    pole = found.poles[0]
    assert pole == pytest.approx(-d / (2 * m) + 1j * np.sqrt(k / m - (d / (2 * m)) ** 2), rel=1e-13)
    by_pole = 2 * m * pole + d
    np.testing.assert_allclose(slopes[0], [-k / by_pole, -d * pole / by_pole, -m * pole**2 / by_pole], rtol=1e-11)


@pytest.mark.parametrize("seed", [1, 2])
def test_slopes_in_every_number_of_a_random_robot_are_differences_of_whole_models(seed: int) -> None:
    robot = random_robot(seed, 3, damping=5e-3)
    everything = ("elasticity", "links.*.mass", "links.*.com.*", "links.*.inertia.*")
    chosen = parameters_of(robot, *everything, "links.*.placement.*", "frames.tip.*", "gravity.*")
    assert len(chosen) > 55
    assert_slopes_are_differences(robot, chosen, "tip", "bent")


@pytest.mark.parametrize(("seed", "feedback"), [(3, False), (5, False), (4, True), (6, True)])
def test_slopes_in_drives_and_gains_are_differences_of_whole_models(seed: int, feedback: bool) -> None:
    robot = random_driven_robot(seed, 3, feedback=feedback)
    zero = [path for path, value in robot.numbers("control.*").items() if value == 0]
    chosen = parameters_of(robot, "control.*", "links.*.drive.*", hold=zero)
    if feedback:
        assert any("state_feedback" in p.path for p in chosen)
    assert_slopes_are_differences(robot, chosen, "tip", "bent")


def test_slopes_of_scompi_are_differences_of_whole_models() -> None:
    robot = am.load("scompi")
    # The feed-forward does not enter the matrices; gains of all motors are one number in this file.
    some = "links.link_2.mass", "links.link_3.com.x", "links.link_2.dh.a", "links.link_3.dh.theta", "control.kp"
    drives = "links.link_1.drive.radius", "links.link_2.drive.gear_ratio", "links.link_3.drive.shaft_stiffness"
    chosen = parameters_of(robot, *some, "control.kd", *drives)
    assert len(chosen) == 9
    assert_slopes_are_differences(robot, chosen, "tool", "c1")


def test_real_poles_have_slopes_as_well() -> None:
    # d² > 4 m k: both poles are real, and (2 m λ + d) ∂λ = −λ ∂d.
    m, k, d = 1.0, 100.0, 50.0
    robot = oscillator(m, k, d)
    found, slopes = pole_sensitivities(robot, {}, parameters_of(robot, "damping"))
    assert not found.oscillatory.any()
    np.testing.assert_allclose(slopes[:, 0], -d * found.poles / (2 * m * found.poles + d), rtol=1e-11)
    assert (slopes.imag == 0).all()


def test_poles_stay_where_mass_damping_and_stiffness_grow_together() -> None:
    # The slopes along value·∂/∂value of all numbers that M, C and K are linear in add up to zero, gravity included.
    robot = random_robot(7, 4, damping=5e-3)
    chosen = parameters_of(robot, "elasticity", "links.*.mass", "links.*.inertia.*")
    found, slopes = pole_sensitivities(robot, "bent", chosen)
    along = [1.0 if p.scale == "log" else p.start / p.size for p in chosen]
    terms = np.abs(slopes) @ np.abs(along)
    assert (np.abs(slopes @ along) <= 1e-10 * terms).all()
    assert (terms > 0.1 * np.abs(found.poles)).all()


def test_a_response_to_its_mass_is_that_to_its_springs_with_the_sign_turned() -> None:
    # H of Z·(1 + ε) is H/(1 + ε): the logarithm's slope along all of M, C and K together is −1.
    robot = random_robot(8, 3, damping=5e-3)
    chosen = parameters_of(robot, "elasticity", "links.*.mass", "links.*.inertia.*")
    _, D = frf_sensitivities(robot, "bent", LINES, chosen, frame="mid")
    along = [1.0 if p.scale == "log" else p.start / p.size for p in chosen]
    np.testing.assert_allclose(D @ along, -1.0, rtol=1e-9)


def test_frequencies_of_undamped_robots_follow_their_springs_by_the_share_of_energy() -> None:
    robot = slides([1.0, 2.0, 1.5, 0.7], [spring(1e4), spring(2e4), spring(5e4), spring(4e4)])
    found, slopes = pole_sensitivities(robot, {}, parameters_of(robot, "stiffness"))
    np.testing.assert_allclose((slopes / found.poles[:, None]).real, found.participation.T / 2, atol=1e-11)


@pytest.mark.parametrize("driven", [False, True])
def test_shapes_change_as_those_of_moved_robots_do(driven: bool) -> None:
    # Scale and phase are free: entries are compared over the largest one.
    robot = random_driven_robot(11, 3) if driven else random_robot(9, 4, damping=5e-3)
    patterns = ["links.link_1.mass", "links.link_2.com.x", "links.link_2.placement.3.x"]
    chosen = parameters_of(robot, *patterns, "control.kp.*" if driven else "stiffness")
    found, _, slopes = mode_sensitivities(robot, "bent", chosen)
    top, every = np.argmax(np.abs(found.shapes), axis=0), np.arange(len(found))

    def ratios(robot: am.Robot) -> Complex:
        others = am.modes(robot, "bent")
        u = others.shapes[:, np.argmin(np.abs(found.poles[:, None] - others.poles), axis=1)]
        return np.asarray(u / u[top, every])

    u, head = found.shapes, found.shapes[top, every]
    for i, p in enumerate(chosen):
        expected = extrapolated(lambda h, p=p: ratios(moved(robot, p, h)), 1e-3)
        du = slopes[..., i]
        got = du / head - u * du[top, every] / head**2
        np.testing.assert_allclose(got, expected, atol=DIFFERENCES * max(1.0, np.abs(expected).max()), err_msg=p.path)
        assert (np.abs(np.sum(u.conj() * (found.mass @ du), axis=0)) <= 1e-9 * (1 + np.abs(du).max())).all()


@pytest.mark.parametrize("pattern", ["links.*.mass", "links.*.drive.rotor_inertia", "links.*.elasticity.*.stiffness"])
def test_the_slope_of_tied_numbers_is_the_sum_of_theirs(pattern: str) -> None:
    sprung = "elasticity" in pattern
    robot = slides([1.0, 2.0], [spring(1e4, 9.0), spring(2e4, 5.0)]) if sprung else random_driven_robot(3, 3)
    frame, posture = ("mass_1", {}) if sprung else ("tip", "bent")
    numbers = robot.numbers(pattern)
    alike = robot.with_values(dict.fromkeys(numbers, max(numbers.values())))
    tied, apart = parameters_of(alike, pattern, ties=[pattern]), parameters_of(alike, pattern)
    assert (len(tied), len(apart)) == (1, len(numbers))
    _, D = frf_sensitivities(alike, posture, LINES, tied, frame=frame)
    _, each = frf_sensitivities(alike, posture, LINES, apart, frame=frame)
    np.testing.assert_allclose(D[..., 0], each.sum(axis=-1), atol=1e-10 * np.abs(each).max())


def test_impedances_give_the_same_slopes_beside_other_numbers_as_alone() -> None:
    # Alone the core works them out, beside others LAPACK does.
    robot = random_robot(12, 4, damping=5e-3)
    alone, beside = parameters_of(robot, "elasticity"), parameters_of(robot, "links.link_0.mass", "elasticity")
    assert beside[-1].path == "links.link_3.elasticity.joint.damping"
    _, D = frf_sensitivities(robot, "bent", LINES, alone, frame="mid", outputs=("x", "rz"), input_frame="tip")
    _, E = frf_sensitivities(robot, "bent", LINES, beside, frame="mid", outputs=("x", "rz"), input_frame="tip")
    where = [i for i, p in enumerate(beside) if p.indices]
    np.testing.assert_allclose(E[..., where], D, atol=1e-10 * np.abs(D).max())


def test_impedances_by_differences_are_those_by_formula() -> None:
    robot = random_robot(13, 3, damping=5e-3)
    chosen = parameters_of(robot, "elasticity")
    _, D = frf_sensitivities(robot, "bent", LINES, chosen, frame="tip")
    blunt = [replace(p, indices=()) for p in chosen]
    _, E = frf_sensitivities(robot, "bent", LINES, blunt, frame="tip")
    np.testing.assert_allclose(E, D, atol=1e-10 * np.abs(D).max())
    poles, slopes = pole_sensitivities(robot, "bent", chosen)
    np.testing.assert_allclose(
        pole_sensitivities(robot, "bent", blunt)[1], slopes, atol=1e-10 * np.abs(poles.poles).max()
    )


def test_a_number_that_nothing_depends_on_has_no_slope_but_rounding() -> None:
    robot = random_robot(3, 4)  # its base stands still, wherever it is
    chosen = parameters_of(robot, "links.link_0.placement.3.*", "links.link_1.mass")
    _, D = frf_sensitivities(robot, "bent", LINES, chosen, frame="tip")
    assert np.abs(D[..., :3]).max() < 1e-11 * np.abs(D[..., 3]).max()


def test_a_response_that_vanishes_has_no_slope() -> None:
    robot = slides([1.0, 2.0], [spring(1e4, 1.0), spring(2e4, 1.0)])
    H, D = frf_sensitivities(robot, {}, LINES, parameters_of(robot, "stiffness", "links.*.mass"), frame="mass_1")
    assert not H[:, 1].any()
    assert not D[:, 1].any()
    assert D[:, 0, 0].all()


def test_integral_gains_have_slopes_at_standstill() -> None:
    # At 0 Hz an integrator on its own motor holds it: what is left is the shaft, whatever the gains.
    robot = with_control(random_driven_robot(14, 1), ki=[3e3], link_ki=[0.0])
    zero = [path for path, value in robot.numbers("control.*").items() if value == 0]
    chosen = parameters_of(robot, "control.*", "links.*.drive.shaft_stiffness", "links.*.mass", hold=zero)
    H, D = frf_sensitivities(robot, "bent", [0.0, 1.0], chosen, frame="tip")
    assert np.isfinite(H).all()
    assert np.isfinite(D).all()
    gains = [i for i, p in enumerate(chosen) if p.path.startswith("control.") and "link" not in p.path.split(".")[1]]
    still = np.abs(D[0]).max(axis=(0, 1))
    assert still[gains].max() < 1e-10
    assert still.max() > 0.1


def test_a_number_at_the_edge_of_what_is_possible_has_a_slope_from_one_side() -> None:
    # About the axis (1, 1, 0)/√2 the inertia is (xx + yy)/2 + xy; with less xy by a step of the difference it would be
    # negative. λ = i √(k/I) gives ∂λ/∂xy = −λ/(2 I).
    link = {
        "name": "rod",
        "parent": "base",
        "joint": {"type": "revolute", "axis": [1, 1, 0]},
        "elasticity": {"joint": spring(100.0)},
        "mass": 1.0,
        "inertia": {"xx": 1e-3, "yy": 1e-3, "zz": 1e-3},
    }
    robot = robot_of([link])
    (p,) = parameters_of(robot, "links.rod.inertia.xy")
    found, slopes = pole_sensitivities(robot, {}, [p])
    assert p.size / 32 > 1e-3
    assert slopes[0, 0] == pytest.approx(-found.poles[0] / (2 * 1e-3) * p.size, rel=1e-10)


def test_two_poles_at_one_place_move_by_what_moves_each() -> None:
    # Two equal oscillators that do not touch each other.
    links = [
        {
            "name": name,
            "parent": "base",
            "joint": {"type": "prismatic", "axis": "x"},
            "elasticity": {"tx": spring(1e4, 10.0)},
            "mass": 1.0,
        }
        for name in ("left", "right")
    ]
    robot = robot_of(links)
    found, slopes = pole_sensitivities(robot, {}, parameters_of(robot, "links.*.mass"))
    by_mass = -(found.poles[0] ** 2) / (2 * found.poles[0] + 10.0)
    assert sorted(np.abs(slopes / by_mass).round(10).ravel().tolist()) == [0, 0, 1, 1]


def test_the_stiffness_of_a_strained_bushing_acts_through_its_load() -> None:
    robot = random_robot(
        15,
        2,
        damping=5e-3,
        bushings=[
            {
                "name": "cable",
                "between": ["base", "tip"],
                "stiffness": [1e4, 2e4, 1e4, 10.0, 10.0, 10.0],
                "damping": [1.0] * 6,
                "rest": [0.0, 0.0],
            }
        ],
    )
    assert am.linearize(robot, "bent").loaded == ("cable",)
    chosen = parameters_of(robot, "bushings.cable.stiffness.[xyz]", "bushings.cable.damping.x")
    assert_slopes_are_differences(robot, chosen, "tip", "bent")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"frame": "nowhere"}, am.PostureError, "nowhere"),
        ({"frame": "tip", "outputs": ("u",)}, am.FrfError, "'u'"),
        ({"frame": "tip", "inputs": ()}, am.FrfError, "none"),
    ],
)
@pytest.mark.parametrize("pattern", ["stiffness", "links.link_0.mass"])
def test_frames_and_axes_that_are_not_there_are_refused(
    options: dict[str, Any], error: type[Exception], message: str, pattern: str
) -> None:
    robot = random_robot(1, 2)
    with pytest.raises(error, match=message):
        frf_sensitivities(robot, "bent", LINES, parameters_of(robot, pattern), **options)


def test_a_line_on_an_undamped_resonance_has_no_response() -> None:
    robot = oscillator(1.0, 4.0)
    on = np.array([2.0 / (2 * np.pi)])
    for pattern in ("stiffness", "links.*.mass"):
        with pytest.raises(am.ModelError, match="mass_0"):
            frf_sensitivities(robot, {}, on, parameters_of(robot, pattern), frame="mass_0", outputs="x", inputs="x")


def test_lines_that_are_no_numbers_are_refused() -> None:
    robot = oscillator(1.0, 4.0)
    with pytest.raises(am.FrfError, match="freq_hz"):
        frf_sensitivities(robot, {}, "fast", parameters_of(robot, "stiffness"), frame="mass_0")
