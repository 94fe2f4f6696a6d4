"""Modes keep their numbers along a walk, also where poles are equal, veer sharply or where two blocks meet."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import armonic as am
from armonic.surveying import running
from models import random_robot, robot_of, spring
from surveyed import smooth
from trees import Array

CROSSING, VEERING = [1, 1], [2, 2]
K = 1e4
SWEPT = "links.a.elasticity.tx.stiffness"


def two_slides(coupling: float = 0.0, damping: tuple[float, float] = (0.0, 0.0)) -> am.Robot:
    """Two masses of 1 kg on slides side by side, springs of K each and a spring of a share of K between them."""
    links = [
        {
            "name": name,
            "parent": "base",
            "joint": {"type": "prismatic", "axis": "x"},
            "elasticity": {"tx": spring(K, damper)},
            "mass": 1.0,
        }
        for name, damper in zip("ab", damping, strict=True)
    ]
    between = {"name": "c", "between": ["a", "b"], "stiffness": [coupling * K, 0, 0, 0, 0, 0]}
    return robot_of(links, gravity=[0, 0, 0], bushings=[between] if coupling else [])


def turned_body(angle: float) -> am.Robot:
    """A mass of 1 kg free to move in a plane, held by a spring whose two principal axes are turned by an angle."""
    links = [
        {
            "name": name,
            "parent": parent,
            "joint": {"type": "prismatic", "axis": axis},
            "elasticity": {"t" + axis: "free"},
            "mass": mass,
        }
        for name, parent, axis, mass in (("a", "base", "x", 0.0), ("b", "a", "y", 1.0))
    ]
    frames = [{"name": f"on_{link}", "link": link, "placement": [{"rz": angle}]} for link in ("base", "b")]
    held = {"name": "c", "between": ["on_base", "on_b"], "stiffness": [K, K, 0, 0, 0, 0]}
    return robot_of(links, gravity=[0, 0, 0], frames=frames, bushings=[held])


def closed_form(stiffness: Array, coupling: float) -> tuple[Array, Array]:
    """Frequencies in Hz (P, 2), the lower one first, and shapes (P, 2, 2) by rows, of `two_slides`."""
    c = coupling * K
    squares, shapes = np.linalg.eigh([[[k + c, -c], [-c, K + c]] for k in stiffness])
    return np.sqrt(squares) / (2 * np.pi), np.swapaxes(shapes, 1, 2)


def alike(found: xr.Dataset, shapes: Array) -> Array:
    """How alike the shapes of a survey are to others of length one, (P, 2), one for the same."""
    return np.abs(np.sum(found["shape"].values.conj() * shapes, axis=2))


def flagged(found: xr.Dataset) -> dict[int, list[int]]:
    """What is flagged, by place."""
    event = found.event.values
    return {int(i): event[i].tolist() for i in np.flatnonzero(event.any(axis=1))}


@pytest.mark.parametrize("damping", [(0.0, 0.0), (1.0, 2.0)])
@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("points", [5, 10, 11, 51, 250, 401])
def test_a_crossing_is_found_at_the_first_place_that_is_past_it_or_on_it(points, down, damping):
    # Odd numbers of points have a place where both poles are equal.
    k = np.linspace(0.5 * K, 1.5 * K, points)
    k = k[::-1] if down else k
    found = am.survey(two_slides(damping=damping), [0, 0], sweep={SWEPT: k})
    a, b = np.sqrt(k) / (2 * np.pi), np.full(points, np.sqrt(K) / (2 * np.pi))
    expected = np.stack([b, a] if down else [a, b], axis=1)
    np.testing.assert_allclose(found.natural_freq_hz, expected, rtol=1e-11)
    at = int(np.flatnonzero((a <= b * (1 + 1e-12)) if down else (a >= b * (1 - 1e-12)))[0])
    assert flagged(found) == {at: CROSSING}
    assert found.mac.min() > 0.999


@pytest.mark.parametrize("per_block", [4096, 16])
@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("angle", [np.pi / 6, np.pi / 4, np.pi / 3])
def test_a_crossing_is_followed_through_equal_poles_whose_shapes_a_solver_may_mix(angle, down, per_block, monkeypatch):
    # At place 15, where blocks of 16 meet, the spring is the same in all directions, and so are the frequencies.
    monkeypatch.setattr(running, "POSTURES_PER_BLOCK", per_block)
    monkeypatch.setattr(running, "FEWEST_PER_BLOCK", 1)
    k = np.linspace(0.5 * K, 1.5 * K, 31)[:: -1 if down else 1]
    found = am.survey(turned_body(angle), [0, 0], sweep={"bushings.c.stiffness.x": k})
    x, y = np.sqrt(k), np.full(31, np.sqrt(K))
    expected = np.stack([y, x] if down else [x, y], axis=1)
    np.testing.assert_allclose(2 * np.pi * found.natural_freq_hz, expected, rtol=1e-11)
    assert flagged(found) == {15: CROSSING}


def test_modes_that_touch_and_turn_back_do_not_cross():
    k = np.concatenate([np.linspace(0.5 * K, K, 20), np.linspace(K, 0.5 * K, 20)[1:]])
    found = am.survey(two_slides(), [0, 0], sweep={SWEPT: k})
    np.testing.assert_allclose(2 * np.pi * found.natural_freq_hz.values[:, 0], np.sqrt(k), rtol=1e-11)
    assert flagged(found) == {}


@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_joints_that_are_alike_are_all_passed_at_once_and_do_not_pass_each_other(damping):
    # Decoupled slides: f = sqrt(k/m) / 2 pi, three times, passing that of another one.
    alike = [("a", "x"), ("b", "y"), ("c", "z")]
    links = [
        {"name": name, "parent": "base", "joint": {"type": "prismatic", "axis": axis}, "mass": 2.0}
        | {"elasticity": {"t" + axis: spring(1e4 if name != "d" else 2e4, damping)}}
        for name, axis in [*alike, ("d", "x")]
    ]
    k = np.linspace(1e4, 4e4, 41)
    sweep = {f"links.{name}.elasticity.t{axis}.stiffness": k for name, axis in alike}
    found = am.survey(robot_of(links, gravity=[0, 0, 0]), [0, 0, 0, 0], sweep=sweep)
    expected = np.sqrt(np.stack([k, k, k, np.full(41, 2e4)], axis=1) / 2) / (2 * np.pi)
    np.testing.assert_allclose(found.natural_freq_hz, expected, rtol=1e-11)
    assert flagged(found) == {int(np.flatnonzero(k > 2e4)[0]): [1, 1, 1, 1]}


# Steps no longer than the range in which the shapes turn, or with a place in its middle.
@pytest.mark.parametrize(
    ("coupling", "width", "points"),
    [
        (0.1, 0.5, 11),
        (0.1, 0.5, 300),
        (1e-2, 0.5, 51),
        (1e-2, 0.5, 200),
        (1e-3, 0.5, 51),
        (1e-3, 0.2, 400),
        (1e-4, 0.5, 51),
        (1e-4, 1e-2, 100),
        (1e-6, 1e-4, 100),
        (1e-6, 1e-4, 301),
        (1e-6, 1e-5, 30),
    ],
)
@pytest.mark.parametrize("down", [False, True])
def test_coupled_modes_veer_and_trade_their_shapes(coupling, width, points, down):
    k = K * np.linspace(1 - width, 1 + width, points)[:: -1 if down else 1]
    found = am.survey(two_slides(coupling), [0, 0], sweep={SWEPT: k}, shapes=True)
    freq, shapes = closed_form(k, coupling)
    np.testing.assert_allclose(found.natural_freq_hz, freq, rtol=1e-9)
    # Rounding over the relative gap is what shapes are known to.
    assert alike(found, shapes).min() > 1 - 1e-6
    gap = np.diff(freq, axis=1)[:, 0]
    ((at, what),) = flagged(found).items()
    assert what == VEERING
    # The flattest part of a gap is known to rounding: there neighbours are as good.
    assert gap[at] <= gap.min() + 1e-14 * freq[0, 0]


@pytest.mark.parametrize(("coupling", "points"), [(1e-4, 10), (1e-6, 10), (1e-6, 100), (1e-7, 250)])
def test_a_veering_much_sharper_than_the_steps_is_passed_as_a_crossing(coupling, points):
    # With no place in the middle, shapes go on as if there were no coupling.
    k = np.linspace(0.5 * K, 1.5 * K, points)
    found = am.survey(two_slides(coupling), [0, 0], sweep={SWEPT: k}, shapes=True)
    assert flagged(found) == {points // 2: CROSSING}
    assert alike(found, np.broadcast_to(np.eye(2), (points, 2, 2))).min() > 0.999


@pytest.mark.parametrize("coupling", [0.0, 0.1, 1e-2])
def test_refining_a_walk_changes_no_name_at_common_places(coupling):
    k = np.linspace(0.5 * K, 1.5 * K, 8 * 60 + 1)
    found = [am.survey(two_slides(coupling), [0, 0], sweep={SWEPT: k[::step]}) for step in (8, 4, 1)]
    for finer, step in zip(found[1:], (2, 8), strict=True):
        np.testing.assert_allclose(finer.pole.values[::step], found[0].pole.values, rtol=1e-9)
        ((at, what),), ((there, also),) = flagged(found[0]).items(), flagged(finer).items()
        assert what == also
        assert abs(there / step - at) <= 1


@pytest.mark.parametrize("robot", ["scompi", "huynh_3r", (0, 3), (3, 6), (1, 6)], ids=str)
def test_refining_the_path_of_a_robot_changes_no_name_at_common_postures(robot):
    robot = am.load(robot) if isinstance(robot, str) else random_robot(*robot)
    postures = smooth(robot, 8 * 200 + 1, seed=2)
    coarse = am.survey(robot, postures[::8]).pole.values
    for step in (4, 1):
        finer = am.survey(robot, postures[::step]).pole.values
        np.testing.assert_allclose(finer[:: 8 // step], coarse, rtol=1e-9)
