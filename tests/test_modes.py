"""Modes against closed forms, LAPACK on the paper's own pencil, and the identities that shapes and shares obey."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg

import armonic as am
from armonic.errors import FrfError, ModelError, PostureError
from armonic.linear import LinearModel
from models import Complex, G, dynamic_stiffness, oscillator, pendulum, random_robot, robot_of, slides, spring
from trees import Array

EPS = np.finfo(float).eps
TURN = 2 * np.pi


@cache
def kuka() -> LinearModel:
    return am.linearize(am.load("kuka_kr90"), "milling")


MODELS = {
    "kuka_kr90": kuka,
    "huynh_3r": lambda: am.linearize(am.load("huynh_3r"), "milling"),
    "a robot that moves": lambda: am.linearize(random_robot(1, 5), "bent", velocity=[3.0, -2.0, 1.5, 4.0, -1.0]),
    **{f"{n} random joints": lambda n=n: am.linearize(random_robot(n, n), "bent") for n in (1, 2, 4, 7, 10, 12)},
    "heavily damped": lambda: am.linearize(random_robot(8, 6, damping=0.1), "bent"),
}


@pytest.fixture(params=MODELS, scope="module")
def model(request: pytest.FixtureRequest) -> LinearModel:
    return MODELS[request.param]()


# --- One coordinate -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.0, 1e-4, 0.02, 0.5, 0.99])
def test_a_damped_oscillator_has_its_textbook_frequencies(ratio):
    mass, stiffness = 3.0, 3.0 * (TURN * 7.0) ** 2
    modes = am.modes(oscillator(mass, stiffness, 2 * ratio * np.sqrt(mass * stiffness)))
    assert len(modes) == 1
    assert modes.coordinates == ("mass_0.tx",)
    assert modes.natural_freq_hz[0] == pytest.approx(7.0, rel=1e-13)
    assert modes.damped_freq_hz[0] == pytest.approx(7.0 * np.sqrt(1 - ratio**2), rel=1e-12)
    assert modes.damping_ratio[0] == pytest.approx(ratio, rel=1e-12, abs=1e-15)
    assert modes.poles[0] == pytest.approx(TURN * 7.0 * (-ratio + 1j * np.sqrt(1 - ratio**2)), rel=1e-12)
    assert modes.oscillatory[0]
    assert modes.shapes[0, 0] == pytest.approx(1 / np.sqrt(mass), rel=1e-12)
    assert modes.participation[0, 0] == 1.0
    assert modes.stability == ("asymptotically stable" if ratio else "marginal")


# Up to a pole 1e10 times slower than the other, which must not pass for a rigid body's.
@pytest.mark.parametrize("ratio", [1.01, 3.0, 100.0, 5e4])
def test_an_overdamped_oscillator_has_two_real_poles_that_do_not_oscillate(ratio):
    modes = am.modes(oscillator(1.0, 1.0, 2 * ratio))
    fast = -ratio - np.sqrt(ratio**2 - 1)
    assert len(modes) == 2
    # Eigenvalues are known to rounding of the larger one.
    np.testing.assert_allclose(modes.poles, [1 / fast, fast], rtol=1e-13, atol=4 * EPS * abs(fast))
    assert not modes.oscillatory.any()
    assert not modes.damped_freq_hz.any()
    np.testing.assert_allclose(modes.natural_freq_hz, np.abs(modes.poles) / TURN, rtol=1e-14)
    np.testing.assert_array_equal(modes.damping_ratio, [1.0, 1.0])


@pytest.mark.parametrize("ratio", [1.01, 3.0, 100.0])
def test_an_overdamped_oscillator_is_stable(ratio):
    assert am.modes(oscillator(1.0, 1.0, 2 * ratio)).stability == "asymptotically stable"


# --- Two coordinates ----------------------------------------------------------------------------------------


def test_two_equal_masses_in_a_row_have_the_golden_ratio_in_their_frequencies():
    mass, stiffness = 2.0, 5e4
    modes = am.modes(slides([mass, mass], [spring(stiffness)] * 2))
    # w² = k/m (3 -+ sqrt 5) / 2, the squares of the golden ratio's inverse and itself.
    golden = np.array([(np.sqrt(5) - 1) / 2, (np.sqrt(5) + 1) / 2])
    np.testing.assert_allclose(modes.natural_freq_hz, golden * np.sqrt(stiffness / mass) / TURN, rtol=1e-13)
    # Absolute displacements are 1 to the golden ratio, and as much the other way round; here they are relative.
    absolute = np.cumsum(modes.shapes.real, axis=0)
    np.testing.assert_allclose(absolute[1] / absolute[0], [golden[1], -golden[0]], rtol=1e-12)
    stretch = np.array([[1.0, 1.0], [golden[1] - 1, -golden[0] - 1]])
    np.testing.assert_allclose(modes.participation, stretch**2 / (stretch**2).sum(axis=0), rtol=1e-12)
    assert modes.movers(0) == (
        ("mass_0.tx", pytest.approx(modes.participation[0, 0])),
        ("mass_1.tx", pytest.approx(modes.participation[1, 0])),
    )
    assert modes.movers(0, count=1)[0][0] == "mass_0.tx"
    assert [name for name, _ in modes.movers(0, least=0.5)] == ["mass_0.tx"]


def test_dampers_in_proportion_to_springs_damp_every_mode_in_proportion_to_its_frequency():
    mass, stiffness, beta = 2.0, 5e4, 1e-4
    modes = am.modes(slides([mass, mass], [spring(stiffness, beta * stiffness)] * 2))
    np.testing.assert_allclose(modes.damping_ratio, beta * TURN * modes.natural_freq_hz / 2, rtol=1e-11)
    # The shapes stay real.
    assert np.abs(modes.shapes.imag).max() < 1e-12 * np.abs(modes.shapes).max()


# --- Rigid bodies, and the verdict --------------------------------------------------------------------------


def every_number(modes: am.Modes) -> Array:
    names = ("poles", "natural_freq_hz", "damped_freq_hz", "damping_ratio", "shapes", "participation")
    return np.concatenate([np.abs(getattr(modes, name)).ravel() for name in names])


def test_a_free_mass_has_its_poles_at_zero():
    modes = am.modes(slides([2.0], ["free"]))
    np.testing.assert_array_equal(modes.poles, [0.0, 0.0])
    assert np.isfinite(every_number(modes)).all()
    assert not modes.oscillatory.any()
    assert not modes.damping_ratio.any()
    assert not modes.participation.any()  # no spring is strained
    assert modes.movers(0) == ()
    assert modes.stability == "marginal"


@pytest.mark.parametrize("damping", [0.0, 40.0])
def test_two_masses_on_one_spring_drift_freely_and_swing_against_each_other(damping):
    m1, m2, stiffness = 2.0, 3.0, 5e4
    modes = am.modes(slides([m1, m2], ["free", spring(stiffness, damping)]))
    np.testing.assert_array_equal(modes.poles[:2], [0.0, 0.0])
    reduced = m1 * m2 / (m1 + m2)
    assert modes.natural_freq_hz[2] == pytest.approx(np.sqrt(stiffness / reduced) / TURN, rel=1e-12)
    assert modes.damping_ratio[2] == pytest.approx(damping / (2 * np.sqrt(stiffness * reduced)), abs=1e-12)
    np.testing.assert_allclose(modes.participation, [[0, 0, 0], [0, 0, 1]], atol=1e-12)
    assert modes.stability == "marginal"
    assert np.isfinite(every_number(modes)).all()


def floating(n: int, rng: np.random.Generator, *, rigid: int, damping: float) -> LinearModel:
    """A model with stiffness and damping in all but some directions, whose coordinates differ by orders in size."""
    size = 10.0 ** rng.uniform(-1, 1, n)
    root, held = rng.normal(size=(n, n)), rng.normal(size=(n, n - rigid))
    stiffness = 1e6 * (held @ held.T) * np.outer(size, size)
    mass = (root @ root.T + np.eye(n)) * np.outer(size, size)
    names = tuple(f"joint_{i}.z" for i in range(n))
    none = {"impedances": (), "directions": np.zeros((0, n)), "spring": np.zeros(0), "damper": np.zeros(0)}
    return replace(kuka(), coordinates=names, mass=mass, damping=damping * stiffness, stiffness=stiffness, **none)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize(("n", "rigid"), [(2, 1), (3, 1), (3, 2), (6, 1), (9, 3)])
def test_rigid_body_poles_are_zero_whatever_rounding_does_to_them(n, rigid, damping):
    # A double eigenvalue zero comes out of LAPACK as the square root of rounding, anywhere around zero.
    rng = np.random.default_rng([n, rigid])
    for _ in range(40):
        modes = am.modes(floating(n, rng, rigid=rigid, damping=damping))
        assert np.count_nonzero(modes.poles == 0) == 2 * rigid
        assert modes.stability == "marginal"


def test_a_turntable_that_is_free_leaves_the_other_modes_as_they_are():
    robot = am.load("kuka_kr90")
    free = am.Robot.from_yaml(robot.to_yaml().replace("z: {stiffness: 5.0e6, damping: 20}", "z: free"))
    soft = robot.with_values(
        {"links.carousel.elasticity.z.stiffness": 1e-3, "links.carousel.elasticity.z.damping": 0.0}
    )
    modes, expected = am.modes(free, "milling"), am.modes(soft, "milling")
    np.testing.assert_array_equal(modes.poles[:2], [0.0, 0.0])
    np.testing.assert_allclose(modes.poles[2:], expected.poles[1:], rtol=1e-8)
    assert modes.stability == "marginal"
    assert not modes.participation[:, :2].any()


def test_an_inverted_pendulum_on_too_soft_a_spring_falls():
    mass, length, inertia = 2.0, 0.8, 0.3
    weight, whole = mass * G * length, inertia + mass * length**2
    rate = np.sqrt(0.5 * weight / whole)
    fallen = am.modes(pendulum(0.5 * weight, mass=mass, length=length, inertia=inertia))
    np.testing.assert_allclose(np.sort(fallen.poles.real), [-rate, rate], rtol=1e-12)
    assert not fallen.oscillatory.any()
    assert fallen.stability == "unstable"
    upright = am.modes(pendulum(1.5 * weight, mass=mass, length=length, inertia=inertia))
    assert upright.natural_freq_hz[0] == pytest.approx(rate / TURN, rel=1e-12)
    assert upright.stability == "marginal"  # nothing damps it


def test_the_verdict_tells_the_three_cases_apart():
    robot = am.load("kuka_kr90")
    undamped = robot.with_values(dict.fromkeys(robot.parameters("damping"), 0.0))
    assert am.modes(robot, "milling").stability == "asymptotically stable"
    assert am.modes(undamped, "milling").stability == "marginal"
    model = kuka()
    assert am.modes(replace(model, damping=-model.damping)).stability == "unstable"


# --- Shapes -------------------------------------------------------------------------------------------------


def test_shapes_and_poles_leave_no_residual(model):
    modes = am.modes(model)
    n = len(model.coordinates)
    Z = dynamic_stiffness(modes.poles, model.mass, model.damping, model.stiffness)
    for pole, u, z in zip(modes.poles, modes.shapes.T, Z, strict=True):
        size = sum(
            np.linalg.norm(a, 2) * abs(pole) ** p for p, a in enumerate((model.stiffness, model.damping, model.mass))
        )
        # Backward error of the eigenvalue solver, times the condition number of M that the normalization costs.
        allowed = 20 * EPS * n * np.linalg.cond(model.mass) * size * np.linalg.norm(u)
        assert np.linalg.norm(z @ u) < allowed


def test_shapes_are_mass_normalized_and_turned_towards_the_real_axis(model):
    modes = am.modes(model)
    by_mass = modes.shapes.conj().T @ model.mass @ modes.shapes
    np.testing.assert_allclose(np.diag(by_mass), 1.0, rtol=1e-10)
    turned = np.einsum("im,ij,jm->m", modes.shapes, model.mass, modes.shapes)
    assert (turned.real > 0).all()
    assert np.abs(turned.imag).max() < 1e-10
    largest = modes.shapes[np.argmax(np.abs(modes.shapes), axis=0), range(len(modes))]
    assert (largest.real > 0).all()


def test_modes_are_the_eigenvalues_of_the_papers_pencil(model):
    # Huynh et al. 2021, Eqs. 18 and 19: A' λ + B' = 0 by LAPACK's generalized solver, which never factors M alone.
    M, C, K = model.mass, model.damping, model.stiffness
    none = np.zeros_like(M)
    expected = scipy.linalg.eigvals(-np.block([[K, none], [none, -M]]), np.block([[C, M], [M, none]]))
    modes = am.modes(model)
    found = np.concatenate([modes.poles, modes.poles[modes.oscillatory].conj()])
    assert found.shape == expected.shape
    gaps = np.abs(found[:, None] - expected)
    # One to one, within the rounding of the generalized problem.
    assert sorted(np.argmin(gaps, axis=1)) == list(range(len(expected)))
    assert gaps.min(axis=1).max() < 1e-9 * np.abs(expected).max()


def test_modes_are_sorted_and_described_by_their_poles(model):
    modes = am.modes(model)
    assert (np.diff(modes.natural_freq_hz) >= 0).all()
    assert (modes.poles.imag >= 0).all()
    assert len(modes) == len(modes.poles) == modes.shapes.shape[1] == modes.participation.shape[1]
    np.testing.assert_allclose(modes.natural_freq_hz, np.abs(modes.poles) / TURN, rtol=1e-14)
    np.testing.assert_allclose(modes.damped_freq_hz, modes.poles.imag / TURN, rtol=1e-14)
    np.testing.assert_allclose(modes.damping_ratio, -modes.poles.real / np.abs(modes.poles), rtol=1e-14)
    np.testing.assert_array_equal(modes.oscillatory, modes.poles.imag > 0)


# --- Participation ------------------------------------------------------------------------------------------


def test_participation_of_all_coordinates_adds_up_to_one(model):
    np.testing.assert_allclose(am.modes(model).participation.sum(axis=0), 1.0, rtol=1e-12)


def test_participation_is_what_a_stiffness_does_to_a_frequency():
    robot = am.Robot.from_yaml(am.load("kuka_kr90").to_yaml().replace("[0, 0, -9.81]", "[0, 0, 0]"))
    robot = robot.with_values(dict.fromkeys(robot.parameters("damping"), 0.0))
    modes = am.modes(robot, "milling")
    h = 1e-3
    for i, path in enumerate(robot.parameters("stiffness")):
        k = robot.parameters(path)[path]
        logs = [
            np.log(am.modes(robot.with_values({path: k * np.exp(step * h)}), "milling").natural_freq_hz)
            for step in (-2, -1, 1, 2)
        ]
        slope = np.array([1, -8, 8, -1]) @ logs / (12 * h)
        # Fourth order in a step of 1e-3 (1e-12); eigenvalues round to 1e-13, over the step.
        np.testing.assert_allclose(modes.participation[i], 2 * slope, rtol=0, atol=1e-8)


def test_bushings_take_their_share_from_the_coordinates():
    # A slide held by its own spring and, in parallel, by a bushing three times as stiff.
    bushing = {"name": "pad", "between": ["base", "mass_0"], "stiffness": [3e4, 0, 0, 0, 0, 0]}
    modes = am.modes(slides([2.0], [spring(1e4)], bushings=[bushing]))
    assert modes.natural_freq_hz[0] == pytest.approx(np.sqrt(4e4 / 2.0) / TURN, rel=1e-13)
    assert modes.participation[0, 0] == pytest.approx(0.25, rel=1e-13)
    assert modes.bushings[0] == "pad.x"
    assert modes.bushing_participation[0, 0] == pytest.approx(0.75, rel=1e-13)
    assert [name for name, _ in modes.movers(0)] == ["pad.x", "mass_0.tx"]


# --- Modal assurance criterion ------------------------------------------------------------------------------


def random_shapes(seed: int, n: int, m: int) -> Complex:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, m)) + 1j * rng.normal(size=(n, m))


def test_mac_of_a_set_with_itself_is_one_on_the_diagonal_and_symmetric(model):
    modes = am.modes(model)
    found = am.mac(modes, modes)
    np.testing.assert_allclose(np.diag(found), 1.0, rtol=1e-13)
    np.testing.assert_allclose(found, found.T, rtol=1e-12)
    assert (found >= 0).all()
    assert (found <= 1 + 1e-12).all()
    root = np.linalg.cholesky(modes.mass).T  # mass-weighted: in these coordinates shapes have one unit
    np.testing.assert_allclose(found, am.mac(root @ modes.shapes, root @ modes.shapes), atol=1e-12)


def test_mac_does_not_see_complex_scale():
    a, b = random_shapes(0, 5, 3), random_shapes(1, 5, 4)
    scale = 10.0 ** np.arange(-3, 1) * np.exp(1j * np.arange(4))
    found = am.mac(a, b)
    assert found.shape == (3, 4)
    np.testing.assert_allclose(am.mac(a, b * scale), found, rtol=1e-12)
    np.testing.assert_allclose(am.mac(b, a), found.T, rtol=1e-12)


def test_mac_of_two_vectors_is_the_squared_cosine_of_their_angle():
    # cos² between (1, 0) and (cos t, e^{ip} sin t) is cos² t, whatever the phase p.
    t = np.array([0.0, 0.3, 1.0, np.pi / 2])
    b = np.array([np.cos(t), np.exp(0.7j) * np.sin(t)])
    np.testing.assert_allclose(am.mac(np.array([[2.0 + 0j], [0.0]]), b)[0], np.cos(t) ** 2, atol=1e-15)
    # |1·1 + 1·(-i)|² / (2 · 2): the first vector is conjugated.
    assert am.mac(np.array([[1.0 + 0j], [1j]]), np.array([[1.0 + 0j], [1.0]]))[0, 0] == pytest.approx(0.5)
    assert am.mac(np.array([[1.0 + 0j], [1j]]), np.array([[1.0 + 0j], [-1j]]))[0, 0] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (np.ones((3, 2)), np.ones((4, 2))),
        (np.ones(3), np.ones((3, 1))),
        (np.ones((3, 1)), np.zeros((3, 1))),
        (np.full((3, 1), np.nan), np.ones((3, 1))),
    ],
    ids=["lengths", "one axis", "zero", "NaN"],
)
def test_shapes_that_cannot_be_compared_are_refused(a, b):
    with pytest.raises(FrfError, match="mac"):
        am.mac(a, b)
    with pytest.raises(FrfError, match="mac"):
        am.mac(b, a)


# --- What is refused ----------------------------------------------------------------------------------------


def test_a_coordinate_without_mass_is_refused():
    joint = {"joint": {"type": "revolute", "axis": "z"}, "elasticity": {"z": spring(1e4)}}
    robot = robot_of([{"name": "disc", "parent": "base", "mass": 1.0, **joint}])  # a point mass on the axis
    with pytest.raises(ModelError, match="mass matrix"):
        am.modes(robot)


@pytest.mark.parametrize(
    "extra", [{"posture": "milling"}, {"wrench": [0.0] * 6, "frame": "sensor"}, {"equilibrium": "static"}], ids=str
)
def test_a_linear_model_takes_no_second_operating_point(extra):
    with pytest.raises(PostureError, match="linear model"):
        am.modes(kuka(), **extra)


def test_modes_say_the_posture_they_belong_to():
    assert am.modes(am.load("kuka_kr90"), "milling").posture == "milling"
    assert "1.2" in am.modes(am.load("kuka_kr90"), [0.0, 1.2, -1.7]).posture
    # Without one it is the only one that the robot names.
    alone, given = (am.modes(am.load("huynh_3r"), p) for p in (None, "milling"))
    np.testing.assert_array_equal(alone.poles, given.poles)
    two = am.Robot.from_yaml(am.load("huynh_3r").to_yaml().rstrip() + "\n  home: [0, 0, 0]\n")
    with pytest.raises(am.PostureError, match="one of milling, home"):
        am.modes(two)


def test_masses_many_orders_off_are_refused_and_overflow_nothing():
    light = slides([1e-300], [spring(1e6, 1e3)])
    with pytest.raises(am.ModelError, match=r"rate of .*many orders off"):
        am.modes(light)
